//! The frame of every fit: noise, start, search, refinement, posterior. What differs between one scene and several is the search.

use super::error::{FitError, check_each};
use super::initial_states::set_initial_states;
use super::noise::{self, Noise};
use super::options::{FitOptions, Method, StartPoint};
use super::posterior::Posterior;
use super::problem::{FitProblem, Horizon, NEGLIGIBLE_FALL};
use super::result::{Fit, SceneFit};
use super::search::{Solution, minimise_from, minimise_in_stages};
use crate::num::{Stop, Stopped};
use crate::scene::Scene;
use crate::world::{Ending, Model};

/// Frames of the longest of the scenes.
pub(super) fn longest(scenes: &[Scene]) -> Horizon {
    scenes.iter().map(|s| s.times.len()).max().unwrap_or(0)
}

/// Fits the models to the scenes by `search` over all frames; without draws from the posterior.
///
/// The search runs with some parameters frozen ([`FitProblem::unfreeze`]) and, if wanted, with derivatives of single
/// precision; then all parameters are refined from where it ended, in double precision.
pub(super) fn estimate_by(
    scenes: &[Scene],
    start: &[Model],
    options: &FitOptions,
    stop: Stop,
    search: impl Fn(&FitProblem, Horizon) -> Result<Solution, FitError>,
) -> Result<Fit, FitError> {
    check_each(scenes, start)?;
    let noises: Vec<Noise> = scenes.iter().map(noise::estimate).collect();
    let mut models = start.to_vec();
    models.iter_mut().for_each(|m| m.corrections.clear());
    if options.start_point == StartPoint::Tracks {
        for ((scene, model), noise) in scenes.iter().zip(&mut models).zip(&noises) {
            set_initial_states(scene, model, noise);
        }
    }
    let mut problem = FitProblem::new(scenes, models, &noises, stop);
    problem.set_budget(options.budget_fraction);
    problem.set_single_precision(options.single_precision && options.method == Method::GaussNewton);
    let frames = longest(scenes);
    let best = match options.method {
        Method::GaussNewton => {
            let found = search(&problem, frames)?;
            let unfrozen = problem.unfreeze();
            problem.set_single_precision(false);
            if options.single_precision || unfrozen.contains(&true) {
                let linear = found.linear.filter(|_| !options.single_precision);
                let found = Solution { linear, ..found };
                refined(&problem, found, &unfrozen, frames, options.max_iterations, stop)?
            } else {
                found
            }
        }
        Method::Paper => {
            problem.unfreeze();
            minimise_in_stages(&problem, frames, options.max_iterations, stop)?
        }
    };
    for scene in &problem.scenes {
        let rollout = scene.rollout(&problem.parameters, &best.point, frames);
        if rollout.ending == Ending::FormulaUndefined {
            return Err(FitError::FormulaUndefined { scene: scene.scene.name.clone() });
        }
    }
    let posterior = Posterior::at(&problem, &best.point, frames);
    stop(1.0)?;
    let fits = (0..scenes.len()).map(|i| SceneFit::at(&problem, i, &best.point, frames)).collect();
    let Solution { iterations, outcome, losses, .. } = best;
    Ok(Fit { scenes: fits, posterior, iterations, outcome, losses })
}

/// The fit from `found` on with the `unfrozen` parameters free, too.
fn refined(
    problem: &FitProblem,
    found: Solution,
    unfrozen: &[bool],
    frames: Horizon,
    budget: usize,
    stop: Stop,
) -> Result<Solution, Stopped> {
    let Solution { point, linear, .. } = found;
    let linear = linear.map(|known| problem.complete(known, unfrozen, &point, frames));
    let refined = minimise_from(problem, (point, linear), frames, NEGLIGIBLE_FALL, budget, stop)?;
    let iterations = found.iterations + refined.iterations;
    let losses = [&found.losses[..], &refined.losses].concat();
    Ok(Solution { iterations, losses, ..refined })
}
