//! What happened, in each rollout: collisions, entrances and exits by frame, and which objects moved.

use super::Prediction;
use crate::scene::{Scene, WorldKind};
use crate::world::{EventKind, Intervention, Trace};
use std::collections::BTreeSet;

/// Frames that a prediction goes on after the video: "next" is within a little more than two seconds.
pub const FUTURE_FRAMES: usize = 58;
/// Slowest speed that counts as moving (m/s).
pub const MOVING_SPEED: f64 = 0.02;

/// Sides of a table.
pub const SIDES: [&str; 4] = ["left", "right", "top", "bottom"];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Collision,
    /// One object collides with this side of the table.
    Side(&'static str),
    In,
    Out,
    Start,
    End,
    /// Stands for an event that was asked for and did not happen.
    Never,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneEvent {
    pub kind: Kind,
    pub frame: usize,
    /// Indices of the scene's objects, sorted.
    pub objects: Vec<usize>,
}

impl SceneEvent {
    /// The same event, whenever it happens.
    pub fn is_like(&self, other: &SceneEvent) -> bool {
        self.kind != Kind::Never && self.kind == other.kind && self.objects == other.objects
    }
}

/// What one set of interventions leads to, in each rollout; rollout 0 is the best one, the ensemble follows.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    pub interventions: Vec<Intervention>,
    pub rollouts: Vec<Past>,
}

/// One rollout.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Past {
    /// By frame.
    pub events: Vec<SceneEvent>,
    /// `moving[object][frame]` of the observed frames; `None` where it was not seen.
    pub moving: Vec<Vec<Option<bool>>>,
}

/// Reads the events off every rollout of a simulation.
pub fn world(scene: &Scene, prediction: &Prediction) -> World {
    let traces = std::iter::once(&prediction.best).chain(&prediction.ensemble);
    let plain = prediction.interventions.is_empty();
    let rollouts = traces.map(|trace| Past {
        events: events(scene, trace, plain),
        moving: if plain { moving(scene, trace) } else { vec![] },
    });
    World { interventions: prediction.interventions.clone(), rollouts: rollouts.collect() }
}

/// By CLEVRER's rule a pair collides once: its annotations tell the first contact, also where the two part and meet again.
fn events(scene: &Scene, trace: &Trace, plain: bool) -> Vec<SceneEvent> {
    let mut events = vec![];
    for event in trace.events.iter().filter(|e| e.kind == EventKind::Collision) {
        let mut objects: Vec<usize> = event.objects.iter().filter_map(|id| scene.object_index(*id)).collect();
        objects.sort_unstable();
        let again = events.iter().any(|e: &SceneEvent| e.objects == objects);
        let side = event.wall.as_ref().and_then(|wall| SIDES.iter().find(|side| *side == wall));
        if let (Some(side), 1) = (side, objects.len()) {
            let frame = scene.frame_at(event.time);
            events.push(SceneEvent { kind: Kind::Side(side), frame, objects });
        } else if objects.len() == 2 && !(again && scene.world == WorldKind::Clevrer) {
            events.push(SceneEvent { kind: Kind::Collision, frame: scene.frame_at(event.time), objects });
        }
    }
    for object in 0..scene.objects.len() {
        let seen = if plain { observed(scene, object, trace) } else { seen(scene, object, trace) };
        let mut add = |kind, frame| events.push(SceneEvent { kind, frame, objects: vec![object] });
        if let Some(&first) = seen.first().filter(|f| **f > 0) {
            add(Kind::In, first);
        }
        if let Some(&last) = seen.last().filter(|f| **f + 1 < trace.times.len()) {
            add(Kind::Out, last + 1);
        }
    }
    events.sort_by_key(|e| e.frame);
    events
}

/// Frames in which the object was seen, and then those in which the rollout shows it without a break.
fn observed(scene: &Scene, object: usize, trace: &Trace) -> Vec<usize> {
    let samples = scene.tracks.get(object).map(|t| t.samples.as_slice()).unwrap_or_default();
    let mut frames: Vec<usize> = samples.iter().map(|s| s.frame).collect();
    if frames.last().is_some_and(|last| *last + 1 == scene.times.len()) {
        let next = seen(scene, object, trace).into_iter().filter(|f| *f >= scene.times.len());
        let next = (scene.times.len()..).zip(next).take_while(|(due, frame)| due == frame);
        frames.extend(next.map(|(_, frame)| frame));
    }
    frames
}

/// Frames in which the rollout has the object in the camera's view.
fn seen(scene: &Scene, object: usize, trace: &Trace) -> Vec<usize> {
    let Some(thing) = scene.objects.get(object) else { return vec![] };
    let Some(body) = trace.ids.iter().position(|id| *id == thing.id) else { return vec![] };
    let inside = |frame: &usize| {
        let state = trace.states.get(*frame).and_then(|row| row.get(body).copied().flatten());
        state.is_some_and(|s| scene.camera.is_none_or(|c| c.sees(s.position, thing.shape.centre_height())))
    };
    (0..trace.states.len()).filter(inside).collect()
}

fn moving(scene: &Scene, trace: &Trace) -> Vec<Vec<Option<bool>>> {
    let of = |(object, track): (&crate::scene::Object, &crate::scene::Track)| {
        let seen: BTreeSet<usize> = track.samples.iter().map(|s| s.frame).collect();
        let body = trace.ids.iter().position(|id| *id == object.id);
        let at = |frame: usize| {
            let state = trace.states.get(frame)?.get(body?).copied().flatten()?;
            seen.contains(&frame).then(|| state.velocity.norm() > MOVING_SPEED)
        };
        (0..scene.times.len()).map(at).collect()
    };
    scene.objects.iter().zip(&scene.tracks).map(of).collect()
}
