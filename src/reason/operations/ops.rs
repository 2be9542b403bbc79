//! What operations do, as functions of plain data.

use crate::effects::effect;
use crate::num::{Vec2, vec2};
use crate::reason::ReasonError;
use crate::reason::context::Halt;
use crate::reason::events::{RolloutEvents, SIDES, SceneEvent, SceneEventKind};
use crate::reason::value::ProgramValue;
use crate::scene::{Object, Scene};
use crate::world::{BodySpec, Intervention, InterventionError, Start, State};

/// Mass factors of "heavier" and "lighter".
pub const HEAVIER: f64 = 5.0;
pub const LIGHTER: f64 = 0.2;
/// CLEVRER's "end" of a video is this many frames before the number of frames.
const END_MARGIN: usize = 3;

/// "the red metal cube"; "the cube 3" for an object without a colour.
pub fn phrase(object: &Object) -> String {
    format!("the {}", object.description())
}

/// The phrase of an object of the scene, with its number where another object looks alike.
pub fn name(scene: &Scene, index: usize) -> String {
    let Some(object) = scene.objects.get(index) else { return String::new() };
    let text = object.description();
    let alike = scene.objects.iter().filter(|o| o.description() == text).count();
    if alike > 1 { numbered(scene, index) } else { phrase(object) }
}

/// "the red metal cube (object 3)".
pub fn numbered(scene: &Scene, index: usize) -> String {
    scene.objects.get(index).map_or(String::new(), |o| format!("{} (object {})", phrase(o), o.id))
}

pub fn all(scene: &Scene) -> Vec<usize> {
    (0..scene.objects.len()).collect()
}

/// Every event that a choice can name: two objects collide; an object enters, exits or hits a side of the table.
pub fn conceivable(scene: &Scene) -> Vec<SceneEvent> {
    let n = scene.objects.len();
    let event = |kind, objects| SceneEvent { kind, frame: 0, time: 0.0, objects };
    let pairs = (0..n).flat_map(|b| (0..b).map(move |a| vec![a, b]));
    let mut events: Vec<SceneEvent> = pairs.map(|p| event(SceneEventKind::Collision, p)).collect();
    for i in 0..n {
        events.extend([event(SceneEventKind::In, vec![i]), event(SceneEventKind::Out, vec![i])]);
        if scene.table.is_some() {
            events.extend(SIDES.map(|side| event(SceneEventKind::Side(side), vec![i])));
        }
    }
    events
}

/// The start or the end of the video.
pub fn edge(scene: &Scene, kind: SceneEventKind) -> SceneEvent {
    let last = scene.times.len().saturating_sub(END_MARGIN);
    let frame = if kind == SceneEventKind::Start { 0 } else { last };
    SceneEvent { kind, frame, time: scene.time_of(frame), objects: vec![] }
}

/// Objects that move, or rest, in a frame. Without a frame: objects that ever move, or that never do.
pub fn filter_motion(
    rollout: &RolloutEvents,
    objects: &[usize],
    frame: Option<usize>,
    moving: bool,
) -> Vec<usize> {
    let of = |i: &usize| rollout.moving.get(*i).map(Vec::as_slice).unwrap_or_default();
    let fits = |i: &&usize| match frame {
        Some(frame) => of(i).get(frame).copied().flatten() == Some(moving),
        None => {
            let seen: Vec<bool> = of(i).iter().flatten().copied().collect();
            !seen.is_empty() && seen.contains(&true) == moving
        }
    };
    objects.iter().filter(fits).copied().collect()
}

pub fn filter_kind(events: &[SceneEvent], kind: SceneEventKind, objects: &[usize]) -> Vec<SceneEvent> {
    let fits = |e: &&SceneEvent| e.kind == kind && e.objects.iter().any(|o| objects.contains(o));
    events.iter().filter(fits).cloned().collect()
}

/// Collisions of the object with one of the partners.
pub fn filter_partner(events: &[SceneEvent], object: usize, partners: &[usize]) -> Vec<SceneEvent> {
    let others = |e: &&SceneEvent| e.objects.iter().any(|o| *o != object && partners.contains(o));
    filter_kind(events, SceneEventKind::Collision, &[object]).iter().filter(others).cloned().collect()
}

