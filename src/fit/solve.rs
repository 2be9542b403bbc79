//! Levenberg-Marquardt with bounds on the whole window, then growing windows where that is not enough.

use super::problem::{Problem, Window};
use super::{FitError, Outcome};
use crate::num::Stop;
use nalgebra::{DMatrix, DVector};

/// A relative fall of the cost below this ends the search.
const TOLERANCE: f64 = 1e-6;
/// So does a fall below this: the cost is a negative log likelihood, and data do not tell odds of 1.001 from even ones.
const NEGLIGIBLE: f64 = 0.001;
/// Damping (share of the Hessian's diagonal): at the start, and beyond which no step helps.
const FIRST_DAMPING: f64 = 1e-4;
const MOST_DAMPING: f64 = 1e10;

/// Where a search ended.
#[derive(Debug, Clone)]
pub(super) struct Solution {
    pub point: Vec<f64>,
    pub cost: f64,
    pub iterations: usize,
    pub outcome: Outcome,
    /// The cost of each iteration, over the frames that it saw; last the cost at the end.
    pub losses: Vec<f64>,
}

/// Minimises the cost over the frames before `window` from `start`. `budget` counts iterations.
pub(super) fn minimise(
    problem: &Problem,
    start: &[f64],
    window: Window,
    budget: usize,
    stop: Stop,
) -> Result<Solution, FitError> {
    let mut point = start.to_vec();
    let mut damping = FIRST_DAMPING;
    let mut cost = f64::INFINITY;
    let mut losses = vec![];
    for iteration in 0..budget {
        stop(iteration as f64 / budget as f64)?;
        let normal = problem.normal(&point, window);
        cost = normal.cost;
        losses.push(cost);
        if problem.is_exhausted() {
            return Ok(Solution {
                point,
                cost,
                iterations: iteration,
                outcome: Outcome::IterationLimit,
                losses,
            });
        }
        let mut accepted = None;
        while accepted.is_none() && damping < MOST_DAMPING {
            stop(iteration as f64 / budget as f64)?;
            if let Some(step) = step(problem, &point, &normal.gradient, &normal.hessian, damping) {
                let trial_cost = problem.cost(&step, window);
                if trial_cost < cost {
                    accepted = Some((step, trial_cost));
                    damping = (damping * 0.1).max(1e-12);
                    break;
                }
            }
            damping *= 10.0;
        }
        let Some((step, trial_cost)) = accepted else {
            let (iterations, outcome) = (iteration + 1, Outcome::Converged);
            return Ok(Solution { point, cost, iterations, outcome, losses });
        };
        let fall = cost - trial_cost;
        point = step;
        cost = trial_cost;
        if fall <= (TOLERANCE * cost).max(NEGLIGIBLE) {
            losses.push(cost);
            let (iterations, outcome) = (iteration + 1, Outcome::Converged);
            return Ok(Solution { point, cost, iterations, outcome, losses });
        }
        if damping > 1.0 {
            damping = 1.0;
        }
    }
    losses.push(cost);
    Ok(Solution { point, cost, iterations: budget, outcome: Outcome::IterationLimit, losses })
}

/// The damped Gauss-Newton step, held inside the bounds: parameters that would leave them are held there and
/// the others solved again.
fn step(
    problem: &Problem,
    point: &[f64],
    gradient: &DVector<f64>,
    hessian: &DMatrix<f64>,
    damping: f64,
) -> Option<Vec<f64>> {
    let n = point.len();
    let mut held = vec![false; n];
    for (k, f) in problem.free.iter().enumerate() {
        let outward = (point[k] <= f.min && gradient[k] > 0.0) || (point[k] >= f.max && gradient[k] < 0.0);
        held[k] = outward;
    }
    for _ in 0..4 {
        let mut system = hessian.clone();
        let mut right = -gradient;
        for k in 0..n {
            system[(k, k)] *= 1.0 + damping;
            if held[k] {
                system.row_mut(k).fill(0.0);
                system.column_mut(k).fill(0.0);
                system[(k, k)] = 1.0;
                right[k] = 0.0;
            }
        }
        let delta = system.cholesky()?.solve(&right);
        if delta.iter().any(|d| !d.is_finite()) {
            return None;
        }
        let moved: Vec<f64> = point.iter().zip(delta.iter()).map(|(x, d)| x + d).collect();
        let mut crossed = false;
        for (k, f) in problem.free.iter().enumerate() {
            if !held[k] && (moved[k] < f.min || moved[k] > f.max) && (point[k] == f.min || point[k] == f.max)
            {
                held[k] = true;
                crossed = true;
            }
        }
        if !crossed {
            let clamped = moved.iter().zip(&problem.free).map(|(x, f)| x.clamp(f.min, f.max));
            return Some(clamped.collect());
        }
    }
    None
}
