//! The force lens: along free stretches, measured positions against the double integral of a model's
//! accelerations along the measured path. Positions are never differentiated twice.

use super::free::{Free, STEP, at_values, flats, free_parameters, values_of};
use super::path::{Path, paths};
use crate::fit::{Noise, estimate_noise};
use crate::num::Vec2;
use crate::scene::Scene;
use crate::world::{Kinematics, Model, Snapshot, Views, accelerations, accelerations_of, affected};
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;
use std::ops::Range;

/// Iterations of one search, and trials of the damping in each.
const ITERATIONS: usize = 12;
const TRIALS: usize = 6;
/// Iterations when numbers are proven on what was left out.
pub const PROOFS: usize = 4;
/// The data say nothing of a number whose deviation stays above this share of its prior's.
const UNTOLD: f64 = 0.5;
/// A fall of chi-square below this share ends a search.
const TOLERANCE: f64 = 1e-4;

/// Objects of which one may be an exception.
const FEW_TRACKS: usize = 4;

/// What the force lens looks at: free stretches of all scenes.
pub struct Lens<'a> {
    pub scenes: &'a [Scene],
    pub noises: Vec<Noise>,
    pub paths: Vec<Vec<Path>>,
    /// For each scene, all bodies in each frame.
    instants: Vec<Vec<Snapshot>>,
    stretches: Vec<Stretch>,
    /// Rows that are left out together: one video's, or one object's where there is one video.
    pub folds: Vec<Vec<Range<usize>>>,
}

/// One free stretch of one body; its rows hold x, then y.
struct Stretch {
    scene: usize,
    body: usize,
    frames: Vec<usize>,
    first_row: usize,
    /// Orthonormal constant and line over the frames: place and velocity at the start are nobody's concern.
    basis: [Vec<f64>; 2],
    /// Unit vector over the rows that does not count either: the friction of a foot that nobody saw turn, as what turns
    /// brakes less.
    braked: Option<DVector<f64>>,
}

impl Stretch {
    /// Writes differences (m) in deviations, what is nobody's concern projected out.
    fn write(&self, differences: impl Iterator<Item = Vec2>, sigma: f64, out: &mut DVector<f64>) {
        let mut rows = bent(&self.basis, differences.map(|d| d.scaled(1.0 / sigma)));
        if let Some(braked) = &self.braked {
            rows -= braked * braked.dot(&rows);
        }
        out.rows_mut(self.first_row, rows.len()).copy_from(&rows);
    }

    fn degrees_of_freedom(&self) -> usize {
        (2 * self.frames.len()).saturating_sub(4 + usize::from(self.braked.is_some()))
    }
}

/// A least-squares solution of the lens.
#[derive(Debug, Clone)]
pub struct Seen {
    pub values: Vec<f64>,
    pub sd: Vec<f64>,
    /// With the priors' share, and without, in units of the measurement noise.
    pub cost: f64,
    pub chi_square: f64,
    /// Chi-square of the rows that did not count.
    pub left_out: f64,
}

impl<'a> Lens<'a> {
    pub fn new(scenes: &'a [Scene]) -> Self {
        let noises: Vec<Noise> = scenes.iter().map(estimate_noise).collect();
        let paths: Vec<Vec<Path>> = scenes.iter().zip(&noises).map(|(s, n)| paths(s, n)).collect();
        let instants = scenes.iter().zip(&paths).map(|(s, p)| instants(s, p)).collect();
        let (mut stretches, mut row) = (vec![], 0);
        let mut folds: BTreeMap<usize, Vec<Range<usize>>> = BTreeMap::new();
        for (scene, paths) in paths.iter().enumerate() {
            for (body, path) in paths.iter().enumerate() {
                for range in &path.stretches {
                    let seen = |f: &usize| scenes[scene].tracks[body].at(*f).is_some();
                    let frames: Vec<usize> = range.clone().filter(seen).collect();
                    let basis = line_basis(&scenes[scene], &frames);
                    let count = frames.len();
                    let braked = unseen_turn(&scenes[scene], body)
                        .then(|| braked(&scenes[scene], path, &frames, &basis))
                        .flatten();
                    stretches.push(Stretch { scene, body, frames, first_row: row, basis, braked });
                    let fold = if scenes.len() > 1 { scene } else { body };
                    folds.entry(fold).or_default().push(row..row + 2 * count);
                    row += 2 * count;
                }
            }
        }
        Lens { scenes, noises, paths, instants, stretches, folds: folds.into_values().collect() }
    }

