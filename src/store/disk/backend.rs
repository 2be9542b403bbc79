//! The file of the database as redb reads and writes it.

use redb::backends::FileBackend;
use redb::{BackendError, DatabaseError, StorageBackend};
use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind};
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

    /// Reads what the file has, and zeros beyond it.
    fn read_to_the_end(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        let left = self.file.metadata()?.len().saturating_sub(offset);
        let within = usize::try_from(left).unwrap_or(usize::MAX).min(out.len());
        let (stored, beyond) = out.split_at_mut(within);
        beyond.fill(0);
        if stored.is_empty() { Ok(()) } else { self.inner.read(offset, stored) }
    }
}

impl StorageBackend for DataFile {
    fn len(&self) -> io::Result<u64> {
        self.inner.len()
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        match self.inner.read(offset, out) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => self.read_to_the_end(offset, out),
            done => done,
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_reads_as_zeros_beyond_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, [7; 10]).unwrap();
        let file = DataFile::open(&path).unwrap();
        let read = |offset| {
            let mut out = [1; 4];
            file.read(offset, &mut out).map(|()| out)
        };
        let found = [0, 6, 8, 10, 1 << 52].map(|offset| read(offset).unwrap());
        assert_eq!(found, [[7; 4], [7; 4], [7, 7, 0, 0], [0; 4], [0; 4]]);
    }
}
