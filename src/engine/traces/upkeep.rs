//! Keeps the data folder in order: removes what exceeds the limits and files without records, keeps space back for
//! deletions, and copies and checks the folder while it is used.

use super::retention::{ClockReading, Retention, TraceRetention};
use crate::engine::error::EngineError;
use crate::engine::metric_names;
use crate::engine::state::Engine;
use crate::store::{
    BackupReport, CheckReport, PageStart, Quota, StorageState, StoredBytes, TableKind, Tenant, TimedRow,
    now_ms,
};
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

    /// What the tenant has stored.
    pub fn stored_bytes(&self) -> StoredBytes {
        self.store.stored_bytes()
    }

    /// Removes the traces that exceed the limits now: by age of all tenants, by size of each tenant by itself, the oldest
    /// first; traces in use stay. Returns their ids.
    pub async fn remove_expired(&self, now: ClockReading) -> Result<Vec<String>, EngineError> {
        let Retention { max_age, max_bytes } = self.retention.limits;
        self.retention.observe(now);
        if max_age.is_none() && max_bytes.is_none() {
            return Ok(vec![]);
        }
        let store = self.store.of_everyone();
        let all = PageStart { prefix: "", after: "", size: usize::MAX };
        let collect = |rows: &mut Vec<TimedRow<AgedTrace>>, row| {
            rows.push(row);
            ControlFlow::Continue(())
        };
        let (mut rows, _) = store.fold(TableKind::Traces, all, vec![], collect).await?;
        rows.sort_by(|a, b| (a.value.stored_ms, &a.key).cmp(&(b.value.stored_ms, &b.key)));
        let mut bytes = BTreeMap::<Tenant, u64>::new();
        for row in &rows {
            *bytes.entry(Tenant::of_key(&row.key)).or_default() += row.value.size_bytes;
        }
        // How much each tenant that has too much must lose.
        let surplus = |bytes: &u64| {
            let most = max_bytes.filter(|most| bytes > most)?;
            Some(bytes.saturating_sub((most as f64 * SIZE_AFTER_REMOVAL) as u64))
        };
        let mut surplus: BTreeMap<Tenant, u64> =
            bytes.iter().filter_map(|(tenant, bytes)| Some((tenant.clone(), surplus(bytes)?))).collect();
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

    /// Removes expired traces after every new trace and once a minute, and files without records at the start, each hour,
    /// and a minute after a deletion failed, until it is dropped.
    pub async fn enforce_retention(self: Arc<Self>) {
        let mut search = Instant::now();
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
            let _ = tokio::time::timeout(EXPIRY_INTERVAL, self.retention.stored.notified()).await;
            if self.storage().is_full && self.store.rebuild_reserve().is_ok() {
                tracing::info!("the reserve of disk space is whole again");
            }
            match self.remove_expired(ClockReading::now()).await {
                Ok(removed) if removed.is_empty() => {}
                Ok(removed) => tracing::info!(traces = removed.len(), "retention removed traces"),
                Err(error) => tracing::error!(%error, "retention failed"),
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