    /// How many residuals there are, less what each stretch's start takes.
    pub fn degrees_of_freedom(&self) -> usize {
        self.stretches.iter().map(Stretch::degrees_of_freedom).sum()
    }

    /// All rows but these.
    pub fn rest(&self, rows: &[Range<usize>]) -> Vec<Range<usize>> {
        let all = self.stretches.iter().map(|s| s.first_row..s.first_row + 2 * s.frames.len());
        all.filter(|r| !rows.contains(r)).collect()
    }

    /// Chi-square of all parts by what the others say; numbers of which they say nothing (the friction of a material that
    /// only this part shows) are the part's own.
    pub fn left_out(&self, models: &[Model], free: &[Free], values: &[f64]) -> f64 {
        let one = |fold: &Vec<Range<usize>>| {
            let others = self.solve(models, free, values, PROOFS, fold);
            let untold = free.iter().zip(&others.sd).filter(|(f, sd)| **sd > UNTOLD * f.sd);
            let own: Vec<Free> = untold.map(|(f, _)| f.clone()).collect();
            if own.is_empty() {
                return others.left_out;
            }
            let told = at_values(models, free, &others.values);
            let here = self.solve(&told, &own, &values_of(&told, &own), PROOFS, &self.rest(fold));
            here.chi_square - here.left_out
        };
        self.folds.iter().map(one).sum()
    }

    /// Chi-square and degrees of freedom of each object that moves.
    pub fn by_track(&self, residual: &DVector<f64>) -> Vec<(f64, f64)> {
        let mut sums: BTreeMap<(usize, usize), (f64, f64)> = BTreeMap::new();
        for s in &self.stretches {
            let sum = sums.entry((s.scene, s.body)).or_default();
            sum.0 += residual.rows(s.first_row, 2 * s.frames.len()).norm_squared();
            sum.1 += s.degrees_of_freedom() as f64;
        }
        sums.into_values().collect()
    }

    /// Reduced chi-square of all objects but the worst, where there are others to compare with.
    pub fn typical(&self, residual: &DVector<f64>) -> f64 {
        let mut tracks = self.by_track(residual);
        tracks.sort_by(|a, b| (b.0 - b.1).total_cmp(&(a.0 - a.1)));
        let others = tracks.get(usize::from(tracks.len() >= FEW_TRACKS)..).unwrap_or_default();
        let (chi_square, degrees) = others.iter().fold((0.0, 0.0), |(a, b), t| (a + t.0, b + t.1));
        chi_square / f64::max(degrees, 1.0)
    }

    /// Measured minus integrated, in deviations, place and velocity of each stretch projected out.
    pub fn residual(&self, models: &[Model], flats: &[Vec<f64>]) -> DVector<f64> {
        let mut out = DVector::zeros(self.stretches.iter().map(|s| 2 * s.frames.len()).sum());
        for scene in 0..self.scenes.len() {
            self.scene_residual(scene, &models[scene], &flats[scene], None, &mut out);
        }
        out
    }

