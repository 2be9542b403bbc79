//! Observed motion without a model: smoothed tracks, cut where something sudden happened.

use crate::fit::Noise;
use crate::num::{Vec2, elementary, vec2};
use crate::scene::{Scene, Track};
use crate::world::{Kinematics, Model};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Samples of one local parabola: over 0.6 s at 25 frames/s a velocity is known to 1 sigma/s.
const SPAN: usize = 15;
/// The same of what stops within these, longest first: half a second at 25 frames/s is long where friction stops a thing of a
/// millimetre within a tenth of that.
const SHORTER_SPANS: [usize; 3] = [11, 7, SHORTEST_SMOOTH];
/// Samples that make a stretch worth looking at.
const SHORTEST: usize = 8;
/// Samples that a velocity can be had from.
const SHORTEST_SMOOTH: usize = 5;
/// Frames in which a tracker may lose an object without cutting its motion in two: how it went on is known well enough.
const BRIDGED: usize = 6;
/// Bodies nearer than this share of their radii together may have touched: so well sizes are known.
const NEAR: f64 = 0.075;
/// Frames around a contact that are left out: the exact time of the impact is not known.
const MARGIN: usize = 1;
/// Time that a ball needs to roll again after a hit (s), at the slip of a fast hit on smooth ground.
const SETTLING: f64 = 0.4;
/// Friction has no certain direction where a velocity is within so many of its deviations of none.
const SLOW: f64 = 3.0;
/// A body is taken to begin at rest where its velocity is within so many deviations of none.
const AT_REST: f64 = 1.5;
/// A deceleration counts by what is beyond so many of its deviations.
const CERTAIN: f64 = 2.0;
/// A velocity jump shows by this many deviations, and still by this many where the acceleration may change too.
const JUMP: f64 = 6.0;
const SURE_JUMP: f64 = 4.0;
/// How often a track is searched for jumps.
const LOOKS: usize = 3;
/// Samples on either side of a possible jump, and of one that shows only against more; and where others are near, as the next
/// one may soon follow.
const WING: usize = 8;
const WIDE_WING: usize = 12;
const NARROW_WING: usize = 5;
const FEWEST_WING: usize = 4;
/// Times a frame at which a stop is tried.
const STOPS_A_FRAME: usize = 4;
/// Frames by which noise may shift a jump.
const BESIDE: usize = 2;

/// One object's observed motion.
#[derive(Debug, Clone, Default)]
pub struct SmoothTrack {
    /// By frame; `None` where the object was not seen.
    pub motion: Vec<Option<Kinematics<f64>>>,
    /// Frames of free motion: no contact, no jump, not at rest. The object may have been lost in a few of them.
    pub stretches: Vec<Range<usize>>,
    /// Frames over which `motion` is smoothed, rest included.
    pub smooth: Vec<Range<usize>>,
    /// Sudden changes of velocity that no other object explains.
    pub jumps: Vec<ChangePoint>,
    /// Standard deviation of the velocity by frame (m/s), where `motion` is smoothed.
    velocity_sd: Vec<f64>,
    /// Frames in which another object was near enough to touch, and the index of its track.
    pub near: Vec<(usize, usize)>,
}

/// A sudden change of velocity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ChangePoint {
    /// Frame after which it happened.
    pub frame: usize,
    /// Where the object was (m).
    pub position: Vec2,
    /// Velocity after minus before (m/s).
    pub change: Vec2,
    /// In deviations of its measurement.
    pub sigmas: f64,
}

