//! The functional programs of CLEVRER: tokens, and the check of their types before anything runs.
//!
//! A program is a list of tokens in postfix order on a stack of typed values. A word or a number pushes itself; each other
//! operation pops its operands and pushes one result, as its row of [`OPERATIONS`] states. The check runs the types alone over
//! the stack: if no operation meets a wrong type, none can at run time. A question leaves one value; one that asks about choices
//! ends in `belong_to` and finds the value of a choice below it. Source of the tokens: the programs of the CLEVRER data set
//! (Yi et al., ICLR 2020); the quantities, and the operations for billiards and for further changes, are ours.

use crate::reason::ReasonError;
use crate::reason::operations::{OPERATIONS, Operation, operation};
use crate::reason::types::{Gives, MOMENT, Type};
use crate::reason::units::UNITS;
use crate::reason::value::{ProgramValue, SpanKind};

/// The words of programs with their types. `color:teal`, `material:wood` and `shape:box` are a scene's own words; the words of a lexicon
/// are given to the parser.
pub static WORDS: &[(&str, Type)] = &[
    ("first", Type::Order),
    ("second", Type::Order),
    ("third", Type::Order),
    ("last", Type::Order),
    ("gray", Type::Color),
    ("red", Type::Color),
    ("blue", Type::Color),
    ("green", Type::Color),
    ("brown", Type::Color),
    ("cyan", Type::Color),
    ("purple", Type::Color),
    ("yellow", Type::Color),
    ("white", Type::Color),
    ("black", Type::Color),
    ("orange", Type::Color),
    ("pink", Type::Color),
    ("rubber", Type::Material),
    ("metal", Type::Material),
    ("sphere", Type::Shape),
    ("cylinder", Type::Shape),
    ("cube", Type::Shape),
    ("left", Type::Side),
    ("right", Type::Side),
    ("top", Type::Side),
    ("bottom", Type::Side),
    ("friction", Type::Law),
    ("object_friction", Type::Law),
    ("drag", Type::Law),
    ("video", Type::Span),
    ("prediction", Type::Span),
    ("video_and_prediction", Type::Span),
];
/// Prefixes of a scene's own words.
const OWN: [(&str, Type); 3] =
    [("color:", Type::Color), ("material:", Type::Material), ("shape:", Type::Shape)];

/// One instruction of a program.
#[derive(Debug, Clone, PartialEq)]
pub enum Op {
    Call(&'static Operation),
    Push(Type, ProgramValue),
}

/// The words of programs, then the units, with their types.
pub fn known_words() -> impl Iterator<Item = (&'static str, Type)> {
    WORDS.iter().copied().chain(UNITS.iter().map(|unit| (unit.name, Type::Unit)))
}

impl Op {
    /// The operation or word of a token.
    pub fn of(token: &str) -> Option<Op> {
        if let Some(found) = operation(&token.to_lowercase()) {
            return Some(Op::Call(found));
        }
        let own = OWN.iter().find_map(|(prefix, kind)| {
            let word = token.strip_prefix(prefix).filter(|w| !w.is_empty())?;
            Some((*kind, word))
        });
        let known = || known_words().find(|(word, _)| *word == token).map(|(word, kind)| (kind, word));
        if let Some((kind, word)) = own.or_else(known) {
            return Some(Op::Push(kind, word_value(kind, word)));
        }
        let number = token.parse().ok().filter(|n: &f64| n.is_finite() && *n >= 0.0);
        number.map(|n| Op::Push(Type::Factor, ProgramValue::Factor(n)))
    }

    /// Whether it is a call of the operation with this token.
    pub fn calls(&self, token: &str) -> bool {
        matches!(self, Op::Call(operation) if operation.token == token)
    }
}

fn word_value(kind: Type, word: &str) -> ProgramValue {
    match (kind, word) {
        (Type::Order, "first") => ProgramValue::Order(0),
        (Type::Order, "second") => ProgramValue::Order(1),
        (Type::Order, "third") => ProgramValue::Order(2),
        (Type::Order, _) => ProgramValue::Order(usize::MAX),
        (Type::Span, "video") => ProgramValue::Span(SpanKind::Video),
        (Type::Span, "prediction") => ProgramValue::Span(SpanKind::Prediction),
        (Type::Span, _) => ProgramValue::Span(SpanKind::Both),
        _ => ProgramValue::Word(word.to_string()),
    }
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
        Self::parse_with(tokens, &[])
    }

