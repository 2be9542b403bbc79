//! The functional programs of CLEVRER: tokens, their types, and the check before anything runs.

use super::ReasonError;

/// Type of a value on the stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    Objects,
    Object,
    Events,
    Event,
    Frame,
    Color,
    Material,
    Shape,
    Side,
    Order,
    Factor,
    Law,
    Change,
    Text,
    Number,
    Bool,
}

macro_rules! ops {
    ($($op:ident: $($token:literal)|+;)*) => {
        /// One operation; a word of the vocabulary is one that pushes itself.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub enum Op { $($op,)* Color(&'static str), Material(&'static str), Shape(&'static str), Side(&'static str), Law(&'static str), Order(usize), Factor(f64) }
        /// Tokens and the operations they stand for: CLEVRER's with the aliases in use, and ours for billiards
        /// and for more changes than CLEVRER makes; a number is a factor, or a length in metres.
        pub static TOKENS: &[(&str, Op)] = &[$($(($token, Op::$op),)+)*
            ("first", Op::Order(0)), ("second", Op::Order(1)), ("last", Op::Order(usize::MAX)),
            ("gray", Op::Color("gray")), ("red", Op::Color("red")), ("blue", Op::Color("blue")),
            ("green", Op::Color("green")), ("brown", Op::Color("brown")), ("cyan", Op::Color("cyan")),
            ("purple", Op::Color("purple")), ("yellow", Op::Color("yellow")),
            ("white", Op::Color("white")), ("black", Op::Color("black")), ("orange", Op::Color("orange")),
            ("pink", Op::Color("pink")), ("left", Op::Side("left")), ("right", Op::Side("right")),
            ("friction", Op::Law("friction")), ("drag", Op::Law("drag")),
            ("top", Op::Side("top")), ("bottom", Op::Side("bottom")),
            ("rubber", Op::Material("rubber")), ("metal", Op::Material("metal")),
            ("sphere", Op::Shape("sphere")), ("cylinder", Op::Shape("cylinder")), ("cube", Op::Shape("cube")),
        ];
    };
}

ops! {
    Objects: "objects";
    Events: "events";
    AllEvents: "all_events";
    UnseenEvents: "unseen_events";
    Start: "start";
    End: "end";
    Null: "null";
    Unique: "unique";
    Count: "count";
    Exist: "exist";
    Negate: "negate";
    BelongTo: "belong_to";
    FilterColor: "filter_color";
    FilterMaterial: "filter_material";
    FilterShape: "filter_shape";
    FilterMoving: "filter_moving";
    FilterStationary: "filter_stationary";
    FilterIn: "filter_in";
    FilterOut: "filter_out";
    FilterCollision: "filter_collision";
    FilterSide: "filter_side";
    FilterPartner: "filter_partner";
    FilterBefore: "filter_before";
    FilterAfter: "filter_after";
    FilterStart: "filter_start";
    FilterEnd: "filter_end";
    FilterOrder: "filter_order";
    FilterAncestor: "filter_ancestor";
    GetFrame: "get_frame" | "query_frame";
    GetObject: "get_object" | "query_object";
    GetPartner: "get_col_partner" | "query_collision_partner";
    Counterfact: "filter_counterfact" | "get_counterfact" | "counterfact_events";
    ApplyHeavier: "apply_heavier";
    ApplyLighter: "apply_lighter";
    ScaleMass: "scale_mass";
    ScaleVelocity: "scale_velocity";
    ScaleRestitution: "scale_restitution";
    AtRest: "at_rest";
    Reverse: "reverse";
    Shift: "shift";
    AddAnother: "add_another";
    SwitchOff: "switch_off";
    Both: "both";
    QueryColor: "query_color";
    QueryMaterial: "query_material";
    QueryShape: "query_shape";
}

/// A parsed program: its operations and the tokens they came from.
#[derive(Debug, Clone, PartialEq)]
pub struct QuestionProgram {
    pub ops: Vec<Op>,
    pub tokens: Vec<String>,
}

impl QuestionProgram {
    /// Most tokens of a program: the longest in the data set has 24.
    pub const MAX_TOKENS: usize = 200;

    pub fn parse(tokens: &[String]) -> Result<QuestionProgram, ReasonError> {
        if tokens.is_empty() || tokens.len() > Self::MAX_TOKENS {
            return Err(ReasonError::ProgramLength { tokens: tokens.len(), most: Self::MAX_TOKENS });
        }
        let ops = tokens.iter().enumerate().map(|(position, token)| {
            let word = TOKENS.iter().find(|(t, _)| t == token).map(|(_, op)| *op);
            let factor = || token.parse().ok().filter(|f: &f64| f.is_finite() && *f > 0.0).map(Op::Factor);
            word.or_else(factor).ok_or_else(|| {
                let names = TOKENS.iter().map(|(t, _)| *t);
                ReasonError::UnknownToken { position, token: token.clone(), nearest: nearest(token, names) }
            })
        });
        Ok(QuestionProgram { ops: ops.collect::<Result<_, _>>()?, tokens: tokens.to_vec() })
    }