/// The model with bodies that begin as the smoothed tracks do, where those are smooth at their beginning; `None`
/// where one is not.
pub fn started(scene: &Scene, paths: &[SmoothTrack], model: &Model) -> Option<Model> {
    let mut model = model.clone();
    for ((body, track), path) in model.bodies.iter_mut().zip(&scene.tracks).zip(paths) {
        let Some(first) = track.samples.first() else { continue };
        let smooth = path.smooth.iter().any(|r| r.contains(&first.frame));
        let motion = path.motion.get(first.frame).copied().flatten().filter(|_| smooth)?;
        let state = &mut body.start.state;
        body.start.time = scene.time_of(first.frame);
        let moves = motion.velocity.norm() > AT_REST * path.velocity_sd.get(first.frame).unwrap_or(&0.0);
        (state.position, state.yaw) = (motion.position, motion.yaw);
        state.velocity = if moves { motion.velocity } else { vec2(0.0, 0.0) };
        state.spin = if moves { motion.spin } else { 0.0 };
    }
    Some(model)
}

/// The motion of each object of the scene. Deterministic.
pub fn paths(scene: &Scene, noise: &Noise) -> Vec<SmoothTrack> {
    let raw: Vec<Vec<Option<Vec2>>> = scene.tracks.iter().map(|t| positions(scene, t)).collect();
    let whole: Vec<Vec<Option<Vec2>>> = raw.iter().map(|own| bridged(own)).collect();
    (0..scene.tracks.len()).map(|i| path(scene, noise, &raw[i], &whole, i)).collect()
}

/// Positions by frame, on a straight line where the object was lost for a few.
fn bridged(own: &[Option<Vec2>]) -> Vec<Option<Vec2>> {
    let mut whole = own.to_vec();
    let mut last: Option<(usize, Vec2)> = None;
    for (f, here) in own.iter().enumerate().filter_map(|(f, p)| Some((f, (*p)?))) {
        if let Some((from, before)) = last.filter(|(from, _)| f - from <= BRIDGED + 1) {
            let step = (here - before).scaled(1.0 / (f - from) as f64);
            for (k, place) in (1..).zip(&mut whole[from + 1..f]) {
                *place = Some(before + step.scaled(f64::from(k)));
            }
        }
        last = Some((f, here));
    }
    whole
}

pub fn positions(scene: &Scene, track: &Track) -> Vec<Option<Vec2>> {
    let mut by_frame = vec![None; scene.times.len()];
    for s in &track.samples {
        if let Some(slot) = by_frame.get_mut(s.frame) {
            *slot = Some(s.position);
        }
    }
    by_frame
}

fn path(
    scene: &Scene,
    noise: &Noise,
    own: &[Option<Vec2>],
    whole: &[Vec<Option<Vec2>>],
    i: usize,
) -> SmoothTrack {
    let noise = &noise.of_track(&scene.tracks[i]);
    let frames = scene.times.len();
    let radius = |k: usize| scene.objects[k].shape.bounding_radius();
    let mut near = vec![];
    for (j, other) in whole.iter().enumerate().filter(|(j, _)| *j != i) {
        for f in 0..frames {
            let (Some(a), Some(b)) = (whole[i][f], other[f]) else { continue };
            let reach = (1.0 + NEAR) * (radius(i) + radius(j)) + 2.0 * noise.position;
            let step = if f > 0 { whole[i][f - 1].map_or(0.0, |p| (a - p).norm()) } else { 0.0 };
            if (a - b).norm() < reach + step {
                near.push((f, j));
            }
        }
    }
    let settles = if scene.objects[i].shape.is_ball() { (SETTLING * scene.fps).ceil() as usize } else { 0 };
    let mut usable: Vec<bool> = whole[i].iter().map(Option::is_some).collect();
    for &(f, _) in &near {
        let end = (f + MARGIN + settles + 1).min(frames);
        usable[f.saturating_sub(MARGIN)..end].iter_mut().for_each(|u| *u = false);
    }
    let mut jumps = vec![];
    // One jump may hide another near it.
    for _ in 0..LOOKS {
        let seen: Vec<ChangePoint> =
            runs(&usable).into_iter().flat_map(|s| find_jumps(scene, noise, own, s)).collect();
        for jump in &seen {
            let end = (jump.frame + 1 + MARGIN + settles).min(frames);
            usable[jump.frame.saturating_sub(MARGIN)..end].iter_mut().for_each(|u| *u = false);
        }
        if seen.is_empty() {
            break;
        }
        jumps.extend(seen);
    }
    jumps.sort_by_key(|j| j.frame);
    let turns = !scene.objects[i].shape.is_ball() || scene.tracks[i].turns_evenly();
    let yaws = turns.then(|| unwrapped_yaws(scene, i));
    let mut motion: Vec<Option<Kinematics<f64>>> = own.iter().map(|p| p.map(still)).collect();
    let smoothed: Vec<Range<usize>> =
        runs(&usable).into_iter().filter(|r| seen(own, r) >= SHORTEST_SMOOTH).collect();
    let (mut velocity_sd, mut moves) = (vec![0.0; frames], vec![false; frames]);
    for frame in smoothed
        .iter()
        .flat_map(|segment| smooth(scene, noise.position, own, yaws.as_deref(), segment.clone()))
    {
        let f = frame.frame;
        (motion[f], velocity_sd[f], moves[f]) = (Some(frame.motion), frame.velocity_sd, frame.moves);
    }
    usable.iter_mut().zip(moves).for_each(|(usable, moves)| *usable &= moves);
    let stretches = runs(&usable).into_iter().filter(|r| seen(own, r) >= SHORTEST).collect();
    SmoothTrack { motion, stretches, smooth: smoothed, jumps, velocity_sd, near }
}

