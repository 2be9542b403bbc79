//! One scene linearised at a point: residuals r (rows) and their Jacobian J = dr/dx (rows x parameters), compressed.
//!
//! Forward differentiation gives J column by column: one pass carries [`LANES`] derivatives. Bodies that never met, directly or
//! through others, form components with no parameters in common but the shared ones; a lane carries one parameter of each
//! component at a time (column compression: Curtis, Powell and Reid, IMA Journal of Applied Mathematics 13 (1974) 117).
//! Stored are one derivative a lane for each row, and for each body the parameter of each lane.

use super::loss::{huber, weight};
use super::scene_problem::{Horizon, LIMITS, ResidualId, SceneProblem, SimulatedScene};
use super::search_parameter::SearchParameter;
use crate::effects::Scalar;
use crate::num::{Differential, Jet, JetF32, LANES, NormalEquations, Stop};
use crate::world::{Event, Rollout, ValueOwner, simulate_observed};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::borrow::Cow;

/// Frames whose residuals are summed to measure their correlation.
const BLOCK: usize = 25;
/// Cost of a pass with derivatives, in simulations without.
const PASS_COST: u64 = 5;

impl SceneProblem<'_> {
    /// Residuals at a point and their derivatives by the parameters that are wanted; `known` is the simulation at the point.
    pub(super) fn linearize(
        &self,
        (parameters, wanted): (&[SearchParameter], &dyn Fn(usize) -> bool),
        point: &[f64],
        horizon: Horizon,
        known: Option<&SimulatedScene>,
        stop: Stop,
    ) -> LinearizedScene {
        let values = self.values(parameters, point);
        let known = match known {
            Some(known) => Cow::Borrowed(known),
            None => Cow::Owned(self.simulate(parameters, point, horizon)),
        };
        let SimulatedScene { rollout, residuals } = known.as_ref();
        let residuals = residuals.clone();
        let mut bodies = Vec::with_capacity(residuals.len());
        self.each_sample(horizon, |m, row| bodies.resize(row + 2 + usize::from(m.yaw.is_some()), m.body));
        let components = self.components(rollout);
        let lanes = self.lanes(wanted, rollout, &components);
        let width = lanes.iter().map(|l| l.number + 1).max().unwrap_or(0);
        let mut jacobian = vec![0.0; residuals.len() * width];
        // What one pass carries takes the same time in double precision.
        let single = self.single_precision && width > LANES;
        let firsts: Vec<usize> = (0..width).step_by(if single { JetF32::LANES } else { LANES }).collect();
        let pass = |first: usize| match single {
            _ if stop(0.0).is_err() => Derivatives::default(),
            true => self.differentiate::<JetF32>((parameters, &values), &lanes, first, horizon),
            false => self.differentiate::<Jet>((parameters, &values), &lanes, first, horizon),
        };
        let passes: Vec<Derivatives> = firsts.par_iter().map(|&first| pass(first)).collect();
        for (&first, Derivatives { rows, derivatives }) in firsts.iter().zip(&passes) {
            let count = derivatives.len() / rows.len().max(1);
            for (row, derivatives) in rows.iter().zip(derivatives.chunks_exact(count.max(1))) {
                let at = row * width + first;
                jacobian[at..at + count].copy_from_slice(derivatives);
            }
        }
        // A body's rows depend on the parameters of its component and on the shared ones only.
        let columns: Vec<Vec<(usize, usize)>> = (0..self.model.bodies.len())
            .map(|body| {
                let relevant = lanes.iter().filter(|l| l.component.is_none_or(|c| c == components[body]));
                relevant.map(|l| (self.slots[l.slot].1, l.number)).collect()
            })
            .collect();
        LinearizedScene { residuals, bodies, jacobian, width, columns }
    }

    /// One pass: derivatives of all residuals by the lanes from number `first` on.
    fn differentiate<J: Differential + Scalar>(
        &self,
        (parameters, values): (&[SearchParameter], &[f64]),
        lanes: &[DerivativeLane],
        first: usize,
        horizon: Horizon,
    ) -> Derivatives {
        let mut jets: Vec<J> = values.iter().map(|&v| J::constant(v)).collect();
        let mut count = 0;
        for lane in lanes.iter().filter(|l| (first..first + J::LANES).contains(&l.number)) {
            let (slot, k) = self.slots[lane.slot];
            let slope = if parameters[k].log { values[slot] } else { 1.0 };
            jets[slot] = jets[slot].with_derivative(lane.number - first, slope);
            count = count.max(lane.number - first + 1);
        }
        let run = simulate_observed(&self.model, &jets, self.times(horizon), &LIMITS);
        // Derivatives count the same in either precision, so that a search ends at the same budget.
        self.count_steps(&run, PASS_COST * (J::LANES / LANES) as u64);
        let (mut rows, mut derivatives) = (vec![], vec![]);
        self.each_sample(horizon, |m, row| {
            let Some(k) = run.states.get(m.sample.frame).and_then(|s| s[m.body].as_ref()) else { return };
            let position =
                |lane| m.whitener.apply(k.position.x.derivative(lane), k.position.y.derivative(lane));
            rows.extend([row, row + 1]);
            for axis in [0, 1] {
                derivatives.extend((0..count).map(|lane| position(lane)[axis]));
            }
            if let Some((_, sigma)) = m.yaw {
                rows.push(row + 2);
                derivatives.extend((0..count).map(|lane| k.yaw.derivative(lane) / sigma));
            }
        });
        Derivatives { rows, derivatives }
    }

    /// How many measurements of this scene carry as much information as one independent measurement (at least 1).
    ///
    /// Where the model is not quite right, residuals of neighbouring frames are correlated. It is the ratio of
    /// sum_b (sum_i r_i)^2 / n_b over blocks b of [`BLOCK`] frames to its expectation sum_b (1 - leverage_b) for independent
    /// residuals; the leverage of a block is |L^T sum_i J_i|^2 / n_b, with the parameters' covariance L L^T (`factor` L).
    pub fn redundancy(&self, linear: &LinearizedScene, factor: &DMatrix<f64>) -> f64 {
        let mut blocks: Vec<ResidualBlock> = vec![];
        let mut rows = linear.rows();
        self.each_sample(self.scene.times.len(), |m, _| {
            for coordinate in 0..2 + usize::from(m.yaw.is_some()) {
                let Some((residual, j, columns)) = rows.next() else { return };
                let key = (m.body, m.sample.frame / BLOCK, coordinate);
                // The coordinates of a sample come one after the other.
                let known = blocks.iter().rposition(|b| b.key == key).filter(|at| at + 3 >= blocks.len());
                let at = known.unwrap_or_else(|| {
                    let slope = DVector::zeros(factor.nrows());
                    blocks.push(ResidualBlock { key, sum: 0.0, count: 0, slope });
                    blocks.len() - 1
                });
                let block = &mut blocks[at];
                block.sum += residual;
                block.count += 1;
                for &(k, lane) in columns {
                    block.slope[k] += j[lane];
                }
            }
        });
        let full = blocks.iter().filter(|b| 2 * b.count > BLOCK);
        let (found, expected) = full.fold((0.0, 0.0), |(found, expected), block| {
            let count = block.count as f64;
            let leverage = factor.tr_mul(&block.slope).norm_squared() / count;
            (found + block.sum * block.sum / count, expected + (1.0 - leverage).max(0.0))
        });
        if expected < 1.0 { 1.0 } else { f64::max(1.0, found / expected) }
    }

    /// The component of each body: bodies that met, directly or through others, share the smallest index among them.
    pub fn components(&self, rollout: &Rollout<f64>) -> Vec<usize> {
        let mut component: Vec<usize> = (0..self.model.bodies.len()).collect();
        if self.model.has_pair_forces() {
            return vec![0; component.len()];
        }
        for (a, b) in self.meetings(rollout) {
            let (from, to) = (component[a].max(component[b]), component[a].min(component[b]));
            component.iter_mut().filter(|c| **c == from).for_each(|c| *c = to);
        }
        component
    }

    fn meetings(&self, rollout: &Rollout<f64>) -> Vec<(usize, usize)> {
        let index = |id: &u32| self.model.body_index(*id);
        let met = |e: &Event| match e.objects[..] {
            [a, b] => Some((index(&a)?, index(&b)?)),
            _ => None,
        };
        rollout.events.iter().filter_map(met).collect()
    }

    /// A lane for each slot that can matter; slots of different components share lanes.
    fn lanes(
        &self,
        wanted: &dyn Fn(usize) -> bool,
        rollout: &Rollout<f64>,
        components: &[usize],
    ) -> Vec<DerivativeLane> {
        let owners = self.model.owners();
        let meetings = self.meetings(rollout);
        let met = |a, b| meetings.iter().any(|&m| m == (a, b) || m == (b, a));
        let component = |s: usize| match owners[self.slots[s].0] {
            _ if !wanted(self.slots[s].1) => None,
            ValueOwner::Body(a) => Some(Some(components[a])),
            ValueOwner::Pair(a, b) => met(a, b).then(|| Some(components[a])),
            ValueOwner::Shared => Some(None),
        };
        let mut lanes = vec![];
        let mut shared = 0;
        for s in 0..self.slots.len() {
            if component(s) == Some(None) {
                lanes.push(DerivativeLane { slot: s, component: None, number: shared });
                shared += 1;
            }
        }
        // Body by body: a body without a lane in a pass is simulated without derivatives until it meets one that has some.
        let body = |slot: usize| match owners[slot] {
            ValueOwner::Body(a) => a,
            ValueOwner::Pair(a, b) => a.max(b),
            ValueOwner::Shared => 0,
        };
        let mut order: Vec<usize> = (0..self.slots.len()).collect();
        order.sort_by_key(|&s| body(self.slots[s].0));
        let mut own = vec![shared; components.len()];
        for s in order {
            if let Some(Some(c)) = component(s) {
                lanes.push(DerivativeLane { slot: s, component: Some(c), number: own[c] });
                own[c] += 1;
            }
        }
        lanes
    }
}

