//! One operation of a program: pops its operands and returns its result.

use super::ReasonError;
use super::context::{Halt, RolloutContext};
use super::events::{SceneEvent, SceneEventKind};
use super::ops;
use super::program::Op;
use super::value::{Operands, ProgramValue};
use crate::scene::Object;
use crate::world::Intervention;

/// The result of an operation. `words`: the describing words since the last `objects`, for messages.
pub(super) fn step(
    op: Op,
    context: RolloutContext,
    stack: &mut Vec<ProgramValue>,
    words: &[&str],
) -> Result<ProgramValue, Halt> {
    use ProgramValue::*;
    let scene = context.scene;
    let mut operands = Operands { op, stack };
    Ok(match op {
        Op::Objects => Objects(ops::all(scene)),
        Op::Events => Events(context.events(&[], false)?),
        Op::UnseenEvents => Events(context.events(&[], true)?),
        Op::AllEvents => Events(ops::conceivable(scene)),
        Op::Start => Event(ops::edge(scene, SceneEventKind::Start)),
        Op::End => Event(ops::edge(scene, SceneEventKind::End)),
        Op::Null => Frame(None),
        Op::Color(word) | Op::Material(word) | Op::Shape(word) | Op::Side(word) | Op::Law(word) => Word(word),
        Op::Factor(factor) => Factor(factor),
        Op::Order(place) => Order(place),
        Op::Unique => match operands.pop()? {
            Objects(objects) => Object(ops::unique_object(scene, &objects, &words.join(" "))?),
            Events(events) => Event(ops::unique_event(&events)?),
            _ => return Err(operands.mismatch()),
        },
        Op::Count => Number(operands.count()?),
        Op::Exist => Bool(operands.count()? > 0),
        Op::Negate => Bool(!operands.bool()?),
        Op::BelongTo => {
            let events = operands.events()?;
            match operands.pop()? {
                Event(event) => Bool(ops::has_event(&events, &event)),
                Object(object) => Bool(ops::has_object(&events, object)),
                _ => return Err(operands.mismatch()),
            }
        }
        Op::GetFrame => Frame(Some(require_event(operands.event()?)?.frame)),
        Op::GetObject => match operands.event()?.objects[..] {
            [one] => Object(one),
            _ => return Err(ReasonError::NoSingleEvent { found: "none of one object".into() }.into()),
        },
        Op::GetPartner => {
            let object = operands.object()?;
            Object(ops::partner(&operands.event()?, object)?)
        }
        Op::QueryColor | Op::QueryMaterial | Op::QueryShape => match scene.objects.get(operands.object()?) {
            Some(object) => Text(attribute(op)(object).to_string()),
            None => return Err(operands.mismatch()),
        },
        Op::Counterfact => {
            let changes = changes(context, &mut operands)?;
            if matches!(operands.stack.last(), Some(Events(_))) {
                operands.stack.pop();
            }
            Events(context.events(&changes, false)?)
        }
        Op::ApplyHeavier | Op::ApplyLighter | Op::AtRest | Op::Reverse => {
            Change(scale(context, &mut operands)?)
        }
        Op::ScaleMass | Op::ScaleVelocity | Op::ScaleRestitution => Change(scale(context, &mut operands)?),
        Op::Shift | Op::AddAnother | Op::SwitchOff | Op::Both => Change(edit(context, &mut operands)?),
        _ => filter(context, &mut operands)?,
    })
}

