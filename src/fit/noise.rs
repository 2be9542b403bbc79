//! Measurement noise, estimated from the tracks alone.
//!
//! Of three samples a, b, c in near frames at times t_a < t_b < t_c, the middle one's distance from the straight line through
//! the others is d = b - (1 - q) a - q c, with q = (t_b - t_a) / (t_c - t_a). Smooth motion leaves almost none, so that d is noise of
//! covariance C_b + (1 - q)^2 C_a + q^2 C_c. The estimate of the standard deviation is the upper median of the whitened |d|,
//! divided by that of a standard normal number (0.6745): the few impacts hardly change a median. Samples that state covariances
//! keep their ratios; their common scale is estimated, and is not less than the noise that such a scene states: the outlines of a video
//! have errors that all frames share (shadows, mirrored neighbours), so that the tracks scatter by much less than they err.
//!
//! Positions in steps q (whole pixels) would make |d| a multiple of q / 2: each is shifted by a number of its own between -q/2 and q/2,
//! whose variance q^2 / 12 is taken off again. What remains is at least that of the rounding itself, q^2 / 12. Where errors of
//! neighbouring frames depend on each other, the estimate is of fast errors; a fit meets the slow ones, and it is multiplied by their ratio.

use crate::num::{NORMAL_MEDIAN_ABSOLUTE, Vec2, elementary, quantile, vec2};
use crate::scene::{Covariance, FindingKind, Sample, Scene, Track, TrackFinding};

/// Fewest second differences that make an estimate.
const ENOUGH: usize = 12;
/// Noise that is assumed if neither the tracks nor the user give it (m; yaws: twice as many rad).
const FALLBACK: f64 = 0.005;
/// Least noise (m, rad): less would make every model inadequate by round-off.
const SMALLEST: f64 = 1e-6;

/// Standard deviations of the measurements of one scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Of each coordinate of a position (m), root mean square over the samples.
    pub position: f64,
    /// Of a yaw (rad); `None` where no yaw that matters was measured.
    pub yaw: Option<f64>,
    /// Mean variance of the covariances that samples state (m^2), whose estimate is `position` squared.
    stated: f64,
}

/// Turns the error of a position (m) into two independent ones of unit deviation: rows `[xx, 0]` and `[yx, yy]` (1/m).
#[derive(Debug, Clone, Copy)]
pub(super) struct Whitener {
    xx: f64,
    yx: f64,
    yy: f64,
}

impl Whitener {
    fn of(covariance: &Covariance) -> Whitener {
        // A covariance without a factor (validation refuses it) is replaced by its mean variance.
        let mean = covariance.mean().abs().sqrt();
        let [xx, yx, yy] = covariance.factor().unwrap_or([mean, 0.0, mean]);
        Whitener { xx: 1.0 / xx, yx: -yx / (xx * yy), yy: 1.0 / yy }
    }

    pub fn apply(&self, x: f64, y: f64) -> [f64; 2] {
        [self.xx * x, self.yx * x + self.yy * y]
    }
}

impl Noise {
    /// The noise of a scene whose position noise (m) was estimated before.
    pub(super) fn of_fit(scene: &Scene, position: f64) -> Noise {
        Noise { position, yaw: None, stated: stated(scene) }
    }

    /// Covariance of a sample (m^2), given the one that it states.
    pub(super) fn covariance(&self, stated: Option<Covariance>) -> Covariance {
        let variance = self.position * self.position;
        match stated {
            Some(c) => c.scaled(variance / self.stated),
            None => Covariance { xx: variance, xy: 0.0, yy: variance },
        }
    }

    /// Whitener of a sample, given the covariance that it states.
    pub(super) fn whitener(&self, stated: Option<Covariance>) -> Whitener {
        Whitener::of(&self.covariance(stated))
    }

    /// The noise of one track: `position` is the root mean square over its own samples.
    pub fn of_track(&self, track: &Track) -> Noise {
        if track.samples.iter().all(|s| s.covariance.is_none()) {
            return *self;
        }
        let sum: f64 = track.samples.iter().map(|s| self.covariance(s.covariance).mean()).sum();
        let variance = sum / track.samples.len() as f64;
        let stated = self.stated * variance / (self.position * self.position);
        Noise { position: variance.sqrt(), stated, ..*self }
    }
}

/// Mean variance of the covariances that the samples state (m^2); 1 where none does.
fn stated(scene: &Scene) -> f64 {
    let samples = scene.tracks.iter().flat_map(|t| &t.samples);
    Covariance::mean_variance(samples.map(|s| s.covariance)).unwrap_or(1.0)
}

