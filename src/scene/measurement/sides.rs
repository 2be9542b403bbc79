//! The samples of all objects on both sides of a pair of neighbouring frames, and what a parabola for each object leaves of them.

use crate::num::elementary;
use crate::scene::observation::{Sample, Scene};
use nalgebra::{Matrix3, Vector3};

/// Samples on each side of a pair of frames, and fewest of them.
const SIDE: usize = 6;
const FEWEST: usize = 3;
/// Fall of chi-square that shows an event: odds of 10^6 to 1 among all pairs of a video of 10,000 frames and some ten sizes.
pub const PROOF: f64 = 52.0;
/// The same that one object must show of a displacement of all: odds of 1000 to 1.
const SHOWS: f64 = 14.0;
/// A leap that is worth a look (deviations of the difference of three positions).
const LEAP: f64 = 2.5;

/// Whether chance, and a noise that is a tenth too small, leave this chi-square.
pub fn is_noise(chi_square: f64, degrees: f64) -> bool {
    chi_square < 1.2 * degrees + 4.0 * (2.0 * degrees).sqrt()
}

/// Those of all objects that were seen on both sides.
pub struct Sides(Vec<Side>);

impl Sides {
    /// `noises` are the deviations of the tracks (m).
    pub fn of(scene: &Scene, frame: usize, noises: &[f64]) -> Sides {
        let all = scene.tracks.iter().zip(noises);
        Sides(all.filter_map(|(track, noise)| Side::of(scene, &track.samples, frame, *noise)).collect())
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether any object leaps over the pair.
    pub fn leap(&self) -> bool {
        self.0.iter().any(Side::leaps)
    }

    pub fn degrees_of_freedom(&self) -> f64 {
        self.0.iter().map(Side::degrees_of_freedom).sum()
    }

    /// What parabolas leave where the later samples are `shift` (s) later.
    pub fn chi_square(&self, shift: f64) -> f64 {
        self.0.iter().map(|side| side.chi_square(shift)).sum()
    }

    /// The displacement of all later samples (m) that leaves least, and by how much it lowers chi-square; by nothing unless each object
    /// shows one.
    pub fn displacement(&self) -> ([f64; 2], f64) {
        let (mut weight, mut shift, mut fall) = (0.0, [0.0; 2], 0.0);
        for side in &self.0 {
            let (own, along) = side.step_share();
            if (along[0] * along[0] + along[1] * along[1]) / own.max(f64::MIN_POSITIVE) < SHOWS {
                return ([0.0; 2], 0.0);
            }
            weight += own / (side.noise * side.noise);
            (0..2).for_each(|c| shift[c] += along[c] / side.noise);
        }
        if weight <= 0.0 {
            return (shift, 0.0);
        }
        for c in &mut shift {
            fall += *c * *c / weight;
            *c /= weight;
        }
        (shift, fall)
    }
}

/// One object's samples beside a pair of frames: time (s), position in deviations, and whether it is after the pair.
struct Side {
    points: Vec<(f64, [f64; 2], bool)>,
    /// m.
    noise: f64,
}

impl Side {
    fn of(scene: &Scene, samples: &[Sample], frame: usize, noise: f64) -> Option<Side> {
        let after = samples.partition_point(|s| s.frame <= frame);
        let (first, last) = (after.saturating_sub(SIDE), (after + SIDE).min(samples.len()));
        let near = |s: &Sample| s.frame + 2 * SIDE > frame && s.frame < frame + 2 * SIDE;
        if after < first + FEWEST
            || last < after + FEWEST
            || !near(&samples[first])
            || !near(&samples[last - 1])
        {
            return None;
        }
        let start = scene.time_of(frame);
        let point = |(k, s): (usize, &Sample)| {
            let at = s.position.scaled(1.0 / noise);
            (scene.time_of(s.frame) - start, [at.x, at.y], first + k >= after)
        };
        Some(Side { points: samples[first..last].iter().enumerate().map(point).collect(), noise })
    }

    fn degrees_of_freedom(&self) -> f64 {
        2.0 * (self.points.len() as f64 - 3.0)
    }

    /// Whether the step over the pair is another than those beside it.
    fn leaps(&self) -> bool {
        let after = self.points.partition_point(|p| !p.2);
        let step = |k: usize| -> Option<[f64; 2]> {
            let (a, b) = (self.points.get(k.checked_sub(1)?)?, self.points.get(k)?);
            Some([0, 1].map(|c| (b.1[c] - a.1[c]) / (b.0 - a.0).max(f64::MIN_POSITIVE)))
        };
        let (Some(before), Some(over), Some(behind)) = (step(after - 1), step(after), step(after + 1)) else {
            return false;
        };
        let time = self.points[after].0 - self.points[after - 1].0;
        let off = |c: usize| (over[c] - 0.5 * (before[c] + behind[c])) * time;
        // Of a step less the mean of its neighbours: variance 2 + 2 * 2 / 4 + 2 (they share a position each).
        elementary::hypot(off(0), off(1)) > LEAP * 5.0_f64.sqrt()
    }

    /// What a parabola leaves of the points, the later ones `shift` (s) later.
    fn chi_square(&self, shift: f64) -> f64 {
        let (mut normal, mut right, mut squares) = (Matrix3::zeros(), [Vector3::zeros(); 2], 0.0);
        for (time, at, after) in &self.points {
            let t = if *after { time + shift } else { *time };
            let row = Vector3::new(1.0, t, t * t);
            normal += row * row.transpose();
            for c in 0..2 {
                right[c] += row * at[c];
                squares += at[c] * at[c];
            }
        }
        let Some(solver) = normal.cholesky() else { return f64::INFINITY };
        let explained: f64 = right.iter().map(|right| right.dot(&solver.solve(right))).sum();
        (squares - explained).max(0.0)
    }

    /// The square of a unit step over the pair that no parabola takes up, and its product with the samples.
    fn step_share(&self) -> (f64, [f64; 2]) {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        let (mut square, mut with, mut along) = (0.0, [Vector3::zeros(); 2], [0.0; 2]);
        for (t, at, after) in &self.points {
            let row = Vector3::new(1.0, *t, t * t);
            normal += row * row.transpose();
            (0..2).for_each(|c| with[c] += row * at[c]);
            if *after {
                right += row;
                square += 1.0;
                (0..2).for_each(|c| along[c] += at[c]);
            }
        }
        let Some(solver) = normal.cholesky() else { return (0.0, [0.0; 2]) };
        let taken = solver.solve(&right);
        (square - right.dot(&taken), [0, 1].map(|c| along[c] - with[c].dot(&taken)))
    }
}
