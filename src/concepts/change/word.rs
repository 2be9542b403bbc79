//! A word for a change, and the refusal of one.

use super::grid::{ALL_FACTORS, FactorPosterior};
use crate::concepts::error::ConceptError;
use crate::concepts::lexicon::{LearnedWord, Meaning, WordKind};
use crate::num::elementary::exp;
use crate::reason::ChangedQuantity;

/// The word, from so many questions or examples that fit it and that do not; `evidence` in nat.
pub fn change_word(
    name: &str,
    quantity: ChangedQuantity,
    found: &FactorPosterior,
    evidence: f64,
    [yes, no]: [usize; 2],
) -> LearnedWord {
    let meaning = Meaning::Change { quantity, factor: found.factor(), interval: found.interval() };
    LearnedWord { name: name.into(), kind: WordKind::Change, meaning, yes, no, evidence }
}

/// The factor is not among those that are tried.
pub fn beyond(what: String) -> ConceptError {
    let [least, most] = ALL_FACTORS.map(exp);
    ConceptError::FactorBeyond { what, least, most }
}

/// Every factor explains what is seen.
pub fn undetermined(name: &str) -> ConceptError {
    let [least, most] = ALL_FACTORS.map(exp);
    ConceptError::Undetermined { name: name.into(), least, most }
}
