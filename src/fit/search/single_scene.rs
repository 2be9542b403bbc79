//! The whole search for one scene: attempts in order of their cost in time, until one fits well.

use super::super::options::StartPoint;
use super::super::problem::{FitProblem, GOOD, worst_chi_square};
use super::divergence::first_divergence;
use super::growing_horizon::grow_horizon;
use super::local_search::{Solution, better, minimise};
use super::yaw_restarts::{minimise_over_yaws, unmeasured_yaws};
use super::{random_restarts, spin_restarts};
use crate::num::{Stop, Stopped};

/// Budget share of the full-horizon search; spurious persistent contacts would otherwise exhaust it.
const FULL_HORIZON_BUDGET: f64 = 0.5;
/// Budget of everything including the last random restarts, as a share of the whole.
const LAST_BUDGET: f64 = 1.5;
/// A round of random restarts whose best fall of the cost is smaller is the last.
const ROUND_FALL: f64 = 5.0;

/// Searches the parameters of one scene over all `frames`; the problem's budget is `fraction` of the limit.
pub(in super::super) fn search_single(
    problem: &FitProblem,
    frames: usize,
    (start_point, fraction): (StartPoint, f64),
    budget: usize,
    stop: Stop,
) -> Result<Solution, Stopped> {
    let negligible = problem.negligible_fall();
    let search = |point: &[f64]| minimise(problem, point, frames, negligible, budget, stop);
    let yaws_known = matches!(start_point, StartPoint::YawSearched | StartPoint::NearOptimum);
    let is_near = start_point == StartPoint::NearOptimum;
    problem.set_budget(FULL_HORIZON_BUDGET * fraction);
    let mut best = match yaws_known {
        true => search(&problem.start())?,
        false => minimise_over_yaws(problem, &problem.start(), frames, budget, stop)?,
    };
    problem.set_budget(fraction);
    let is_good = |best: &Solution| worst_chi_square(problem, &best.point, frames) <= GOOD;
    if !is_near && is_good(&best) {
        return Ok(best);
    }
    if !is_near && !problem.is_exhausted() {
        let grown = grow_horizon(problem, problem.start(), frames, budget, stop)?;
        let turned = match yaws_known || unmeasured_yaws(problem).is_empty() {
            true => None,
            false => Some(minimise_over_yaws(problem, &grown.point, frames, budget, stop)?),
        };
        best = better(best, grown);
        best = turned.into_iter().fold(best, better);
    }
    'spins: for other in spin_restarts::points(problem, &best.point) {
        // On the whole video first: over a horizon that ends before its spin matters, a ball loses it.
        for whole in [true, false] {
            if problem.is_exhausted() || is_good(&best) {
                break 'spins;
            }
            let tried = match whole {
                true => search(&other)?,
                false => grow_horizon(problem, other.clone(), frames, budget, stop)?,
            };
            best = better(best, tried);
        }
    }
    if !is_near {
        problem.set_budget(LAST_BUDGET * fraction);
        best = restart_randomly(problem, best, frames, budget, stop)?;
    }
    Ok(best)
}

/// Random restarts from the posterior of the frames that are followed, as long as they lower the cost and the fit is not good.
fn restart_randomly(
    problem: &FitProblem,
    mut best: Solution,
    frames: usize,
    budget: usize,
    stop: Stop,
) -> Result<Solution, Stopped> {
    while worst_chi_square(problem, &best.point, frames) > GOOD && !problem.is_exhausted() {
        let (before, followed) = (best.cost, first_divergence(problem, &best.point, frames));
        for other in random_restarts::points(problem, &best.point, followed.unwrap_or(frames), frames, stop)?
        {
            let tried = minimise(problem, &other, frames, problem.negligible_fall(), budget, stop)?;
            best = better(best, tried);
        }
        if before - best.cost < ROUND_FALL {
            break;
        }
    }
    Ok(best)
}
