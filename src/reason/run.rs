//! Runs a program against the context of one rollout and keeps the derivation of its steps.

use super::ReasonError;
use super::events::{Kind, Past, SceneEvent, World};
use super::ops;
use super::program::{Op, QuestionProgram};
use crate::scene::Scene;
use crate::world::{BodySpec, Intervention};
use serde::{Deserialize, Serialize};

/// One step of a program: its token and what came of it, in words.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DerivationStep {
    pub token: String,
    pub result: String,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    Objects(Vec<usize>),
    Object(usize),
    Events(Vec<SceneEvent>),
    Event(SceneEvent),
    Frame(Option<usize>),
    Word(&'static str),
    Order(usize),
    Factor(f64),
    Change(Vec<Intervention>),
    Text(String),
    Number(usize),
    Bool(bool),
}

/// Why a run ended early.
#[derive(Debug, Clone, PartialEq)]
pub enum Halt {
    /// It asks for a world that has not been simulated.
    NeedsSimulation(Vec<Intervention>),
    Error(ReasonError),
}

impl From<ReasonError> for Halt {
    fn from(error: ReasonError) -> Self {
        Halt::Error(error)
    }
}

/// What a program is run against: a scene and one rollout of each simulated world.
#[derive(Clone, Copy)]
pub struct RolloutContext<'a> {
    pub scene: &'a Scene,
    /// Of the fitted model.
    pub bodies: &'a [BodySpec],
    /// Effects that are on in it.
    pub effects: &'a [String],
    pub worlds: &'a [World],
    pub rollout: usize,
}

impl RolloutContext<'_> {
    fn past(&self, interventions: &[Intervention]) -> Result<&Past, Halt> {
        let world = self.worlds.iter().find(|w| w.interventions == interventions);
        world
            .and_then(|w| w.rollouts.get(self.rollout))
            .ok_or_else(|| Halt::NeedsSimulation(interventions.to_vec()))
    }

    /// Events of a world, those of the video or those after it.
    fn events(&self, interventions: &[Intervention], after: bool) -> Result<Vec<SceneEvent>, Halt> {
        let end = self.scene.times.len();
        let events = self.past(interventions)?.events.iter();
        Ok(events.filter(|e| (e.frame >= end) == after).cloned().collect())
    }
}

/// Runs a checked program on top of `stack`; with its derivation on the best rollout.
pub fn run(
    program: &QuestionProgram,
    context: RolloutContext,
    mut stack: Vec<Value>,
) -> Result<(Vec<Value>, Vec<DerivationStep>), Halt> {
    let mut derivation = vec![];
    let mut words: Vec<&str> = vec![];
    for (op, token) in program.ops.iter().zip(&program.tokens) {
        match op {
            Op::Objects => words.clear(),
            Op::Color(w) | Op::Material(w) | Op::Shape(w) => words.push(w),
            _ => {}
        }
        let value = step(*op, context, &mut stack, &words)?;
        // Only the best rollout's derivation is told, and telling costs more than the step.
        if context.rollout == 0 {
            derivation.push(DerivationStep { token: token.clone(), result: describe(context.scene, &value) });
        }
        stack.push(value);
    }
    Ok((stack, derivation))
}

/// The type check makes this unreachable from outside.
fn untyped(op: Op) -> Halt {
    let expected = "a checked program";
    Halt::Error(ReasonError::ProgramResult { expected, found: format!("{op:?} on a wrong value") })
}

