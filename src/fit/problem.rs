//! The fit as a least-squares problem: free parameters, whitened residuals, their Jacobian.

use super::linear::Linear;
use super::noise::{Noise, Whitener};
use super::solve::{NEAR, NEGLIGIBLE};
use crate::effects::{Hook, effect};
use crate::num::{Stop, wrapped};
use crate::scene::{Sample, Scene};
use crate::world::{BODY_VALUES, BodySpec, Ending, Limits, MASS, MASS_BOUNDS, Model, Rollout, SPINS, film};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Residuals beyond this many deviations count linearly (Huber), so that a wrong track cannot pull the fit.
pub(super) const HUBER: f64 = 5.0;

/// A video needs far fewer events; a trial point that wants more is not worth its time.
pub(super) const LIMITS: Limits = Limits { events: 3_000 };

/// Effects on a foot that slides as a whole, which no ball has.
const OF_FEET: [&str; 1] = ["friction_offset"];

/// A force whose parameter has a prior deviation of no more than this share of its mean is held until the motion is right: it
/// would take a part of every pass with derivatives, and hardly move.
const KNOWN: f64 = 0.1;

/// Steps of all simulations of one search, for each video: some twenty times what a video of ten colliding objects takes.
/// What needs more is ended where it stands: nothing searches for ever. A short one has its share, by the frame.
const WORK: u64 = 400_000;
const WORK_BY_FRAME: u64 = 3_200;

/// One free parameter of the fit, in the space in which it is searched.
#[derive(Debug, Clone)]
pub(super) struct Free {
    /// The scene it belongs to; `None` where scenes share it.
    pub scene: Option<usize>,
    pub name: String,
    pub unit: String,
    /// Masses are searched as logarithms.
    pub log: bool,
    pub min: f64,
    pub max: f64,
    /// Prior mean and deviation, in search space; an infinite deviation is no prior.
    pub mean: f64,
    pub sd: f64,
    /// Whether it stays where it is for now.
    pub held: bool,
}

impl Free {
    /// What the prior says against a value.
    pub fn prior_cost(&self, x: f64) -> f64 {
        0.5 * ((x - self.mean) / self.sd).powi(2)
    }
}

/// One scene's part: its measurements and where each free parameter enters its model.
pub(super) struct Part<'a> {
    pub scene: &'a Scene,
    pub model: Model,
    pub noise: Noise,
    base: Vec<f64>,
    /// Steps that were simulated.
    work: AtomicU64,
    /// Index in [`Model::flatten`] and the free parameter that stands there.
    pub slots: Vec<(usize, usize)>,
    /// Whether its derivatives are of single precision.
    pub swift: bool,
}

pub(super) struct Problem<'a> {
    /// Steps that the search may take before it must go on with something else, or end.
    allowed: AtomicU64,
    /// Polled between passes of one linearisation; what a stopped one gives is never used.
    pub stop: Stop<'a>,
    pub parts: Vec<Part<'a>>,
    pub free: Vec<Free>,
}

/// Normal equations at one point: half the cost's gradient and Gauss-Newton Hessian.
pub(super) struct Normal {
    pub cost: f64,
    pub gradient: DVector<f64>,
    pub hessian: DMatrix<f64>,
}

impl Normal {
    /// L with L L^T = H^-1, lower triangular; H is regularised where the data and priors leave it singular.
    pub fn covariance_factor(self) -> DMatrix<f64> {
        let Normal { hessian, .. } = self;
        let n = hessian.nrows();
        // Scale to a unit diagonal first: states and masses differ by orders of magnitude.
        let scale = DVector::from_iterator(n, (0..n).map(|k| 1.0 / hessian[(k, k)].max(1e-300).sqrt()));
        let mut unit = hessian;
        for i in 0..n {
            for j in 0..n {
                unit[(i, j)] *= scale[i] * scale[j];
            }
        }
        let mut ridge = 0.0;
        let inverse = loop {
            let mut trial = unit.clone();
            for k in 0..n {
                trial[(k, k)] += ridge;
            }
            if let Some(c) = trial.cholesky() {
                break c.inverse();
            }
            ridge = if ridge == 0.0 { 1e-12 } else { ridge * 100.0 };
            if ridge > 1.0 {
                break DMatrix::identity(n, n);
            }
        };
        let mut covariance = inverse;
        for i in 0..n {
            for j in 0..n {
                covariance[(i, j)] *= scale[i] * scale[j];
            }
        }
        let diagonal = covariance.diagonal();
        match covariance.cholesky() {
            Some(c) => c.unpack(),
            None => DMatrix::from_diagonal(&diagonal.map(|v| v.max(0.0).sqrt())),
        }
    }
}

