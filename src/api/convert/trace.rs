//! Traces: requests to domain values, records and replayed items to replies.

use super::names::{model_ids, model_name, trace_name, video_name};
use super::violations::Violations;
use crate::api::v1;
use crate::engine::{EngineError, ReplayItem, ReplayOptions, TraceFilter, TraceKind, TraceRecord};
use crate::recording::messages::v1 as recorded;
use prost_types::Timestamp;

/// Slowest and fastest replay (times real time).
const SPEEDS: [f64; 2] = [0.001, 1000.0];

/// Which traces to list, how many and after which.
pub fn list(given: v1::ListTracesRequest) -> Result<(TraceFilter, usize, String), EngineError> {
    let mut violations = Violations::default();
    let video = violations.optional_id("video", &given.video, "videos");
    let mut filter = TraceFilter { video, ..TraceFilter::default() };
    if !given.model.is_empty() {
        match model_ids(&given.model) {
            Some((of, id)) if filter.video.as_ref().is_none_or(|v| v == of) => {
                (filter.video, filter.model) = (Some(of.to_string()), Some(id.to_string()));
            }
            Some(_) => violations.add("model", format!("is {:?}, which is of another video", given.model)),
            None => {
                violations.add("model", format!("is {:?}; must be videos/{{id}}/models/{{id}}", given.model));
            }
        }
    }
    filter.stored_ms = (
        milliseconds(&mut violations, "stored_from", given.stored_from),
        milliseconds(&mut violations, "stored_before", given.stored_before),
    );
    let (size, after) = violations.page(given.page_size, given.page_token);
    violations.finish((filter, size, after))
}

/// Whole milliseconds after 1970 of a time.
pub fn milliseconds(violations: &mut Violations, path: &str, time: Option<Timestamp>) -> Option<u64> {
    let time = time?;
    let within = |seconds: u64| seconds.checked_mul(1000)?.checked_add(time.nanos as u64 / 1_000_000);
    let found = u64::try_from(time.seconds).ok().filter(|_| (0..1_000_000_000).contains(&time.nanos));
    let found = found.and_then(within);
    if found.is_none() {
        violations.add(path, "is no time after 1970 with nanos from 0 to 999999999");
    }
    found
}

/// Id of the trace and how to play it.
pub fn replay(given: v1::ReplayTraceRequest) -> Result<(String, ReplayOptions), EngineError> {
    let mut violations = Violations::default();
    let id = violations.id("name", &given.name, "traces");
    let default = ReplayOptions::default();
    let speed = given.speed.unwrap_or(default.speed);
    let [slowest, fastest] = SPEEDS;
    if speed != 0.0 && !(slowest..=fastest).contains(&speed) {
        violations.add("speed", format!("is {speed:?}; must be 0, or from {slowest:?} to {fastest:?}"));
    }
    if given.r#loop && speed == 0.0 {
        violations.add("loop", "needs a speed above 0");
    }
    let (from, to) = (given.from, given.to.unwrap_or(default.to));
    if !(0.0..=default.to).contains(&from) {
        violations.add("from", format!("is {from:?}; must be from 0 to {:?} s", default.to));
    }
    if !(from..=default.to).contains(&to) {
        violations.add("to", format!("is {to:?}; must be from `from` to {:?} s", default.to));
    }
    violations.finish((id, ReplayOptions { speed, from, to, repeat: given.r#loop }))
}

pub fn trace(record: TraceRecord) -> v1::Trace {
    let kind = match record.kind {
        TraceKind::Simulation => v1::TraceKind::Simulation,
        TraceKind::Fit => v1::TraceKind::Fit,
        TraceKind::Discovery => v1::TraceKind::Discovery,
    };
    v1::Trace {
        name: trace_name(&record.id),
        video: video_name(&record.video),
        model: model_name(&record.video, &record.model),
        size_bytes: record.size_bytes,
        frames: record.frames,
        seed: record.seed,
        interventions: record.interventions,
        kind: kind.into(),
        store_time: Some(timestamp(record.stored_ms)),
    }
}

/// The time that many milliseconds after 1970.
pub fn timestamp(ms: u64) -> Timestamp {
    Timestamp { seconds: (ms / 1000) as i64, nanos: (ms % 1000) as i32 * 1_000_000 }
}

pub fn played(round: u64, time: f64, item: ReplayItem) -> v1::ReplayTraceResponse {
    use v1::replay_trace_response::Item;
    let item = match item {
        ReplayItem::Frame(row) => Item::Frame(frame(row)),
        ReplayItem::Event(e) => Item::Event(event(e)),
    };
    v1::ReplayTraceResponse { time, round, item: Some(item) }
}

fn frame(row: recorded::TraceFrame) -> v1::SimulatedFrame {
    let state = |s: recorded::TraceState| v1::ObjectState {
        object_id: s.object_id,
        x: s.x,
        y: s.y,
        yaw: s.yaw,
        vx: s.vx,
        vy: s.vy,
        spin: s.spin,
        sd: s.sd.unwrap_or(0.0),
    };
    let objects = row.states.into_iter().map(state).collect();
    v1::SimulatedFrame { frame: row.frame, time: row.time, objects }
}

fn event(e: recorded::TraceEvent) -> v1::SimulatedEvent {
    let kind = match e.kind.as_str() {
        "collision" => v1::EventKind::Collision,
        "enter" => v1::EventKind::Enter,
        "exit" => v1::EventKind::Exit,
        "stop" => v1::EventKind::Stop,
        _ => v1::EventKind::Unspecified,
    };
    v1::SimulatedEvent {
        kind: kind.into(),
        frame: e.frame,
        time: e.time,
        object_ids: e.object_ids,
        probability: e.probability,
        wall: e.wall,
    }
}
