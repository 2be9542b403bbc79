//! What the data say about the parameters: mean, covariance, what is identified, and draws.

use super::linear::Linear;
use super::problem::{Followed, Free, Part, Problem, Window, rho};
use super::{Fit, SceneFit};
use crate::world::{BODY_VALUES, MASS, Model};
use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Draws from a posterior.
pub const DRAWS: usize = 32;
/// A draw that fits this many deviations worse than a draw from the true posterior would is pulled in.
const TOLERATED: f64 = 3.0;
/// A block that is linear costs as much as its draw says, but for round-off.
const ROUNDED: f64 = 1.001;
/// How far a draw is pulled in at once, and how often.
const SHRINK: f64 = 0.5;
const SHRINKS: usize = 6;
/// How often a draw is led back to the data before it is pulled in.
const CORRECTIONS: usize = 3;

/// They tell nothing of a parameter whose deviation they leave at this share of what was believed.
const UNTOLD: f64 = 0.95;
/// The data identify a parameter when they leave less than this share of the prior's deviation.
const IDENTIFIED: f64 = 0.5;

/// Gaussian around the best parameters (Laplace), in search space: masses as logarithms.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Posterior {
    pub estimates: Vec<Estimate>,
    /// Where they stand in search space, in the order of `estimates`.
    coordinates: Vec<Coordinate>,
    /// For each scene, index in [`Model::flatten`] and in `coordinates`.
    slots: Vec<Vec<(usize, usize)>>,
    /// Draws, as search-space values; none until they are asked for.
    draws: Vec<Vec<f64>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Coordinate {
    value: f64,
    log: bool,
    /// What was believed before.
    #[serde(default)]
    mean: f64,
}

/// The linear model of a problem at its best point.
struct Laplace {
    parts: Vec<Linear>,
    /// How much of each part is independent.
    shares: Vec<f64>,
    /// L with L L^T = the parameters' covariance.
    factor: DMatrix<f64>,
}

impl Laplace {
    fn at(problem: &Problem, point: &[f64], window: Window) -> Laplace {
        // What the search has is of a point before: where contacts are sensitive, derivatives change within a deviation.
        let parts = problem.linearised(point, window, None);
        let independent = vec![1.0; parts.len()];
        let factor = problem.weighed(point, &parts, &independent).covariance_factor();
        let share = |(part, linear): (&Part, &Linear)| 1.0 / part.redundancy(linear, &factor);
        let shares: Vec<f64> = problem.parts.iter().zip(&parts).map(share).collect();
        let factor = problem.weighed(point, &parts, &shares).covariance_factor();
        Laplace { parts, shares, factor }
    }
}

/// One fitted parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Index of the scene; `None` where scenes share it.
    pub scene: Option<usize>,
    /// `objects[3].mass`, `sliding_friction.mu[rubber]`.
    pub name: String,
    pub value: f64,
    pub sd: f64,
    pub unit: String,
    /// Whether the data, and not the prior, determine it.
    pub identified: bool,
}

/// What is known of one object of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectEstimate {
    pub id: u32,
    /// kg, or relative where the scene gives no mass.
    pub mass: Estimate,
    /// The object's factor: a contact's restitution is about the product of the two.
    pub restitution: Estimate,
}

/// One parameter that the objects of a set-up share; several values where it differs by material or pair.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedEstimate {
    pub effect: String,
    pub parameter: String,
    /// What each value applies to; one empty label where there is one value.
    pub labels: Vec<String>,
    pub values: Vec<Estimate>,
}

impl Posterior {
    /// The parameter of that full name, if the data tell of it: else it repeats what was `believed` (a deviation).
    pub fn told(&self, name: &str, believed: f64) -> Option<&Estimate> {
        self.estimates.iter().find(|e| e.name == name && e.sd < UNTOLD * believed)
    }

    pub(super) fn at(problem: &Problem, point: &[f64], window: Window) -> Posterior {
        let Laplace { factor, .. } = Laplace::at(problem, point, window);
        let estimate = |(k, f): (usize, &Free)| {
            let sd = factor.row(k).norm();
            let value = if f.log { point[k].exp() } else { point[k] };
            Estimate {
                scene: f.scene,
                name: f.name.clone(),
                value,
                sd: if f.log { value * sd } else { sd },
                unit: f.unit.to_string(),
                identified: sd < IDENTIFIED * f.sd,
            }
        };
        let coordinate = |(f, &value): (&Free, &f64)| Coordinate { value, log: f.log, mean: f.mean };
        Posterior {
            estimates: problem.free.iter().enumerate().map(estimate).collect(),
            coordinates: problem.free.iter().zip(point).map(coordinate).collect(),
            slots: problem.parts.iter().map(|p| p.slots.clone()).collect(),
            draws: vec![],
        }
    }

