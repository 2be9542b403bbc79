//! The estimate of one number of a model.

use serde::{Deserialize, Serialize};

/// The data identify a parameter if they leave less than this share of the prior's standard deviation.
pub(super) const IDENTIFIED: f64 = 0.5;

/// One fitted parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Index of the scene; `None` if scenes share it.
    pub scene: Option<usize>,
    /// `objects[3].mass`, `sliding_friction.mu[rubber]`.
    pub name: String,
    pub value: f64,
    /// Standard deviation, in `unit`.
    pub sd: f64,
    pub unit: String,
    /// Whether the data, and not the prior, determine it.
    pub identified: bool,
}
