//! Initial states: position, velocity, yaw and spin of each body from a line through the first frames of its track.

use super::noise::Noise;
use crate::effects::effect;
use crate::num::{Vec2, elementary, vec2, wrap_angle};
use crate::scene::{Sample, Scene, Track};
use crate::world::{ActiveEffect, Model};

/// Most and fewest samples of a track that the line goes through; more where they do not tell whether it moves.
const MOST_SAMPLES: usize = 10;
const FEWEST_SAMPLES: usize = 4;
/// Mean square residual, in noise variances, beyond which a line does not describe its samples.
const BENT: f64 = 4.0;
/// Deviations of chi-square that are chance.
const CHANCE: f64 = 1.0;
/// The same within which half of the samples tell nothing of motion.
const HALF_MOVES: f64 = 2.0;
/// A velocity within this many standard deviations of zero is rest, if friction can keep a body at rest.
const REST_DEVIATIONS: f64 = 3.5;

/// The model as a fit from tracks starts with it.
pub fn initial_model(scene: &Scene, start: &Model) -> Model {
    let mut model = start.clone();
    set_initial_states(scene, &mut model, &super::noise::estimate(scene));
    model
}

/// Sets the state of each body at its first sample. A body that neither moves nor turns there is at rest: friction keeps it, and
/// its velocity is no parameter.
pub(super) fn set_initial_states(scene: &Scene, model: &mut Model, noise: &Noise) {
    let holds = |e: &ActiveEffect| e.on && effect(&e.name).is_some_and(|e| e.profile.holds_at_rest);
    let has_dry_friction = model.effects.iter().any(holds);
    for (body, track) in model.bodies.iter_mut().zip(&scene.tracks) {
        let Some(first) = track.samples.first() else { continue };
        let noise = &noise.of_track(track);
        let state = &mut body.start.state;
        body.start.time = scene.time_of(first.frame);
        let samples = straight(scene, track, noise.position);
        let (position, velocity, sd) = line(scene, samples, noise.position, |s| Some(s.position));
        state.velocity = velocity;
        state.position = position;
        let unwrapped = unwrapped(samples);
        let turn = noise.yaw.map(|sigma| line(scene, &unwrapped, sigma, |s| s.yaw.map(|yaw| vec2(yaw, 0.0))));
        let turns =
            !body.shape.is_ball() && turn.is_some_and(|(_, spin, sd)| spin.x.abs() > REST_DEVIATIONS * sd);
        if velocity.norm() < REST_DEVIATIONS * sd && has_dry_friction && !turns {
            state.velocity = vec2(0.0, 0.0);
            state.position = mean(samples);
        }
        let moves = state.velocity.norm() > 0.0;
        if let Some((yaw, spin, _)) = turn {
            state.yaw = yaw.x;
            state.spin = if moves && !body.shape.is_ball() { spin.x } else { 0.0 };
        }
        let has_fixed_spin = body.shape.is_ball() && model.spin_sd == 0.0 && !body.start.rolling;
        if has_fixed_spin && moves && track.turns_evenly() {
            // A ball's measured turn is no parameter, but some laws push a spinning ball sideways.
            state.spin = turn_rate(scene, samples).unwrap_or(0.0);
        }
        if body.shape.is_ball() && moves && model.spin_sd > 0.0 {
            // It starts rolling, but its spin is a parameter of its own. A tracker's yaw of a ball is too uncertain to be
            // fitted; it gives the start value.
            state.roll = state.velocity.perp().scaled(1.0 / body.shape.bounding_radius());
            state.spin = turn_rate(scene, samples).unwrap_or(0.0);
            body.start.rolling = false;
        }
    }
}