/// Which frames count: those before this index.
pub(super) type Window = usize;

impl<'a> Problem<'a> {
    pub fn new(scenes: &'a [Scene], models: Vec<Model>, noises: &[Noise], stop: Stop<'a>) -> Self {
        let mut free: Vec<Free> = vec![];
        let mut parts = vec![];
        for (index, ((scene, model), noise)) in scenes.iter().zip(models).zip(noises).enumerate() {
            let mut slots = vec![];
            let width = BODY_VALUES.len();
            for (b, (body, object)) in model.bodies.iter().zip(&scene.objects).enumerate() {
                let moves = body.start.state.velocity.norm() > 0.0 || body.start.state.spin != 0.0;
                let yaw = scene.tracks[b].samples.iter().any(|s| s.yaw.is_some());
                let ball = body.shape.is_ball();
                let spun = moves && ball && model.spin_sd > 0.0;
                let wanted = [
                    (0, "m", true),
                    (1, "m", true),
                    (2, "rad", if body.shape.is_round() { yaw && !ball } else { true }),
                    (3, "m/s", moves),
                    (4, "m/s", moves),
                    (5, "rad/s", spun || (moves && !ball)),
                    (6, "rad/s", spun),
                    (7, "rad/s", spun),
                ];
                let start = [
                    body.start.state.position.x,
                    body.start.state.position.y,
                    body.start.state.yaw,
                    body.start.state.velocity.x,
                    body.start.state.velocity.y,
                    body.start.state.spin,
                    body.start.state.roll.x,
                    body.start.state.roll.y,
                ];
                // Wide, so that a direction without data (the yaw of a square that nobody measured) stays finite.
                let wide = [100.0 * noise.position, 100.0 * noise.position, 1.0, 10.0, 10.0, 3.0, 3.0, 3.0];
                let spin_sd = model.spin_sd / body.shape.bounding_radius();
                for (value, unit, free_here) in wanted {
                    if free_here {
                        slots.push((b * width + value, free.len()));
                        free.push(Free {
                            scene: Some(index),
                            name: format!("objects[{}].{}", body.id, BODY_VALUES[value]),
                            unit: unit.into(),
                            log: false,
                            min: f64::NEG_INFINITY,
                            max: f64::INFINITY,
                            mean: if value == 5 { 0.0 } else { start[value] },
                            sd: if spun && SPINS.contains(&value) { spin_sd } else { wide[value] },
                            held: false,
                        });
                    }
                }
                if object.mass.is_none() {
                    slots.push((b * width + MASS, free.len()));
                    free.push(Free {
                        scene: Some(index),
                        name: format!("objects[{}].mass", body.id),
                        unit: "1".into(),
                        log: true,
                        min: MASS_BOUNDS[0].ln(),
                        max: MASS_BOUNDS[1].ln(),
                        mean: 0.0,
                        sd: model.mass_sd,
                        held: false,
                    });
                }
            }
            let mut at = width * model.bodies.len();
            for active in &model.effects {
                let uses = |hook| effect(&active.name).is_some_and(|e| e.uses(hook));
                // Where outlines touch tells little before it is known which do: until then it only opens wrong ways.
                let (of_details, is_force) = (uses(Hook::Margin), uses(Hook::Force));
                for (k, parameter) in active.parameters.iter().enumerate() {
                    let bounds = active.bounds(k);
                    for (label, mean) in parameter.labels.iter().zip(&parameter.means) {
                        let shared = active.shares(parameter);
                        let name = parameter.full_name(active, label);
                        let named = |b: &BodySpec| b.id.to_string() == *label || b.shape.word() == label;
                        let of_ball = || model.bodies.iter().any(|b| b.shape.is_ball() && named(b));
                        let idle = OF_FEET.contains(&active.name.as_str()) && of_ball();
                        if parameter.prior.sd > 0.0 && active.on && !idle {
                            let known =
                                free.iter().position(|f| shared && f.scene.is_none() && f.name == name);
                            slots.push((at, known.unwrap_or(free.len())));
                            if known.is_none() {
                                free.push(Free {
                                    scene: (!shared).then_some(index),
                                    name,
                                    unit: bounds.map_or("1", |b| b.0).into(),
                                    log: false,
                                    min: bounds.map_or(f64::NEG_INFINITY, |b| b.1),
                                    max: bounds.map_or(f64::INFINITY, |b| b.2),
                                    mean: *mean,
                                    sd: parameter.prior.sd,
                                    held: of_details
                                        || (is_force && parameter.prior.sd <= KNOWN * mean.abs()),
                                });
                            }
                        }
                        at += 1;
                    }
                }
            }
            let base = model.flatten();
            let work = AtomicU64::default();
            parts.push(Part { scene, model, noise: *noise, base, slots, work, swift: false });
        }
        Problem { allowed: AtomicU64::new(most(&parts)), stop, parts, free }
    }

