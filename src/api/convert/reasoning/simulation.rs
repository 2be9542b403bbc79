//! Simulations: requests to domain values, predictions to replies.

use super::interventions::intervention;
use crate::api::convert::findings::unseen_pushes;
use crate::api::convert::names::{model_name, trace_name, video_name};
use crate::api::convert::violations::{MAX_LIST, Violations};
use crate::api::v1;
use crate::engine::{EngineError, ModelSource, PublishedSimulation, SimulateOptions};
use crate::reason::{CutShort, LikelyEvent, Prediction};
use crate::world::{Ending, EventKind, State};

/// Video, model and options of a simulation.
pub fn simulate_request(
    request: v1::SimulateRequest,
) -> Result<(String, ModelSource, SimulateOptions), EngineError> {
    let mut violations = Violations::default();
    violations.request_id(&request.request_id);
    let video = violations.id("video", &request.video, "videos");
    let source = violations.source("model", request.model, &video);
    let rollouts = violations.rollouts(request.rollouts);
    if request.interventions.len() > MAX_LIST {
        violations.add("interventions", format!("are {}; at most {MAX_LIST}", request.interventions.len()));
    }
    let interventions = request
        .interventions
        .into_iter()
        .take(MAX_LIST)
        .enumerate()
        .filter_map(|(i, given)| intervention(&mut violations, &format!("interventions[{i}]"), given))
        .collect();
    let frames = (request.frames > 0).then_some(request.frames as usize);
    violations.finish((
        video,
        source,
        SimulateOptions { interventions, frames, rollouts, seed: request.seed, stills: request.stills },
    ))
}

pub fn simulation(video: &str, done: &PublishedSimulation) -> v1::SimulateResponse {
    v1::SimulateResponse {
        video: video_name(video),
        model: model_name(video, &done.model),
        fps: done.fps,
        observed_frames: done.prediction.observed_frames as u32,
        frames: frames(&done.prediction),
        events: done.prediction.events.iter().map(event).collect(),
        trace: trace_name(&done.trace),
        unreached_object_ids: done.prediction.unreached.clone(),
        cut_short: done.prediction.cut_short.map(cut_short),
        unseen_pushes: unseen_pushes(video, &done.prediction.model),
    }
}

fn cut_short(cut: CutShort) -> v1::CutShort {
    use v1::cut_short::Reason;
    let reason = match cut.why {
        Ending::Completed => Reason::Unspecified,
        Ending::EventLimit => Reason::EventLimit,
        Ending::FormulaUndefined => Reason::FormulaUndefined,
    };
    v1::CutShort {
        reason: reason.into(),
        rollouts: cut.rollouts as u32,
        frame: cut.frame.map(|f| f as u32),
        message: cut.why.to_string(),
    }
}

fn frames(prediction: &Prediction) -> Vec<v1::SimulatedFrame> {
    let best = &prediction.best;
    let rows = best.states.iter().zip(&best.times).zip(&prediction.sd).enumerate();
    rows.map(|(i, ((states, time), sds))| v1::SimulatedFrame {
        frame: i as u32,
        time: *time,
        objects: states
            .iter()
            .zip(&best.ids)
            .zip(sds)
            .filter_map(|((state, id), sd)| Some(object_state(*id, state.as_ref()?, *sd)))
            .collect(),
    })
    .collect()
}

fn object_state(object_id: u32, state: &State, sd: Option<f64>) -> v1::ObjectState {
    v1::ObjectState {
        object_id,
        x: state.position.x,
        y: state.position.y,
        yaw: state.yaw,
        vx: state.velocity.x,
        vy: state.velocity.y,
        spin: state.spin,
        sd: sd.unwrap_or(0.0),
    }
}

fn event(likely: &LikelyEvent) -> v1::SimulatedEvent {
    let kind = match likely.event.kind {
        EventKind::Collision => v1::EventKind::Collision,
        EventKind::Enter => v1::EventKind::Enter,
        EventKind::Exit => v1::EventKind::Exit,
        EventKind::Stop => v1::EventKind::Stop,
    };
    v1::SimulatedEvent {
        kind: kind.into(),
        frame: likely.frame as u32,
        time: likely.event.time,
        object_ids: likely.event.objects.clone(),
        probability: likely.probability,
        wall: likely.event.wall.clone().unwrap_or_default(),
    }
}
