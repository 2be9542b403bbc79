//! The simulation: its state, islands of bodies, events and the responses to them.
//!
//! Files build on each other in this order:
//!
//! 1. `event_queue`, `recorder`: parts of the state;
//! 2. `state`: the state of a run;
//! 3. `grouping`, `facing`: islands, and pairs of bodies as they are at present;
//! 4. `contact_forces`, `rest`, `static_equilibrium`: accelerations and modes of an island;
//! 5. `island_motion`, `bonding`, `scheduling`: segments, broken bonds, scheduled events;
//! 6. `contact_impulse`, `impact_propagation`, `collision_response`: impacts.

pub(super) mod bonding;
pub(super) mod collision_response;
pub(super) mod contact_forces;
pub(super) mod contact_impulse;
pub(super) mod event_queue;
pub(super) mod facing;
pub(super) mod grouping;
pub(super) mod impact_propagation;
pub(super) mod island_motion;
pub(super) mod recorder;
pub(super) mod rest;
pub(super) mod scheduling;
pub(super) mod state;
pub(super) mod static_equilibrium;
