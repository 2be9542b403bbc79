//! Start values: what a line through the first frames of each track says, other spins that a ball may have, and other
//! yaws of what nobody measured one of.

use super::noise::Noise;
use super::problem::Problem;
use crate::num::{Vec2, vec2, wrapped};
use crate::scene::{Sample, Scene, Track};
use crate::world::{BODY_VALUES, Model};

/// Most and fewest samples of a track that the first line goes through.
const FIRST: usize = 10;
const FEWEST: usize = 4;
/// Mean square, in deviations, beyond which a line does not describe its samples: something happened there.
const BENT: f64 = 4.0;
/// A velocity within this many deviations of zero is rest, where friction can hold.
const REST_DEVIATIONS: f64 = 3.5;
/// Effects that can hold a body at rest.
const DRY_FRICTION: [&str; 2] = ["sliding_friction", "gliding_friction"];
/// Other spins to start from: the roll as a share of rolling, and the spin about z in prior deviations (plain rolling,
/// stun, draw, either side; much and less, as a spin that friction ends before it matters has no gradient).
const OTHER_SPINS: [(f64, f64); 7] =
    [(1.0, 0.0), (0.0, 0.0), (-1.0, 0.0), (1.0, 0.5), (1.0, -0.5), (1.0, 1.0), (1.0, -1.0)];

/// Place of the yaw in [`BODY_VALUES`].
const YAW: usize = 2;
/// How far apart the yaws are from which a body is tried whose yaw was not measured (rad): a contact's cost has a minimum
/// for each side that may have been hit, and they are an eighth of a turn from each other's border.
pub(super) const YAW_STEP: f64 = std::f64::consts::FRAC_PI_8;

/// Puts each body of the model where its track begins, with the velocity of its first frames. A body that neither moves
/// nor turns there is at rest: friction holds it, and its velocity is no parameter.
pub(super) fn from_tracks(scene: &Scene, model: &mut Model, noise: &Noise) {
    let holds = DRY_FRICTION.iter().any(|name| model.effect(name).is_some_and(|e| e.on));
    for (body, track) in model.bodies.iter_mut().zip(&scene.tracks) {
        let Some(first) = track.samples.first() else { continue };
        let noise = &noise.of_track(track);
        let state = &mut body.start.state;
        body.start.time = scene.time_of(first.frame);
        let begin = straight(scene, track, noise.position);
        let (position, velocity, sd) = line(scene, begin, noise.position, |s| Some(s.position));
        state.velocity = velocity;
        state.position = position;
        let unwound = unwound(begin);
        let turn = noise.yaw.map(|sigma| line(scene, &unwound, sigma, |s| s.yaw.map(|yaw| vec2(yaw, 0.0))));
        let turns =
            !body.shape.is_ball() && turn.is_some_and(|(_, spin, sd)| spin.x.abs() > REST_DEVIATIONS * sd);
        if velocity.norm() < REST_DEVIATIONS * sd && holds && !turns {
            state.velocity = vec2(0.0, 0.0);
            state.position = mean(begin);
        }
        let moves = state.velocity.norm() > 0.0;
        if let Some((yaw, spin, _)) = turn {
            state.yaw = yaw.x;
            state.spin = if moves && !body.shape.is_ball() { spin.x } else { 0.0 };
        }
        let glides = body.shape.is_ball() && model.spin_sd == 0.0 && !body.start.rolling;
        if glides && moves && track.turns_evenly() {
            // What it knows of its turn about z is no parameter: a spinning ball is pushed sideways by some laws.
            state.spin = turn_rate(scene, begin).unwrap_or(0.0);
        }
        if body.shape.is_ball() && moves && model.spin_sd > 0.0 {
            // It begins to roll, but its spin is a parameter of its own. What a tracker calls the yaw of a ball is too
            // uncertain to be fitted; it tells where to start.
            state.roll = state.velocity.perp().scaled(1.0 / body.shape.bounding_radius());
            state.spin = turn_rate(scene, begin).unwrap_or(0.0);
            body.start.rolling = false;
        }
    }
}

