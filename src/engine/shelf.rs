//! How long traces are kept: retention by age and by size, oldest first, never one that is being read or written.

use super::trace::TraceRecord;
use super::{Engine, EngineError};
use crate::store::Kind;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::Notify;

/// How often old traces are looked for where nothing is written.
const ROUND: Duration = Duration::from_secs(60);
/// Retention by size goes down to this share of the limit, so that it need not count all traces at every new one.
const DOWN_TO: f64 = 0.9;

/// What retention keeps; by default everything.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Retention {
    /// Traces that were stored longer ago are removed.
    pub max_age: Option<Duration>,
    /// Bytes of all traces together.
    pub max_bytes: Option<u64>,
}

#[derive(Default)]
pub struct Shelf {
    pub retention: Retention,
    /// A trace was stored.
    pub filled: Notify,
    uses: Uses,
}

/// By whole key of a trace: how many use it, or [`REMOVED`] while it is being removed.
type Uses = Arc<Mutex<HashMap<String, usize>>>;
const REMOVED: usize = usize::MAX;

/// As long as it lives, its trace is not removed by retention.
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

impl Shelf {
    /// `None` while the trace is being removed.
    pub fn lease(&self, key: &str) -> Option<Lease> {
        let mut uses = locked(&self.uses);
        let count = uses.entry(key.to_string()).or_default();
        if *count == REMOVED {
            return None;
        }
        *count += 1;
        Some(Lease { key: key.to_string(), uses: self.uses.clone() })
    }

    /// Waits while the trace is being removed, which takes one turn of the disk.
    pub async fn lease_when_free(&self, key: &str) -> Lease {
        loop {
            if let Some(lease) = self.lease(key) {
                return lease;
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }

    /// The right to remove the trace, if nobody uses it.
    fn remove(&self, key: &str) -> Option<Lease> {
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

impl Engine {
    /// The engine with a limit on what it keeps.
    pub fn retaining(mut self, retention: Retention) -> Engine {
        self.shelf = Arc::new(Shelf { retention, ..Shelf::default() });
        self
    }

    /// Removes what retention no longer keeps at `now_ms` (ms after 1970), of all tenants together; gives the ids.
    pub async fn retain(&self, now_ms: u64) -> Result<Vec<String>, EngineError> {
        let Retention { max_age, max_bytes } = self.shelf.retention;
        if max_age.is_none() && max_bytes.is_none() {
            return Ok(vec![]);
        }
        let store = self.store.of_everyone();
        let mut rows = store.list(Kind::Traces, "", "", usize::MAX, |_: &TraceRecord| true).await?;
        rows.sort_by(|(a, ra), (b, rb)| (ra.stored_ms, a).cmp(&(rb.stored_ms, b)));
        let mut bytes: u64 = rows.iter().map(|(_, r)| r.size_bytes).sum();
        let goal = max_bytes.filter(|most| bytes > *most).map(|most| (most as f64 * DOWN_TO) as u64);
        let too_old = |r: &TraceRecord| {
            max_age.is_some_and(|age| now_ms.saturating_sub(r.stored_ms) as u128 > age.as_millis())
        };
        let mut removed = vec![];
        for (key, record) in rows {
            if !too_old(&record) && goal.is_none_or(|goal| bytes <= goal) {
                continue;
            }
            let Some(_right) = self.shelf.remove(&key) else { continue };
            store.delete_trace(&key).await?;
            bytes -= record.size_bytes;
            removed.push(record.id);
            // What is in memory may name it: who asks again gets a trace that exists.
            self.forget();
        }
        Ok(removed)
    }

    /// Keeps to the retention until it is dropped: after every new trace, and once a minute.
    pub async fn keep_house(self: Arc<Self>) {
        loop {
            let _ = tokio::time::timeout(ROUND, self.shelf.filled.notified()).await;
            match self.retain(super::trace::now_ms()).await {
                Ok(removed) if removed.is_empty() => {}
                Ok(removed) => tracing::info!(traces = removed.len(), "retention removed traces"),
                Err(error) => tracing::error!(%error, "retention failed"),
            }
        }
    }
}
