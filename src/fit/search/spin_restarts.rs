//! Restarts from other spins of balls: a spin that friction ends before it matters has no gradient.

use super::super::problem::FitProblem;
use crate::num::vec2;
use crate::world::BODY_VALUES;

/// The roll as a share of rolling without slip, and the spin about the vertical in prior standard deviations: plain rolling,
/// stun, draw, either side; much and little.
const SPINS: [(f64, f64); 7] =
    [(1.0, 0.0), (0.0, 0.0), (-1.0, 0.0), (1.0, 0.5), (1.0, -0.5), (1.0, 1.0), (1.0, -1.0)];

/// Points of the search that differ from this one in the spin of one ball whose spin is free.
pub(super) fn points(problem: &FitProblem, point: &[f64]) -> Vec<Vec<f64>> {
    let mut others = vec![];
    let width = BODY_VALUES.len();
    for scene in &problem.scenes {
        for (b, body) in scene.model.bodies.iter().enumerate().filter(|(_, b)| b.shape.is_ball()) {
            let of = |value: usize| scene.parameter_at(b * width + value);
            let [Some(vx), Some(vy), Some(spin), Some(x), Some(y)] = [3, 4, 5, 6, 7].map(of) else {
                continue;
            };
            let radius = body.shape.bounding_radius();
            let rolling = vec2(point[vx], point[vy]).perp().scaled(1.0 / radius);
            for (share, side) in SPINS {
                let mut other = point.to_vec();
                other[spin] = side * scene.model.spin_sd / radius;
                (other[x], other[y]) = (share * rolling.x, share * rolling.y);
                others.push(other);
            }
        }
    }
    others
}
