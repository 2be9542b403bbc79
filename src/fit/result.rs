//! What a fit gives: models, posterior, and how well each scene is explained.

use super::posterior::Posterior;
use super::problem::{FitProblem, Horizon, is_adequate, misfit};
use super::search::Termination;
use crate::world::Model;
use serde::{Deserialize, Serialize};

/// Models of one or several videos with the posterior of their parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// One a scene, in the order given.
    pub scenes: Vec<SceneFit>,
    pub posterior: Posterior,
    pub iterations: usize,
    pub outcome: Termination,
    /// The cost of each iteration of the search that was chosen, over the frames of its horizon; last the cost at its end.
    #[serde(default)]
    pub losses: Vec<f64>,
}

/// How one scene was fitted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneFit {
    pub name: String,
    /// The model at the best parameters.
    pub model: Model,
    /// Measurement noise of a position, estimated from the tracks without the model (m).
    pub noise_sigma: f64,
    /// The same of a yaw (rad); `None` if no yaw was measured.
    pub noise_yaw: Option<f64>,
    /// Root mean square of the position residuals, both coordinates pooled (m).
    pub rmse: f64,
    pub reduced_chi_square: f64,
    pub degrees_of_freedom: usize,
    /// Whether the noise explains the misfit.
    pub adequate: bool,
}

impl SceneFit {
    /// Scene `index` of a problem at its best point.
    pub(super) fn at(problem: &FitProblem, index: usize, point: &[f64], horizon: Horizon) -> SceneFit {
        let scene = &problem.scenes[index];
        let found = misfit(problem, index, point, horizon);
        SceneFit {
            name: scene.scene.name.clone(),
            model: problem.model(index, point),
            noise_sigma: scene.noise.position,
            noise_yaw: scene.noise.yaw,
            rmse: found.rmse,
            reduced_chi_square: found.reduced_chi_square,
            degrees_of_freedom: found.degrees_of_freedom,
            adequate: is_adequate(found.reduced_chi_square),
        }
    }
}