/// Derivatives of one pass: the rows that have some, and as many derivatives for each of them.
#[derive(Default)]
struct Derivatives {
    rows: Vec<usize>,
    derivatives: Vec<f64>,
}

/// The lane that carries the derivative by one slot.
struct DerivativeLane {
    slot: usize,
    /// The bodies that the slot can affect; `None`: all.
    component: Option<usize>,
    number: usize,
}

/// Residuals of one coordinate of a body over a few frames: their sum, number and derivative.
struct ResidualBlock {
    key: ResidualId,
    sum: f64,
    count: usize,
    slope: DVector<f64>,
}

/// Residuals of one scene with their compressed Jacobian.
#[derive(Debug, Clone)]
pub(in super::super) struct LinearizedScene {
    pub residuals: Vec<f64>,
    /// Body of each row.
    pub bodies: Vec<usize>,
    /// Rows x width, row by row.
    jacobian: Vec<f64>,
    /// Number of lanes.
    width: usize,
    /// For each body, the parameters that affect it and their lanes.
    columns: Vec<Vec<(usize, usize)>>,
}

impl LinearizedScene {
    /// The same with the derivatives by further parameters.
    pub(super) fn with(self, further: &LinearizedScene) -> LinearizedScene {
        let width = self.width + further.width;
        let mut jacobian = Vec::with_capacity(self.residuals.len() * width);
        for row in 0..self.residuals.len() {
            for part in [&self, further] {
                jacobian.extend_from_slice(part.row(row));
            }
        }
        let mut columns = self.columns;
        for (columns, further) in columns.iter_mut().zip(&further.columns) {
            columns.extend(further.iter().map(|&(k, lane)| (k, self.width + lane)));
        }
        LinearizedScene { jacobian, width, columns, ..self }
    }

