//! Joins core and edges: looks up or computes what a request needs, once, on the CPU pool, and stores it.
//!
//! A request runs through these parts:
//! * `cache`: equal requests share one job; its result stays in memory.
//! * `pool`: jobs run on a fixed number of threads behind a bounded queue.
//! * `store` (the room below): results are durable before they are returned.
//! * `questions`: English becomes a program, by our reader or a language model, and the program an answer.
//! * `operations`: long work that goes on when its caller leaves.
//! * `traces`: each simulation, fit and discovery leaves one file that can be replayed.
//!
//! Ids of results hold the program's version and the numeric fingerprint (`results::result_digest`): results of other
//! arithmetic are never mixed with ours.

mod cache;
mod error;
mod fits;
mod joint;
mod limits;
mod listings;
pub mod metric_names;
mod model_source;
mod operations;
mod pool;
mod predictions;
mod progress;
mod questions;
mod report_page;
mod results;
mod sides;
mod state;
mod studies;
mod task;
mod traces;
mod videos;
mod words;

pub use crate::store::{Listing, Quota, StorageState, Tenant, TimedRow, VideoHead};
pub use cache::{Job, JobHandle, Update};
pub use error::EngineError;
pub use joint::JointVideos;
pub use limits::{
    MAX_REPLAYS, MAX_REPLY_STATES, MAX_ROLLOUT_STATES, MAX_ROLLOUTS, MAX_SPEED, MAX_STUDY_VIDEOS,
};
pub use listings::{CreatedRange, ModelFilter, RevisionFilter, SetupRow, VideoFilter};
pub use model_source::{ModelSource, ModelSourceKind};
pub use operations::{
    CutOperation, NewOperation, OperationFilter, OperationKind, OperationOutcome, OperationRecord,
    OperationState, OperationStatus, OperationUpdate,
};
pub use pool::{JobKind, Load, panic_message};
pub use predictions::{DEFAULT_FUTURE_FRAMES, DEFAULT_ROLLOUTS, SimulateOptions};
pub use progress::{JobProgress, Phase};
pub use questions::{AskedQuestion, ChatParser, ChatSettings, Parsed};
pub use report_page::{ReportContents, ReportPage, ReportQuestion};
pub use results::{
    Discovered, Findings, OptionalPose, PublishedAnswer, PublishedSimulation, RevisionRecord, StoredFit,
    Study, TrajectoryPair,
};
pub use sides::SideDifference;
pub use state::{Capacity, Engine};
pub use studies::{MAX_EFFECTS, StudyKind};
pub use traces::file::{TraceKind, TraceRecord};
pub use traces::replay::{Replay, ReplayItem, ReplayOptions};
pub use traces::retention::{ClockReading, Lease, Retention};
pub use traces::stored::{Download, TraceFilter};
pub use words::{ExamplePlace, LearnRequest, NamedChange, NamedExample, VideoLessons};
