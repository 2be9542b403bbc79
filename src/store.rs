//! The data folder: videos, fits, studies, operations and trace records in one redb file, trace files in a folder beside it.
//!
//! Guarantees:
//! * A value is durable when `put` returns; a killed process leaves whole values or none.
//! * A file is published whole or not at all; its record is written after it and deleted before it.
//! * What belongs to a video is stored only while the video exists, in one transaction with that check.
//! * Each row has a checksum. A damaged row is reported under its key and hides no other row.
//! * After an I/O error the database takes no more work until it is opened again, which the next call does.
//! * Each tenant sees its own rows only; the tenant is part of the key.
//!
//! Rows of older programs stay readable: stored names of fields never change, new fields have defaults. Ids of results
//! hold the program's version and its numeric fingerprint, so results of older programs are listed but not reused.

mod operations;

use bytes::Bytes;
use object_store::local::LocalFileSystem;
use object_store::path::Path as BlobPath;
use object_store::{GetResultPayload, ObjectStore, ObjectStoreExt, PutMode, PutOptions};
use redb::{
    Database, DatabaseError, Durability, ReadOnlyDatabase, ReadableDatabase, ReadableTable, TableDefinition,
    WriteTransaction,
};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::File;
use std::ops::Bound;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::{SystemTime, UNIX_EPOCH};
use tokio::sync::Semaphore;

/// Layout of the tables; a store with a newer one is refused.
pub const SCHEMA_VERSION: u64 = 1;
/// Most store calls that block a thread at a time: redb has one writer, so more calls would only wait.
const MAX_BLOCKING: usize = 8;
/// Memory for pages of the database. The default of redb is 1 GiB, more than the 512 MiB of a container.
const CACHE_BYTES: usize = 64 << 20;

type RowTable = TableDefinition<'static, &'static str, &'static [u8]>;
const META: TableDefinition<&str, u64> = TableDefinition::new("meta");
/// When rows were stored first (milliseconds after 1970), by `{table}/{key}`; rows of older programs have none.
const TIMES: TableDefinition<&str, u64> = TableDefinition::new("times");
/// Bytes of the results of operations, by the operation's key.
const OPERATION_RESULTS: RowTable = TableDefinition::new("operation_results");

/// A table of CBOR values: fields have names as in JSON, and infinite bounds can be stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableKind {
    /// By video id.
    Videos,
    /// By `{video}/{model}`.
    Fits,
    /// By `{first video}/{study}`.
    Studies,
    /// By `{video}/stills`: frames of the video file as pictures.
    Stills,
    /// By trace id; the value has a `video`.
    Traces,
    /// By operation id; the value has `videos`.
    Operations,
    /// By lexicon id.
    Lexica,
}

const TABLES: [TableKind; 7] = [
    TableKind::Videos,
    TableKind::Fits,
    TableKind::Studies,
    TableKind::Stills,
    TableKind::Traces,
    TableKind::Operations,
    TableKind::Lexica,
];

impl TableKind {
    fn table(self) -> RowTable {
        TableDefinition::new(self.name())
    }

    fn name(self) -> &'static str {
        match self {
            TableKind::Videos => "videos",
            TableKind::Fits => "fits",
            TableKind::Studies => "studies",
            TableKind::Stills => "stills",
            TableKind::Traces => "traces",
            TableKind::Operations => "operations",
            TableKind::Lexica => "lexica",
        }
    }

    /// Whether it is kept when its rows were stored first.
    fn has_times(self) -> bool {
        matches!(self, TableKind::Videos | TableKind::Fits)
    }

    /// The key of the time of one of its rows.
    fn time_key(self, key: &str) -> String {
        format!("{}/{key}", self.name())
    }
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StoreError {
    #[error("data folder {path} is in use by another process; stop it, or choose another --data-dir")]
    Locked { path: String },
    #[error(
        "data folder {path} has schema version {found}, this program knows {known}; use a newer program, or \
         another --data-dir"
    )]
    Newer { path: String, found: u64, known: u64 },
    #[error(
        "data folder {path} cannot be used: {cause}; make it writable, restore it from a copy if it is damaged, or choose another --data-dir"
    )]
    Unusable { path: String, cause: String },
    #[error("the video was deleted meanwhile")]
    VideoGone,
    #[error(
        "the file of trace {id} is missing in the data folder; request the simulation again to rebuild it"
    )]
    FileGone { id: String },
    #[error(
        "the record {key} of the data folder is damaged; post the video or send the request again, or restore the folder from a copy"
    )]
    Damaged { key: String },
    #[error(
        "storage failed: {0}; check free space and permissions of the service's data folder, then try again"
    )]
    Failed(String),
}

