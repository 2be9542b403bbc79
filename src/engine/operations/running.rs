//! The operations that run in this process.

use crate::engine::progress::JobProgress;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

/// Of all tenants, by whole key.
#[derive(Default)]
pub struct RunningOperations {
    by_key: Mutex<HashMap<String, Arc<RunningOperation>>>,
    count: AtomicU32,
    closed: AtomicBool,
    /// Held while an operation with a request id starts, so that equal ids start one.
    pub(super) starts: tokio::sync::Mutex<()>,
}

pub(super) struct RunningOperation {
    /// Cancelled by a caller, or by the end of the service.
    pub token: CancellationToken,
    pub progress: watch::Sender<JobProgress>,
    /// Cancelled when it has ended and its end is stored.
    pub ended: CancellationToken,
}

/// Keeps an operation in the table until it is dropped, also by a panic.
pub(super) struct Registration {
    all: Arc<RunningOperations>,
    key: String,
    pub running: Arc<RunningOperation>,
}

impl Drop for Registration {
    fn drop(&mut self) {
        self.all.locked().remove(&self.key);
        self.running.ended.cancel();
    }
}

impl RunningOperations {
    /// No code panics while it holds this lock.
    fn locked(&self) -> MutexGuard<'_, HashMap<String, Arc<RunningOperation>>> {
        self.by_key.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A new id: hexadecimal digits that sort before those of older operations.
    pub(super) fn new_id(&self) -> String {
        let nanos = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos() as u64);
        format!("{:016x}{:08x}", u64::MAX - nanos, self.count.fetch_add(1, Ordering::Relaxed))
    }

    pub(super) fn register(self: &Arc<Self>, key: String) -> Registration {
        let (token, ended) = (CancellationToken::new(), CancellationToken::new());
        let running = Arc::new(RunningOperation { token, progress: watch::Sender::default(), ended });
        self.locked().insert(key.clone(), running.clone());
        Registration { all: self.clone(), key, running }
    }

    pub(super) fn get(&self, key: &str) -> Option<Arc<RunningOperation>> {
        self.locked().get(key).cloned()
    }

    /// Those whose keys begin with `prefix`, by key.
    pub(super) fn with_prefix(&self, prefix: &str) -> HashMap<String, Arc<RunningOperation>> {
        let all = self.locked();
        let ours = all.iter().filter(|(key, _)| key.starts_with(prefix));
        ours.map(|(key, running)| (key.clone(), running.clone())).collect()
    }

    /// Whether the service ends: what is cancelled now is aborted.
    pub(super) fn is_closed(&self) -> bool {
        self.closed.load(Ordering::SeqCst)
    }

    /// Aborts all.
    pub(super) async fn close(&self) {
        self.closed.store(true, Ordering::SeqCst);
        let all: Vec<_> = self.locked().values().cloned().collect();
        for running in &all {
            running.token.cancel();
        }
        for running in all {
            running.ended.cancelled().await;
        }
    }
}
