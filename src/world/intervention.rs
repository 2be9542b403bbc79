//! Interventions: changes of a model for a counterfactual simulation.

use crate::effects::{ParamRole, Scope, parameter_with};
use crate::num::Vec2;
use crate::world::model::{ActiveEffect, BodySpec, Model};
use serde::{Deserialize, Serialize};

/// A change of the model before it is simulated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Intervention {
    Remove {
        id: u32,
    },
    /// Multiplies the mass.
    ScaleMass {
        id: u32,
        factor: f64,
    },
    /// Multiplies the object's own factor in the restitution of its contacts, if the model has one.
    ScaleRestitution {
        id: u32,
        factor: f64,
    },
    /// Multiplies the friction between the ground and the object, whatever its forms: sliding, rolling, spin.
    ScaleFriction {
        id: u32,
        factor: f64,
    },
    /// Sets the velocity at the body's start (m/s).
    SetVelocity {
        id: u32,
        velocity: Vec2,
    },
    /// Multiplies the velocity and the spin at the body's start; negative: the opposite direction.
    ScaleVelocity {
        id: u32,
        factor: f64,
    },
    /// Sets the position and yaw at the body's start (m, rad).
    Place {
        id: u32,
        position: Vec2,
        yaw: Option<f64>,
    },
    /// Moves the position at the body's start (m).
    Shift {
        id: u32,
        by: Vec2,
    },
    Add {
        body: BodySpec,
    },
    /// Switches an effect of the model off, or on again.
    SwitchEffect {
        name: String,
        on: bool,
    },
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InterventionError {
    #[error("object {id} is not in the model; it has {known:?}")]
    UnknownObject { id: u32, known: Vec<u32> },
    #[error("object {id} is in the model already; give the added object another id")]
    DuplicateObject { id: u32 },
    #[error("{what} is {value:?}; it must be finite{more}")]
    BadValue { what: &'static str, value: f64, more: &'static str },
    #[error("effect {name:?} is not in the model, whose effects are {}", .known.join(", "))]
    UnknownEffect { name: String, known: Vec<String> },
}

/// Factors of a mass: from the lightest to the heaviest object that a scene may have.
pub const FACTORS: [f64; 2] = [1e-9, 1e9];

/// A value out of range is an error that names it.
fn check(
    is_valid: bool,
    what: &'static str,
    value: f64,
    more: &'static str,
) -> Result<(), InterventionError> {
    if is_valid { Ok(()) } else { Err(InterventionError::BadValue { what, value, more }) }
}

fn check_finite(what: &'static str, value: f64) -> Result<(), InterventionError> {
    check(value.is_finite(), what, value, "")
}

fn check_vector(what: &'static str, value: Vec2) -> Result<(), InterventionError> {
    check_finite(what, value.x)?;
    check_finite(what, value.y)
}

fn find_body(model: &mut Model, id: u32) -> Result<&mut BodySpec, InterventionError> {
    let index = find_index(model, id)?;
    Ok(&mut model.bodies[index])
}

fn find_index(model: &Model, id: u32) -> Result<usize, InterventionError> {
    model.body_index(id).ok_or_else(|| InterventionError::UnknownObject {
        id,
        known: model.bodies.iter().map(|b| b.id).collect(),
    })
}

fn unknown_effect(model: &Model, name: &str) -> InterventionError {
    let known = model.effects.iter().map(|e| e.name.clone()).collect();
    InterventionError::UnknownEffect { name: name.to_string(), known }
}

fn scale_restitution(model: &mut Model, id: u32, factor: f64) -> Result<(), InterventionError> {
    find_index(model, id)?;
    check((0.0..=FACTORS[1]).contains(&factor), "restitution factor", factor, ", from 0 to 1e9")?;
    let law = parameter_with(ParamRole::ObjectRestitution).map_or("", |(effect, _)| effect.spec.name);
    let own = model.effects.iter_mut().filter(|e| e.on && e.name == law);
    let own = own.flat_map(|e| &mut e.parameters).find(|p| p.scope == Scope::Object);
    let value = own.and_then(|p| {
        let at = p.labels.binary_search(&id.to_string()).ok()?;
        p.values.get_mut(at)
    });
    match value {
        Some(value) => *value *= factor,
        None => return Err(unknown_effect(model, law)),
    }
    Ok(())
}