/// A value with its key and the time at which it was stored first (milliseconds after 1970).
#[derive(Debug, Clone, PartialEq)]
pub struct TimedRow<T> {
    pub key: String,
    pub value: T,
    pub created_ms: Option<u64>,
}

/// Milliseconds after 1970.
pub fn now_ms() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_millis() as u64)
}

/// The field of a value that names its video.
#[derive(serde::Deserialize)]
struct OfVideo {
    video: String,
}

/// The field of a value that names its videos.
#[derive(serde::Deserialize)]
struct OfVideos {
    videos: Vec<String>,
}

/// Opens or creates the database.
fn database(path: &Path) -> Result<Database, DatabaseError> {
    Database::builder().set_cache_size(CACHE_BYTES).create(path)
}

/// The schema version of a database that needs no repair.
fn schema(path: &Path) -> Option<u64> {
    let read = ReadOnlyDatabase::open(path).ok()?.begin_read().ok()?;
    read.open_table(META).ok()?.get("schema").ok()?.map(|v| v.value())
}

/// The database; after an error of its disk it takes no more work until it is opened again.
struct Db {
    path: PathBuf,
    open: RwLock<Option<Database>>,
}

impl Db {
    /// Runs `work`. If the disk failed, the database is opened again for the next call.
    fn run<T>(&self, work: impl FnOnce(&Database) -> Result<T, StoreError>) -> Result<T, StoreError> {
        let usable = |db: &Database| db.begin_write().is_ok();
        let result = match self.open.read().unwrap_or_else(PoisonError::into_inner).as_ref() {
            Some(db) => work(db),
            None => Err(StoreError::Failed("the database is closed because its disk failed".into())),
        };
        if matches!(result, Err(StoreError::Failed(_))) {
            let mut open = self.open.write().unwrap_or_else(PoisonError::into_inner);
            if !open.as_ref().is_some_and(usable) {
                *open = None;
                *open = Some(database(&self.path).map_err(failed)?);
            }
        }
        result
    }
}

/// The owner of rows: each tenant has rows of its own in the same folder. The default is the unnamed tenant.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Tenant {
    /// The start of every key. `~` sorts after all characters of ids, so that the rows of a tenant follow those without a name.
    prefix: Arc<str>,
}

impl Default for Tenant {
    fn default() -> Self {
        Tenant { prefix: "".into() }
    }
}

impl Tenant {
    /// A name of 1 to 40 of `a-z`, `0-9`, `-` and `_`.
    pub fn new(name: &str) -> Option<Tenant> {
        let plain = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-' || b == b'_';
        let fine = (1..=40).contains(&name.len()) && name.bytes().all(plain);
        fine.then(|| Tenant { prefix: format!("~{name}/").into() })
    }

    pub fn is_unnamed(&self) -> bool {
        self.prefix.is_empty()
    }

    /// Its name; empty for the unnamed tenant.
    pub fn name(&self) -> &str {
        self.prefix.trim_start_matches('~').trim_end_matches('/')
    }

    fn owns(&self, key: &str) -> bool {
        if self.is_unnamed() { !key.starts_with('~') } else { key.starts_with(&*self.prefix) }
    }
}

/// An open data folder; one process at a time. It shows one tenant's rows, by keys without the tenant.
#[derive(Clone)]
pub struct Store {
    db: Arc<Db>,
    blobs: Arc<LocalFileSystem>,
    blocking_permits: Arc<Semaphore>,
    tenant: Tenant,
    /// Shows the rows of all tenants, by their whole keys.
    everyone: bool,
}

impl Store {
    /// Opens or creates the folder.
    pub fn open(folder: &Path) -> Result<Store, StoreError> {
        // redb panics at some kinds of damage.
        let opened = std::panic::catch_unwind(|| Store::open_here(folder));
        let opened = opened.unwrap_or_else(|_| Err(StoreError::Failed("the database is damaged".into())));
        opened.map_err(|error| match error {
            StoreError::Failed(cause) => StoreError::Unusable { path: folder.display().to_string(), cause },
            other => other,
        })
    }

