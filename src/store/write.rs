//! Stores and deletes rows, each with its head, within the tenant's quota.

use super::disk::database::{begin, caught};
use super::error::{StoreError, failed};
use super::folder::Store;
use super::scan::{Found, KeyRange, head_range, scan};
use super::schema::heads::{PlainHead, RowHead, VideoHead};
use super::schema::rows::{encode, readable, sealed};
use super::schema::tables::{HEADS, OPERATION_RESULTS, TableKind};
use crate::scene::Scene;
use redb::{Database, ReadableDatabase, ReadableTable, Table, WriteTransaction};
use serde::Serialize;
use std::ops::ControlFlow;
use std::sync::PoisonError;
use std::time::{SystemTime, UNIX_EPOCH};

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

/// A row that is to be stored.
struct NewRow {
    kind: TableKind,
    /// The whole key.
    key: String,
    row: Vec<u8>,
    /// Bytes that count towards the quota.
    bytes: u64,
    shown: Option<VideoHead>,
    /// The whole key of the video that must exist.
    video: Option<String>,
    /// Bytes of an operation beside its record.
    beside: Option<Vec<u8>>,
}

/// A row that was removed.
struct Removed {
    kind: TableKind,
    key: String,
    bytes: u64,
}

type Heads<'t> = Table<'t, &'static str, &'static [u8]>;

impl Store {
    /// Stores a video; durable when it returns.
    pub async fn put_video(&self, id: &str, scene: &Scene) -> Result<(), StoreError> {
        let key = self.key(id);
        let row = encode(&key, scene)?;
        let (bytes, shown) = (row.len() as u64, Some(VideoHead::of(scene)));
        self.put(NewRow { kind: TableKind::Videos, key, row, bytes, shown, video: None, beside: None }).await
    }

    /// Stores a lexicon; durable when it returns.
    pub async fn put_lexicon<T: Serialize>(&self, id: &str, value: &T) -> Result<(), StoreError> {
        self.put(NewRow::plain(TableKind::Lexica, self.key(id), value)?).await
    }

    /// Stores the record of a new operation with its request; durable when it returns.
    pub async fn put_operation<T: Serialize>(
        &self,
        id: &str,
        record: &T,
        request: Vec<u8>,
    ) -> Result<(), StoreError> {
        let row = NewRow::plain(TableKind::Operations, self.key(id), record)?;
        self.put(NewRow { beside: Some(sealed(&row.key, request)), ..row }).await
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
        let row = NewRow::plain(kind, self.key(key), value)?;
        self.put(NewRow { video: Some(self.key(video)), ..row }).await
    }

    /// Stores the record of a trace, whose file has so many bytes, unless the video was deleted meanwhile; durable when it
    /// returns.
    pub async fn put_trace<T: Serialize>(
        &self,
        video: &str,
        id: &str,
        record: &T,
        bytes: u64,
    ) -> Result<(), StoreError> {
        let row = NewRow::plain(TableKind::Traces, self.key(id), record)?;
        self.put(NewRow { bytes, video: Some(self.key(video)), ..row }).await
    }

    /// Refuses a trace file of so many bytes if its tenant would then have more than its quota, or if the disk is full.
    pub async fn admit_trace(&self, id: &str, bytes: u64) -> Result<(), StoreError> {
        // Usual traces wait for no thread.
        if self.quota.trace_bytes.is_none() && !self.reserve.is_spent() {
            return Ok(());
        }
        let (key, quota, usage) = (self.key(id), self.quota, self.usage.clone());
        let reserve = self.reserve.clone();
        self.blocking(TableKind::Traces.head_key(&key), move |db| {
            reserve.admit()?;
            if quota.trace_bytes.is_none() {
                return Ok(());
            }
            let read = db.begin_read().map_err(failed)?;
            let heads = read.open_table(HEADS).map_err(failed)?;
            let old = bytes_of(&heads, &TableKind::Traces.head_key(&key))?;
            let usage = usage.lock().unwrap_or_else(PoisonError::into_inner);
            usage.admit(&quota, TableKind::Traces, &key, [old, bytes])
        })
        .await
    }

