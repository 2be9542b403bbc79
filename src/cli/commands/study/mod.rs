//! Commands that study the scenes of one set-up.

pub mod compare;
pub mod diagnose;
pub mod discover;
mod ranking;
pub mod report;
pub mod revise;
pub mod show;
mod why;
