//! Laplace's approximation of the posterior: means, standard deviations, what the data identify.

use super::super::problem::{FitProblem, Horizon, LinearizedScene, SceneProblem, SearchParameter, influence};
use super::pairs::{PairRestitution, pair_restitutions};
use super::parameter_estimate::{Estimate, IDENTIFIED};
use crate::effects::ParamId;
use crate::num::elementary;
use crate::world::Model;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Uninformative if the posterior standard deviation is at least this share of the prior's.
const UNINFORMATIVE: f64 = 0.95;

/// Most parameters whose correlations are kept: as many as a few dozen objects have.
const MOST_CORRELATED: usize = 256;

/// How many times the standard deviation by the noise the disagreement of videos may be.
const MAX_SCATTER: f64 = 4.0;

/// A standard deviation that also holds how far the videos (or windows) disagree, each left out in turn. Where one of them alone
/// informs the number, leaving it out says nothing, so that there is a limit.
pub fn widened(sd: f64, scatter: f64) -> f64 {
    scatter.min(MAX_SCATTER * sd).max(sd)
}

/// Normal distribution around the best parameters in search space: masses as logarithms.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Posterior {
    pub estimates: Vec<Estimate>,
    /// The best point, in the order of `estimates`.
    pub(super) coordinates: Vec<SearchCoordinate>,
    /// For each scene, index in [`Model::flatten`] and in `coordinates`.
    pub(super) slots: Vec<Vec<(usize, usize)>>,
    /// The restitution of the objects that touch.
    #[serde(default)]
    pub pairs: Vec<PairRestitution>,
    /// Draws, as search-space values; none until they are asked for.
    pub(super) draws: Vec<Vec<f64>>,
    /// Correlations of the physical parameters.
    #[serde(default, skip_serializing_if = "Correlations::is_empty")]
    pub(super) correlations: Correlations,
}

/// Correlations of the masses and of the effects' parameters, which are of all scenes of the fit.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Correlations {
    /// Indices of the estimates, ascending.
    of: Vec<usize>,
    /// Rows of the lower triangle without its diagonal.
    below: Vec<f64>,
}

impl Correlations {
    fn new(estimates: &[Estimate], factor: &DMatrix<f64>) -> Correlations {
        let is_physical = |k: &usize| {
            let name = &estimates[*k].name;
            estimates[*k].sd > 0.0 && (ParamId::parse(name).is_some() || name.ends_with("].mass"))
        };
        let of: Vec<usize> = (0..estimates.len()).filter(is_physical).collect();
        if of.len() > MOST_CORRELATED {
            return Correlations::default();
        }
        let rows: Vec<_> = of.iter().map(|&k| factor.row(k).normalize()).collect();
        let below =
            (0..of.len()).flat_map(|a| (0..a).map(move |b| (a, b))).map(|(a, b)| rows[a].dot(&rows[b]));
        Correlations { below: below.collect(), of }
    }

    fn is_empty(&self) -> bool {
        self.of.is_empty()
    }

    fn at(&self, a: usize, b: usize) -> f64 {
        let (row, column) = (a.max(b), a.min(b));
        if row == column { 1.0 } else { self.below[row * (row - 1) / 2 + column] }
    }

