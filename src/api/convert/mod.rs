//! Messages to domain values and back; a request is refused with all its violations at once.

pub mod findings;
pub mod ingest;
pub mod listing;
pub mod model;
pub mod names;
pub mod operation;
pub mod progress;
pub mod read_mask;
pub mod reasoning;
pub mod study;
pub mod trace;
pub mod video;
pub mod violations;