fn still(position: Vec2) -> Kinematics<f64> {
    Kinematics { position, yaw: 0.0, velocity: vec2(0.0, 0.0), spin: 0.0, roll: vec2(0.0, 0.0) }
}

/// In how many of the frames it was seen.
fn seen(own: &[Option<Vec2>], frames: &Range<usize>) -> usize {
    own.iter().take(frames.end).skip(frames.start).flatten().count()
}

/// Runs of true.
fn runs(usable: &[bool]) -> Vec<Range<usize>> {
    let mut runs = vec![];
    let mut start = None;
    for (f, &u) in usable.iter().chain([&false]).enumerate() {
        match (u, start) {
            (true, None) => start = Some(f),
            (false, Some(s)) => {
                runs.push(s..f);
                start = None;
            }
            _ => {}
        }
    }
    runs
}

/// Yaw by frame without jumps by whole turns.
fn unwrapped_yaws(scene: &Scene, i: usize) -> Vec<Option<f64>> {
    let mut yaws = vec![None; scene.times.len()];
    let mut last: Option<f64> = None;
    for s in &scene.tracks[i].samples {
        if let (Some(yaw), Some(slot)) = (s.yaw, yaws.get_mut(s.frame)) {
            let turn = std::f64::consts::TAU;
            let near = last.map_or(yaw, |before| yaw - turn * ((yaw - before) / turn).round());
            (*slot, last) = (Some(near), Some(near));
        }
    }
    yaws
}

/// One frame of a smoothed segment.
struct SmoothFrame {
    frame: usize,
    motion: Kinematics<f64>,
    /// m/s.
    velocity_sd: f64,
    /// Whether it certainly moves, and does not stop within the span that it is smoothed over: a parabola does not tell when.
    moves: bool,
}

/// Local parabolas over the segment, through positions of deviation `sigma` (m), and through yaws. What is slowed so much that it
/// stops within the usual span is looked at over shorter ones, where these know its braking.
fn smooth(
    scene: &Scene,
    sigma: f64,
    own: &[Option<Vec2>],
    yaws: Option<&[Option<f64>]>,
    segment: Range<usize>,
) -> Vec<SmoothFrame> {
    let one = |f: usize| {
        let at = |span: usize| smooth_frame(scene, sigma, (own, yaws), &segment, (f, span));
        let usual = at(SPAN)?;
        let shorter = || SHORTER_SPANS.into_iter().filter(|span| *span < segment.len()).filter_map(at);
        let moves = match usual.moves {
            true => None,
            false => shorter().find(|frame| frame.moves),
        };
        Some(moves.unwrap_or(usual))
    };
    segment.clone().filter_map(one).collect()
}