    /// Those of the estimates `kept` (ascending), which are renumbered.
    fn among(&self, kept: &[usize]) -> Correlations {
        let places: Vec<(usize, usize)> =
            (0..self.of.len()).filter_map(|a| Some((a, kept.binary_search(&self.of[a]).ok()?))).collect();
        let pairs = (0..places.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
        let below = pairs.map(|(a, b)| self.at(places[a].0, places[b].0)).collect();
        Correlations { of: places.iter().map(|p| p.1).collect(), below }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct SearchCoordinate {
    pub value: f64,
    pub log: bool,
    /// The prior mean.
    #[serde(default)]
    pub mean: f64,
}

/// The linear model of a problem at its best point.
pub(super) struct Laplace {
    pub scenes: Vec<LinearizedScene>,
    /// Share of each scene's measurements that is independent: one over its redundancy.
    pub shares: Vec<f64>,
    /// L with L L^T = the parameters' covariance.
    pub factor: DMatrix<f64>,
    /// Standard deviation of each parameter by how far the scenes disagree on it; 0 where one scene alone informs it.
    pub scatter: Vec<f64>,
}

impl Laplace {
    pub fn at(problem: &FitProblem, point: &[f64], horizon: Horizon) -> Laplace {
        // The search's last derivatives are of a point before: through contacts they change within a standard deviation.
        let scenes = problem.linearize(point, horizon, None);
        let independent = vec![1.0; scenes.len()];
        let factor = problem.normal_equations(point, &scenes, &independent).covariance_factor();
        let share =
            |(scene, linear): (&SceneProblem, &LinearizedScene)| 1.0 / scene.redundancy(linear, &factor);
        let shares: Vec<f64> = problem.scenes.iter().zip(&scenes).map(share).collect();
        let scatter = scatter(problem, &scenes, &factor);
        let factor = problem.normal_equations(point, &scenes, &shares).covariance_factor();
        Laplace { scenes, shares, factor, scatter }
    }
}

/// Standard deviation of each parameter by how far the scenes disagree: each is left out in turn, to first order. With the gradient
/// g_s of scene s at the optimum and the covariance S = L L^T of all scenes (`factor` L), leaving it out moves the parameters by
/// n/(n-1) S g_s; the jackknife's variance is n/(n-1) sum_s (S g_s)_k^2 over the n scenes that have parameter k.
/// Source: Efron, J. R. Statist. Soc. B 54 (1992) 83.
fn scatter(problem: &FitProblem, scenes: &[LinearizedScene], factor: &DMatrix<f64>) -> Vec<f64> {
    let (mut squares, mut count) = (vec![0.0; factor.nrows()], vec![0.0; factor.nrows()]);
    for (scene, linear) in problem.scenes.iter().zip(scenes) {
        let influences: Vec<f64> = linear.residuals.iter().map(|r| influence(*r)).collect();
        let mut gradient = DVector::zeros(factor.nrows());
        linear.add_transposed_product(&influences, &mut gradient);
        let moved = factor * factor.tr_mul(&gradient);
        for &(_, k) in &scene.slots {
            squares[k] += moved[k] * moved[k];
            count[k] += 1.0;
        }
    }
    let deviation = |(sum, n): (&f64, &f64)| if *n > 1.0 { (sum * n / (n - 1.0)).sqrt() } else { 0.0 };
    squares.iter().zip(&count).map(deviation).collect()
}

impl Posterior {
    /// The posterior at the best point of a problem, without draws.
    pub(in super::super) fn at(problem: &FitProblem, point: &[f64], horizon: Horizon) -> Posterior {
        let Laplace { mut factor, scatter, .. } = Laplace::at(problem, point, horizon);
        let noise: Vec<f64> = (0..factor.nrows()).map(|k| factor.row(k).norm()).collect();
        for (k, &noise) in noise.iter().enumerate().filter(|(_, noise)| **noise > 0.0) {
            // Correlations stay.
            factor.row_mut(k).scale_mut(widened(noise, scatter[k]) / noise);
        }
        let estimate = |(k, p): (usize, &SearchParameter)| {
            let sd = factor.row(k).norm();
            let value = p.in_model(point[k]);
            Estimate {
                scene: p.scene,
                name: p.name.clone(),
                value,
                sd: if p.log { value * sd } else { sd },
                unit: p.unit.to_string(),
                identified: noise[k] < IDENTIFIED * p.sd,
            }
        };
        let coordinate =
            |(p, &value): (&SearchParameter, &f64)| SearchCoordinate { value, log: p.log, mean: p.mean };
        let estimates: Vec<Estimate> = problem.parameters.iter().enumerate().map(estimate).collect();
        Posterior {
            correlations: Correlations::new(&estimates, &factor),
            estimates,
            coordinates: problem.parameters.iter().zip(point).map(coordinate).collect(),
            slots: problem.scenes.iter().map(|s| s.slots.clone()).collect(),
            pairs: pair_restitutions(problem, point, horizon, &factor),
            draws: vec![],
        }
    }

    /// The parameter of a full name, if the data inform it beyond its prior of standard deviation `prior_sd`.
    pub fn informative(&self, name: &str, prior_sd: f64) -> Option<&Estimate> {
        self.estimates.iter().find(|e| e.name == name && e.sd < UNINFORMATIVE * prior_sd)
    }

    /// The part of one scene.
    pub(super) fn of_scene(&self, scene: usize) -> Posterior {
        let concerns = |k: &usize| self.estimates[*k].scene.is_none_or(|s| s == scene);
        let kept: Vec<usize> = (0..self.estimates.len()).filter(concerns).collect();
        let estimate = |k: &usize| {
            let e = &self.estimates[*k];
            Estimate { scene: e.scene.map(|_| 0), ..e.clone() }
        };
        let slot = |&(slot, k): &(usize, usize)| Some((slot, kept.binary_search(&k).ok()?));
        let slots = self.slots.get(scene).map(|slots| slots.iter().filter_map(slot).collect());
        Posterior {
            estimates: kept.iter().map(estimate).collect(),
            coordinates: kept.iter().map(|&k| self.coordinates[k]).collect(),
            slots: slots.into_iter().collect(),
            pairs: self
                .pairs
                .iter()
                .filter(|pair| pair.scene == scene)
                .map(|pair| PairRestitution { scene: 0, ..pair.clone() })
                .collect(),
            draws: self.draws.iter().map(|d| kept.iter().map(|&k| d[k]).collect()).collect(),
            correlations: self.correlations.among(&kept),
        }
    }

    /// The fitted masses and parameters of effects with their covariance, row by row; none where there are too many of them.
    pub fn covariance(&self) -> (Vec<&Estimate>, Vec<Vec<f64>>) {
        let all = &self.correlations;
        let own: Vec<&Estimate> = all.of.iter().map(|&k| &self.estimates[k]).collect();
        let row = |a: usize| (0..own.len()).map(|b| all.at(a, b) * own[a].sd * own[b].sd).collect();
        let rows = (0..own.len()).map(row).collect();
        (own, rows)
    }

    /// The estimate of a name in one scene.
    pub(super) fn named(&self, scene: usize, name: &str) -> Option<&Estimate> {
        self.estimates.iter().find(|e| e.name == name && e.scene.is_none_or(|s| s == scene))
    }

    /// The model of a scene at stored draw `draw`.
    pub(super) fn model(&self, scene: usize, model: &Model, draw: usize) -> Model {
        let mut values = model.flatten();
        for &(slot, k) in &self.slots[scene] {
            let value = self.draws[draw][k];
            values[slot] = if self.coordinates[k].log { elementary::exp(value) } else { value };
        }
        model.with_values(&values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scatter_widens_a_deviation_up_to_a_limit() {
        assert_eq!([widened(1.0, 0.5), widened(1.0, 3.0), widened(1.0, 90.0)], [1.0, 3.0, MAX_SCATTER]);
    }
}