/// The first samples of a track, as many as a line describes; twice as many, and so on, if these tell that it moves.
fn straight<'a>(scene: &Scene, track: &'a Track, sigma: f64) -> &'a [Sample] {
    let mut samples = &track.samples[..track.samples.len().min(MOST_SAMPLES)];
    while samples.len() > FEWEST_SAMPLES
        && bend(scene, samples, sigma) > BENT * (2 * samples.len() - 4) as f64
    {
        samples = &samples[..samples.len() - 1];
    }
    let mut more = samples;
    while more.len() >= MOST_SAMPLES && more.len() < track.samples.len() {
        let (_, velocity, sd) = line(scene, more, sigma, |s| Some(s.position));
        if velocity.norm() > REST_DEVIATIONS * sd {
            break;
        }
        more = &track.samples[..track.samples.len().min(2 * more.len())];
        let degrees = (2 * more.len() - 4) as f64;
        if bend(scene, more, sigma) > degrees + CHANCE * (2.0 * degrees).sqrt() {
            return samples;
        }
    }
    if moves_evenly(scene, more, sigma) { more } else { samples }
}

/// Whether both halves of the samples move, and alike: what rests until it is hit does not.
fn moves_evenly(scene: &Scene, samples: &[Sample], sigma: f64) -> bool {
    let halves = samples.split_at(samples.len() / 2);
    let [(_, early, sd), (_, late, other_sd)] =
        [halves.0, halves.1].map(|half| line(scene, half, sigma, |s| Some(s.position)));
    let apart = REST_DEVIATIONS * elementary::hypot(sd, other_sd);
    early.norm() > HALF_MOVES * sd && late.norm() > HALF_MOVES * other_sd && (early - late).norm() < apart
}

/// What a line leaves of the samples (chi-square).
fn bend(scene: &Scene, samples: &[Sample], sigma: f64) -> f64 {
    let (position, velocity, _) = line(scene, samples, sigma, |s| Some(s.position));
    let start = scene.time_of(samples[0].frame);
    let off = |s: &Sample| position + velocity.scaled(scene.time_of(s.frame) - start) - s.position;
    samples.iter().map(|s| off(s).norm_squared()).sum::<f64>() / (sigma * sigma)
}

/// The samples with continuous yaws; most trackers give them modulo a whole turn.
fn unwrapped(samples: &[Sample]) -> Vec<Sample> {
    let mut samples = samples.to_vec();
    let mut before: Option<f64> = None;
    for yaw in samples.iter_mut().filter_map(|s| s.yaw.as_mut()) {
        *yaw = before.map_or(*yaw, |before| before + wrap_angle(*yaw - before));
        before = Some(*yaw);
    }
    samples
}

/// Mean turn rate (rad/s) over samples that follow each other; each turn is at most half a whole one.
fn turn_rate(scene: &Scene, samples: &[Sample]) -> Option<f64> {
    let turn = |w: &[Sample]| {
        Some((wrap_angle(w[1].yaw? - w[0].yaw?), scene.time_of(w[1].frame) - scene.time_of(w[0].frame)))
    };
    let turns = samples.windows(2).filter_map(turn);
    let (angle, time) = turns.fold((0.0, 0.0), |sum, t| (sum.0 + t.0, sum.1 + t.1));
    (time > 0.0).then(|| angle / time)
}

fn mean(samples: &[Sample]) -> Vec2 {
    let sum = samples.iter().fold(vec2(0.0, 0.0), |sum, s| sum + s.position);
    sum.scaled(1.0 / samples.len() as f64)
}

/// Least-squares line through values of the samples: value at the first sample, slope (1/s) and the slope's standard deviation, which
/// is infinite if there are not two samples.
fn line(
    scene: &Scene,
    samples: &[Sample],
    sigma: f64,
    value: impl Fn(&Sample) -> Option<Vec2>,
) -> (Vec2, Vec2, f64) {
    let Some(first) = samples.first() else { return (vec2(0.0, 0.0), vec2(0.0, 0.0), 0.0) };
    let start = scene.time_of(first.frame);
    let points: Vec<(f64, Vec2)> =
        samples.iter().filter_map(|s| Some((scene.time_of(s.frame) - start, value(s)?))).collect();
    let n = points.len() as f64;
    let centre = points.iter().map(|p| p.0).sum::<f64>() / n;
    let middle = points.iter().fold(vec2(0.0, 0.0), |sum, p| sum + p.1).scaled(1.0 / n);
    let spread: f64 = points.iter().map(|p| elementary::powi(p.0 - centre, 2)).sum();
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
