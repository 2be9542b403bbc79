//! How the tracks were measured, examined before any physics: what is no measurement is left out or put right, and all that was
//! found is reported.
//!
//! | part | finds |
//! |---|---|
//! | `finding` | the findings as data, and their sentences |
//! | `steps` | positions in steps, such as whole pixels |
//! | `repeats` | frames, and positions, that stand still |
//! | `frame_times` | frames that are missing though numbers go on; a frame rate that changes |
//! | `camera_motion` | bumps and shakes of the camera, which all objects have in common |
//! | `slow_camera` | drift, sway and zoom of the camera, which objects at rest show |
//! | `sides` | the samples of all objects beside a pair of frames, for the two before |
//! | `markers`, `ends`, `interpolated` | values for "not seen"; a first or last position that is off; positions that were filled in |
//! | `identities` | tracks that leap to something else, and exchanged identities |
//! | `uneven_noise` | noise that differs by object |
//! | `dependence` | errors of neighbouring frames that depend on each other |

mod camera_motion;
mod dependence;
mod ends;
mod finding;
mod frame_times;
mod identities;
mod interpolated;
mod markers;
mod repeats;
mod sides;
mod slow_camera;
mod steps;
#[cfg(test)]
mod tests;
mod uneven_noise;

pub use dependence::dependence;
pub use finding::{FindingKind, TrackFinding};
pub use steps::step;

use crate::num::{Stop, Stopped, quantile};
use crate::scene::covariance::Covariance;
use crate::scene::observation::{Outlier, Sample, Scene};
use camera_motion::{take_out_bumps, take_out_shake};
use ends::leave_out_ends;
use frame_times::{take_in_lost_frames, take_in_rate_changes};
use identities::put_identities_right;
use interpolated::leave_out_interpolated;
use markers::leave_out_markers;
use repeats::leave_out_repeats;
use slow_camera::take_out_slow_motion;
use uneven_noise::state_uneven_noise;

/// A step shows where it is larger than this share of the noise.
const COARSE: f64 = 1.0;

/// Examines a scene whose values are all in their bounds. What was found before, and leaves no trace, stays found.
pub(in crate::scene) fn examine(scene: &mut Scene, stop: Stop) -> Result<(), Stopped> {
    let mut found = leave_out_markers(scene);
    let step = step(scene);
    stop(0.0)?;
    found.extend(leave_out_repeats(scene, step));
    stop(0.0)?;
    found.extend(leave_out_interpolated(scene, step));
    stop(0.0)?;
    found.extend(take_in_lost_frames(scene, step, stop)?);
    stop(0.0)?;
    found.extend(take_out_bumps(scene, step, stop)?);
    stop(0.0)?;
    found.extend(put_identities_right(scene, step));
    stop(0.0)?;
    found.extend(take_out_slow_motion(scene, step));
    stop(0.0)?;
    // Of a video's outlines the covariances hold what neighbouring frames share.
    let ratio = if states_noise(scene) { 1.0 } else { dependence(scene, step) };
    if ratio <= 1.0 {
        // Of dependent errors an end has others than the rest, and a contact shows for longer.
        found.extend(take_in_rate_changes(scene, step));
        found.extend(leave_out_ends(scene, step));
    }
    // Where one track is on another object, both have all in common.
    stop(0.0)?;
    found.extend(take_out_shake(scene, step));
    stop(0.0)?;
    found.extend(state_uneven_noise(scene, step));
    let finding = |kind, value| TrackFinding { kind, objects: vec![], frames: vec![], value };
    let noise = position_sds(scene, 0.0).into_iter().fold(f64::INFINITY, f64::min);
    if step > COARSE * noise && is_rounded(scene, step) {
        found.push(finding(FindingKind::Steps, step));
    }
    if ratio > 1.0 {
        found.push(finding(FindingKind::DependentNoise, ratio));
    }
    let known = std::mem::take(&mut scene.findings);
    let lost = |old: &TrackFinding| found.iter().all(|new| new != old);
    let earlier: Vec<TrackFinding> = known.into_iter().filter(lost).collect();
    scene.findings = [earlier, found].concat();
    Ok(())
}

/// Whether the noise is known, with the covariance of each position.
fn states_noise(scene: &Scene) -> bool {
    let mut samples = scene.tracks.iter().flat_map(|t| &t.samples);
    scene.noise_sigma.is_some() && samples.all(|s| s.covariance.is_some())
}

/// Moves samples that are no measurement to the outliers; they are at no distance from anything. Returns their frames.
fn leave_out(scene: &mut Scene, object: usize, is_none: impl Fn(&Sample) -> bool) -> Vec<usize> {
    let samples = std::mem::take(&mut scene.tracks[object].samples);
    let (gone, kept): (Vec<Sample>, Vec<Sample>) = samples.into_iter().partition(is_none);
    let frames = gone.iter().map(|s| s.frame).collect();
    scene.tracks[object].samples = kept;
    scene.outliers.extend(gone.into_iter().map(|sample| Outlier { object, sample, distance: 0.0 }));
    frames
}

/// Whether positions lie beside a line through their neighbours as rounding to the step makes them, and uniform motion by
/// whole steps does not.
fn is_rounded(scene: &Scene, step: f64) -> bool {
    let beside = |w: &[Sample]| {
        let even = w[0].frame + w[2].frame == 2 * w[1].frame;
        even.then(|| (w[0].position + w[2].position - w[1].position.scaled(2.0)).norm() > 0.5 * step)
    };
    let all: Vec<bool> = scene.tracks.iter().flat_map(|t| t.samples.windows(3)).filter_map(beside).collect();
    all.iter().filter(|b| **b).count() as f64 > ROUNDED * all.len() as f64
}

/// Share of the samples that rounding puts beside the line, at least: what rests or moves by whole steps is on it.
const ROUNDED: f64 = 0.05;

/// Standard deviation of a coordinate of a track (m), from the median of its second differences; at least that of rounding to the
/// step, and what the samples state: outlines in a video err alike in neighbouring frames, and do not scatter. The squared length of two
/// independent normal numbers has the median 2 ln 2.
fn position_sd(samples: &[Sample], step: f64) -> f64 {
    let second = |w: &[Sample]| {
        let share = (w[1].frame - w[0].frame) as f64 / (w[2].frame - w[0].frame) as f64;
        let line = w[0].position.scaled(1.0 - share) + w[2].position.scaled(share);
        (w[1].position - line).norm() / (1.0 + share * share + (1.0 - share) * (1.0 - share)).sqrt()
    };
    let mut all: Vec<f64> = samples.windows(3).map(second).collect();
    let median = quantile(&mut all, 0.5).unwrap_or(0.0) / (2.0 * std::f64::consts::LN_2).sqrt();
    let stated = Covariance::mean_variance(samples.iter().map(|s| s.covariance)).unwrap_or(0.0).sqrt();
    median.max(step / 12.0_f64.sqrt()).max(stated).max(SMALLEST)
}

/// The same of each track.
fn position_sds(scene: &Scene, step: f64) -> Vec<f64> {
    scene.tracks.iter().map(|t| position_sd(&t.samples, step)).collect()
}

/// Least deviation of a position (m): less is round-off.
const SMALLEST: f64 = 1e-9;
