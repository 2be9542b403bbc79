//! What something unseen (a hand, a kick) does to objects: found, put into the model of its video, and passed over.
//!
//! A push is a nuisance of one video: an impulse on one object at one time ([`UnknownImpulse`]), or two at the ends of a span whose
//! measurements do not count. It competes with every law by its price: its numbers, and the choice of its object and time,
//!
//! price = p ln(n) + 2 ln(objects x frames)   (twice a log likelihood; p free numbers, n measurements).
//!
//! 1. Change points of the tracks that no object near, no wall and no contact explains are candidates for impulses.
//! 2. Where a fit with these still leaves its tracks, the frames up to which it follows them are found by bisection; from there a span
//!    of the object that leaves first is passed over, the shortest that is followed by motion that the model explains.
//!
//! Something unseen in one place that acts in several videos is a law of the library (a hidden object or wall). A discovery passes over
//! pushes only in videos that it does not follow without.

use super::outcome::Discovery;
use super::proof;
use super::resample::speed;
use super::smooth_track::{ChangePoint, change_near, paths, positions};
use crate::fit::{Fit, FitError, FitOptions, Noise, SceneFit, StartPoint, estimate_noise, estimate_one};
use crate::num::{Stop, Vec2, elementary};
use crate::scene::{Scene, Track};
use crate::world::{EventKind, Model, SimulationLimits, UnknownImpulse, simulate_observed, trace};
use rayon::prelude::*;

/// Most pushes of one video: more are no accident.
const MOST: usize = 4;
/// Reduced chi-square up to which a video is followed.
const FOLLOWED: f64 = 1.5;
/// Deviations by which a change of velocity is certain; also by which a simulation leaves a track.
const CERTAIN: f64 = 6.0;
/// A gain beyond the price that is more than what an engine does at a contact (twice a log likelihood).
const MUCH: f64 = 40.0;
/// Frames between a change and the change of what dealt it, or the contact that did.
const BESIDE: usize = 2;
/// What is nearer than this share of the radii together may push, touching or not (magnets, sizes that are not right).
const REACH: f64 = 3.0;
/// Share of a change that another object must take up, two deviations included, to have dealt it: masses are not known well.
const DEALT: f64 = 0.4;
/// A wall that is nearer than this share of the radius deals changes away from it (cosine).
const WALL_REACH: f64 = 1.5;
const AWAY: f64 = 0.7;
/// Frames before the first that leaves its track in which a push may have begun: it is seen once it has moved the object by more than
/// the noise.
const BEFORE: [usize; 3] = [2, 5, 10];
/// How long a push may last (s).
const DURATIONS: [f64; 5] = [0.06, 0.12, 0.25, 0.5, 1.0];
/// Samples through which the velocity after a push is measured, and fewest after it that are worth passing it over.
const AFTER: usize = 8;
/// Frames before the end of what is followed in which another object must not be near.
const CONTACT_FRAMES: usize = 8;
/// Fewest frames that a prefix of a video has.
const SHORTEST: usize = 8;

/// One video's fit, and the same with what something unseen did passed over, where there is such.
pub fn fit_passing_over_pushes(
    scene: &Scene,
    start: &Model,
    options: &FitOptions,
    stop: Stop,
) -> Result<Fit, FitError> {
    let fit = estimate_one(scene, start, options, stop)?;
    pass_over_pushes(scene, start, fit, options, stop)
}

/// The fit of one video from `start`, or one that passes over what something unseen did to its objects.
pub fn pass_over_pushes(
    scene: &Scene,
    start: &Model,
    fit: Fit,
    options: &FitOptions,
    stop: Stop,
) -> Result<Fit, FitError> {
    let mut best = fit;
    if is_followed(&best) {
        return Ok(best);
    }
    let candidates = impulses(scene, start);
    if !candidates.is_empty() && start.impulses.len() + candidates.len() <= MOST {
        let mut model = start.clone();
        model.impulses.extend(candidates);
        let found = certain_only(scene, model, options, stop)?;
        if is_worth_its_price(scene, &best, &found) {
            best = found;
        }
    }
    while !is_followed(&best) && best.scenes.iter().all(|s| s.model.impulses.len() < MOST) {
        match lasting(scene, &best, options, stop)? {
            Some(found) if is_worth_its_price(scene, &best, &found) => best = found,
            _ => break,
        }
    }
    Ok(best)
}

