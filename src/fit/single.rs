//! Fits of scenes that share nothing, one scene at a time.

use super::error::FitError;
use super::estimation::estimate_by;
use super::options::FitOptions;
use super::result::Fit;
use super::search::search_single;
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::Model;
use rayon::prelude::*;
use std::slice;

/// Fits one scene, without draws from the posterior.
pub fn estimate_one(scene: &Scene, start: &Model, options: &FitOptions, stop: Stop) -> Result<Fit, FitError> {
    estimate_by(slice::from_ref(scene), slice::from_ref(start), options, stop, |problem, frames| {
        let start = (options.start_point, options.budget_fraction);
        Ok(search_single(problem, frames, start, options.max_iterations, stop)?)
    })
}

/// Fits each scene by itself.
pub fn estimate_each(
    scenes: &[Scene],
    start: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Vec<Fit>, FitError> {
    (scenes, start).into_par_iter().map(|(scene, start)| estimate_one(scene, start, options, stop)).collect()
}
