//! Keeps the data folder in order: removes what exceeds the limits and files without records, keeps space back for
//! deletions, and copies and checks the folder while it is used.

use super::retention::{ClockReading, Retention, TraceRetention};
use crate::engine::error::EngineError;
use crate::engine::metric_names;
use crate::engine::state::Engine;
use crate::store::{BackupReport, CheckReport, Quota, StorageState, TableKind, Tenant, TimedRow, now_ms};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::io::Write;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How often expired traces are removed where none is written, and left files where a deletion failed.
const EXPIRY_INTERVAL: Duration = Duration::from_secs(60);
/// How often all files are compared with the records.
const ORPHAN_INTERVAL: Duration = Duration::from_secs(3600);
/// How long the steps of a discovery are kept that a service's end cut short: longer than any operation may take.
const CHECKPOINT_AGE: Duration = Duration::from_secs(24 * 3600);
/// Removal by size goes down to this share of the limit, so that the next new trace needs no count of all traces.
const SIZE_AFTER_REMOVAL: f64 = 0.9;

/// What retention reads of a trace.
#[derive(Deserialize)]
struct AgedTrace {
    id: String,
    video: String,
    size_bytes: u64,
    #[serde(default)]
    stored_ms: u64,
}

impl Engine {
    /// The engine with limits on the traces it keeps.
    pub fn with_retention(mut self, retention: Retention) -> Engine {
        self.retention = Arc::new(TraceRetention::new(retention));
        self
    }

    /// The engine with limits on what each tenant may store.
    pub fn with_quota(mut self, quota: Quota) -> Engine {
        self.store = self.store.with_quota(quota);
        self
    }

    /// Keeps back so many bytes of the disk for deletions; 0: none. A disk without room for them is reported in the log.
    pub fn keep_reserve(&self, bytes: u64) {
        if let Err(error) = self.store.keep_reserve(bytes) {
            tracing::warn!(%error, bytes, "no space is kept back: deletions may fail on a full disk");
        }
    }

    /// What the disk of the data folder has.
    pub fn storage(&self) -> StorageState {
        self.store.storage()
    }

    /// How many bytes of traces each tenant that has too many must lose.
    fn surplus(&self) -> BTreeMap<Tenant, u64> {
        let Some(most) = self.retention.limits.max_bytes else { return BTreeMap::new() };
        let left = (most as f64 * SIZE_AFTER_REMOVAL) as u64;
        let over = self.store.tenants_with_more_traces(most).into_iter();
        over.map(|(tenant, bytes)| (tenant, bytes.saturating_sub(left))).collect()
    }

    /// Removes the traces that exceed the limits now: by age of all tenants, by size of each tenant by itself, the oldest
    /// first; traces in use stay. Returns their ids.
    pub async fn remove_expired(&self, now: ClockReading) -> Result<Vec<String>, EngineError> {
        self.retention.observe(now);
        let (mut surplus, start) = (self.surplus(), Instant::now());
        if self.retention.limits.max_age.is_none() && surplus.is_empty() {
            return Ok(vec![]);
        }
        let store = self.store.of_everyone();
        let collect = |rows: &mut Vec<TimedRow<AgedTrace>>, row| {
            rows.push(row);
            ControlFlow::Continue(())
        };
        let (mut rows, _) = store.fold(TableKind::Traces, ("", ""), vec![], collect).await?;
        self.retention.keep_ages(rows.iter().map(|row| row.key.as_str()), start);
        rows.sort_by(|a, b| (a.value.stored_ms, &a.key).cmp(&(b.value.stored_ms, &b.key)));
        let mut removed = vec![];
        for TimedRow { key, value: trace, .. } in rows {
            let tenant = Tenant::of_key(&key);
            let is_surplus = surplus.get(&tenant).is_some_and(|left| *left > 0);
            if !is_surplus && !self.retention.is_too_old(&key, trace.stored_ms) {
                continue;
            }
            let Some(_right) = self.retention.removal(&key) else { continue };
            store.delete_trace(&key).await?;
            self.retention.note_removed(&key);
            if let Some(left) = surplus.get_mut(&tenant) {
                *left = left.saturating_sub(trace.size_bytes);
            }
            // Results in memory may name it; without them the next request stores the trace again.
            self.deletions.add(self.store.of(&tenant).key(&trace.video));
            removed.push(trace.id);
        }
        Ok(removed)
    }

    /// Removes what discoveries have left that nobody asked for again since a service ended.
    async fn forget_old_checkpoints(&self) -> Result<(), EngineError> {
        let until = now_ms().saturating_sub(CHECKPOINT_AGE.as_millis() as u64);
        Ok(self.store.of_everyone().forget_checkpoints("", Some(until)).await?)
    }

    /// Removes the trace files of all tenants that have no record and that nobody writes now. Returns how many.
    pub async fn remove_orphans(&self) -> Result<usize, EngineError> {
        let mut removed = 0;
        for key in self.store.orphans().await? {
            let Some(_right) = self.retention.removal(&key) else { continue };
            removed += usize::from(self.store.delete_orphan(&key).await?);
        }
        metrics::counter!(metric_names::ORPHANS).increment(removed as u64);
        Ok(removed)
    }

    /// Removes traces beyond the limits of size after new ones, those that are too old once a minute, and files without
    /// records at the start, each hour, and a minute after a deletion failed, until it is dropped.
    pub async fn enforce_retention(self: Arc<Self>) {
        let (mut search, mut minute) = (Instant::now(), Instant::now() + EXPIRY_INTERVAL);
        loop {
            if self.retention.take_orphans() || Instant::now() >= search {
                search = Instant::now() + ORPHAN_INTERVAL;
                if let Err(error) = self.forget_old_checkpoints().await {
                    tracing::error!(%error, "old steps of discoveries were not removed");
                }
                match self.remove_orphans().await {
                    Ok(0) => {}
                    Ok(files) => tracing::warn!(files, "trace files without records were removed"),
                    Err(error) => tracing::error!(%error, "files without records were not removed"),
                }
            }
            let left = minute.saturating_duration_since(Instant::now());
            let _ = tokio::time::timeout(left, self.retention.stored.notified()).await;
            let is_due = Instant::now() >= minute;
            if is_due {
                minute = Instant::now() + EXPIRY_INTERVAL;
                self.renew_reserve().await;
            }
            // A new trace is not too old.
            if !is_due && self.surplus().is_empty() {
                continue;
            }
            match self.remove_expired(ClockReading::now()).await {
                Ok(removed) if removed.is_empty() => {}
                Ok(removed) => tracing::info!(traces = removed.len(), "retention removed traces"),
                Err(error) => tracing::error!(%error, "retention failed"),
            }
        }
    }

    /// Makes the reserve of disk space, if it is not there and there is room for it now.
    async fn renew_reserve(&self) {
        if self.store.lacks_reserve() {
            let store = self.store.clone();
            let made = tokio::task::spawn_blocking(move || store.rebuild_reserve()).await;
            if matches!(made, Ok(Ok(()))) {
                tracing::info!("the reserve of disk space is whole again");
            }
        }
    }

    /// Writes a copy of all tenants' data, as they are now. It blocks its thread until all is written.
    pub fn backup(&self, to: impl Write) -> Result<BackupReport, EngineError> {
        Ok(self.store.backup(to)?)
    }

    /// Reads all rows and trace files of all tenants. It blocks its thread until all is read.
    pub fn check(&self) -> Result<CheckReport, EngineError> {
        Ok(self.store.check()?)
    }
}
