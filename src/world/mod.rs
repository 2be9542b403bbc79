//! The model and its simulation: bodies under effects, exact contacts, a trace of what happened.

mod acceleration_field;
mod agenda;
mod anchor;
mod blow;
mod encounter;
mod flight;
mod footprint;
mod geometry;
mod grid;
mod group;
mod impact;
mod intervene;
mod jam;
mod model;
mod motion;
mod observation;
mod obstacle;
mod pairs;
mod preset;
mod pressing;
mod pressure;
mod rigid;
mod shared_values;
mod simulate;
mod trace;
mod written;

pub use acceleration_field::{AccelerationField, FormulaForces, Snapshot};
pub use anchor::StateCorrection;
pub use geometry::{PlacedShape, gap};
pub use intervene::{Intervention, InterventionError};
pub use model::{
    ActiveEffect, BODY_VALUES, BodySpec, MASS, MASS_BOUNDS, Model, Parameter, Prior, SPINS, Start,
    ValueOwner, Wall,
};
pub use motion::Kinematics;
pub use observation::{ObservationModel, simulate_observed};
pub use preset::{PRESETS, Preset};
pub use simulate::{Rollout, SimulationLimits, simulate, trace};
pub use trace::{Ending, Event, EventKind, State, Trace};

#[cfg(test)]
mod tests;