    /// Writes the rows of one scene, or of some of its bodies.
    fn scene_residual(
        &self,
        scene: usize,
        model: &Model,
        flat: &[f64],
        of: Option<&[bool]>,
        out: &mut DVector<f64>,
    ) {
        let instants = &self.instants[scene];
        let accelerations = match of {
            Some(of) => accelerations_of(model, flat, instants, of),
            None => accelerations(model, flat, instants),
        };
        let written = |s: &&Stretch| s.scene == scene && of.is_none_or(|of| of[s.body]);
        let views = Views::new(model, flat);
        for s in self.stretches.iter().filter(written) {
            let sigma = self.noises[scene].position;
            let at = |f: usize| instants[f].bodies.iter().position(|b| b.0 == s.body);
            // How a ball turns about the vertical no trajectory follows.
            let turns = !model.bodies[s.body].shape.is_ball();
            let measured = |f: usize| {
                let sample = &self.scenes[scene].tracks[s.body].samples;
                let seen = sample.binary_search_by_key(&f, |x| x.frame).map(|at| sample[at].position).ok()?;
                let yaw = at(f).filter(|_| turns).map_or(0.0, |at| instants[f].bodies[at].1.yaw);
                Some(views.undone(s.body, seen, yaw))
            };
            let acceleration = |f: usize| at(f).map_or(Vec2::zero(), |at| accelerations[f][at]);
            let integrated = integral(&self.scenes[scene], &s.frames, acceleration);
            let differences = s.frames.iter().zip(&integrated);
            let differences = differences.map(|(&f, at)| measured(f).unwrap_or(Vec2::zero()) - *at);
            s.write(differences, sigma, out);
        }
    }

    /// Fits the free parameters from `start`, priors counting; rows in `without` do not count.
    pub fn solve(
        &self,
        models: &[Model],
        free: &[Free],
        start: &[f64],
        iterations: usize,
        without: &[Range<usize>],
    ) -> Seen {
        let mut values = start.to_vec();
        let counted = self.counted(without);
        let mut residual = self.residual(models, &flats(models, free, &values));
        let mut cost = self.cost(&residual, free, &values, without);
        let mut damping = 1e-6;
        let mut normal = DMatrix::identity(free.len(), free.len());
        for _ in 0..iterations.max(1) {
            let jacobian = self.slopes(models, free, &values, &residual, &counted);
            let (h, g) = self.normal(&jacobian, &residual, free, &values, without);
            normal = h;
            let mut fallen = None;
            for _ in 0..if iterations == 0 { 0 } else { TRIALS } {
                let trial = damped_step(&normal, &g, free, &values, damping);
                let mut trial_residual = residual.clone();
                let at = flats(models, free, &trial);
                for &scene in &counted {
                    self.scene_residual(scene, &models[scene], &at[scene], None, &mut trial_residual);
                }
                let trial_cost = self.cost(&trial_residual, free, &trial, without);
                if trial_cost < cost {
                    fallen = Some(cost - trial_cost);
                    (values, residual, cost) = (trial, trial_residual, trial_cost);
                    damping = (damping * 0.1f64).max(1e-9);
                    break;
                }
                damping = damping.max(1e-6) * 20.0;
            }
            if fallen.is_none_or(|fall| fall < TOLERANCE * cost) {
                break;
            }
        }
        if counted.len() < self.scenes.len() {
            residual = self.residual(models, &flats(models, free, &values));
        }
        let sd = match normal.cholesky() {
            Some(c) => c.inverse().diagonal().iter().map(|v| v.max(0.0).sqrt()).collect(),
            None => free.iter().map(|f| f.sd).collect(),
        };
        Seen { chi_square: residual.norm_squared(), left_out: squares(&residual, without), values, sd, cost }
    }

    /// Sum of squares with the priors' terms.
    fn cost(&self, residual: &DVector<f64>, free: &[Free], values: &[f64], without: &[Range<usize>]) -> f64 {
        let priors: f64 = free.iter().zip(values).map(|(f, v)| ((v - f.mean) / f.sd).powi(2)).sum();
        residual.norm_squared() - squares(residual, without) + priors
    }

    /// Scenes with rows that are not in `without`.
    fn counted(&self, without: &[Range<usize>]) -> Vec<usize> {
        let counts = |s: &&Stretch| !without.iter().any(|r| r.start == s.first_row);
        let mut scenes: Vec<usize> = self.stretches.iter().filter(counts).map(|s| s.scene).collect();
        scenes.dedup();
        scenes
    }

    /// Derivatives of the residual by differences; a parameter of one scene moves that scene only.
    pub fn jacobian(
        &self,
        models: &[Model],
        free: &[Free],
        values: &[f64],
        residual: &DVector<f64>,
    ) -> DMatrix<f64> {
        self.slopes(models, free, values, residual, &self.counted(&[]))
    }

