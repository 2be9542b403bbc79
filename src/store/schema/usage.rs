//! How many bytes each tenant has stored, and how many it may.

use super::tables::TableKind;
use crate::store::error::StoreError;
use crate::store::tenant::Tenant;
use std::collections::HashMap;

/// Most bytes that one tenant may store; `None`: no limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Quota {
    /// Of videos and their stills, as they are stored.
    pub video_bytes: Option<u64>,
    /// Of trace files.
    pub trace_bytes: Option<u64>,
}

/// Bytes that one tenant has stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StoredBytes {
    pub videos: u64,
    pub traces: u64,
}

/// The tables whose rows count.
pub const COUNTED: [TableKind; 3] = [TableKind::Videos, TableKind::Stills, TableKind::Traces];

impl StoredBytes {
    fn part(&mut self, kind: TableKind) -> Option<&mut u64> {
        match kind {
            TableKind::Videos | TableKind::Stills => Some(&mut self.videos),
            TableKind::Traces => Some(&mut self.traces),
            _ => None,
        }
    }
}

/// The bytes of all tenants. They are summed from the heads when the folder is opened, and follow each commit.
#[derive(Debug, Default)]
pub struct UsageTable {
    tenants: HashMap<Tenant, StoredBytes>,
}

impl UsageTable {
    pub fn of(&self, tenant: &Tenant) -> StoredBytes {
        self.tenants.get(tenant).copied().unwrap_or_default()
    }

    /// The tenants that have more bytes of traces.
    pub fn with_more_traces(&self, than: u64) -> Vec<(Tenant, u64)> {
        let traces = self.tenants.iter().map(|(tenant, stored)| (tenant, stored.traces));
        traces.filter(|(_, bytes)| *bytes > than).map(|(tenant, bytes)| (tenant.clone(), bytes)).collect()
    }

    /// Notes that the row under this whole key has `new` bytes instead of `old`.
    pub fn change(&mut self, kind: TableKind, key: &str, old: u64, new: u64) {
        let stored = self.tenants.entry(Tenant::of_key(key)).or_default();
        if let Some(bytes) = stored.part(kind) {
            *bytes = bytes.saturating_sub(old).saturating_add(new);
        }
    }

    /// Refuses the row if its tenant would then have more than its quota. A row that grows nothing is never refused.
    pub fn admit(
        &self,
        quota: &Quota,
        kind: TableKind,
        key: &str,
        [old, new]: [u64; 2],
    ) -> Result<(), StoreError> {
        let mut stored = self.of(&Tenant::of_key(key));
        let (name, limit) = match kind {
            TableKind::Videos | TableKind::Stills => ("videos", quota.video_bytes),
            TableKind::Traces => ("traces", quota.trace_bytes),
            _ => return Ok(()),
        };
        let (Some(limit_bytes), Some(bytes)) = (limit, stored.part(kind)) else { return Ok(()) };
        let needed_bytes = bytes.saturating_sub(old).saturating_add(new);
        if new <= old || needed_bytes <= limit_bytes {
            return Ok(());
        }
        Err(StoreError::Quota { kind: name, needed_bytes, limit_bytes })
    }
}
