//! Results in memory: each is computed once for all who ask at once, and the recent ones stay.

mod recent_results;
mod single_flight;

pub use recent_results::RecentResults;
pub use single_flight::{Job, JobHandle, SingleFlightCache, Update};
