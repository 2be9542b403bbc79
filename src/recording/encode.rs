//! Encodes a simulation: measured and simulated states, residuals, rollouts, events and parameters.

use super::draw::{color, entity, pose};
use super::messages::{self as m, Topic, foxglove as fox, v1};
use super::origin::metadata;
use super::stills::stills;
use super::writer::{TraceWriter, timestamp};
use super::{FRAME, Recording, RecordingError};
use crate::fit::Fit;
use crate::num::Vec2;
use crate::reason::{LikelyEvent, Prediction};
use crate::scene::Scene;
use crate::world::{BodySpec, EventKind, Model, State, Trace};
use serde::Serialize;
use std::collections::BTreeMap;

/// Most states of rollouts in one file: about 25 MB. Rollouts beyond it can be simulated again from the file.
pub const MAX_ROLLOUT_STATES: usize = 1_000_000;
/// Shapes move with their frames of reference. They are repeated after this number of frames, so that a viewer that
/// starts in the middle has them.
const SHAPES_EVERY: usize = 25;
/// Media types of attachments.
const JSON: &str = "application/json";
const CBOR: &str = "application/cbor";

/// The trace file of one simulation.
pub fn encode(recording: &Recording) -> Result<Vec<u8>, RecordingError> {
    let Recording { scene, prediction, fit, .. } = *recording;
    let kept = rollouts_kept(prediction);
    let mut topics = m::SIMULATION.to_vec();
    if kept > 0 {
        topics.extend([m::MEAN, m::MEAN_POSES, m::ROLLOUTS]);
    }
    if !recording.stills.is_empty() {
        topics.extend([m::IMAGE, m::ANNOTATIONS]);
    }
    let mut writer = TraceWriter::new(topics);
    measured(scene, &mut writer)?;
    residuals(scene, &prediction.best, &m::RESIDUALS, &mut writer)?;
    simulated(scene, prediction, &mut writer)?;
    ensemble(prediction, kept, &mut writer)?;
    events(recording, &mut writer)?;
    parameters(fit, &mut writer)?;
    stills(recording, &mut writer)?;
    let mut attachments = vec![
        ("request.json", JSON, recording.request_json.as_bytes().to_vec()),
        ("model.json", JSON, serde_json::to_vec(&prediction.model)?),
        ("scene.json", JSON, serde_json::to_vec(scene)?),
        ("fit.cbor", CBOR, cbor(fit)?),
    ];
    if !recording.stills.is_empty() {
        attachments.push(("stills.cbor", CBOR, cbor(&recording.stills)?));
    }
    let mut metadata = metadata("simulation", scene, recording.video, recording.model);
    metadata.extend(
        [
            ("preset", prediction.model.preset.clone()),
            ("seed", recording.seed.to_string()),
            ("frames", prediction.best.times.len().to_string()),
            ("observed_frames", prediction.observed_frames.to_string()),
            ("rollouts", prediction.ensemble.len().to_string()),
            ("rollouts_kept", kept.to_string()),
            ("interventions", serde_json::to_string(&prediction.interventions)?),
        ]
        .map(|(key, value)| (key.to_string(), value)),
    );
    writer.finish(metadata, &attachments)
}

/// A value as CBOR: a fit has infinite bounds, which JSON cannot hold.
pub fn cbor<T: Serialize>(value: &T) -> Result<Vec<u8>, RecordingError> {
    let mut bytes = Vec::new();
    ciborium::into_writer(value, &mut bytes).map_err(|e| RecordingError::Cbor(e.to_string()))?;
    Ok(bytes)
}

fn rollouts_kept(prediction: &Prediction) -> usize {
    let states = prediction.best.times.len() * prediction.best.ids.len();
    prediction.ensemble.len().min(MAX_ROLLOUT_STATES / states.max(1))
}