    /// The same of these scenes; zero elsewhere.
    fn slopes(
        &self,
        models: &[Model],
        free: &[Free],
        values: &[f64],
        residual: &DVector<f64>,
        counted: &[usize],
    ) -> DMatrix<f64> {
        let mut jacobian = DMatrix::zeros(residual.len(), free.len());
        let flats = flats(models, free, values);
        for (k, f) in free.iter().enumerate() {
            let mut scenes: Vec<usize> = f.slots.iter().map(|s| s.0).collect();
            scenes.dedup();
            scenes.retain(|s| counted.contains(s));
            if scenes.is_empty() {
                continue;
            }
            let at = |value: f64| {
                let mut moved = residual.clone();
                for &scene in &scenes {
                    let mut flat = flats[scene].clone();
                    for &(_, slot) in f.slots.iter().filter(|s| s.0 == scene) {
                        flat[slot] = value;
                    }
                    // What moves as before leaves its rows as they are.
                    let moves = affected(&models[scene], &flats[scene], &flat);
                    self.scene_residual(scene, &models[scene], &flat, Some(&moves), &mut moved);
                }
                moved
            };
            // The forces are linear in most parameters: one side will do where the step is small.
            let up = if values[k] + f.step > f.max { values[k] - f.step } else { values[k] + f.step };
            let (from, down) = if f.step > STEP {
                let down = (values[k] - f.step).max(f.min);
                (at(down), down)
            } else {
                (residual.clone(), values[k])
            };
            jacobian.set_column(k, &((at(up) - from) / (up - down)));
        }
        jacobian
    }

    /// The residual's derivative by the amplitude of an acceleration, or of a force where `force` is set.
    pub fn column(
        &self,
        models: &[Model],
        force: bool,
        value: impl Fn(&Kinematics<f64>, f64) -> Vec2,
    ) -> DVector<f64> {
        let mut out = DVector::zeros(self.stretches.iter().map(|s| 2 * s.frames.len()).sum());
        for s in &self.stretches {
            let body = &models[s.scene].bodies[s.body];
            let share =
                if body.start.rolling { 5.0 / 7.0 } else { 1.0 } / if force { body.mass } else { 1.0 };
            let acceleration = |f: usize| {
                let instant = &self.instants[s.scene][f];
                let here = instant.bodies.iter().find(|b| b.0 == s.body);
                here.map_or(Vec2::zero(), |(_, k)| value(k, instant.time).scaled(share))
            };
            let integrated = integral(&self.scenes[s.scene], &s.frames, acceleration);
            s.write(integrated.iter().map(|p| -*p), self.noises[s.scene].position, &mut out);
        }
        out
    }

    fn normal(
        &self,
        jacobian: &DMatrix<f64>,
        residual: &DVector<f64>,
        free: &[Free],
        values: &[f64],
        without: &[Range<usize>],
    ) -> (DMatrix<f64>, DVector<f64>) {
        let mut h = jacobian.tr_mul(jacobian);
        let mut g = jacobian.tr_mul(residual);
        for rows in without {
            let part = jacobian.rows(rows.start, rows.len());
            h -= part.tr_mul(&part);
            g -= part.tr_mul(&residual.rows(rows.start, rows.len()));
        }
        for (k, f) in free.iter().enumerate() {
            h[(k, k)] += 1.0 / (f.sd * f.sd);
            g[k] += (values[k] - f.mean) / (f.sd * f.sd);
        }
        (h, g)
    }

    /// What the data say of the columns' amplitudes (their inverse covariance) beside the parameters of the base; and the columns
    /// against those parameters'.
    pub fn information(&self, projector: &Projector, columns: &DMatrix<f64>) -> (DMatrix<f64>, DMatrix<f64>) {
        let across = projector.jacobian.tr_mul(columns);
        (columns.tr_mul(columns) - across.tr_mul(&projector.factor.solve(&across)), across)
    }