    /// Parses a program that may use the words of a lexicon besides the vocabulary.
    pub fn parse_with(tokens: &[String], lexicon: &[String]) -> Result<QuestionProgram, ReasonError> {
        if tokens.is_empty() || tokens.len() > Self::MAX_TOKENS {
            return Err(ReasonError::ProgramLength { tokens: tokens.len(), most: Self::MAX_TOKENS });
        }
        let ops = tokens.iter().enumerate().map(|(position, token)| {
            let concept = || {
                let word = lexicon.iter().find(|w| *w == token)?;
                Some(Op::Push(Type::Concept, ProgramValue::Word(word.clone())))
            };
            Op::of(token).or_else(concept).ok_or_else(|| {
                let names = OPERATIONS.iter().flat_map(|o| std::iter::once(&o.token).chain(o.aliases));
                let names = names.copied().chain(known_words().map(|(word, _)| word));
                let names = names.chain(lexicon.iter().map(String::as_str));
                ReasonError::UnknownToken { position, token: token.clone(), nearest: nearest(token, names) }
            })
        });
        Ok(QuestionProgram { ops: ops.collect::<Result<_, _>>()?, tokens: tokens.to_vec() })
    }

    /// Runs the types over `stack`; an error names the first operation with an operand of a wrong type.
    pub fn check(&self, stack: &mut Vec<Type>) -> Result<(), ReasonError> {
        for (position, op) in self.ops.iter().enumerate() {
            apply(op, stack).map_err(|(expected, found)| ReasonError::ProgramType {
                position,
                token: self.tokens.get(position).cloned().unwrap_or_default(),
                expected,
                found: found.map_or("nothing", Type::name).to_string(),
            })?;
        }
        Ok(())
    }

    /// Whether it calls one of the operations.
    pub fn calls(&self, tokens: &[&str]) -> bool {
        self.ops.iter().any(|op| tokens.iter().any(|t| op.calls(t)))
    }
}

/// How many operands an operation has at least.
pub fn operand_count(op: &Op) -> usize {
    match op {
        Op::Call(operation) => operation.takes.len(),
        Op::Push(..) => 0,
    }
}

/// The candidate with the most similar spelling.
pub fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> String {
    let score = |c: &str| strsim::jaro_winkler(&word.to_lowercase(), &c.to_lowercase());
    candidates.max_by(|a, b| score(a).total_cmp(&score(b))).unwrap_or_default().to_string()
}

/// What was expected, and the type that was on the stack instead, if any.
type Mismatch = (&'static str, Option<Type>);

/// Replaces the operands of an operation on the stack by the type of its result.
pub fn apply(op: &Op, stack: &mut Vec<Type>) -> Result<(), Mismatch> {
    let operation = match op {
        Op::Push(kind, _) => {
            stack.push(*kind);
            return Ok(());
        }
        Op::Call(operation) => operation,
    };
    if operation.may_take_moment && stack.last().is_some_and(|t| MOMENT.1.contains(t)) {
        stack.pop();
    }
    let (mut top, mut lowest) = (None, None);
    for (expected, allowed) in operation.takes {
        match stack.pop() {
            Some(t) if allowed.contains(&t) => {
                top = top.or(Some(t));
                lowest = Some(t);
            }
            found => return Err((expected, found)),
        }
    }
    if operation.takes_all_changes {
        while stack.last() == Some(&Type::Change) {
            stack.pop();
        }
    }
    // The events that a counterfactual replaces may be left out.
    if operation.replaces_events && stack.last() == Some(&Type::Events) {
        stack.pop();
    }
    match operation.gives {
        Gives::One(kind) => stack.push(kind),
        Gives::OneOfOperand => {
            stack.push(if top == Some(Type::Events) { Type::Event } else { Type::Object });
        }
        Gives::LikeOperand => stack.extend(lowest),
        Gives::Nothing => {}
    }
    Ok(())
}
