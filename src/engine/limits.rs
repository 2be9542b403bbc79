//! Limits of requests and replies: sizes, edits that fit the model, finite numbers.

use super::error::EngineError;
use crate::reason::{MAX_SIMULATED_FRAMES, Prediction};
use crate::scene::{MASS_RANGE, Scene};
use crate::world::{Intervention, InterventionError, Model, trace};

/// Most rollouts of one request: the standard error of a probability is below 2 % by then.
pub const MAX_ROLLOUTS: usize = 1000;
/// Most object states in one reply: about 16 MB on the wire.
pub const MAX_REPLY_STATES: usize = 200_000;
/// Most object states over all rollouts of a request: about 300 MB in memory.
pub const MAX_ROLLOUT_STATES: usize = 4_000_000;
/// Most replays at a time: each has a thread of its own.
pub const MAX_REPLAYS: usize = 32;
/// Most videos of one study or joint fit: they are fitted together.
pub const MAX_STUDY_VIDEOS: usize = 32;
/// Fastest start of an object (m/s): it leaves any table at once, and its square is far from overflow.
pub const MAX_SPEED: f64 = 1e4;
/// Two objects overlap if their centres are closer than this share of the sum of their inscribed radii. It is below 1
/// so that objects may be placed in contact.
const MIN_SEPARATION: f64 = 0.98;

/// Refuses more frames or rollouts than a reply and the memory hold.
pub fn size(scene: &Scene, frames: usize, rollouts: usize) -> Result<(), EngineError> {
    let objects = scene.objects.len();
    if frames == 0 || frames > MAX_SIMULATED_FRAMES {
        let message = format!("is {frames}; must be 1 to {MAX_SIMULATED_FRAMES}");
        return Err(EngineError::invalid("frames", message));
    }
    if frames * objects > MAX_REPLY_STATES {
        let most = MAX_REPLY_STATES / objects;
        return Err(EngineError::invalid("frames", format!("is {frames}; {objects} objects allow {most}")));
    }
    self::rollouts(scene, frames, rollouts)
}

/// Refuses more rollouts than the memory holds.
pub fn rollouts(scene: &Scene, frames: usize, rollouts: usize) -> Result<(), EngineError> {
    let most = (MAX_ROLLOUT_STATES / (frames * scene.objects.len()).max(1)).min(MAX_ROLLOUTS);
    if rollouts > most {
        return Err(EngineError::invalid("rollouts", format!("is {rollouts}; must be at most {most} here")));
    }
    Ok(())
}

/// The edited model. Each edit is checked against the model that the edits before it made.
pub fn edit(model: &Model, interventions: &[Intervention]) -> Result<Model, EngineError> {
    let mut edited = model.clone();
    for (i, intervention) in interventions.iter().enumerate() {
        edited = intervention.apply(&edited).map_err(|e| refused_edit(i, intervention, &e))?;
        if let Intervention::ScaleMass { id, .. } = intervention {
            let mass = edited.bodies.iter().find(|b| b.id == *id).map_or(1.0, |b| b.mass);
            let [low, high] = MASS_RANGE;
            if !(low..=high).contains(&mass) {
                let message = format!("makes the mass {mass:?}; it must be from {low:?} to {high:?} kg");
                return Err(EngineError::invalid(format!("interventions[{i}].scale_mass.factor"), message));
            }
        }
    }
    Ok(edited)
}

/// Refuses an object that was put where another one is at that time; `edited` has all interventions.
pub fn places(edited: &Model, interventions: &[Intervention]) -> Result<(), EngineError> {
    for (i, intervention) in interventions.iter().enumerate() {
        let kind = match intervention {
            Intervention::Place { .. } => "place",
            Intervention::Shift { .. } => "shift",
            Intervention::Add { .. } => "add",
            _ => continue,
        };
        let Some(index) = intervention.object().and_then(|id| edited.body_index(id)) else { continue };
        let placed = &edited.bodies[index];
        let Some(states) = trace(edited, &[placed.start.time]).states.pop() else { continue };
        for (other, state) in edited.bodies.iter().zip(states).filter(|(other, _)| other.id != placed.id) {
            let position = match other.start.time == placed.start.time {
                true => Some(other.start.state.position),
                false => state.map(|s| s.position),
            };
            let Some(position) = position else { continue };
            let needed = placed.shape.inscribed_radius() + other.shape.inscribed_radius();
            let distance = (placed.start.state.position - position).norm();
            if distance < MIN_SEPARATION * needed {
                let message = format!(
                    "is {distance:.3} m from object {}, which needs {needed:.3} m; choose a free place",
                    other.id
                );
                let field = if kind == "shift" { "by" } else { "position" };
                return Err(EngineError::invalid(format!("interventions[{i}].{kind}.{field}"), message));
            }
        }
    }
    Ok(())
}

/// Refuses a simulation whose numbers overflowed.
pub fn finite(prediction: &Prediction) -> Result<(), EngineError> {
    let best = &prediction.best;
    for (frame, (states, sds)) in best.states.iter().zip(&prediction.sd).enumerate() {
        for ((state, sd), object) in states.iter().zip(sds).zip(&best.ids) {
            let Some(s) = state else { continue };
            let numbers = [s.position.x, s.position.y, s.yaw, s.velocity.x, s.velocity.y, s.spin];
            let rest = [s.roll.x, s.roll.y, sd.unwrap_or(0.0)];
            if !numbers.iter().chain(&rest).all(|v| v.is_finite()) {
                return Err(EngineError::NotFinite { object: *object, frame });
            }
        }
    }
    Ok(())
}

/// An intervention error with the path of the request's field.
fn refused_edit(index: usize, intervention: &Intervention, error: &InterventionError) -> EngineError {
    let kind = match intervention {
        Intervention::Remove { .. } => "remove",
        Intervention::ScaleMass { .. } => "scale_mass",
        Intervention::ScaleRestitution { .. } => "scale_restitution",
        Intervention::ScaleFriction { .. } => "scale_friction",
        Intervention::SetVelocity { .. } => "set_velocity",
        Intervention::ScaleVelocity { .. } => "scale_velocity",
        Intervention::Shift { .. } => "shift",
        Intervention::Place { .. } => "place",
        Intervention::Add { .. } => "add",
        Intervention::SwitchEffect { .. } => "switch_effect",
    };
    let field = match error {
        InterventionError::UnknownObject { .. } | InterventionError::DuplicateObject { .. } => "object_id",
        InterventionError::UnknownEffect { .. } => "effect",
        InterventionError::BadValue { what, .. } if what.ends_with("factor") => "factor",
        InterventionError::BadValue { what: "shift", .. } => "by",
        InterventionError::BadValue { what, .. } => what,
    };
    EngineError::invalid(format!("interventions[{index}].{kind}.{field}"), error.to_string())
}
