//! Cost, gradient and normal equations of all scenes, and the budget of a search.

use super::super::noise::Noise;
use super::jacobian::LinearizedScene;
use super::loss::{huber, influence};
use super::scene_problem::{Horizon, SceneProblem, SimulatedScene};
use super::search_parameter::{SearchParameter, add_parameters};
use crate::num::{NormalEquations, Stop, elementary};
use crate::scene::Scene;
use crate::world::Model;
use nalgebra::DVector;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// A fall of the cost that is not worth another iteration: the cost is a negative log likelihood, and odds of 1.01 to 1 are even.
pub(in super::super) const NEGLIGIBLE_FALL: f64 = 0.01;
/// An undamped step with a smaller fall stays within the posterior standard deviations: derivatives at its start serve at its end.
pub(in super::super) const MAX_CHORD_FALL: f64 = 0.1;

/// The least-squares problem of one or several scenes.
pub(in super::super) struct FitProblem<'a> {
    /// Simulation steps that the search may take before it must go on with something else, or end.
    budget: AtomicU64,
    /// Polled between passes of one linearisation; the result of a stopped one is never used.
    pub stop: Stop<'a>,
    pub scenes: Vec<SceneProblem<'a>>,
    pub parameters: Vec<SearchParameter>,
}

impl<'a> FitProblem<'a> {
    pub fn new(scenes: &'a [Scene], models: Vec<Model>, noises: &[Noise], stop: Stop<'a>) -> Self {
        let mut parameters = vec![];
        let each = scenes.iter().zip(models).zip(noises).enumerate();
        let problems: Vec<SceneProblem> = each
            .map(|(index, ((scene, model), noise))| {
                let slots = add_parameters(index, (scene, &model, noise), &mut parameters);
                SceneProblem::new(scene, model, *noise, slots)
            })
            .collect();
        FitProblem { budget: AtomicU64::new(max_steps(&problems)), stop, scenes: problems, parameters }
    }

    /// The same parameters and models with other measurements of the same objects.
    pub fn with_scenes<'b>(&'b self, scenes: &'b [Scene]) -> FitProblem<'b> {
        let scenes: Vec<SceneProblem> =
            self.scenes.iter().zip(scenes).map(|(p, scene)| p.with_scene(scene)).collect();
        FitProblem {
            budget: AtomicU64::new(max_steps(&scenes)),
            stop: self.stop,
            scenes,
            parameters: self.parameters.clone(),
        }
    }

    /// Whether derivatives are of single precision from now on.
    pub fn set_single_precision(&mut self, single_precision: bool) {
        self.scenes.iter_mut().for_each(|scene| scene.single_precision = single_precision);
    }

    /// Unfreezes all parameters; gives which were frozen.
    pub fn unfreeze(&mut self) -> Vec<bool> {
        self.parameters.iter_mut().map(|p| std::mem::take(&mut p.frozen)).collect()
    }

    /// A fall of the cost that is not worth another iteration; larger while parameters are frozen, as the search goes on anyway.
    pub fn negligible_fall(&self) -> f64 {
        if self.parameters.iter().any(|p| p.frozen) { MAX_CHORD_FALL } else { NEGLIGIBLE_FALL }
    }

    /// A point a step away, within the bounds; frozen parameters stay.
    pub fn stepped(&self, from: &[f64], step: impl Fn(usize) -> f64) -> Vec<f64> {
        let stepped = |(k, p): (usize, &SearchParameter)| match p.frozen {
            true => from[k],
            false => (from[k] + step(k)).clamp(p.min, p.max),
        };
        self.parameters.iter().enumerate().map(stepped).collect()
    }

    /// The point of the models that the problem was made of.
    pub fn start(&self) -> Vec<f64> {
        self.point_of_values(self.scenes.iter().map(|scene| &scene.base[..]))
    }

    /// The point of other models of the scenes.
    pub fn point_of(&self, models: &[Model]) -> Vec<f64> {
        let values: Vec<Vec<f64>> = models.iter().map(Model::flatten).collect();
        self.point_of_values(values.iter().map(|values| &values[..]))
    }

