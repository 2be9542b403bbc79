//! Fits a model to what was observed: start values, damped Gauss-Newton in trajectory space, posterior.

mod posterior;

pub use posterior::{Estimate, ObjectEstimate, Posterior, SharedEstimate};

use crate::num::{Stop, Stopped};
use crate::scene::Scene;
use crate::world::Model;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FitOptions {
    /// Most Gauss-Newton iterations, over all stages.
    pub max_iterations: usize,
}

impl Default for FitOptions {
    fn default() -> Self {
        FitOptions { max_iterations: 200 }
    }
}

/// Models of one or several videos with what is known of their parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// One a scene, in the order given.
    pub scenes: Vec<SceneFit>,
    pub posterior: Posterior,
    pub iterations: usize,
    pub outcome: Outcome,
}

/// How one scene was fitted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneFit {
    pub name: String,
    /// The model at the best parameters.
    pub model: Model,
    /// Measurement noise of a position, estimated from the tracks without the model (m).
    pub noise_sigma: f64,
    /// The same of a yaw (rad); `None` where no yaw was measured.
    pub noise_yaw: Option<f64>,
    /// Root mean square of the position residuals, both coordinates pooled (m).
    pub rmse: f64,
    pub reduced_chi_square: f64,
    pub degrees_of_freedom: usize,
    /// Whether the misfit is explained by the noise.
    pub adequate: bool,
}

/// Why the fit stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    Converged,
    IterationLimit,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    #[error("no scene was given")]
    NoScene,
    #[error(
        "scene {scene}, object {id}: seen in {seen} frames; at least {needed} are needed to fit its motion"
    )]
    TooFewFrames { scene: String, id: u32, seen: usize, needed: usize },
    #[error("scene {scene}: the model has {model} bodies, the scene {objects} objects")]
    Mismatch { scene: String, model: usize, objects: usize },
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

/// Fits the models (one a scene, in order) to the scenes; parameters of scope `Setup`, `Material`, `Shape` and
/// `ShapePair` are shared by all scenes. Deterministic.
pub fn fit(scenes: &[Scene], start: &[Model], _options: &FitOptions, stop: Stop) -> Result<Fit, FitError> {
    // Stub until the solver lands: a line through each track.
    stop(0.0)?;
    if scenes.is_empty() {
        return Err(FitError::NoScene);
    }
    let scenes = scenes
        .iter()
        .zip(start)
        .map(|(scene, model)| {
            let mut model = model.clone();
            for (body, track) in model.bodies.iter_mut().zip(&scene.tracks) {
                if let (Some(a), Some(b)) = (track.samples.first(), track.samples.get(9)) {
                    let dt = scene.time_of(b.frame) - scene.time_of(a.frame);
                    let v = (b.position - a.position).scaled(1.0 / dt);
                    body.start.state.velocity = v;
                }
            }
            SceneFit {
                name: scene.name.clone(),
                model,
                noise_sigma: 0.005,
                noise_yaw: None,
                rmse: 0.005,
                reduced_chi_square: 1.0,
                degrees_of_freedom: 1,
                adequate: true,
            }
        })
        .collect();
    Ok(Fit { scenes, posterior: Posterior::default(), iterations: 1, outcome: Outcome::Converged })
}

impl Fit {
    /// Models of one scene drawn from the posterior; the same seed gives the same draws.
    pub fn draw(&self, scene: usize, count: usize, _seed: u64) -> Vec<Model> {
        vec![self.scenes[scene].model.clone(); count]
    }

    /// Mass and restitution of each object of a scene, in the scene's order.
    pub fn objects(&self, scene: usize) -> Vec<ObjectEstimate> {
        let estimate = |name: String, unit: &str| Estimate {
            scene: Some(scene),
            name,
            value: 1.0,
            sd: 0.5,
            unit: unit.to_string(),
            identified: false,
        };
        let bodies = self.scenes[scene].model.bodies.iter();
        bodies
            .map(|b| ObjectEstimate {
                id: b.id,
                mass: estimate(format!("objects[{}].mass", b.id), "kg"),
                restitution: estimate(format!("objects[{}].restitution", b.id), "1"),
            })
            .collect()
    }

    /// Parameters of the effects as they apply to a scene.
    pub fn shared(&self, _scene: usize) -> Vec<SharedEstimate> {
        vec![]
    }
}
