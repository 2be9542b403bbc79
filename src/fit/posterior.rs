//! What the data say about the parameters: mean, covariance, what is identified.

use serde::{Deserialize, Serialize};

/// Gaussian around the best parameters (Laplace).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Posterior {
    pub estimates: Vec<Estimate>,
}

/// One fitted parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Index of the scene; `None` where scenes share it.
    pub scene: Option<usize>,
    /// `objects[3].mass`, `sliding_friction.mu[rubber]`.
    pub name: String,
    pub value: f64,
    pub sd: f64,
    pub unit: String,
    /// Whether the data, and not the prior, determine it.
    pub identified: bool,
}

/// What is known of one object of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectEstimate {
    pub id: u32,
    /// kg, or relative where the scene gives no mass.
    pub mass: Estimate,
    /// The object's factor: a contact's restitution is about the product of the two.
    pub restitution: Estimate,
}

/// One parameter that the objects of a set-up share; several values where it differs by material or pair.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedEstimate {
    pub effect: String,
    pub parameter: String,
    /// What each value applies to; one empty label where there is one value.
    pub labels: Vec<String>,
    pub values: Vec<Estimate>,
}
