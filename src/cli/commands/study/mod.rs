//! Commands that study the scenes of one set-up.

pub mod compare;
pub mod diagnose;
pub mod discover;
mod errors;
mod ranking;
pub mod report;
pub mod revise;
pub mod show;
mod side_by_side;
mod why;
