//! Results in memory: each is computed once for all who ask at once, and the recent ones stay.

mod deletions;
mod recent_results;
mod single_flight;

pub use deletions::Deletions;
pub use recent_results::{RecentResults, SMALL_RESULT};
pub use single_flight::{Job, JobHandle, SingleFlightCache, Update};

use std::sync::{Mutex, MutexGuard, PoisonError};

/// No code panics while it holds these locks, so a poisoned lock is taken as it is.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
