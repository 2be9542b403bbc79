//! Draws from the posterior that agree with the data.
//!
//! Parameters fall into blocks that are independent in the covariance. For each draw z:
//!
//! 1. the point x* + L z is simulated; a block is accepted if its cost exceeds that at x* by at most half of
//!    max(n + 3 sqrt(2 n), 1.001 |z|^2), n its parameters: three standard deviations of chi-square, or what the draw itself says;
//! 2. other blocks, and those of bodies that met theirs, are led towards the residuals r + J L z of the linear model by at most
//!    three Gauss-Newton steps with the derivatives at x*;
//! 3. if that is not enough, their share of L z is halved and the block starts again from 1., at most six times; then it stays at x*.

use super::super::problem::{FitProblem, Horizon, LinearizedScene, SceneProblem, SimulatedScene, huber};
use super::laplace::{Laplace, Posterior};
use crate::num::standard_normal;
use crate::world::BODY_VALUES;
use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

/// Draws from a posterior.
pub const DRAWS: usize = 32;
/// Standard deviations of chi-square by which a block may fit worse than expected.
const TOLERATED: f64 = 3.0;
/// A linear block costs exactly what its draw says, but for round-off.
const ROUND_OFF: f64 = 1.001;
/// Factor by which a draw is shrunk at a time, and how often.
const SHRINK: f64 = 0.5;
const SHRINKS: usize = 6;
/// Gauss-Newton steps of a draw before it is shrunk.
const CORRECTIONS: usize = 3;

/// The posterior with [`DRAWS`] draws; the problem's models are those of its best point.
pub(in super::super) fn sample(
    posterior: Posterior,
    problem: &mut FitProblem,
    horizon: Horizon,
) -> Posterior {
    let mut point = problem.start();
    // The priors are the posterior's: the problem was made of models at the best point.
    for ((p, c), x) in problem.parameters.iter_mut().zip(&posterior.coordinates).zip(&mut point) {
        p.mean = c.mean;
        *x = c.value;
    }
    let laplace = Laplace::at(problem, &point, horizon);
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let n = point.len();
    let unit: Vec<DVector<f64>> =
        (0..DRAWS).map(|_| DVector::from_iterator(n, (0..n).map(|_| standard_normal(&mut random)))).collect();
    let blocks = IndependentBlocks::new(problem, &laplace.factor);
    let residuals: Vec<Vec<f64>> = laplace.scenes.iter().map(|s| s.residuals.clone()).collect();
    let costs = blocks.costs(problem, &point, &residuals, &laplace);
    let sampler = Sampler { problem, horizon, point: &point, laplace: &laplace, blocks, costs };
    Posterior { draws: unit.into_par_iter().map(|z| sampler.draw(&z)).collect(), ..posterior }
}

struct Sampler<'p, 'a> {
    problem: &'p FitProblem<'a>,
    horizon: Horizon,
    point: &'p [f64],
    laplace: &'p Laplace,
    blocks: IndependentBlocks,
    /// The cost of each block at the best point.
    costs: Vec<f64>,
}

impl Sampler<'_, '_> {
    /// The draw of the unit normal numbers `z`.
    fn draw(&self, z: &DVector<f64>) -> Vec<f64> {
        let Sampler { problem, blocks, .. } = self;
        let tolerated = blocks.tolerated(z);
        let shift: DVector<f64> = &self.laplace.factor * z;
        let n = shift.len();
        let mut share = vec![1.0; self.costs.len()];
        let mut bad = vec![true; self.costs.len()];
        for _ in 0..SHRINKS {
            if (problem.stop)(0.0).is_err() {
                break;
            }
            let step = DVector::from_iterator(n, (0..n).map(|k| shift[k] * share[blocks.of[k]]));
            let mut target = None;
            let mut drawn = problem.stepped(self.point, |k| step[k]);
            bad.fill(true);
            for _ in 0..CORRECTIONS {
                let Some(found) = SimulatedDraw::at(problem, &drawn, self.horizon) else { break };
                let costs = blocks.costs(problem, &drawn, &found.residuals, self.laplace);
                // A cost that is not a number is not accepted.
                let accepted = |block: usize| costs[block] - self.costs[block] <= tolerated[block];
                (0..bad.len()).for_each(|block| bad[block] = !accepted(block));
                blocks.extend_to_meetings(&found.components, &mut bad);
                if !bad.contains(&true) {
                    return drawn;
                }
                let predicted = || self.laplace.scenes.iter().map(|s| s.predicted(step.as_slice())).collect();
                let target: &Vec<Vec<f64>> = target.get_or_insert_with(predicted);
                let back = self.correction(&found.residuals, target);
                drawn = problem.stepped(&drawn, |k| if bad[blocks.of[k]] { -back[k] } else { 0.0 });
            }
            share.iter_mut().zip(&bad).filter(|(_, bad)| **bad).for_each(|(share, _)| *share *= SHRINK);
        }
        problem.stepped(self.point, |k| if bad[blocks.of[k]] { 0.0 } else { shift[k] * share[blocks.of[k]] })
    }

