//! Trace files: one MCAP for one piece of work, readable by Foxglove and Rerun, with every number beside it.

mod change;
mod draft;
mod draw;
mod encode;
pub mod messages;
mod read;
mod replay;
mod scan;

pub use change::{Change, Step, encode_change};
pub use draft::MAX_TIME;
pub use encode::{MAX_ROLLOUT_STATES, encode};
pub use read::{Message, Reader};
pub use replay::{Difference, TOLERANCE, Verification, verify};
pub use scan::{Damage, Item, Reading, Report, read, scan};

use crate::fit::Fit;
use crate::reason::Prediction;
use crate::scene::Scene;
use std::collections::BTreeMap;

/// All that goes into the trace file of a simulation. The same recording gives the same bytes.
#[derive(Debug, Clone, Copy)]
pub struct Recording<'a> {
    pub scene: &'a Scene,
    pub prediction: &'a Prediction,
    /// Of this scene alone, before interventions; models were drawn from it.
    pub fit: &'a Fit,
    /// Id of the video.
    pub video: &'a str,
    /// Id of the fitted model.
    pub model: &'a str,
    pub seed: u64,
    /// The request as JSON.
    pub request_json: &'a str,
}

#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    #[error("time {time} s has no place in a trace; times run from 0 to {most} s", most = MAX_TIME)]
    Time { time: f64 },
    #[error("JSON: {0}")]
    Json(#[from] serde_json::Error),
    #[error("CBOR: {0}")]
    Cbor(String),
    #[error("MCAP: {0}")]
    Mcap(#[from] mcap::McapError),
    #[error("a message is too large: {0}")]
    Large(#[from] prost::EncodeError),
    #[error("topic {topic}, message {index}: {source}")]
    Message { topic: String, index: usize, source: prost::DecodeError },
    #[error("the file cannot be read: {0}")]
    Io(#[from] std::io::Error),
    #[error("the file is no MCAP file; give one that `vrdp simulate --trace` or `DownloadTrace` wrote")]
    NoTrace,
    #[error(
        "the file is damaged from byte {from} to byte {to}: {what}; `vrdp trace verify` says what is lost"
    )]
    Damaged { from: u64, to: u64, what: String },
    #[error("the trace has no {what}; only traces of vrdp can be simulated again")]
    Lacks { what: &'static str },
    #[error("the recorded request cannot be simulated: {0}")]
    Simulate(#[from] crate::reason::ReasonError),
}

/// Frame of reference of every pose.
pub const FRAME: &str = "world";

/// What wrote a trace: numbers are equal bit for bit within one build on one kind of machine.
pub fn build() -> String {
    format!("{} {}-{}", env!("CARGO_PKG_VERSION"), std::env::consts::ARCH, std::env::consts::OS)
}

/// What every kind of trace says of itself.
fn metadata(kind: &str, scene: &Scene, video: &str, model: &str) -> BTreeMap<String, String> {
    [
        ("build", build()),
        ("kind", kind.to_string()),
        ("scene", scene.name.clone()),
        ("video", video.to_string()),
        ("model", model.to_string()),
    ]
    .map(|(key, value)| (key.to_string(), value))
    .into()
}

#[cfg(test)]
mod tests;
