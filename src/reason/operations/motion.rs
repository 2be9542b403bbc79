//! The operations that read the motion of a rollout: positions, speeds, times.

use super::machine::{Machine, Outcome, happened};
use super::ops;
use crate::num::{Vec2, elementary};
use crate::reason::context::Halt;
use crate::reason::events::{MOVING_SPEED, SceneEvent, SceneEventKind};
use crate::reason::value::ProgramValue::*;
use crate::reason::value::SpanKind;
use crate::world::{EventKind, State, Trace};

/// "Just before" and "just after" an event are this far from it (s): less than any time between two contacts that the video shows,
/// more than the precision of a contact's time.
const JUST: f64 = 1e-6;

/// Pops a moment: its time (s).
pub fn time(m: &mut Machine) -> Result<f64, Halt> {
    let scene = m.context.scene;
    Ok(match m.pop()? {
        Time(time) => time,
        Event(event) => match event.kind {
            SceneEventKind::End => scene.times.last().copied().unwrap_or(0.0),
            _ => happened(event)?.time,
        },
        Frame(Some(frame)) => scene.time_of(frame),
        Factor(frame) => scene.time_of(frame as usize),
        _ => return Err(m.mismatch()),
    })
}

/// The rollout up to a time; beyond what is simulated, the answer is not determined.
fn trace<'a>(m: &Machine<'a>, time: f64) -> Result<&'a Trace, Halt> {
    let scene = m.context.scene;
    // The frame after it too, for the state between.
    let needed = scene.frame_at(time) + 1;
    let (video, most) = (m.context.frames(SpanKind::Video), m.context.frames(SpanKind::Both));
    if needed > most {
        let end = scene.time_of(most.saturating_sub(1));
        let time = if time < 1e9 { format!("{time:.2}") } else { format!("{time:.2e}") };
        return Err(Halt::Undetermined(format!(
            "{time} s is beyond the simulation, which ends at {end:.2} s"
        )));
    }
    m.context.trace(&m.supposed, if needed > video { most } else { video })
}

/// The state of an object at a time. Between frames it is followed from the frame on the same side of each event of the object.
pub fn state(m: &Machine, object: usize, time: f64) -> Result<State, Halt> {
    let (trace, scene) = (trace(m, time)?, m.context.scene);
    let absent = || {
        let who = ops::name(scene, object);
        Halt::Undetermined(format!("{who} is not in the scene at {time:.2} s"))
    };
    let id = ops::id(scene, object)?;
    let body = trace.ids.iter().position(|i| *i == id).ok_or_else(absent)?;
    let frame = scene.frame_at(time);
    let at = |frame: usize| -> Option<(f64, State)> {
        let state = trace.states.get(frame)?.get(body).copied().flatten()?;
        Some((*trace.times.get(frame)?, state))
    };
    let (before, after) = (at(frame), at(frame + 1));
    let events = trace.events.iter().filter(|e| e.objects.contains(&id) && e.kind != EventKind::Stop);
    let is_between = |from: f64, to: f64| events.clone().any(|e| e.time > from && e.time <= to);
    let moved = |(t, s): (f64, State)| State { position: s.position + s.velocity * (time - t), ..s };
    match (before, after) {
        (Some(one), _) if time - one.0 <= f64::EPSILON => Ok(one.1),
        (Some(one), Some(two)) if !is_between(one.0, two.0) => {
            let share = (time - one.0) / (two.0 - one.0);
            let mix = |a: Vec2, b: Vec2| a + (b - a) * share;
            Ok(State {
                position: mix(one.1.position, two.1.position),
                velocity: mix(one.1.velocity, two.1.velocity),
                spin: one.1.spin + (two.1.spin - one.1.spin) * share,
                ..one.1
            })
        }
        (Some(one), _) if !is_between(one.0, time) => Ok(moved(one)),
        (_, Some(two)) if !is_between(time, two.0) => Ok(moved(two)),
        (Some(one), _) => Ok(moved(one)),
        _ => Err(absent()),
    }
}

pub fn position(m: &mut Machine) -> Outcome {
    let (at, object) = (time(m)?, m.object()?);
    Ok(Vector(state(m, object, at)?.position, "m"))
}

