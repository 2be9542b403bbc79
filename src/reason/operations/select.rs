//! The operations that select objects and events and ask for their attributes.

use super::machine::{Machine, Outcome, happened};
use super::ops;
use crate::reason::ReasonError;
use crate::reason::context::Halt;
use crate::reason::events::{SceneEvent, SceneEventKind};
use crate::reason::value::ProgramValue::*;
use crate::reason::value::SpanKind;
use crate::reason::words::DrawnWords;

pub fn all_objects(m: &mut Machine) -> Outcome {
    m.words.clear();
    Ok(Objects(ops::all(m.context.scene)))
}

/// The object with this number in the scene.
pub fn object_number(m: &mut Machine) -> Outcome {
    let (number, scene) = (m.factor()?, m.context.scene);
    let found = scene.objects.iter().position(|o| f64::from(o.id) == number);
    if let Some(absent) = scene.absent.iter().find(|o| f64::from(o.id) == number) {
        return Err(ops::not_shown(absent));
    }
    found.map(Object).ok_or_else(|| {
        let candidates = (0..scene.objects.len()).map(|i| ops::numbered(scene, i)).collect();
        ReasonError::NoSuchObject { phrase: format!("object {number}"), candidates }.into()
    })
}

/// Two objects as objects to choose from.
pub fn either(m: &mut Machine) -> Outcome {
    let (second, first) = (m.object()?, m.object()?);
    Ok(Objects(vec![first, second]))
}

pub fn pair(m: &mut Machine) -> Outcome {
    let objects = m.objects()?;
    if objects.len() == 2 {
        return Ok(Objects(objects));
    }
    let words = m.words.join(" ");
    Err(ops::unique_object(m.context.scene, &objects, &format!("the two {words} objects"))
        .err()
        .unwrap_or(ReasonError::AmbiguousObject { phrase: "the two objects".into(), candidates: vec![] })
        .into())
}

pub fn events(m: &mut Machine) -> Outcome {
    let span = match m.token() {
        "unseen_events" => SpanKind::Prediction,
        "whole_events" => SpanKind::Both,
        _ => SpanKind::Video,
    };
    Ok(Events(m.context.events(&m.supposed, span)?))
}

/// When two objects come near each other and do not touch.
pub fn approaches(m: &mut Machine) -> Outcome {
    let span = m.span()?;
    Ok(Events(m.context.approaches(&m.supposed, span)?))
}

/// Whether a word of the lexicon describes an object: at a moment if there is one, else over the whole video.
pub fn has_word(m: &mut Machine) -> Outcome {
    let frame = optional_frame(m)?;
    let (name, object) = (m.word()?, m.object()?);
    Ok(Bool(learned_words(m, &name)?.holds(&name, object, frame)))
}

pub fn all_events(m: &mut Machine) -> Outcome {
    Ok(Events(ops::conceivable(m.context.scene)))
}

pub fn edge(m: &mut Machine) -> Outcome {
    let is_start = ["start", "filter_start"].contains(&m.token());
    Ok(Event(ops::edge(m.context.scene, if is_start { SceneEventKind::Start } else { SceneEventKind::End })))
}

/// CLEVRER's form of [`edge`], which pops events.
pub fn filter_edge(m: &mut Machine) -> Outcome {
    m.events()?;
    edge(m)
}

pub fn null(_: &mut Machine) -> Outcome {
    Ok(Frame(None))
}

pub fn unique(m: &mut Machine) -> Outcome {
    match m.pop()? {
        Objects(objects) if objects.is_empty() && ops::absent(m.context.scene, &m.words).is_some() => {
            Err(ops::absent(m.context.scene, &m.words).map_or_else(|| m.mismatch(), ops::not_shown))
        }
        Objects(objects) => Ok(Object(ops::unique_object(m.context.scene, &objects, &m.words.join(" "))?)),
        Events(events) => Ok(Event(ops::unique_event(&events)?)),
        _ => Err(m.mismatch()),
    }
}

pub fn count(m: &mut Machine) -> Outcome {
    Ok(Number(m.count()?))
}

pub fn exist(m: &mut Machine) -> Outcome {
    Ok(Bool(m.count()? > 0))
}

pub fn negate(m: &mut Machine) -> Outcome {
    Ok(Bool(!m.boolean()?))
}

pub fn belong_to(m: &mut Machine) -> Outcome {
    let events = m.events()?;
    match m.pop()? {
        Event(event) => Ok(Bool(ops::has_event(&events, &event))),
        Object(object) => Ok(Bool(ops::has_object(&events, object))),
        _ => Err(m.mismatch()),
    }
}

pub fn get_frame(m: &mut Machine) -> Outcome {
    Ok(Frame(Some(happened(m.event()?)?.frame)))
}

pub fn get_object(m: &mut Machine) -> Outcome {
    match happened(m.event()?)?.objects[..] {
        [one] => Ok(Object(one)),
        _ => Err(ReasonError::NoSingleEvent { found: "none of one object".into() }.into()),
    }
}

/// The objects that take part in the events, each once, by the time of its first event.
pub fn participants(m: &mut Machine) -> Outcome {
    let mut found: Vec<usize> = vec![];
    for object in m.events()?.iter().flat_map(|e| e.objects.clone()) {
        if !found.contains(&object) {
            found.push(object);
        }
    }
    Ok(Objects(found))
}

pub fn get_partner(m: &mut Machine) -> Outcome {
    let object = m.object()?;
    Ok(Object(ops::partner(&m.event()?, object)?))
}

pub fn query(m: &mut Machine) -> Outcome {
    let object = m.object()?;
    match m.context.attribute(m.token(), object) {
        Some(word) => Ok(Text(word.to_string())),
        None => Err(m.mismatch()),
    }
}

