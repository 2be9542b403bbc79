//! How many encoded traces may wait for the disk.
//!
//! A job whose trace has no room waits in its thread, and so keeps its slot in the queue: the pool admits new jobs no
//! faster than the disk writes, and memory stays bounded. A job asks for the room of all its files at once, so that no
//! two jobs can wait for each other.

use super::file::TraceFile;
use crate::engine::error::EngineError;
use crate::num::Stop;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// KiB of encoded traces that may wait for the disk: about a hundred usual ones.
const BACKLOG: u32 = 64 * 1024;
/// How often a waiting job looks for room.
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// The traces of one job, and their share of the backlog.
pub struct Batch {
    pub(super) files: Vec<TraceFile>,
    _share: OwnedSemaphorePermit,
}

/// The bounded bytes of traces that wait for the disk.
pub struct Backlog(Arc<Semaphore>);

impl Default for Backlog {
    fn default() -> Self {
        Backlog(Arc::new(Semaphore::new(BACKLOG as usize)))
    }
}

impl Backlog {
    /// Waits until there is room for all the files.
    pub fn admit(&self, files: Vec<TraceFile>, stop: Stop) -> Result<Batch, EngineError> {
        let bytes: usize = files.iter().map(|f| f.bytes.len()).sum();
        let kib = u32::try_from(bytes / 1024 + 1).unwrap_or(BACKLOG).min(BACKLOG);
        loop {
            if let Ok(share) = self.0.clone().try_acquire_many_owned(kib) {
                return Ok(Batch { files, _share: share });
            }
            stop(1.0)?;
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}