    /// How much chi-square would fall if the columns entered linearly beside the parameters of `base`, and their
    /// amplitudes. `factor` and `base` are of [`Lens::projector`].
    pub fn gain(&self, projector: &Projector, columns: &DMatrix<f64>) -> Option<(f64, DVector<f64>)> {
        let (mut s, _) = self.information(projector, columns);
        let g = columns.tr_mul(&projector.residual);
        for k in 0..s.nrows() {
            // A column that the base explains has no amplitude.
            if s[(k, k)] <= 1e-9 * columns.column(k).norm_squared() {
                return None;
            }
            s[(k, k)] *= 1.0 + 1e-12;
        }
        let amplitudes = -s.cholesky()?.solve(&g);
        Some((-amplitudes.dot(&g), amplitudes))
    }

    /// Cost with the columns beside the parameters of the base, all free at once and without bounds, from wherever the
    /// base stands; and the columns' amplitudes.
    pub fn joint(
        &self,
        projector: &Projector,
        cost: f64,
        columns: &DMatrix<f64>,
    ) -> Option<(f64, DVector<f64>)> {
        let (s, across) = self.information(projector, columns);
        let base = projector.factor.solve(&projector.gradient);
        let g = columns.tr_mul(&projector.residual) - across.tr_mul(&base);
        let amplitudes = -s.cholesky()?.solve(&g);
        Some((cost - projector.gradient.dot(&base) + amplitudes.dot(&g), amplitudes))
    }

    /// Deviations of the free parameters by how much the objects disagree about them, whatever the noise is (White,
    /// Econometrica 48 (1980) 817, with objects as clusters); `None` where there are too few objects.
    pub fn scatter(&self, models: &[Model], free: &[Free], values: &[f64]) -> Option<Vec<f64>> {
        let residual = self.residual(models, &flats(models, free, values));
        let jacobian = self.jacobian(models, free, values, &residual);
        let inverse = self.normal(&jacobian, &residual, free, values, &[]).0.cholesky()?.inverse();
        let mut pulls: BTreeMap<(usize, usize), DVector<f64>> = BTreeMap::new();
        for s in &self.stretches {
            let (first, count) = (s.first_row, 2 * s.frames.len());
            let pull = jacobian.rows(first, count).tr_mul(&residual.rows(first, count));
            *pulls.entry((s.scene, s.body)).or_insert_with(|| DVector::zeros(free.len())) += pull;
        }
        let count = pulls.len() as f64;
        let moved = pulls.into_values().map(|pull| (&inverse * pull).map(|m| m * m));
        let sum = moved.fold(DVector::zeros(free.len()), |sum, m| sum + m);
        (count > 1.0).then(|| sum.iter().map(|v| (v * count / (count - 1.0)).sqrt()).collect())
    }

    /// What projects the parameters of a solution out of further columns.
    pub fn projector(&self, models: &[Model], free: &[Free], values: &[f64]) -> Option<Projector> {
        let residual = self.residual(models, &flats(models, free, values));
        let jacobian = self.jacobian(models, free, values, &residual);
        let (h, gradient) = self.normal(&jacobian, &residual, free, values, &[]);
        Some(Projector { residual, factor: h.cholesky()?, jacobian, gradient })
    }
}

fn squares(residual: &DVector<f64>, rows: &[Range<usize>]) -> f64 {
    rows.iter().map(|r| residual.rows(r.start, r.len()).norm_squared()).sum()
}

/// See [`Lens::projector`].
pub struct Projector {
    pub residual: DVector<f64>,
    jacobian: DMatrix<f64>,
    gradient: DVector<f64>,
    factor: nalgebra::Cholesky<f64, nalgebra::Dyn>,
}

impl Projector {
    /// The residual with the columns at these amplitudes, the parameters of the base moved with them ([`Lens::joint`]).
    pub fn moved(&self, columns: &DMatrix<f64>, amplitudes: &[f64]) -> DVector<f64> {
        let added = columns * DVector::from_column_slice(amplitudes);
        let step = self.factor.solve(&(&self.gradient + self.jacobian.tr_mul(&added)));
        &self.residual + added - &self.jacobian * step
    }
}