/// The models of a discovery with the pushes that videos need which it does not follow; `None` where there are none.
pub fn with_unseen_pushes(
    scenes: &[Scene],
    models: &[Model],
    found: &Discovery,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<Vec<Model>>, FitError> {
    let Some(last) = found.revisions.last() else { return Ok(None) };
    let one = |(k, (scene, model)): (usize, (&Scene, &Model))| -> Result<(Model, bool), FitError> {
        let own = last.fit.of_scene(k);
        let Some(fitted) = own.scenes.first().filter(|s| s.reduced_chi_square > FOLLOWED).cloned() else {
            return Ok((Model { impulses: pushes_of(&last.fit, k), ..model.clone() }, false));
        };
        let before = fitted.model.impulses.len();
        let passing = pass_over_pushes(scene, &fitted.model, own, options, stop)?;
        let impulses = pushes_of(&passing, 0);
        let more = impulses.len() > before;
        Ok((Model { impulses, ..model.clone() }, more))
    };
    let each: Result<Vec<(Model, bool)>, FitError> =
        scenes.par_iter().zip(models).enumerate().map(one).collect();
    let each = each?;
    let any = each.iter().any(|(_, more)| *more);
    Ok(any.then(|| each.into_iter().map(|(model, _)| model).collect()))
}

fn pushes_of(fit: &Fit, scene: usize) -> Vec<UnknownImpulse> {
    fit.scenes.get(scene).map_or(vec![], |s| s.model.impulses.clone())
}

/// Whether a discovery that passes over pushes explains the videos better than one without, the price of the pushes paid.
pub fn explains_pushed(scenes: &[Scene], without: &Discovery, with: &Discovery) -> bool {
    let (Some(before), Some(after)) = (without.revisions.last(), with.revisions.last()) else { return false };
    let price = |fit: &Fit| -> f64 { scenes.iter().zip(&fit.scenes).map(|(s, f)| price(s, f)).sum() };
    proof::deviance(&after.fit) + price(&after.fit) < proof::deviance(&before.fit) + price(&before.fit) - MUCH
}

/// Adds to a discovery's reason what something unseen did.
pub fn name_pushes(scenes: &[Scene], found: &mut Discovery) {
    let Some(last) = found.revisions.last() else { return };
    let of = |(scene, fitted): (&Scene, &SceneFit)| -> Vec<String> {
        let sentence = |p: &crate::world::UnseenPush| format!("{}: {}", scene.name, p.sentence());
        fitted.model.unseen_pushes().iter().map(sentence).collect()
    };
    let all: Vec<String> = scenes.iter().zip(&last.fit.scenes).flat_map(of).collect();
    if !all.is_empty() {
        found.reason += &format!("; {}; the models pass over that", all.join("; "));
    }
}

fn is_followed(fit: &Fit) -> bool {
    fit.scenes.iter().all(|s| s.reduced_chi_square <= FOLLOWED)
}

/// What the pushes of a video cost (twice a log likelihood).
fn price(scene: &Scene, fitted: &SceneFit) -> f64 {
    let impulses = &fitted.model.impulses;
    let numbers = |i: &UnknownImpulse| {
        2.0 + f64::from(u8::from(i.spin_sd > 0.0)) + f64::from(u8::from(i.delay_sd > 0.0))
    };
    let places = (scene.objects.len().max(1) * scene.times.len().max(2)) as f64;
    let each = |i: &UnknownImpulse| {
        numbers(i) * elementary::ln(fitted.degrees_of_freedom.max(2) as f64) + 2.0 * elementary::ln(places)
    };
    impulses.iter().map(each).sum()
}

/// Whether the gain of a fit is more than the price of the pushes that it has more.
fn is_worth_its_price(scene: &Scene, before: &Fit, after: &Fit) -> bool {
    let cost = |fit: &Fit| -> f64 { proof::deviance(fit) + fit.scenes.iter().map(|s| price(scene, s)).sum::<f64>() };
    cost(after) < cost(before) - MUCH
}

/// An impulse on an object midway between a frame and the next; `None` at the end. Its prior has the scale of the video's speeds, and
/// its time is within the frame.
fn impulse(scene: &Scene, object: usize, frame: usize, change: Vec2) -> Option<UnknownImpulse> {
    let (before, after) = (*scene.times.get(frame)?, *scene.times.get(frame + 1)?);
    let usual = scene.tracks.iter().map(|track| speed(scene, track)).fold(0.0, f64::max);
    let velocity_sd = usual.max(change.norm());
    let own = scene.objects.get(object)?;
    let turns = !own.shape.is_ball() && scene.tracks.get(object)?.samples.iter().any(|s| s.yaw.is_some());
    Some(UnknownImpulse {
        id: own.id,
        time: 0.5 * (before + after),
        frame,
        until: None,
        velocity: change,
        spin: 0.0,
        delay: 0.0,
        velocity_sd,
        spin_sd: if turns { velocity_sd / own.shape.bounding_radius() } else { 0.0 },
        delay_sd: 0.5 * (after - before),
    })
}

/// Impulses at the change points that nothing in the video explains, other than those that the model has.
fn impulses(scene: &Scene, model: &Model) -> Vec<UnknownImpulse> {
    let noise = estimate_noise(scene);
    let known = |object: usize, frame: usize| {
        let same = |i: &UnknownImpulse| i.id == scene.objects[object].id && i.frame.abs_diff(frame) <= 2 * BESIDE;
        model.impulses.iter().any(same)
    };
    let mut found = vec![];
    for (object, path) in paths(scene, &noise).iter().enumerate() {
        for jump in &path.jumps {
            let dealt = dealt_by_object(scene, &noise, model, object, jump) || dealt_by_wall(scene, model, object, jump);
            if !dealt && !known(object, jump.frame) {
                found.extend(impulse(scene, object, jump.frame, jump.change));
            }
        }
    }
    found
}

/// Whether another object that is near takes up the momentum of a change, or may have: its motion is not known.
fn dealt_by_object(scene: &Scene, noise: &Noise, model: &Model, object: usize, jump: &ChangePoint) -> bool {
    let radius = |k: usize| scene.objects[k].shape.bounding_radius();
    let mass = |k: usize| model.bodies.get(k).map_or(1.0, |b| b.mass);
    let others = (0..scene.tracks.len()).filter(|other| *other != object);
    let near = others.filter(|&other| {
        let reach = REACH * (radius(object) + radius(other));
        let place = nearest(&scene.tracks[other], jump.frame);
        place.is_some_and(|p| (p - jump.position).norm() < reach)
    });
    let taken = |other: usize| {
        let track = &scene.tracks[other];
        let noise = noise.of_track(track);
        let (change, sd) = change_near(scene, &noise, &positions(scene, track), jump.frame, BESIDE)?;
        Some(mass(other) * ((-change.dot(jump.change.unit())).max(0.0) + 2.0 * sd))
    };
    let all: Option<Vec<f64>> = near.map(taken).collect();
    all.is_none_or(|all| all.iter().sum::<f64>() >= DEALT * mass(object) * jump.change.norm())
}

/// Where a track is in the frame nearest to this one, if it was seen about then.
fn nearest(track: &Track, frame: usize) -> Option<Vec2> {
    let near = track.samples.iter().filter(|s| s.frame.abs_diff(frame) <= CONTACT_FRAMES);
    near.min_by_key(|s| s.frame.abs_diff(frame)).map(|s| s.position)
}

/// Whether a wall of the model is near, and the change is away from it.
fn dealt_by_wall(scene: &Scene, model: &Model, object: usize, jump: &ChangePoint) -> bool {
    let reach = WALL_REACH * scene.objects[object].shape.bounding_radius();
    model.walls.iter().any(|wall| {
        let along = wall.to - wall.from;
        let share = (jump.position - wall.from).dot(along) / along.norm_squared().max(f64::MIN_POSITIVE);
        let apart = jump.position - (wall.from + along.scaled(share.clamp(0.0, 1.0)));
        apart.norm() < reach && jump.change.unit().dot(apart.unit()).abs() > AWAY
    })
}

/// The fit with impulses at their right frames, and without those that are not certain.
fn certain_only(scene: &Scene, mut model: Model, options: &FitOptions, stop: Stop) -> Result<Fit, FitError> {
    let mut fit = estimate_one(scene, &model, options, stop)?;
    for _ in 0..MOST {
        let asked = model.impulses.len();
        let kept = kept(scene, &fit);
        let moved = kept.iter().zip(&pushes_of(&fit, 0)).any(|(a, b)| a.frame != b.frame);
        if kept.len() == asked && !moved {
            break;
        }
        model.impulses = kept;
        if let Some(known) = fit.scenes.first() {
            let impulses = std::mem::take(&mut model.impulses);
            model.copy_state_from(&known.model);
            model.impulses = impulses;
        }
        let near = FitOptions { start_point: StartPoint::YawSearched, ..*options };
        let next = estimate_one(scene, &model, &near, stop)?;
        if kept_len_equal(&fit, &next) && proof::deviance(&next) > proof::deviance(&fit) {
            break;
        }
        fit = next;
    }
    Ok(fit)
}

fn kept_len_equal(a: &Fit, b: &Fit) -> bool {
    pushes_of(a, 0).len() == pushes_of(b, 0).len()
}

/// The impulses of a fit that are certain, each in the frame in which it acts.
fn kept(scene: &Scene, fit: &Fit) -> Vec<UnknownImpulse> {
    let sd = |k: usize, value: &str| {
        let name = format!("impulses[{k}].{value}");
        fit.posterior.estimates.iter().find(|e| e.name == name).map_or(f64::INFINITY, |e| e.sd)
    };
    let certain = |(k, i): &(usize, UnknownImpulse)| {
        let spans = i.until.is_some() || i.delay_sd == 0.0;
        spans || elementary::hypot(i.velocity.x / sd(*k, "vx"), i.velocity.y / sd(*k, "vy")) > CERTAIN
    };
    let at_its_frame = |(_, i): (usize, UnknownImpulse)| {
        let frame = scene.times.partition_point(|t| *t <= i.acts_at()).saturating_sub(1);
        match impulse_time(scene, frame) {
            Some(time) if i.delay_sd > 0.0 && frame != i.frame => UnknownImpulse { frame, delay: i.acts_at() - time, time, ..i },
            _ => i,
        }
    };
    pushes_of(fit, 0).into_iter().enumerate().filter(certain).map(at_its_frame).collect()
}

/// Midway between a frame and the next (s).
fn impulse_time(scene: &Scene, frame: usize) -> Option<f64> {
    Some(0.5 * (scene.times.get(frame)? + scene.times.get(frame + 1)?))
}

/// The fit that passes over a span of the object that leaves its track first, if what follows is then explained.
fn lasting(scene: &Scene, fit: &Fit, options: &FitOptions, stop: Stop) -> Result<Option<Fit>, FitError> {
    let Some(fitted) = fit.scenes.first() else { return Ok(None) };
    let model = &fitted.model;
    let Some((prefix, end)) = followed_prefix(scene, model, options, stop)? else { return Ok(None) };
    let Some(object) = leaves_first(scene, &prefix, end) else { return Ok(None) };
    if may_touch(scene, &prefix, object, end) {
        return Ok(None);
    }
    let mut best: Option<Fit> = None;
    for duration in DURATIONS {
        for before in BEFORE {
            let Some(first) = end.checked_sub(before + 1) else { continue };
            let Some(pair) = span(scene, &prefix, object, first, duration) else { continue };
            let mut with = model.clone();
            with.copy_state_from(&prefix);
            with.impulses.extend(pair);
            let near = FitOptions { start_point: StartPoint::YawSearched, ..*options };
            let found = estimate_one(scene, &with, &near, stop)?;
            if best.as_ref().is_none_or(|b| proof::deviance(&found) < proof::deviance(b)) {
                best = Some(found);
            }
            if best.as_ref().is_some_and(is_followed) {
                return Ok(best);
            }
        }
    }
    // Otherwise the model is wrong, or more was done: what follows is explained up to the next push only.
    let farther = |found: &Fit| -> Result<bool, FitError> {
        let Some(model) = found.scenes.first().map(|s| &s.model) else { return Ok(false) };
        let further = followed_prefix(scene, model, options, stop)?;
        Ok(further.is_none_or(|(_, next)| next >= end + AFTER + CONTACT_FRAMES))
    };
    match best {
        Some(found) if farther(&found)? => Ok(Some(found)),
        _ => Ok(None),
    }
}

/// The model of the longest part from the start that is followed, and the number of its frames; `None` if it is the whole.
fn followed_prefix(
    scene: &Scene,
    model: &Model,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<(Model, usize)>, FitError> {
    let (mut followed, mut not) = (SHORTEST, scene.times.len());
    let mut best: Option<Model> = None;
    while not - followed.min(not) > 1 {
        let middle = (followed + not) / 2;
        let part = first_frames(scene, middle);
        // What has no sample yet has no start: the scene is refused.
        let fit = estimate_one(&part, model, options, stop)?;
        if out_of_noise(&part, &fit).is_none() {
            followed = middle;
            best = fit.scenes.into_iter().next().map(|s| s.model);
        } else {
            not = middle;
        }
    }
    Ok(best.map(|model| (model, followed)).filter(|_| followed + 1 < scene.times.len()))
}

fn first_frames(scene: &Scene, frames: usize) -> Scene {
    let mut part = scene.clone();
    part.times.truncate(frames);
    for track in &mut part.tracks {
        // One that enters later keeps its first sample.
        let seen = track.samples.iter().filter(|s| s.frame < frames).count().max(1);
        track.samples.truncate(seen);
        part.times = scene.times[..part.times.len().max(track.samples.last().map_or(0, |s| s.frame + 1))].to_vec();
    }
    part
}

/// The first object and frame of a fit beyond noise: where two neighbouring samples of an object are.
fn out_of_noise(scene: &Scene, fit: &Fit) -> Option<(usize, usize)> {
    let fitted = fit.scenes.first()?;
    departure_of(scene, &fitted.model, fitted.noise_sigma, 0)
}

/// The first object and frame from `from` on at which a simulation is out of the noise (m).
fn departure_of(scene: &Scene, model: &Model, sigma: f64, from: usize) -> Option<(usize, usize)> {
    let limits = SimulationLimits::default();
    let run = simulate_observed::<f64>(model, &model.flatten(), &scene.times, &limits);
    let far = |object: usize, track: &Track| {
        let id = scene.objects[object].id;
        let off = |s: &crate::scene::Sample| {
            let state = run.states.get(s.frame)?.get(object).copied().flatten()?;
            Some(((state.position - s.position).norm(), s.frame))
        };
        let counts = |s: &&crate::scene::Sample| s.frame >= from && !model.passes_over(id, scene.time_of(s.frame));
        let all: Vec<(f64, usize)> = track.samples.iter().filter(counts).filter_map(off).collect();
        let two = |w: &[(f64, usize)]| w.iter().map(|o| o.0).sum::<f64>() > 2.0 * DRIFT * sigma;
        all.windows(2).find(|w| two(w)).map(|w| (w[0].1, object))
    };
    let each = scene.tracks.iter().enumerate().filter_map(|(object, track)| far(object, track));
    each.min().map(|(frame, object)| (object, frame))
}

/// Mean distance of two neighbouring samples from a fit beyond which it does not follow them (deviations).
const DRIFT: f64 = 4.0;

/// The object that leaves first the track that a model of the frames before `end` predicts.
fn leaves_first(scene: &Scene, prefix: &Model, end: usize) -> Option<usize> {
    let sigma = estimate_noise(scene).position;
    departure_of(scene, prefix, sigma, end.saturating_sub(BEFORE[0])).map(|(object, _)| object)
}

/// Whether an object may touch another, or a wall, about the end of what is followed.
fn may_touch(scene: &Scene, prefix: &Model, object: usize, end: usize) -> bool {
    let frames = end.saturating_sub(CONTACT_FRAMES)..end + BESIDE;
    let times = [frames.start, frames.end].map(|f| scene.time_of(f));
    let id = scene.objects[object].id;
    let collides = trace(prefix, &scene.times).events.iter().any(|e| {
        e.kind == EventKind::Collision && e.objects.contains(&id) && times[0] <= e.time && e.time <= times[1]
    });
    let radius = |k: usize| scene.objects[k].shape.bounding_radius();
    let near = |other: usize, frame: usize| {
        let place = |k: usize| scene.tracks[k].at(frame).map(|s| s.position);
        let pair = place(object).zip(place(other));
        pair.is_some_and(|(a, b)| (a - b).norm() < WALL_REACH * (radius(object) + radius(other)))
    };
    let mut others = (0..scene.tracks.len()).filter(|k| *k != object);
    collides || others.any(|other| frames.clone().any(|frame| near(other, frame)))
}

/// Two impulses on an object between which nothing counts: one after frame `first`, one so much later (s).
fn span(scene: &Scene, prefix: &Model, object: usize, first: usize, duration: f64) -> Option<[UnknownImpulse; 2]> {
    let start = impulse_time(scene, first)?;
    let last = scene.times.partition_point(|t| *t < start + duration);
    let end = impulse_time(scene, last)?;
    let after: Vec<&crate::scene::Sample> =
        scene.tracks[object].samples.iter().filter(|s| s.frame > last).take(AFTER).collect();
    let (a, b) = (after.first()?, after.last()?);
    if after.len() < AFTER {
        return None;
    }
    let run = trace(prefix, &[prefix.bodies.iter().map(|b| b.start.time).fold(start, f64::min), start]);
    let state = run.states.last()?.get(object).copied().flatten()?;
    let velocity = (b.position - a.position).scaled(1.0 / (scene.time_of(b.frame) - scene.time_of(a.frame)));
    let there = a.position - velocity.scaled(scene.time_of(a.frame) - end);
    let between = (there - state.position).scaled(1.0 / (end - start));
    let at = |frame, change| {
        Some(UnknownImpulse { delay_sd: 0.0, ..impulse(scene, object, frame, change)? })
    };
    let begins = UnknownImpulse { until: Some(end), ..at(first, between - state.velocity)? };
    Some([begins, at(last, velocity - between)?])
}