pub fn velocity(m: &mut Machine) -> Outcome {
    let (at, object) = (time(m)?, m.object()?);
    Ok(Vector(state(m, object, at)?.velocity, "m/s"))
}

pub fn speed(m: &mut Machine) -> Outcome {
    let (at, object) = (time(m)?, m.object()?);
    Ok(Quantity(state(m, object, at)?.velocity.norm(), "m/s"))
}

/// Change of the speed over two frames around the moment; over the frames on one side where a collision is near.
pub fn acceleration(m: &mut Machine) -> Outcome {
    let (at, object) = (time(m)?, m.object()?);
    let step = 1.0 / m.context.scene.fps;
    let first = m.context.scene.times.first().copied().unwrap_or(0.0);
    let (from, to) = ((at - step).max(first), at + step);
    let change = state(m, object, to)?.velocity - state(m, object, from)?.velocity;
    Ok(Quantity(change.norm() / (to - from), "m/s^2"))
}

/// Counter-clockwise from the x axis.
pub fn direction(m: &mut Machine) -> Outcome {
    let (at, object) = (time(m)?, m.object()?);
    let v = state(m, object, at)?.velocity;
    if v.norm() <= MOVING_SPEED {
        let who = ops::name(m.context.scene, object);
        return Err(Halt::Undetermined(format!("{who} is at rest at {at:.2} s")));
    }
    Ok(Quantity(elementary::atan2(v.y, v.x).to_degrees(), "degrees"))
}

pub fn spin(m: &mut Machine) -> Outcome {
    let (at, object) = (time(m)?, m.object()?);
    Ok(Quantity(state(m, object, at)?.spin, "rad/s"))
}

pub fn is_moving(m: &mut Machine) -> Outcome {
    let (at, object) = (time(m)?, m.object()?);
    if m.supposed.is_empty() {
        let frame = m.context.scene.frame_at(at);
        let rollout = m.context.rollout(&[], m.context.frames(SpanKind::Video))?;
        let seen = rollout.moving.get(object).and_then(|of| of.get(frame)).copied().flatten();
        if let Some(moves) = seen {
            return Ok(Bool(moves));
        }
    }
    Ok(Bool(in_motion(&state(m, object, at)?)))
}

/// Whether it moves at any time of a span.
pub fn moves(m: &mut Machine) -> Outcome {
    let (span, object) = (m.span()?, m.object()?);
    if span == SpanKind::Video && m.supposed.is_empty() {
        let rollout = m.context.rollout(&[], m.context.frames(SpanKind::Video))?;
        return Ok(Bool(!ops::filter_motion(rollout, &[object], None, true).is_empty()));
    }
    Ok(Bool(path(m, object, span)?.iter().any(|(_, s)| in_motion(s))))
}

pub fn distance(m: &mut Machine) -> Outcome {
    let (at, b, a) = (time(m)?, m.object()?, m.object()?);
    apart(m, [a, b], at)
}

/// The distance of two objects at a time (centres).
fn apart(m: &Machine, [a, b]: [usize; 2], at: f64) -> Outcome {
    Ok(Quantity((state(m, a, at)?.position - state(m, b, at)?.position).norm(), "m"))
}

/// The distance of the only two objects.
pub fn separation(m: &mut Machine) -> Outcome {
    let (at, objects) = (time(m)?, m.objects()?);
    match objects[..] {
        [a, b] => apart(m, [a, b], at),
        _ => Err(m.mismatch()),
    }
}

fn in_motion(state: &State) -> bool {
    state.velocity.norm() > MOVING_SPEED
}

/// The first frame of a path from which on the object rests, after it moved; `None` where it never moves, or moves to the end.
fn rests_from(path: &[(f64, State)]) -> Option<f64> {
    path.get(path.iter().rposition(|(_, s)| in_motion(s))? + 1).map(|(t, _)| *t)
}