    async fn put(&self, new: NewRow) -> Result<(), StoreError> {
        let (quota, usage, reserve) = (self.quota, self.usage.clone(), self.reserve.clone());
        self.blocking(new.kind.head_key(&new.key), move |db| {
            reserve.admit()?;
            let write = begin(db)?;
            if let Some(video) = &new.video {
                let videos = write.open_table(TableKind::Videos.table()).map_err(failed)?;
                if videos.get(video.as_str()).map_err(failed)?.is_none() {
                    return Err(StoreError::VideoGone);
                }
            }
            // Writers take turns in redb; this keeps the sums in step with the commits.
            let mut usage = usage.lock().unwrap_or_else(PoisonError::into_inner);
            let old = {
                let mut heads = write.open_table(HEADS).map_err(failed)?;
                let head_key = new.kind.head_key(&new.key);
                let before = PlainHead::of(&heads, &head_key)?;
                let old = before.as_ref().map_or(0, |head| head.bytes);
                usage.admit(&quota, new.kind, &new.key, [old, new.bytes])?;
                let created_ms = before.map_or_else(|| Some(now_ms()), |head| head.created_ms);
                let head = RowHead { created_ms, bytes: new.bytes, shown: new.shown };
                heads.insert(head_key.as_str(), encode(&head_key, &head)?.as_slice()).map_err(failed)?;
                let mut table = write.open_table(new.kind.table()).map_err(failed)?;
                table.insert(new.key.as_str(), new.row.as_slice()).map_err(failed)?;
                if let Some(bytes) = &new.beside {
                    let mut beside = write.open_table(OPERATION_RESULTS).map_err(failed)?;
                    beside.insert(new.key.as_str(), bytes.as_slice()).map_err(failed)?;
                }
                old
            };
            write.commit().map_err(failed)?;
            usage.change(new.kind, &new.key, old, new.bytes);
            Ok(())
        })
        .await
    }

    /// Removes the kept steps of discoveries whose keys begin so; those that were kept before `until_ms` only, if that is given.
    pub async fn forget_checkpoints(&self, prefix: &str, until_ms: Option<u64>) -> Result<(), StoreError> {
        let kind = TableKind::Checkpoints;
        let (range, table) = (head_range(kind, self.range(prefix, "")), kind.head_key(""));
        self.freeing(kind.name().into(), move |db| {
            let (read, mut keys) = (db.begin_read().map_err(failed)?, vec![]);
            // The heads say enough: the rows may be large.
            let mut collect = |found: Found| {
                if let Found::Row(head_key, row) = found {
                    let kept_ms = PlainHead::read(head_key, row).and_then(|head| head.created_ms);
                    if until_ms.is_none_or(|until| kept_ms.is_none_or(|kept| kept < until)) {
                        keys.extend(head_key.strip_prefix(&table).map(str::to_string));
                    }
                }
                Ok(ControlFlow::Continue(()))
            };
            scan(&read.open_table(HEADS).map_err(failed)?, range.clone(), &mut collect)?;
            if keys.is_empty() {
                return Ok(());
            }
            let write = begin(db)?;
            {
                let mut heads = write.open_table(HEADS).map_err(failed)?;
                for key in keys {
                    remove_row(&write, &mut heads, kind, &key)?;
                }
            }
            write.commit().map_err(failed)
        })
        .await
    }

    /// Deletes a lexicon; `false` if it does not exist.
    pub async fn delete_lexicon(&self, id: &str) -> Result<bool, StoreError> {
        self.remove(TableKind::Lexica, self.key(id)).await
    }

    /// Removes a row with its head; `false` if it does not exist.
    pub(super) async fn remove(&self, kind: TableKind, key: String) -> Result<bool, StoreError> {
        let usage = self.usage.clone();
        self.freeing(kind.head_key(&key), move |db| {
            let write = begin(db)?;
            let mut usage = usage.lock().unwrap_or_else(PoisonError::into_inner);
            let (found, removed) = {
                let mut heads = write.open_table(HEADS).map_err(failed)?;
                remove_row(&write, &mut heads, kind, &key)?
            };
            write.commit().map_err(failed)?;
            usage.change(kind, &key, removed.bytes, 0);
            Ok(found)
        })
        .await
    }

    /// Deletes operations with their results; those that do not exist are skipped.
    pub async fn delete_operations(&self, ids: &[String]) -> Result<(), StoreError> {
        let keys: Vec<String> = ids.iter().map(|id| self.key(id)).collect();
        self.freeing(TableKind::Operations.name().into(), move |db| {
            let write = begin(db)?;
            {
                let mut heads = write.open_table(HEADS).map_err(failed)?;
                keys.iter().try_for_each(|key| remove_operation(&write, &mut heads, key))?;
            }
            write.commit().map_err(failed)
        })
        .await
    }

    /// Deletes a video with its models, studies, stills, operations and traces; `false` if it does not exist.
    pub async fn delete_video(&self, id: &str) -> Result<bool, StoreError> {
        let (video, whole, usage) = (id.to_string(), self.key(id), self.usage.clone());
        let ranges = [self.range(&format!("{id}/"), ""), self.range("", "")];
        let (found, traces) = self
            .freeing(TableKind::Videos.head_key(&whole), move |db| {
                let write = begin(db)?;
                let owned = Owned::of(db, &video, &ranges)?;
                let mut usage = usage.lock().unwrap_or_else(PoisonError::into_inner);
                let (found, removed) = {
                    let mut heads = write.open_table(HEADS).map_err(failed)?;
                    let (found, video) = remove_row(&write, &mut heads, TableKind::Videos, &whole)?;
                    let mut removed = vec![video];
                    for (kind, key) in &owned.rows {
                        removed.push(remove_row(&write, &mut heads, *kind, key)?.1);
                    }
                    owned.operations.iter().try_for_each(|key| remove_operation(&write, &mut heads, key))?;
                    (found, removed)
                };
                write.commit().map_err(failed)?;
                for Removed { kind, key, bytes } in removed {
                    usage.change(kind, &key, bytes, 0);
                }
                let is_trace = |(kind, _): &&(TableKind, String)| *kind == TableKind::Traces;
                Ok((
                    found,
                    owned.rows.iter().filter(is_trace).map(|(_, key)| key.clone()).collect::<Vec<_>>(),
                ))
            })
            .await?;
        for trace in traces {
            self.delete_blob(&trace).await?;
        }
        Ok(found)
    }
}

