//! The file of the database as redb reads and writes it.

use redb::backends::FileBackend;
use redb::{BackendError, DatabaseError, StorageBackend};
use std::fs::{File, OpenOptions};
use std::io;
use std::ops::Bound;
use std::path::Path;

/// Counts writes to the disk that failed, of the database and of trace files.
pub const WRITE_ERRORS: &str = "vrdp_storage_write_errors_total";

/// Notes the failure of a write.
pub fn count_failure<T, E>(done: Result<T, E>) -> Result<T, E> {
    if done.is_err() {
        metrics::counter!(WRITE_ERRORS).increment(1);
    }
    done
}

/// A file that reads as zeros beyond its end. A damaged page may point there; redb takes no more work after an error of
/// the disk, whereas it reports zeros as damage of that page alone.
#[derive(Debug)]
pub struct DataFile {
    file: File,
    inner: FileBackend,
}

impl DataFile {
    /// Opens or creates the file.
    pub fn open(path: &Path) -> Result<DataFile, DatabaseError> {
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
        Ok(DataFile { inner: FileBackend::new(file.try_clone()?)?, file })
    }
}

impl StorageBackend for DataFile {
    fn len(&self) -> io::Result<u64> {
        self.inner.len()
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        let left = self.file.metadata()?.len().saturating_sub(offset);
        let within = usize::try_from(left).unwrap_or(usize::MAX).min(out.len());
        let (stored, beyond) = out.split_at_mut(within);
        beyond.fill(0);
        if stored.is_empty() { Ok(()) } else { self.inner.read(offset, stored) }
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        count_failure(self.inner.set_len(len))
    }

    fn sync_data(&self) -> io::Result<()> {
        count_failure(self.inner.sync_data())
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        count_failure(self.inner.write(offset, data))
    }

    fn close(&self) -> io::Result<()> {
        self.inner.close()
    }

    fn try_lock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<bool, BackendError> {
        self.inner.try_lock_range(start, end)
    }

    fn try_lock_shared_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<bool, BackendError> {
        self.inner.try_lock_shared_range(start, end)
    }

    fn lock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<(), BackendError> {
        self.inner.lock_range(start, end)
    }

    fn lock_shared_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<(), BackendError> {
        self.inner.lock_shared_range(start, end)
    }

    fn unlock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<(), BackendError> {
        self.inner.unlock_range(start, end)
    }

    fn query_lock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<bool, BackendError> {
        self.inner.query_lock_range(start, end)
    }
}
