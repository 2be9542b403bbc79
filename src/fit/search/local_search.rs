//! Levenberg-Marquardt from one point over the frames of a horizon.

use super::super::problem::{FitProblem, Horizon, LinearizedScene, MAX_CHORD_FALL, SimulatedScene};
use crate::num::{
    AtBounds, Bounds, Ended, LeastSquares, Minimum, NormalEquations, Schedule, Stop, Stopped,
    levenberg_marquardt,
};
use nalgebra::DVector;
use serde::{Deserialize, Serialize};

/// A relative fall of the cost below this ends the search.
const RELATIVE_TOLERANCE: f64 = 1e-6;

/// Chord steps are tried near the minimum: a linearisation costs as much as many simulations.
const SCHEDULE: Schedule = Schedule {
    initial: 1e-4,
    min: 1e-12,
    max: 1e10,
    max_at_start: 1.0,
    min_after_rejection: 0.0,
    growth: 10.0,
    trials: usize::MAX,
    chord_below: MAX_CHORD_FALL,
    at_bounds: AtBounds::ActiveSet,
};

/// Why a fit stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Termination {
    Converged,
    IterationLimit,
}

/// Where a search ended.
#[derive(Debug, Clone)]
pub(in super::super) struct Solution {
    pub point: Vec<f64>,
    pub cost: f64,
    pub iterations: usize,
    pub outcome: Termination,
    /// The cost of each iteration, over the frames of its horizon; last the cost at the end.
    pub losses: Vec<f64>,
    /// Residuals of each scene at the point, with derivatives that serve a further search from there.
    pub linear: Option<Vec<LinearizedScene>>,
}

/// Minimises the cost over the horizon from `start`, until it falls by no more than `negligible`. `budget` counts iterations.
pub(in super::super) fn minimise(
    problem: &FitProblem,
    start: &[f64],
    horizon: Horizon,
    negligible: f64,
    budget: usize,
    stop: Stop,
) -> Result<Solution, Stopped> {
    let local = LocalProblem::new(problem, horizon, negligible, stop);
    local.solve(start.to_vec(), None, budget)
}

/// The same from a point where the scenes are linearised already.
pub(in super::super) fn minimise_from(
    problem: &FitProblem,
    (start, linear): (Vec<f64>, Option<Vec<LinearizedScene>>),
    horizon: Horizon,
    negligible: f64,
    budget: usize,
    stop: Stop,
) -> Result<Solution, Stopped> {
    let local = LocalProblem::new(problem, horizon, negligible, stop);
    local.solve(start, linear, budget)
}

/// The solution of lower cost, with the iterations of both.
pub(in super::super) fn better(known: Solution, tried: Solution) -> Solution {
    let iterations = known.iterations + tried.iterations;
    let best = if tried.cost < known.cost { tried } else { known };
    Solution { iterations, ..best }
}

/// The problem over one horizon.
struct LocalProblem<'p, 'a> {
    problem: &'p FitProblem<'a>,
    bounds: Vec<Bounds>,
    horizon: Horizon,
    negligible: f64,
    stop: Stop<'p>,
}

impl<'p, 'a> LocalProblem<'p, 'a> {
    fn new(problem: &'p FitProblem<'a>, horizon: Horizon, negligible: f64, stop: Stop<'p>) -> Self {
        let bounds = problem.parameters.iter().map(|p| p.bounds()).collect();
        LocalProblem { problem, bounds, horizon, negligible, stop }
    }

    fn normal_equations(&self, point: &[f64], linear: &[LinearizedScene]) -> NormalEquations {
        self.problem.normal_equations(point, linear, &vec![1.0; linear.len()])
    }

    fn solve(
        mut self,
        start: Vec<f64>,
        linear: Option<Vec<LinearizedScene>>,
        budget: usize,
    ) -> Result<Solution, Stopped> {
        let known = linear.map(|linear| {
            let normal = self.normal_equations(&start, &linear);
            (linear, normal)
        });
        let found: Minimum<Self> = levenberg_marquardt(&mut self, start, known, &SCHEDULE, budget)?;
        let outcome = match found.ended {
            Ended::Converged => Termination::Converged,
            Ended::Exhausted | Ended::IterationLimit | Ended::Undefined => Termination::IterationLimit,
        };
        let linear = found.linearization.map(|mut linear| {
            let evaluation = found.evaluation.into_iter().flatten();
            linear.iter_mut().zip(evaluation).for_each(|(linear, at)| linear.residuals = at.residuals);
            linear
        });
        let Minimum { point, cost, iterations, losses, .. } = found;
        Ok(Solution { point, cost, iterations, outcome, losses, linear })
    }
}

impl LeastSquares for LocalProblem<'_, '_> {
    type Evaluation = Vec<SimulatedScene>;
    type Linearization = Vec<LinearizedScene>;
    type Error = Stopped;

    // What a simulation that is cut short does not reach costs nothing: its cost is not defined.
    fn evaluate(&mut self, point: &[f64]) -> Option<(f64, Vec<SimulatedScene>)> {
        let scenes = self.problem.simulate(point, self.horizon)?;
        Some((self.problem.cost_of(point, &scenes), scenes))
    }
    fn linearize(
        &mut self,
        point: &[f64],
        known: Option<&Vec<SimulatedScene>>,
    ) -> (Vec<LinearizedScene>, NormalEquations) {
        let linear = self.problem.linearize(point, self.horizon, known.map(Vec::as_slice));
        let normal = self.normal_equations(point, &linear);
        (linear, normal)
    }
    fn bounds(&self) -> &[Bounds] {
        &self.bounds
    }
    fn tolerance(&self, _before: f64, after: f64) -> f64 {
        (RELATIVE_TOLERANCE * after).max(self.negligible)
    }
    fn poll(&self, progress: f64) -> Result<(), Stopped> {
        (self.stop)(progress)
    }
    fn is_exhausted(&self) -> bool {
        self.problem.is_exhausted()
    }
    fn chord_gradient(
        &self,
        point: &[f64],
        linear: &Vec<LinearizedScene>,
        known: &Vec<SimulatedScene>,
    ) -> Option<DVector<f64>> {
        Some(self.problem.chord_gradient(point, linear, known))
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::noise;
    use super::super::super::problem::NEGLIGIBLE_FALL;
    use super::super::super::tests::three_bodies;
    use super::*;
    use crate::effects::formula::Formula;
    use crate::num::never;
    use crate::world::{ActiveEffect, Prior};

    /// Frames that a simulation does not reach leave no residuals, which would look like the best of fits.
    #[test]
    fn a_formula_without_a_value_is_no_minimum() {
        let (scene, mut model) = three_bodies("s", 1, [1.0; 3]);
        let formula = Formula::new("let k = 0; ax = 0.001*k*sqrt(1 - k*t)", vec![]).expect("it is one");
        let mut active = ActiveEffect::of_formula("f", formula, &model.bodies).expect("it is one");
        active.parameters[0].prior = Prior { mean: 0.0, sd: 1.0 };
        model.effects.push(active);
        let (noises, scenes) = ([noise::estimate(&scene)], [scene]);
        let problem = FitProblem::new(&scenes, vec![model], &noises, &never);
        let cost = |k: f64| {
            let mut start = problem.start();
            let at = problem.parameters.iter().position(|p| p.name == "f.k").expect("it is free");
            start[at] = k;
            minimise(&problem, &start, 100, NEGLIGIBLE_FALL, 5, &never).expect("nobody stops it").cost
        };
        assert!(cost(0.1).is_finite() && cost(3.0).is_infinite());
    }
}
