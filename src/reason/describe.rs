//! Values, changes and events in words.

use super::events::{SceneEvent, SceneEventKind};
use super::operations::ops;
use super::value::{ProgramValue, SpanKind};
use crate::num::Vec2;
use crate::scene::Scene;
use crate::world::Intervention;

/// A value in words.
pub fn describe(scene: &Scene, value: &ProgramValue) -> String {
    let name = |i: &usize| ops::name(scene, *i);
    let list = |parts: Vec<String>| if parts.is_empty() { "none".to_string() } else { parts.join(", ") };
    match value {
        ProgramValue::Objects(objects) => list(objects.iter().map(name).collect()),
        ProgramValue::Object(object) => name(object),
        ProgramValue::Events(events) if events.len() > 8 => format!("{} events", events.len()),
        ProgramValue::Events(events) => list(events.iter().map(|e| describe_event(scene, e)).collect()),
        ProgramValue::Event(event) => describe_event(scene, event),
        ProgramValue::Frame(None) => "at any time".to_string(),
        ProgramValue::Frame(Some(frame)) => format!("frame {frame}"),
        ProgramValue::Time(time) => at_time(scene, *time, 0.0),
        ProgramValue::Span(SpanKind::Video) => "the video".to_string(),
        ProgramValue::Span(SpanKind::Prediction) => "the prediction".to_string(),
        ProgramValue::Span(SpanKind::Both) => "the video and the prediction".to_string(),
        ProgramValue::Word(word) => word.clone(),
        ProgramValue::Order(usize::MAX) => "last".to_string(),
        ProgramValue::Order(place) => format!("number {}", place + 1),
        ProgramValue::Factor(factor) => factor.to_string(),
        ProgramValue::Change(changes) => describe_changes(scene, changes),
        ProgramValue::Text(text) => text.clone(),
        ProgramValue::Number(number) => number.to_string(),
        ProgramValue::Bool(b) => if *b { "yes" } else { "no" }.to_string(),
        ProgramValue::Quantity(value, unit) => quantity(*value, 0.0, unit),
        ProgramValue::Vector(value, unit) => vector(*value, 0.0, unit),
        ProgramValue::Undetermined(why) => format!("not determined: {why}"),
    }
}

/// Changes in words.
pub fn describe_changes(scene: &Scene, changes: &[Intervention]) -> String {
    let words: Vec<String> = changes.iter().map(|change| describe_change(scene, change)).collect();
    if words.is_empty() { "none".to_string() } else { words.join(", ") }
}

/// Decimals at which a number with this deviation has two digits of it; 3 for an exact one.
fn decimals(sd: f64) -> usize {
    const MOST: usize = 6;
    let mut decimals = 0;
    let mut scaled = sd;
    while scaled > 0.0 && scaled < 9.5 && decimals < MOST {
        scaled *= 10.0;
        decimals += 1;
    }
    if sd > 0.0 { decimals.max(1) } else { 3 }
}

/// "0.88 +- 0.01 m/s".
pub fn quantity(value: f64, sd: f64, unit: &str) -> String {
    let digits = decimals(sd);
    let deviation = if sd > 0.0 { format!(" +- {sd:.digits$}") } else { String::new() };
    format!("{value:.digits$}{deviation} {unit}").trim_end().to_string()
}

/// "(0.12, -1.50) +- 0.01 m".
pub fn vector(value: Vec2, sd: f64, unit: &str) -> String {
    let digits = decimals(sd);
    let deviation = if sd > 0.0 { format!(" +- {sd:.digits$}") } else { String::new() };
    format!("({:.digits$}, {:.digits$}){deviation} {unit}", value.x, value.y)
}

/// "5.40 +- 0.03 s (frame 135)".
pub fn at_time(scene: &Scene, time: f64, sd: f64) -> String {
    let end = scene.times.last().copied().unwrap_or(0.0);
    let after =
        if time > end { format!(", {:.2} s after the video ends", time - end) } else { String::new() };
    format!("{} (frame {}{after})", quantity(time, sd, "s"), scene.frame_at(time))
}

fn describe_change(scene: &Scene, change: &Intervention) -> String {
    let name = |id: &u32| scene.object_index(*id).map(|i| ops::name(scene, i));
    match change {
        Intervention::Remove { id } => format!("without {}", name(id).unwrap_or_default()),
        Intervention::ScaleMass { id, factor } => {
            format!("the mass of {} times {factor}", name(id).unwrap_or_default())
        }
        Intervention::ScaleVelocity { id, factor } => {
            format!("the velocity of {} times {factor}", name(id).unwrap_or_default())
        }
        Intervention::ScaleRestitution { id, factor } => {
            format!("the restitution of {} times {factor}", name(id).unwrap_or_default())
        }
        Intervention::ScaleFriction { id, factor } => {
            format!("the friction of {} times {factor}", name(id).unwrap_or_default())
        }
        Intervention::Shift { id, by } => {
            format!("{} moved by ({}, {}) m", name(id).unwrap_or_default(), by.x, by.y)
        }
        Intervention::Add { body } => {
            let p = body.start.state.position;
            format!("another {} at ({}, {}) m", body.shape.word(), p.x, p.y)
        }
        Intervention::SwitchEffect { name, .. } => format!("without {name}"),
        other => format!("{other:?}"),
    }
}

/// "the red metal cube collides with the blue rubber sphere".
pub fn event_words(scene: &Scene, event: &SceneEvent) -> String {
    let name = |k: usize| event.objects.get(k).map(|i| ops::name(scene, *i)).unwrap_or_default();
    match event.kind {
        SceneEventKind::Collision => format!("{} collides with {}", name(0), name(1)),
        SceneEventKind::Approach => format!("{} comes close to {} without touching it", name(0), name(1)),
        SceneEventKind::In => format!("{} enters the scene", name(0)),
        SceneEventKind::Out => format!("{} exits the scene", name(0)),
        SceneEventKind::Side(side) => format!("{} collides with the {side} side", name(0)),
        SceneEventKind::Start => "the video begins".to_string(),
        SceneEventKind::End => "the video ends".to_string(),
        SceneEventKind::Stop => format!("{} comes to rest", name(0)),
        SceneEventKind::Never => "no such event".to_string(),
    }
}

/// "the red metal cube collides with the blue rubber sphere (frame 44)".
pub fn describe_event(scene: &Scene, event: &SceneEvent) -> String {
    let what = event_words(scene, event);
    let is_timed = event.frame > 0 && event.kind != SceneEventKind::Never;
    if is_timed { format!("{what} (frame {})", event.frame) } else { what }
}
