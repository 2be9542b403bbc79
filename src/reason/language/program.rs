//! The functional programs of CLEVRER: tokens, their types, and the check before anything runs.
//!
//! A program is a list of tokens in postfix order on a stack of typed values. A word or a number pushes itself; each other
//! operation pops its operands and pushes one result, as [`signature`] states. The check runs the types alone over the
//! stack: if no operation meets a wrong type, none can at run time. A question leaves one value; one that asks about choices ends
//! in `belong_to` and finds the value of a choice below it. Source of the tokens: the programs of the CLEVRER data set
//! (Yi et al., ICLR 2020); the operations for billiards and for further changes are ours.

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

impl Type {
    /// Its name in messages.
    pub(super) fn name(self) -> &'static str {
        match self {
            Type::Objects => "objects",
            Type::Object => "an object",
            Type::Events => "events",
            Type::Event => "an event",
            Type::Frame => "a frame",
            Type::Color => "a color",
            Type::Material => "a material",
            Type::Shape => "a shape",
            Type::Side => "a side",
            Type::Order => "an order",
            Type::Factor => "a number",
            Type::Law => "a law",
            Type::Change => "a change",
            Type::Text => "a text",
            Type::Number => "a count",
            Type::Bool => "yes or no",
        }
    }
}

macro_rules! ops {
    ($($op:ident: $($token:literal)|+;)*) => {
        /// One operation; a word of the vocabulary is an operation that pushes itself.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub enum Op { $($op,)* Color(&'static str), Material(&'static str), Shape(&'static str), Side(&'static str), Law(&'static str), Order(usize), Factor(f64) }
        /// Tokens and their operations: CLEVRER's with the aliases in use, and ours for billiards and further changes. A
        /// number is a factor, or a length in metres.
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

    /// Runs the types over `stack`; an error names the first operation with an operand of a wrong type.
    pub fn check(&self, stack: &mut Vec<Type>) -> Result<(), ReasonError> {
        for (position, op) in self.ops.iter().enumerate() {
            apply(*op, stack).map_err(|(expected, found)| ReasonError::ProgramType {
                position,
                token: self.tokens.get(position).cloned().unwrap_or_default(),
                expected,
                found: found.map_or("nothing", Type::name).to_string(),
            })?;
        }
        Ok(())
    }
}

/// The candidate with the most similar spelling.
pub(super) fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> String {
    let score = |c: &str| strsim::jaro_winkler(&word.to_lowercase(), &c.to_lowercase());
    candidates.max_by(|a, b| score(a).total_cmp(&score(b))).unwrap_or_default().to_string()
}

/// One operand of an operation: how messages name it, and the types it may have.
type Takes = (&'static str, &'static [Type]);
/// What was expected, and the type that was on the stack instead, if any.
type Mismatch = (&'static str, Option<Type>);

const COLOR: Takes = ("a color", &[Type::Color]);
const MATERIAL: Takes = ("a material", &[Type::Material]);
const SHAPE: Takes = ("a shape", &[Type::Shape]);
const TABLE_SIDE: Takes = ("a side of the table", &[Type::Side]);
const DIRECTION: Takes = ("left, right, top or bottom", &[Type::Side]);
const ORDER: Takes = ("first, second or last", &[Type::Order]);
const LENGTH: Takes = ("a length", &[Type::Factor]);
const FACTOR: Takes = ("a factor", &[Type::Factor]);
const LAW: Takes = ("friction or drag", &[Type::Law]);
const YES_OR_NO: Takes = ("yes or no", &[Type::Bool]);
const OBJECT: Takes = ("an object", &[Type::Object]);
const OBJECTS: Takes = ("objects", &[Type::Objects]);
const ANY_OBJECTS: Takes = ("objects or an object", &[Type::Objects, Type::Object]);
const OBJECT_OR_CHANGE: Takes = ("an object or a change", &[Type::Object, Type::Change]);
const OBJECTS_OR_EVENTS: Takes = ("objects or events", &[Type::Objects, Type::Events]);
const EVENT: Takes = ("an event", &[Type::Event]);
const EVENTS: Takes = ("events", &[Type::Events]);
const FRAME: Takes = ("a frame", &[Type::Frame, Type::Event]);
const MOMENT: Takes = ("an event or a frame", &[Type::Event, Type::Frame]);
const CHOICE: Takes = ("the event or object of a choice", &[Type::Event, Type::Object]);

/// The operands of an operation, from the top of the stack, and the type of its result.
fn signature(op: Op) -> (&'static [Takes], Type) {
    match op {
        Op::Objects => (&[], Type::Objects),
        Op::Events | Op::AllEvents | Op::UnseenEvents => (&[], Type::Events),
        Op::Start | Op::End => (&[], Type::Event),
        Op::Null => (&[], Type::Frame),
        Op::Color(_) => (&[], Type::Color),
        Op::Material(_) => (&[], Type::Material),
        Op::Shape(_) => (&[], Type::Shape),
        Op::Side(_) => (&[], Type::Side),
        Op::Factor(_) => (&[], Type::Factor),
        Op::Law(_) => (&[], Type::Law),
        Op::Order(_) => (&[], Type::Order),
        Op::Unique => (&[OBJECTS_OR_EVENTS], Type::Object),
        Op::Count => (&[OBJECTS_OR_EVENTS], Type::Number),
        Op::Exist => (&[OBJECTS_OR_EVENTS], Type::Bool),
        Op::Negate => (&[YES_OR_NO], Type::Bool),
        Op::BelongTo => (&[EVENTS, CHOICE], Type::Bool),
        Op::FilterColor => (&[COLOR, OBJECTS], Type::Objects),
        Op::FilterMaterial => (&[MATERIAL, OBJECTS], Type::Objects),
        Op::FilterShape => (&[SHAPE, OBJECTS], Type::Objects),
        Op::FilterMoving | Op::FilterStationary => (&[FRAME, OBJECTS], Type::Objects),
        Op::FilterIn | Op::FilterOut | Op::FilterCollision => (&[ANY_OBJECTS, EVENTS], Type::Events),
        Op::FilterSide => (&[TABLE_SIDE, ANY_OBJECTS, EVENTS], Type::Events),
        Op::FilterPartner => (&[OBJECTS, OBJECT, EVENTS], Type::Events),
        Op::FilterBefore | Op::FilterAfter => (&[MOMENT, EVENTS], Type::Events),
        Op::FilterStart | Op::FilterEnd => (&[EVENTS], Type::Event),
        Op::FilterOrder => (&[ORDER, EVENTS], Type::Event),
        Op::FilterAncestor => (&[EVENT, EVENTS], Type::Events),
        Op::GetFrame => (&[EVENT], Type::Frame),
        Op::GetObject => (&[EVENT], Type::Object),
        Op::GetPartner => (&[OBJECT, EVENT], Type::Object),
        Op::Counterfact => (&[OBJECT_OR_CHANGE], Type::Events),
        Op::Shift => (&[DIRECTION, LENGTH, OBJECT], Type::Change),
        Op::AddAnother => (&[DIRECTION, LENGTH, OBJECT, OBJECTS], Type::Change),
        Op::ScaleMass | Op::ScaleVelocity | Op::ScaleRestitution => (&[FACTOR, OBJECT], Type::Change),
        Op::SwitchOff => (&[LAW], Type::Change),
        Op::Both => (&[OBJECT_OR_CHANGE, OBJECT_OR_CHANGE], Type::Change),
        Op::ApplyHeavier | Op::ApplyLighter | Op::AtRest | Op::Reverse => (&[OBJECT], Type::Change),
        Op::QueryColor | Op::QueryMaterial | Op::QueryShape => (&[OBJECT], Type::Text),
    }
}

/// Replaces the operands of an operation on the stack by the type of its result.
fn apply(op: Op, stack: &mut Vec<Type>) -> Result<(), Mismatch> {
    let (operands, mut result) = signature(op);
    let mut top = None;
    for (expected, allowed) in operands {
        match stack.pop() {
            Some(t) if allowed.contains(&t) => top = top.or(Some(t)),
            found => return Err((expected, found)),
        }
    }
    if op == Op::Unique && top == Some(Type::Events) {
        result = Type::Event;
    }
    // The events that it replaces may be left out.
    if op == Op::Counterfact && stack.last() == Some(&Type::Events) {
        stack.pop();
    }
    stack.push(result);
    Ok(())
}
