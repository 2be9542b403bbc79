//! Shake of the camera: what moves all images of resting bodies alike.
//!
//! In the image, a body that moves slowly follows a straight line for `2 HALF_WINDOW + 1` frames. With r_ik the residual of body i
//! in frame k from that line (px), the shift of frame k is the median of r_ik over the bodies that are nearly at rest. The camera
//! shakes if the residuals of different bodies agree: `sum r_i . r_j / sum (|r_i|^2 + |r_j|^2)/2 >= LEAST_COHERENCE` over pairs.
//! The shift is then taken off all bodies of the frame. A drift that is slower than the window is not seen.

use super::body_track::{BodyTrack, Placement, shifted_covariance};
use crate::num::median;
use crate::perception::outlines::viewpoint::Viewpoint;
use crate::scene::Covariance;

/// Frames on each side over which the line is fitted: 0.3 s at 25 frames/s. The fit takes 1/17 of the shake's variance.
const HALF_WINDOW: usize = 8;
/// Fewest placed frames in a window.
const LEAST_IN_WINDOW: usize = 9;
/// Largest speed of a body that counts (px/frame): a shake of 0.5 px changes the slope over a window by 0.025.
const SLOW: f64 = 0.08;
/// Least visible share: what others hide is less exact.
const LEAST_VISIBLE: f64 = 0.6;
/// Least coherence, and least pairs of bodies in a frame that prove it.
const LEAST_COHERENCE: f64 = 0.5;
const LEAST_PAIRS: usize = 20;
/// Least shake (px, each coordinate) where bodies agree, and of both coordinates where one body alone shows it: its own noise is
/// 0.05, and where its outline is uncertain, it is so along one line.
const LEAST_SHAKE: f64 = 0.08;
const LEAST_SHAKE_ALONE: f64 = 0.2;

/// How the camera shakes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shake {
    /// Deviation of each coordinate (px).
    pub rms: f64,
    /// Frames in which it was taken off.
    pub corrected: usize,
}

type ShakePoint = [f64; 2];

/// Takes the shake off the tracks; `None` where the camera is at rest.
pub(super) fn remove_shake(tracks: &mut [BodyTrack], view: &Viewpoint) -> Option<Shake> {
    let frames = tracks.iter().map(|t| t.placements.len()).max()?;
    let mut residuals: Vec<Vec<ShakePoint>> = vec![vec![]; frames];
    for track in tracks.iter() {
        for (k, residual) in slow_residuals(&pixels(track, view)) {
            residuals[k].push(residual);
        }
    }
    let rms = shake_of(&residuals)?;
    let mut corrected = 0;
    for (k, of_frame) in residuals.iter_mut().enumerate() {
        let shift = [0, 1].map(|c| {
            let mut values: Vec<f64> = of_frame.iter().map(|r| r[c]).collect();
            median(&mut values)
        });
        let known = if let [Some(u), Some(v)] = shift { Some([u, v]) } else { None };
        corrected += usize::from(known.is_some());
        for track in tracks.iter_mut() {
            correct(track, view, k, known, rms);
        }
    }
    Some(Shake { rms, corrected })
}

/// Moves a body back by the known shift; else its covariance grows by that of the shake.
fn correct(track: &mut BodyTrack, view: &Viewpoint, frame: usize, shift: Option<ShakePoint>, rms: f64) {
    let Some(Some(placement)) = track.placements.get_mut(frame) else { return };
    let size = placement.pose.size;
    let Some([u, v]) = view.pixel([placement.pose.at.x, placement.pose.at.y, size]) else { return };
    match shift {
        Some([du, dv]) => {
            if let Some(at) = view.locate([u - du, v - dv], size) {
                placement.pose.at = at;
            }
        }
        None => {
            if let Some(more) = shifted_covariance(view, &placement.pose, rms) {
                let c = placement.covariance;
                placement.covariance =
                    Covariance { xx: c.xx + more.xx, xy: c.xy + more.xy, yy: c.yy + more.yy };
            }
        }
    }
}

/// Where the images of a body's centre are, by frame.
fn pixels(track: &BodyTrack, view: &Viewpoint) -> Vec<Option<ShakePoint>> {
    let pixel = |p: &Option<Placement>| {
        let p = p.as_ref().filter(|p| p.visible_share() >= LEAST_VISIBLE)?;
        view.pixel([p.pose.at.x, p.pose.at.y, p.pose.size])
    };
    track.placements.iter().map(pixel).collect()
}

