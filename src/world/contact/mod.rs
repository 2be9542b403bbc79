//! Contacts of bodies: geometry, time of impact, impulses, lasting contacts, bonds, and the islands that they form.

pub(super) mod bonds;
pub(super) mod compression;
pub(super) mod contact_law;
pub(super) mod contact_solver;
pub(super) mod geometry;
pub(super) mod grid;
pub(super) mod impulse;
pub(super) mod islands;
pub(super) mod persistent_contact;
pub(super) mod rigid_cluster;
pub(super) mod static_body;
pub(super) mod time_of_impact;