/// Times and states of an object at the frames of a span; in the video only where it is observed.
fn path(m: &Machine, object: usize, span: SpanKind) -> Result<Vec<(f64, State)>, Halt> {
    let (scene, video) = (m.context.scene, m.context.frames(SpanKind::Video));
    let trace = m.context.trace(&m.supposed, m.context.frames(span))?;
    let id = ops::id(scene, object)?;
    let absent = || Halt::Undetermined(format!("{} is not in the scene", ops::name(scene, object)));
    let body = trace.ids.iter().position(|i| *i == id).ok_or_else(absent)?;
    let first = if span == SpanKind::Prediction { video.saturating_sub(1) } else { 0 };
    let seen =
        |frame: usize| frame >= video || scene.tracks.get(object).is_some_and(|t| t.at(frame).is_some());
    let all_seen = !m.supposed.is_empty();
    let states = trace.states.iter().enumerate().take(m.context.frames(span)).skip(first);
    let found: Vec<(f64, State)> = states
        .filter(|(frame, _)| all_seen || seen(*frame))
        .filter_map(|(frame, row)| Some((*trace.times.get(frame)?, row.get(body).copied().flatten()?)))
        .collect();
    if found.is_empty() { Err(absent()) } else { Ok(found) }
}

fn length(path: &[(f64, State)]) -> f64 {
    path.windows(2).map(|w| (w[1].1.position - w[0].1.position).norm()).sum()
}

pub fn path_length(m: &mut Machine) -> Outcome {
    let (span, object) = (m.span()?, m.object()?);
    Ok(Quantity(length(&path(m, object, span)?), "m"))
}

pub fn displacement(m: &mut Machine) -> Outcome {
    let (span, object) = (m.span()?, m.object()?);
    let path = path(m, object, span)?;
    let ends = path.first().zip(path.last());
    Ok(Quantity(ends.map_or(0.0, |(a, b)| (b.1.position - a.1.position).norm()), "m"))
}

/// Largest, smallest or mean speed.
pub fn speed_over(m: &mut Machine) -> Outcome {
    let (span, object) = (m.span()?, m.object()?);
    let path = path(m, object, span)?;
    let speeds = path.iter().map(|(_, s)| s.velocity.norm());
    Ok(Quantity(
        match m.token() {
            "top_speed" => speeds.fold(0.0, f64::max),
            "least_speed" => speeds.fold(f64::INFINITY, f64::min),
            _ => speeds.sum::<f64>() / path.len().max(1) as f64,
        },
        "m/s",
    ))
}

/// Frames, distances and times at which two objects are closest (centres).
fn closest(m: &mut Machine) -> Result<(f64, f64), Halt> {
    let (span, b, a) = (m.span()?, m.object()?, m.object()?);
    let (a, b) = (path(m, a, span)?, path(m, b, span)?);
    let both = a.iter().filter_map(|(t, s)| {
        let other = b.iter().find(|(u, _)| u == t)?;
        Some((*t, (s.position - other.1.position).norm()))
    });
    both.min_by(|x, y| x.1.total_cmp(&y.1))
        .ok_or_else(|| Halt::Undetermined("the objects are never in the scene together".into()))
}

pub fn closest_distance(m: &mut Machine) -> Outcome {
    Ok(Quantity(closest(m)?.1, "m"))
}

pub fn closest_time(m: &mut Machine) -> Outcome {
    Ok(Time(closest(m)?.0))
}

/// Path from an event on until the object rests, collides again, or the span ends.
pub fn path_after(m: &mut Machine) -> Outcome {
    let (event, object) = (happened(m.event()?)?, m.object()?);
    let span = if event.frame < m.context.scene.times.len() { SpanKind::Video } else { SpanKind::Both };
    let events = m.context.events(&m.supposed, span)?;
    let next = events
        .iter()
        .find(|e| e.time > event.time && e.kind == SceneEventKind::Collision && e.objects.contains(&object));
    let until = next.map_or(f64::INFINITY, |e| e.time);
    let path: Vec<(f64, State)> =
        path(m, object, span)?.into_iter().filter(|(t, _)| *t > event.time && *t < until).collect();
    Ok(Quantity(length(&path), "m"))
}

/// The time at which it first moves, or from which on it rests.
pub fn motion_time(m: &mut Machine) -> Outcome {
    let starts = m.token() == "start_time";
    let (span, object) = (m.span()?, m.object()?);
    let path = path(m, object, span)?;
    let who = ops::name(m.context.scene, object);
    let Some((begins, _)) = path.iter().find(|(_, s)| in_motion(s)) else {
        return Err(Halt::Undetermined(format!("{who} never moves")));
    };
    if starts {
        return Ok(Time(*begins));
    }
    rests_from(&path).map(Time).ok_or_else(|| {
        let end = path.last().map_or(0.0, |(t, _)| *t);
        Halt::Undetermined(format!("{who} still moves at {end:.2} s, where the simulation or its view ends"))
    })
}

