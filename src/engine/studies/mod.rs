//! Studies of a set-up's videos: comparisons, diagnoses, discoveries and changes of their models.

mod checkpoints;
mod input;
mod revision;
mod run;

pub use input::{MAX_EFFECTS, StudyKind};