fn step(op: Op, context: RolloutContext, stack: &mut Vec<Value>, words: &[&str]) -> Result<Value, Halt> {
    use Value::*;
    let scene = context.scene;
    // An object by itself stands for its removal.
    let changes = |value| match value {
        Object(object) => Ok(vec![Intervention::Remove { id: ops::id(scene, object)? }]),
        Change(changes) => Ok(changes),
        _ => Err(untyped(op)),
    };
    let mut pop = || stack.pop().ok_or_else(|| untyped(op));
    Ok(match op {
        Op::Objects => Objects(ops::all(scene)),
        Op::Events => Events(context.events(&[], false)?),
        Op::UnseenEvents => Events(context.events(&[], true)?),
        Op::AllEvents => Events(ops::conceivable(scene)),
        Op::Start => Event(ops::edge(scene, Kind::Start)),
        Op::End => Event(ops::edge(scene, Kind::End)),
        Op::Null => Frame(None),
        Op::Color(word) | Op::Material(word) | Op::Shape(word) | Op::Side(word) | Op::Law(word) => Word(word),
        Op::Factor(factor) => Factor(factor),
        Op::Order(place) => Order(place),
        Op::Unique => match pop()? {
            Objects(objects) => Object(ops::unique_object(scene, &objects, &words.join(" "))?),
            Events(events) => Event(ops::unique_event(&events)?),
            _ => return Err(untyped(op)),
        },
        Op::Count | Op::Exist => {
            let count = match pop()? {
                Objects(objects) => objects.len(),
                Events(events) => events.len(),
                _ => return Err(untyped(op)),
            };
            if op == Op::Count { Number(count) } else { Bool(count > 0) }
        }
        Op::Negate => match pop()? {
            Bool(b) => Bool(!b),
            _ => return Err(untyped(op)),
        },
        Op::BelongTo => match (pop()?, pop()?) {
            (Events(events), Event(event)) => Bool(ops::has_event(&events, &event)),
            (Events(events), Object(object)) => Bool(ops::has_object(&events, object)),
            _ => return Err(untyped(op)),
        },
        Op::FilterColor | Op::FilterMaterial | Op::FilterShape => match (pop()?, pop()?) {
            (Word(word), Objects(objects)) => Objects(ops::filter_word(scene, &objects, attribute(op), word)),
            _ => return Err(untyped(op)),
        },
        Op::FilterMoving | Op::FilterStationary => {
            let frame = match pop()? {
                Frame(frame) => frame,
                Event(event) => Some(event.frame),
                _ => return Err(untyped(op)),
            };
            match pop()? {
                Objects(objects) => {
                    Objects(ops::filter_motion(context.past(&[])?, &objects, frame, op == Op::FilterMoving))
                }
                _ => return Err(untyped(op)),
            }
        }
        Op::FilterIn | Op::FilterOut | Op::FilterCollision | Op::FilterSide => {
            let side = match op {
                Op::FilterSide => Some(pop()?),
                _ => None,
            };
            let objects = match pop()? {
                Objects(objects) => objects,
                Object(object) => vec![object],
                _ => return Err(untyped(op)),
            };
            let kind = match (op, side) {
                (Op::FilterIn, _) => Kind::In,
                (Op::FilterOut, _) => Kind::Out,
                (_, Some(Word(side))) => Kind::Side(side),
                _ => Kind::Collision,
            };
            match pop()? {
                Events(events) => Events(ops::filter_kind(&events, kind, &objects)),
                _ => return Err(untyped(op)),
            }
        }
        Op::FilterPartner => match (pop()?, pop()?, pop()?) {
            (Objects(partners), Object(object), Events(events)) => {
                Events(ops::filter_partner(&events, object, &partners))
            }
            _ => return Err(untyped(op)),
        },
        Op::FilterBefore | Op::FilterAfter => {
            let frame = match pop()? {
                Event(event) => Some(happened(event)?.frame),
                Frame(frame) => frame,
                _ => return Err(untyped(op)),
            };
            match pop()? {
                Events(events) => Events(ops::filter_time(&events, frame, op == Op::FilterAfter)),
                _ => return Err(untyped(op)),
            }
        }
        Op::FilterStart | Op::FilterEnd => {
            pop()?;
            Event(ops::edge(scene, if op == Op::FilterStart { Kind::Start } else { Kind::End }))
        }
        Op::FilterOrder => match (pop()?, pop()?) {
            (Order(place), Events(events)) => {
                let none = || ReasonError::NoSingleEvent { found: format!("{} of them", events.len()) };
                Event(ops::order(&events, place).ok_or_else(none)?)
            }
            _ => return Err(untyped(op)),
        },
        Op::FilterAncestor => match (pop()?, pop()?) {
            (Event(event), Events(events)) => Events(ops::ancestors(&events, &happened(event)?)),
            _ => return Err(untyped(op)),
        },
        Op::GetFrame => match pop()? {
            Event(event) => Frame(Some(happened(event)?.frame)),
            _ => return Err(untyped(op)),
        },
        Op::GetObject => match pop()? {
            Event(e) => match e.objects[..] {
                [one] => Object(one),
                _ => return Err(ReasonError::NoSingleEvent { found: "none of one object".into() }.into()),
            },
            _ => return Err(untyped(op)),
        },
        Op::GetPartner => match (pop()?, pop()?) {
            (Object(object), Event(event)) => Object(ops::partner(&event, object)?),
            _ => return Err(untyped(op)),
        },
        Op::ApplyHeavier | Op::ApplyLighter | Op::AtRest | Op::Reverse => match pop()? {
            Object(object) => {
                let id = ops::id(scene, object)?;
                Change(vec![match op {
                    Op::ApplyHeavier => Intervention::ScaleMass { id, factor: ops::HEAVIER },
                    Op::ApplyLighter => Intervention::ScaleMass { id, factor: ops::LIGHTER },
                    Op::AtRest => Intervention::ScaleVelocity { id, factor: 0.0 },
                    _ => Intervention::ScaleVelocity { id, factor: -1.0 },
                }])
            }
            _ => return Err(untyped(op)),
        },
        Op::ScaleMass | Op::ScaleVelocity | Op::ScaleRestitution => match (pop()?, pop()?) {
            (Factor(factor), Object(object)) => {
                let id = ops::id(scene, object)?;
                Change(vec![match op {
                    Op::ScaleMass => Intervention::ScaleMass { id, factor },
                    Op::ScaleVelocity => Intervention::ScaleVelocity { id, factor },
                    _ => Intervention::ScaleRestitution { id, factor },
                }])
            }
            _ => return Err(untyped(op)),
        },
        Op::Shift => match (pop()?, pop()?, pop()?) {
            (Word(side), Factor(length), Object(object)) => {
                let by = ops::towards(side, length);
                Change(vec![Intervention::Shift { id: ops::id(scene, object)?, by }])
            }
            _ => return Err(untyped(op)),
        },
        Op::AddAnother => match (pop()?, pop()?, pop()?, pop()?) {
            (Word(side), Factor(length), Object(beside), Objects(alike)) => {
                let alike = ops::first_object(scene, &alike, "the object to be another of")?;
                let ids = [ops::id(scene, alike)?, ops::id(scene, beside)?];
                Change(vec![ops::another(context.bodies, ids, ops::towards(side, length))?])
            }
            _ => return Err(untyped(op)),
        },
        Op::SwitchOff => match pop()? {
            Word(law) => Change(ops::switch_off(context.effects, law)?),
            _ => return Err(untyped(op)),
        },
        Op::Both => {
            let (second, first) = (changes(pop()?)?, changes(pop()?)?);
            Change([first, second].concat())
        }
        Op::Counterfact => {
            let changes = changes(pop()?)?;
            if matches!(stack.last(), Some(Events(_))) {
                stack.pop();
            }
            Events(context.events(&changes, false)?)
        }
        Op::QueryColor | Op::QueryMaterial | Op::QueryShape => match pop()? {
            Object(object) => match scene.objects.get(object) {
                Some(object) => Text(attribute(op)(object).to_string()),
                None => return Err(untyped(op)),
            },
            _ => return Err(untyped(op)),
        },
    })
}

