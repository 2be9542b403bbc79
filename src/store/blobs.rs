//! The files of traces: published whole or not at all, and removed with their records.

use super::disk::backend::count_failure;
use super::error::{StoreError, blob_failed, broken, io_failed};
use super::folder::Store;
use super::schema::tables::TableKind;
use super::write::is_recorded;
use bytes::Bytes;
use object_store::path::Path as BlobPath;
use object_store::{GetResultPayload, ObjectStore, ObjectStoreExt, PutMode, PutOptions};
use std::fs::File;
use std::path::Path;

/// How the name of a trace's file ends.
const ENDS: &str = ".mcap";

impl Store {
    /// Publishes a blob whole or not at all; durable when it returns. Publishing the same blob again changes nothing, unless
    /// the disk has damaged it: then it is written again.
    pub async fn put_blob(&self, id: &str, bytes: Bytes) -> Result<(), StoreError> {
        let _permit = self.blocking_permits.acquire().await.map_err(broken)?;
        let path = blob(&self.key(id));
        let create = PutOptions { mode: PutMode::Create, ..PutOptions::default() };
        match self.blobs.put_opts(&path, bytes.clone().into(), create).await {
            Ok(_) => Ok(()),
            Err(object_store::Error::AlreadyExists { .. }) => {
                let known = self.blobs.get(&path).await.map_err(|e| blob_failed(&e))?;
                if known.bytes().await.map_err(|e| blob_failed(&e))? != bytes {
                    tracing::warn!(trace = id, "a damaged file was written again");
                    count_failure(self.blobs.put(&path, bytes.into()).await).map_err(|e| blob_failed(&e))?;
                }
                Ok(())
            }
            Err(error) => count_failure(Err(error)).map_err(|e| blob_failed(&e)),
        }
    }

    /// Bytes of a blob's file.
    pub async fn blob_size(&self, id: &str) -> Result<u64, StoreError> {
        let found = self.blobs.head(&blob(&self.key(id))).await;
        found.map(|meta| meta.size).map_err(|error| unread(id, &error))
    }

    /// Bytes `offset..offset + len` of a blob; fewer at its end.
    pub async fn read_blob(&self, id: &str, offset: u64, len: u64) -> Result<Bytes, StoreError> {
        let read = self.blobs.get_range(&blob(&self.key(id)), offset..offset + len).await;
        read.map_err(|error| unread(id, &error))
    }

    /// A blob as an open file.
    pub async fn open_blob(&self, id: &str) -> Result<File, StoreError> {
        let found = self.blobs.get(&blob(&self.key(id))).await.map_err(|error| unread(id, &error))?;
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

    pub(super) async fn delete_blob(&self, key: &str) -> Result<(), StoreError> {
        match self.blobs.delete(&blob(key)).await {
            Err(object_store::Error::NotFound { .. }) | Ok(()) => Ok(()),
            Err(error) => Err(blob_failed(&error)),
        }
    }

    /// Whole keys of the trace files that have no record, of all tenants. One that is being written now is among them.
    pub async fn orphans(&self) -> Result<Vec<String>, StoreError> {
        let traces = self.traces.clone();
        self.blocking(TableKind::Traces.name().into(), move |db| {
            let mut orphans = vec![];
            for entry in std::fs::read_dir(&*traces).map_err(|e| io_failed(&e))? {
                let name = entry.map_err(|e| io_failed(&e))?.file_name();
                if let Some(key) = name.to_str().and_then(key_of_file)
                    && !is_recorded(db, &key)?
                {
                    orphans.push(key);
                }
            }
            Ok(orphans)
        })
        .await
    }

    /// Removes the file of a trace if it has no record. Its whole key must be free of leases.
    pub async fn delete_orphan(&self, key: &str) -> Result<bool, StoreError> {
        let of = key.to_string();
        let is_orphan =
            self.blocking(TableKind::Traces.head_key(key), move |db| Ok(!is_recorded(db, &of)?)).await?;
        if is_orphan {
            self.delete_blob(key).await?;
        }
        Ok(is_orphan)
    }
}

/// The file of a trace, by its whole key.
fn blob(key: &str) -> BlobPath {
    BlobPath::from(file_name(key))
}

/// The name of a trace's file, by its whole key.
pub fn file_name(key: &str) -> String {
    format!("{}{ENDS}", key.trim_start_matches('~').replace('/', "."))
}

/// The whole key of the trace with this file; `None`: it is not the file of a trace.
pub fn key_of_file(name: &str) -> Option<String> {
    let stem = name.strip_suffix(ENDS)?;
    Some(match stem.split_once('.') {
        Some((tenant, id)) => format!("~{tenant}/{id}"),
        None => stem.to_string(),
    })
}

/// Opens the file of a trace, by its whole key.
pub fn open_file(traces: &Path, key: &str) -> std::io::Result<File> {
    File::open(traces.join(file_name(key)))
}

/// Why a blob cannot be read.
fn unread(id: &str, error: &object_store::Error) -> StoreError {
    match error {
        object_store::Error::NotFound { .. } => StoreError::FileGone { id: id.into() },
        error => blob_failed(error),
    }
}