/// Poses as they were measured, outliers included.
pub fn measured(scene: &Scene, to: &mut TraceWriter) -> Result<(), RecordingError> {
    let mut rows: BTreeMap<usize, Vec<fox::Pose>> = BTreeMap::new();
    for (index, object) in scene.objects.iter().enumerate() {
        for sample in scene.all_samples(index) {
            let pose = pose(sample.position, &object.shape, sample.yaw.unwrap_or(0.0));
            rows.entry(sample.frame).or_default().push(pose);
        }
    }
    for (frame, poses) in rows {
        let time = scene.time_of(frame);
        let message = fox::PosesInFrame { timestamp: timestamp(time)?, frame_id: FRAME.into(), poses };
        to.push(&m::MEASURED, time, &message)?;
    }
    Ok(())
}

/// Measured minus simulated positions.
pub fn residuals(
    scene: &Scene,
    run: &Trace,
    topic: &Topic,
    to: &mut TraceWriter,
) -> Result<(), RecordingError> {
    let mut rows: BTreeMap<usize, Vec<v1::TraceResidual>> = BTreeMap::new();
    for (object, track) in scene.objects.iter().zip(&scene.tracks) {
        let body = run.ids.iter().position(|id| *id == object.id);
        for sample in &track.samples {
            let row = rows.entry(sample.frame).or_default();
            let states = run.states.get(sample.frame);
            let state = states.zip(body).and_then(|(row, body)| row.get(body).copied().flatten());
            if let Some(state) = state {
                let Vec2 { x, y } = sample.position - state.position;
                row.push(v1::TraceResidual { object_id: object.id, x, y });
            }
        }
    }
    for (frame, residuals) in rows {
        let message = v1::TraceResiduals { frame: frame as u32, residuals };
        to.push(topic, scene.time_of(frame), &message)?;
    }
    Ok(())
}

fn simulated(scene: &Scene, prediction: &Prediction, to: &mut TraceWriter) -> Result<(), RecordingError> {
    let (best, model) = (&prediction.best, &prediction.model);
    run(best, &prediction.sd, model, [&m::STATES, &m::POSES], to)?;
    let frames: Vec<String> = best.ids.iter().map(|id| format!("object_{id}")).collect();
    let mut shown: Option<Vec<bool>> = None;
    for (frame, (row, &time)) in best.states.iter().zip(&best.times).enumerate() {
        let timestamp = timestamp(time)?;
        let mut transforms = Vec::with_capacity(row.len());
        for ((state, body), child) in row.iter().zip(&model.bodies).zip(&frames) {
            let Some(state) = state else { continue };
            let pose = pose(state.position, &body.shape, state.yaw);
            transforms.push(fox::FrameTransform {
                timestamp,
                parent_frame_id: FRAME.into(),
                child_frame_id: child.clone(),
                translation: pose.position,
                rotation: pose.orientation,
            });
        }
        to.push(&m::TRANSFORMS, time, &fox::FrameTransforms { transforms })?;
        let here: Vec<bool> = row.iter().map(Option::is_some).collect();
        if frame % SHAPES_EVERY == 0 || shown.as_ref() != Some(&here) {
            let color_of = |id: u32| scene.objects.iter().find(|o| o.id == id).map_or("", |o| &o.color);
            let of = |((body, frame), _): ((&BodySpec, &String), _)| {
                entity(frame, &body.shape, color(color_of(body.id)), timestamp)
            };
            let entities = model.bodies.iter().zip(&frames).zip(&here).filter(|(_, here)| **here).map(of);
            to.push(&m::SHAPES, time, &fox::SceneUpdate { entities: entities.collect() })?;
            shown = Some(here);
        }
    }
    Ok(())
}

