//! Times of frames that are others than was said: frames that are missing, and a rate that changes.

mod lost_frames;
mod rate_changes;

pub use lost_frames::take_in_lost_frames;
pub use rate_changes::take_in_rate_changes;