/// The parabola over the `span` frames around `f`.
fn smooth_frame(
    scene: &Scene,
    sigma: f64,
    (own, yaws): (&[Option<Vec2>], Option<&[Option<f64>]>),
    segment: &Range<usize>,
    (f, span): (usize, usize),
) -> Option<SmoothFrame> {
    let first = (f.saturating_sub(span / 2)).max(segment.start).min(segment.end - segment.len().min(span));
    let window = first..(first + span).min(segment.end);
    let fitted = |value: &dyn Fn(usize) -> Option<f64>| {
        let points: Vec<(f64, f64)> =
            window.clone().filter_map(|g| Some((scene.times[g] - scene.times[f], value(g)?))).collect();
        parabola(&points)
    };
    let (x, y) = (fitted(&|g| own[g].map(|p| p.x))?, fitted(&|g| own[g].map(|p| p.y))?);
    let yaw = yaws.and_then(|yaws| fitted(&|g| yaws[g])).map_or((0.0, 0.0), |p| (p.value, p.slope));
    let velocity = vec2(x.slope, y.slope);
    let half = 0.5 * (scene.times[window.end - 1] - scene.times[window.start]);
    // Over the usual span braking counts by what is certain of it; over a shorter one by all that it may be.
    let side = if span < SPAN { CERTAIN } else { -CERTAIN };
    let braking = -vec2(x.second, y.second).dot(velocity.unit()) + side * sigma * x.second_sd;
    let velocity_sd = sigma * x.slope_sd;
    let moves = velocity.norm() > f64::max(SLOW * velocity_sd, braking * half);
    let position = vec2(x.value, y.value);
    let motion = Kinematics { position, yaw: yaw.0, velocity, spin: yaw.1, roll: vec2(0.0, 0.0) };
    Some(SmoothFrame { frame: f, motion, velocity_sd, moves })
}

/// Frames after which a track bends sharply, at contacts too: between short wings that are taken for straight. `noise` is the
/// track's.
pub fn bends(scene: &Scene, noise: &Noise, own: &[Option<Vec2>]) -> Vec<ChangePoint> {
    let bend = |f: usize| {
        let (change, sd) = change_near(scene, noise, own, f, 0)?;
        let sigmas = change.norm() / sd;
        (sigmas > JUMP).then_some(ChangePoint { frame: f, position: (*own.get(f)?)?, change, sigmas })
    };
    largest((0..own.len()).filter_map(bend), NARROW_WING)
}

/// How the velocity changes after frame `f` or one of the few beside it, where it does most, and the deviation of that (m/s).
pub fn change_near(
    scene: &Scene,
    noise: &Noise,
    own: &[Option<Vec2>],
    f: usize,
    beside: usize,
) -> Option<(Vec2, f64)> {
    let at = |g: usize| {
        let window = (g + 1).saturating_sub(NARROW_WING)..(g + NARROW_WING + 1).min(own.len());
        let enough = |wing: Range<usize>| seen(own, &wing) >= FEWEST_WING;
        let enough = enough(window.start..g + 1) && enough(g + 1..window.end);
        enough.then(|| jump(scene, noise, own, g, window, HalfWindows::Straight))?
    };
    let all = (f.saturating_sub(beside)..=f + beside).filter_map(at);
    let (change, sigmas) = all.max_by(|a, b| a.1.total_cmp(&b.1))?;
    Some((change, change.norm() / sigmas.max(f64::MIN_POSITIVE)))
}