    /// The same parameters and models with other measurements of the same objects.
    pub fn with_scenes<'b>(&'b self, scenes: &'b [Scene]) -> Problem<'b> {
        let part = |(p, scene): (&Part, &'b Scene)| Part {
            scene,
            model: p.model.clone(),
            noise: p.noise,
            base: p.base.clone(),
            work: AtomicU64::default(),
            slots: p.slots.clone(),
            swift: p.swift,
        };
        let parts: Vec<Part> = self.parts.iter().zip(scenes).map(part).collect();
        Problem { allowed: AtomicU64::new(most(&parts)), stop: self.stop, parts, free: self.free.clone() }
    }

    /// Whether derivatives are of single precision from now on.
    pub fn hurry(&mut self, swift: bool) {
        self.parts.iter_mut().for_each(|part| part.swift = swift);
    }

    /// Frees what was held for now; which parameters were.
    pub fn release(&mut self) -> Vec<bool> {
        self.free.iter_mut().map(|f| std::mem::take(&mut f.held)).collect()
    }

    /// A fall of the cost that is not worth another step; while something is held, the search goes on anyway.
    pub fn negligible(&self) -> f64 {
        if self.free.iter().any(|f| f.held) { NEAR } else { NEGLIGIBLE }
    }

    /// A point a step away, within the bounds; what is held stays.
    pub fn moved(&self, from: &[f64], step: impl Fn(usize) -> f64) -> Vec<f64> {
        let moved = |(k, f): (usize, &Free)| match f.held {
            true => from[k],
            false => (from[k] + step(k)).clamp(f.min, f.max),
        };
        self.free.iter().enumerate().map(moved).collect()
    }

    /// Where the search starts: the values of the models.
    pub fn start(&self) -> Vec<f64> {
        self.point_of(self.parts.iter().map(|part| &part.base[..]))
    }

    /// Where other models of the parts stand.
    pub fn at(&self, models: &[Model]) -> Vec<f64> {
        let flat: Vec<Vec<f64>> = models.iter().map(Model::flatten).collect();
        self.point_of(flat.iter().map(|flat| &flat[..]))
    }