    fn open_here(folder: &Path) -> Result<Store, StoreError> {
        let traces = folder.join("traces");
        std::fs::create_dir_all(&traces).map_err(failed)?;
        let path = || folder.display().to_string();
        let file = folder.join("vrdp.redb");
        let newer = |found| StoreError::Newer { path: path(), found, known: SCHEMA_VERSION };
        // A newer database is not modified. One that needs a repair shows its version below.
        if let Some(found) = schema(&file).filter(|found| *found > SCHEMA_VERSION) {
            return Err(newer(found));
        }
        let is_new = std::fs::metadata(&file).map_or(true, |m| m.len() == 0);
        if is_new && std::fs::read_dir(&traces).map_err(failed)?.next().is_some() {
            tracing::error!(
                folder = path(),
                "the database is missing although there are traces: restore it from a copy"
            );
        }
        let db = database(&file).map_err(|e| match e {
            DatabaseError::DatabaseAlreadyOpen => StoreError::Locked { path: path() },
            other => failed(other),
        })?;
        let write = begin(&db)?;
        {
            let mut meta = write.open_table(META).map_err(failed)?;
            let found = meta.get("schema").map_err(failed)?.map(|v| v.value());
            match found {
                Some(found) if found > SCHEMA_VERSION => {
                    return Err(newer(found));
                }
                _ => meta.insert("schema", SCHEMA_VERSION).map_err(failed)?,
            };
            for kind in TABLES {
                write.open_table(kind.table()).map_err(failed)?;
            }
            write.open_table(OPERATION_RESULTS).map_err(failed)?;
            write.open_table(TIMES).map_err(failed)?;
        }
        write.commit().map_err(failed)?;
        sweep(&traces)?;
        let blobs = LocalFileSystem::new_with_prefix(&traces).map_err(failed)?.with_fsync(true);
        let db = Db { path: file, open: RwLock::new(Some(db)) };
        let (blobs, blocking_permits) = (Arc::new(blobs), Arc::new(Semaphore::new(MAX_BLOCKING)));
        Ok(Store { db: Arc::new(db), blobs, blocking_permits, tenant: Tenant::default(), everyone: false })
    }

    /// The same folder, as a tenant sees it.
    pub fn of(&self, tenant: &Tenant) -> Store {
        Store { tenant: tenant.clone(), everyone: false, ..self.clone() }
    }

    /// The same folder with the rows of all tenants, by their whole keys.
    pub fn of_everyone(&self) -> Store {
        Store { tenant: Tenant::default(), everyone: true, ..self.clone() }
    }

    /// The whole key of one of the tenant's rows.
    pub fn key(&self, key: &str) -> String {
        format!("{}{key}", self.tenant.prefix)
    }

    pub async fn get<T>(&self, kind: TableKind, key: &str) -> Result<Option<T>, StoreError>
    where
        T: DeserializeOwned + Send + 'static,
    {
        let key = self.key(key);
        self.blocking(move |db| {
            let read = db.begin_read().map_err(failed)?;
            let table = read.open_table(kind.table()).map_err(failed)?;
            let found = table.get(key.as_str()).map_err(failed)?;
            found.map(|v| decode(&key, v.value())).transpose()
        })
        .await
    }

    /// Up to `limit` values that `keep` accepts, whose keys start with `prefix` and come after `after`, by key.
    pub async fn list<T, K>(
        &self,
        kind: TableKind,
        prefix: &str,
        after: &str,
        limit: usize,
        keep: K,
    ) -> Result<Vec<(String, T)>, StoreError>
    where
        T: DeserializeOwned + Send + 'static,
        K: Fn(&T) -> bool + Send + 'static,
    {
        let rows = self.list_with_times(kind, prefix, after, limit, move |value, _| keep(value)).await?;
        Ok(rows.into_iter().map(|row| (row.key, row.value)).collect())
    }

    /// When a row was stored first (milliseconds after 1970).
    pub async fn created_ms(&self, kind: TableKind, key: &str) -> Result<Option<u64>, StoreError> {
        let key = kind.time_key(&self.key(key));
        self.blocking(move |db| {
            let read = db.begin_read().map_err(failed)?;
            let times = read.open_table(TIMES).map_err(failed)?;
            Ok(times.get(key.as_str()).map_err(failed)?.map(|ms| ms.value()))
        })
        .await
    }