fn damped_step(
    normal: &DMatrix<f64>,
    gradient: &DVector<f64>,
    free: &[Free],
    values: &[f64],
    damping: f64,
) -> Vec<f64> {
    let mut system = normal.clone();
    for k in 0..free.len() {
        system[(k, k)] *= 1.0 + damping;
    }
    let Some(factor) = system.cholesky() else { return values.to_vec() };
    let step = factor.solve(gradient);
    let moved = values.iter().zip(step.iter()).map(|(v, s)| v - s);
    moved.zip(free).map(|(v, f)| v.clamp(f.min, f.max)).collect()
}

/// All bodies that are seen, frame by frame.
pub(super) fn instants(scene: &Scene, paths: &[Path]) -> Vec<Snapshot> {
    let bodies = |f: usize| {
        let seen = paths.iter().enumerate();
        seen.filter_map(|(i, p)| Some((i, (*p.motion.get(f)?)?))).collect()
    };
    scene.times.iter().enumerate().map(|(f, &time)| Snapshot { time, bodies: bodies(f) }).collect()
}

/// Double integral of a piecewise linear acceleration from rest at the first frame.
pub(super) fn integral(scene: &Scene, frames: &[usize], acceleration: impl Fn(usize) -> Vec2) -> Vec<Vec2> {
    let (mut place, mut velocity) = (Vec2::zero(), Vec2::zero());
    let mut all = vec![place];
    for pair in frames.windows(2) {
        let h = scene.times[pair[1]] - scene.times[pair[0]];
        let (a, b) = (acceleration(pair[0]), acceleration(pair[1]));
        place += velocity.scaled(h) + (a.scaled(2.0) + b).scaled(h * h / 6.0);
        velocity += (a + b).scaled(0.5 * h);
        all.push(place);
    }
    all
}

/// Differences as rows, x then y, constant and line projected out.
fn bent(basis: &[Vec<f64>; 2], differences: impl Iterator<Item = Vec2>) -> DVector<f64> {
    let (mut x, mut y): (Vec<f64>, Vec<f64>) = differences.map(|d| (d.x, d.y)).unzip();
    for values in [&mut x, &mut y] {
        for base in basis {
            let share: f64 = base.iter().zip(values.iter()).map(|(b, v)| b * v).sum();
            values.iter_mut().zip(base).for_each(|(v, b)| *v -= share * b);
        }
    }
    x.append(&mut y);
    DVector::from_vec(x)
}

/// Whether an object has a foot that may turn, and nobody measured how it does.
pub(super) fn unseen_turn(scene: &Scene, object: usize) -> bool {
    !scene.objects[object].shape.is_ball() && scene.tracks[object].samples.iter().all(|s| s.yaw.is_none())
}

/// What friction of any constant size does over the frames, as a unit vector.
fn braked(scene: &Scene, path: &Path, frames: &[usize], basis: &[Vec<f64>; 2]) -> Option<DVector<f64>> {
    let against = |f: usize| path.motion[f].map_or(Vec2::zero(), |k| -k.velocity.unit());
    bent(basis, integral(scene, frames, against).into_iter()).try_normalize(1e-9)
}

fn line_basis(scene: &Scene, frames: &[usize]) -> [Vec<f64>; 2] {
    let n = frames.len() as f64;
    let mean = frames.iter().map(|&f| scene.times[f]).sum::<f64>() / n;
    let mut line: Vec<f64> = frames.iter().map(|&f| scene.times[f] - mean).collect();
    let norm = line.iter().map(|t| t * t).sum::<f64>().sqrt().max(1e-12);
    line.iter_mut().for_each(|t| *t /= norm);
    [vec![1.0 / n.sqrt(); frames.len()], line]
}

/// Fits the models' parameters as the lens sees them.
pub fn fit_forces(lens: &Lens, models: &[Model]) -> (Vec<Free>, Seen) {
    let free = free_parameters(models);
    let seen = lens.solve(models, &free, &values_of(models, &free), ITERATIONS, &[]);
    (free, seen)
}