/// Points of the search that differ from this one in the spin of one ball whose spin is free.
pub(super) fn other_spins(problem: &Problem, point: &[f64]) -> Vec<Vec<f64>> {
    let mut others = vec![];
    let width = BODY_VALUES.len();
    for part in &problem.parts {
        let free = |slot: usize| part.slots.iter().find(|s| s.0 == slot).map(|s| s.1);
        for (b, body) in part.model.bodies.iter().enumerate().filter(|(_, b)| b.shape.is_ball()) {
            let of = |value: usize| free(b * width + value);
            let [Some(vx), Some(vy), Some(spin), Some(x), Some(y)] = [3, 4, 5, 6, 7].map(of) else {
                continue;
            };
            let radius = body.shape.bounding_radius();
            let rolling = vec2(point[vx], point[vy]).perp().scaled(1.0 / radius);
            for (share, side) in OTHER_SPINS {
                let mut other = point.to_vec();
                other[spin] = side * part.model.spin_sd / radius;
                (other[x], other[y]) = (share * rolling.x, share * rolling.y);
                others.push(other);
            }
        }
    }
    others
}

/// Where the yaws stand that are searched though none was measured, and how many others, [`YAW_STEP`] apart, look different.
pub(super) fn unseen_yaws(problem: &Problem) -> Vec<(usize, usize)> {
    let mut unseen = vec![];
    for part in &problem.parts {
        for (b, (body, track)) in part.model.bodies.iter().zip(&part.scene.tracks).enumerate() {
            let Some([length, width]) = body.shape.half_extents() else { continue };
            let yaw = part.slots.iter().find(|s| s.0 == b * BODY_VALUES.len() + YAW);
            let measured = track.samples.iter().any(|s| s.yaw.is_some());
            if let Some((_, k)) = yaw.filter(|_| !measured) {
                unseen.push((*k, if length == width { 3 } else { 7 }));
            }
        }
    }
    unseen
}

/// The first samples of a track, as many as a line describes.
fn straight<'a>(scene: &Scene, track: &'a Track, sigma: f64) -> &'a [Sample] {
    let mut begin = &track.samples[..track.samples.len().min(FIRST)];
    while begin.len() > FEWEST {
        let (position, velocity, _) = line(scene, begin, sigma, |s| Some(s.position));
        let start = scene.time_of(begin[0].frame);
        let off = |s: &Sample| position + velocity.scaled(scene.time_of(s.frame) - start) - s.position;
        let squares: f64 = begin.iter().map(|s| off(s).norm_squared()).sum();
        if squares <= BENT * sigma * sigma * (2 * begin.len() - 4) as f64 {
            break;
        }
        begin = &begin[..begin.len() - 1];
    }
    begin
}

/// The samples with yaws that go on over a whole turn, as most trackers' do not.
fn unwound(samples: &[Sample]) -> Vec<Sample> {
    let mut samples = samples.to_vec();
    let mut before: Option<f64> = None;
    for yaw in samples.iter_mut().filter_map(|s| s.yaw.as_mut()) {
        *yaw = before.map_or(*yaw, |before| before + wrapped(*yaw - before));
        before = Some(*yaw);
    }
    samples
}

/// Mean turn rate (rad/s) over samples that follow each other, each turn taken the short way.
fn turn_rate(scene: &Scene, samples: &[Sample]) -> Option<f64> {
    let turn = |w: &[Sample]| {
        Some((wrapped(w[1].yaw? - w[0].yaw?), scene.time_of(w[1].frame) - scene.time_of(w[0].frame)))
    };
    let turns = samples.windows(2).filter_map(turn);
    let (angle, time) = turns.fold((0.0, 0.0), |sum, t| (sum.0 + t.0, sum.1 + t.1));
    (time > 0.0).then(|| angle / time)
}

fn mean(samples: &[Sample]) -> Vec2 {
    let sum = samples.iter().fold(vec2(0.0, 0.0), |sum, s| sum + s.position);
    sum.scaled(1.0 / samples.len() as f64)
}

/// Value and slope at the first of the samples of a line through them, and the slope's deviation.
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
