//! Domain values to replies: models, effects, simulations, answers, traces.

use super::v1;
use crate::effects::{EFFECTS, Scope};
use crate::engine::{Answered, Engine, Job, Simulated, StoredFit};
use crate::fit::{Estimate, Termination};
use crate::reason::{ChoiceAnswer, CutShort, DerivationStep, LikelyEvent, Prediction};
use crate::world::{Ending, EventKind, State};
use std::time::Duration;

pub fn model_name(video: &str, id: &str) -> String {
    format!("videos/{video}/models/{id}")
}

pub fn trace_name(id: &str) -> String {
    format!("traces/{id}")
}

/// What the engine does just now; the jobs are those of its tenant.
pub fn statistics(engine: &Engine) -> v1::ServiceStatistics {
    let (load, capacity) = (engine.load(), engine.capacity());
    let job = |job: Job| v1::RunningJob {
        kind: job.kind.into(),
        video: format!("videos/{}", job.video),
        progress: job.progress,
        age: duration(job.age),
    };
    v1::ServiceStatistics {
        version: env!("CARGO_PKG_VERSION").into(),
        uptime: duration(engine.uptime()),
        workers: capacity.workers as u32,
        queue_capacity: capacity.queue as u32,
        jobs_running: load.running as u32,
        jobs_waiting: load.waiting as u32,
        oldest_wait: duration(load.oldest),
        fits: engine.fits_run(),
        jobs: engine.jobs().into_iter().map(job).collect(),
    }
}

fn duration(time: Duration) -> Option<prost_types::Duration> {
    prost_types::Duration::try_from(time).ok()
}

pub fn model(stored: &StoredFit) -> v1::Model {
    let name = model_name(&stored.video, &stored.id);
    let Some(scene) = stored.fit.scenes.first() else {
        return v1::Model { name, ..v1::Model::default() };
    };
    let objects = stored.fit.objects(0).into_iter().map(|o| v1::ObjectEstimate {
        object_id: o.id,
        mass: Some(estimate(&o.mass)),
        restitution: Some(estimate(&o.restitution)),
    });
    let shared = stored.fit.shared(0).into_iter().map(|s| v1::SharedEstimate {
        effect: s.effect,
        parameter: s.parameter,
        labels: s.labels,
        values: s.values.iter().map(estimate).collect(),
    });
    v1::Model {
        name,
        revision: stored.revision,
        preset: scene.model.preset.clone(),
        rmse: scene.rmse,
        noise_sigma: scene.noise_sigma,
        noise_yaw: scene.noise_yaw,
        reduced_chi_square: scene.reduced_chi_square,
        degrees_of_freedom: scene.degrees_of_freedom as u64,
        identified: stored.fit.posterior.estimates.iter().all(|e| e.identified),
        adequate: scene.adequate,
        converged: stored.fit.outcome == Termination::Converged,
        iterations: stored.fit.iterations as u64,
        objects: objects.collect(),
        shared: shared.collect(),
        // A model is plain data with string keys, which JSON always takes.
        model_json: serde_json::to_string(&scene.model).unwrap_or_default(),
        history: stored.step.as_ref().map(super::study::revision),
    }
}

/// The last message of a fit.
pub fn fitted(fit: &StoredFit, others: &[&StoredFit]) -> v1::FitModelResponse {
    let event = Some(v1::fit_model_response::Event::Model(model(fit)));
    v1::FitModelResponse { event, others: others.iter().map(|fit| model(fit)).collect() }
}

fn estimate(e: &Estimate) -> v1::Estimate {
    v1::Estimate { value: e.value, sd: e.sd, unit: e.unit.clone(), identified: e.identified }
}

pub fn effects() -> Vec<v1::Effect> {
    let effect = |e: &crate::effects::EffectEntry| v1::Effect {
        name: e.spec.name.into(),
        description: e.spec.doc.into(),
        source: e.spec.source.into(),
        parameters: e.spec.params.iter().map(parameter).collect(),
    };
    EFFECTS.iter().map(effect).collect()
}

fn parameter(p: &crate::effects::ParamSpec) -> v1::EffectParameter {
    let scope = match p.scope {
        Scope::Setup => "setup",
        Scope::Material => "material",
        Scope::Shape => "shape",
        Scope::Object => "object",
        Scope::ShapePair => "shape_pair",
        Scope::Pair => "pair",
    };
    v1::EffectParameter {
        name: p.name.into(),
        description: p.doc.into(),
        unit: p.unit.into(),
        default_value: p.default,
        min: p.min,
        max: p.max,
        scope: scope.into(),
    }
}

pub fn simulation(video: &str, done: &Simulated) -> v1::SimulateResponse {
    v1::SimulateResponse {
        video: format!("videos/{video}"),
        model: model_name(video, &done.model),
        fps: done.fps,
        observed_frames: done.prediction.observed_frames as u32,
        frames: frames(&done.prediction),
        events: done.prediction.events.iter().map(event).collect(),
        trace: trace_name(&done.trace),
        unreached_object_ids: done.prediction.unreached.clone(),
        cut_short: done.prediction.cut_short.map(cut_short),
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

pub fn answer(video: &str, done: &Answered) -> v1::AskResponse {
    let answer = &done.answer;
    v1::AskResponse {
        answer: answer.answer.clone(),
        probability: answer.probability,
        choices: answer.choices.iter().map(choice).collect(),
        trail: answer.derivation.iter().map(step).collect(),
        program: Some(v1::Program { tokens: answer.program.clone() }),
        explanation: answer.explanation.clone(),
        traces: done.traces.iter().map(|id| trace_name(id)).collect(),
        model: model_name(video, &done.model),
    }
}

fn choice(c: &ChoiceAnswer) -> v1::ChoiceAnswer {
    v1::ChoiceAnswer {
        choice: c.choice.clone(),
        correct: c.correct,
        probability: c.probability,
        trail: c.derivation.iter().map(step).collect(),
    }
}

fn step(s: &DerivationStep) -> v1::Step {
    v1::Step { token: s.token.clone(), text: s.result.clone() }
}
