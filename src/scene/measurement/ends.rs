//! A first or last position that is off: trackers often start, and lose, an object beside it.
//!
//! The n samples next to it are fitted by a parabola, which predicts it with the deviation sigma sqrt(1 + g), where g follows
//! from the design (Seber and Lee, Linear Regression Analysis, sec. 5.3). It is left out where it is farther than `FAR` of these, though
//! the parabola describes its own samples.

use super::finding::{FindingKind, TrackFinding};
use super::position_sd;
use super::sides::is_noise;
use crate::num::elementary;
use crate::scene::observation::{Outlier, Sample, Scene};
use nalgebra::{Matrix3, Vector3};

/// Samples of the parabola.
const SAMPLES: usize = 8;
/// Deviations of the prediction: odds of 10^6 to 1 in two coordinates, for some hundred ends, and a noise that is a half too small.
const FAR: f64 = 12.0;

/// Moves ends that are off to the outliers, and says so.
pub fn leave_out_ends(scene: &mut Scene, step: f64) -> Vec<TrackFinding> {
    let mut found = vec![];
    for object in 0..scene.tracks.len() {
        let samples = &scene.tracks[object].samples;
        if samples.len() < 2 * SAMPLES {
            continue;
        }
        // Rounding of what moves little is no chance.
        let noise = elementary::hypot(position_sd(samples, step), step);
        let first: Vec<&Sample> = samples.iter().take(SAMPLES + 1).collect();
        let last: Vec<&Sample> = samples.iter().rev().take(SAMPLES + 1).collect();
        let off = [is_off(scene, &first, noise), is_off(scene, &last, noise)];
        for (at_end, distance) in [(false, off[0]), (true, off[1])] {
            let Some(distance) = distance else { continue };
            let samples = &mut scene.tracks[object].samples;
            let sample = if at_end { samples.remove(samples.len() - 1) } else { samples.remove(0) };
            let (kind, objects) = (FindingKind::Leaps, vec![scene.objects[object].id]);
            found.push(TrackFinding { kind, objects, frames: vec![sample.frame], value: 1.0 });
            scene.outliers.push(Outlier { object, sample, distance });
        }
    }
    found
}

/// How far the first of the samples is from where the others lead (m), if that is too far.
fn is_off(scene: &Scene, samples: &[&Sample], noise: f64) -> Option<f64> {
    let (end, others) = samples.split_first()?;
    let time = |s: &Sample| scene.time_of(s.frame) - scene.time_of(end.frame);
    let unit = others.iter().map(|s| time(s).abs()).fold(0.0, f64::max);
    let row = |s: &Sample| {
        let t = time(s) / unit;
        Vector3::new(1.0, t, t * t)
    };
    let (mut normal, mut right) = (Matrix3::zeros(), [Vector3::zeros(); 2]);
    for s in others {
        normal += row(s) * row(s).transpose();
        right[0] += row(s) * s.position.x;
        right[1] += row(s) * s.position.y;
    }
    let inverse = normal.try_inverse()?;
    let fitted = right.map(|right| inverse * right);
    let at = |s: &Sample| fitted.map(|fitted| fitted.dot(&row(s)));
    let distance = |s: &Sample| (s.position - crate::num::vec2(at(s)[0], at(s)[1])).norm();
    let left: f64 = others.iter().map(|s| distance(s) * distance(s)).sum::<f64>() / (noise * noise);
    let deviation = noise * (1.0 + inverse[(0, 0)]).sqrt();
    let off = distance(end);
    (off > FAR * deviation && is_noise(left, 2.0 * others.len() as f64 - 6.0)).then_some(off)
}
