//! Trace files: one MCAP for one simulation, readable by Foxglove and Rerun, with every number beside it.

mod encode;
pub mod messages;
mod read;

pub use encode::encode;
pub use read::{Reading, read};

use crate::fit::Estimate;
use crate::reason::Imagined;
use crate::scene::Scene;

/// All that goes into one trace file. The same recording gives the same bytes.
#[derive(Debug, Clone, Copy)]
pub struct Recording<'a> {
    pub scene: &'a Scene,
    pub imagined: &'a Imagined,
    /// What was fitted, of this scene.
    pub estimates: &'a [Estimate],
    /// Id of the video.
    pub video: &'a str,
    /// Digest of the fitted model, before interventions.
    pub model: &'a str,
    pub seed: u64,
    /// The request as JSON; with the model it is enough to simulate again.
    pub request_json: &'a str,
}

#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    #[error("time {time} s has no place in a trace; times run from 0 to {most} s", most = MAX_TIME)]
    Time { time: f64 },
    #[error("the model cannot be written as JSON: {0}")]
    Model(#[from] serde_json::Error),
    #[error("MCAP: {0}")]
    Mcap(#[from] mcap::McapError),
    #[error("topic {topic}, message {index}: {source}")]
    Message { topic: String, index: usize, source: prost::DecodeError },
}

/// Latest time in a trace (s): nanoseconds keep their place in an `i64` with room to spare.
pub const MAX_TIME: f64 = 1e9;

/// Frame of reference of every pose.
pub const FRAME: &str = "world";

#[cfg(test)]
mod tests;
