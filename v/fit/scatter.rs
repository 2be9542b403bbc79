//! Draws from what the frames that are followed tell: where no step leads on from the best of these points, because what is
//! met next hangs by the noise, another may.

use super::problem::{Problem, Window};
use crate::num::{Stop, Stopped};
use nalgebra::DVector;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// Draws that are simulated, and those that are worth a search.
const DRAWN: usize = 128;
const BEST: usize = 3;

/// Points as likely as this one by the frames before `followed` that follow those before `window` best, the best first.
pub(super) fn others(
    problem: &Problem,
    point: &[f64],
    followed: Window,
    window: Window,
    stop: Stop,
) -> Result<Vec<Vec<f64>>, Stopped> {
    let factor = problem.normal(point, followed).covariance_factor();
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut drawn: Vec<(f64, Vec<f64>)> = vec![];
    for _ in 0..DRAWN {
        stop(0.0)?;
        if problem.is_exhausted() {
            break;
        }
        let z =
            DVector::from_iterator(point.len(), (0..point.len()).map(|_| StandardNormal.sample(&mut random)));
        let off = &factor * z;
        let draw = problem.moved(point, |k| off[k]);
        drawn.push((problem.cost(&draw, window), draw));
    }
    drawn.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(drawn.into_iter().take(BEST).map(|(_, draw)| draw).collect())
}
