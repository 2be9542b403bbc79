//! The ways in: a fit of one or several scenes, with or without draws from the posterior.

use super::error::{FitError, check};
use super::estimation::{estimate_by, longest};
use super::joint::search_joint;
use super::noise::{self, Noise};
use super::options::FitOptions;
use super::posterior::sample;
use super::problem::FitProblem;
use super::result::Fit;
use super::single::estimate_one;
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::Model;

/// Fits the models (one a scene, in order) to the scenes, and draws from the posterior; parameters of scope `Setup`,
/// `Material`, `Shape` and `ShapePair` are shared by all scenes. Deterministic.
pub fn fit(scenes: &[Scene], start: &[Model], options: &FitOptions, stop: Stop) -> Result<Fit, FitError> {
    check(scenes, start)?;
    with_draws(scenes, estimate(scenes, start, options, stop)?, stop)
}

/// Fits without draws from the posterior, and without the checks of [`fit`] that compare scenes with each other.
pub fn estimate(
    scenes: &[Scene],
    start: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Fit, FitError> {
    match (scenes, start) {
        ([scene], [start]) => estimate_one(scene, start, options, stop),
        _ => estimate_by(scenes, start, options, stop, |problem, frames| {
            search_joint(problem, frames, (scenes, start), options, stop)
        }),
    }
}

/// The fit of these scenes with draws from its posterior, which predictions need; a fit with draws stays as it is.
pub fn with_draws(scenes: &[Scene], fit: Fit, stop: Stop) -> Result<Fit, FitError> {
    if fit.draws() > 0 {
        return Ok(fit);
    }
    let noises: Vec<Noise> = scenes.iter().map(noise::estimate).collect();
    let models = fit.models();
    let mut problem = FitProblem::new(scenes, models, &noises, stop);
    problem.unfreeze();
    let posterior = sample(fit.posterior.clone(), &mut problem, longest(scenes));
    stop(1.0)?;
    Ok(Fit { posterior, ..fit })
}
