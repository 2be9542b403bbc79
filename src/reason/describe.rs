//! Values, changes and events in words.

use super::events::{SceneEvent, SceneEventKind};
use super::ops;
use super::value::ProgramValue;
use crate::scene::Scene;
use crate::world::Intervention;

/// A value in words.
pub fn describe(scene: &Scene, value: &ProgramValue) -> String {
    let name = |i: &usize| scene.objects.get(*i).map(ops::phrase).unwrap_or_default();
    let list = |parts: Vec<String>| if parts.is_empty() { "none".to_string() } else { parts.join(", ") };
    match value {
        ProgramValue::Objects(objects) => list(objects.iter().map(name).collect()),
        ProgramValue::Object(object) => name(object),
        ProgramValue::Events(events) if events.len() > 8 => format!("{} events", events.len()),
        ProgramValue::Events(events) => list(events.iter().map(|e| describe_event(scene, e)).collect()),
        ProgramValue::Event(event) => describe_event(scene, event),
        ProgramValue::Frame(None) => "at any time".to_string(),
        ProgramValue::Frame(Some(frame)) => format!("frame {frame}"),
        ProgramValue::Word(word) => word.to_string(),
        ProgramValue::Concept(k) => format!("word {k} of the lexicon"),
        ProgramValue::Order(usize::MAX) => "last".to_string(),
        ProgramValue::Order(place) => format!("number {}", place + 1),
        ProgramValue::Factor(factor) => factor.to_string(),
        ProgramValue::Change(changes) => {
            list(changes.iter().map(|change| describe_change(scene, change)).collect())
        }
        ProgramValue::Text(text) => text.clone(),
        ProgramValue::Number(number) => number.to_string(),
        ProgramValue::Bool(b) => if *b { "yes" } else { "no" }.to_string(),
    }
}

fn describe_change(scene: &Scene, change: &Intervention) -> String {
    let name = |id: &u32| scene.object_index(*id).and_then(|i| scene.objects.get(i)).map(ops::phrase);
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

/// "the red metal cube collides with the blue rubber sphere (frame 44)".
pub fn describe_event(scene: &Scene, event: &SceneEvent) -> String {
    let name = |k: usize| {
        let object = event.objects.get(k).and_then(|i| scene.objects.get(*i));
        object.map(ops::phrase).unwrap_or_default()
    };
    let what = match event.kind {
        SceneEventKind::Collision => format!("{} collides with {}", name(0), name(1)),
        SceneEventKind::In => format!("{} enters the scene", name(0)),
        SceneEventKind::Out => format!("{} exits the scene", name(0)),
        SceneEventKind::Side(side) => format!("{} collides with the {side} side", name(0)),
        SceneEventKind::Start => "the video begins".to_string(),
        SceneEventKind::End => "the video ends".to_string(),
        SceneEventKind::Never => return "no such event".to_string(),
    };
    if event.frame == 0 { what } else { format!("{what} (frame {})", event.frame) }
}
