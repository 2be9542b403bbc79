//! The events of each rollout in the terms of questions: collisions, entrances and exits, and which objects move.
//!
//! The frame of an event is the last frame that does not begin after it. Collisions and stops have an exact time; entrances and
//! exits are known to the frame.

use super::ReasonError;
use super::encounters::Encounters;
use super::predict::{Prediction, PredictionRequest, predict};
use crate::fit::Fit;
use crate::num::Stop;
use crate::scene::{Scene, WorldKind};
use crate::world::{EventKind, Intervention, Trace};
use std::collections::BTreeSet;

/// Frames that a prediction continues after the video: "next" means within 2.3 s at 25 frames/s.
pub const FUTURE_FRAMES: usize = 58;
/// The same for a question that names a later time, or asks when something stops: 10 s at 25 frames/s.
pub const MAX_FUTURE_FRAMES: usize = 250;
/// Slowest speed that counts as moving (m/s).
pub const MOVING_SPEED: f64 = 0.02;

/// Events that differ by less are simultaneous (s): the precision to which the simulation locates a contact.
const SIMULTANEOUS: f64 = 1e-9;
/// A motion shorter than this many standard deviations of the measured positions is no motion that the video shows: the
/// difference of two positions has sqrt(2) of them, and two of those are exceeded by chance in 5 % of the cases.
const MOTION_DEVIATIONS: f64 = 2.0 * std::f64::consts::SQRT_2;

