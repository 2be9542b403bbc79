//! A disk in memory. It has as many pages as it is given, and its reads and writes fail where a test asks for it.

use redb::StorageBackend;
use std::collections::BTreeSet;
use std::io::{self, ErrorKind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

const PAGE: u64 = 4096;

/// What fails.
#[derive(Debug, Default)]
pub struct Faults {
    /// Pages of the disk; a file that keeps space back takes some of them.
    pub pages: Option<u64>,
    pub reserve: Option<PathBuf>,
    /// Writes that still work; all others fail.
    pub writes: Option<u64>,
    /// Reads that still work, and how the next one fails; then all work again.
    pub reads: Option<(u64, ErrorKind)>,
}

#[derive(Debug, Clone, Default)]
pub struct MemoryDisk {
    pub bytes: Arc<Mutex<Vec<u8>>>,
    pub faults: Arc<Mutex<Faults>>,
    /// Bytes of the largest read.
    pub largest_read: Arc<AtomicUsize>,
    written: Arc<Mutex<BTreeSet<u64>>>,
}

impl MemoryDisk {
    pub fn of(bytes: Vec<u8>) -> MemoryDisk {
        let pages = (0..bytes.len() as u64 / PAGE).collect();
        let written = Arc::new(Mutex::new(pages));
        MemoryDisk { bytes: Arc::new(Mutex::new(bytes)), written, ..MemoryDisk::default() }
    }

    pub fn image(&self) -> Vec<u8> {
        self.bytes.lock().unwrap().clone()
    }

    /// Pages that have been written.
    pub fn used(&self) -> u64 {
        self.written.lock().unwrap().len() as u64
    }
}

impl StorageBackend for MemoryDisk {
    fn len(&self) -> io::Result<u64> {
        Ok(self.bytes.lock().unwrap().len() as u64)
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        self.largest_read.fetch_max(out.len(), Ordering::SeqCst);
        let mut faults = self.faults.lock().unwrap();
        match faults.reads {
            Some((0, kind)) => {
                faults.reads = None;
                return Err(io::Error::from(kind));
            }
            Some((left, kind)) => faults.reads = Some((left - 1, kind)),
            None => {}
        }
        let bytes = self.bytes.lock().unwrap();
        // As the real file does it: zeros beyond its end.
        let from = bytes.len().min(offset as usize);
        let stored = &bytes[from..bytes.len().min(from + out.len())];
        out[..stored.len()].copy_from_slice(stored);
        out[stored.len()..].fill(0);
        Ok(())
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        self.bytes.lock().unwrap().resize(len as usize, 0);
        self.written.lock().unwrap().retain(|page| page * PAGE < len);
        Ok(())
    }

    fn sync_data(&self) -> io::Result<()> {
        Ok(())
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        let mut faults = self.faults.lock().unwrap();
        if let Some(left) = &mut faults.writes {
            if *left == 0 {
                return Err(io::Error::from(ErrorKind::Other));
            }
            *left -= 1;
        }
        let mut written = self.written.lock().unwrap();
        let new: Vec<u64> = (offset / PAGE..(offset + data.len() as u64).div_ceil(PAGE))
            .filter(|page| !written.contains(page))
            .collect();
        let kept_back = faults.reserve.as_ref().and_then(|file| Some(std::fs::metadata(file).ok()?.len()));
        let used = written.len() as u64 + new.len() as u64 + kept_back.unwrap_or(0).div_ceil(PAGE);
        if faults.pages.is_some_and(|pages| used > pages) && !new.is_empty() {
            return Err(io::Error::from(ErrorKind::StorageFull));
        }
        written.extend(new);
        let mut bytes = self.bytes.lock().unwrap();
        let end = offset as usize + data.len();
        if bytes.len() < end {
            bytes.resize(end, 0);
        }
        bytes[offset as usize..end].copy_from_slice(data);
        Ok(())
    }
}
