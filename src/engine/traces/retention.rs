//! Which traces may be removed: the limits on age and size, and the leases on traces in use.
//!
//! Invariants:
//! * A trace with a [`Lease`] (it is being written, downloaded or replayed) is never removed.
//! * A trace that is being removed gets no lease; a writer of the same trace waits until the removal is done.
//! * Leases are keyed by the whole key in the store, so that tenants do not block each other.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::Notify;

/// Limits on what is kept; by default everything is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Retention {
    /// Traces that were stored longer ago are removed.
    pub max_age: Option<Duration>,
    /// Bytes of all traces together.
    pub max_bytes: Option<u64>,
}

/// The limits and the leases of all traces.
#[derive(Default)]
pub struct TraceRetention {
    pub limits: Retention,
    /// Notified when a trace was stored.
    pub stored: Notify,
    uses: Uses,
}

/// By whole key of a trace: how many leases it has, or [`REMOVED`] while it is being removed.
type Uses = Arc<Mutex<HashMap<String, usize>>>;
const REMOVED: usize = usize::MAX;

/// Protects one trace from removal until it is dropped.
pub struct Lease {
    key: String,
    uses: Uses,
}

impl Drop for Lease {
    fn drop(&mut self) {
        let mut uses = locked(&self.uses);
        match uses.get_mut(&self.key) {
            Some(count) if *count > 1 && *count != REMOVED => *count -= 1,
            _ => {
                uses.remove(&self.key);
            }
        }
    }
}

impl TraceRetention {
    pub fn new(limits: Retention) -> TraceRetention {
        TraceRetention { limits, ..TraceRetention::default() }
    }

    /// A lease; `None` while the trace is being removed.
    pub fn lease(&self, key: &str) -> Option<Lease> {
        let mut uses = locked(&self.uses);
        let count = uses.entry(key.to_string()).or_default();
        if *count == REMOVED {
            return None;
        }
        *count += 1;
        Some(Lease { key: key.to_string(), uses: self.uses.clone() })
    }

    /// A lease, after waiting for a removal of the same trace to end.
    pub async fn lease_when_free(&self, key: &str) -> Lease {
        loop {
            if let Some(lease) = self.lease(key) {
                return lease;
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }

    /// The right to remove the trace; `None` if it has a lease.
    pub fn removal(&self, key: &str) -> Option<Lease> {
        let mut uses = locked(&self.uses);
        if uses.contains_key(key) {
            return None;
        }
        uses.insert(key.to_string(), REMOVED);
        Some(Lease { key: key.to_string(), uses: self.uses.clone() })
    }
}

/// No code panics while it holds this lock.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
