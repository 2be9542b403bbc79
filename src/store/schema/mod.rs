//! What the database holds: tables, rows with checksums, heads, and the steps from older schemas to this one.

pub(super) mod heads;
pub(super) mod migrations;
pub(super) mod rows;
pub(super) mod tables;
pub(super) mod usage;