    /// The Gauss-Newton step from residuals to those of the target, with the derivatives at the best point.
    fn correction(&self, residuals: &[Vec<f64>], target: &[Vec<f64>]) -> DVector<f64> {
        let Laplace { scenes, shares, factor, .. } = self.laplace;
        let mut gradient = DVector::zeros(factor.nrows());
        for (((scene, found), wanted), share) in scenes.iter().zip(residuals).zip(target).zip(shares) {
            let off: Vec<f64> = found.iter().zip(wanted).map(|(f, w)| share * (f - w)).collect();
            scene.add_transposed_product(&off, &mut gradient);
        }
        factor * factor.tr_mul(&gradient)
    }
}

/// The simulation of a draw: residuals of each scene, and which bodies met ([`SceneProblem::components`]).
struct SimulatedDraw {
    residuals: Vec<Vec<f64>>,
    components: Vec<Vec<usize>>,
}

impl SimulatedDraw {
    fn at(problem: &FitProblem, point: &[f64], horizon: Horizon) -> Option<SimulatedDraw> {
        let (mut all, mut components) = (vec![], vec![]);
        for scene in &problem.scenes {
            let found = scene.simulate_completely(&problem.parameters, point, horizon)?;
            let SimulatedScene { rollout, residuals } = found;
            components.push(scene.components(&rollout));
            all.push(residuals);
        }
        Some(SimulatedDraw { residuals: all, components })
    }
}

/// Parameters in blocks that are independent of each other, and the bodies whose tracks inform them.
struct IndependentBlocks {
    /// The block of each parameter.
    of: Vec<usize>,
    /// The block of each body, scene by scene.
    bodies: Vec<Vec<usize>>,
    /// How many parameters each block has.
    sizes: Vec<usize>,
}

impl IndependentBlocks {
    /// `factor` L has the parameters' covariance L L^T.
    fn new(problem: &FitProblem, factor: &DMatrix<f64>) -> IndependentBlocks {
        let n = problem.parameters.len();
        let mut of: Vec<usize> = (0..n).collect();
        for (a, b) in (0..n).flat_map(|a| (0..a).map(move |b| (a, b))) {
            if factor[(a, b)] != 0.0 && of[a] != of[b] {
                let (low, high) = (of[a].min(of[b]), of[a].max(of[b]));
                of.iter_mut().filter(|block| **block == high).for_each(|block| *block = low);
            }
        }
        // All parameters that move a body are in one block with its position.
        let block = |scene: &SceneProblem, body: usize| {
            scene.parameter_at(body * BODY_VALUES.len()).map_or(0, |k| of[k])
        };
        let bodies =
            |scene: &SceneProblem| (0..scene.model.bodies.len()).map(|body| block(scene, body)).collect();
        let bodies = problem.scenes.iter().map(bodies).collect();
        let mut sizes = vec![0; n];
        of.iter().for_each(|&block| sizes[block] += 1);
        IndependentBlocks { of, bodies, sizes }
    }

    /// The cost of each block, each scene multiplied by its share.
    fn costs(
        &self,
        problem: &FitProblem,
        point: &[f64],
        residuals: &[Vec<f64>],
        laplace: &Laplace,
    ) -> Vec<f64> {
        let mut costs = vec![0.0; self.sizes.len()];
        for ((p, x), &block) in problem.parameters.iter().zip(point).zip(&self.of) {
            costs[block] += p.prior_cost(*x);
        }
        let scenes = residuals.iter().zip(&laplace.scenes).zip(&self.bodies).zip(&laplace.shares);
        for (((residuals, linear), bodies), share) in scenes {
            let LinearizedScene { bodies: rows, .. } = linear;
            for (&r, &body) in residuals.iter().zip(rows) {
                costs[bodies[body]] += share * huber(r);
            }
        }
        costs
    }

    /// Marks the blocks of bodies that met a body of a bad block: one may be pushed from its track by the other's error. So may
    /// parameters that no track informs at the best point.
    fn extend_to_meetings(&self, components: &[Vec<usize>], bad: &mut [bool]) {
        for (components, bodies) in components.iter().zip(&self.bodies) {
            for component in 0..components.len() {
                let of_component = || components.iter().zip(bodies).filter(|(c, _)| **c == component);
                if of_component().any(|(_, &block)| bad[block]) {
                    of_component().for_each(|(_, &block)| bad[block] = true);
                }
            }
        }
        if bad.contains(&true) {
            let is_informed = |block: usize| self.bodies.iter().flatten().any(|&of_body| of_body == block);
            (0..bad.len()).for_each(|block| bad[block] |= !is_informed(block));
        }
    }

    /// How much more than at the best point each block of a draw `z` may cost.
    fn tolerated(&self, z: &DVector<f64>) -> Vec<f64> {
        let mut squares = vec![0.0; self.sizes.len()];
        z.iter().zip(&self.of).for_each(|(z, &block)| squares[block] += z * z);
        let tolerated = |(&size, squares): (&usize, f64)| {
            let size = size as f64;
            0.5 * f64::max(size + TOLERATED * (2.0 * size).sqrt(), ROUND_OFF * squares)
        };
        self.sizes.iter().zip(squares).map(tolerated).collect()
    }
}