    /// With draws; the problem stands where this posterior is of.
    pub(super) fn drawn(self, problem: &mut Problem, window: Window) -> Posterior {
        let mut point = problem.start();
        // What was believed is the posterior's, where the problem begins at its best point.
        for ((f, c), x) in problem.free.iter_mut().zip(&self.coordinates).zip(&mut point) {
            f.mean = c.mean;
            *x = c.value;
        }
        Posterior { draws: draws(problem, &point, &Laplace::at(problem, &point, window), window), ..self }
    }

    /// The part that one scene sees.
    fn of_scene(&self, scene: usize) -> Posterior {
        let seen = |k: &usize| self.estimates[*k].scene.is_none_or(|s| s == scene);
        let kept: Vec<usize> = (0..self.estimates.len()).filter(seen).collect();
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
            draws: self.draws.iter().map(|d| kept.iter().map(|&k| d[k]).collect()).collect(),
        }
    }

    fn named(&self, scene: usize, name: &str) -> Option<&Estimate> {
        self.estimates.iter().find(|e| e.name == name && e.scene.is_none_or(|s| s == scene))
    }

    /// The model of a scene at stored draw `draw`.
    fn model(&self, scene: usize, model: &Model, draw: usize) -> Model {
        let mut flat = model.flatten();
        for &(slot, k) in &self.slots[scene] {
            let value = self.draws[draw][k];
            flat[slot] = if self.coordinates[k].log { value.exp() } else { value };
        }
        model.with_values(&flat)
    }
}

/// Draws from the Gaussian around `point`, bent to the data: through contacts the cost is not the parabola that
/// Laplace's approximation takes it for, so a draw whose residuals are not those of the linear model is led
/// back by Gauss-Newton steps with the derivatives at `point`, and pulled in where that is not enough. What is independent
/// of it stays as it was drawn.
fn draws(problem: &Problem, point: &[f64], laplace: &Laplace, window: Window) -> Vec<Vec<f64>> {
    let Laplace { parts, shares, factor } = laplace;
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let n = point.len();
    let blocks = Blocks::new(problem, factor);
    let residuals: Vec<Vec<f64>> = parts.iter().map(|p| p.residuals.clone()).collect();
    let best = blocks.costs(problem, point, &residuals, parts, shares);
    let unit: Vec<DVector<f64>> = (0..DRAWS)
        .map(|_| DVector::from_iterator(n, (0..n).map(|_| StandardNormal.sample(&mut random))))
        .collect();
    let draw = |z: DVector<f64>| {
        let worst = blocks.worst(&z);
        let shift: DVector<f64> = factor * z;
        let mut share = vec![1.0; best.len()];
        let mut bad = vec![true; best.len()];
        for _ in 0..SHRINKS {
            if (problem.stop)(0.0).is_err() {
                break;
            }
            let step = DVector::from_iterator(n, (0..n).map(|k| shift[k] * share[blocks.of[k]]));
            let mut wanted = None;
            let mut drawn = problem.moved(point, |k| step[k]);
            bad.fill(true);
            for _ in 0..CORRECTIONS {
                let Some(found) = Found::at(problem, &drawn, window) else { break };
                let costs = blocks.costs(problem, &drawn, &found.residuals, parts, shares);
                // Not a number is too much, too.
                let little = |block: usize| costs[block] - best[block] <= worst[block];
                (0..bad.len()).for_each(|block| bad[block] = !little(block));
                blocks.pass_on(&found.components, &mut bad);
                if !bad.contains(&true) {
                    return drawn;
                }
                let predicted = || parts.iter().map(|p| p.predicted(step.as_slice())).collect();
                let wanted: &Vec<Vec<f64>> = wanted.get_or_insert_with(predicted);
                let mut gradient = DVector::zeros(n);
                for (((part, found), wanted), share) in
                    parts.iter().zip(&found.residuals).zip(wanted).zip(shares)
                {
                    let off: Vec<f64> = found.iter().zip(wanted).map(|(f, w)| share * (f - w)).collect();
                    part.pull_back(&off, &mut gradient);
                }
                let back = factor * factor.tr_mul(&gradient);
                drawn = problem.moved(&drawn, |k| if bad[blocks.of[k]] { -back[k] } else { 0.0 });
            }
            share.iter_mut().zip(&bad).filter(|(_, bad)| **bad).for_each(|(share, _)| *share *= SHRINK);
        }
        problem.moved(point, |k| if bad[blocks.of[k]] { 0.0 } else { shift[k] * share[blocks.of[k]] })
    };
    unit.into_par_iter().map(draw).collect()
}