    fn point_of<'f>(&self, flat: impl Iterator<Item = &'f [f64]>) -> Vec<f64> {
        let mut point: Vec<f64> = self.free.iter().map(|f| f.mean).collect();
        for (part, flat) in self.parts.iter().zip(flat) {
            for &(slot, k) in &part.slots {
                point[k] = if self.free[k].log { flat[slot].ln() } else { flat[slot] };
            }
        }
        point
    }

    /// Whether the search has worked as much as it may for now.
    pub fn is_exhausted(&self) -> bool {
        let done: u64 = self.parts.iter().map(|p| p.work.load(Ordering::Relaxed)).sum();
        done > self.allowed.load(Ordering::Relaxed)
    }

    /// Lets the search work up to this share of all that it may.
    pub fn allow(&self, share: f64) {
        self.allowed.store((share * most(&self.parts) as f64) as u64, Ordering::Relaxed);
    }

    /// Half the sum of squared residuals, priors included.
    pub fn cost(&self, point: &[f64], window: Window) -> f64 {
        self.followed(point, window).map_or(f64::INFINITY, |parts| self.cost_of(point, &parts))
    }

    /// The same where it is known what the parts do.
    pub fn cost_of(&self, point: &[f64], parts: &[Followed]) -> f64 {
        let misfit = |part: &Followed| part.residuals.iter().map(|&r| rho(r)).sum::<f64>();
        let cost = self.prior_cost(point) + parts.iter().map(misfit).sum::<f64>();
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// What each part does; `None` where a simulation does not come to its end.
    pub fn followed(&self, point: &[f64], window: Window) -> Option<Vec<Followed>> {
        self.of_parts(|_, part| part.followed(&self.free, point, window)).into_iter().collect()
    }

    /// One result a part, in order; several parts at once.
    fn of_parts<R: Send>(&self, of: impl Fn(usize, &Part) -> R + Sync + Send) -> Vec<R> {
        match &self.parts[..] {
            [one] => vec![of(0, one)],
            parts => parts.par_iter().enumerate().map(|(k, part)| of(k, part)).collect(),
        }
    }

    fn prior_cost(&self, point: &[f64]) -> f64 {
        self.free.iter().zip(point).map(|(f, x)| f.prior_cost(*x)).sum()
    }

    pub fn normal(&self, point: &[f64], window: Window) -> Normal {
        let linear = self.linearised(point, window, None);
        self.weighed(point, &linear, &vec![1.0; linear.len()])
    }

    /// Normal equations of linearised parts, each counted by its share.
    pub fn weighed(&self, point: &[f64], parts: &[Linear], shares: &[f64]) -> Normal {
        let n = self.free.len();
        let mut normal = Normal {
            cost: self.prior_cost(point),
            gradient: DVector::zeros(n),
            hessian: DMatrix::zeros(n, n),
        };
        for (k, f) in self.free.iter().enumerate() {
            normal.gradient[k] = (point[k] - f.mean) / (f.sd * f.sd);
            normal.hessian[(k, k)] = 1.0 / (f.sd * f.sd);
        }
        for (linear, share) in parts.iter().zip(shares) {
            linear.add_to(&mut normal, *share);
        }
        normal.hessian.fill_upper_triangle_with_lower_triangle();
        normal
    }

    /// Half the cost's gradient where the parts do this, with the derivatives of a point nearby.
    pub fn gradient(&self, point: &[f64], parts: &[Linear], there: &[Followed]) -> DVector<f64> {
        let prior = self.free.iter().zip(point).map(|(f, x)| (x - f.mean) / (f.sd * f.sd));
        let mut gradient = DVector::from_iterator(point.len(), prior);
        for (linear, there) in parts.iter().zip(there) {
            let pulls: Vec<f64> = there.residuals.iter().map(|r| r.clamp(-HUBER, HUBER)).collect();
            linear.pull_back(&pulls, &mut gradient);
        }
        gradient
    }

    /// Residuals of each part and how they change with the parameters; what the parts do at the point, where that is known.
    pub fn linearised(&self, point: &[f64], window: Window, there: Option<&[Followed]>) -> Vec<Linear> {
        self.of_parts(|k, part| {
            let there = there.and_then(|parts| parts.get(k));
            part.linearised(&self.free, |k| !self.free[k].held, point, window, there, self.stop)
        })
    }

    /// The same where the derivatives by all but some parameters are `known`.
    pub fn completed(
        &self,
        known: Vec<Linear>,
        missing: &[bool],
        point: &[f64],
        window: Window,
    ) -> Vec<Linear> {
        let further = self
            .of_parts(|_, part| part.linearised(&self.free, |k| missing[k], point, window, None, self.stop));
        known.into_iter().zip(&further).map(|(known, further)| known.with(further)).collect()
    }

    /// The model of part `index` at this point.
    pub fn model(&self, index: usize, point: &[f64]) -> Model {
        let part = &self.parts[index];
        part.model.with_values(&part.flat(&self.free, point))
    }
}

/// A simulation of one part, and its whitened residuals in their fixed order.
#[derive(Debug, Clone)]
pub(super) struct Followed {
    pub rollout: Rollout<f64>,
    pub residuals: Vec<f64>,
}

/// Steps that a search of these parts may take.
fn most(parts: &[Part]) -> u64 {
    parts.iter().map(|p| WORK.min(WORK_BY_FRAME * p.scene.times.len() as u64)).sum()
}

/// Huber's loss.
pub(super) fn rho(r: f64) -> f64 {
    if r.abs() <= HUBER { 0.5 * r * r } else { HUBER * (r.abs() - 0.5 * HUBER) }
}

