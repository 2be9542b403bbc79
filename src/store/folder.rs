//! The open data folder: what all calls to the store share.

use super::disk::backend::DataFile;
use super::disk::database::{OpenDatabase, caught, database};
use super::disk::reserve::{Reserve, free_bytes};
use super::error::{StoreError, broken, failed, io_failed};
use super::scan::{Found, head_range, scan};
use super::schema::heads::PlainHead;
use super::schema::migrations::{SCHEMA_VERSION, migrate, schema_of};
use super::schema::tables::HEADS;
use super::schema::usage::{COUNTED, Quota, StoredBytes, UsageTable};
use super::tenant::Tenant;
use object_store::local::LocalFileSystem;
use redb::{Database, DatabaseError, ReadOnlyDatabase, ReadableDatabase};
use std::ops::{Bound, ControlFlow};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::Semaphore;

/// Most store calls that block a thread at a time: redb has one writer, so more calls would only wait.
const MAX_BLOCKING: usize = 8;
/// The file of the database in the folder.
pub const DATABASE_FILE: &str = "vrdp.redb";
/// The folder of the traces' files.
pub const TRACES_FOLDER: &str = "traces";

/// What the disk of a data folder has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StorageState {
    /// Bytes that may still be written; `None`: unknown.
    pub free_bytes: Option<u64>,
    /// The disk was so full that the reserve went to a deletion; nothing is stored until there is space for it again.
    pub is_full: bool,
}

/// An open data folder; one process at a time. It shows one tenant's rows, by keys without the tenant.
#[derive(Clone)]
pub struct Store {
    pub(super) db: Arc<OpenDatabase>,
    pub(super) blobs: Arc<LocalFileSystem>,
    pub(super) traces: Arc<PathBuf>,
    pub(super) reserve: Arc<Reserve>,
    pub(super) usage: Arc<Mutex<UsageTable>>,
    pub(super) quota: Quota,
    pub(super) blocking_permits: Arc<Semaphore>,
    pub(super) tenant: Tenant,
    /// Shows the rows of all tenants, by their whole keys.
    pub(super) everyone: bool,
}

/// The schema version of a database that needs no repair.
fn readable_schema(path: &Path) -> Option<u64> {
    caught(|| schema_of(&ReadOnlyDatabase::open(path).map_err(failed)?)).ok()?
}

impl Store {
    /// Opens or creates the folder, and brings it to the present schema.
    pub fn open(folder: &Path) -> Result<Store, StoreError> {
        let store = Store::opened(folder, |path| database(DataFile::open(path)?), migrate)?;
        let unusable = |e: std::io::Error| StoreError::Unusable {
            path: folder.display().to_string(),
            cause: e.to_string(),
        };
        sweep(&store.traces).map_err(unusable)?;
        Ok(store)
    }

    /// Opens an existing folder of any known schema, and changes nothing in it.
    pub fn open_unchanged(folder: &Path) -> Result<Store, StoreError> {
        if !folder.join(DATABASE_FILE).is_file() {
            let cause = "it has no database".into();
            return Err(StoreError::Unusable { path: folder.display().to_string(), cause });
        }
        Store::opened(folder, |path| database(DataFile::open(path)?), |_| Ok(()))
    }

    /// Opens the folder with a database of this opener, after `prepare`.
    pub(super) fn opened(
        folder: &Path,
        opener: impl Fn(&Path) -> Result<Database, DatabaseError> + Send + Sync + 'static,
        prepare: impl Fn(&Database) -> Result<(), StoreError>,
    ) -> Result<Store, StoreError> {
        let path = || folder.display().to_string();
        // redb panics at some kinds of damage.
        let opened = caught(|| Store::opened_here(folder, opener, prepare));
        opened.map_err(|error| match error {
            StoreError::Failed(cause) => StoreError::Unusable { path: path(), cause },
            StoreError::Full => StoreError::Unusable { path: path(), cause: "its disk is full".into() },
            StoreError::Damaged { .. } => {
                StoreError::Unusable { path: path(), cause: "its database is damaged".into() }
            }
            other => other,
        })
    }

    fn opened_here(
        folder: &Path,
        opener: impl Fn(&Path) -> Result<Database, DatabaseError> + Send + Sync + 'static,
        prepare: impl Fn(&Database) -> Result<(), StoreError>,
    ) -> Result<Store, StoreError> {
        let traces = folder.join(TRACES_FOLDER);
        std::fs::create_dir_all(&traces).map_err(|e| io_failed(&e))?;
        let path = || folder.display().to_string();
        let file = folder.join(DATABASE_FILE);
        let newer = |found| StoreError::Newer { path: path(), found, known: SCHEMA_VERSION };
        // A newer database is not modified. One that needs a repair shows its version below.
        if let Some(found) = readable_schema(&file).filter(|found| *found > SCHEMA_VERSION) {
            return Err(newer(found));
        }
        let is_new = std::fs::metadata(&file).map_or(true, |m| m.len() == 0);
        let has_traces = std::fs::read_dir(&traces).map_err(|e| io_failed(&e))?.next().is_some();
        if is_new && has_traces {
            return Err(StoreError::DatabaseGone { path: path() });
        }
        let db = OpenDatabase::open(Box::new(move || opener(&file))).map_err(|e| match e {
            DatabaseError::DatabaseAlreadyOpen => StoreError::Locked { path: path() },
            other => failed(other),
        })?;
        let reserve = Reserve::new(folder);
        let prepared = || {
            db.run(|db| match schema_of(db)? {
                Some(found) if found > SCHEMA_VERSION => Err(newer(found)),
                // An interrupted creation leaves a database without tables.
                None if !is_new
                    && db.begin_read().map_err(failed)?.list_tables().map_err(failed)?.next().is_some() =>
                {
                    Err(StoreError::Damaged { key: String::new() })
                }
                _ => prepare(db),
            })
        };
        match prepared() {
            Err(StoreError::Full) if reserve.release() => prepared()?,
            done => done?,
        }
        let usage = db.run(stored_bytes)?;
        let blobs = LocalFileSystem::new_with_prefix(&traces).map_err(broken)?.with_fsync(true);
        Ok(Store {
            db: Arc::new(db),
            blobs: Arc::new(blobs),
            traces: Arc::new(traces),
            reserve: Arc::new(reserve),
            usage: Arc::new(Mutex::new(usage)),
            quota: Quota::default(),
            blocking_permits: Arc::new(Semaphore::new(MAX_BLOCKING)),
            tenant: Tenant::default(),
            everyone: false,
        })
    }