/// States and poses of one run; `sd[frame][body]` where they are known.
pub fn run(
    run: &Trace,
    sd: &[Vec<Option<f64>>],
    model: &Model,
    [states_topic, poses_topic]: [&Topic; 2],
    to: &mut TraceWriter,
) -> Result<(), RecordingError> {
    for (frame, (row, &time)) in run.states.iter().zip(&run.times).enumerate() {
        let (mut states, mut poses) = (Vec::with_capacity(row.len()), Vec::with_capacity(row.len()));
        for (body, ((state, &id), spec)) in row.iter().zip(&run.ids).zip(&model.bodies).enumerate() {
            let Some(state) = state else { continue };
            let sd = sd.get(frame).and_then(|row| row.get(body).copied().flatten());
            states.push(trace_state(id, state, sd));
            poses.push(pose(state.position, &spec.shape, state.yaw));
        }
        let energy = run.energy.get(frame).copied().unwrap_or(0.0);
        to.push(states_topic, time, &v1::TraceFrame { frame: frame as u32, time, energy, states })?;
        let poses = fox::PosesInFrame { timestamp: timestamp(time)?, frame_id: FRAME.into(), poses };
        to.push(poses_topic, time, &poses)?;
    }
    Ok(())
}

/// The mean and the standard deviation of all rollouts, and the first `kept` rollouts themselves.
fn ensemble(prediction: &Prediction, kept: usize, to: &mut TraceWriter) -> Result<(), RecordingError> {
    if kept == 0 {
        return Ok(());
    }
    let (mean, sd) = mean(prediction);
    run(&mean, &sd, &prediction.model, [&m::MEAN, &m::MEAN_POSES], to)?;
    let rollouts = &prediction.ensemble[..kept];
    let ids = &prediction.best.ids;
    for (frame, &time) in prediction.best.times.iter().enumerate() {
        let list = || Vec::with_capacity(kept * ids.len());
        let (mut x, mut y, mut yaw) = (list(), list(), list());
        for run in rollouts {
            for body in 0..ids.len() {
                let state = run.states.get(frame).and_then(|row| row.get(body).copied().flatten());
                let of = |value: fn(State) -> f64| state.map_or(f32::NAN, |s| value(s) as f32);
                x.push(of(|s| s.position.x));
                y.push(of(|s| s.position.y));
                yaw.push(of(|s| s.yaw));
            }
        }
        let message = v1::TraceRollouts { frame: frame as u32, object_ids: ids.clone(), x, y, yaw };
        to.push(&m::ROLLOUTS, time, &message)?;
    }
    Ok(())
}

/// Mean states over the rollouts that have the body, and the standard deviation of a position per coordinate (m):
/// sd^2 = (mean |r|^2 - |mean r|^2) / 2. The mean is no possible motion: where a collision happens in some rollouts only,
/// it runs between their trajectories.
fn mean(prediction: &Prediction) -> (Trace, Vec<Vec<Option<f64>>>) {
    let best = &prediction.best;
    let mut mean = Trace { events: vec![], ..best.clone() };
    let mut spread = Vec::with_capacity(best.states.len());
    for (frame, row) in mean.states.iter_mut().enumerate() {
        let mut sds = Vec::with_capacity(row.len());
        for (body, slot) in row.iter_mut().enumerate() {
            let (mut sum, mut squares, mut count) = (State::default(), 0.0, 0usize);
            for state in prediction.ensemble.iter().filter_map(|t| *t.states.get(frame)?.get(body)?) {
                sum.position += state.position;
                squares += state.position.norm_squared();
                sum.velocity += state.velocity;
                sum.roll += state.roll;
                sum.yaw += state.yaw;
                sum.spin += state.spin;
                count += 1;
            }
            let share = 1.0 / count.max(1) as f64;
            *slot = (count > 0).then(|| State {
                position: sum.position.scaled(share),
                yaw: sum.yaw * share,
                velocity: sum.velocity.scaled(share),
                spin: sum.spin * share,
                roll: sum.roll.scaled(share),
            });
            let variance = |mean: Vec2| (0.5 * (squares * share - mean.norm_squared())).max(0.0);
            sds.push(slot.map(|s| variance(s.position).sqrt()));
        }
        spread.push(sds);
    }
    for (frame, energy) in mean.energy.iter_mut().enumerate() {
        let all = prediction.ensemble.iter().filter_map(|t| t.energy.get(frame));
        *energy = all.sum::<f64>() / prediction.ensemble.len().max(1) as f64;
    }
    (mean, spread)
}