/// The noise of a scene's positions and yaws.
pub fn estimate(scene: &Scene) -> Noise {
    let stated = stated(scene);
    let (mut positions, mut yaws) = whitened_differences(scene, stated);
    let any_stated = scene.tracks.iter().flat_map(|t| &t.samples).any(|s| s.covariance.is_some());
    let given = scene.noise_sigma.filter(|sigma| *sigma > 0.0);
    let assumed = given.unwrap_or(if any_stated { stated.sqrt() } else { FALLBACK });
    let rounding = scene.finding(FindingKind::Steps).unwrap_or(0.0) / 12.0_f64.sqrt();
    let shifted = standard_deviation(&mut positions).unwrap_or(assumed);
    let fast = (shifted * shifted - rounding * rounding).max(rounding * rounding).sqrt();
    let dependence = scene.finding(FindingKind::DependentNoise).unwrap_or(1.0);
    // Errors that neighbouring frames share do not scatter.
    let least = given.filter(|_| any_stated).unwrap_or(SMALLEST);
    let position = elementary::hypot(dependence * fast, shake(scene)).max(least);
    let any_yaw = scene
        .objects
        .iter()
        .zip(&scene.tracks)
        .any(|(o, t)| !o.shape.is_ball() && t.samples.iter().any(|s| s.yaw.is_some()));
    let yaw = any_yaw.then(|| standard_deviation(&mut yaws).unwrap_or(2.0 * FALLBACK).max(SMALLEST));
    Noise { position, yaw, stated }
}

/// Deviation of what a shaking camera leaves in a coordinate (m): what is slow in it cannot be distinguished from motion.
fn shake(scene: &Scene) -> f64 {
    let shakes = |f: &&TrackFinding| f.kind == FindingKind::MovingCamera && f.frames.is_empty();
    scene.findings.iter().find(shakes).map_or(0.0, |f| f.value / std::f64::consts::SQRT_2)
}

/// Absolute values of the whitened second differences of positions, in units of the mean stated deviation (`stated` is its
/// square, 1 if nothing is stated), and of yaws (rad).
fn whitened_differences(scene: &Scene, stated: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut positions, mut yaws) = (vec![], vec![]);
    let relative = |s: &Sample| {
        s.covariance.map_or(Covariance { xx: 1.0, xy: 0.0, yy: 1.0 }, |c| c.scaled(1.0 / stated))
    };
    let step = scene.finding(FindingKind::Steps).unwrap_or(0.0);
    for (object, track) in scene.objects.iter().zip(&scene.tracks) {
        let at = |s: &Sample| s.position + within_step(object.id, s.frame).scaled(step);
        second_differences(scene, track, |[a, b, c], share| {
            let off = at(b) - at(a).scaled(1.0 - share) - at(c).scaled(share);
            let (wa, wc) = ((1.0 - share) * (1.0 - share), share * share);
            let (ca, cb, cc) = (relative(a), relative(b), relative(c));
            let sum = |f: fn(&Covariance) -> f64| f(&cb) + wa * f(&ca) + wc * f(&cc);
            let spread = Covariance { xx: sum(|c| c.xx), xy: sum(|c| c.xy), yy: sum(|c| c.yy) };
            positions.extend(Whitener::of(&spread).apply(off.x, off.y).map(f64::abs));
        });
        if !object.shape.is_ball() {
            second_differences(scene, track, |[a, b, c], share| {
                if let (Some(a), Some(b), Some(c)) = (a.yaw, b.yaw, c.yaw) {
                    let scale = (1.0 + share * share + (1.0 - share) * (1.0 - share)).sqrt();
                    yaws.push(((b - a * (1.0 - share) - c * share) / scale).abs());
                }
            });
        }
    }
    (positions, yaws)
}

/// A number for each coordinate between -1/2 and 1/2, spread evenly over objects and frames (Steele, Lea and Flood, OOPSLA 2014:
/// SplitMix64).
fn within_step(object: u32, frame: usize) -> Vec2 {
    let mix = |axis: u64| {
        let seed = (u64::from(object) << 32 | frame as u64).wrapping_mul(2).wrapping_add(axis + 1);
        let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    vec2(mix(0), mix(1))
}

/// Calls `f(samples, q)` for three samples in near frames; q is the middle one's place in time between the others (1: at the last).
fn second_differences(scene: &Scene, track: &Track, mut f: impl FnMut([&Sample; 3], f64)) {
    for w in track.samples.windows(3) {
        if let [a, b, c] = w
            && c.frame - a.frame <= 4
        {
            let (t0, t1, t2) = (scene.time_of(a.frame), scene.time_of(b.frame), scene.time_of(c.frame));
            f([a, b, c], (t1 - t0) / (t2 - t0));
        }
    }
}

/// Standard deviation of a centred normal distribution from absolute values; `None` if they are too few.
fn standard_deviation(absolute: &mut [f64]) -> Option<f64> {
    let enough = absolute.len() >= ENOUGH;
    quantile(absolute, 0.5).filter(|_| enough).map(|median| median / NORMAL_MEDIAN_ABSOLUTE)
}