fn scale_friction(model: &mut Model, id: u32, factor: f64) -> Result<(), InterventionError> {
    let body = model.bodies[find_index(model, id)?].clone();
    check((0.0..=FACTORS[1]).contains(&factor), "friction factor", factor, ", from 0 to 1e9")?;
    let mut found = false;
    for active in model.effects.iter_mut().filter(|e| e.on) {
        let is_friction =
            |a: &ActiveEffect, k: usize| a.role_of(&a.parameters[k]) == Some(ParamRole::GroundFriction);
        for k in (0..active.parameters.len()).filter(|k| is_friction(active, *k)).collect::<Vec<_>>() {
            let parameter = &mut active.parameters[k];
            parameter.split_by_object(&model.bodies);
            if let Some(at) = parameter.index(&body, &body) {
                parameter.values[at] *= factor;
            }
            found = true;
        }
    }
    if found { Ok(()) } else { Err(unknown_effect(model, "friction")) }
}

impl Intervention {
    /// The changed model.
    ///
    /// # Errors
    /// The object or effect is not in the model, an added id is in use, or a value is not finite or out of range.
    pub fn apply(&self, model: &Model) -> Result<Model, InterventionError> {
        let mut changed = model.clone();
        match self {
            Intervention::Remove { id } => {
                let index = find_index(model, *id)?;
                changed.remove_body(index);
            }
            Intervention::ScaleMass { id, factor } => {
                let [least, most] = FACTORS;
                check((least..=most).contains(factor), "mass factor", *factor, ", from 1e-9 to 1e9")?;
                find_body(&mut changed, *id)?.mass *= factor;
            }
            Intervention::ScaleRestitution { id, factor } => scale_restitution(&mut changed, *id, *factor)?,
            Intervention::ScaleFriction { id, factor } => scale_friction(&mut changed, *id, *factor)?,
            Intervention::SetVelocity { id, velocity } => {
                check_vector("velocity", *velocity)?;
                find_body(&mut changed, *id)?.set_velocity(*velocity);
            }
            Intervention::ScaleVelocity { id, factor } => {
                check(factor.abs() <= FACTORS[1], "velocity factor", *factor, ", from -1e9 to 1e9")?;
                let start = &mut find_body(&mut changed, *id)?.start.state;
                start.velocity = start.velocity * *factor;
                start.roll = start.roll * *factor;
                start.spin *= factor;
            }
            Intervention::Place { id, position, yaw } => {
                let start = &mut find_body(&mut changed, *id)?.start.state;
                check_vector("position", *position)?;
                start.position = *position;
                if let Some(yaw) = yaw {
                    check_finite("yaw", *yaw)?;
                    start.yaw = *yaw;
                }
            }
            Intervention::Shift { id, by } => {
                check_vector("shift", *by)?;
                find_body(&mut changed, *id)?.start.state.position += *by;
            }
            Intervention::Add { body } => {
                if model.body_index(body.id).is_some() {
                    return Err(InterventionError::DuplicateObject { id: body.id });
                }
                changed.add_body(body.clone());
            }
            Intervention::SwitchEffect { name, on } => {
                match changed.effects.iter_mut().find(|e| e.name == *name) {
                    Some(effect) => effect.on = *on,
                    None => return Err(unknown_effect(model, name)),
                }
            }
        }
        Ok(changed)
    }

    /// The object that it changes, if it changes one.
    pub fn object(&self) -> Option<u32> {
        match self {
            Intervention::Remove { id }
            | Intervention::ScaleMass { id, .. }
            | Intervention::ScaleRestitution { id, .. }
            | Intervention::ScaleFriction { id, .. }
            | Intervention::SetVelocity { id, .. }
            | Intervention::ScaleVelocity { id, .. }
            | Intervention::Shift { id, .. }
            | Intervention::Place { id, .. } => Some(*id),
            Intervention::Add { body } => Some(body.id),
            Intervention::SwitchEffect { .. } => None,
        }
    }
}