/// The operations that select objects or events.
fn filter(context: RolloutContext, operands: &mut Operands) -> Result<ProgramValue, Halt> {
    use ProgramValue::*;
    let (op, scene) = (operands.op, context.scene);
    Ok(match op {
        Op::FilterColor | Op::FilterMaterial | Op::FilterShape => {
            let word = operands.word()?;
            Objects(ops::filter_word(scene, &operands.objects()?, attribute(op), word))
        }
        Op::FilterMoving | Op::FilterStationary => {
            let frame = match operands.pop()? {
                Frame(frame) => frame,
                Event(event) => Some(event.frame),
                _ => return Err(operands.mismatch()),
            };
            let objects = operands.objects()?;
            Objects(ops::filter_motion(context.rollout(&[])?, &objects, frame, op == Op::FilterMoving))
        }
        Op::FilterIn | Op::FilterOut | Op::FilterCollision | Op::FilterSide => {
            let kind = match op {
                Op::FilterIn => SceneEventKind::In,
                Op::FilterOut => SceneEventKind::Out,
                Op::FilterSide => SceneEventKind::Side(operands.word()?),
                _ => SceneEventKind::Collision,
            };
            let objects = operands.any_objects()?;
            Events(ops::filter_kind(&operands.events()?, kind, &objects))
        }
        Op::FilterPartner => {
            let (partners, object) = (operands.objects()?, operands.object()?);
            Events(ops::filter_partner(&operands.events()?, object, &partners))
        }
        Op::FilterBefore | Op::FilterAfter => {
            let frame = match operands.pop()? {
                Event(event) => Some(require_event(event)?.frame),
                Frame(frame) => frame,
                _ => return Err(operands.mismatch()),
            };
            Events(ops::filter_time(&operands.events()?, frame, op == Op::FilterAfter))
        }
        Op::FilterStart | Op::FilterEnd => {
            operands.events()?;
            let is_start = op == Op::FilterStart;
            Event(ops::edge(scene, if is_start { SceneEventKind::Start } else { SceneEventKind::End }))
        }
        Op::FilterOrder => {
            let place = operands.order()?;
            let events = operands.events()?;
            let none = || ReasonError::NoSingleEvent { found: format!("{} of them", events.len()) };
            Event(ops::order(&events, place).ok_or_else(none)?)
        }
        Op::FilterAncestor => {
            let event = operands.event()?;
            Events(ops::ancestors(&operands.events()?, &require_event(event)?))
        }
        _ => return Err(operands.mismatch()),
    })
}

/// The operations that multiply a mass, a velocity or a restitution.
fn scale(context: RolloutContext, operands: &mut Operands) -> Result<Vec<Intervention>, Halt> {
    let factor = match operands.op {
        Op::ApplyHeavier => ops::HEAVIER,
        Op::ApplyLighter => ops::LIGHTER,
        Op::AtRest => 0.0,
        Op::Reverse => -1.0,
        _ => operands.factor()?,
    };
    let id = ops::id(context.scene, operands.object()?)?;
    Ok(vec![match operands.op {
        Op::ApplyHeavier | Op::ApplyLighter | Op::ScaleMass => Intervention::ScaleMass { id, factor },
        Op::ScaleRestitution => Intervention::ScaleRestitution { id, factor },
        _ => Intervention::ScaleVelocity { id, factor },
    }])
}

/// The operations that move or add an object, switch off a law, or join two changes.
fn edit(context: RolloutContext, operands: &mut Operands) -> Result<Vec<Intervention>, Halt> {
    let scene = context.scene;
    match operands.op {
        Op::Shift => {
            let by = ops::towards(operands.word()?, operands.factor()?);
            Ok(vec![Intervention::Shift { id: ops::id(scene, operands.object()?)?, by }])
        }
        Op::AddAnother => {
            let by = ops::towards(operands.word()?, operands.factor()?);
            let (beside, alike) = (operands.object()?, operands.objects()?);
            let alike = ops::first_object(scene, &alike, "the object to be another of")?;
            let ids = [ops::id(scene, alike)?, ops::id(scene, beside)?];
            Ok(vec![ops::another(context.bodies, ids, by)?])
        }
        Op::SwitchOff => Ok(ops::switch_off(context.effects, operands.word()?)?),
        Op::Both => {
            let second = changes(context, operands)?;
            let first = changes(context, operands)?;
            Ok([first, second].concat())
        }
        _ => Err(operands.mismatch()),
    }
}

/// A change, or the removal of an object that stands by itself.
fn changes(context: RolloutContext, operands: &mut Operands) -> Result<Vec<Intervention>, Halt> {
    match operands.pop()? {
        ProgramValue::Object(object) => {
            Ok(vec![Intervention::Remove { id: ops::id(context.scene, object)? }])
        }
        ProgramValue::Change(changes) => Ok(changes),
        _ => Err(operands.mismatch()),
    }
}

/// An event that happened: one that did not has no time and no causes.
fn require_event(event: SceneEvent) -> Result<SceneEvent, ReasonError> {
    match event.kind {
        SceneEventKind::Never => Err(ReasonError::NoSingleEvent { found: "none".into() }),
        _ => Ok(event),
    }
}

/// The attribute that an operation filters by or asks for.
fn attribute(op: Op) -> fn(&Object) -> &str {
    match op {
        Op::FilterColor | Op::QueryColor => |o| &o.color,
        Op::FilterMaterial | Op::QueryMaterial => |o| &o.material,
        _ => |o| o.shape.word(),
    }
}
