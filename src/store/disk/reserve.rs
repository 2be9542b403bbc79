//! Space that is kept back, so that deletions work on a full disk.
//!
//! A deletion writes before it frees. If it finds the disk full, the reserve's file is removed, and the deletion runs
//! again in its space. Until the reserve is whole again, nothing else is stored: it would take the space that the next
//! deletion needs.

use crate::store::error::{StoreError, io_failed};
use rustix::fs::{FallocateFlags, fallocate, statvfs};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

const FILE_NAME: &str = "reserve";

/// Bytes that this process may still write to the folder's disk; `None`: unknown.
pub fn free_bytes(folder: &Path) -> Option<u64> {
    let disk = statvfs(folder).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

/// The file that keeps space back.
#[derive(Debug)]
pub struct Reserve {
    file: PathBuf,
    bytes: AtomicU64,
    /// It existed in this process, and was given to a deletion.
    is_spent: AtomicBool,
    /// It should exist and does not.
    is_missing: AtomicBool,
}

impl Reserve {
    pub fn new(folder: &Path) -> Reserve {
        let (bytes, [is_spent, is_missing]) = (AtomicU64::new(0), [false; 2].map(AtomicBool::new));
        Reserve { file: folder.join(FILE_NAME), bytes, is_spent, is_missing }
    }

    /// Keeps back so many bytes from now on; 0: none.
    pub fn set(&self, bytes: u64) -> Result<(), StoreError> {
        self.bytes.store(bytes, Ordering::SeqCst);
        match bytes {
            0 => match std::fs::remove_file(&self.file) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => Err(io_failed(&error)),
                _ => Ok(()),
            },
            _ => self.rebuild(),
        }
    }

    /// Makes the reserve whole, if there is space for it.
    pub fn rebuild(&self) -> Result<(), StoreError> {
        let bytes = self.bytes.load(Ordering::SeqCst);
        let made = match bytes == 0
            || std::fs::metadata(&self.file).is_ok_and(|file| file.is_file() && file.len() == bytes)
        {
            true => Ok(()),
            false => File::create(&self.file).and_then(|file| {
                fallocate(&file, FallocateFlags::empty(), 0, bytes)?;
                file.sync_all()
            }),
        };
        self.is_missing.store(made.is_err(), Ordering::SeqCst);
        match made {
            Ok(()) => {
                self.is_spent.store(false, Ordering::SeqCst);
                Ok(())
            }
            Err(error) => {
                let _ = std::fs::remove_file(&self.file);
                Err(io_failed(&error))
            }
        }
    }

    /// Gives the space to a deletion; `false`: there is none to give.
    pub fn release(&self) -> bool {
        let released = std::fs::remove_file(&self.file).is_ok();
        if released {
            self.is_spent.store(true, Ordering::SeqCst);
            self.is_missing.store(true, Ordering::SeqCst);
            tracing::warn!("the disk is full: the reserve was released for a deletion");
        }
        released
    }

    /// Refuses to store anything while deletions need the space.
    pub fn admit(&self) -> Result<(), StoreError> {
        if self.is_spent.load(Ordering::SeqCst) && self.rebuild().is_err() {
            return Err(StoreError::Full);
        }
        Ok(())
    }

    /// Whether it should exist and does not: deletions have taken it, or there was no room for it.
    pub fn is_missing(&self) -> bool {
        self.is_missing.load(Ordering::SeqCst)
    }

    /// Whether deletions have taken it.
    pub fn is_spent(&self) -> bool {
        self.is_spent.load(Ordering::SeqCst)
    }
}
