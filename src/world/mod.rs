//! The model and its simulation: bodies under effects, exact contacts, a trace of what happened.

mod agenda;
mod anchor;
mod blow;
mod encounter;
mod field;
mod film;
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
mod obstacle;
mod pairs;
mod preset;
mod pressing;
mod pressure;
mod rigid;
mod setup;
mod simulate;
mod trace;
mod written;

pub use anchor::Anchor;
pub use field::{Field, Snapshot, Written};
pub use film::{Views, film};
pub use geometry::{Outline, gap};
pub use intervene::{Intervention, InterventionError};
pub use model::{
    ActiveEffect, BODY_VALUES, BodySpec, MASS, MASS_BOUNDS, Model, Owner, Parameter, Prior, SPINS, Start,
    Wall,
};
pub use motion::Kinematics;
pub use preset::{PRESETS, Preset};
pub use simulate::{Limits, Rollout, simulate, trace};
pub use trace::{Ending, Event, EventKind, State, Trace};

#[cfg(test)]
mod tests;
