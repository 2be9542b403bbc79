//! Writes a recording as MCAP: log time is simulation time, so equal recordings give equal bytes.

use super::messages::{self as m, Topic, foxglove as fox, v1};
use super::{FRAME, MAX_TIME, Recording, RecordingError};
use crate::num::Vec2;
use crate::reason::LikelyEvent;
use crate::scene::Shape;
use crate::world::{EventKind, State};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions};
use prost::Message;
use prost_types::Timestamp;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;

/// The trace file of one simulation.
pub fn encode(recording: &Recording) -> Result<Vec<u8>, RecordingError> {
    let mut messages = Vec::new();
    measured(recording, &mut messages)?;
    simulated(recording, &mut messages)?;
    events(recording, &mut messages)?;
    parameters(recording, &mut messages)?;
    messages.sort_by_key(|message| (message.time, message.topic));
    write(recording, &messages)
}

struct Timed {
    /// ns from the start of the video.
    time: u64,
    /// Index into [`m::TOPICS`].
    topic: usize,
    data: Vec<u8>,
}

fn push(to: &mut Vec<Timed>, topic: &Topic, time: f64, message: &impl Message) -> Result<(), RecordingError> {
    let topic = m::TOPICS.iter().position(|t| t.name == topic.name).unwrap_or(0);
    to.push(Timed { time: nanoseconds(time)?, topic, data: message.encode_to_vec() });
    Ok(())
}

fn nanoseconds(time: f64) -> Result<u64, RecordingError> {
    if !(0.0..=MAX_TIME).contains(&time) {
        return Err(RecordingError::Time { time });
    }
    Ok((time * 1e9).round() as u64)
}

fn timestamp(time: f64) -> Result<Option<Timestamp>, RecordingError> {
    let ns = nanoseconds(time)?;
    Ok(Some(Timestamp { seconds: (ns / 1_000_000_000) as i64, nanos: (ns % 1_000_000_000) as i32 }))
}

fn measured(recording: &Recording, to: &mut Vec<Timed>) -> Result<(), RecordingError> {
    let scene = recording.scene;
    let mut rows: BTreeMap<usize, (Vec<fox::Pose>, Vec<v1::TraceResidual>)> = BTreeMap::new();
    for (object, track) in scene.objects.iter().zip(&scene.tracks) {
        let body = recording.imagined.best.ids.iter().position(|id| *id == object.id);
        for sample in &track.samples {
            let (poses, residuals) = rows.entry(sample.frame).or_default();
            poses.push(pose(sample.position, &object.shape, sample.yaw.unwrap_or(0.0)));
            let row = recording.imagined.best.states.get(sample.frame);
            let state = row.zip(body).and_then(|(row, body)| row.get(body).copied().flatten());
            if let Some(state) = state {
                let Vec2 { x, y } = sample.position - state.position;
                residuals.push(v1::TraceResidual { object_id: object.id, x, y });
            }
        }
    }
    for (frame, (poses, residuals)) in rows {
        let time = scene.time_of(frame);
        let poses = fox::PosesInFrame { timestamp: timestamp(time)?, frame_id: FRAME.into(), poses };
        push(to, &m::MEASURED, time, &poses)?;
        push(to, &m::RESIDUALS, time, &v1::TraceResiduals { frame: frame as u32, residuals })?;
    }
    Ok(())
}

