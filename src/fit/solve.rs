//! Levenberg-Marquardt with bounds on the whole window, then growing windows where that is not enough.

use super::linear::Linear;
use super::problem::{Followed, Problem, Window};
use super::{FitError, Outcome};
use crate::num::Stop;
use nalgebra::{DMatrix, DVector};

/// A relative fall of the cost below this ends the search.
const TOLERANCE: f64 = 1e-6;
/// So does a fall below this: the cost is a negative log likelihood, and data do not tell odds of 1.01 from even ones.
pub(super) const NEGLIGIBLE: f64 = 0.01;
/// A step that is not damped and has a smaller fall stays well within the deviations of the posterior: the derivatives at
/// its start serve at its end.
pub(super) const NEAR: f64 = 0.1;
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
    /// Residuals of each part at the point, with derivatives that serve a further search from there.
    pub linear: Option<Vec<Linear>>,
}

/// Minimises the cost over the frames before `window` from `start`, until it falls by no more than `negligible`. `budget`
/// counts iterations.
pub(super) fn minimise(
    problem: &Problem,
    start: &[f64],
    window: Window,
    negligible: f64,
    budget: usize,
    stop: Stop,
) -> Result<Solution, FitError> {
    minimise_from(problem, start.to_vec(), None, window, negligible, budget, stop)
}

/// The same from a point where the parts are linearised already.
pub(super) fn minimise_from(
    problem: &Problem,
    mut point: Vec<f64>,
    mut known: Option<Vec<Linear>>,
    window: Window,
    negligible: f64,
    budget: usize,
    stop: Stop,
) -> Result<Solution, FitError> {
    let mut damping = FIRST_DAMPING;
    let mut cost = f64::INFINITY;
    let mut losses = vec![];
    let mut there: Option<Vec<Followed>> = None;
    if known.is_none() {
        there = problem.followed(&point, window);
        // What a simulation that is cut short does not reach costs nothing: no search begins with one.
        if there.is_none() {
            let outcome = Outcome::IterationLimit;
            return Ok(Solution { point, cost, iterations: 0, outcome, losses, linear: None });
        }
    }
    for iteration in 0..budget {
        stop(iteration as f64 / budget as f64)?;
        let linear = known.take().unwrap_or_else(|| problem.linearised(&point, window, there.as_deref()));
        let normal = problem.weighed(&point, &linear, &vec![1.0; linear.len()]);
        cost = normal.cost;
        losses.push(cost);
        if problem.is_exhausted() {
            return Ok(Solution {
                point,
                cost,
                iterations: iteration,
                outcome: Outcome::IterationLimit,
                losses,
                linear: Some(linear),
            });
        }
        let mut accepted = None;
        while accepted.is_none() && damping < MOST_DAMPING {
            stop(iteration as f64 / budget as f64)?;
            if let Some(step) = step(problem, &point, &normal.gradient, &normal.hessian, damping) {
                let found = Trial::at(problem, step, window);
                if found.cost < cost {
                    accepted = Some(found);
                    damping = (damping * 0.1).max(1e-12);
                    break;
                }
            }
            damping *= 10.0;
        }
        let Some(mut trial) = accepted else {
            let (iterations, outcome) = (iteration + 1, Outcome::Converged);
            return Ok(Solution { point, cost, iterations, outcome, losses, linear: Some(linear) });
        };
        let enough = (TOLERANCE * trial.cost).max(negligible);
        let mut fall = cost - trial.cost;
        // The derivatives serve for further steps as long as these gain: a pass with them costs as much as many trials. Far
        // from the end such steps lead to other minima.
        let near = fall <= enough || (fall <= NEAR && damping <= FIRST_DAMPING);
        while near && fall > enough {
            stop(iteration as f64 / budget as f64)?;
            let gradient = problem.gradient(&trial.point, &linear, &trial.there);
            let next = step(problem, &trial.point, &gradient, &normal.hessian, damping);
            let next =
                next.map(|step| Trial::at(problem, step, window)).filter(|next| next.cost < trial.cost);
            let gain = next.as_ref().map_or(0.0, |next| trial.cost - next.cost);
            trial = next.unwrap_or(trial);
            if gain < 0.1 * fall && gain > enough {
                break;
            }
            fall = gain;
        }
        let converged = near && fall <= enough;
        point = trial.point;
        cost = trial.cost;
        if converged {
            losses.push(cost);
            let (iterations, outcome) = (iteration + 1, Outcome::Converged);
            let mut linear = linear;
            linear.iter_mut().zip(trial.there).for_each(|(part, there)| part.residuals = there.residuals);
            let linear = Some(linear);
            return Ok(Solution { point, cost, iterations, outcome, losses, linear });
        }
        there = Some(trial.there);
        if damping > 1.0 {
            damping = 1.0;
        }
    }
    losses.push(cost);
    Ok(Solution { point, cost, iterations: budget, outcome: Outcome::IterationLimit, losses, linear: None })
}

/// A point with what the parts do there.
struct Trial {
    point: Vec<f64>,
    cost: f64,
    there: Vec<Followed>,
}

impl Trial {
    fn at(problem: &Problem, point: Vec<f64>, window: Window) -> Trial {
        match problem.followed(&point, window) {
            Some(there) => Trial { cost: problem.cost_of(&point, &there), point, there },
            None => Trial { point, cost: f64::INFINITY, there: vec![] },
        }
    }
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
        held[k] = outward || f.held;
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

#[cfg(test)]
mod tests {
    use super::super::noise;
    use super::super::tests::film;
    use super::*;
    use crate::effects::formula::Formula;
    use crate::num::never;
    use crate::world::{ActiveEffect, Prior};

    /// Frames that a simulation does not reach leave no residuals, which would look like the best of fits.
    #[test]
    fn where_a_formula_loses_its_value_is_no_minimum() {
        let (scene, mut model) = film("s", 1, [1.0; 3]);
        let formula = Formula::new("let k = 0; ax = 0.001*k*sqrt(1 - k*t)", vec![]).expect("it is one");
        let mut active = ActiveEffect::of_formula("f", formula, &model.bodies).expect("it is one");
        active.parameters[0].prior = Prior { mean: 0.0, sd: 1.0 };
        model.effects.push(active);
        let (noises, scenes) = ([noise::estimate(&scene)], [scene]);
        let problem = Problem::new(&scenes, vec![model], &noises, &never);
        let cost = |k: f64| {
            let mut start = problem.start();
            let at = problem.free.iter().position(|f| f.name == "f.k").expect("it is free");
            start[at] = k;
            minimise(&problem, &start, 100, NEGLIGIBLE, 5, &never).expect("nobody stops it").cost
        };
        assert!(cost(0.1).is_finite() && cost(3.0).is_infinite());
    }
}
