//! Frames that the camera lost though numbers and times go on: all objects leap ahead at once.
//!
//! For each pair of neighbouring frames, the samples on both sides of all objects are fitted by one parabola an object, the later
//! ones n frame times later: chi^2(n) is the sum of squared residuals over the noise variance. Frames are lost where some n >= 1
//! brings chi^2 down to the noise from far above it. A contact changes velocities, which no n explains.

use super::finding::{FindingKind, TrackFinding};
use super::position_sd;
use super::sides::{PROOF, Sides, is_noise};
use crate::num::quantile;
use crate::scene::observation::Scene;

/// Most frames that are lost in one place.
const MOST: usize = 25;

/// Shifts the times after lost frames, and says so.
pub fn take_in_lost_frames(scene: &mut Scene, step: f64) -> Option<TrackFinding> {
    let mut gaps: Vec<f64> = scene.times.windows(2).map(|w| w[1] - w[0]).collect();
    let frame_time = quantile(&mut gaps, 0.5)?;
    let noises: Vec<f64> = scene.tracks.iter().map(|t| position_sd(&t.samples, step)).collect();
    let (mut frames, mut total) = (vec![], 0);
    for frame in 0..scene.times.len().saturating_sub(1) {
        let sides = Sides::of(scene, frame, &noises);
        if !sides.leap() {
            continue;
        }
        let chi_square = |n: usize| sides.chi_square(n as f64 * frame_time);
        let best = (1..=MOST).map(|n| (n, chi_square(n))).min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((lost, least)) = best else { continue };
        if is_noise(least, sides.degrees_of_freedom()) && chi_square(0) - least > PROOF {
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
