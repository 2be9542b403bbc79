//! The simulation: its state, islands of bodies, events and the responses to them.
//!
//! Each file builds on the earlier ones of this list, and none on a later one.

pub(super) mod event_queue;
pub(super) mod recorder;
#[rustfmt::skip]
pub(super) mod state;
pub(super) mod bonding;
pub(super) mod collision_response;
pub(super) mod contact_forces;
pub(super) mod contact_impulse;
pub(super) mod facing;
pub(super) mod grouping;
pub(super) mod impact_propagation;
pub(super) mod island_motion;
pub(super) mod rest;
pub(super) mod scheduling;
pub(super) mod static_equilibrium;
