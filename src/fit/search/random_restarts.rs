//! Random restarts from the posterior of the frames that are followed so far; needed where noise decides which body is hit next.

use super::super::problem::{FitProblem, Horizon};
use crate::num::{Stop, Stopped, standard_normal};
use nalgebra::DVector;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Draws that are simulated, and the best of them, from which a search starts.
const RESTART_DRAWS: usize = 128;
const BEST: usize = 3;

/// Draws of the Laplace approximation at `point` over the frames before `followed`, those of least cost over `horizon` first.
pub(super) fn points(
    problem: &FitProblem,
    point: &[f64],
    followed: Horizon,
    horizon: Horizon,
    stop: Stop,
) -> Result<Vec<Vec<f64>>, Stopped> {
    let factor = problem.normal_equations_at(point, followed).covariance_factor();
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut drawn: Vec<(f64, Vec<f64>)> = vec![];
    for _ in 0..RESTART_DRAWS {
        stop(0.0)?;
        if problem.is_exhausted() {
            break;
        }
        let z = DVector::from_iterator(point.len(), (0..point.len()).map(|_| standard_normal(&mut random)));
        let step = &factor * z;
        let draw = problem.stepped(point, |k| step[k]);
        drawn.push((problem.cost(&draw, horizon), draw));
    }
    drawn.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(drawn.into_iter().take(BEST).map(|(_, draw)| draw).collect())
}