    fn row(&self, row: usize) -> &[f64] {
        &self.jacobian[row * self.width..(row + 1) * self.width]
    }

    /// Residual, derivatives and columns of each row.
    fn rows(&self) -> impl Iterator<Item = (f64, &[f64], &[(usize, usize)])> {
        let row =
            |(row, (&r, &body)): (usize, (&f64, &usize))| (r, self.row(row), self.columns[body].as_slice());
        self.residuals.iter().zip(&self.bodies).enumerate().map(row)
    }

    /// Adds the scene's loss, gradient J^T rho'(r) and Hessian J^T W J to the lower triangle, all multiplied by `share`.
    pub(super) fn add_to(&self, normal: &mut NormalEquations, share: f64) {
        let (mut row, mut gradient, mut hessian, mut reached) = (vec![], vec![], vec![], vec![]);
        let mut next = 0;
        // The rows of a body follow each other and have the same columns: their sums are dense.
        for of_body in self.bodies.chunk_by(|a, b| a == b) {
            let mut waiting = self.columns[of_body[0]].clone();
            reached.clear();
            gradient.clear();
            hessian.clear();
            for (r, j, _) in self.rows().skip(next).take(of_body.len()) {
                // Parameters of other bodies have derivatives from the first meeting on: until then rows are short.
                reached.extend(waiting.extract_if(.., |(_, lane)| j[*lane] != 0.0));
                let n = reached.len();
                gradient.resize(n, 0.0);
                hessian.resize(n * (n + 1) / 2, 0.0);
                let weight = share * weight(r);
                normal.cost += share * huber(r);
                row.clear();
                row.extend(reached.iter().map(|&(_, lane)| j[lane]));
                let mut rest = &mut hessian[..];
                for (x, slope) in row.iter().enumerate() {
                    let scaled = weight * slope;
                    gradient[x] += scaled * r;
                    let sums;
                    (sums, rest) = rest.split_at_mut(x + 1);
                    sums.iter_mut().zip(&row).for_each(|(sum, other)| *sum += scaled * other);
                }
            }
            next += of_body.len();
            let mut sums = hessian.iter();
            for (x, &(k, _)) in reached.iter().enumerate() {
                normal.gradient[k] += gradient[x];
                for (&(m, _), sum) in reached[..=x].iter().zip(&mut sums) {
                    normal.hessian[(k.max(m), k.min(m))] += sum;
                }
            }
        }
    }