/// By how much the velocity after frame `last` differs from that up to frame `first`, in deviations, beyond what motion that goes on
/// as it does on either side explains: parabolas through the samples of both are compared at three instants between, where they differ
/// least. `None` where too few samples are there.
pub fn sigmas_between(
    scene: &Scene,
    noise: &Noise,
    own: &[Option<Vec2>],
    [first, last]: [usize; 2],
) -> Option<f64> {
    let points = |frames: &mut dyn Iterator<Item = usize>| -> Vec<(f64, Vec2)> {
        frames.filter_map(|f| Some((*scene.times.get(f)?, (*own.get(f)?)?))).take(SPAN).collect()
    };
    let sides = [points(&mut (0..=first).rev()), points(&mut (last + 1..own.len()))];
    if sides.iter().any(|side| side.len() < SHORTEST) {
        return None;
    }
    let (from, until) = (*scene.times.get(first)?, *scene.times.get(last + 1)?);
    let at = |instant: f64| {
        let one = |side: &[(f64, Vec2)]| {
            let along = |of: fn(&Vec2) -> f64| {
                parabola(&side.iter().map(|(t, p)| (t - instant, of(p))).collect::<Vec<_>>())
            };
            let (x, y) = (along(|p| p.x)?, along(|p| p.y)?);
            Some((vec2(x.slope, y.slope), noise.position * x.slope_sd))
        };
        let ((a, sd_a), (b, sd_b)) = (one(&sides[0])?, one(&sides[1])?);
        Some((b - a).norm() / elementary::hypot(sd_a, sd_b))
    };
    [from, 0.5 * (from + until), until]
        .into_iter()
        .map(at)
        .try_fold(f64::INFINITY, |least, s| Some(least.min(s?)))
}

/// A parabola at zero: value, slope and second derivative, and the deviations of these two where a value has deviation 1.
struct Parabola {
    value: f64,
    slope: f64,
    second: f64,
    slope_sd: f64,
    second_sd: f64,
}

/// The parabola through the points; the line where there are two only.
fn parabola(points: &[(f64, f64)]) -> Option<Parabola> {
    let columns = points.len().min(3);
    if columns < 2 {
        return None;
    }
    let design = DMatrix::from_fn(points.len(), columns, |r, c| elementary::powi(points[r].0, c as i32));
    let values = DVector::from_iterator(points.len(), points.iter().map(|p| p.1));
    let inverse = (design.transpose() * &design).cholesky()?.inverse();
    let solved = &inverse * (design.transpose() * values);
    let sd = |k: usize| inverse[(k, k)].sqrt();
    let (second, second_sd) = if columns > 2 { (2.0 * solved[2], 2.0 * sd(2)) } else { (0.0, 0.0) };
    Some(Parabola { value: solved[0], slope: solved[1], second, slope_sd: sd(1), second_sd })
}

/// Frames after which the velocity jumps: the largest of each neighbourhood. Beside a jump the same wings see one the other
/// way, so that those which are the largest in their own wings come first; the others are looked at again without these.
fn find_jumps(scene: &Scene, noise: &Noise, own: &[Option<Vec2>], segment: Range<usize>) -> Vec<ChangePoint> {
    let within = |f: usize, wing: usize| {
        let window = (f + 1).saturating_sub(wing).max(segment.start)..(f + wing + 1).min(segment.end);
        if seen(own, &(window.start..f + 1)) < FEWEST_WING || seen(own, &(f + 1..window.end)) < FEWEST_WING {
            return None;
        }
        let bent = |g: usize| jump(scene, noise, own, g, window.clone(), HalfWindows::Bent);
        let at = |g: usize| {
            let bent = bent(g).filter(|j| j.1 > JUMP)?;
            let apart = jump(scene, noise, own, g, window.clone(), HalfWindows::BentApart)?;
            let is_jump = apart.1 > SURE_JUMP && !stops(scene, noise, own, g, window.clone());
            is_jump.then_some(bent)
        };
        let (change, sigmas) = at(f)?;
        let larger = |g: usize| g.abs_diff(f) > BESIDE && bent(g).is_some_and(|other| other.1 > sigmas);
        let mut others = window.start + FEWEST_WING - 1..window.end - FEWEST_WING;
        Some((ChangePoint { frame: f, position: own[f]?, change, sigmas }, !others.any(larger)))
    };
    let all: Vec<(ChangePoint, bool)> =
        segment.clone().filter_map(|f| within(f, WING).or_else(|| within(f, WIDE_WING))).collect();
    let peaks = all.iter().any(|c| c.1);
    largest(all.into_iter().filter(|c| c.1 || !peaks).map(|c| c.0), WING)
}