/// Whether it has moved and rests from some frame on.
pub fn stops(m: &mut Machine) -> Outcome {
    let (span, object) = (m.span()?, m.object()?);
    Ok(Bool(rests_from(&path(m, object, span)?).is_some()))
}

/// Time that it moves, or rests.
pub fn motion_duration(m: &mut Machine) -> Outcome {
    let moving = m.token() == "moving_duration";
    let (span, object) = (m.span()?, m.object()?);
    let path = path(m, object, span)?;
    let steps = path.windows(2).filter(|w| in_motion(&w[0].1) == moving);
    Ok(Quantity(steps.map(|w| w[1].0 - w[0].0).sum(), "s"))
}

pub fn get_time(m: &mut Machine) -> Outcome {
    Ok(Time(happened(m.event()?)?.time))
}

/// Seconds from the end of the video to an event.
pub fn until(m: &mut Machine) -> Outcome {
    let event = happened(m.event()?)?;
    Ok(Quantity(event.time - m.context.scene.times.last().copied().unwrap_or(0.0), "s after the video ends"))
}

pub fn at_frame(m: &mut Machine) -> Outcome {
    Ok(Frame(Some(m.factor()? as usize)))
}

pub fn at_time(m: &mut Machine) -> Outcome {
    Ok(Time(m.factor()? + m.context.scene.times.first().copied().unwrap_or(0.0)))
}

/// A moment some seconds before or after another.
pub fn offset(m: &mut Machine) -> Outcome {
    let by = m.factor()?;
    let at = time(m)?;
    Ok(Time(if m.token() == "earlier" { at - by } else { at + by }))
}

pub fn beside_event(m: &mut Machine) -> Outcome {
    let event = happened(m.event()?)?;
    Ok(Time(event.time + if m.token() == "just_before" { -JUST } else { JUST }))
}

/// Speed that an object loses in a collision as frames show it: the mean over the last whole frame interval before it, minus that
/// over the first one after it.
pub fn speed_lost(m: &mut Machine) -> Outcome {
    let (object, event): (usize, SceneEvent) = (m.object()?, happened(m.event()?)?);
    let (scene, half) = (m.context.scene, 0.5 / m.context.scene.fps);
    let frame =
        if scene.time_of(event.frame) < event.time { event.frame } else { event.frame.saturating_sub(1) };
    let first = scene.times.first().copied().unwrap_or(0.0);
    let before = state(m, object, (scene.time_of(frame) - half).max(first))?.velocity.norm();
    let after = state(m, object, scene.time_of(event.frame + 1) + half)?.velocity.norm();
    Ok(Quantity(before - after, "m/s"))
}

/// The object with the most of something.
pub fn extreme(m: &mut Machine) -> Outcome {
    let token = m.token();
    let is_instant = ["fastest", "slowest"].contains(&token);
    let at = if is_instant { time(m)? } else { 0.0 };
    let span = if is_instant { SpanKind::Video } else { m.span()? };
    let objects = m.objects()?;
    let score = |object: usize| -> Result<f64, Halt> {
        if is_instant {
            let speed = state(m, object, at)?.velocity.norm();
            return Ok(if token == "fastest" { speed } else { -speed });
        }
        let path = path(m, object, span)?;
        Ok(match token {
            "farthest" => length(&path),
            "least_far" => -length(&path),
            // Only one that moved and then rests has stopped.
            _ => rests_from(&path).map_or(f64::NEG_INFINITY, |t| -t),
        })
    };
    let mut best: Option<(usize, f64)> = None;
    for object in objects {
        match score(object) {
            Ok(score) if score.is_finite() && best.is_none_or(|b| score > b.1) => {
                best = Some((object, score))
            }
            Ok(_) | Err(Halt::Undetermined(_)) => {}
            Err(halt) => return Err(halt),
        }
    }
    best.map(|(i, _)| Object(i)).ok_or_else(|| Halt::Undetermined("none of the objects does".into()))
}
