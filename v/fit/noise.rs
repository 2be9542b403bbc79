//! Measurement noise, estimated from the tracks alone.

use crate::scene::{Covariance, Sample, Scene, Track};

/// Fewest second differences that make an estimate.
const ENOUGH: usize = 12;
/// Noise that is taken where neither the tracks nor the user tell (m, rad).
const FALLBACK: f64 = 0.005;
/// Noise is never believed to be smaller (m, rad): it would make every model inadequate by round-off.
const SMALLEST: f64 = 1e-6;

/// Standard deviations of the measurements of one scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Of each coordinate of a position (m), root mean square over the samples.
    pub position: f64,
    /// Of a yaw (rad); `None` where no yaw that matters was measured.
    pub yaw: Option<f64>,
    /// Mean variance of the covariances that samples state (m^2): `position` squared stands for it.
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
        // Where a covariance has no factor (validation refuses it), its mean is better than nothing.
        let alone = covariance.mean().abs().sqrt();
        let [xx, yx, yy] = covariance.factor().unwrap_or([alone, 0.0, alone]);
        Whitener { xx: 1.0 / xx, yx: -yx / (xx * yy), yy: 1.0 / yy }
    }

    pub fn apply(&self, x: f64, y: f64) -> [f64; 2] {
        [self.xx * x, self.yx * x + self.yy * y]
    }
}

impl Noise {
    /// Of the positions of a scene whose noise was estimated before (m).
    pub(super) fn of_fit(scene: &Scene, position: f64) -> Noise {
        Noise { position, yaw: None, stated: stated(scene) }
    }

    /// Covariance of a sample (m^2) that states this one.
    pub(super) fn covariance(&self, stated: Option<Covariance>) -> Covariance {
        let variance = self.position * self.position;
        match stated {
            Some(c) => c.scaled(variance / self.stated),
            None => Covariance { xx: variance, xy: 0.0, yy: variance },
        }
    }

    /// For a sample that states this covariance.
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
    let all = scene.tracks.iter().flat_map(|t| &t.samples).filter_map(|s| s.covariance);
    let (sum, count) = all.fold((0.0, 0), |(sum, n), c| (sum + c.mean(), n + 1));
    if count == 0 { 1.0 } else { sum / count as f64 }
}

/// Median absolute second difference over three neighbouring frames, scaled to a standard deviation:
/// smooth motion and the few impacts leave the median alone.
pub fn estimate(scene: &Scene) -> Noise {
    let mut positions = vec![];
    let mut yaws = vec![];
    // In units of the stated mean, which is one where nothing is stated.
    let stated = stated(scene);
    let relative = |s: &Sample| {
        s.covariance.map_or(Covariance { xx: 1.0, xy: 0.0, yy: 1.0 }, |c| c.scaled(1.0 / stated))
    };
    for (object, track) in scene.objects.iter().zip(&scene.tracks) {
        second_differences(scene, track, |[a, b, c], share| {
            let off = b.position - a.position.scaled(1.0 - share) - c.position.scaled(share);
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
    let seen = |d: &Vec<f64>| (d.len() >= ENOUGH).then_some(());
    let any_stated = scene.tracks.iter().flat_map(|t| &t.samples).any(|s| s.covariance.is_some());
    let believed = scene.noise_sigma.unwrap_or(if any_stated { stated.sqrt() } else { FALLBACK });
    let position = seen(&positions).map_or(believed, |()| deviation(&mut positions)).max(SMALLEST);
    let any_yaw = scene
        .objects
        .iter()
        .zip(&scene.tracks)
        .any(|(o, t)| !o.shape.is_ball() && t.samples.iter().any(|s| s.yaw.is_some()));
    let yaw = any_yaw.then(|| seen(&yaws).map_or(2.0 * FALLBACK, |()| deviation(&mut yaws)).max(SMALLEST));
    Noise { position, yaw, stated }
}

/// Calls `f(samples, share)` for three samples in near frames; `share` is the middle one's place in time between the
/// others (1: at the last).
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

/// Standard deviation of a normal distribution with this median of absolute values.
fn deviation(absolute: &mut [f64]) -> f64 {
    let middle = absolute.len() / 2;
    let (_, median, _) = absolute.select_nth_unstable_by(middle, f64::total_cmp);
    *median / 0.674_489_750_196_081_7
}