fn trace_state(id: u32, state: &State, sd: Option<f64>) -> v1::TraceState {
    v1::TraceState {
        object_id: id,
        x: state.position.x,
        y: state.position.y,
        yaw: state.yaw,
        vx: state.velocity.x,
        vy: state.velocity.y,
        spin: state.spin,
        roll_x: state.roll.x,
        roll_y: state.roll.y,
        sd,
    }
}

fn events(recording: &Recording, to: &mut TraceWriter) -> Result<(), RecordingError> {
    for likely in &recording.prediction.events {
        let e = &likely.event;
        let event = v1::TraceEvent {
            kind: word(e.kind).into(),
            time: e.time,
            frame: likely.frame as u32,
            object_ids: e.objects.clone(),
            x: e.position.x,
            y: e.position.y,
            normal_x: e.normal.map(|n| n.x),
            normal_y: e.normal.map(|n| n.y),
            impulse: e.impulse,
            wall: e.wall.clone().unwrap_or_default(),
            probability: likely.probability,
        };
        to.push(&m::EVENTS, e.time, &event)?;
        let log = fox::Log {
            timestamp: timestamp(e.time)?,
            level: fox::log::Level::Info as i32,
            message: sentence(recording, likely),
            name: "vrdp".into(),
            ..Default::default()
        };
        to.push(&m::LOG, e.time, &log)?;
    }
    if let Some(cut) = recording.prediction.cut_short {
        let last = recording.prediction.best.times.last().copied().unwrap_or(0.0);
        let time = cut.frame.and_then(|f| recording.prediction.best.times.get(f)).copied().unwrap_or(last);
        let log = fox::Log {
            timestamp: timestamp(time)?,
            level: fox::log::Level::Warning as i32,
            message: format!("{} rollouts ended early: {}", cut.rollouts, cut.why),
            name: "vrdp".into(),
            ..Default::default()
        };
        to.push(&m::LOG, time, &log)?;
    }
    Ok(())
}

fn word(kind: EventKind) -> &'static str {
    match kind {
        EventKind::Collision => "collision",
        EventKind::Enter => "enter",
        EventKind::Exit => "exit",
        EventKind::Stop => "stop",
    }
}

/// One line about an event, such as `collision of 1 (red metal cube) and 3 (blue rubber sphere)`.
fn sentence(recording: &Recording, likely: &LikelyEvent) -> String {
    let name = |id: &u32| match recording.scene.objects.iter().find(|o| o.id == *id) {
        Some(o) => format!("{id} ({} {} {})", o.color, o.material, o.shape.word()),
        None => id.to_string(),
    };
    let mut objects: Vec<String> = likely.event.objects.iter().map(name).collect();
    objects.extend(likely.event.wall.iter().map(|wall| format!("wall {wall}")));
    let probability = 100.0 * likely.probability;
    format!("{} of {}, probability {probability:.0} %", word(likely.event.kind), objects.join(" and "))
}

/// The fitted parameters of one scene with their standard deviations and 95 % intervals.
pub fn parameters(fit: &Fit, to: &mut TraceWriter) -> Result<(), RecordingError> {
    let parameters = fit.posterior.estimates.iter().map(|e| {
        let [low95, high95] = fit.interval(0, e);
        v1::TraceParameter {
            name: e.name.clone(),
            value: e.value,
            sd: e.sd,
            unit: e.unit.clone(),
            identified: e.identified,
            low95,
            high95,
        }
    });
    to.push(&m::PARAMETERS, 0.0, &v1::TraceParameters { parameters: parameters.collect() })
}
