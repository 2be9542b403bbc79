//! Messages to domain values and back; a request is refused with all its violations at once.

pub mod camera;
pub mod detections;
pub mod findings;
pub mod interventions;
pub mod model;
pub mod names;
pub mod new_video;
pub mod question;
pub mod simulation;
pub mod study;
pub mod trace;
pub mod video;
pub mod violations;
