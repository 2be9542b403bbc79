//! Motion of single bodies between contacts: forces, ground friction, and integration.

pub(super) mod contact_patch;
pub(super) mod dynamics;
pub(super) mod ground_friction;
pub(super) mod kinematics;
pub(super) mod moving_body;
pub(super) mod path;
pub(super) mod segment;
