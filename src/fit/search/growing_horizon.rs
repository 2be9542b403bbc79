//! Growing horizon: a fit of the first frames takes in more frames as far as the simulation follows the tracks. No contact is
//! passed before the motion up to it is right.

use super::super::problem::{FitProblem, Horizon};
use super::divergence::{divergences, first_divergence};
use super::local_search::{Solution, better, minimise};
use super::{missed_contact_restarts, random_restarts, restitution_restarts};
use crate::num::{Stop, Stopped};

/// The horizon reaches this many frames beyond the first divergence, and at least this time (s): contacts follow each other no
/// faster where a camera has more frames a second.
const LOOK_AHEAD: usize = 8;
const LOOK_AHEAD_TIME: f64 = 0.32;
/// A divergence this many steps behind the horizon is given up: then all other frames are fitted at once.
const MAX_STEPS_BEHIND: usize = 3;
/// Fewest frames of a horizon, and the frames of a fit that restarts begin with if not even that horizon is followed.
const FIRST_HORIZON: usize = 10;
const SHORTEST_HORIZON: usize = 4;
/// Horizons that were followed from whose points restarts are drawn if the next one is not.
const KEPT_POINTS: usize = 2;
/// Most iterations over a horizon, and from a restart in it.
const HORIZON_ITERATIONS: usize = 30;
const RESTART_ITERATIONS: usize = 15;
/// A fall of the cost that is not worth another iteration while the horizon still grows.
const UNFINISHED_FALL: f64 = 0.01;

/// Fits all frames from `start`.
pub(super) fn grow_horizon(
    problem: &FitProblem,
    start: Vec<f64>,
    frames: usize,
    budget: usize,
    stop: Stop,
) -> Result<Solution, Stopped> {
    let fastest = problem.scenes.iter().map(|s| s.scene.fps).fold(0.0, f64::max);
    let ahead = LOOK_AHEAD.max((LOOK_AHEAD_TIME * fastest).round() as usize);
    let mut horizon = ahead.max(FIRST_HORIZON).min(frames);
    let (mut iterations, mut losses) = (0, vec![]);
    let shortest = minimise(problem, &start, SHORTEST_HORIZON, UNFINISHED_FALL, RESTART_ITERATIONS, stop)?;
    let mut followed_points = vec![(shortest.point, SHORTEST_HORIZON)];
    let mut point = start;
    loop {
        let remaining = budget.saturating_sub(iterations).clamp(1, HORIZON_ITERATIONS);
        let negligible = if horizon < frames { UNFINISHED_FALL } else { problem.negligible_fall() };
        let found = minimise(problem, &point, horizon, negligible, remaining, stop)?;
        let (solution, followed) = restarted(problem, found, &followed_points, horizon, negligible, stop)?;
        iterations += solution.iterations;
        point = solution.point;
        losses.extend(&solution.losses);
        if horizon >= frames {
            return Ok(Solution { point, iterations, losses, ..solution });
        }
        // The effect of a contact before one horizon may show in the next only.
        if followed {
            followed_points.push((point.clone(), horizon));
            followed_points.drain(..followed_points.len().saturating_sub(KEPT_POINTS));
        } else {
            followed_points.clear();
        }
        let diverges = first_divergence(problem, &point, frames).unwrap_or(frames);
        // A later horizon does not correct a divergence that far behind.
        let is_behind = diverges + MAX_STEPS_BEHIND * ahead < horizon;
        horizon = if is_behind { frames } else { (diverges + ahead).max(horizon + ahead).min(frames) };
    }
}

/// The best fit of a horizon, and whether the simulation follows the tracks there. Starts from `found`; if that diverges, from
/// missed contacts, from other restitutions of the contacts before, and from draws of the posterior of `followed_points`: points
/// that follow all frames of a horizon, the last of them last.
fn restarted(
    problem: &FitProblem,
    found: Solution,
    followed_points: &[(Vec<f64>, Horizon)],
    horizon: Horizon,
    negligible: f64,
    stop: Stop,
) -> Result<(Solution, bool), Stopped> {
    let mut best = found;
    let first = divergences(problem, &best.point, horizon);
    if first.is_empty() {
        return Ok((best, true));
    }
    let mut tried = missed_contact_restarts::points(&best.point, &first);
    tried.extend(restitution_restarts::points(problem, &best.point, &first));
    let is_followed = |s: &Solution| divergences(problem, &s.point, horizon).is_empty();
    let mut earlier = followed_points.iter().rev();
    loop {
        for point in tried {
            if problem.is_exhausted() {
                break;
            }
            best = better(best, minimise(problem, &point, horizon, negligible, RESTART_ITERATIONS, stop)?);
        }
        if is_followed(&best) {
            return Ok((best, true));
        }
        let Some((from, followed)) = earlier.next() else { return Ok((best, false)) };
        tried = random_restarts::points(problem, from, *followed, horizon, stop)?;
    }
}
