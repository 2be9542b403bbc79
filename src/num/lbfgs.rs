//! Bounded minimisation by the limited-memory BFGS method.
//!
//! From the gradient g of a function f of x (n numbers within bounds) and the last changes s of x and y of g, the two-loop
//! recursion forms the direction -B g, where B approximates the inverse Hessian; B starts as the diagonal `scale`, multiplied by
//! s^T y / y^T (scale y). Steps are projected onto the bounds; a backtracking line search asks for a share of the fall that the
//! gradient promises (Armijo's condition). Pairs with s^T y <= 0, that is of negative curvature, are left out, so that
//! every direction descends.
//!
//! Source: Nocedal and Wright, Numerical Optimization (2006), algorithms 7.4 and 7.5.

use super::stop::{Stop, Stopped};
use std::collections::VecDeque;

/// Pairs (s, y) that are kept.
const MEMORY: usize = 10;
/// Most trials of one line search, and Armijo's share of the promised fall.
const LINE_TRIALS: usize = 20;
const SUFFICIENT: f64 = 1e-4;
/// A relative fall of f below this ends the search.
const RELATIVE_TOLERANCE: f64 = 1e-8;

/// A function f to be minimised within bounds.
pub struct Objective<'f> {
    pub value: &'f dyn Fn(&[f64]) -> f64,
    pub gradient: &'f dyn Fn(&[f64]) -> Vec<f64>,
    /// Whether a point is good enough to end the search.
    pub done: &'f dyn Fn(&[f64]) -> bool,
    /// Lower and upper bound of each coordinate.
    pub bounds: Vec<(f64, f64)>,
    /// First guess of the inverse Hessian's diagonal; a coordinate of scale 0 does not move.
    pub scale: Vec<f64>,
}

/// Where a search ended.
pub struct Descent {
    pub point: Vec<f64>,
    pub value: f64,
    pub iterations: usize,
    /// Whether it ended for another reason than its number of steps.
    pub converged: bool,
    /// f at the start and after each step.
    pub values: Vec<f64>,
}

type Pairs = VecDeque<(Vec<f64>, Vec<f64>)>;

impl Objective<'_> {
    /// Minimises f from `start` in at most `steps` steps.
    pub fn minimise(&self, start: &[f64], steps: usize, stop: Stop) -> Result<Descent, Stopped> {
        let value = (self.value)(start);
        let mut at =
            Descent { point: start.to_vec(), value, iterations: 0, converged: true, values: vec![value] };
        let mut pairs = Pairs::new();
        let mut gradient = vec![];
        for iteration in 0..steps {
            stop(iteration as f64 / steps as f64)?;
            at.iterations = iteration;
            if (self.done)(&at.point) {
                return Ok(at);
            }
            if gradient.is_empty() {
                gradient = (self.gradient)(&at.point);
            }
            at.iterations = iteration + 1;
            let mut found = self.line_search(&at, &gradient, &self.direction(&gradient, &pairs));
            if found.is_none() && !pairs.is_empty() {
                pairs.clear();
                found = self.line_search(&at, &gradient, &self.direction(&gradient, &pairs));
            }
            let Some((next, lower)) = found else { return Ok(at) };
            let fall = at.value - lower;
            let slope = (self.gradient)(&next);
            let moved = difference(&next, &at.point);
            let change = difference(&slope, &gradient);
            if dot(&moved, &change) > 1e-10 * dot(&moved, &moved).sqrt() * dot(&change, &change).sqrt() {
                pairs.push_back((moved, change));
                if pairs.len() > MEMORY {
                    pairs.pop_front();
                }
            }
            (at.point, at.value, gradient) = (next, lower, slope);
            at.values.push(at.value);
            if fall <= RELATIVE_TOLERANCE * at.value {
                return Ok(at);
            }
        }
        Ok(Descent { iterations: steps, converged: false, ..at })
    }

    /// -B g by the two-loop recursion.
    fn direction(&self, gradient: &[f64], pairs: &Pairs) -> Vec<f64> {
        let mut q = gradient.to_vec();
        let mut shares = vec![];
        for (s, y) in pairs.iter().rev() {
            let share = dot(s, &q) / dot(s, y);
            add(&mut q, y, -share);
            shares.push(share);
        }
        let scaled = |v: &[f64]| -> Vec<f64> { v.iter().zip(&self.scale).map(|(v, h)| v * h).collect() };
        let size = pairs.back().map_or(1.0, |(s, y)| dot(s, y) / dot(y, &scaled(y)).max(f64::MIN_POSITIVE));
        let mut r: Vec<f64> = scaled(&q).iter().map(|v| v * size).collect();
        for ((s, y), share) in pairs.iter().zip(shares.iter().rev()) {
            let back = dot(y, &r) / dot(s, y);
            add(&mut r, s, share - back);
        }
        r.iter().map(|v| -v).collect()
    }

    /// The first trial along the projected direction that falls enough, and f there.
    fn line_search(&self, at: &Descent, slope: &[f64], along: &[f64]) -> Option<(Vec<f64>, f64)> {
        let x = &at.point;
        let mut share = 1.0;
        for _ in 0..LINE_TRIALS {
            let trial: Vec<f64> = (0..x.len())
                .map(|k| (x[k] + share * along[k]).clamp(self.bounds[k].0, self.bounds[k].1))
                .collect();
            let promised = dot(slope, &difference(&trial, x));
            if promised >= 0.0 {
                return None;
            }
            let lower = (self.value)(&trial);
            if lower <= at.value + SUFFICIENT * promised {
                return Some((trial, lower));
            }
            // The minimum of the parabola through the two values and the slope.
            let least = -0.5 * promised / (lower - at.value - promised);
            share *= if least.is_finite() { least.clamp(0.1, 0.5) } else { 0.1 };
        }
        None
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(x, y)| x - y).collect()
}

fn add(to: &mut [f64], v: &[f64], share: f64) {
    to.iter_mut().zip(v).for_each(|(t, v)| *t += share * v);
}

#[cfg(test)]
mod tests {
    use super::super::stop::never;
    use super::*;

    fn rosenbrock(x: &[f64]) -> f64 {
        (1.0 - x[0]).powi(2) + 100.0 * (x[1] - x[0] * x[0]).powi(2)
    }

    fn slope(x: &[f64]) -> Vec<f64> {
        let steep = 200.0 * (x[1] - x[0] * x[0]);
        vec![-2.0 * (1.0 - x[0]) - 2.0 * x[0] * steep, steep]
    }

    fn objective(scale: [f64; 2]) -> Objective<'static> {
        Objective {
            value: &rosenbrock,
            gradient: &slope,
            done: &|_| false,
            bounds: vec![(-2.0, 2.0); 2],
            scale: scale.to_vec(),
        }
    }

    #[test]
    fn it_follows_a_curved_valley_inside_the_bounds() {
        let close = |scale: [f64; 2], to: [f64; 2]| {
            let x = objective(scale).minimise(&[-1.2, 1.0], 100, &never).expect("nobody stops it").point;
            assert!((x[0] - to[0]).abs() < 1e-3 && (x[1] - to[1]).abs() < 1e-3, "{x:?}");
        };
        close([1.0, 1.0], [1.0, 1.0]);
        close([0.0, 1.0], [-1.2, 1.44]);
        let refused = |_: f64| Err(Stopped);
        assert!(objective([1.0; 2]).minimise(&[0.0, 0.0], 9, &refused).is_err());
    }
}
