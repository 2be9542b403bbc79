//! One scene linearised at a point: its residuals with their Jacobian, in as few passes as the meetings of its bodies allow.

use super::problem::{Coordinate, Followed, Free, HUBER, LIMITS, Normal, Part, Window, rho};
use crate::effects::Scalar;
use crate::num::{Differential, Jet, LANES, Stop, Swift};
use crate::world::{Event, Owner, Rollout, film};
use rayon::prelude::*;
use std::borrow::Cow;

/// Frames over which residuals are taken together.
const BLOCK: usize = 25;
/// What a pass with derivatives costs, in simulations without.
const JET: u64 = 5;

impl Part<'_> {
    /// With derivatives by the free parameters that are `wanted`; what it does at the point, where that is known.
    pub fn linearised(
        &self,
        free: &[Free],
        wanted: impl Fn(usize) -> bool,
        point: &[f64],
        window: Window,
        there: Option<&Followed>,
        stop: Stop,
    ) -> Linear {
        let flat = self.flat(free, point);
        let there = match there {
            Some(there) => Cow::Borrowed(there),
            None => Cow::Owned(self.simulated(free, point, window)),
        };
        let Followed { rollout, residuals } = there.as_ref();
        let residuals = residuals.clone();
        let mut bodies = Vec::with_capacity(residuals.len());
        self.each_sample(window, |m, row| bodies.resize(row + 2 + usize::from(m.yaw.is_some()), m.body));
        let components = self.components(rollout);
        let lanes = self.lanes(wanted, rollout, &components);
        // Derivatives by lane: rows x lanes.
        let width = lanes.iter().map(|l| l.number + 1).max().unwrap_or(0);
        let mut jacobian = vec![0.0; residuals.len() * width];
        // What one pass carries is as quick in double precision.
        let swift = self.swift && width > LANES;
        let firsts: Vec<usize> = (0..width).step_by(if swift { Swift::LANES } else { LANES }).collect();
        let slopes = |first: usize| match swift {
            _ if stop(0.0).is_err() => Slopes::default(),
            true => self.slopes::<Swift>(free, &flat, &lanes, first, window),
            false => self.slopes::<Jet>(free, &flat, &lanes, first, window),
        };
        let passes: Vec<Slopes> = firsts.par_iter().map(|&first| slopes(first)).collect();
        for (&first, Slopes { rows, slopes }) in firsts.iter().zip(&passes) {
            let count = slopes.len() / rows.len().max(1);
            for (row, slopes) in rows.iter().zip(slopes.chunks_exact(count.max(1))) {
                let at = row * width + first;
                jacobian[at..at + count].copy_from_slice(slopes);
            }
        }
        // Each body's rows meet only the parameters of its component and the shared ones.
        let columns: Vec<Vec<(usize, usize)>> = (0..self.model.bodies.len())
            .map(|body| {
                let relevant = lanes.iter().filter(|l| l.component.is_none_or(|c| c == components[body]));
                relevant.map(|l| (self.slots[l.slot].1, l.number)).collect()
            })
            .collect();
        Linear { residuals, bodies, jacobian, width, columns }
    }

    /// Of all residuals, one pass: their derivatives by the lanes that begin with number `first`.
    fn slopes<J: Differential + Scalar>(
        &self,
        free: &[Free],
        flat: &[f64],
        lanes: &[Lane],
        first: usize,
        window: Window,
    ) -> Slopes {
        let mut jets: Vec<J> = flat.iter().map(|&v| J::constant(v)).collect();
        let mut count = 0;
        for lane in lanes.iter().filter(|l| (first..first + J::LANES).contains(&l.number)) {
            let (slot, k) = self.slots[lane.slot];
            let slope = if free[k].log { flat[slot] } else { 1.0 };
            jets[slot] = jets[slot].with_derivative(lane.number - first, slope);
            count = count.max(lane.number - first + 1);
        }
        let run = film(&self.model, &jets, self.times(window), &LIMITS);
        // As much for a derivative in whichever precision: a search that ends for want of work ends where it would.
        self.worked(&run, JET * (J::LANES / LANES) as u64);
        let (mut rows, mut slopes) = (vec![], vec![]);
        self.each_sample(window, |m, row| {
            let Some(k) = run.states.get(m.sample.frame).and_then(|s| s[m.body].as_ref()) else { return };
            let place = |lane| m.whitener.apply(k.position.x.derivative(lane), k.position.y.derivative(lane));
            rows.extend([row, row + 1]);
            for axis in [0, 1] {
                slopes.extend((0..count).map(|lane| place(lane)[axis]));
            }
            if let Some((_, sigma)) = m.yaw {
                rows.push(row + 2);
                slopes.extend((0..count).map(|lane| k.yaw.derivative(lane) / sigma));
            }
        });
        Slopes { rows, slopes }
    }

    /// How many measurements of this part tell as much as one that is independent: residuals that go together,
    /// because the model is not quite right, say less than their number. Variance of means over a block of
    /// frames against that of independent ones, of which the fit has taken its leverage; `factor` L has the
    /// parameters' covariance L L^T.
    pub fn redundancy(&self, linear: &Linear, factor: &nalgebra::DMatrix<f64>) -> f64 {
        /// Residuals of one coordinate of a body over a few frames: their sum, number and derivative.
        struct Block {
            key: Coordinate,
            sum: f64,
            count: usize,
            slope: nalgebra::DVector<f64>,
        }
        let mut blocks: Vec<Block> = vec![];
        let mut rows = linear.rows();
        self.each_sample(self.scene.times.len(), |m, _| {
            for coordinate in 0..2 + usize::from(m.yaw.is_some()) {
                let Some((residual, j, columns)) = rows.next() else { return };
                let key = (m.body, m.sample.frame / BLOCK, coordinate);
                // The coordinates of a sample come one after the other.
                let known = blocks.iter().rposition(|b| b.key == key).filter(|at| at + 3 >= blocks.len());
                let at = known.unwrap_or_else(|| {
                    let slope = nalgebra::DVector::zeros(factor.nrows());
                    blocks.push(Block { key, sum: 0.0, count: 0, slope });
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

    /// Bodies that met, directly or through others, share a component: the smallest index among them.
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

    /// A lane for each slot that can matter; lanes are shared by slots of components that never meet, so that
    /// one pass carries several of them (column compression: Curtis, Powell and Reid, 1974).
    fn lanes(
        &self,
        wanted: impl Fn(usize) -> bool,
        rollout: &Rollout<f64>,
        components: &[usize],
    ) -> Vec<Lane> {
        let owners = self.model.owners();
        let meetings = self.meetings(rollout);
        let met = |a, b| meetings.iter().any(|&m| m == (a, b) || m == (b, a));
        let component = |s: usize| match owners[self.slots[s].0] {
            _ if !wanted(self.slots[s].1) => None,
            Owner::Body(a) => Some(Some(components[a])),
            Owner::Pair(a, b) => met(a, b).then(|| Some(components[a])),
            Owner::Shared => Some(None),
        };
        let mut lanes = vec![];
        let mut shared = 0;
        for s in 0..self.slots.len() {
            if component(s) == Some(None) {
                lanes.push(Lane { slot: s, component: None, number: shared });
                shared += 1;
            }
        }
        // Body by body: a body that no lane of a pass reaches goes without derivatives until it meets one that has some.
        let body = |slot: usize| match owners[slot] {
            Owner::Body(a) => a,
            Owner::Pair(a, b) => a.max(b),
            Owner::Shared => 0,
        };
        let mut order: Vec<usize> = (0..self.slots.len()).collect();
        order.sort_by_key(|&s| body(self.slots[s].0));
        let mut own = vec![shared; components.len()];
        for s in order {
            if let Some(Some(c)) = component(s) {
                lanes.push(Lane { slot: s, component: Some(c), number: own[c] });
                own[c] += 1;
            }
        }
        lanes
    }
}

/// Residuals of one scene with their Jacobian, compressed: of each row only what can differ from zero.
#[derive(Debug, Clone)]
pub(super) struct Linear {
    pub residuals: Vec<f64>,
    /// Body of each row.
    pub bodies: Vec<usize>,
    /// Rows x width.
    jacobian: Vec<f64>,
    width: usize,
    /// For each body, the parameters that reach it and where in the row their derivatives stand.
    columns: Vec<Vec<(usize, usize)>>,
}

impl Linear {
    /// The same with the derivatives by further parameters.
    pub fn with(self, further: &Linear) -> Linear {
        let width = self.width + further.width;
        let mut jacobian = Vec::with_capacity(self.residuals.len() * width);
        for row in 0..self.residuals.len() {
            for part in [&self, further] {
                jacobian.extend_from_slice(&part.jacobian[row * part.width..(row + 1) * part.width]);
            }
        }
        let mut columns = self.columns;
        for (columns, further) in columns.iter_mut().zip(&further.columns) {
            columns.extend(further.iter().map(|&(k, lane)| (k, self.width + lane)));
        }
        Linear { jacobian, width, columns, ..self }
    }

    fn rows(&self) -> impl Iterator<Item = (f64, &[f64], &[(usize, usize)])> {
        let row = |(row, (&r, &body)): (usize, (&f64, &usize))| {
            (r, &self.jacobian[row * self.width..(row + 1) * self.width], self.columns[body].as_slice())
        };
        self.residuals.iter().zip(&self.bodies).enumerate().map(row)
    }

    /// Adds its cost and derivatives to the normal equations, counted `share` times.
    pub fn add_to(&self, normal: &mut Normal, share: f64) {
        let (mut row, mut gradient, mut hessian, mut reached) = (vec![], vec![], vec![], vec![]);
        let mut next = 0;
        // The rows of a body follow each other and have the same columns: their sums are dense.
        for of_body in self.bodies.chunk_by(|a, b| a == b) {
            let mut waiting = self.columns[of_body[0]].clone();
            reached.clear();
            gradient.clear();
            hessian.clear();
            for (r, j, _) in self.rows().skip(next).take(of_body.len()) {
                // What others are reaches a body when it meets them: until then its rows are short.
                reached.extend(waiting.extract_if(.., |(_, lane)| j[*lane] != 0.0));
                let n = reached.len();
                gradient.resize(n, 0.0);
                hessian.resize(n * (n + 1) / 2, 0.0);
                let weight = share * if r.abs() <= HUBER { 1.0 } else { HUBER / r.abs() };
                normal.cost += share * rho(r);
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

    /// What the residuals become after a step, were they linear.
    pub fn predicted(&self, step: &[f64]) -> Vec<f64> {
        let (mut after, mut along) = (Vec::with_capacity(self.residuals.len()), vec![0.0; self.width]);
        for of_body in self.bodies.chunk_by(|a, b| a == b) {
            along.fill(0.0);
            self.columns[of_body[0]].iter().for_each(|&(k, lane)| along[lane] = step[k]);
            for _ in of_body {
                let row = after.len();
                let slopes = &self.jacobian[row * self.width..(row + 1) * self.width];
                let off: f64 = slopes.iter().zip(&along).map(|(slope, step)| slope * step).sum();
                after.push(self.residuals[row] + off);
            }
        }
        after
    }

    /// Adds the transposed Jacobian's product with `difference`.
    pub fn pull_back(&self, difference: &[f64], gradient: &mut nalgebra::DVector<f64>) {
        let (mut row, mut sums) = (0, vec![0.0; self.width]);
        for of_body in self.bodies.chunk_by(|a, b| a == b) {
            sums.fill(0.0);
            for d in &difference[row..row + of_body.len()] {
                let slopes = &self.jacobian[row * self.width..(row + 1) * self.width];
                sums.iter_mut().zip(slopes).for_each(|(sum, slope)| *sum += slope * d);
                row += 1;
            }
            self.columns[of_body[0]].iter().for_each(|&(k, lane)| gradient[k] += sums[lane]);
        }
    }
}

/// Derivatives of one pass: for each of the rows, as many.
#[derive(Default)]
struct Slopes {
    rows: Vec<usize>,
    slopes: Vec<f64>,
}

/// Where the derivative by one slot is carried.
struct Lane {
    slot: usize,
    /// The bodies it can reach; `None`: all.
    component: Option<usize>,
    number: usize,
}

#[cfg(test)]
mod tests {
    use super::super::noise;
    use super::super::problem::Problem;
    use super::super::tests::film;
    use super::*;
    use crate::num::never;

    #[test]
    fn derivatives_of_single_precision_are_those_of_double() {
        let (scene, model) = film("swift", 5, [1.0, 1.6, 0.7]);
        let (noise, scenes) = (noise::estimate(&scene), std::slice::from_ref(&scene));
        let mut problem = Problem::new(scenes, vec![model], &[noise], &never);
        let (point, frames) = (problem.start(), scene.times.len());
        let exact = problem.linearised(&point, frames, None).remove(0);
        problem.hurry(true);
        let swift = problem.linearised(&point, frames, None).remove(0);
        assert!(exact.width > LANES, "one pass is of double precision anyway");
        assert_eq!((&exact.residuals, &exact.columns), (&swift.residuals, &swift.columns));
        assert_ne!(exact.jacobian, swift.jacobian);
        for (exact, swift) in exact.rows().zip(swift.rows()) {
            let size = exact.1.iter().fold(1.0, |a: f64, b| a.max(b.abs()));
            let off = exact.1.iter().zip(swift.1).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-4 * size, "{off} of {size}");
        }
    }
}
