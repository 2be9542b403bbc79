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
/// Least probability of a listed event that the best rollout lacks.
const MIN_PROBABILITY: f64 = 0.05;
/// Least difference of diverged rollouts (m, rad): beyond round-off, far below any noise.
const DIVERGED: f64 = 1e-6;

/// The best rollout of a scene under interventions, and its uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Prediction {
    pub interventions: Vec<Intervention>,
    /// Frames of the video.
    pub observed_frames: usize,
    /// The model that the best rollout simulated.
    pub model: Model,
    /// The rollout with the best parameters, one row a frame from frame 0.
    pub best: Trace,
    /// Rollouts with parameters drawn from the posterior.
    pub ensemble: Vec<Trace>,
    /// `sd[frame][body]`: standard deviation of the position around the best rollout (m, a coordinate); `None` where absent.
    pub sd: Vec<Vec<Option<f64>>>,
    /// Events of the best rollout, and others that the ensemble finds likely, by time.
    pub events: Vec<LikelyEvent>,
    /// Objects that the interventions do not affect within the video: they move as observed.
    pub unreached: Vec<u32>,
    /// Rollouts that ended early, if there are any.
    pub cut_short: Option<CutShort>,
}

/// Rollouts that have no states from some frame on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct CutShort {
    /// Number of such rollouts, the best one included.
    pub rollouts: usize,
    /// Why the first of them ended.
    pub why: Ending,
    /// The first frame that the best rollout lacks; `None` where it is complete.
    pub frame: Option<usize>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LikelyEvent {
    pub event: Event,
    /// The last frame that does not begin after the event.
    pub frame: usize,
    /// Share of the ensemble in which it happens.
    pub probability: f64,
}

/// A simulation of a fitted scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PredictionRequest {
    /// Without any: the prediction.
    pub interventions: Vec<Intervention>,
    /// Frames from frame 0.
    pub frames: usize,
    /// Number of rollouts in the ensemble.
    pub rollouts: usize,
    pub seed: u64,
}

/// Simulates scene `index` of the fit under the interventions, with the best parameters and with draws from the posterior.
/// Deterministic.
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
    let observed = |mut run: Trace, model: &Model| {
        if let Some(camera) = &scene.camera {
            let seen = enter_exit_events(model, &run, camera);
            run.events.extend(seen);
            run.events.sort_by(|a, b| a.time.total_cmp(&b.time));
        }
        run.as_observed(model)
    };
    let fitted = &fit.scenes[index];
    let mut model = edited(&fitted.model)?;
    let factual = trace(&fitted.model, &scene.times);
    let is_changed = !interventions.is_empty();
    let uncorrected = |model: &Model| is_changed.then(|| trace(model, &scene.times));
    let divergences = divergence_times(&factual, uncorrected(&model).as_ref().unwrap_or(&factual));
    // A correction at the last requested frame, or after it, has no effect.
    let mut discrepancies: BTreeMap<(usize, usize), Option<StateDiscrepancy>> = BTreeMap::new();
    let mut discrepancy = |d: &DivergenceTime| -> Option<StateDiscrepancy> {
        let found = || state_discrepancy(scene, fitted, &factual, d.body, scene.time_of(d.last));
        if d.last + 1 < *frames { *discrepancies.entry((d.body, d.last)).or_insert_with(found) } else { None }
    };
    model.corrections = divergences.iter().filter_map(|d| Some(discrepancy(d)?.correction())).collect();
    let best = observed(trace(&model, &times), &model);
    let is_corrected = !model.corrections.is_empty();
    let mut ensemble = Vec::with_capacity(*rollouts);
    for (number, drawn) in fit.draw(index, *rollouts, *seed).iter().enumerate() {
        stop(ensemble.len() as f64 / *rollouts as f64)?;
        let mut model = edited(drawn)?;
        let mut free = None;
        if is_corrected {
            let own = trace(drawn, &scene.times);
            free = uncorrected(&model);
            let correction = |d: &DivergenceTime| -> Option<StateCorrection> {
                let at = |t: &Trace| -> Option<State> { *t.states.get(d.last)?.get(d.body)? };
                Some(discrepancy(d)?.sample_correction(number, &at(&own)?, &at(&factual)?))
            };
            let divergences = divergence_times(&own, free.as_ref().unwrap_or(&own));
            model.corrections = divergences.iter().filter_map(correction).collect();
        }
        // Without corrections the rollout is known already.
        let known = free.filter(|run| model.corrections.is_empty() && run.times == times);
        ensemble.push(observed(known.unwrap_or_else(|| trace(&model, &times)), &model));
    }
    let sd = spread(&best, &ensemble);
    let events = likely_events(scene, &best, &ensemble);
    let observed_frames = scene.times.len();
    let unaffected = divergences.iter().filter(|d| is_changed && d.last + 1 == observed_frames);
    let unreached = unaffected.map(|d| factual.ids[d.body]).collect();
    let interventions = interventions.clone();
    let cut_short = cut_short(&best, &ensemble);
    Ok(Prediction { interventions, observed_frames, model, best, ensemble, sd, events, unreached, cut_short })
}

/// Until when a body moves alike in two rollouts.
struct DivergenceTime {
    /// Index of the body in the first rollout.
    body: usize,
    /// The last frame before they diverge.
    last: usize,
}

/// When each body of the factual rollout diverges: only then can the interventions have affected it. Bodies that differ from the
/// first frame on are left out.
fn divergence_times(factual: &Trace, prediction: &Trace) -> Vec<DivergenceTime> {
    let of = |(body, id): (usize, &u32)| {
        let other = prediction.ids.iter().position(|i| i == id)?;
        let alike = |frame: &usize| match (factual.states[*frame][body], prediction.states[*frame][other]) {
            (Some(a), Some(b)) => (a.position - b.position).norm().max((a.yaw - b.yaw).abs()) <= DIVERGED,
            (None, None) => true,
            _ => false,
        };
        let last = (0..factual.states.len()).take_while(alike).last()?;
        Some(DivergenceTime { body, last })
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

/// Root mean square deviation of the ensemble from the best rollout (m, a coordinate).
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

/// The events of the best rollout and the likely ones of the ensemble, with their probabilities.
fn likely_events(scene: &Scene, best: &Trace, ensemble: &[Trace]) -> Vec<LikelyEvent> {
    /// Kind, objects, wall, and how many such events are earlier.
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
        .filter(|(i, p, _)| *i < sure || *p >= MIN_PROBABILITY)
        .map(|(_, probability, event)| LikelyEvent { frame: scene.frame_at(event.time), event, probability })
        .collect();
    likely.sort_by(|a, b| a.event.time.total_cmp(&b.event.time));
    likely
}

/// The events of bodies that enter or leave the camera's view.
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
