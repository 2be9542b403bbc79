//! Trace files: one MCAP file for each simulation, fit and discovery, readable by Foxglove and Rerun.
//!
//! Format:
//! * The log time of a message is the time in the video (ns); no wall clock is in a file.
//! * Every number is on a topic of ours (`/simulated/states`, `/events`, `/parameters`, ...) in double precision. The
//!   other topics repeat them in Foxglove's schemas, for viewers.
//! * Attachments hold the inputs: `scene.json`, `fit.cbor` (CBOR keeps infinite bounds), the request, the models, and
//!   `stills.cbor` where frames of the video were asked for.
//! * Metadata name the program, its numeric fingerprint, the video, the model and the seed.
//!
//! The file is a function of its inputs: the same recording gives the same bytes (`writer` sorts messages by time and
//! topic, and compresses with LZ4, which is deterministic). `verify` therefore computes a trace again from its
//! attachments and compares bytes. Where another program or other arithmetic wrote it, numbers are compared within
//! [`TOLERANCE`].

mod change;
mod draw;
mod encode;
pub mod messages;
mod origin;
mod read;
mod scan;
mod stills;
mod verify;
mod writer;

pub use change::{RecordedChange, RecordedRevision, encode_change};
pub use encode::{MAX_ROLLOUT_STATES, encode};
pub use origin::{TOLERANCE, build, origin_difference};
pub use read::{Message, TraceReader};
pub use scan::{Damage, ScanReport, ScannedItem, TraceContents, read, scan};
pub use verify::{Difference, Verification, verify};
pub use writer::MAX_TIME;

use crate::fit::Fit;
use crate::media::Still;
use crate::reason::Prediction;
use crate::scene::Scene;

/// The content of the trace file of a simulation.
#[derive(Debug, Clone, Copy)]
pub struct Recording<'a> {
    pub scene: &'a Scene,
    pub prediction: &'a Prediction,
    /// The fit of this scene alone, before interventions; the models of the rollouts were drawn from it.
    pub fit: &'a Fit,
    /// Id of the video.
    pub video: &'a str,
    /// Id of the fitted model.
    pub model: &'a str,
    pub seed: u64,
    /// The request as JSON.
    pub request_json: &'a str,
    /// Frames of the video that the trace shows too; usually none.
    pub stills: &'a [Still],
}

#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    #[error("time {time} s cannot be written; times of a trace are from 0 to {most} s", most = MAX_TIME)]
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
        "the file is damaged from byte {from} to byte {to}: {what}; `vrdp trace verify` lists the missing messages"
    )]
    Damaged { from: u64, to: u64, what: String },
    #[error(
        "reading the file takes more work than {most} bytes, the most for a file of {size} bytes: its parts overlap or unpack to \
         far more than a trace holds; it is no trace of vrdp, or was made to keep its reader busy"
    )]
    TooMuchWork { size: u64, most: u64 },
    #[error("the trace has no {what}; only traces of vrdp can be simulated again")]
    Missing { what: &'static str },
    #[error("the recorded request cannot be simulated: {0}")]
    Simulate(#[from] crate::reason::ReasonError),
}

/// Frame of reference of every pose.
pub const FRAME: &str = "world";

#[cfg(test)]
mod tests;
