//! The open database. It goes on after an error of the disk and after a damaged page.
//!
//! redb takes no more work after an error of its disk, and panics at some kinds of damage. Both end the call with a typed
//! error, and the database is opened again if it does not work any more.

use super::checked_pages::CheckedPages;
use crate::store::error::{StoreError, broken, failed};
use redb::{Database, DatabaseError, Durability, ReadableDatabase, StorageBackend, WriteTransaction};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{PoisonError, RwLock};

/// Memory for pages of the database. The default of redb is 1 GiB, more than the 512 MiB of a container.
const CACHE_BYTES: usize = 64 << 20;

/// Opens or creates the database on this storage.
pub fn database(storage: impl StorageBackend) -> Result<Database, DatabaseError> {
    Database::builder().set_cache_size(CACHE_BYTES).create_with_backend(CheckedPages(storage))
}

/// The start of a durable write.
pub fn begin(db: &Database) -> Result<WriteTransaction, StoreError> {
    let mut write = db.begin_write().map_err(failed)?;
    write.set_durability(Durability::Immediate).map_err(failed)?;
    // A database that a killed process left opens at once, whatever its size; each commit costs a little more for it.
    write.set_quick_repair(true);
    Ok(write)
}

/// What `work` returns; a panic inside redb is damage of what it reads.
pub fn caught<T>(work: impl FnOnce() -> Result<T, StoreError>) -> Result<T, StoreError> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or(Err(StoreError::Damaged { key: String::new() }))
}

type Opener = Box<dyn Fn() -> Result<Database, DatabaseError> + Send + Sync>;

/// The database and how it is opened again.
pub struct OpenDatabase {
    opener: Opener,
    /// Without a database: why it could not be opened again.
    open: RwLock<Result<Database, StoreError>>,
    /// A call waits to open the database again: long reads must end.
    is_wanted: AtomicBool,
}

impl OpenDatabase {
    pub fn open(opener: Opener) -> Result<OpenDatabase, DatabaseError> {
        let open = RwLock::new(Ok(opener()?));
        Ok(OpenDatabase { opener, open, is_wanted: AtomicBool::new(false) })
    }

    /// Runs `work`. If the database then takes no more work, it is opened again for the next call.
    pub fn run<T>(&self, work: impl FnOnce(&Database) -> Result<T, StoreError>) -> Result<T, StoreError> {
        let reading = || self.open.read().unwrap_or_else(PoisonError::into_inner);
        if reading().is_err() {
            self.reopen();
        }
        let open = reading();
        let result = match open.as_ref() {
            Ok(db) => caught(|| work(db)),
            Err(reason) => return Err(reason.clone()),
        };
        // Other calls go on while it is looked at: a damaged row or a full disk must not end a backup.
        let is_suspect = result.as_ref().is_err_and(is_of_database);
        if is_suspect && !open.as_ref().is_ok_and(is_usable) {
            drop(open);
            self.reopen();
        }
        result
    }

    /// Opens the database again, unless it works.
    fn reopen(&self) {
        self.is_wanted.store(true, Ordering::SeqCst);
        let mut open = self.open.write().unwrap_or_else(PoisonError::into_inner);
        self.is_wanted.store(false, Ordering::SeqCst);
        if open.as_ref().is_ok_and(is_usable) {
            return;
        }
        // The old one is closed first: it holds the file.
        close(&mut open);
        *open = caught(|| (self.opener)().map_err(failed)).map_err(|error| error.at("database"));
    }

    /// Whether a long read must end, so that the database can be opened again.
    pub fn must_yield(&self) -> bool {
        self.is_wanted.load(Ordering::SeqCst)
    }
}

impl Drop for OpenDatabase {
    fn drop(&mut self) {
        close(self.open.get_mut().unwrap_or_else(PoisonError::into_inner));
    }
}

/// Closes the database. What redb then writes may meet damage, too.
fn close(open: &mut Result<Database, StoreError>) {
    let closed = Err(broken("the database is closed because its disk failed"));
    let old = std::mem::replace(open, closed);
    let dropped = caught(|| {
        drop(old);
        Ok(())
    });
    if dropped.is_err() {
        tracing::error!("the database could not be closed in order: a page is damaged");
    }
}

/// Whether an error may be one of the whole database. A row whose checksum is wrong is named, and is a matter of itself.
fn is_of_database(error: &StoreError) -> bool {
    match error {
        StoreError::Failed(_) | StoreError::Full => true,
        StoreError::Damaged { key } => key.is_empty(),
        _ => false,
    }
}

/// Whether the database still works. Others may use it meanwhile; a write that runs is waited for. One that is damaged
/// where it must write can be read, and might not open again.
fn is_usable(db: &Database) -> bool {
    let works = || {
        db.begin_read().map_err(failed)?;
        db.begin_write().map_err(failed)?.abort().map_err(failed)
    };
    matches!(caught(works), Ok(()) | Err(StoreError::Damaged { .. }))
}