fn simulated(recording: &Recording, to: &mut Vec<Timed>) -> Result<(), RecordingError> {
    let (scene, imagined) = (recording.scene, recording.imagined);
    let shapes: Vec<Shape> = imagined.model.bodies.iter().map(|b| b.shape).collect();
    let color_of = |id: &u32| scene.objects.iter().find(|o| o.id == *id).map(|o| color(&o.color));
    let colors: Vec<fox::Color> =
        imagined.best.ids.iter().map(|id| color_of(id).unwrap_or_else(|| color(""))).collect();
    for (frame, (row, &time)) in imagined.best.states.iter().zip(&imagined.best.times).enumerate() {
        let timestamp = timestamp(time)?;
        let mut states = Vec::with_capacity(row.len());
        let mut poses = Vec::with_capacity(row.len());
        let mut transforms = Vec::with_capacity(row.len());
        let mut entities = Vec::with_capacity(row.len());
        let bodies = row.iter().zip(&imagined.best.ids).zip(shapes.iter().zip(&colors)).enumerate();
        for (body, ((state, &id), (shape, color))) in bodies {
            let Some(state) = state else { continue };
            let sd = imagined.sd.get(frame).and_then(|row| row.get(body).copied().flatten());
            states.push(trace_state(id, state, sd));
            let pose = pose(state.position, shape, state.yaw);
            transforms.push(fox::FrameTransform {
                timestamp,
                parent_frame_id: FRAME.into(),
                child_frame_id: format!("object_{id}"),
                translation: pose.position,
                rotation: pose.orientation,
            });
            entities.push(entity(id, shape, pose, *color, timestamp));
            poses.push(pose);
        }
        let energy = imagined.best.energy.get(frame).copied().unwrap_or(0.0);
        push(to, &m::STATES, time, &v1::TraceFrame { frame: frame as u32, time, energy, states })?;
        push(to, &m::POSES, time, &fox::PosesInFrame { timestamp, frame_id: FRAME.into(), poses })?;
        push(to, &m::TRANSFORMS, time, &fox::FrameTransforms { transforms })?;
        push(to, &m::SHAPES, time, &fox::SceneUpdate { entities })?;
    }
    Ok(())
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

fn pose(position: Vec2, shape: &Shape, yaw: f64) -> fox::Pose {
    let position = fox::Vector3 { x: position.x, y: position.y, z: shape.centre_height() };
    let orientation = fox::Quaternion { x: 0.0, y: 0.0, z: (0.5 * yaw).sin(), w: (0.5 * yaw).cos() };
    fox::Pose { position: Some(position), orientation: Some(orientation) }
}

fn entity(
    id: u32,
    shape: &Shape,
    pose: fox::Pose,
    color: fox::Color,
    timestamp: Option<Timestamp>,
) -> fox::SceneEntity {
    let (pose, color) = (Some(pose), Some(color));
    let size = |x: f64, y: f64| Some(fox::Vector3 { x, y, z: 2.0 * shape.centre_height() });
    let mut entity = fox::SceneEntity {
        timestamp,
        frame_id: FRAME.into(),
        id: format!("object_{id}"),
        ..Default::default()
    };
    match *shape {
        Shape::Disc { radius } => entity.cylinders.push(fox::CylinderPrimitive {
            pose,
            size: size(2.0 * radius, 2.0 * radius),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color,
        }),
        Shape::Ball { radius } => {
            entity.spheres.push(fox::SpherePrimitive { pose, size: size(2.0 * radius, 2.0 * radius), color });
        }
        Shape::Square { half_side: a } => {
            entity.cubes.push(fox::CubePrimitive { pose, size: size(2.0 * a, 2.0 * a), color });
        }
        Shape::Rectangle { half_length: a, half_width: b } => {
            entity.cubes.push(fox::CubePrimitive { pose, size: size(2.0 * a, 2.0 * b), color });
        }
    }
    entity
}

/// CLEVRER's colour words as RGB; grey for any other.
fn color(word: &str) -> fox::Color {
    let [r, g, b] = match word {
        "red" => [0.68, 0.14, 0.14],
        "blue" => [0.16, 0.29, 0.84],
        "green" => [0.11, 0.41, 0.08],
        "brown" => [0.51, 0.29, 0.10],
        "purple" => [0.51, 0.15, 0.75],
        "cyan" => [0.16, 0.82, 0.82],
        "yellow" => [1.0, 0.93, 0.20],
        _ => [0.5, 0.5, 0.5],
    };
    fox::Color { r, g, b, a: 1.0 }
}

fn events(recording: &Recording, to: &mut Vec<Timed>) -> Result<(), RecordingError> {
    for likely in &recording.imagined.events {
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
        push(to, &m::EVENTS, e.time, &event)?;
        let log = fox::Log {
            timestamp: timestamp(e.time)?,
            level: fox::log::Level::Info as i32,
            message: sentence(recording, likely),
            name: "vrdp".into(),
            ..Default::default()
        };
        push(to, &m::LOG, e.time, &log)?;
    }
    if let Some(cut) = recording.imagined.cut_short {
        let last = recording.imagined.best.times.last().copied().unwrap_or(0.0);
        let time = cut.frame.and_then(|f| recording.imagined.best.times.get(f)).copied().unwrap_or(last);
        let log = fox::Log {
            timestamp: timestamp(time)?,
            level: fox::log::Level::Warning as i32,
            message: format!("{} rollouts ended early: {}", cut.rollouts, cut.why),
            name: "vrdp".into(),
            ..Default::default()
        };
        push(to, &m::LOG, time, &log)?;
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

fn parameters(recording: &Recording, to: &mut Vec<Timed>) -> Result<(), RecordingError> {
    let parameters = recording.estimates.iter().map(|e| v1::TraceParameter {
        name: e.name.clone(),
        value: e.value,
        sd: e.sd,
        unit: e.unit.clone(),
        identified: e.identified,
    });
    push(to, &m::PARAMETERS, 0.0, &v1::TraceParameters { parameters: parameters.collect() })
}

fn write(recording: &Recording, messages: &[Timed]) -> Result<Vec<u8>, RecordingError> {
    let options = WriteOptions::new().compression(Some(Compression::Lz4)).library("vrdp");
    let mut bytes = Vec::new();
    let mut file = options.create(Cursor::new(&mut bytes))?;
    file.write_metadata(&metadata(recording)?)?;
    let model = serde_json::to_vec(&recording.imagined.model)?;
    for (name, data) in
        [("request.json", recording.request_json.as_bytes()), ("model.json", model.as_slice())]
    {
        file.attach(&Attachment {
            log_time: 0,
            create_time: 0,
            name: name.into(),
            media_type: "application/json".into(),
            data: Cow::Borrowed(data),
        })?;
    }
    let mut channels = Vec::with_capacity(m::TOPICS.len());
    for topic in &m::TOPICS {
        let schema = file.add_schema(topic.schema, "protobuf", topic.descriptors)?;
        channels.push(file.add_channel(schema, topic.name, "protobuf", &BTreeMap::new())?);
    }
    let mut sequence = vec![0; m::TOPICS.len()];
    for message in messages {
        let header = MessageHeader {
            channel_id: channels[message.topic],
            sequence: sequence[message.topic],
            log_time: message.time,
            publish_time: message.time,
        };
        sequence[message.topic] += 1;
        file.write_to_known_channel(&header, &message.data)?;
    }
    file.finish()?;
    drop(file);
    Ok(bytes)
}

fn metadata(recording: &Recording) -> Result<Metadata, RecordingError> {
    let (scene, imagined) = (recording.scene, recording.imagined);
    let entries = [
        ("build", env!("CARGO_PKG_VERSION").to_string()),
        ("video", recording.video.to_string()),
        ("scene", scene.name.clone()),
        ("preset", imagined.model.preset.clone()),
        ("model", recording.model.to_string()),
        ("seed", recording.seed.to_string()),
        ("frames", imagined.best.states.len().to_string()),
        ("observed_frames", imagined.observed_frames.to_string()),
        ("rollouts", imagined.ensemble.len().to_string()),
        ("interventions", serde_json::to_string(&imagined.interventions)?),
    ];
    let metadata = entries.into_iter().map(|(key, value)| (key.to_string(), value)).collect();
    Ok(Metadata { name: "vrdp".into(), metadata })
}