    /// Runs the types over `stack`; the first operation whose input does not fit is named.
    pub fn check(&self, stack: &mut Vec<Type>) -> Result<(), ReasonError> {
        for (position, op) in self.ops.iter().enumerate() {
            apply(*op, stack).map_err(|(expected, found)| ReasonError::ProgramType {
                position,
                token: self.tokens.get(position).cloned().unwrap_or_default(),
                expected,
                found: found.map_or("nothing".to_string(), |t| format!("{t:?}")),
            })?;
        }
        Ok(())
    }
}

/// The candidate that is written most alike.
pub(super) fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> String {
    let score = |c: &str| strsim::jaro_winkler(&word.to_lowercase(), &c.to_lowercase());
    candidates.max_by(|a, b| score(a).total_cmp(&score(b))).unwrap_or_default().to_string()
}

type Mismatch = (&'static str, Option<Type>);

fn apply(op: Op, stack: &mut Vec<Type>) -> Result<(), Mismatch> {
    use Type::*;
    let mut pop = |expected: &'static str, allowed: &[Type]| -> Result<Type, Mismatch> {
        match stack.pop() {
            Some(t) if allowed.contains(&t) => Ok(t),
            found => Err((expected, found)),
        }
    };
    let result = match op {
        Op::Objects => Objects,
        Op::Events | Op::AllEvents | Op::UnseenEvents => Events,
        Op::Start | Op::End => Event,
        Op::Null => Frame,
        Op::Color(_) => Color,
        Op::Material(_) => Material,
        Op::Shape(_) => Shape,
        Op::Side(_) => Side,
        Op::Factor(_) => Factor,
        Op::Law(_) => Law,
        Op::Order(_) => Order,
        Op::Unique => match pop("objects or events", &[Objects, Events])? {
            Objects => Object,
            _ => Event,
        },
        Op::Count => pop("objects or events", &[Objects, Events]).map(|_| Number)?,
        Op::Exist => pop("objects or events", &[Objects, Events]).map(|_| Bool)?,
        Op::Negate => pop("yes or no", &[Bool])?,
        Op::BelongTo => {
            pop("events", &[Events])?;
            pop("the event or object of a choice", &[Event, Object]).map(|_| Bool)?
        }
        Op::FilterColor | Op::FilterMaterial | Op::FilterShape => {
            match op {
                Op::FilterColor => pop("a color", &[Color])?,
                Op::FilterMaterial => pop("a material", &[Material])?,
                _ => pop("a shape", &[Shape])?,
            };
            pop("objects", &[Objects])?
        }
        Op::FilterMoving | Op::FilterStationary => {
            pop("a frame", &[Frame, Event])?;
            pop("objects", &[Objects])?
        }
        Op::FilterIn | Op::FilterOut | Op::FilterCollision => {
            pop("objects or an object", &[Objects, Object])?;
            pop("events", &[Events])?
        }
        Op::FilterSide => {
            pop("a side of the table", &[Side])?;
            pop("objects or an object", &[Objects, Object])?;
            pop("events", &[Events])?
        }
        Op::FilterPartner => {
            pop("objects", &[Objects])?;
            pop("an object", &[Object])?;
            pop("events", &[Events])?
        }
        Op::FilterBefore | Op::FilterAfter => {
            pop("an event or a frame", &[Event, Frame])?;
            pop("events", &[Events])?
        }
        Op::FilterStart | Op::FilterEnd => pop("events", &[Events]).map(|_| Event)?,
        Op::FilterOrder => {
            pop("first, second or last", &[Order])?;
            pop("events", &[Events]).map(|_| Event)?
        }
        Op::FilterAncestor => {
            pop("an event", &[Event])?;
            pop("events", &[Events])?
        }
        Op::GetFrame => pop("an event", &[Event]).map(|_| Frame)?,
        Op::GetObject => pop("an event", &[Event]).map(|_| Object)?,
        Op::GetPartner => {
            pop("an object", &[Object])?;
            pop("an event", &[Event]).map(|_| Object)?
        }
        Op::Counterfact => {
            pop("an object or a change", &[Object, Change])?;
            if stack.last() == Some(&Events) {
                stack.pop();
            }
            Events
        }
        Op::Shift => {
            pop("left, right, top or bottom", &[Side])?;
            pop("a length", &[Factor])?;
            pop("an object", &[Object]).map(|_| Change)?
        }
        Op::AddAnother => {
            pop("left, right, top or bottom", &[Side])?;
            pop("a length", &[Factor])?;
            pop("an object", &[Object])?;
            pop("objects", &[Objects]).map(|_| Change)?
        }
        Op::ScaleMass | Op::ScaleVelocity | Op::ScaleRestitution => {
            pop("a factor", &[Factor])?;
            pop("an object", &[Object]).map(|_| Change)?
        }
        Op::SwitchOff => pop("friction or drag", &[Law]).map(|_| Change)?,
        Op::Both => {
            pop("an object or a change", &[Object, Change])?;
            pop("an object or a change", &[Object, Change]).map(|_| Change)?
        }
        Op::ApplyHeavier | Op::ApplyLighter | Op::AtRest | Op::Reverse => {
            pop("an object", &[Object]).map(|_| Change)?
        }
        Op::QueryColor | Op::QueryMaterial | Op::QueryShape => pop("an object", &[Object]).map(|_| Text)?,
    };
    stack.push(result);
    Ok(())
}
