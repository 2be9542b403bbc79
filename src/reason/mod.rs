//! Reasoning: predict, imagine, and answer questions by simulating.

mod imagine;

pub use imagine::{Imagined, LikelyEvent, MAX_SIMULATED_FRAMES, Request, imagine};

use crate::num::Stopped;
use crate::world::InterventionError;

/// Why a question has no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReasonError {
    #[error(transparent)]
    Intervention(#[from] InterventionError),
    #[error("frames is {frames}; ask for 1 to {most}")]
    Frames { frames: usize, most: usize },
    #[error(transparent)]
    Stopped(#[from] Stopped),
}