/// One sample of a body, and how its residuals are whitened.
pub(super) struct Measured<'a> {
    pub body: usize,
    pub sample: &'a Sample,
    pub whitener: Whitener,
    /// Value and deviation (rad), where it counts.
    pub yaw: Option<(f64, f64)>,
}

/// One residual's identity: body, frame, and coordinate 0, 1 = position (x and y where their errors are independent),
/// 2 = yaw.
pub(super) type Coordinate = (usize, usize, usize);

impl Part<'_> {
    pub fn flat(&self, free: &[Free], point: &[f64]) -> Vec<f64> {
        let mut flat = self.base.clone();
        for &(slot, k) in &self.slots {
            flat[slot] = if free[k].log { point[k].exp() } else { point[k] };
        }
        flat
    }

    pub fn times(&self, window: Window) -> &[f64] {
        &self.scene.times[..window.min(self.scene.times.len())]
    }

    pub fn rollout(&self, free: &[Free], point: &[f64], window: Window) -> Rollout<f64> {
        let rollout = film(&self.model, &self.flat(free, point), self.times(window), &LIMITS);
        self.worked(&rollout, 1);
        rollout
    }

    /// What the part does; `None` where the simulation does not come to its end.
    pub fn followed(&self, free: &[Free], point: &[f64], window: Window) -> Option<Followed> {
        let followed = self.simulated(free, point, window);
        (followed.rollout.ending == Ending::Completed).then_some(followed)
    }

    /// The same, however it ends.
    pub fn simulated(&self, free: &[Free], point: &[f64], window: Window) -> Followed {
        let rollout = self.rollout(free, point, window);
        let mut residuals = vec![];
        self.each_residual(&rollout, window, |_, r, _| residuals.push(r));
        Followed { rollout, residuals }
    }

    /// Counts a simulation that costs as much as so many without derivatives.
    pub fn worked<T>(&self, rollout: &Rollout<T>, each: u64) {
        // An order of additions shows in no sum.
        self.work.fetch_add(each * (1 + rollout.steps as u64), Ordering::Relaxed);
    }

    /// Calls `f(coordinate, whitened residual, row)` for each measurement in a fixed order.
    pub fn each_residual(
        &self,
        rollout: &Rollout<f64>,
        window: Window,
        mut f: impl FnMut(Coordinate, f64, usize),
    ) {
        self.each_sample(window, |m, row| {
            let (body, frame) = (m.body, m.sample.frame);
            let k = rollout.states.get(frame).and_then(|s| s[body].as_ref());
            let off = k.map(|k| k.position - m.sample.position).unwrap_or_default();
            let [x, y] = m.whitener.apply(off.x, off.y);
            f((body, frame, 0), x, row);
            f((body, frame, 1), y, row + 1);
            if let Some((yaw, sigma)) = m.yaw {
                f((body, frame, 2), k.map_or(0.0, |k| wrapped(k.yaw - yaw) / sigma), row + 2);
            }
        });
    }

    /// Sum of squared position residuals (m^2), and how many coordinates were measured.
    pub fn position_error(&self, rollout: &Rollout<f64>, window: Window) -> (f64, usize) {
        let (mut squares, mut count) = (0.0, 0);
        self.each_sample(window, |m, _| {
            let k = rollout.states.get(m.sample.frame).and_then(|s| s[m.body].as_ref());
            squares += k.map_or(0.0, |k| (k.position - m.sample.position).norm_squared());
            count += 2;
        });
        (squares, count)
    }

    /// Calls `f(measurement, first row)`: a position has two rows, a yaw that counts has a third.
    pub fn each_sample(&self, window: Window, mut f: impl FnMut(Measured, usize)) {
        let mut row = 0;
        let usual = self.noise.whitener(None);
        for (body, track) in self.scene.tracks.iter().enumerate() {
            let turns = !self.model.bodies[body].shape.is_ball();
            for sample in track.samples.iter().take_while(|s| s.frame < window) {
                let yaw = sample.yaw.zip(self.noise.yaw).filter(|_| turns);
                let whitener = sample.covariance.map_or(usual, |c| self.noise.whitener(Some(c)));
                f(Measured { body, sample, whitener, yaw }, row);
                row += 2 + usize::from(yaw.is_some());
            }
        }
    }
}
