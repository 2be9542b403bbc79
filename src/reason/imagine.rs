//! Predictions and counterfactuals over an ensemble drawn from the posterior.

use super::ReasonError;
use crate::fit::Fit;
use crate::num::Stop;
use crate::scene::{Camera, Scene};
use crate::world::{Event, EventKind, Intervention, Model, Trace, trace};
use serde::{Deserialize, Serialize};

/// Most frames of one simulation.
pub const MAX_SIMULATED_FRAMES: usize = 20_000;
/// Events of the ensemble that the best rollout lacks are told from this probability on.
const WORTH_TELLING: f64 = 0.05;

/// One simulation request, answered: the best rollout and how sure it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Imagined {
    pub interventions: Vec<Intervention>,
    /// Frames of the video itself.
    pub observed_frames: usize,
    /// The model that the best rollout simulated.
    pub model: Model,
    /// The rollout at the best parameters, one row a frame from frame 0.
    pub best: Trace,
    /// Rollouts of models drawn from the posterior.
    pub ensemble: Vec<Trace>,
    /// `sd[frame][body]`: spread of the position around the best rollout, per coordinate (m); `None` where absent.
    pub sd: Vec<Vec<Option<f64>>>,
    /// Events of the best rollout and others that the ensemble finds likely, by time.
    pub events: Vec<LikelyEvent>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LikelyEvent {
    pub event: Event,
    /// The frame nearest to the event's time.
    pub frame: usize,
    /// Share of the ensemble in which it happens.
    pub probability: f64,
}

/// What is to be simulated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Request {
    /// None: the prediction.
    pub interventions: Vec<Intervention>,
    /// Frames from frame 0.
    pub frames: usize,
    /// Models drawn from the posterior.
    pub rollouts: usize,
    pub seed: u64,
}

/// Simulates scene `index` of the fit under the interventions, at the best parameters and over draws from the
/// posterior. Deterministic.
pub fn imagine(
    scene: &Scene,
    fit: &Fit,
    index: usize,
    request: &Request,
    stop: Stop,
) -> Result<Imagined, ReasonError> {
    let Request { interventions, frames, rollouts, seed } = request;
    if *frames == 0 || *frames > MAX_SIMULATED_FRAMES {
        return Err(ReasonError::Frames { frames: *frames, most: MAX_SIMULATED_FRAMES });
    }
    let times: Vec<f64> = (0..*frames).map(|f| scene.time_of(f)).collect();
    let simulated = |model: &Model| -> Result<(Model, Trace), ReasonError> {
        let model = interventions.iter().try_fold(model.clone(), |m, i| i.apply(&m))?;
        let mut run = trace(&model, &times);
        if let Some(camera) = &scene.camera {
            run.events.extend(comings_and_goings(&model, &run, camera));
            run.events.sort_by(|a, b| a.time.total_cmp(&b.time));
        }
        Ok((model, run))
    };
    let (model, best) = simulated(&fit.scenes[index].model)?;
    let mut ensemble = Vec::with_capacity(*rollouts);
    for drawn in fit.draw(index, *rollouts, *seed) {
        stop(ensemble.len() as f64 / *rollouts as f64)?;
        ensemble.push(simulated(&drawn)?.1);
    }
    let sd = spread(&best, &ensemble);
    let events = likely_events(scene, &best, &ensemble);
    let observed_frames = scene.times.len();
    Ok(Imagined { interventions: interventions.clone(), observed_frames, model, best, ensemble, sd, events })
}

/// Root mean square deviation of the ensemble from the best rollout, per coordinate.
fn spread(best: &Trace, ensemble: &[Trace]) -> Vec<Vec<Option<f64>>> {
    let of = |frame: usize, body: usize| {
        let centre = best.states[frame][body]?.position;
        let squares =
            ensemble.iter().filter_map(|t| Some((t.states[frame][body]?.position - centre).norm_squared()));
        let (sum, count) = squares.fold((0.0, 0usize), |(s, n), d| (s + d, n + 1));
        Some((sum / (2 * count.max(1)) as f64).sqrt())
    };
    (0..best.states.len()).map(|f| (0..best.ids.len()).map(|b| of(f, b)).collect()).collect()
}

/// Events by what happens to whom for the how-manieth time, with the share of the ensemble that has them.
fn likely_events(scene: &Scene, best: &Trace, ensemble: &[Trace]) -> Vec<LikelyEvent> {
    type Key = (EventKind, Vec<u32>, Option<String>, usize);
    let keyed = |t: &Trace| -> Vec<(Key, Event)> {
        let mut seen: Vec<(Key, Event)> = vec![];
        for e in &t.events {
            let same = |k: &Key| k.0 == e.kind && k.1 == e.objects && k.2 == e.wall;
            let times = seen.iter().filter(|(k, _)| same(k)).count();
            seen.push(((e.kind, e.objects.clone(), e.wall.clone(), times), e.clone()));
        }
        seen
    };
    let runs: Vec<_> = ensemble.iter().map(keyed).collect();
    let mut all = keyed(best);
    let sure = all.len();
    for (key, event) in runs.iter().flatten() {
        if !all.iter().any(|(k, _)| k == key) {
            all.push((key.clone(), event.clone()));
        }
    }
    let probability = |key: &Key| {
        let having = runs.iter().filter(|run| run.iter().any(|(k, _)| k == key)).count();
        if runs.is_empty() { 1.0 } else { having as f64 / runs.len() as f64 }
    };
    let mut likely: Vec<LikelyEvent> = all
        .into_iter()
        .enumerate()
        .map(|(i, (key, event))| (i, probability(&key), event))
        .filter(|(i, p, _)| *i < sure || *p >= WORTH_TELLING)
        .map(|(_, probability, event)| LikelyEvent {
            frame: nearest_frame(scene, event.time),
            event,
            probability,
        })
        .collect();
    likely.sort_by(|a, b| a.event.time.total_cmp(&b.event.time));
    likely
}

fn nearest_frame(scene: &Scene, time: f64) -> usize {
    let before = scene.frame_at(time);
    let nearer = scene.time_of(before + 1) - time < time - scene.time_of(before);
    if nearer { before + 1 } else { before }
}

/// When bodies come into the camera's view and leave it.
fn comings_and_goings(model: &Model, run: &Trace, camera: &Camera) -> Vec<Event> {
    let mut events = vec![];
    for (b, body) in model.bodies.iter().enumerate() {
        let mut visible: Option<bool> = None;
        for (frame, row) in run.states.iter().enumerate() {
            let seen = row[b].is_some_and(|s| camera.sees(s.position, body.shape.centre_height()));
            let kind = match (visible, seen) {
                (Some(false), true) => Some(EventKind::Enter),
                (Some(true), false) => Some(EventKind::Exit),
                _ => None,
            };
            if let (Some(kind), Some(state)) = (kind, row[b]) {
                events.push(Event {
                    kind,
                    time: run.times[frame],
                    objects: vec![body.id],
                    position: state.position,
                    normal: None,
                    impulse: None,
                    wall: None,
                });
            }
            visible = Some(seen);
        }
    }
    events
}