/// The largest jump of each neighbourhood of so many frames.
fn largest(candidates: impl Iterator<Item = ChangePoint>, wing: usize) -> Vec<ChangePoint> {
    let mut found: Vec<ChangePoint> = vec![];
    for c in candidates {
        match found.last_mut() {
            Some(last) if c.frame - last.frame <= wing => {
                if c.sigmas > last.sigmas {
                    *last = c;
                }
            }
            _ => found.push(c),
        }
    }
    found
}

/// What the motion may do on either side of a jump: nothing, be accelerated alike, or each in its own way.
#[derive(Clone, Copy)]
enum HalfWindows {
    Straight,
    Bent,
    BentApart,
}

/// Column `c` of a jump at time zero: place, velocity, its jump, acceleration, its jump.
fn half_window_column(t: f64, c: usize) -> f64 {
    [1.0, t, t.max(0.0), t * t, elementary::powi(t.max(0.0), 2)][c]
}

/// Whether friction that brakes to a stop in the window explains it as well as a jump after frame `f` with accelerations of their own
/// (Akaike): x = p + u max(s - t, 0)^2, at rest from s on. Where noise is small, a stop bends both half-windows by more than that.
fn stops(scene: &Scene, noise: &Noise, own: &[Option<Vec2>], f: usize, window: Range<usize>) -> bool {
    let middle = 0.5 * (scene.times[f] + scene.times[f + 1]);
    let times = [scene.times[window.start] - middle, scene.times[window.end - 1] - middle];
    let points: Vec<(f64, Vec2)> = window.filter_map(|g| Some((scene.times[g] - middle, own[g]?))).collect();
    let chi_square = |columns: usize, column: &dyn Fn(f64, usize) -> f64| -> Option<f64> {
        let design = DMatrix::from_fn(points.len(), columns, |r, c| column(points[r].0, c));
        let inverse = (design.transpose() * &design).cholesky()?.inverse();
        let left = |value: fn(&Vec2) -> f64| {
            let y = DVector::from_iterator(points.len(), points.iter().map(|p| value(&p.1)));
            (&y - &design * (&inverse * (design.transpose() * &y))).norm_squared()
        };
        Some((left(|p| p.x) + left(|p| p.y)) / (noise.position * noise.position))
    };
    let Some(jumps) = chi_square(5, &half_window_column) else { return false };
    let steps = STOPS_A_FRAME * points.len();
    let at = |k: usize| times[0] + (times[1] - times[0]) * (k as f64 + 0.5) / steps as f64;
    let stop =
        |s: f64| chi_square(2, &move |t, c| if c == 0 { 1.0 } else { elementary::powi((s - t).max(0.0), 2) });
    let least = (0..steps).filter_map(|k| stop(at(k))).fold(f64::INFINITY, f64::min);
    // Ten numbers of a jump against four and the time of a stop.
    least < jumps + 2.0 * (10.0 - 5.0)
}

