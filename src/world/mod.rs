//! The model and its simulation: bodies under effects, exact contacts, a trace of states and events.
//!
//! The folders build on each other in this order: `model` and `trace` (data), `motion` (single bodies), `contact` (pairs of
//! bodies), `simulation` (the state of a run and its events). [`simulate`] drives a run; `observation` adds the camera.

mod acceleration_field;
mod contact;
mod intervention;
mod model;
mod motion;
mod observation;
mod preset;
mod shared_values;
mod simulate;
mod simulation;
mod trace;
mod unknown_impulse;
mod unseen_push;

pub use acceleration_field::{AccelerationField, FormulaForces, Snapshot};
pub use contact::geometry::{PlacedShape, gap};
pub use intervention::{FACTORS, Intervention, InterventionError};
pub use model::{
    ActiveEffect, BODY_VALUES, BodySpec, MASS, MASS_BOUNDS, Model, Parameter, Prior, SPINS, Start,
    StateCorrection, ValueOwner, Wall,
};
pub use motion::kinematics::Kinematics;
pub use observation::{ObservationModel, simulate_observed};
pub use preset::{PRESETS, Preset};
pub use simulate::{Rollout, SimulationLimits, simulate, trace};
pub use trace::{Ending, Event, EventKind, State, Trace};
pub use unknown_impulse::{IMPULSE_VALUES, UnknownImpulse};
pub use unseen_push::UnseenPush;

#[cfg(test)]
mod tests;
