//! Stored traces: published, listed and downloaded.
//!
//! Publishing writes a file before the record that names it, so every listed trace has a whole file. The id of a trace
//! is the digest of its bytes: the same simulation again writes nothing, and repairs a file that the disk damaged. A
//! download ends with an error if the bytes do not match the id.

use super::backlog::Batch;
use super::file::{TraceFile, TraceRecord};
use super::retention::Lease;
use crate::engine::error::EngineError;
use crate::engine::metric_names;
use crate::engine::state::Engine;
use crate::store::{Listing, PageStart, TableKind, now_ms};
use bytes::Bytes;
use std::sync::Arc;

/// Most bytes of a trace that are read at a time.
const READ_BYTES: u64 = 256 * 1024;
/// Selects traces.
#[derive(Debug, Clone, Default)]
pub struct TraceFilter {
    pub video: Option<String>,
    pub model: Option<String>,
    /// Stored at or after the first and before the second time (ms after 1970).
    pub stored_ms: (Option<u64>, Option<u64>),
}

impl Engine {
    /// Stores the files, each before the record that names it, and returns their ids.
    #[tracing::instrument(skip_all)]
    pub(crate) async fn publish(&self, batch: Batch) -> Result<Vec<String>, EngineError> {
        let mut ids = Vec::with_capacity(batch.files.len());
        for file in batch.files {
            ids.push(self.publish_file(file).await?);
        }
        if !ids.is_empty() {
            self.retention.stored.notify_one();
        }
        Ok(ids)
    }

    async fn publish_file(&self, file: TraceFile) -> Result<String, EngineError> {
        let TraceFile { bytes, record } = file;
        let key = self.store.key(&record.id);
        let lease = self.retention.lease_when_free(&key).await;
        let record = TraceRecord { stored_ms: now_ms(), ..record };
        self.store.admit_trace(&record.id, record.size_bytes).await?;
        self.store.put_blob(&record.id, bytes).await?;
        metrics::counter!(metric_names::TRACES).increment(1);
        metrics::counter!(metric_names::TRACE_BYTES).increment(record.size_bytes);
        let stored = self.store.put_trace(&record.video, &record.id, &record, record.size_bytes).await;
        if let Err(error) = stored {
            drop(lease);
            self.remove_unrecorded(&key).await;
            return Err(EngineError::of_video(&record.video, error));
        }
        self.retention.note_stored(&key);
        Ok(record.id)
    }

    /// Removes a file that no record names. Another call may be about to record it: then it is looked for later.
    async fn remove_unrecorded(&self, key: &str) {
        let is_removed = match self.retention.removal(key) {
            Some(_right) => self.store.delete_orphan(key).await.is_ok(),
            None => false,
        };
        if !is_removed {
            self.retention.look_for_orphans();
        }
    }

    /// Up to `limit` traces that match the filter, after the id `after`, by id.
    pub async fn traces(
        &self,
        filter: TraceFilter,
        after: &str,
        limit: usize,
    ) -> Result<Vec<TraceRecord>, EngineError> {
        let listed = self.list_traces(filter, after, limit).await?;
        Ok(listed.rows.into_iter().map(|row| row.value).collect())
    }

    /// A page of the traces that match the filter, after the id `after`, by id.
    pub async fn list_traces(
        &self,
        filter: TraceFilter,
        after: &str,
        size: usize,
    ) -> Result<Listing<TraceRecord>, EngineError> {
        if let Some(video) = &filter.video {
            self.video(video).await?;
        }
        let keep = move |record: &TraceRecord, _: Option<u64>| {
            let is = |wanted: &Option<String>, found: &String| wanted.as_ref().is_none_or(|w| w == found);
            let (from, to) = filter.stored_ms;
            is(&filter.video, &record.video)
                && is(&filter.model, &record.model)
                && from.is_none_or(|from| record.stored_ms >= from)
                && to.is_none_or(|to| record.stored_ms < to)
        };
        Ok(self.store.list_page(TableKind::Traces, PageStart { prefix: "", after, size }, keep).await?)
    }

    /// The record of a trace, and a lease that keeps it from being removed.
    pub async fn trace(&self, id: &str) -> Result<(TraceRecord, Lease), EngineError> {
        let missing = || EngineError::NotFound { name: format!("traces/{id}") };
        let lease = self.retention.lease(&self.store.key(id)).ok_or_else(missing)?;
        let record = self.store.get(TableKind::Traces, id).await?.ok_or_else(missing)?;
        Ok((record, lease))
    }

    /// Opens the file of a trace.
    pub async fn download(self: &Arc<Self>, id: &str) -> Result<Download, EngineError> {
        let (record, lease) = self.trace(id).await?;
        let found = self.store.blob_size(id).await?;
        if found != record.size_bytes {
            return Err(self.damaged(&record, format!("it has {found} bytes of {}", record.size_bytes)));
        }
        let (engine, hasher) = (self.clone(), blake3::Hasher::new());
        Ok(Download { engine, record, offset: 0, hasher, _lease: lease })
    }

    /// The error of a trace that cannot be read. The results of its video in memory are dropped, so that the next request for
    /// its simulation writes it again.
    pub(crate) fn damaged(&self, record: &TraceRecord, what: String) -> EngineError {
        tracing::error!(trace = record.id, what, "a trace is damaged");
        self.forget_video(&record.video);
        EngineError::Damaged { id: record.id.clone(), what }
    }
}

/// A trace file that is being read. Its last bytes are returned only if the digest of all bytes is its id.
pub struct Download {
    engine: Arc<Engine>,
    record: TraceRecord,
    offset: u64,
    hasher: blake3::Hasher,
    _lease: Lease,
}

impl Download {
    pub fn record(&self) -> &TraceRecord {
        &self.record
    }

    /// The offset of the next bytes, and the bytes; empty at the end.
    pub async fn next(&mut self) -> Result<(u64, Bytes), EngineError> {
        let (id, offset) = (&self.record.id, self.offset);
        let len = self.record.size_bytes.saturating_sub(offset).min(READ_BYTES);
        if len == 0 {
            return Ok((offset, Bytes::new()));
        }
        let bytes = self.engine.store.read_blob(id, offset, len).await?;
        self.hasher.update(&bytes);
        self.offset += bytes.len() as u64;
        let is_last = self.offset == self.record.size_bytes;
        if (bytes.len() as u64) < len || is_last && self.hasher.finalize().to_hex().as_str() != id {
            return Err(self.engine.damaged(&self.record, "its checksum is wrong".into()));
        }
        Ok((offset, bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::state::Capacity;
    use std::time::Duration;

    #[tokio::test]
    async fn a_file_that_another_call_may_record_is_not_removed() {
        let folder = tempfile::tempdir().unwrap();
        let capacity = Capacity { workers: 1, queue: 1, job_timeout: Duration::from_secs(60) };
        let engine = Engine::open(folder.path(), capacity).unwrap();
        engine.store.put_blob("t", Bytes::from_static(b"whole")).await.unwrap();
        let other = engine.retention.lease("t").unwrap();
        engine.remove_unrecorded("t").await;
        assert_eq!(engine.store.blob_size("t").await, Ok(5));
        assert!(engine.retention.take_orphans(), "it is looked for later");
        drop(other);
        engine.remove_unrecorded("t").await;
        assert!(engine.store.blob_size("t").await.is_err() && !engine.retention.take_orphans());
    }
}
