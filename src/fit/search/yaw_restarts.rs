//! Restarts from other yaws of bodies whose yaw was not measured: the cost of a contact has a minimum for each side that may
//! have been hit.

use super::super::problem::FitProblem;
use super::local_search::{Solution, Termination, better, minimise};
use crate::num::{Stop, Stopped};
use crate::world::BODY_VALUES;

/// Place of the yaw in [`BODY_VALUES`].
const YAW: usize = 2;
/// Step between the yaws that are tried (rad): minima are at least an eighth of a turn apart.
const YAW_STEP: f64 = std::f64::consts::FRAC_PI_8;
/// Most iterations from another yaw; how often all bodies are gone through, and the fall of the cost that makes another
/// round worth its time.
const YAW_ITERATIONS: usize = 40;
const YAW_ROUNDS: usize = 2;
const ROUND_FALL: f64 = 5.0;

/// The parameters that are yaws of bodies without a measured yaw, and how many other yaws, [`YAW_STEP`] apart, look different.
pub(super) fn unmeasured_yaws(problem: &FitProblem) -> Vec<(usize, usize)> {
    let mut unmeasured = vec![];
    for scene in &problem.scenes {
        for (b, (body, track)) in scene.model.bodies.iter().zip(&scene.scene.tracks).enumerate() {
            let Some([length, width]) = body.shape.half_extents() else { continue };
            let yaw = scene.parameter_at(b * BODY_VALUES.len() + YAW);
            let measured = track.samples.iter().any(|s| s.yaw.is_some());
            if let Some(k) = yaw.filter(|_| !measured) {
                unmeasured.push((k, if length == width { 3 } else { 7 }));
            }
        }
    }
    unmeasured
}

/// The best fit from `start` and from other yaws, one body after the other. All are compared, because the wrong side may fit
/// well enough to be accepted.
pub(super) fn minimise_over_yaws(
    problem: &FitProblem,
    start: &[f64],
    frames: usize,
    budget: usize,
    stop: Stop,
) -> Result<Solution, Stopped> {
    let search = |point: &[f64], iterations: usize| {
        minimise(problem, point, frames, problem.negligible_fall(), iterations, stop)
    };
    let unmeasured = unmeasured_yaws(problem);
    if unmeasured.is_empty() {
        return search(start, budget);
    }
    // Only the best one is followed until it converges.
    let few = budget.min(YAW_ITERATIONS);
    let mut best = search(start, few)?;
    for _ in 0..YAW_ROUNDS {
        let before = best.cost;
        for &(k, others) in &unmeasured {
            let from = best.point.clone();
            for other in 1..=others {
                if problem.is_exhausted() {
                    return Ok(best);
                }
                let mut point = from.clone();
                point[k] += other as f64 * YAW_STEP;
                best = better(best, search(&point, few)?);
            }
        }
        if before - best.cost < ROUND_FALL {
            break;
        }
    }
    if best.outcome == Termination::IterationLimit {
        let further = search(&best.point, budget)?;
        best = better(best, further);
    }
    Ok(best)
}
