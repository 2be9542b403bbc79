//! Predictions and counterfactuals over an ensemble drawn from the posterior.
//!
//! The best rollout has the parameters of the fit. The ensemble has n rollouts with parameters drawn from the posterior. The
//! probability of an event e is `p(e) = (1/n) sum_j [e happens in rollout j]`; two rollouts share an event if kind, objects and
//! wall agree, and it is the k-th such event in both. The standard deviation of a position is
//! `sd = sqrt(sum_j |x_j - x_best|^2 / (2 n))` (m, a coordinate), over the rollouts that have the body.
//!
//! A rollout starts at frame 0, so that its error at the end of the video exceeds the noise where the model is wrong. As in
//! Ding et al. (2021), the state is corrected there: a body that leaves its observed positions by more than the noise gets a
//! `StateCorrection` at the last frame before its motion diverges from the factual rollout. Without interventions that is
//! the last frame of the video. Two rollouts diverge for a body when position (m) or yaw (rad) differ by more than
//! [`DIVERGED`]. Objects that never diverge within the video move as observed ("unreached").

use super::ReasonError;
use crate::fit::{Fit, StateDiscrepancy, state_discrepancy};
use crate::num::Stop;
use crate::scene::{Camera, Scene};
use crate::world::{Ending, Event, EventKind, Intervention, Model, State, StateCorrection, Trace, trace};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Most frames of one simulation.
pub const MAX_SIMULATED_FRAMES: usize = 20_000;
/// Events of the ensemble that the best rollout lacks are told from this probability on.
const WORTH_TELLING: f64 = 0.05;
/// Simulations that are farther apart than this (m, rad) have parted: beyond round-off, far below any noise.
const PARTED: f64 = 1e-6;

/// One simulation request, answered: the best rollout and how sure it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Prediction {
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
    /// Objects that the interventions do not reach within the video: they move as observed.
    pub unreached: Vec<u32>,
    /// Rollouts that ended before they were through, if there are any.
    pub cut_short: Option<CutShort>,
}

/// Rollouts that have no states from some frame on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct CutShort {
    /// How many: the best one and those of the ensemble.
    pub rollouts: usize,
    /// Why the first of them ended.
    pub why: Ending,
    /// The first frame that the best rollout lacks; `None` where it is whole.
    pub frame: Option<usize>,
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
pub struct PredictionRequest {
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
pub fn predict(
    scene: &Scene,
    fit: &Fit,
    index: usize,
    request: &PredictionRequest,
    stop: Stop,
) -> Result<Prediction, ReasonError> {
    let PredictionRequest { interventions, frames, rollouts, seed } = request;
    if *frames == 0 || *frames > MAX_SIMULATED_FRAMES {
        return Err(ReasonError::Frames { frames: *frames, most: MAX_SIMULATED_FRAMES });
    }
    let times: Vec<f64> = (0..*frames).map(|f| scene.time_of(f)).collect();
    let edited = |model: &Model| interventions.iter().try_fold(model.clone(), |m, i| i.apply(&m));
    let filmed = |mut run: Trace, model: &Model| {
        if let Some(camera) = &scene.camera {
            let seen = enter_exit_events(model, &run, camera);
            run.events.extend(seen);
            run.events.sort_by(|a, b| a.time.total_cmp(&b.time));
        }
        run.as_observed(model)
    };
    let fitted = &fit.scenes[index];
    let mut model = edited(&fitted.model)?;
    // What was observed against the simulation that was fitted to it.
    let factual = trace(&fitted.model, &scene.times);
    let changed = !interventions.is_empty();
    let unguided = |model: &Model| changed.then(|| trace(model, &scene.times));
    let reached = divergence_times(&factual, unguided(&model).as_ref().unwrap_or(&factual));
    // An anchor at the last frame that is asked for, or after it, changes nothing.
    let mut known: BTreeMap<(usize, usize), Option<StateDiscrepancy>> = BTreeMap::new();
    let mut off = |p: &Parting| -> Option<StateDiscrepancy> {
        let found = || state_discrepancy(scene, fitted, &factual, p.body, scene.time_of(p.last));
        if p.last + 1 < *frames { *known.entry((p.body, p.last)).or_insert_with(found) } else { None }
    };
    model.corrections = reached.iter().filter_map(|p| Some(off(p)?.correction())).collect();
    let best = filmed(trace(&model, &times), &model);
    let anchored = !model.corrections.is_empty();
    let mut ensemble = Vec::with_capacity(*rollouts);
    for (number, drawn) in fit.draw(index, *rollouts, *seed).iter().enumerate() {
        stop(ensemble.len() as f64 / *rollouts as f64)?;
        let mut model = edited(drawn)?;
        let mut found = None;
        if anchored {
            let own = trace(drawn, &scene.times);
            found = unguided(&model);
            let anchor = |p: &Parting| -> Option<StateCorrection> {
                let at = |t: &Trace| -> Option<State> { *t.states.get(p.last)?.get(p.body)? };
                Some(off(p)?.sample_correction(number, &at(&own)?, &at(&factual)?))
            };
            let parted = divergence_times(&own, found.as_ref().unwrap_or(&own));
            model.corrections = parted.iter().filter_map(anchor).collect();
        }
        let known = found.filter(|run| model.corrections.is_empty() && run.times == times);
        ensemble.push(filmed(known.unwrap_or_else(|| trace(&model, &times)), &model));
    }
    let sd = spread(&best, &ensemble);
    let events = likely_events(scene, &best, &ensemble);
    let observed_frames = scene.times.len();
    let whole = reached.iter().filter(|p| changed && p.last + 1 == observed_frames);
    let unreached = whole.map(|p| factual.ids[p.body]).collect();
    let interventions = interventions.clone();
    let cut_short = cut_short(&best, &ensemble);
    Ok(Prediction { interventions, observed_frames, model, best, ensemble, sd, events, unreached, cut_short })
}

/// Until when a body of the video moves in two simulations alike.
struct Parting {
    /// Index of the body in the first one.
    body: usize,
    /// The last frame in which it does.
    last: usize,
}

/// Bodies that begin alike, and how long: the interventions can have reached one only when the simulations part.
fn divergence_times(factual: &Trace, prediction: &Trace) -> Vec<Parting> {
    let of = |(body, id): (usize, &u32)| {
        let other = prediction.ids.iter().position(|i| i == id)?;
        let alike = |frame: &usize| match (factual.states[*frame][body], prediction.states[*frame][other]) {
            (Some(a), Some(b)) => (a.position - b.position).norm().max((a.yaw - b.yaw).abs()) <= PARTED,
            (None, None) => true,
            _ => false,
        };
        let last = (0..factual.states.len()).take_while(alike).last()?;
        Some(Parting { body, last })
    };
    factual.ids.iter().enumerate().filter_map(of).collect()
}

fn cut_short(best: &Trace, ensemble: &[Trace]) -> Option<CutShort> {
    let runs = std::iter::once(best).chain(ensemble);
    let mut early = runs.map(|run| run.ending).filter(|ending| *ending != Ending::Completed);
    let why = early.next()?;
    let whole = best.states.iter().rposition(|row| row.iter().any(Option::is_some)).map_or(0, |f| f + 1);
    let frame = (best.ending != Ending::Completed).then_some(whole);
    Some(CutShort { rollouts: 1 + early.count(), why, frame })
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
fn enter_exit_events(model: &Model, run: &Trace, camera: &Camera) -> Vec<Event> {
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