/// What a draw does: residuals of each part, and which bodies met ([`Part::components`]).
struct Found {
    residuals: Vec<Vec<f64>>,
    components: Vec<Vec<usize>>,
}

impl Found {
    fn at(problem: &Problem, point: &[f64], window: Window) -> Option<Found> {
        let (mut all, mut components) = (vec![], vec![]);
        for part in &problem.parts {
            let Followed { rollout, residuals } = part.followed(&problem.free, point, window)?;
            components.push(part.components(&rollout));
            all.push(residuals);
        }
        Some(Found { residuals: all, components })
    }
}

/// Parameters in blocks that are independent of each other, and the bodies whose tracks tell of them.
struct Blocks {
    /// The block of each parameter.
    of: Vec<usize>,
    /// The block of each body, part by part.
    bodies: Vec<Vec<usize>>,
    /// How many parameters each block has.
    sizes: Vec<usize>,
}

impl Blocks {
    /// `factor` L has the parameters' covariance L L^T.
    fn new(problem: &Problem, factor: &DMatrix<f64>) -> Blocks {
        let n = problem.free.len();
        let mut of: Vec<usize> = (0..n).collect();
        for (a, b) in (0..n).flat_map(|a| (0..a).map(move |b| (a, b))) {
            if factor[(a, b)] != 0.0 && of[a] != of[b] {
                let (low, high) = (of[a].min(of[b]), of[a].max(of[b]));
                of.iter_mut().filter(|block| **block == high).for_each(|block| *block = low);
            }
        }
        // All that moves a body is in one block with its place.
        let place = |part: &Part, body: usize| {
            let slot = part.slots.iter().find(|s| s.0 == body * BODY_VALUES.len());
            slot.map_or(0, |&(_, k)| of[k])
        };
        let bodies = |part: &Part| (0..part.model.bodies.len()).map(|body| place(part, body)).collect();
        let bodies = problem.parts.iter().map(bodies).collect();
        let mut sizes = vec![0; n];
        of.iter().for_each(|&block| sizes[block] += 1);
        Blocks { of, bodies, sizes }
    }

    /// The cost of each block, each part counted by its share.
    fn costs(
        &self,
        problem: &Problem,
        point: &[f64],
        residuals: &[Vec<f64>],
        parts: &[Linear],
        shares: &[f64],
    ) -> Vec<f64> {
        let mut costs = vec![0.0; self.sizes.len()];
        for ((f, x), &block) in problem.free.iter().zip(point).zip(&self.of) {
            costs[block] += f.prior_cost(*x);
        }
        for (((residuals, linear), bodies), share) in
            residuals.iter().zip(parts).zip(&self.bodies).zip(shares)
        {
            for (&r, &body) in residuals.iter().zip(&linear.bodies) {
                costs[bodies[body]] += share * rho(r);
            }
        }
        costs
    }

    /// Bodies that meet answer for each other: one may be pushed from its track though nothing of its own is wrong. So may what no
    /// track tells of at the best point answer for any of them.
    fn pass_on(&self, components: &[Vec<usize>], bad: &mut [bool]) {
        for (components, bodies) in components.iter().zip(&self.bodies) {
            for component in 0..components.len() {
                let of_component = || components.iter().zip(bodies).filter(|(c, _)| **c == component);
                if of_component().any(|(_, &block)| bad[block]) {
                    of_component().for_each(|(_, &block)| bad[block] = true);
                }
            }
        }
        if bad.contains(&true) {
            let told = |block: usize| self.bodies.iter().flatten().any(|&of_body| of_body == block);
            (0..bad.len()).for_each(|block| bad[block] |= !told(block));
        }
    }

    /// How much more each block of a draw `z` of unit normal numbers may cost.
    fn worst(&self, z: &DVector<f64>) -> Vec<f64> {
        let mut squares = vec![0.0; self.sizes.len()];
        z.iter().zip(&self.of).for_each(|(z, &block)| squares[block] += z * z);
        let worst = |(&size, squares): (&usize, f64)| {
            let size = size as f64;
            0.5 * f64::max(size + TOLERATED * (2.0 * size).sqrt(), ROUNDED * squares)
        };
        self.sizes.iter().zip(squares).map(worst).collect()
    }
}