/// What never happened has no time and no causes.
fn happened(event: SceneEvent) -> Result<SceneEvent, ReasonError> {
    match event.kind {
        Kind::Never => Err(ReasonError::NoSingleEvent { found: "none".into() }),
        _ => Ok(event),
    }
}

fn attribute(op: Op) -> fn(&crate::scene::Object) -> &str {
    match op {
        Op::FilterColor | Op::QueryColor => |o| &o.color,
        Op::FilterMaterial | Op::QueryMaterial => |o| &o.material,
        _ => |o| o.shape.word(),
    }
}

/// A value in words.
pub fn describe(scene: &Scene, value: &Value) -> String {
    let name = |i: &usize| scene.objects.get(*i).map(ops::phrase).unwrap_or_default();
    let list = |parts: Vec<String>| if parts.is_empty() { "none".to_string() } else { parts.join(", ") };
    match value {
        Value::Objects(objects) => list(objects.iter().map(name).collect()),
        Value::Object(object) => name(object),
        Value::Events(events) if events.len() > 8 => format!("{} events", events.len()),
        Value::Events(events) => list(events.iter().map(|e| describe_event(scene, e)).collect()),
        Value::Event(event) => describe_event(scene, event),
        Value::Frame(None) => "at any time".to_string(),
        Value::Frame(Some(frame)) => format!("frame {frame}"),
        Value::Word(word) => word.to_string(),
        Value::Order(usize::MAX) => "last".to_string(),
        Value::Order(place) => format!("number {}", place + 1),
        Value::Factor(factor) => factor.to_string(),
        Value::Change(changes) => list(changes.iter().map(|change| describe_change(scene, change)).collect()),
        Value::Text(text) => text.clone(),
        Value::Number(number) => number.to_string(),
        Value::Bool(b) => if *b { "yes" } else { "no" }.to_string(),
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
        Kind::Collision => format!("{} collides with {}", name(0), name(1)),
        Kind::In => format!("{} enters the scene", name(0)),
        Kind::Out => format!("{} exits the scene", name(0)),
        Kind::Side(side) => format!("{} collides with the {side} side", name(0)),
        Kind::Start => "the video begins".to_string(),
        Kind::End => "the video ends".to_string(),
        Kind::Never => return "no such event".to_string(),
    };
    if event.frame == 0 { what } else { format!("{what} (frame {})", event.frame) }
}
