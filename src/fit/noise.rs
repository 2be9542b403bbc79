//! Measurement noise, estimated from the tracks alone.

use crate::scene::{Scene, Track};

/// Fewest second differences that make an estimate.
const ENOUGH: usize = 12;
/// Noise that is taken where neither the tracks nor the user tell (m, rad).
const FALLBACK: f64 = 0.005;
/// Noise is never believed to be smaller (m, rad): it would make every model inadequate by round-off.
const SMALLEST: f64 = 1e-6;

/// Standard deviations of the measurements of one scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Of each coordinate of a position (m).
    pub position: f64,
    /// Of a yaw (rad); `None` where no yaw that matters was measured.
    pub yaw: Option<f64>,
}

/// Median absolute second difference over three neighbouring frames, scaled to a standard deviation:
/// smooth motion and the few impacts leave the median alone.
pub fn estimate(scene: &Scene) -> Noise {
    let mut positions = vec![];
    let mut yaws = vec![];
    for (object, track) in scene.objects.iter().zip(&scene.tracks) {
        second_differences(scene, track, |s| Some(s.position.x), &mut positions);
        second_differences(scene, track, |s| Some(s.position.y), &mut positions);
        if !object.shape.is_ball() {
            second_differences(scene, track, |s| s.yaw, &mut yaws);
        }
    }
    let seen = |d: &Vec<f64>| (d.len() >= ENOUGH).then_some(());
    let believed = scene.noise_sigma.unwrap_or(FALLBACK);
    let position = seen(&positions).map_or(believed, |()| deviation(&mut positions)).max(SMALLEST);
    let any_yaw = scene
        .objects
        .iter()
        .zip(&scene.tracks)
        .any(|(o, t)| !o.shape.is_ball() && t.samples.iter().any(|s| s.yaw.is_some()));
    let yaw = any_yaw.then(|| seen(&yaws).map_or(2.0 * FALLBACK, |()| deviation(&mut yaws)).max(SMALLEST));
    Noise { position, yaw }
}

/// Second differences over samples in consecutive frames, in units of one measurement's deviation.
fn second_differences(
    scene: &Scene,
    track: &Track,
    value: impl Fn(&crate::scene::Sample) -> Option<f64>,
    out: &mut Vec<f64>,
) {
    for w in track.samples.windows(3) {
        let (t0, t1, t2) = (scene.time_of(w[0].frame), scene.time_of(w[1].frame), scene.time_of(w[2].frame));
        if w[2].frame - w[0].frame > 4 {
            continue;
        }
        if let (Some(a), Some(b), Some(c)) = (value(&w[0]), value(&w[1]), value(&w[2])) {
            let share = (t1 - t0) / (t2 - t0);
            let difference = b - a * (1.0 - share) - c * share;
            let scale = (1.0 + share * share + (1.0 - share) * (1.0 - share)).sqrt();
            out.push((difference / scale).abs());
        }
    }
}

/// Standard deviation of a normal distribution with this median of absolute values.
fn deviation(absolute: &mut [f64]) -> f64 {
    let middle = absolute.len() / 2;
    let (_, median, _) = absolute.select_nth_unstable_by(middle, f64::total_cmp);
    *median / 0.674_489_750_196_081_7
}

/// The angle in -pi..=pi that differs by whole turns.
pub(super) fn wrapped(angle: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle - turn * (angle / turn).round()
}
