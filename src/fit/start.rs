//! Start values: what a line through the first frames of each track says.

use super::noise::Noise;
use crate::num::{Vec2, vec2};
use crate::scene::{Scene, Track};
use crate::world::Model;

/// Samples of a track that the first line goes through.
const FIRST: usize = 10;
/// A velocity within this many deviations of zero is rest, where friction can hold.
const REST_DEVIATIONS: f64 = 3.5;
/// Effects that can hold a body at rest.
const DRY_FRICTION: [&str; 2] = ["sliding_friction", "gliding_friction"];

/// Puts each body of the model where its track begins, with the velocity of its first frames. A body that does
/// not move there is at rest: friction holds it, and its velocity is no parameter.
pub(super) fn from_tracks(scene: &Scene, model: &mut Model, noise: &Noise) {
    let holds = DRY_FRICTION.iter().any(|name| model.effect(name).is_some_and(|e| e.on));
    for (body, track) in model.bodies.iter_mut().zip(&scene.tracks) {
        let Some(first) = track.samples.first() else { continue };
        let state = &mut body.start.state;
        body.start.time = scene.time_of(first.frame);
        let (position, velocity, sd) = line(scene, track, noise.position, |s| Some(s.position));
        state.velocity = velocity;
        state.position = position;
        if velocity.norm() < REST_DEVIATIONS * sd && holds {
            state.velocity = vec2(0.0, 0.0);
            state.position = mean(track);
        }
        let moves = state.velocity.norm() > 0.0;
        if let Some(sigma) = noise.yaw {
            let (yaw, spin, _) = line(scene, track, sigma, |s| s.yaw.map(|yaw| vec2(yaw, 0.0)));
            state.yaw = yaw.x;
            state.spin = if moves && !body.shape.is_ball() { spin.x } else { 0.0 };
        }
    }
}

fn mean(track: &Track) -> Vec2 {
    let n = track.samples.len().min(FIRST);
    let sum = track.samples[..n].iter().fold(vec2(0.0, 0.0), |sum, s| sum + s.position);
    sum.scaled(1.0 / n as f64)
}

/// Value and slope at the first sample of a line through the first ones, and the slope's deviation.
fn line(
    scene: &Scene,
    track: &Track,
    sigma: f64,
    value: impl Fn(&crate::scene::Sample) -> Option<Vec2>,
) -> (Vec2, Vec2, f64) {
    let Some(first) = track.samples.first() else { return (vec2(0.0, 0.0), vec2(0.0, 0.0), 0.0) };
    let start = scene.time_of(first.frame);
    let points: Vec<(f64, Vec2)> = track
        .samples
        .iter()
        .take(FIRST)
        .filter_map(|s| Some((scene.time_of(s.frame) - start, value(s)?)))
        .collect();
    let n = points.len() as f64;
    let centre = points.iter().map(|p| p.0).sum::<f64>() / n;
    let middle = points.iter().fold(vec2(0.0, 0.0), |sum, p| sum + p.1).scaled(1.0 / n);
    let spread: f64 = points.iter().map(|p| (p.0 - centre).powi(2)).sum();
    if points.len() < 2 || spread <= 0.0 {
        let at = points.first().map_or(vec2(0.0, 0.0), |p| p.1);
        return (at, vec2(0.0, 0.0), f64::INFINITY);
    }
    let slope = points
        .iter()
        .fold(vec2(0.0, 0.0), |sum, p| sum + (p.1 - middle).scaled(p.0 - centre))
        .scaled(1.0 / spread);
    (middle - slope.scaled(centre), slope, sigma / spread.sqrt())
}
