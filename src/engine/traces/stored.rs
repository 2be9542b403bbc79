//! Stored traces: published, listed, downloaded, and removed when they exceed the limits of retention.
//!
//! Publishing writes a file before the record that names it, so every listed trace has a whole file. The id of a trace
//! is the digest of its bytes: the same simulation again writes nothing, and repairs a file that the disk damaged. A
//! download ends with an error if the bytes do not match the id.

use super::backlog::Batch;
use super::file::{TraceFile, TraceRecord};
use super::retention::{Lease, Retention, TraceRetention};
use crate::engine::error::EngineError;
use crate::engine::metric_names;
use crate::engine::state::Engine;
use crate::store::{TableKind, now_ms};
use bytes::Bytes;
use std::sync::Arc;
use std::time::Duration;

/// Most bytes of a trace that are read at a time.
const READ_BYTES: u64 = 256 * 1024;
/// How often expired traces are removed where none is written.
const EXPIRY_INTERVAL: Duration = Duration::from_secs(60);
/// Removal by size goes down to this share of the limit, so that the next new trace needs no count of all traces.
const SIZE_AFTER_REMOVAL: f64 = 0.9;

/// Selects traces.
#[derive(Debug, Clone, Default)]
pub struct TraceFilter {
    pub video: Option<String>,
    pub model: Option<String>,
    /// Stored at or after the first and before the second time (ms after 1970).
    pub stored_ms: (Option<u64>, Option<u64>),
}

impl Engine {
    /// The engine with limits on the traces it keeps.
    pub fn with_retention(mut self, retention: Retention) -> Engine {
        self.retention = Arc::new(TraceRetention::new(retention));
        self
    }

    /// Removes the traces that exceed the limits at `now_ms` (ms after 1970), of all tenants together, the oldest first;
    /// traces in use stay. Returns their ids.
    pub async fn remove_expired(&self, now_ms: u64) -> Result<Vec<String>, EngineError> {
        let Retention { max_age, max_bytes } = self.retention.limits;
        if max_age.is_none() && max_bytes.is_none() {
            return Ok(vec![]);
        }
        let store = self.store.of_everyone();
        let mut rows = store.list(TableKind::Traces, "", "", usize::MAX, |_: &TraceRecord| true).await?;
        rows.sort_by(|(a, ra), (b, rb)| (ra.stored_ms, a).cmp(&(rb.stored_ms, b)));
        let mut bytes: u64 = rows.iter().map(|(_, r)| r.size_bytes).sum();
        let goal =
            max_bytes.filter(|most| bytes > *most).map(|most| (most as f64 * SIZE_AFTER_REMOVAL) as u64);
        let too_old = |r: &TraceRecord| {
            max_age.is_some_and(|age| now_ms.saturating_sub(r.stored_ms) as u128 > age.as_millis())
        };
        let mut removed = vec![];
        for (key, record) in rows {
            if !too_old(&record) && goal.is_none_or(|goal| bytes <= goal) {
                continue;
            }
            let Some(_right) = self.retention.removal(&key) else { continue };
            store.delete_trace(&key).await?;
            bytes -= record.size_bytes;
            // Results in memory may name it; without them the next request stores the trace again.
            let tenant = key.strip_suffix(&record.id).unwrap_or_default();
            self.deletions.add(format!("{tenant}{}", record.video));
            removed.push(record.id);
        }
        Ok(removed)
    }

    /// Removes expired traces after every new trace and once a minute, until it is dropped.
    pub async fn enforce_retention(self: Arc<Self>) {
        loop {
            let _ = tokio::time::timeout(EXPIRY_INTERVAL, self.retention.stored.notified()).await;
            match self.remove_expired(now_ms()).await {
                Ok(removed) if removed.is_empty() => {}
                Ok(removed) => tracing::info!(traces = removed.len(), "retention removed traces"),
                Err(error) => tracing::error!(%error, "retention failed"),
            }
        }
    }

    /// Stores the files, each before the record that names it, and returns their ids.
    #[tracing::instrument(skip_all)]
    pub(crate) async fn publish(&self, batch: Batch) -> Result<Vec<String>, EngineError> {
        let mut ids = Vec::with_capacity(batch.files.len());
        for TraceFile { bytes, record } in batch.files {
            let _lease = self.retention.lease_when_free(&self.store.key(&record.id)).await;
            let record = TraceRecord { stored_ms: now_ms(), ..record };
            self.store.put_blob(&record.id, bytes).await?;
            metrics::counter!(metric_names::TRACES).increment(1);
            metrics::counter!(metric_names::TRACE_BYTES).increment(record.size_bytes);
            self.put_of_video(TableKind::Traces, &record.video, &record.id, &record).await?;
            ids.push(record.id);
        }
        self.retention.stored.notify_one();
        Ok(ids)
    }

    /// Up to `limit` traces that match the filter, after the id `after`, by id.
    pub async fn traces(
        &self,
        filter: TraceFilter,
        after: &str,
        limit: usize,
    ) -> Result<Vec<TraceRecord>, EngineError> {
        if let Some(video) = &filter.video {
            self.video(video).await?;
        }
        let keep = move |record: &TraceRecord| {
            let is = |wanted: &Option<String>, found: &String| wanted.as_ref().is_none_or(|w| w == found);
            let (from, to) = filter.stored_ms;
            is(&filter.video, &record.video)
                && is(&filter.model, &record.model)
                && from.is_none_or(|from| record.stored_ms >= from)
                && to.is_none_or(|to| record.stored_ms < to)
        };
        let rows = self.store.list(TableKind::Traces, "", after, limit, keep).await?;
        Ok(rows.into_iter().map(|(_, record)| record).collect())
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