/// A moment as the limit of events before or after it; `None` for any time.
pub fn limit(scene: &Scene, moment: &ProgramValue) -> Option<SceneEvent> {
    let (kind, frame, time) = match moment {
        ProgramValue::Event(event) => return Some(event.clone()),
        ProgramValue::Time(time) => (SceneEventKind::Stop, scene.frame_at(*time), *time),
        ProgramValue::Frame(Some(frame)) => (SceneEventKind::In, *frame, scene.time_of(*frame)),
        ProgramValue::Factor(frame) => (SceneEventKind::In, *frame as usize, scene.time_of(*frame as usize)),
        _ => return None,
    };
    Some(SceneEvent { kind, frame, time, objects: vec![] })
}

/// Events before or after a limit; without one all.
pub fn filter_time(events: &[SceneEvent], limit: Option<&SceneEvent>, after: bool) -> Vec<SceneEvent> {
    let fits = |e: &&SceneEvent| {
        limit.is_none_or(|limit| if after { limit.is_before(e) } else { e.is_before(limit) })
    };
    events.iter().filter(fits).cloned().collect()
}

/// The event at this place in time; `usize::MAX` is the last.
pub fn order(events: &[SceneEvent], place: usize) -> Option<SceneEvent> {
    let mut sorted: Vec<&SceneEvent> = events.iter().collect();
    sorted.sort_by(|a, b| a.time.total_cmp(&b.time));
    if place == usize::MAX { sorted.last() } else { sorted.get(place) }.map(|e| (*e).clone())
}

/// The causes of an event: earlier events of its participants, and their causes; not the event itself.
pub fn ancestors(events: &[SceneEvent], of: &SceneEvent) -> Vec<SceneEvent> {
    let mut found: Vec<SceneEvent> = vec![];
    let mut open = vec![of.clone()];
    while let Some(event) = open.pop() {
        for earlier in events.iter().filter(|e| e.is_before(&event)) {
            if earlier.objects.iter().any(|o| event.objects.contains(o)) && !found.contains(earlier) {
                found.push(earlier.clone());
                open.push(earlier.clone());
            }
        }
    }
    found.sort_by(|a, b| a.time.total_cmp(&b.time));
    found
}

pub fn has_object(events: &[SceneEvent], object: usize) -> bool {
    events.iter().any(|e| e.objects.contains(&object))
}

pub fn has_event(events: &[SceneEvent], event: &SceneEvent) -> bool {
    events.iter().any(|e| e.is_like(event))
}

/// The events that others lack.
pub fn lacking(others: &[SceneEvent], events: &[SceneEvent]) -> Vec<SceneEvent> {
    events.iter().filter(|e| !has_event(others, e)).cloned().collect()
}

/// The only object; for none or several, an error that names the candidates.
pub fn unique_object(scene: &Scene, objects: &[usize], phrase_asked: &str) -> Result<usize, ReasonError> {
    let names = |of: &[usize]| of.iter().map(|i| name(scene, *i)).collect();
    let phrase = phrase_asked.to_string();
    match objects {
        [one] => Ok(*one),
        [] => Err(ReasonError::NoSuchObject { phrase, candidates: names(&all(scene)) }),
        several => Err(ReasonError::AmbiguousObject { phrase, candidates: names(several) }),
    }
}

/// The only object that the video does not show and that all these words describe.
pub fn absent<'a>(scene: &'a Scene, words: &[String]) -> Option<&'a Object> {
    let describes =
        |o: &Object, word: &String| [o.color.as_str(), &o.material, o.shape.word()].contains(&word.as_str());
    let mut fitting = scene.absent.iter().filter(|o| words.iter().all(|w| describes(o, w)));
    fitting.next().filter(|_| !words.is_empty() && fitting.next().is_none())
}

/// Why nothing is known of an object that the video does not show.
pub fn not_shown(object: &Object) -> Halt {
    Halt::Undetermined(format!("no frame of the video shows {}: it has not entered", phrase(object)))
}

/// The first of the objects, as a pattern for another one.
pub fn first_object(scene: &Scene, objects: &[usize], phrase_asked: &str) -> Result<usize, ReasonError> {
    objects.first().map_or_else(|| unique_object(scene, &[], phrase_asked), |first| Ok(*first))
}

