//! Interventions: changes of a model for a counterfactual simulation.

use crate::effects::Scope;
use crate::num::Vec2;
use crate::world::model::{BodySpec, Model};
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
    #[error("{what} is {value}; it must be finite{more}")]
    BadValue { what: &'static str, value: f64, more: &'static str },
    #[error("effect {name} is not in the model; it has {known:?}")]
    UnknownEffect { name: String, known: Vec<String> },
}

impl Intervention {
    /// The changed model.
    ///
    /// # Errors
    /// The object or effect is not in the model, an added id is in use, or a value is not finite or out of range.
    pub fn apply(&self, model: &Model) -> Result<Model, InterventionError> {
        let mut edited = model.clone();
        let find = |id: u32| {
            model.bodies.iter().position(|b| b.id == id).ok_or_else(|| InterventionError::UnknownObject {
                id,
                known: model.bodies.iter().map(|b| b.id).collect(),
            })
        };
        let known = || model.effects.iter().map(|e| e.name.clone()).collect();
        match self {
            Intervention::Remove { id } => edited.remove_body(find(*id)?),
            Intervention::ScaleMass { id, factor } => {
                if !(factor.is_finite() && *factor > 0.0) {
                    return Err(InterventionError::BadValue {
                        what: "mass factor",
                        value: *factor,
                        more: " and positive",
                    });
                }
                edited.bodies[find(*id)?].mass *= factor;
            }
            Intervention::ScaleRestitution { id, factor } => {
                find(*id)?;
                if !(factor.is_finite() && *factor >= 0.0) {
                    return Err(InterventionError::BadValue {
                        what: "restitution factor",
                        value: *factor,
                        more: " and at least 0",
                    });
                }
                let own = edited.effects.iter_mut().filter(|e| e.on && e.name == "restitution");
                let own = own.flat_map(|e| &mut e.parameters).find(|p| p.scope == Scope::Object);
                let value = own.and_then(|p| {
                    let at = p.labels.binary_search(&id.to_string()).ok()?;
                    p.values.get_mut(at)
                });
                *value.ok_or_else(|| InterventionError::UnknownEffect {
                    name: "restitution".to_string(),
                    known: known(),
                })? *= factor;
            }
            Intervention::SetVelocity { id, velocity } => {
                finite("velocity", velocity.x)?;
                finite("velocity", velocity.y)?;
                edited.bodies[find(*id)?].set_velocity(*velocity);
            }
            Intervention::ScaleVelocity { id, factor } => {
                finite("velocity factor", *factor)?;
                let start = &mut edited.bodies[find(*id)?].start.state;
                start.velocity = start.velocity * *factor;
                start.roll = start.roll * *factor;
                start.spin *= factor;
            }
            Intervention::Place { id, position, yaw } => {
                let start = &mut edited.bodies[find(*id)?].start;
                finite("position", position.x)?;
                finite("position", position.y)?;
                start.state.position = *position;
                if let Some(yaw) = yaw {
                    finite("yaw", *yaw)?;
                    start.state.yaw = *yaw;
                }
            }
            Intervention::Shift { id, by } => {
                finite("shift", by.x)?;
                finite("shift", by.y)?;
                edited.bodies[find(*id)?].start.state.position += *by;
            }
            Intervention::Add { body } => {
                if find(body.id).is_ok() {
                    return Err(InterventionError::DuplicateObject { id: body.id });
                }
                edited.add_body(body.clone());
            }
            Intervention::SwitchEffect { name, on } => {
                match edited.effects.iter_mut().find(|e| e.name == *name) {
                    Some(effect) => effect.on = *on,
                    None => {
                        return Err(InterventionError::UnknownEffect { name: name.clone(), known: known() });
                    }
                }
            }
        }
        Ok(edited)
    }

    /// The object that it changes, if it changes one.
    pub fn object(&self) -> Option<u32> {
        match self {
            Intervention::Remove { id }
            | Intervention::ScaleMass { id, .. }
            | Intervention::ScaleRestitution { id, .. }
            | Intervention::SetVelocity { id, .. }
            | Intervention::ScaleVelocity { id, .. }
            | Intervention::Shift { id, .. }
            | Intervention::Place { id, .. } => Some(*id),
            Intervention::Add { body } => Some(body.id),
            Intervention::SwitchEffect { .. } => None,
        }
    }
}

fn finite(what: &'static str, value: f64) -> Result<(), InterventionError> {
    if value.is_finite() { Ok(()) } else { Err(InterventionError::BadValue { what, value, more: "" }) }
}
