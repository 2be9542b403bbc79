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

use super::followed::{FollowedStart, followed_start};
use super::outcome::Discovery;
use super::proof;
use super::resample::speed;
use super::smooth_track::{ChangePoint, change_near, paths, positions, sigmas_between};
use crate::fit::{Fit, FitError, FitOptions, Noise, SceneFit, StartPoint, estimate_noise, estimate_one};
use crate::num::{Stop, Vec2, elementary};
use crate::scene::{Sample, Scene, Track};
use crate::world::{Model, UnknownImpulse, UnseenPush, trace};
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
/// Frames before the first that leaves its track in which a push may have started: it is seen once it has moved the object by more than
/// the noise.
const BEFORE: [usize; 3] = [2, 5, 10];
/// How long a push may last (s).
const DURATIONS: [f64; 5] = [0.06, 0.12, 0.25, 0.5, 1.0];
/// How long one that was taken for an impulse may last (s).
const WIDENED: [f64; 3] = [0.06, 0.12, 0.25];
/// Samples through which the velocity after a push is measured, and fewest after it that are worth passing it over.
const AFTER: usize = 8;
/// Frames around a change in which the place of another object is taken for that in the change.
const CONTACT_FRAMES: usize = 8;

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
            best = widened(scene, found, options, stop)?;
        }
    }
    // What lasts is passed over only if the model explains all that remains.
    let mut next = best.clone();
    while !is_followed(&next) && next.scenes.iter().all(|s| s.model.impulses.len() < MOST) {
        match lasting(scene, &next, options, stop)? {
            Some(found) if is_worth_its_price(scene, &next, &found) => next = found,
            _ => break,
        }
    }
    Ok(if is_followed(&next) { next } else { best })
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
    // A thing that nobody saw takes the impulse of a push for a contact with it: then the push is sought without it.
    let unseen = found.names_unseen_bodies();
    let one = |(k, (scene, model)): (usize, (&Scene, &Model))| -> Result<(Model, bool), FitError> {
        let own = last.fit.of_scene(k);
        let Some(fitted) = own.scenes.first().filter(|s| s.reduced_chi_square > FOLLOWED).cloned() else {
            return Ok((Model { impulses: pushes_of(&last.fit, k), ..model.clone() }, false));
        };
        let before = fitted.model.impulses.len();
        let passing = match unseen {
            false => pass_over_pushes(scene, &fitted.model, own, options, stop)?,
            true => fit_passing_over_pushes(scene, model, options, stop)?,
        };
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

/// Adds to a discovery's reason what something unseen did, at the frames in which it acts as the last fits have it.
pub fn name_pushes(scenes: &[Scene], found: &mut Discovery) {
    for revision in &mut found.revisions {
        for (scene, fitted) in scenes.iter().zip(&mut revision.fit.scenes) {
            fitted.model.impulses.iter_mut().for_each(|i| i.frame = scene.frame_at(i.acts_at()));
        }
    }
    let Some(last) = found.revisions.last() else { return };
    let of = |(scene, fitted): (&Scene, &SceneFit)| -> Vec<String> {
        let sentence = |p: &UnseenPush| format!("{}: {}", scene.name, p.sentence());
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
    let cost =
        |fit: &Fit| -> f64 { proof::deviance(fit) + fit.scenes.iter().map(|s| price(scene, s)).sum::<f64>() };
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
        let same =
            |i: &UnknownImpulse| i.id == scene.objects[object].id && i.frame.abs_diff(frame) <= 2 * BESIDE;
        model.impulses.iter().any(same)
    };
    let mut found = vec![];
    for (object, path) in paths(scene, &noise).iter().enumerate() {
        for jump in &path.jumps {
            let dealt = dealt_by_object(scene, &noise, model, object, jump)
                || dealt_by_wall(scene, model, object, jump);
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
        let kept = kept(scene, &fit);
        let fewer = kept.len() < model.impulses.len();
        let moved = kept.iter().zip(&pushes_of(&fit, 0)).any(|(a, b)| a.frame != b.frame);
        if !fewer && !moved {
            break;
        }
        if let Some(known) = fit.scenes.first() {
            model.copy_state_from(&known.model);
        }
        model.impulses = kept;
        let next = estimate_one(scene, &model, &from_there(options), stop)?;
        if !fewer && proof::deviance(&next) > proof::deviance(&fit) {
            break;
        }
        fit = next;
    }
    Ok(fit)
}

fn from_there(options: &FitOptions) -> FitOptions {
    FitOptions { start_point: StartPoint::YawSearched, ..*options }
}

/// A local search: what differs between the trials is known well from the tracks.
fn local(options: &FitOptions) -> FitOptions {
    FitOptions { start_point: StartPoint::NearOptimum, ..*options }
}

/// The fit in which pushes that took longer than a frame are passed over for as long as they took: where impulses at one time leave
/// more than noise, and it is noise that is left without the measurements around them. Otherwise a law is missing, and they stay.
fn widened(scene: &Scene, fit: Fit, options: &FitOptions, stop: Stop) -> Result<Fit, FitError> {
    let mut best = fit.clone();
    for impulse in pushes_of(&fit, 0).into_iter().filter(|i| i.until.is_none()) {
        let object = scene.object_index(impulse.id);
        let Some((object, interval)) = object.zip(interval(scene, impulse.frame)) else { continue };
        for duration in WIDENED {
            let Some(model) = best.scenes.first().filter(|s| !is_at_noise(s)).map(|s| s.model.clone()) else {
                return Ok(best);
            };
            let half = ((0.5 * duration / interval).ceil() as usize).max(1);
            let first = impulse.frame.saturating_sub(half);
            let Some(pair) = span(scene, &model, object, first, impulse.frame + half) else { break };
            let mut with = model;
            with.impulses.retain(|i| !within(i, &pair));
            with.impulses.extend(pair);
            let found = estimate_one(scene, &with, &local(options), stop)?;
            if is_worth_its_price(scene, &best, &found) {
                best = found;
            }
        }
    }
    let explained = best.scenes.iter().all(is_at_noise);
    Ok(if explained { best } else { fit })
}

/// Whether an impulse is in the span of two others on the same object.
fn within(impulse: &UnknownImpulse, [begin, end]: &[UnknownImpulse; 2]) -> bool {
    impulse.id == begin.id && begin.time <= impulse.time && impulse.time <= end.time
}

/// From a frame to the next (s).
fn interval(scene: &Scene, frame: usize) -> Option<f64> {
    Some(scene.times.get(frame + 1)? - scene.times.get(frame)?)
}

/// Whether noise explains what a fit leaves: chi-square within four of its deviations.
fn is_at_noise(fitted: &SceneFit) -> bool {
    fitted.reduced_chi_square <= 1.0 + 4.0 * (2.0 / fitted.degrees_of_freedom.max(1) as f64).sqrt()
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
        let frame = scene.frame_at(i.acts_at());
        match impulse_time(scene, frame) {
            Some(time) if i.delay_sd > 0.0 && frame != i.frame => {
                UnknownImpulse { frame, delay: i.acts_at() - time, time, ..i }
            }
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
    let start = followed_start(scene, model, options, stop)?;
    let Some(FollowedStart { model: prefix, frames: end, object, .. }) =
        start.filter(|s| !s.may_be_a_contact())
    else {
        return Ok(None);
    };
    let track = &scene.tracks[object];
    let (noise, own) = (estimate_noise(scene).of_track(track), positions(scene, track));
    let mut best: Option<Fit> = None;
    for duration in DURATIONS {
        for before in BEFORE {
            let Some(first) = end.checked_sub(before + 1) else { continue };
            let Some(start) = impulse_time(scene, first) else { continue };
            let last = scene.times.partition_point(|t| *t < start + duration);
            let sudden = sigmas_between(scene, &noise, &own, [first, last]).is_some_and(|s| s > CERTAIN);
            let Some(pair) = span(scene, &prefix, object, first, last).filter(|_| sudden) else { continue };
            let mut with = model.clone();
            with.copy_state_from(&prefix);
            with.impulses.extend(pair);
            let found = estimate_one(scene, &with, &local(options), stop)?;
            if best.as_ref().is_none_or(|b| proof::deviance(&found) < proof::deviance(b)) {
                best = Some(found);
            }
            if best.as_ref().is_some_and(is_followed) {
                return Ok(best);
            }
        }
    }
    Ok(best)
}

/// Two impulses on an object between which nothing counts: one after frame `first`, one after frame `last`, as the track and a model
/// up to there say.
fn span(
    scene: &Scene,
    model: &Model,
    object: usize,
    first: usize,
    last: usize,
) -> Option<[UnknownImpulse; 2]> {
    let (start, end) = (impulse_time(scene, first)?, impulse_time(scene, last)?);
    let after: Vec<&Sample> =
        scene.tracks[object].samples.iter().filter(|s| s.frame > last).take(AFTER).collect();
    let (a, b) = (after.first()?, after.last()?);
    if after.len() < AFTER {
        return None;
    }
    let run = trace(model, &[model.bodies.iter().map(|b| b.start.time).fold(start, f64::min), start]);
    let state = run.states.last()?.get(object).copied().flatten()?;
    let velocity = (b.position - a.position).scaled(1.0 / (scene.time_of(b.frame) - scene.time_of(a.frame)));
    let there = a.position - velocity.scaled(scene.time_of(a.frame) - end);
    let between = (there - state.position).scaled(1.0 / (end - start));
    let at = |frame, change| Some(UnknownImpulse { delay_sd: 0.0, ..impulse(scene, object, frame, change)? });
    let begins = UnknownImpulse { until: Some(end), ..at(first, between - state.velocity)? };
    Some([begins, at(last, velocity - between)?])
}

#[cfg(test)]
mod tests {
    use super::super::tests::{DISC, Launch, film_under, models};
    use super::super::{DiscoverOptions, Verdict, discover};
    use super::*;
    use crate::num::{never, vec2};
    use crate::world::ActiveEffect;
    use std::cell::Cell;

    /// Videos of the launches, the first with these pushes: object, time, change of the velocity.
    fn pushed(launches: &[Vec<Launch>], tilt: f64, pushes: &[(u32, f64, [f64; 2])]) -> Vec<Scene> {
        let number = Cell::new(0);
        film_under(launches, |model| {
            if number.replace(number.get() + 1) == 0 {
                let one = |&(id, time, [x, y]): &(u32, f64, [f64; 2])| UnknownImpulse {
                    id,
                    time,
                    frame: 0,
                    until: None,
                    velocity: vec2(x, y),
                    spin: 0.3,
                    delay: 0.0,
                    velocity_sd: 0.0,
                    spin_sd: 0.0,
                    delay_sd: 0.0,
                };
                model.impulses = pushes.iter().map(one).collect();
            }
            if tilt != 0.0 {
                let entry = crate::effects::effect("tilt").expect("it is in the library");
                let mut active = ActiveEffect::new(&entry.spec, &model.bodies);
                active.parameters[0].values.fill(tilt);
                model.effects.push(active);
            }
        })
    }

    fn fitted(scene: &Scene) -> [SceneFit; 2] {
        let start = models(std::slice::from_ref(scene)).remove(0);
        let options = FitOptions::default();
        let plain = estimate_one(scene, &start, &options, &never).expect("it can be fitted");
        let passing =
            pass_over_pushes(scene, &start, plain.clone(), &options, &never).expect("it can be fitted");
        [plain, passing].map(|mut fit| fit.scenes.remove(0))
    }

    #[test]
    fn a_push_is_named_and_the_video_is_followed_after_it() {
        let launches = [vec![(DISC, 0.6, [-2.0, 0.5], [1.3, 0.1]), (DISC, 2.0, [1.5, -1.5], [-0.5, 0.9])]];
        let scene = &pushed(&launches, 0.0, &[(1, 2.1, [0.3, -0.8])])[0];
        let [plain, passing] = fitted(scene);
        assert!(plain.reduced_chi_square > 10.0 && passing.reduced_chi_square < 1.2, "{passing:?}");
        let [push] = passing.model.unseen_pushes()[..] else { panic!("{:?}", passing.model.impulses) };
        assert_eq!((push.id, push.frames), (1, [52, 52]));
        assert!((push.velocity - vec2(0.3, -0.8)).norm() < 0.03, "{push:?}");
    }

    #[test]
    fn a_hand_that_holds_an_object_for_a_while_is_passed_over() {
        let launches = [vec![(DISC, 0.6, [-2.0, 0.5], [1.0, 0.1])]];
        let slowed = (0..8).map(|k| (0, 1.5 + 0.06 * f64::from(k), [-0.1, 0.1]));
        let scene = &pushed(&launches, 0.0, &slowed.collect::<Vec<_>>())[0];
        let [plain, passing] = fitted(scene);
        assert!(plain.reduced_chi_square > 10.0 && passing.reduced_chi_square < FOLLOWED, "{passing:?}");
        let pushes = passing.model.unseen_pushes();
        let change = pushes.iter().fold(vec2(0.0, 0.0), |sum, p| sum + p.velocity);
        assert!(pushes.len() < 3 && (change - vec2(-0.8, 0.8)).norm() < 0.1, "{pushes:?}");
    }

    #[test]
    fn a_collision_is_no_push() {
        let launches = [vec![(DISC, 0.6, [-1.5, 0.0], [1.2, 0.0]), (DISC, 0.9, [-0.5, 0.15], [0.0, 0.0])]];
        let scene = &pushed(&launches, 0.0, &[])[0];
        assert_eq!(fitted(scene)[1].model.impulses, []);
        // Nor if the sizes are not right: each takes up what the other gives.
        let mut small = scene.clone();
        small.objects.iter_mut().for_each(|o| o.shape = crate::scene::Shape::Disc { radius: 0.12 });
        assert_eq!(impulses(&small, &models(std::slice::from_ref(&small))[0]), []);
    }

    #[test]
    fn a_push_in_one_video_of_three_does_not_hide_a_law_nor_become_one() {
        let launches = [
            vec![(DISC, 0.6, [-1.5, 0.5], [1.0, 0.3])],
            vec![(DISC, 0.6, [0.0, 1.5], [0.4, -1.2])],
            vec![(DISC, 0.6, [-1.5, -1.5], [0.8, 0.9])],
        ];
        for (tilt, verdict) in [(0.0, Verdict::Adequate), (0.15, Verdict::EffectFound)] {
            let scenes = pushed(&launches, tilt, &[(0, 1.9, [-0.5, 0.4])]);
            let found = discover(&scenes, &models(&scenes), &DiscoverOptions::default(), &never)
                .expect("not stopped");
            let ambiguous = found.verdict == Verdict::Ambiguous && tilt > 0.0;
            assert!(found.verdict == verdict || ambiguous, "{:?}: {}", found.verdict, found.reason);
            let last = found.revisions.last().expect("it has one");
            assert!(last.fit.scenes.iter().all(|s| s.reduced_chi_square < 1.3), "{}", found.reason);
            let named = "video 0: object 0 is pushed by something unseen at frame 47";
            assert!(found.reason.contains(named), "{}", found.reason);
        }
    }
}