    /// The residuals after a step, as the linear model predicts them: r + J step.
    pub fn predicted(&self, step: &[f64]) -> Vec<f64> {
        let (mut after, mut along) = (Vec::with_capacity(self.residuals.len()), vec![0.0; self.width]);
        for of_body in self.bodies.chunk_by(|a, b| a == b) {
            along.fill(0.0);
            self.columns[of_body[0]].iter().for_each(|&(k, lane)| along[lane] = step[k]);
            for _ in of_body {
                let row = after.len();
                let off: f64 = self.row(row).iter().zip(&along).map(|(slope, step)| slope * step).sum();
                after.push(self.residuals[row] + off);
            }
        }
        after
    }

    /// Adds J^T `factors`, one factor a row.
    pub fn add_transposed_product(&self, factors: &[f64], gradient: &mut DVector<f64>) {
        let (mut row, mut sums) = (0, vec![0.0; self.width]);
        for of_body in self.bodies.chunk_by(|a, b| a == b) {
            sums.fill(0.0);
            for factor in &factors[row..row + of_body.len()] {
                let slopes = self.row(row);
                sums.iter_mut().zip(slopes).for_each(|(sum, slope)| *sum += slope * factor);
                row += 1;
            }
            self.columns[of_body[0]].iter().for_each(|&(k, lane)| gradient[k] += sums[lane]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::noise;
    use super::super::super::tests::three_bodies;
    use super::super::FitProblem;
    use super::*;
    use crate::num::never;

    #[test]
    fn derivatives_of_single_precision_are_those_of_double() {
        let (scene, model) = three_bodies("single", 5, [1.0, 1.6, 0.7]);
        let (noise, scenes) = (noise::estimate(&scene), std::slice::from_ref(&scene));
        let mut problem = FitProblem::new(scenes, vec![model], &[noise], &never);
        let (point, frames) = (problem.start(), scene.times.len());
        let double = problem.linearize(&point, frames, None).remove(0);
        problem.set_single_precision(true);
        let single = problem.linearize(&point, frames, None).remove(0);
        assert!(double.width > LANES, "one pass is of double precision anyway");
        assert_eq!((&double.residuals, &double.columns), (&single.residuals, &single.columns));
        assert_ne!(double.jacobian, single.jacobian);
        for (double, single) in double.rows().zip(single.rows()) {
            let size = double.1.iter().fold(1.0, |a: f64, b| a.max(b.abs()));
            let off = double.1.iter().zip(single.1).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-4 * size, "{off} of {size}");
        }
    }
}