/// Frames in which the body is slow, and its residuals from the lines.
fn slow_residuals(pixels: &[Option<ShakePoint>]) -> Vec<(usize, ShakePoint)> {
    let mut found = vec![];
    for (k, pixel) in pixels.iter().enumerate() {
        let Some(pixel) = pixel else { continue };
        let range = k.saturating_sub(HALF_WINDOW)..(k + HALF_WINDOW + 1).min(pixels.len());
        let window: Vec<(f64, ShakePoint)> =
            range.filter_map(|j| Some((j as f64 - k as f64, pixels[j]?))).collect();
        let count = window.len() as f64;
        if window.len() < LEAST_IN_WINDOW {
            continue;
        }
        let time = window.iter().map(|w| w.0).sum::<f64>() / count;
        let spread = window.iter().map(|w| (w.0 - time) * (w.0 - time)).sum::<f64>().max(1e-9);
        let mean = [0, 1].map(|c| window.iter().map(|w| w.1[c]).sum::<f64>() / count);
        let slope = [0, 1].map(|c| window.iter().map(|w| (w.0 - time) * w.1[c]).sum::<f64>() / spread);
        if slope[0] * slope[0] + slope[1] * slope[1] < SLOW * SLOW {
            found.push((k, [0, 1].map(|c| pixel[c] - mean[c] + slope[c] * time)));
        }
    }
    found
}

/// The deviation of the shake (px, each coordinate), from the residuals by frame.
fn shake_of(residuals: &[Vec<ShakePoint>]) -> Option<f64> {
    let dot = |a: &ShakePoint, b: &ShakePoint| a[0] * b[0] + a[1] * b[1];
    let (mut common, mut all, mut pairs) = (0.0, 0.0, 0usize);
    let (mut alone, mut count) = ([0.0; 2], 0usize);
    for of_frame in residuals {
        for (i, a) in of_frame.iter().enumerate() {
            (alone, count) = ([alone[0] + a[0] * a[0], alone[1] + a[1] * a[1]], count + 1);
            for b in &of_frame[..i] {
                common += 0.5 * dot(a, b);
                all += 0.25 * (dot(a, a) + dot(b, b));
                pairs += 1;
            }
        }
    }
    let rms = |sum: f64, count: usize| (f64::max(sum, 0.0) / count.max(1) as f64).sqrt();
    let (rms, least) = if pairs >= LEAST_PAIRS {
        (if common >= LEAST_COHERENCE * all { rms(common, pairs) } else { 0.0 }, LEAST_SHAKE)
    } else {
        (if count >= LEAST_PAIRS { rms(alone[0].min(alone[1]), count) } else { 0.0 }, LEAST_SHAKE_ALONE)
    };
    (rms >= least).then_some(rms)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(k: usize, salt: usize) -> f64 {
        ((k * 7919 + salt * 104_729) % 1000) as f64 / 1000.0 - 0.5
    }

    #[test]
    fn a_common_shift_is_shake_and_single_ones_are_not() {
        let line = |k: usize, own: f64, common: f64, salt: usize| {
            let at = |c: usize| 50.0 + own * noise(k, salt + c) + common * noise(k, c);
            Some([at(0), at(1)])
        };
        let residuals = |own: f64, common: f64| {
            let mut all = vec![vec![]; 60];
            for salt in [10, 20, 30] {
                let pixels: Vec<_> = (0..60).map(|k| line(k, own, common, salt)).collect();
                slow_residuals(&pixels).into_iter().for_each(|(k, r)| all[k].push(r));
            }
            all
        };
        // A uniform distribution of width 1 has the deviation 0.289.
        let shake = shake_of(&residuals(0.1, 1.0)).unwrap();
        assert!((shake - 0.289).abs() < 0.05, "{shake}");
        assert_eq!(shake_of(&residuals(1.0, 0.0)), None);
        assert_eq!(shake_of(&residuals(0.1, 0.1)), None);
    }

    #[test]
    fn a_fast_body_says_nothing() {
        let pixels: Vec<_> = (0..40).map(|k| Some([3.0 * k as f64, 5.0])).collect();
        assert!(slow_residuals(&pixels).is_empty());
    }
}