impl Fit {
    /// The models with the numbers found, one a scene.
    pub fn models(&self) -> Vec<Model> {
        self.scenes.iter().map(|s| s.model.clone()).collect()
    }

    /// What the fit says of one of its scenes alone.
    pub fn of_scene(&self, scene: usize) -> Fit {
        Fit {
            scenes: self.scenes.get(scene).cloned().into_iter().collect(),
            posterior: self.posterior.of_scene(scene),
            iterations: self.iterations,
            outcome: self.outcome,
            losses: self.losses.clone(),
        }
    }

    /// How many draws the fit has.
    pub fn draws(&self) -> usize {
        self.posterior.draws.len()
    }

    /// Models of one scene drawn from the posterior; the seed picks among the [`DRAWS`] that [`drawn`](super::drawn)
    /// made; none where it was not called.
    pub fn draw(&self, scene: usize, count: usize, seed: u64) -> Vec<Model> {
        let model = &self.scenes[scene].model;
        let kept = self.posterior.draws.len();
        let pick =
            |i: usize| self.posterior.model(scene, model, (i + (seed % kept.max(1) as u64) as usize) % kept);
        if kept == 0 { vec![] } else { (0..count.min(kept)).map(pick).collect() }
    }

    /// Mass and restitution of each object of a scene, in the scene's order.
    pub fn objects(&self, scene: usize) -> Vec<ObjectEstimate> {
        let SceneFit { model, .. } = &self.scenes[scene];
        let flat = model.flatten();
        let one = |(b, body): (usize, &crate::world::BodySpec)| {
            let name = format!("objects[{}].mass", body.id);
            let given = Estimate {
                scene: Some(scene),
                name: name.clone(),
                value: flat[b * BODY_VALUES.len() + MASS],
                sd: 0.0,
                unit: "kg".into(),
                identified: true,
            };
            let mass = self.posterior.named(scene, &name).cloned().unwrap_or(given);
            ObjectEstimate { id: body.id, mass, restitution: self.restitution(scene, body.id) }
        };
        model.bodies.iter().enumerate().map(one).collect()
    }

    /// The factor of one object: its own where the model has one, else the root of what its contacts show.
    fn restitution(&self, scene: usize, id: u32) -> Estimate {
        let name = format!("objects[{id}].restitution");
        if let Some(own) = self.posterior.named(scene, &format!("restitution.object[{id}]")) {
            return Estimate { name, ..own.clone() };
        }
        let touches = |label: &str| label.split('-').any(|part| part == id.to_string());
        let shared = self.shared(scene);
        let coefficient = shared.iter().find(|s| s.effect == "restitution" && s.parameter == "coefficient");
        let best =
            coefficient.into_iter().flat_map(|s| s.labels.iter().zip(&s.values)).filter(|(label, _)| {
                label.is_empty() || !label.contains(|c: char| c.is_ascii_digit()) || touches(label)
            });
        let best = best.min_by(|a, b| a.1.sd.total_cmp(&b.1.sd)).map(|(_, e)| e.clone());
        let e = best.unwrap_or(Estimate {
            scene: Some(scene),
            name: String::new(),
            value: 0.0,
            sd: 0.0,
            unit: "1".into(),
            identified: false,
        });
        let root = e.value.max(0.0).sqrt();
        Estimate { scene: Some(scene), name, value: root, sd: e.sd / (2.0 * root.max(0.1)), ..e }
    }

    /// Parameters of the effects as they apply to a scene.
    pub fn shared(&self, scene: usize) -> Vec<SharedEstimate> {
        let model = &self.scenes[scene].model;
        let mut all = vec![];
        for active in model.effects.iter().filter(|e| e.on) {
            for (k, parameter) in active.parameters.iter().enumerate() {
                let unit = active.bounds(k).map_or("1", |b| b.0);
                let value = |(label, value): (&String, &f64)| {
                    let name = parameter.full_name(active, label);
                    let fixed = Estimate {
                        scene: None,
                        name: name.clone(),
                        value: *value,
                        sd: 0.0,
                        unit: unit.to_string(),
                        identified: false,
                    };
                    self.posterior.named(scene, &name).cloned().unwrap_or(fixed)
                };
                all.push(SharedEstimate {
                    effect: active.name.clone(),
                    parameter: parameter.name.clone(),
                    labels: parameter.labels.clone(),
                    values: parameter.labels.iter().zip(&parameter.values).map(value).collect(),
                });
            }
        }
        all
    }
}
