//! The force lens: along free stretches, measured positions against the double integral of a model's
//! accelerations along the measured path. Positions are never differentiated twice.

use super::checkpoints::Checkpoints;
use super::free::{FreeParameter, STEP, at_values, flats, free_parameters, values_of};
use super::segment::{FreeSegment, instants, integral};
use super::smooth_track::{SmoothTrack, paths};
use crate::fit::{Noise, estimate_noise};
use crate::num::{
    AtBounds, Bounds, LeastSquares, NormalEquations, Schedule, Stop, Stopped, Vec2, elementary,
    levenberg_marquardt, never,
};
use crate::scene::Scene;
use crate::world::{AccelerationField, FormulaForces, Kinematics, Model, Snapshot};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
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
pub struct WeakFormRegression<'a> {
    pub scenes: &'a [Scene],
    pub noises: Vec<Noise>,
    /// By scene and object: standard deviation of a coordinate (m).
    track_noises: Vec<Vec<f64>>,
    pub paths: Vec<Vec<SmoothTrack>>,
    /// For each scene, all bodies in each frame.
    instants: Vec<Vec<Snapshot>>,
    stretches: Vec<FreeSegment>,
    /// Rows that are left out together: one video's, or one object's where there is one video.
    pub folds: Vec<Vec<Range<usize>>>,
    /// Once it says so, what is computed has no meaning, and comes at once: the caller asks it, too.
    stop: Stop<'a>,
    /// Where the steps of a discovery are kept.
    pub checkpoints: Option<&'a dyn Checkpoints>,
}

/// A least-squares solution of the lens.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct LensFit {
    pub values: Vec<f64>,
    pub sd: Vec<f64>,
    /// With the priors' share, and without, in units of the measurement noise.
    pub cost: f64,
    pub chi_square: f64,
    /// Chi-square of the rows that did not count.
    pub left_out: f64,
}

impl LensFit {
    /// Where the search was stopped.
    fn meaningless(free: &[FreeParameter], start: &[f64]) -> LensFit {
        let sd = free.iter().map(|f| f.sd).collect();
        LensFit { values: start.to_vec(), sd, cost: 0.0, chi_square: 0.0, left_out: 0.0 }
    }
}

impl<'a> WeakFormRegression<'a> {
    pub fn new(scenes: &'a [Scene]) -> Self {
        let noises: Vec<Noise> = scenes.iter().map(estimate_noise).collect();
        let own = |(scene, noise): (&Scene, &Noise)| -> Vec<f64> {
            scene.tracks.iter().map(|track| noise.of_track(track).position).collect()
        };
        let track_noises = scenes.iter().zip(&noises).map(own).collect();
        let paths: Vec<Vec<SmoothTrack>> = scenes.iter().zip(&noises).map(|(s, n)| paths(s, n)).collect();
        let instants: Vec<Vec<Snapshot>> = scenes.iter().zip(&paths).map(|(s, p)| instants(s, p)).collect();
        let (mut stretches, mut row) = (vec![], 0);
        let mut folds: BTreeMap<usize, Vec<Range<usize>>> = BTreeMap::new();
        for (index, scene) in scenes.iter().enumerate() {
            for stretch in FreeSegment::all(index, scene, &paths[index], &instants[index], &mut row) {
                let fold = if scenes.len() > 1 { index } else { stretch.body };
                folds.entry(fold).or_default().push(stretch.span());
                stretches.push(stretch);
            }
        }
        WeakFormRegression {
            scenes,
            noises,
            track_noises,
            paths,
            instants,
            stretches,
            folds: folds.into_values().collect(),
            stop: &never,
            checkpoints: None,
        }
    }

    /// The same, ended by `stop`: from then on all results are meaningless and come at once. The caller must ask `stop` before it
    /// uses one.
    pub fn until(self, stop: Stop<'a>) -> Self {
        WeakFormRegression { stop, ..self }
    }

    /// The same, with long steps kept there.
    pub fn kept_in(self, checkpoints: Option<&'a dyn Checkpoints>) -> Self {
        WeakFormRegression { checkpoints, ..self }
    }

