//! Growing windows: a fit from the first frames on, which takes in more as far as the model follows. No contact is passed
//! before the motion up to it is right.

use super::bounce::{self, left};
use super::problem::{Part, Problem, Window};
use super::solve::{Solution, minimise};
use super::{FitError, better, graze, scatter};
use crate::num::Stop;

/// A growing window takes in this many frames after the first that leaves the noise, and at least this time (s): what
/// happens between objects does not hurry where a camera does.
const LOOK_AHEAD: usize = 8;
const LOOK_AHEAD_TIME: f64 = 0.32;
/// Steps of the window after which what is lost is given up: all the rest is fitted at once.
const MOST_BEHIND: usize = 3;
/// Fewest frames of a window, and the frames that tell how objects begin where that one is not followed.
const FIRST: usize = 10;
const FEW_FRAMES: usize = 4;
/// Windows that were followed from whose points others are drawn where the next one is not.
const BACK: usize = 2;
/// Most iterations over a window, and from another point in it.
const ITERATIONS: usize = 30;
const OTHER_ITERATIONS: usize = 15;
/// A fall of the cost that is not worth another step while the window still grows.
const UNFINISHED: f64 = 0.01;
/// A residual beyond this many deviations has left the noise.
pub(super) const OUT_OF_NOISE: f64 = 6.0;

/// Fits all frames from `start`.
pub(super) fn grow(
    problem: &Problem,
    start: Vec<f64>,
    frames: usize,
    budget: usize,
    stop: Stop,
) -> Result<Solution, FitError> {
    let fastest = problem.parts.iter().map(|p| p.scene.fps).fold(0.0, f64::max);
    let ahead = LOOK_AHEAD.max((LOOK_AHEAD_TIME * fastest).round() as usize);
    let mut window = ahead.max(FIRST).min(frames);
    let (mut iterations, mut losses) = (0, vec![]);
    let few = minimise(problem, &start, FEW_FRAMES, UNFINISHED, OTHER_ITERATIONS, stop)?;
    let mut known = vec![(few.point, FEW_FRAMES)];
    let mut point = start;
    loop {
        let left = budget.saturating_sub(iterations).clamp(1, ITERATIONS);
        let negligible = if window < frames { UNFINISHED } else { problem.negligible() };
        let found = minimise(problem, &point, window, negligible, left, stop)?;
        let (solution, followed) = of_any_contact(problem, found, &known, window, negligible, stop)?;
        iterations += solution.iterations;
        point = solution.point;
        losses.extend(&solution.losses);
        if window >= frames {
            return Ok(Solution { point, iterations, losses, ..solution });
        }
        // What happened before one window may show in the next only.
        if followed {
            known.push((point.clone(), window));
            known.drain(..known.len().saturating_sub(BACK));
        } else {
            known.clear();
        }
        let lost = first_lost(problem, &point, frames).unwrap_or(frames);
        // What is left that far behind no window takes in any more.
        let behind = lost + MOST_BEHIND * ahead < window;
        window = if behind { frames } else { (lost + ahead).max(window + ahead).min(frames) };
    }
}

/// The best fit of a window, and whether it is followed: `found`, and where that leaves the tracks, from a graze that it may have
/// missed, from other bounces at the contact before, and from points as likely by frames that were followed. `known` are
/// points that follow all before a window, the last of them last.
fn of_any_contact(
    problem: &Problem,
    found: Solution,
    known: &[(Vec<f64>, Window)],
    window: Window,
    negligible: f64,
    stop: Stop,
) -> Result<(Solution, bool), FitError> {
    let mut best = found;
    let first = left(problem, &best.point, window);
    if first.is_empty() {
        return Ok((best, true));
    }
    let mut tried = graze::others(&best.point, &first);
    tried.extend(bounce::others(problem, &best.point, &first));
    let followed = |s: &Solution| left(problem, &s.point, window).is_empty();
    let mut earlier = known.iter().rev();
    loop {
        for point in tried {
            if problem.is_exhausted() {
                break;
            }
            best = better(best, minimise(problem, &point, window, negligible, OTHER_ITERATIONS, stop)?);
        }
        if followed(&best) {
            return Ok((best, true));
        }
        let Some((from, seen)) = earlier.next() else { return Ok((best, false)) };
        tried = scatter::others(problem, from, *seen, window, stop)?;
    }
}

/// The first frame at which the simulation of any scene leaves its measurements.
pub(super) fn first_lost(problem: &Problem, point: &[f64], frames: usize) -> Option<usize> {
    let of = |part: &Part| {
        let rollout = part.rollout(&problem.free, point, frames);
        let mut first: Option<usize> = None;
        part.each_residual(&rollout, frames, |(_, frame, _), r, _| {
            if r.abs() > OUT_OF_NOISE && first.is_none_or(|f| frame < f) {
                first = Some(frame);
            }
        });
        first
    };
    problem.parts.iter().filter_map(of).min()
}