impl NewRow {
    fn plain<T: Serialize>(kind: TableKind, key: String, value: &T) -> Result<NewRow, StoreError> {
        let row = encode(&key, value)?;
        let bytes = row.len() as u64;
        Ok(NewRow { kind, key, row, bytes, shown: None, video: None, beside: None })
    }
}

/// What goes with a video: whole keys.
struct Owned {
    rows: Vec<(TableKind, String)>,
    operations: Vec<String>,
}

impl Owned {
    /// Looks at the last commit, which no other writer changes meanwhile. What a damaged page hides is not found: its file
    /// is removed when the folder is next looked through.
    /// `ranges` are the keys of the video's own rows, and of all of the tenant.
    fn of(db: &Database, video: &str, [own, all]: &[KeyRange; 2]) -> Result<Owned, StoreError> {
        let read = db.begin_read().map_err(failed)?;
        let mut owned = Owned { rows: vec![], operations: vec![] };
        let mut collect = |kind: TableKind, range: &KeyRange, is_owned: &dyn Fn(&str, &[u8]) -> bool| {
            let table = read.open_table(kind.table()).map_err(failed)?;
            let mut found = |found: Found| {
                if let Found::Row(key, row) = found
                    && is_owned(key, row)
                {
                    match kind {
                        TableKind::Operations => owned.operations.push(key.to_string()),
                        _ => owned.rows.push((kind, key.to_string())),
                    }
                }
                Ok(ControlFlow::Continue(()))
            };
            scan(&table, range.clone(), &mut found)
        };
        for kind in [TableKind::Fits, TableKind::Studies, TableKind::Stills, TableKind::Checkpoints] {
            collect(kind, own, &|_, _| true)?;
        }
        collect(TableKind::Traces, all, &|key, row| {
            readable::<OfVideo>(key, row).is_some_and(|v| v.video == video)
        })?;
        collect(TableKind::Operations, all, &|key, row| {
            readable::<OfVideos>(key, row).is_some_and(|v| v.videos.iter().any(|v| v == video))
        })?;
        Ok(owned)
    }
}

fn bytes_of(
    heads: &impl ReadableTable<&'static str, &'static [u8]>,
    head_key: &str,
) -> Result<u64, StoreError> {
    Ok(PlainHead::of(heads, head_key)?.map_or(0, |head| head.bytes))
}

/// Removes a row with its head; `false` if neither exists.
fn remove_row(
    write: &WriteTransaction,
    heads: &mut Heads,
    kind: TableKind,
    key: &str,
) -> Result<(bool, Removed), StoreError> {
    let head_key = kind.head_key(key);
    let bytes = bytes_of(heads, &head_key)?;
    let had_head = heads.remove(head_key.as_str()).map_err(failed)?.is_some();
    let mut table = write.open_table(kind.table()).map_err(failed)?;
    // The old row is dropped at once: it may be large.
    let had_row = table.remove(key).map_err(failed)?.is_some();
    Ok((had_head || had_row, Removed { kind, key: key.to_string(), bytes }))
}

fn remove_operation(write: &WriteTransaction, heads: &mut Heads, key: &str) -> Result<(), StoreError> {
    remove_row(write, heads, TableKind::Operations, key)?;
    let mut results = write.open_table(OPERATION_RESULTS).map_err(failed)?;
    results.remove(key).map_err(failed)?;
    Ok(())
}

/// Whether a trace has a record or a head. One that cannot be looked up has.
pub(super) fn is_recorded(db: &Database, key: &str) -> Result<bool, StoreError> {
    let found = caught(|| {
        let read = db.begin_read().map_err(failed)?;
        let kind = TableKind::Traces;
        let records = read.open_table(kind.table()).map_err(failed)?;
        let heads = read.open_table(HEADS).map_err(failed)?;
        let has_row = records.get(key).map_err(failed)?.is_some();
        Ok(has_row || heads.get(kind.head_key(key).as_str()).map_err(failed)?.is_some())
    });
    match found {
        Err(StoreError::Damaged { .. }) => Ok(true),
        found => found,
    }
}