/// The number of different colours, materials or shapes.
pub fn count_distinct(m: &mut Machine) -> Outcome {
    let (context, token) = (m.context, m.token());
    let all = m.objects()?;
    let mut found: Vec<&str> =
        all.iter().filter_map(|i| context.attribute(token, *i)).filter(|w| !w.is_empty()).collect();
    found.sort_unstable();
    found.dedup();
    Ok(Number(found.len()))
}

pub fn filter_word(m: &mut Machine) -> Outcome {
    let word = m.word()?;
    m.words.push(word.clone());
    let (context, token) = (m.context, m.token());
    let fits = |i: &usize| context.attribute(token, *i) == Some(word.as_str());
    Ok(Objects(m.objects()?.into_iter().filter(fits).collect()))
}

/// Objects, or encounters of two of them, that a word of the lexicon describes: at a moment if there is one, else over the whole video.
pub fn filter_concept(m: &mut Machine) -> Outcome {
    let frame = optional_frame(m)?;
    let name = m.word()?;
    m.words.push(name.clone());
    let (context, words) = (m.context, learned_words(m, &name)?);
    match m.pop()? {
        Objects(mut objects) => {
            objects.retain(|o| words.holds(&name, *o, frame));
            Ok(Objects(objects))
        }
        Events(mut events) => {
            let holds = |e: &SceneEvent| {
                let met = context.encounter(e);
                met.is_some_and(|met| words.holds_for_encounter(&name, &e.objects, &met.features))
            };
            events.retain(holds);
            Ok(Events(events))
        }
        _ => Err(m.mismatch()),
    }
}

/// The frame of a moment on top of the stack, if there is one.
fn optional_frame(m: &mut Machine) -> Result<Option<usize>, Halt> {
    let is_moment = matches!(m.stack.last(), Some(Frame(_) | Event(_) | Time(_) | Factor(_)));
    if is_moment { m.frame() } else { Ok(None) }
}

/// The words of the lexicon, without which `name` is unknown.
fn learned_words<'a>(m: &Machine<'a>, name: &str) -> Result<DrawnWords<'a>, Halt> {
    let unknown = || ReasonError::UnknownWord { word: name.to_string(), known: vec![] };
    Ok(m.context.words.ok_or_else(unknown)?)
}

pub fn filter_motion(m: &mut Machine) -> Outcome {
    let frame = m.frame()?;
    let objects = m.objects()?;
    let rollout = m.context.rollout(&[], m.context.frames(SpanKind::Video))?;
    Ok(Objects(ops::filter_motion(rollout, &objects, frame, m.token() == "filter_moving")))
}

pub fn filter_kind(m: &mut Machine) -> Outcome {
    let kind = match SceneEventKind::of_filter(m.token()) {
        Some(kind) => kind,
        None => SceneEventKind::of_side(&m.word()?),
    };
    let objects = m.any_objects()?;
    Ok(Events(ops::filter_kind(&m.events()?, kind, &objects)))
}

/// The hits of any side of the table; as contacts also the collisions with objects.
pub fn filter_sides(m: &mut Machine) -> Outcome {
    let all = m.token() == "filter_contact";
    let objects = m.any_objects()?;
    let is_kind = |e: &SceneEvent| match e.kind {
        SceneEventKind::Side(_) => true,
        SceneEventKind::Collision => all,
        _ => false,
    };
    let of = |e: &&SceneEvent| is_kind(e) && e.objects.iter().any(|o| objects.contains(o));
    Ok(Events(m.events()?.iter().filter(of).cloned().collect()))
}

/// Collisions of two of the objects with each other.
pub fn filter_among(m: &mut Machine) -> Outcome {
    let objects = m.objects()?;
    let among = |e: &&SceneEvent| {
        e.kind == SceneEventKind::Collision && e.objects.iter().all(|o| objects.contains(o))
    };
    Ok(Events(m.events()?.iter().filter(among).cloned().collect()))
}

pub fn filter_partner(m: &mut Machine) -> Outcome {
    let (partners, object) = (m.objects()?, m.object()?);
    Ok(Events(ops::filter_partner(&m.events()?, object, &partners)))
}

pub fn filter_time(m: &mut Machine) -> Outcome {
    let after = m.token() == "filter_after";
    let limit = match m.pop()? {
        Event(event) => Some(happened(event)?),
        moment @ (Time(_) | Frame(_) | Factor(_)) => ops::limit(m.context.scene, &moment),
        _ => return Err(m.mismatch()),
    };
    Ok(Events(ops::filter_time(&m.events()?, limit.as_ref(), after)))
}

pub fn filter_order(m: &mut Machine) -> Outcome {
    let place = m.order()?;
    let events = m.events()?;
    let none = || ReasonError::NoSingleEvent { found: format!("{} of them", events.len()) };
    Ok(Event(ops::order(&events, place).ok_or_else(none)?))
}

pub fn filter_ancestor(m: &mut Machine) -> Outcome {
    let event = happened(m.event()?)?;
    Ok(Events(ops::ancestors(&m.events()?, &event)))
}

/// The events of the video that these lack.
pub fn lost_events(m: &mut Machine) -> Outcome {
    let kept = m.events()?;
    let actual = m.context.events(&[], SpanKind::Video)?;
    Ok(Events(ops::lacking(&kept, &actual)))
}

/// The events that the video lacks.
pub fn new_events(m: &mut Machine) -> Outcome {
    let events = m.events()?;
    let actual = m.context.events(&[], SpanKind::Video)?;
    Ok(Events(ops::lacking(&actual, &events)))
}