    fn point_of_values<'f>(&self, values: impl Iterator<Item = &'f [f64]>) -> Vec<f64> {
        let mut point: Vec<f64> = self.parameters.iter().map(|p| p.mean).collect();
        for (scene, values) in self.scenes.iter().zip(values) {
            for &(slot, k) in &scene.slots {
                point[k] = if self.parameters[k].log { elementary::ln(values[slot]) } else { values[slot] };
            }
        }
        point
    }

    /// The model of scene `index` at a point.
    pub fn model(&self, index: usize, point: &[f64]) -> Model {
        let scene = &self.scenes[index];
        scene.model.with_values(&scene.values(&self.parameters, point))
    }

    /// Whether the search has used its budget of simulation steps.
    pub fn is_exhausted(&self) -> bool {
        let done: u64 = self.scenes.iter().map(SceneProblem::steps).sum();
        done > self.budget.load(Ordering::Relaxed)
    }

    /// Sets the budget, counted from the beginning of the search, to this fraction of the limit.
    pub fn set_budget(&self, fraction: f64) {
        self.budget.store((fraction * max_steps(&self.scenes) as f64) as u64, Ordering::Relaxed);
    }

    /// The cost; infinite if a simulation does not come to its end.
    pub fn cost(&self, point: &[f64], horizon: Horizon) -> f64 {
        self.simulate(point, horizon).map_or(f64::INFINITY, |scenes| self.cost_of(point, &scenes))
    }

    /// The cost of a point whose simulations are known.
    pub fn cost_of(&self, point: &[f64], scenes: &[SimulatedScene]) -> f64 {
        let misfit = |scene: &SimulatedScene| scene.residuals.iter().map(|&r| huber(r)).sum::<f64>();
        let cost = self.prior_cost(point) + scenes.iter().map(misfit).sum::<f64>();
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    fn prior_cost(&self, point: &[f64]) -> f64 {
        self.parameters.iter().zip(point).map(|(p, x)| p.prior_cost(*x)).sum()
    }

    /// The simulation of each scene; `None` if one does not come to its end, or the caller no longer wants it.
    pub fn simulate(&self, point: &[f64], horizon: Horizon) -> Option<Vec<SimulatedScene>> {
        let each = self.map_scenes(|_, scene| {
            (self.stop)(0.0).ok()?;
            scene.simulate_completely(&self.parameters, point, horizon)
        });
        each.into_iter().collect()
    }

    /// One result a scene, in order; several scenes in parallel.
    fn map_scenes<R: Send>(&self, of: impl Fn(usize, &SceneProblem) -> R + Sync + Send) -> Vec<R> {
        match &self.scenes[..] {
            [one] => vec![of(0, one)],
            scenes => scenes.par_iter().enumerate().map(|(k, scene)| of(k, scene)).collect(),
        }
    }

    /// Residuals and Jacobian of each scene by the parameters that are not frozen; `known` are the simulations at the point.
    pub fn linearize(
        &self,
        point: &[f64],
        horizon: Horizon,
        known: Option<&[SimulatedScene]>,
    ) -> Vec<LinearizedScene> {
        self.map_scenes(|k, scene| {
            let known = known.and_then(|scenes| scenes.get(k));
            let wanted = |k: usize| !self.parameters[k].frozen;
            scene.linearize((&self.parameters, &wanted), point, horizon, known, self.stop)
        })
    }

    /// The same with the derivatives by the `missing` parameters added to those that are known.
    pub fn complete(
        &self,
        known: Vec<LinearizedScene>,
        missing: &[bool],
        point: &[f64],
        horizon: Horizon,
    ) -> Vec<LinearizedScene> {
        let wanted = |k: usize| missing[k];
        let further = self.map_scenes(|_, scene| {
            scene.linearize((&self.parameters, &wanted), point, horizon, None, self.stop)
        });
        known.into_iter().zip(&further).map(|(known, further)| known.with(further)).collect()
    }

    /// Normal equations of linearised scenes, each weighted by its share.
    pub fn normal_equations(
        &self,
        point: &[f64],
        scenes: &[LinearizedScene],
        shares: &[f64],
    ) -> NormalEquations {
        let mut normal = NormalEquations::zeros(self.parameters.len());
        normal.cost = self.prior_cost(point);
        for (k, p) in self.parameters.iter().enumerate() {
            normal.gradient[k] = (point[k] - p.mean) / (p.sd * p.sd);
            normal.hessian[(k, k)] = 1.0 / (p.sd * p.sd);
        }
        for (scene, share) in scenes.iter().zip(shares) {
            scene.add_to(&mut normal, *share);
        }
        normal.hessian.fill_upper_triangle_with_lower_triangle();
        normal
    }

    /// Normal equations at a point, all scenes of weight 1.
    pub fn normal_equations_at(&self, point: &[f64], horizon: Horizon) -> NormalEquations {
        let linear = self.linearize(point, horizon, None);
        self.normal_equations(point, &linear, &vec![1.0; linear.len()])
    }

    /// The gradient of simulations at a point, with the Jacobian of a point nearby.
    pub fn chord_gradient(
        &self,
        point: &[f64],
        nearby: &[LinearizedScene],
        scenes: &[SimulatedScene],
    ) -> DVector<f64> {
        let prior = self.parameters.iter().zip(point).map(|(p, x)| (x - p.mean) / (p.sd * p.sd));
        let mut gradient = DVector::from_iterator(point.len(), prior);
        for (linear, scene) in nearby.iter().zip(scenes) {
            let influences: Vec<f64> = scene.residuals.iter().map(|r| influence(*r)).collect();
            linear.add_transposed_product(&influences, &mut gradient);
        }
        gradient
    }
}

/// Simulation steps that a search of these scenes may take.
fn max_steps(scenes: &[SceneProblem]) -> u64 {
    scenes.iter().map(SceneProblem::max_steps).sum()
}
