//! What can be wrong with the text of a formula, and the limits that it must keep.

use super::unit::SYMBOLS;

/// Longest text (bytes): a page.
pub const LONGEST: usize = 2_000;
/// Deepest nesting: the parser recurses.
pub const DEEPEST: usize = 64;
/// Most parameters: as many as any law of the table has, and some.
pub const MOST_PARAMETERS: usize = 16;
/// What is wrong with a formula.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FormulaError {
    #[error("line {line}, column {column}: {problem}")]
    Text { line: usize, column: usize, problem: SyntaxError },
    #[error("parameter {name}: {problem}")]
    Parameter { name: String, problem: &'static str },
    #[error("parameter {name}: {unit:?} is no unit; known: {}", known_units())]
    Unit { name: String, unit: String },
    #[error("{problem}; {name} [{unit}] would have to be {needed}: correct its unit or the formula")]
    Mismatch { problem: String, name: String, unit: String, needed: String },
    #[error("there are {count} parameters; at most {MOST_PARAMETERS} are allowed")]
    Count { count: usize },
    #[error("the formula has {bytes} bytes; {LONGEST} is the most")]
    TooLong { bytes: usize },
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SyntaxError {
    #[error("{found:?} is no {wanted}{hint}; known: {known}")]
    Unknown { found: String, wanted: &'static str, hint: String, known: String },
    #[error("expected {wanted}, found {found}{hint}")]
    Unexpected { wanted: &'static str, found: String, hint: &'static str },
    #[error("nested deeper than {DEEPEST}; simplify")]
    TooDeep,
    #[error("{name} takes {wanted} arguments, not {found}")]
    Arguments { name: &'static str, wanted: usize, found: usize },
    #[error("{name} is given twice")]
    Twice { name: &'static str },
    #[error(
        "{name} has a constant that is infinite, undefined or beyond any acceleration; write smaller numbers"
    )]
    RunawayConstant { name: &'static str },
    #[error("parameter {name}: {problem}")]
    Parameter { name: String, problem: &'static str },
}

/// The units of an error message.
pub(super) fn known_units() -> String {
    format!("{}, with * / and ^, as in kg/s or m/s^2", SYMBOLS.join(" "))
}