    /// The same as `list`, with the times at which the rows were stored first (milliseconds after 1970).
    pub async fn list_with_times<T, K>(
        &self,
        kind: TableKind,
        prefix: &str,
        after: &str,
        limit: usize,
        keep: K,
    ) -> Result<Vec<TimedRow<T>>, StoreError>
    where
        T: DeserializeOwned + Send + 'static,
        K: Fn(&T, Option<u64>) -> bool + Send + 'static,
    {
        let (prefix, after) = (self.key(prefix), self.key(after));
        let (tenant, everyone) = (self.tenant.clone(), self.everyone);
        self.blocking(move |db| {
            let read = db.begin_read().map_err(failed)?;
            let table = read.open_table(kind.table()).map_err(failed)?;
            let times = read.open_table(TIMES).map_err(failed)?;
            let from = if after > prefix { Bound::Excluded(&*after) } else { Bound::Included(&*prefix) };
            let rows = table.range::<&str>((from, Bound::Unbounded)).map_err(failed)?;
            let mut found = Vec::new();
            for row in rows {
                let (key, value) = row.map_err(failed)?;
                let key = key.value();
                let ours = everyone || tenant.owns(key);
                if found.len() == limit || !ours || !key.starts_with(&prefix) {
                    break;
                }
                // A damaged row is skipped in lists; a request for its key returns the error.
                let Ok(value) = decode(key, value.value()) else { continue };
                let created_ms = match kind.has_times() {
                    true => times.get(kind.time_key(key).as_str()).map_err(failed)?.map(|ms| ms.value()),
                    false => None,
                };
                if keep(&value, created_ms) {
                    let key = key.strip_prefix(&*tenant.prefix).unwrap_or(key).to_string();
                    found.push(TimedRow { key, value, created_ms });
                }
            }
            Ok(found)
        })
        .await
    }

    /// Stores a video; durable when it returns.
    pub async fn put_video<T: Serialize>(&self, id: &str, value: &T) -> Result<(), StoreError> {
        self.put(TableKind::Videos, self.key(id), value, None).await
    }

    /// Stores a lexicon; durable when it returns.
    pub async fn put_lexicon<T: Serialize>(&self, id: &str, value: &T) -> Result<(), StoreError> {
        self.put(TableKind::Lexica, self.key(id), value, None).await
    }

    /// Deletes a lexicon; `false` if it does not exist.
    pub async fn delete_lexicon(&self, id: &str) -> Result<bool, StoreError> {
        self.remove(TableKind::Lexica, self.key(id)).await
    }

    /// Removes a row; `false` if it does not exist.
    async fn remove(&self, kind: TableKind, key: String) -> Result<bool, StoreError> {
        self.blocking(move |db| {
            let write = begin(db)?;
            let found = {
                let mut table = write.open_table(kind.table()).map_err(failed)?;
                table.remove(key.as_str()).map_err(failed)?.is_some()
            };
            write.commit().map_err(failed)?;
            Ok(found)
        })
        .await
    }

    /// Stores a value that belongs to a video, unless the video was deleted meanwhile; durable when it returns.
    pub async fn put_of_video<T>(
        &self,
        kind: TableKind,
        video: &str,
        key: &str,
        value: &T,
    ) -> Result<(), StoreError>
    where
        T: Serialize,
    {
        self.put(kind, self.key(key), value, Some(self.key(video))).await
    }

    async fn put<T: Serialize>(
        &self,
        kind: TableKind,
        key: String,
        value: &T,
        video: Option<String>,
    ) -> Result<(), StoreError> {
        let value = encode(value)?;
        self.blocking(move |db| {
            let write = begin(db)?;
            if let Some(video) = video {
                let videos = write.open_table(TableKind::Videos.table()).map_err(failed)?;
                if videos.get(video.as_str()).map_err(failed)?.is_none() {
                    return Err(StoreError::VideoGone);
                }
            }
            {
                let mut table = write.open_table(kind.table()).map_err(failed)?;
                table.insert(key.as_str(), value.as_slice()).map_err(failed)?;
                if kind.has_times() {
                    let (mut times, key) = (write.open_table(TIMES).map_err(failed)?, kind.time_key(&key));
                    if times.get(key.as_str()).map_err(failed)?.is_none() {
                        times.insert(key.as_str(), now_ms()).map_err(failed)?;
                    }
                }
            }
            write.commit().map_err(failed)
        })
        .await
    }

