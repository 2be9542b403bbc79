//! Whether the service is ready for calls: its store answers, its disk has room, its queue moves, and it does not drain.

use super::metrics::READY;
use crate::engine::{Engine, EngineError};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Longest answer of the store to a question for one row.
const STORE_TIMEOUT: Duration = Duration::from_secs(5);
/// An id that no operation has.
const NO_OPERATION: &str = "0";

/// Beyond these the service is not ready.
#[derive(Debug, Clone)]
pub struct ReadinessLimits {
    /// Least free bytes on the disk of the data folder.
    pub free_bytes: u64,
    /// Longest wait of the oldest queued job.
    pub oldest_wait: Duration,
}

impl Default for ReadinessLimits {
    fn default() -> Self {
        ReadinessLimits { free_bytes: 64 << 20, oldest_wait: Duration::from_secs(300) }
    }
}

/// Why the service is not ready.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotReady {
    #[error("the service drains: it ends its running calls and takes no new ones")]
    Draining,
    #[error("the store does not answer: {0}")]
    Store(&'static str),
    #[error(
        "the disk of the data folder has {free} bytes left; {least} are needed: free some, or lower min_free_bytes"
    )]
    Disk { free: u64, least: u64 },
    #[error(
        "the oldest queued job has waited {seconds} s; more than {most} s means that the service is overloaded"
    )]
    Queue { seconds: u64, most: u64 },
}

pub struct Readiness {
    limits: ReadinessLimits,
    draining: AtomicBool,
}

impl Readiness {
    pub fn new(limits: ReadinessLimits) -> Readiness {
        Readiness { limits, draining: AtomicBool::new(false) }
    }

    /// From now on the service is not ready.
    pub fn drain(&self) {
        self.draining.store(true, Ordering::Relaxed);
        metrics::gauge!(READY).set(0.0);
    }

    /// Asks the store, the disk and the queue.
    pub async fn check(&self, engine: &Engine) -> Result<(), NotReady> {
        let found = self.found(engine).await;
        metrics::gauge!(READY).set(if found.is_ok() { 1.0 } else { 0.0 });
        found
    }

    async fn found(&self, engine: &Engine) -> Result<(), NotReady> {
        if self.draining.load(Ordering::Relaxed) {
            return Err(NotReady::Draining);
        }
        match tokio::time::timeout(STORE_TIMEOUT, engine.operation(NO_OPERATION)).await {
            Ok(Ok(_) | Err(EngineError::NotFound { .. })) => {}
            Ok(Err(error)) => {
                tracing::debug!(%error, "not ready");
                return Err(NotReady::Store("it failed; the log of the service says more"));
            }
            Err(_) => return Err(NotReady::Store("it took too long")),
        }
        if let Some(free) = engine.storage().free_bytes.filter(|free| *free < self.limits.free_bytes) {
            return Err(NotReady::Disk { free, least: self.limits.free_bytes });
        }
        let oldest = engine.load().oldest;
        if oldest > self.limits.oldest_wait {
            let most = self.limits.oldest_wait.as_secs();
            return Err(NotReady::Queue { seconds: oldest.as_secs(), most });
        }
        Ok(())
    }
}
