//! A parameter of a formula: its name, unit, start and bounds.

use super::program::{FUNCTIONS, TARGETS, VARIABLES};
use serde::{Deserialize, Serialize};

/// Bounds of a parameter that is given none, in units of its start or of 1, whichever is larger.
pub const BOUND: f64 = 1e3;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FormulaParameter {
    pub name: String,
    pub unit: String,
    pub default: f64,
    pub min: f64,
    pub max: f64,
}

impl FormulaParameter {
    /// Missing bounds are those of `BOUND`; a missing start is 0, or the bound nearest to 0.
    pub fn new(name: String, unit: String, start: Option<f64>, min: Option<f64>, max: Option<f64>) -> Self {
        let bound = BOUND * start.map_or(1.0, |v| v.abs().max(1.0));
        let (min, max) = (min.unwrap_or(-bound), max.unwrap_or(bound));
        FormulaParameter { name, unit, default: start.unwrap_or(f64::max(0.0, min).min(max)), min, max }
    }

    /// Why it cannot stand beside the others.
    pub(super) fn problem(&self, others: &[FormulaParameter]) -> Option<&'static str> {
        let name = self.name.as_str();
        let mut letters = name.chars();
        let word = letters.next().is_some_and(|c| c.is_ascii_alphabetic())
            && letters.all(|c| c.is_ascii_alphanumeric() || c == '_');
        let taken = VARIABLES.contains(&name)
            || TARGETS.contains(&name)
            || ["pi", "let", "from", "to"].contains(&name)
            || FUNCTIONS.iter().any(|f| f.0 == name);
        let finite = [self.default, self.min, self.max].iter().all(|v| v.is_finite());
        if !word {
            Some("must be a word of letters, digits and _")
        } else if taken || others.iter().any(|q| q.name == name) {
            Some("is a name that is taken; choose another")
        } else if !finite || self.min >= self.max || !(self.min..=self.max).contains(&self.default) {
            Some("bounds must be finite, min below max, the default between")
        } else {
            None
        }
    }
}