    /// Deletes a video with its models, studies, stills, operations and traces; `false` if it does not exist.
    pub async fn delete_video(&self, id: &str) -> Result<bool, StoreError> {
        let (video, row, tenant) = (id.to_string(), self.key(id), self.tenant.clone());
        let (found, traces) = self
            .blocking(move |db| {
                let write = begin(db)?;
                let mut traces = Vec::new();
                let found = {
                    let mut videos = write.open_table(TableKind::Videos.table()).map_err(failed)?;
                    videos.remove(row.as_str()).map_err(failed)?.is_some()
                };
                {
                    let prefix = format!("{row}/");
                    let mut times = write.open_table(TIMES).map_err(failed)?;
                    times.remove(TableKind::Videos.time_key(&row).as_str()).map_err(failed)?;
                    for kind in [TableKind::Fits, TableKind::Studies, TableKind::Stills] {
                        let mut rows = write.open_table(kind.table()).map_err(failed)?;
                        rows.retain(|key, _| !key.starts_with(&prefix)).map_err(failed)?;
                        let of_video = kind.time_key(&prefix);
                        times.retain(|key, _| !key.starts_with(&of_video)).map_err(failed)?;
                    }
                    let mut table = write.open_table(TableKind::Traces.table()).map_err(failed)?;
                    let of_video = |key: &str, value: &[u8]| {
                        tenant.owns(key) && decode::<OfVideo>(key, value).is_ok_and(|v| v.video == video)
                    };
                    for row in table.extract_if(of_video).map_err(failed)? {
                        traces.push(row.map_err(failed)?.0.value().to_string());
                    }
                }
                delete_operations_of(&write, &tenant, &video)?;
                write.commit().map_err(failed)?;
                Ok((found, traces))
            })
            .await?;
        for trace in traces {
            self.delete_blob(&trace).await?;
        }
        Ok(found)
    }

    /// Publishes a blob whole or not at all; durable when it returns. Publishing the same blob again changes nothing, unless
    /// the disk has damaged it: then it is written again.
    pub async fn put_blob(&self, id: &str, bytes: Bytes) -> Result<(), StoreError> {
        let _permit = self.blocking_permits.acquire().await.map_err(failed)?;
        let path = blob(&self.key(id));
        let create = PutOptions { mode: PutMode::Create, ..PutOptions::default() };
        match self.blobs.put_opts(&path, bytes.clone().into(), create).await {
            Ok(_) => Ok(()),
            Err(object_store::Error::AlreadyExists { .. }) => {
                let known = self.blobs.get(&path).await.map_err(failed)?.bytes().await.map_err(failed)?;
                if known != bytes {
                    tracing::warn!(trace = id, "a damaged file was written again");
                    self.blobs.put(&path, bytes.into()).await.map_err(failed)?;
                }
                Ok(())
            }
            Err(error) => Err(failed(error)),
        }
    }

    /// Bytes of a blob's file.
    pub async fn blob_size(&self, id: &str) -> Result<u64, StoreError> {
        let found = self.blobs.head(&blob(&self.key(id))).await;
        found.map(|meta| meta.size).map_err(|error| unread(id, error))
    }

    /// Bytes `offset..offset + len` of a blob; fewer at its end.
    pub async fn read_blob(&self, id: &str, offset: u64, len: u64) -> Result<Bytes, StoreError> {
        let read = self.blobs.get_range(&blob(&self.key(id)), offset..offset + len).await;
        read.map_err(|error| unread(id, error))
    }

    /// A blob as an open file.
    pub async fn open_blob(&self, id: &str) -> Result<File, StoreError> {
        let found = self.blobs.get(&blob(&self.key(id))).await.map_err(|error| unread(id, error))?;
        match found.payload {
            GetResultPayload::File(file, _) => Ok(file),
            GetResultPayload::Stream(_) => Err(StoreError::Failed(format!("blob {id} is no local file"))),
        }
    }