/// The jump of the velocity midway between frame `f` and the next, and its size in deviations.
fn jump(
    scene: &Scene,
    noise: &Noise,
    own: &[Option<Vec2>],
    f: usize,
    window: Range<usize>,
    wings: HalfWindows,
) -> Option<(Vec2, f64)> {
    let middle = 0.5 * (scene.times[f] + scene.times.get(f + 1)?);
    let points: Vec<(f64, Vec2)> = window.filter_map(|g| Some((scene.times[g] - middle, own[g]?))).collect();
    let columns = match wings {
        HalfWindows::Straight => 3,
        HalfWindows::Bent => 4,
        HalfWindows::BentApart => 5,
    };
    if points.len() < columns + 2 {
        return None;
    }
    let design = DMatrix::from_fn(points.len(), columns, |r, c| half_window_column(points[r].0, c));
    let inverse = (design.transpose() * &design).cholesky()?.inverse();
    let solve = |value: fn(&Vec2) -> f64| {
        let y = DVector::from_iterator(points.len(), points.iter().map(|p| value(&p.1)));
        (&inverse * (design.transpose() * y))[2]
    };
    let change = vec2(solve(|p| p.x), solve(|p| p.y));
    let deviation = noise.position * inverse[(2, 2)].sqrt();
    Some((change, change.norm() / deviation))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{CUBE, film};
    use super::super::weak_form::WeakFormRegression;
    use super::*;
    use crate::scene::Shape;

    #[test]
    fn a_few_lost_frames_leave_a_motion_whole_and_many_cut_it_in_two() {
        let mut scenes = film(&[vec![(CUBE, 2.0, [-1.5, 0.0], [0.9, 0.1])]], None);
        let whole = WeakFormRegression::new(&scenes).degrees_of_freedom();
        let long = 30..30 + BRIDGED + 1;
        scenes[0].tracks[0].samples.retain(|s| s.frame % 5 != 1 && !long.contains(&s.frame));
        let lens = WeakFormRegression::new(&scenes);
        let [before, after] = &lens.paths[0][0].stretches[..] else {
            panic!("{:?}", lens.paths[0][0].stretches)
        };
        assert!(before.end <= long.start && long.end <= after.start, "{before:?} {after:?}");
        assert!(lens.paths[0][0].jumps.is_empty());
        // Rows are of frames that were seen: a fifth of them was not.
        let left = lens.degrees_of_freedom() as f64 / whole as f64;
        assert!((0.6..0.8).contains(&left), "{left}");
    }

    /// A disc of 2 mm at 60 mm/s on ordinary friction stops after a fifth of a second: twelve frames.
    #[test]
    fn what_stops_within_the_usual_span_moves_before_that() {
        let (speed, braking, frame) = (0.06, 0.3, 1.0 / 60.0);
        let mut scenes = film(&[vec![(Shape::Disc { radius: 0.001 }, 1e-5, [0.0, 0.0], [0.0, 0.0])]], None);
        let scene = &mut scenes[0];
        scene.fps = 1.0 / frame;
        scene.times = (0..scene.times.len()).map(|f| f as f64 * frame).collect();
        for s in &mut scene.tracks[0].samples {
            let t = (s.frame as f64 * frame).min(speed / braking);
            // Noise of 10 um in steps that no parabola follows.
            let noise = 1e-5 * [0.8, -1.1, 0.3, 1.2, -0.9, -0.4][s.frame % 6];
            s.position = vec2(speed * t - 0.5 * braking * t * t + noise, 0.0);
        }
        let mut noise = crate::fit::estimate_noise(scene);
        noise.position = 1e-5;
        let own = &paths(scene, &noise)[0];
        let [moving] = &own.stretches[..] else { panic!("{:?}", own.stretches) };
        assert!(moving.start == 0 && (8..12).contains(&moving.end), "{moving:?}");
    }

    #[test]
    fn a_jump_is_seen_where_it_is_and_not_beside() {
        let wall = [("presence", 1.0), ("offset", 0.2), ("angle", -1.0), ("restitution", 0.8)];
        // The sooner it strikes, the fewer frames are before that.
        let launch = |k: usize| vec![(CUBE, 2.0, [0.2, -1.05 + 0.05 * k as f64], [0.1, 1.4])];
        let scenes = film(&[0, 1, 2, 3, 4, 5, 6, 7].map(launch), Some(("hidden_wall", &wall)));
        let normal = vec2(f64::cos(-1.0), f64::sin(-1.0));
        for paths in &WeakFormRegression::new(&scenes).paths {
            let [jump] = &paths[0].jumps[..] else { panic!("{:?}", paths[0].jumps) };
            assert!(jump.change.unit().dot(normal) > 0.9, "{jump:?}");
        }
    }
}