/// Sides of a table.
pub const SIDES: [&str; 4] = ["left", "right", "top", "bottom"];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneEventKind {
    Collision,
    /// Two objects come closest to each other without touching (`reason::encounters`).
    Approach,
    /// One object collides with this side of the table.
    Side(&'static str),
    In,
    Out,
    Start,
    End,
    /// The object comes to rest.
    Stop,
    /// Stands for an event in question that did not happen.
    Never,
}

impl SceneEventKind {
    /// The kind that an operation keeps; `None` where the operation is of sides or keeps several kinds.
    pub fn of_filter(token: &str) -> Option<SceneEventKind> {
        match token {
            "filter_in" => Some(SceneEventKind::In),
            "filter_out" => Some(SceneEventKind::Out),
            "filter_stop" => Some(SceneEventKind::Stop),
            "filter_approach" => Some(SceneEventKind::Approach),
            "filter_collision" => Some(SceneEventKind::Collision),
            _ => None,
        }
    }

    /// A hit of the side of this name; of a table that has none, what never happens.
    pub fn of_side(name: &str) -> SceneEventKind {
        SIDES
            .iter()
            .find(|side| **side == name)
            .map_or(SceneEventKind::Never, |side| SceneEventKind::Side(side))
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct SceneEvent {
    pub kind: SceneEventKind,
    pub frame: usize,
    /// s; of an entrance or exit the time of its frame.
    pub time: f64,
    /// Indices of the scene's objects, sorted.
    pub objects: Vec<usize>,
}

impl SceneEvent {
    /// The same kind of event of the same objects, at any time.
    pub fn is_like(&self, other: &SceneEvent) -> bool {
        self.kind != SceneEventKind::Never && self.kind == other.kind && self.objects == other.objects
    }

    /// Whether it happens before the other: by time if both are exact, else by frame. Simultaneous events are not.
    pub fn is_before(&self, other: &SceneEvent) -> bool {
        let is_exact = |e: &SceneEvent| {
            matches!(
                e.kind,
                SceneEventKind::Collision
                    | SceneEventKind::Approach
                    | SceneEventKind::Side(_)
                    | SceneEventKind::Stop
            )
        };
        match is_exact(self) && is_exact(other) {
            true => self.time + SIMULTANEOUS < other.time,
            false => self.frame < other.frame,
        }
    }
}

/// A set of interventions and the events of its rollouts: rollout 0 has the best parameters, the ensemble follows.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    pub interventions: Vec<Intervention>,
    /// Frames simulated, from frame 0.
    pub frames: usize,
    pub rollouts: Vec<RolloutEvents>,
}

/// The events of one rollout.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RolloutEvents {
    /// By frame.
    pub events: Vec<SceneEvent>,
    /// `moving[object][frame]` of the observed frames; `None` where the object has no sample.
    pub moving: Vec<Vec<Option<bool>>>,
    /// How two objects met, by time: all their collisions, and their approaches, which are no events of the list above.
    pub encounters: Encounters,
}

/// A simulation of scene `index` of a fit, and its events.
pub fn simulated(
    scene: &Scene,
    (fit, index): (&Fit, usize),
    request: &PredictionRequest,
    stop: Stop,
) -> Result<(Scenario, Prediction), ReasonError> {
    let simulation = predict(scene, fit, index, request, stop)?;
    let noise = fit.scenes.get(index).map_or(0.0, |s| s.noise_sigma);
    Ok((scenario(scene, &simulation, noise), simulation))
}

/// The events of every rollout of a prediction.
/// `noise`: standard deviation of a measured position (m).
pub fn scenario(scene: &Scene, prediction: &Prediction, noise: f64) -> Scenario {
    let traces = std::iter::once(&prediction.best).chain(&prediction.ensemble);
    let is_factual = prediction.interventions.is_empty();
    let rollouts = traces.map(|trace| RolloutEvents {
        events: events(scene, trace, is_factual),
        moving: if is_factual { moving(scene, trace, noise) } else { vec![] },
        encounters: Encounters::new(MOTION_DEVIATIONS * noise),
    });
    Scenario {
        interventions: prediction.interventions.clone(),
        frames: prediction.best.times.len(),
        rollouts: rollouts.collect(),
    }
}

/// The events of a trace. In a CLEVRER scene a pair of objects collides once: CLEVRER's annotations have the first contact only.
fn events(scene: &Scene, trace: &Trace, is_factual: bool) -> Vec<SceneEvent> {
    let mut events: Vec<SceneEvent> = vec![];
    for event in trace.events.iter().filter(|e| e.kind == EventKind::Collision) {
        let mut objects: Vec<usize> = event.objects.iter().filter_map(|id| scene.object_index(*id)).collect();
        objects.sort_unstable();
        let is_repeated = events.iter().any(|e| e.objects == objects);
        let side = event.wall.as_ref().and_then(|wall| SIDES.iter().find(|side| *side == wall));
        if let (Some(side), 1) = (side, objects.len()) {
            let (frame, time) = (scene.frame_at(event.time), event.time);
            events.push(SceneEvent { kind: SceneEventKind::Side(side), frame, time, objects });
        } else if objects.len() == 2 && !(is_repeated && scene.world == WorldKind::Clevrer) {
            events.push(SceneEvent {
                kind: SceneEventKind::Collision,
                frame: scene.frame_at(event.time),
                time: event.time,
                objects,
            });
        }
    }
    for object in 0..scene.objects.len() {
        let seen = if is_factual { observed(scene, object, trace) } else { in_view(scene, object, trace) };
        let mut add = |kind, frame| {
            events.push(SceneEvent { kind, frame, time: scene.time_of(frame), objects: vec![object] })
        };
        if let Some(&first) = seen.first().filter(|f| **f > 0) {
            add(SceneEventKind::In, first);
        }
        if let Some(&last) = seen.last().filter(|f| **f + 1 < trace.times.len()) {
            add(SceneEventKind::Out, last + 1);
        }
    }
    events.sort_by(|a, b| a.time.total_cmp(&b.time));
    events
}

/// Frames with a sample of the object; if the last observed frame has one, also the following frames in which the rollout
/// keeps the object in view without a gap.
fn observed(scene: &Scene, object: usize, trace: &Trace) -> Vec<usize> {
    let samples = scene.tracks.get(object).map(|t| t.samples.as_slice()).unwrap_or_default();
    let mut frames: Vec<usize> = samples.iter().map(|s| s.frame).collect();
    if frames.last().is_some_and(|last| *last + 1 == scene.times.len()) {
        let next = in_view(scene, object, trace).into_iter().filter(|f| *f >= scene.times.len());
        let next = (scene.times.len()..).zip(next).take_while(|(expected, frame)| expected == frame);
        frames.extend(next.map(|(_, frame)| frame));
    }
    frames
}

/// Frames in which the object is in the camera's view in the rollout.
fn in_view(scene: &Scene, object: usize, trace: &Trace) -> Vec<usize> {
    let Some(object) = scene.objects.get(object) else { return vec![] };
    let Some(body) = trace.ids.iter().position(|id| *id == object.id) else { return vec![] };
    let inside = |frame: &usize| {
        let state = trace.states.get(*frame).and_then(|row| row.get(body).copied().flatten());
        state.is_some_and(|s| scene.camera.is_none_or(|c| c.sees(s.position, object.shape.centre_height())))
    };
    (0..trace.states.len()).filter(inside).collect()
}

/// Whether each object moves in each observed frame with a sample of it: faster than [`MOVING_SPEED`], in a motion that is longer
/// than the noise of the video explains.
fn moving(scene: &Scene, trace: &Trace, noise: f64) -> Vec<Vec<Option<bool>>> {
    let of = |(object, track): (&crate::scene::Object, &crate::scene::Track)| {
        let seen: BTreeSet<usize> = track.samples.iter().map(|s| s.frame).collect();
        let body = trace.ids.iter().position(|id| *id == object.id);
        let state = |frame: usize| trace.states.get(frame)?.get(body?).copied().flatten();
        let fast = |frame: usize| state(frame).map(|s| s.velocity.norm() > MOVING_SPEED);
        let mut moving: Vec<Option<bool>> =
            (0..trace.states.len().min(scene.times.len())).map(fast).collect();
        let mut first = 0;
        while first < moving.len() {
            let length = moving.iter().skip(first).take_while(|m| **m == Some(true)).count();
            let ends = state(first).zip(state(first + length));
            let ends = ends.or_else(|| state(first).zip(state((first + length).saturating_sub(1))));
            let distance = ends.map_or(0.0, |(a, b)| (b.position - a.position).norm());
            if distance < MOTION_DEVIATIONS * noise {
                moving.iter_mut().skip(first).take(length).for_each(|m| *m = Some(false));
            }
            first += length.max(1);
        }
        (0..scene.times.len())
            .map(|f| moving.get(f).copied().flatten().filter(|_| seen.contains(&f)))
            .collect()
    };
    scene.objects.iter().zip(&scene.tracks).map(of).collect()
}