    /// The same folder, as a tenant sees it.
    pub fn of(&self, tenant: &Tenant) -> Store {
        Store { tenant: tenant.clone(), everyone: false, ..self.clone() }
    }

    /// The same folder with the rows of all tenants, by their whole keys.
    pub fn of_everyone(&self) -> Store {
        Store { tenant: Tenant::default(), everyone: true, ..self.clone() }
    }

    /// The same folder, of which each tenant may fill so much.
    pub fn with_quota(self, quota: Quota) -> Store {
        Store { quota, ..self }
    }

    /// Keeps back so many bytes of the disk for deletions; 0: none.
    pub fn keep_reserve(&self, bytes: u64) -> Result<(), StoreError> {
        self.reserve.set(bytes)
    }

    /// Whether space that should be kept back is not: it went to a deletion, or there was no room for it.
    pub fn lacks_reserve(&self) -> bool {
        self.reserve.is_missing()
    }

    /// Makes the reserve whole again, if there is space.
    pub fn rebuild_reserve(&self) -> Result<(), StoreError> {
        self.reserve.rebuild()
    }

    /// What the disk has.
    pub fn storage(&self) -> StorageState {
        StorageState { free_bytes: free_bytes(&self.traces), is_full: self.reserve.is_spent() }
    }

    /// What the tenant has stored.
    pub fn stored_bytes(&self) -> StoredBytes {
        self.usage.lock().unwrap_or_else(PoisonError::into_inner).of(&self.tenant)
    }

    /// The tenants that have stored more bytes of traces, and how many each has.
    pub fn tenants_with_more_traces(&self, than: u64) -> Vec<(Tenant, u64)> {
        self.usage.lock().unwrap_or_else(PoisonError::into_inner).with_more_traces(than)
    }

    /// The whole key of one of the tenant's rows.
    pub fn key(&self, key: &str) -> String {
        format!("{}{key}", self.tenant.prefix())
    }

    /// Runs `work`, which is about this record, on a thread that may block.
    pub(super) async fn blocking<T, F>(&self, record: String, work: F) -> Result<T, StoreError>
    where
        T: Send + 'static,
        F: FnOnce(&Database) -> Result<T, StoreError> + Send + 'static,
    {
        let permit = self.blocking_permits.clone().acquire_owned().await.map_err(broken)?;
        let db = self.db.clone();
        // The task owns the permit: a caller who leaves does not free it while the work still runs.
        let task = tokio::task::spawn_blocking(move || {
            let _permit = permit;
            db.run(work).map_err(|error| error.at(&record))
        });
        task.await.map_err(broken)?
    }

    /// Runs `work`, which frees space. On a full disk it runs again in the space of the reserve.
    pub(super) async fn freeing<T, F>(&self, record: String, work: F) -> Result<T, StoreError>
    where
        T: Send + 'static,
        F: Fn(&Database) -> Result<T, StoreError> + Clone + Send + 'static,
    {
        match self.blocking(record.clone(), work.clone()).await {
            Err(StoreError::Full) if self.reserve.release() => {
                let done = self.blocking(record, work).await;
                // It may not fit yet; it is tried again.
                let _ = self.reserve.rebuild();
                done
            }
            done => done,
        }
    }
}

/// Sums the bytes of all tenants. Damaged heads count nothing.
fn stored_bytes(db: &Database) -> Result<UsageTable, StoreError> {
    let mut usage = UsageTable::default();
    let read = db.begin_read().map_err(failed)?;
    let heads = match read.open_table(HEADS) {
        // A folder of an older schema that is only looked at.
        Err(redb::TableError::TableDoesNotExist(_)) => return Ok(usage),
        heads => heads.map_err(failed)?,
    };
    for kind in COUNTED {
        let mut sum = |found: Found| {
            if let Found::Row(head_key, row) = found
                && let Some((_, key)) = head_key.split_once('/')
                && let Some(head) = PlainHead::read(head_key, row)
            {
                usage.change(kind, key, 0, head.bytes);
            }
            Ok(ControlFlow::Continue(()))
        };
        scan(&heads, head_range(kind, (Bound::Unbounded, Bound::Unbounded)), &mut sum)?;
    }
    Ok(usage)
}

/// Removes files that a killed process has not finished; they have a `#` in their names.
fn sweep(traces: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(traces)? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().contains('#') {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}