    /// Whether results have no meaning any more.
    pub fn is_stopped(&self) -> bool {
        (self.stop)(0.0).is_err()
    }

    /// How many residuals there are, less what each stretch's start takes.
    pub fn degrees_of_freedom(&self) -> usize {
        self.stretches.iter().map(FreeSegment::degrees_of_freedom).sum()
    }

    /// All rows but these.
    pub fn rest(&self, rows: &[Range<usize>]) -> Vec<Range<usize>> {
        let all = self.stretches.iter().map(FreeSegment::span);
        all.filter(|r| !rows.contains(r)).collect()
    }

    /// Chi-square of all parts by what the others say; numbers of which they say nothing (the friction of a material that
    /// only this part shows) are the part's own.
    pub fn left_out(&self, models: &[Model], free: &[FreeParameter], values: &[f64]) -> f64 {
        let one = |fold: &Vec<Range<usize>>| {
            let others = self.solve(models, free, values, PROOFS, fold);
            let untold = free.iter().zip(&others.sd).filter(|(f, sd)| **sd > UNTOLD * f.sd);
            let own: Vec<FreeParameter> = untold.map(|(f, _)| f.clone()).collect();
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

    /// The rows of each object that moves, in the order of [`Self::by_track`].
    pub fn rows_by_track(&self) -> Vec<Vec<Range<usize>>> {
        let mut rows: BTreeMap<(usize, usize), Vec<Range<usize>>> = BTreeMap::new();
        self.stretches.iter().for_each(|s| rows.entry((s.scene, s.body)).or_default().push(s.span()));
        rows.into_values().collect()
    }

    /// The most that one object's track says of the amplitude of column `k`, the parameters of the base projected out (part of its
    /// [`information`](Self::information)).
    pub fn largest_track_share(&self, projector: &Projector, columns: &DMatrix<f64>, k: usize) -> f64 {
        let column = columns.column(k);
        let explained = projector.factor.solve(&projector.jacobian.tr_mul(&column));
        let rest = column - &projector.jacobian * explained;
        self.rows_by_track().iter().map(|rows| squares(&rest, rows)).fold(0.0, f64::max)
    }

    /// Reduced chi-square of all objects but the worst, where there are others to compare with.
    pub fn trimmed_chi_square(&self, residual: &DVector<f64>) -> f64 {
        let mut tracks = self.by_track(residual);
        tracks.sort_by(|a, b| (b.0 - b.1).total_cmp(&(a.0 - a.1)));
        let others = tracks.get(usize::from(tracks.len() >= FEW_TRACKS)..).unwrap_or_default();
        let (chi_square, degrees) = others.iter().fold((0.0, 0.0), |(a, b), t| (a + t.0, b + t.1));
        chi_square / f64::max(degrees, 1.0)
    }

    /// Measured minus integrated, in deviations, place and velocity of each stretch projected out.
    pub fn residual(&self, models: &[Model], flats: &[Vec<f64>]) -> DVector<f64> {
        let mut out = DVector::zeros(self.row_count());
        for (scene, (model, flat)) in models.iter().zip(flats).enumerate() {
            self.write_scene(scene, &AccelerationField::new(model, flat), &mut out);
        }
        out
    }

    /// How far two readings of the scenes are apart in acceleration where bodies move freely (m/s^2): root mean square, and most.
    pub fn apart(&self, models: &[Model], others: &[Model]) -> [f64; 2] {
        let (mut squares, mut most, mut count) = (0.0, 0.0f64, 0.0);
        for (scene, (model, other)) in models.iter().zip(others).enumerate() {
            let [here, there] = [model, other].map(|m| {
                let flat = m.flatten();
                AccelerationField::new(m, &flat).accelerations(&self.instants[scene], None, None)
            });
            let measured = self.stretches.iter().filter(|s| s.scene == scene).flat_map(|s| &s.measured);
            for at in measured.filter_map(|m| m.at) {
                let square = (here[at] - there[at]).norm_squared();
                (squares, most, count) = (squares + square, most.max(square), count + 1.0);
            }
        }
        [(squares / f64::max(count, 1.0)).sqrt(), most.sqrt()]
    }

    fn row_count(&self) -> usize {
        self.stretches.last().map_or(0, |s| s.span().end)
    }

    fn write_scene(&self, scene: usize, field: &AccelerationField, out: &mut DVector<f64>) {
        self.each_stretch(scene, field, None, None, |s, rows| {
            out.rows_mut(s.first_row, rows.len()).copy_from(&rows)
        });
    }

    /// Calls `f(stretch, its rows of the residual)` for one scene, or for some of its bodies; what formulas do may be `known`.
    fn each_stretch(
        &self,
        scene: usize,
        field: &AccelerationField,
        of: Option<&[bool]>,
        known: Option<&FormulaForces>,
        mut f: impl FnMut(&FreeSegment, DVector<f64>),
    ) {
        let accelerations = field.accelerations(&self.instants[scene], of, known);
        let written = |s: &&FreeSegment| s.scene == scene && of.is_none_or(|of| of[s.body]);
        for s in self.stretches.iter().filter(written) {
            let felt = s.measured.iter().map(|m| m.at.map_or(Vec2::zero(), |at| accelerations[at]));
            let integrated = integral(&self.scenes[scene], &s.frames, felt);
            let differences = s.measured.iter().zip(&integrated);
            let differences = differences.map(|(m, at)| field.true_position(s.body, m.position, m.yaw) - *at);
            // The noise is of the picture: what a camera draws together is no better known for it.
            let middle = s.measured.get(s.measured.len() / 2);
            let magnification = middle.map_or(1.0, |m| {
                let position = field.true_position(s.body, m.position, m.yaw);
                field.magnification(s.body, position, m.yaw)
            });
            f(s, s.rows(differences, self.track_noises[scene][s.body] / magnification));
        }
    }

    /// Fits the free parameters from where they stand in the models.
    pub fn fit(&self, models: &[Model], free: &[FreeParameter]) -> LensFit {
        self.solve(models, free, &values_of(models, free), ITERATIONS, &[])
    }

    /// Fits the free parameters from `start`, priors counting; rows in `without` do not count.
    pub fn solve(
        &self,
        models: &[Model],
        free: &[FreeParameter],
        start: &[f64],
        iterations: usize,
        without: &[Range<usize>],
    ) -> LensFit {
        if self.is_stopped() {
            return LensFit::meaningless(free, start);
        }
        let residual = self.residual(models, &flats(models, free, start));
        let counted = self.counted(without);
        let bounds = free.iter().map(|f| Bounds { min: f.min, max: f.max, frozen: false }).collect();
        let mut problem = WeakFormProblem { lens: self, models, free, without, counted, bounds, residual };
        let schedule = Schedule { trials: if iterations == 0 { 0 } else { TRIALS }, ..SCHEDULE };
        let linear = problem.linearize(start, None);
        let found =
            levenberg_marquardt(&mut problem, start.to_vec(), Some(linear), &schedule, iterations.max(1));
        let Ok(found) = found else { return LensFit::meaningless(free, start) };
        let WeakFormProblem { counted, residual, .. } = problem;
        let (values, cost) = (found.point, found.cost);
        let mut residual = found.evaluation.unwrap_or(residual);
        let normal = found.normal.map_or_else(|| DMatrix::identity(free.len(), free.len()), |n| n.hessian);
        if counted.len() < self.scenes.len() {
            residual = self.residual(models, &flats(models, free, &values));
        }
        let sd = match normal.cholesky() {
            Some(c) => c.inverse().diagonal().iter().map(|v| v.max(0.0).sqrt()).collect(),
            None => free.iter().map(|f| f.sd).collect::<Vec<f64>>(),
        };
        let (chi_square, left_out) = (residual.norm_squared(), squares(&residual, without));
        let rows: usize = self.counted_rows(without).iter().map(Range::len).sum();
        let remains = ((chi_square - left_out) / f64::max(rows as f64, 1.0)).max(1.0);
        LensFit { chi_square, left_out, cost: cost + occam_penalty(free, &sd, remains), values, sd }
    }

    /// Sum of squares with the priors' terms.
    fn cost(
        &self,
        residual: &DVector<f64>,
        free: &[FreeParameter],
        values: &[f64],
        without: &[Range<usize>],
    ) -> f64 {
        let priors: f64 =
            free.iter().zip(values).map(|(f, v)| elementary::powi((v - f.mean) / f.sd, 2)).sum();
        residual.norm_squared() - squares(residual, without) + priors
    }

    /// Runs of rows that are not in `without`.
    fn counted_rows(&self, without: &[Range<usize>]) -> Vec<Range<usize>> {
        let mut runs: Vec<Range<usize>> = vec![];
        for span in self.rest(without) {
            match runs.last_mut().filter(|last| last.end == span.start) {
                Some(last) => last.end = span.end,
                None => runs.push(span),
            }
        }
        runs
    }

    /// Scenes with rows that are not in `without`.
    fn counted(&self, without: &[Range<usize>]) -> Vec<usize> {
        let counts = |s: &&FreeSegment| !without.iter().any(|r| r.start == s.first_row);
        let mut scenes: Vec<usize> = self.stretches.iter().filter(counts).map(|s| s.scene).collect();
        scenes.dedup();
        scenes
    }

    /// Derivatives of the residual by differences; a parameter of one scene moves that scene only.
    pub fn jacobian(
        &self,
        models: &[Model],
        free: &[FreeParameter],
        values: &[f64],
        residual: &DVector<f64>,
    ) -> DMatrix<f64> {
        self.slopes(models, free, values, residual, &self.counted(&[]))
    }

    /// The same of these scenes; zero elsewhere.
    fn slopes(
        &self,
        models: &[Model],
        free: &[FreeParameter],
        values: &[f64],
        residual: &DVector<f64>,
        counted: &[usize],
    ) -> DMatrix<f64> {
        let mut jacobian = DMatrix::zeros(residual.len(), free.len());
        let flats = flats(models, free, values);
        let fields: Vec<AccelerationField> =
            models.iter().zip(&flats).map(|(m, flat)| AccelerationField::new(m, flat)).collect();
        let seen = fields.iter().zip(&self.instants).enumerate();
        let written = seen.map(|(k, (field, at))| counted.contains(&k).then(|| field.formula_forces(at)));
        let written: Vec<Option<FormulaForces>> = written.collect();
        for (k, f) in free.iter().enumerate() {
            if self.is_stopped() {
                break;
            }
            let mut scenes: Vec<usize> = f.slots.iter().map(|s| s.0).collect();
            scenes.dedup();
            scenes.retain(|s| counted.contains(s));
            // The forces are linear in most parameters: one side will do where the step is small.
            let up = if values[k] + f.step > f.max { values[k] - f.step } else { values[k] + f.step };
            let down = if f.step > STEP { (values[k] - f.step).max(f.min) } else { values[k] };
            for scene in scenes {
                let at = |value: f64| {
                    let mut flat = flats[scene].clone();
                    f.slots.iter().filter(|s| s.0 == scene).for_each(|s| flat[s.1] = f.in_model(value));
                    AccelerationField::new(&models[scene], &flat)
                };
                let (above, below) = (at(up), (down != values[k]).then(|| at(down)));
                // What moves as before has no slope.
                let mut moves = above.differs(&fields[scene]);
                if let Some(below) = &below {
                    let too = below.differs(&fields[scene]);
                    moves.iter_mut().zip(too).for_each(|(moves, too)| *moves |= too);
                }
                let written = written[scene].as_ref();
                let mut column = jacobian.column_mut(k);
                self.each_stretch(scene, &above, Some(&moves), written, |s, rows| {
                    let from = residual.rows(s.first_row, rows.len());
                    let rise = if below.is_some() { rows } else { rows - from };
                    column.rows_mut(s.first_row, rise.len()).copy_from(&(rise / (up - down)));
                });
                if let Some(below) = below {
                    self.each_stretch(scene, &below, Some(&moves), written, |s, rows| {
                        let mut slope = column.rows_mut(s.first_row, rows.len());
                        slope -= rows / (up - down);
                    });
                }
            }
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
        let mut out = DVector::zeros(self.row_count());
        for s in self.stretches.iter().take_while(|_| !self.is_stopped()) {
            let body = &models[s.scene].bodies[s.body];
            let share =
                if body.start.rolling { 5.0 / 7.0 } else { 1.0 } / if force { body.mass } else { 1.0 };
            let acceleration = |f: usize| {
                let instant = &self.instants[s.scene][f];
                let here = instant.bodies.iter().find(|b| b.0 == s.body);
                here.map_or(Vec2::zero(), |(_, k)| value(k, instant.time).scaled(share))
            };
            let felt = s.frames.iter().map(|&f| acceleration(f));
            let integrated = integral(&self.scenes[s.scene], &s.frames, felt);
            let rows = s.rows(integrated.iter().map(|p| -*p), self.track_noises[s.scene][s.body]);
            out.rows_mut(s.first_row, rows.len()).copy_from(&rows);
        }
        out
    }

    fn normal(
        &self,
        jacobian: &DMatrix<f64>,
        residual: &DVector<f64>,
        free: &[FreeParameter],
        values: &[f64],
        without: &[Range<usize>],
    ) -> (DMatrix<f64>, DVector<f64>) {
        let mut h = DMatrix::zeros(free.len(), free.len());
        let mut g = DVector::zeros(free.len());
        for rows in self.counted_rows(without) {
            let (jacobian, residual) = (jacobian.rows_range(rows.clone()), residual.rows_range(rows));
            for k in 0..free.len() {
                g[k] += jacobian.column(k).dot(&residual);
                for l in 0..=k {
                    h[(k, l)] += jacobian.column(k).dot(&jacobian.column(l));
                }
            }
        }
        h.fill_upper_triangle_with_lower_triangle();
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
    /// amplitudes. `factor` and `base` are of [`WeakFormRegression::projector`].
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
        if self.is_stopped() {
            return None;
        }
        let (s, across) = self.information(projector, columns);
        let base = projector.factor.solve(&projector.gradient);
        let g = columns.tr_mul(&projector.residual) - across.tr_mul(&base);
        let amplitudes = -s.cholesky()?.solve(&g);
        Some((cost - projector.gradient.dot(&base) + amplitudes.dot(&g), amplitudes))
    }

    /// Deviations of the free parameters by how much the objects disagree about them, whatever the noise is (White,
    /// Econometrica 48 (1980) 817, with objects as clusters); `None` where there are too few objects.
    pub fn scatter(&self, models: &[Model], free: &[FreeParameter], values: &[f64]) -> Option<Vec<f64>> {
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
    pub fn projector(&self, models: &[Model], free: &[FreeParameter], values: &[f64]) -> Option<Projector> {
        let residual = self.residual(models, &flats(models, free, values));
        let jacobian = self.jacobian(models, free, values, &residual);
        let (h, gradient) = self.normal(&jacobian, &residual, free, values, &[]);
        Some(Projector { residual, factor: h.cholesky()?, jacobian, gradient })
    }
}

fn squares(residual: &DVector<f64>, rows: &[Range<usize>]) -> f64 {
    rows.iter().map(|r| residual.rows(r.start, r.len()).norm_squared()).sum()
}

/// What a law pays for masses that nobody gave and that it needs, in units of what `remains` (twice the logarithm of the Occam
/// factors; MacKay, Information Theory, Inference, and Learning Algorithms, 2003, 28.1): one that takes all for alike needs none.
fn occam_penalty(free: &[FreeParameter], sd: &[f64], remains: f64) -> f64 {
    let masses = free.iter().zip(sd).filter(|(f, _)| f.log);
    remains * masses.map(|(f, sd)| 2.0 * elementary::ln((f.sd / (sd * remains.sqrt())).max(1.0))).sum::<f64>()
}

/// See [`WeakFormRegression::projector`].
pub struct Projector {
    pub residual: DVector<f64>,
    jacobian: DMatrix<f64>,
    gradient: DVector<f64>,
    factor: nalgebra::Cholesky<f64, nalgebra::Dyn>,
}

impl Projector {
    /// The residual with the columns at these amplitudes, the parameters of the base moved with them ([`WeakFormRegression::joint`]).
    pub fn moved(&self, columns: &DMatrix<f64>, amplitudes: &[f64]) -> DVector<f64> {
        let added = columns * DVector::from_column_slice(amplitudes);
        let step = self.factor.solve(&(&self.gradient + self.jacobian.tr_mul(&added)));
        &self.residual + added - &self.jacobian * step
    }
}

/// Damping of [`WeakFormRegression::solve`].
const SCHEDULE: Schedule = Schedule {
    initial: 1e-6,
    min: 1e-9,
    max: f64::INFINITY,
    max_at_start: f64::INFINITY,
    min_after_rejection: 1e-6,
    growth: 20.0,
    trials: TRIALS,
    chord_below: 0.0,
    at_bounds: AtBounds::Clamp,
};

/// The lens's least-squares problem in the free parameters, without some rows.
struct WeakFormProblem<'p, 'a> {
    lens: &'p WeakFormRegression<'a>,
    models: &'p [Model],
    free: &'p [FreeParameter],
    without: &'p [Range<usize>],
    /// Scenes with rows that count.
    counted: Vec<usize>,
    bounds: Vec<Bounds>,
    /// The residual at the start, of all rows.
    residual: DVector<f64>,
}

impl LeastSquares for WeakFormProblem<'_, '_> {
    /// The residual.
    type Evaluation = DVector<f64>;
    type Linearization = ();
    type Error = Stopped;

    fn evaluate(&mut self, point: &[f64]) -> Option<(f64, DVector<f64>)> {
        let mut residual = self.residual.clone();
        let at = flats(self.models, self.free, point);
        for &scene in &self.counted {
            self.lens.write_scene(
                scene,
                &AccelerationField::new(&self.models[scene], &at[scene]),
                &mut residual,
            );
        }
        Some((self.lens.cost(&residual, self.free, point, self.without), residual))
    }
    fn linearize(&mut self, point: &[f64], known: Option<&DVector<f64>>) -> ((), NormalEquations) {
        let residual = known.unwrap_or(&self.residual);
        let jacobian = self.lens.slopes(self.models, self.free, point, residual, &self.counted);
        let (hessian, gradient) = self.lens.normal(&jacobian, residual, self.free, point, self.without);
        let cost = self.lens.cost(residual, self.free, point, self.without);
        ((), NormalEquations { cost, gradient, hessian })
    }
    fn bounds(&self) -> &[Bounds] {
        &self.bounds
    }
    fn tolerance(&self, _before: f64, after: f64) -> f64 {
        TOLERANCE * after
    }
    fn poll(&self, _progress: f64) -> Result<(), Stopped> {
        (self.lens.stop)(0.0)
    }
}

/// Fits the models' parameters as the lens sees them.
pub fn fit_forces(lens: &WeakFormRegression, models: &[Model]) -> (Vec<FreeParameter>, LensFit) {
    let free = free_parameters(lens.scenes, models);
    let seen = lens.fit(models, &free);
    (free, seen)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{DISC, film, models};
    use super::*;
    use crate::effects::effect;
    use crate::world::ActiveEffect;

    #[test]
    fn readings_are_apart_by_the_force_that_one_lacks() {
        let scenes = film(&[vec![(DISC, 1.0, [-1.0, 0.0], [1.0, 0.0])]], None);
        let (without, mut with) = (models(&scenes), models(&scenes));
        let wind = &effect("uniform_force").expect("it is in the library").spec;
        let mut active = ActiveEffect::new(wind, &with[0].bodies);
        active.parameters.iter_mut().zip([0.03, 0.04]).for_each(|(p, force)| p.values.fill(force));
        with[0].effects.push(active);
        let lens = WeakFormRegression::new(&scenes);
        let expected = 0.05 / with[0].bodies[0].mass;
        for told in lens.apart(&with, &without) {
            assert!((told - expected).abs() < 1e-9, "{told} is not {expected}");
        }
        assert_eq!(lens.apart(&with, &with), [0.0, 0.0]);
    }
}
