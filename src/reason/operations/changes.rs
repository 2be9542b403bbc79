//! The operations that change the model, and those that simulate the change.

use super::machine::{Machine, Outcome};
use super::ops;
use crate::reason::ReasonError;
use crate::reason::context::Halt;
use crate::reason::value::ProgramValue::*;
use crate::reason::value::SpanKind;
use crate::reason::words::{ChangeWord, ChangedQuantity};
use crate::world::Intervention;

/// Multiplies a mass, a velocity, a restitution or a friction; on a change: of the object changed last, beside it.
pub fn scale(m: &mut Machine) -> Outcome {
    let token = m.token();
    let factor = match token {
        "apply_heavier" => ops::HEAVIER,
        "apply_lighter" => ops::LIGHTER,
        "at_rest" => 0.0,
        "reverse" => -1.0,
        _ => m.factor()?,
    };
    let quantity = match token {
        "apply_heavier" | "apply_lighter" | "scale_mass" => ChangedQuantity::Mass,
        "scale_restitution" => ChangedQuantity::Restitution,
        "scale_friction" => ChangedQuantity::Friction,
        _ => ChangedQuantity::Velocity,
    };
    multiplied(m, quantity, factor)
}

/// What the target of a change has, so many times.
fn multiplied(m: &mut Machine, quantity: ChangedQuantity, factor: f64) -> Outcome {
    let (mut changes, id) = target(m)?;
    changes.push(match quantity {
        ChangedQuantity::Mass => Intervention::ScaleMass { id, factor },
        ChangedQuantity::Velocity => Intervention::ScaleVelocity { id, factor },
        ChangedQuantity::Friction => Intervention::ScaleFriction { id, factor },
        ChangedQuantity::Restitution => Intervention::ScaleRestitution { id, factor },
    });
    Ok(Change(ops::joined_changes(changes)))
}

/// The changes so far, and the object that the next one is about.
fn target(m: &mut Machine) -> Result<(Vec<Intervention>, u32), Halt> {
    match m.pop()? {
        Object(object) => Ok((vec![], ops::id(m.context.scene, object)?)),
        Change(changes) => match changes.last().and_then(Intervention::object) {
            Some(id) => Ok((changes, id)),
            None => Err(m.mismatch()),
        },
        _ => Err(m.mismatch()),
    }
}

/// The change that a word of the lexicon stands for; on a change: of the object changed last, beside it.
pub fn apply_word(m: &mut Machine) -> Outcome {
    let name = m.word()?;
    let Some(change) = m.context.words.and_then(|w| w.change(&name)) else {
        let words = m.context.words.map_or(&[][..], |w| &w.words.changes);
        let known = words.iter().map(|c| c.name.clone()).collect();
        return Err(ReasonError::UnknownWord { word: name, known }.into());
    };
    let ChangeWord { quantity, factor, .. } = *change;
    multiplied(m, quantity, factor)
}

pub fn remove(m: &mut Machine) -> Outcome {
    Ok(Change(m.changes()?))
}

pub fn shift(m: &mut Machine) -> Outcome {
    let by = ops::towards(&m.word()?, m.factor()?);
    let (mut changes, id) = target(m)?;
    changes.push(Intervention::Shift { id, by });
    Ok(Change(changes))
}

pub fn add_another(m: &mut Machine) -> Outcome {
    let by = ops::towards(&m.word()?, m.factor()?);
    let (beside, alike) = (m.object()?, m.objects()?);
    let scene = m.context.scene;
    let alike = ops::first_object(scene, &alike, "the object to be another of")?;
    let ids = [ops::id(scene, alike)?, ops::id(scene, beside)?];
    Ok(Change(vec![ops::another(m.context.bodies, ids, by)?]))
}

pub fn switch_off(m: &mut Machine) -> Outcome {
    Ok(Change(ops::switch_off(m.context.effects, &m.word()?)?))
}

pub fn both(m: &mut Machine) -> Outcome {
    let second = m.changes()?;
    let first = m.changes()?;
    Ok(Change(ops::joined_changes([first, second].concat())))
}

/// All changes on top of the stack.
fn all_changes(m: &mut Machine) -> Result<Vec<Intervention>, Halt> {
    let mut changes = m.changes()?;
    while matches!(m.stack.last(), Some(Change(_))) {
        changes = [m.changes()?, changes].concat();
    }
    Ok(ops::joined_changes(changes))
}

/// The events under a change, in the video, as CLEVRER's questions ask.
pub fn counterfact(m: &mut Machine) -> Outcome {
    let changes = all_changes(m)?;
    if matches!(m.stack.last(), Some(Events(_))) {
        m.stack.pop();
    }
    Ok(Events(m.context.events(&changes, SpanKind::Video)?))
}

/// All that follows is under the change.
pub fn suppose(m: &mut Machine) -> Outcome {
    m.supposed = all_changes(m)?;
    Ok(Frame(None))
}

/// All that follows is without a change.
pub fn actual(m: &mut Machine) -> Outcome {
    m.supposed.clear();
    Ok(Frame(None))
}
