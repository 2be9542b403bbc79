//! Frames that the camera lost though numbers and times go on: all objects leap ahead at once.
//!
//! For each pair of neighbouring frames, the samples on both sides of all objects are fitted by one parabola an object, the later
//! ones n frame times later: chi^2(n) is the sum of squared residuals over the noise variance. Frames are lost where some n >= 1
//! brings chi^2 down to the noise from far above it. A contact changes velocities, which no n explains.

use super::finding::{FindingKind, TrackFinding};
use super::position_sd;
use crate::num::{elementary, quantile};
use crate::scene::observation::{Sample, Scene};
use nalgebra::{Matrix3, Vector3};

/// Samples on each side of a pair of frames, and fewest of them.
const SIDE: usize = 6;
const FEWEST: usize = 3;
/// Most frames that are lost in one place.
const MOST: usize = 25;
/// Fall of chi-square that shows a loss: odds of 10^6 to 1 among all pairs of a film of 10,000 frames and all n.
const PROOF: f64 = 52.0;
/// A leap that is worth a look (deviations of the difference of three positions).
const LEAP: f64 = 5.0;

/// Shifts the times after lost frames, and says so.
pub fn take_in_lost_frames(scene: &mut Scene, step: f64) -> Option<TrackFinding> {
    let mut gaps: Vec<f64> = scene.times.windows(2).map(|w| w[1] - w[0]).collect();
    let frame_time = quantile(&mut gaps, 0.5)?;
    let noises: Vec<f64> = scene.tracks.iter().map(|t| position_sd(&t.samples, step)).collect();
    let (mut frames, mut total) = (vec![], 0);
    for frame in 0..scene.times.len().saturating_sub(1) {
        let sides: Vec<Side> = scene
            .tracks
            .iter()
            .zip(&noises)
            .filter_map(|(track, noise)| Side::of(scene, &track.samples, frame, *noise))
            .collect();
        if !sides.iter().any(|side| side.leaps()) {
            continue;
        }
        let chi_square = |n: usize| sides.iter().map(|s| s.chi_square(n as f64 * frame_time)).sum::<f64>();
        let degrees: f64 = sides.iter().map(Side::degrees_of_freedom).sum();
        let best = (1..=MOST).map(|n| (n, chi_square(n))).min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((lost, least)) = best else { continue };
        // To the noise: within what chance and a noise that is a fifth too small leave.
        let explained = least < 1.5 * degrees + 4.0 * (2.0 * degrees).sqrt();
        if explained && chi_square(0) - least > PROOF {
            scene.times[frame + 1..].iter_mut().for_each(|t| *t += lost as f64 * frame_time);
            frames.push(frame);
            total += lost;
        }
    }
    (total > 0).then(|| TrackFinding {
        kind: FindingKind::LostFrames,
        objects: vec![],
        frames,
        value: total as f64,
    })
}

/// One object's samples beside a pair of frames: time (s), position in deviations, and whether it is after the pair.
struct Side {
    points: Vec<(f64, [f64; 2], bool)>,
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
        Some(Side { points: samples[first..last].iter().enumerate().map(point).collect() })
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
}