    /// Deletes a trace: first its record, so that it is no longer listed, then its blob.
    pub async fn delete_trace(&self, id: &str) -> Result<(), StoreError> {
        let key = self.key(id);
        self.remove(TableKind::Traces, key.clone()).await?;
        self.delete_blob(&key).await
    }

    async fn delete_blob(&self, key: &str) -> Result<(), StoreError> {
        match self.blobs.delete(&blob(key)).await {
            Err(object_store::Error::NotFound { .. }) | Ok(()) => Ok(()),
            Err(error) => Err(failed(error)),
        }
    }

    async fn blocking<T, F>(&self, work: F) -> Result<T, StoreError>
    where
        T: Send + 'static,
        F: FnOnce(&Database) -> Result<T, StoreError> + Send + 'static,
    {
        let permit = self.blocking_permits.clone().acquire_owned().await.map_err(failed)?;
        let db = self.db.clone();
        // The task owns the permit: a caller who leaves does not free it while the work still runs.
        let task = tokio::task::spawn_blocking(move || {
            let _permit = permit;
            db.run(work)
        });
        task.await.map_err(failed)?
    }
}

fn encode<T: Serialize>(value: &T) -> Result<Vec<u8>, StoreError> {
    let mut bytes = Vec::new();
    ciborium::into_writer(value, &mut bytes).map_err(failed)?;
    Ok(sealed(bytes))
}

/// Bytes with their checksum.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let sum = crc32fast::hash(&bytes);
    bytes.extend(sum.to_le_bytes());
    bytes
}

/// The bytes, if their checksum holds.
fn unsealed(row: &[u8]) -> Option<&[u8]> {
    let (bytes, sum) = row.split_last_chunk()?;
    (crc32fast::hash(bytes).to_le_bytes() == *sum).then_some(bytes)
}

fn damaged(key: &str) -> StoreError {
    tracing::error!(key, "a record of the data folder is damaged");
    StoreError::Damaged { key: key.into() }
}

/// A value whose checksum holds; rows of older programs have none.
fn decode<T: DeserializeOwned>(key: &str, row: &[u8]) -> Result<T, StoreError> {
    let mut rest = unsealed(row).unwrap_or(row);
    match ciborium::from_reader(&mut rest) {
        Ok(value) if rest.is_empty() => Ok(value),
        _ => Err(damaged(key)),
    }
}

/// Deletes the operations about a video, with their results.
fn delete_operations_of(write: &WriteTransaction, tenant: &Tenant, video: &str) -> Result<(), StoreError> {
    let mut records = write.open_table(TableKind::Operations.table()).map_err(failed)?;
    let mut results = write.open_table(OPERATION_RESULTS).map_err(failed)?;
    let of_video = |key: &str, value: &[u8]| {
        tenant.owns(key) && decode::<OfVideos>(key, value).is_ok_and(|v| v.videos.iter().any(|v| v == video))
    };
    for row in records.extract_if(of_video).map_err(failed)? {
        results.remove(row.map_err(failed)?.0.value()).map_err(failed)?;
    }
    Ok(())
}

fn begin(db: &Database) -> Result<WriteTransaction, StoreError> {
    let mut write = db.begin_write().map_err(failed)?;
    write.set_durability(Durability::Immediate).map_err(failed)?;
    // A database that a killed process left opens at once, whatever its size; each commit costs a little more for it.
    write.set_quick_repair(true);
    Ok(write)
}

/// Removes files that a killed process has not finished; they have a `#` in their names.
fn sweep(traces: &Path) -> Result<(), StoreError> {
    for entry in std::fs::read_dir(traces).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        if entry.file_name().to_string_lossy().contains('#') {
            std::fs::remove_file(entry.path()).map_err(failed)?;
        }
    }
    Ok(())
}

/// The file of a trace, by its whole key.
fn blob(key: &str) -> BlobPath {
    BlobPath::from(format!("{}.mcap", key.trim_start_matches('~').replace('/', ".")))
}

/// Why a blob cannot be read.
fn unread(id: &str, error: object_store::Error) -> StoreError {
    match error {
        object_store::Error::NotFound { .. } => StoreError::FileGone { id: id.into() },
        error => failed(error),
    }
}

fn failed(error: impl std::fmt::Display) -> StoreError {
    StoreError::Failed(error.to_string())
}

#[cfg(test)]
mod tests;