/// Adds a body like the first one, at rest, at the offset `by` (m) from the start of the second one.
pub fn another(bodies: &[BodySpec], [like, beside]: [u32; 2], by: Vec2) -> Result<Intervention, ReasonError> {
    let find = |id: u32| {
        let known = || bodies.iter().map(|b| b.id).collect();
        bodies
            .iter()
            .find(|b| b.id == id)
            .ok_or_else(|| InterventionError::UnknownObject { id, known: known() })
    };
    let (like, beside) = (find(like)?, find(beside)?);
    let state = State { position: beside.start.state.position + by, ..State::default() };
    let start = Start { time: 0.0, state, rolling: false };
    let id = bodies.iter().map(|b| b.id).max().map_or(0, |id| id.saturating_add(1));
    Ok(Intervention::Add { body: BodySpec { id, start, ..like.clone() } })
}

/// The only event; of several alike the first. None gives [`SceneEventKind::Never`].
pub fn unique_event(events: &[SceneEvent]) -> Result<SceneEvent, ReasonError> {
    match events {
        [] => Ok(SceneEvent { kind: SceneEventKind::Never, frame: 0, time: 0.0, objects: vec![] }),
        [first, rest @ ..] if rest.iter().all(|e| e.is_like(first)) => Ok(first.clone()),
        several => Err(ReasonError::NoSingleEvent { found: format!("{} of them", several.len()) }),
    }
}

/// The other object of a collision or an approach in which the object takes part.
pub fn partner(event: &SceneEvent, object: usize) -> Result<usize, ReasonError> {
    let kinds = [SceneEventKind::Collision, SceneEventKind::Approach];
    let is_pair = kinds.contains(&event.kind) && event.objects.contains(&object);
    let other = event.objects.iter().find(|o| is_pair && **o != object).copied();
    other.ok_or_else(|| ReasonError::NoSingleEvent { found: "none of this object".to_string() })
}

/// The scene's id of an object.
pub fn id(scene: &Scene, object: usize) -> Result<u32, ReasonError> {
    let found = scene.objects.get(object).ok_or_else(|| ReasonError::NoSuchObject {
        phrase: format!("object {object}"),
        candidates: scene.objects.iter().map(phrase).collect(),
    })?;
    Ok(found.id)
}

/// The vector of this length (m) towards a side: x to the right, y to the top.
pub fn towards(side: &str, length: f64) -> Vec2 {
    match side {
        "left" => vec2(-length, 0.0),
        "right" => vec2(length, 0.0),
        "top" => vec2(0.0, length),
        _ => vec2(0.0, -length),
    }
}

/// Switches off the effects of the model that together are the friction of the ground, that between objects, or drag.
pub fn switch_off(effects: &[String], law: &str) -> Result<Vec<Intervention>, ReasonError> {
    let called = |name: &&String| effect(name).is_some_and(|e| e.profile.common_name == Some(law));
    let off = effects.iter().filter(called);
    let off: Vec<Intervention> =
        off.map(|name| Intervention::SwitchEffect { name: name.clone(), on: false }).collect();
    if off.is_empty() {
        let (name, known) = (law.to_string(), effects.to_vec());
        return Err(InterventionError::UnknownEffect { name, known }.into());
    }
    Ok(off)
}

/// The changes without repetition: a removed object is removed once and not changed besides; factors of one object multiply.
pub fn joined_changes(changes: Vec<Intervention>) -> Vec<Intervention> {
    let removed: Vec<u32> = changes
        .iter()
        .filter_map(|c| if let Intervention::Remove { id } = c { Some(*id) } else { None })
        .collect();
    let mut joined: Vec<Intervention> = vec![];
    for change in changes {
        let is_removal = matches!(change, Intervention::Remove { .. });
        if joined.contains(&change) && (is_removal || matches!(change, Intervention::SwitchEffect { .. })) {
            continue;
        }
        if !is_removal && change.object().is_some_and(|id| removed.contains(&id)) {
            continue;
        }
        match &change {
            Intervention::ScaleMass { id, factor } => {
                let same =
                    |c: &&mut Intervention| matches!(c, Intervention::ScaleMass { id: i, .. } if i == id);
                match joined.iter_mut().find(same) {
                    Some(Intervention::ScaleMass { factor: before, .. }) => *before *= factor,
                    _ => joined.push(change),
                }
            }
            _ => joined.push(change),
        }
    }
    joined
}
