//! What is stored of an operation, and how long.

use serde::{Deserialize, Serialize};

/// How long the end of an operation is kept: a caller may be away for a week.
const KEPT_MS: u64 = 7 * 24 * 3600 * 1000;
/// Most ended operations of one tenant.
const MAX_KEPT: usize = 500;
/// Most bytes of their results: a dozen of the largest, or thousands of usual ones.
const MAX_KEPT_BYTES: u64 = 256 << 20;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OperationKind {
    FitModel,
    CompareModels,
    DiagnoseModel,
    DiscoverEffects,
    AddEffect,
    RemoveEffect,
    WriteReport,
    CreateVideo,
    LearnConcepts,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OperationState {
    /// It waits for a CPU thread or runs.
    Running,
    Succeeded,
    Failed,
    Cancelled,
    /// The service ended before it, more than once without a drain, or before its request was kept.
    Aborted,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OperationRecord {
    /// Sorts before those of older operations.
    pub id: String,
    pub kind: OperationKind,
    /// Ids of the videos that it is about.
    pub videos: Vec<String>,
    /// The caller's name for it; empty: none.
    pub request_id: String,
    /// Of its request.
    pub request_digest: String,
    pub state: OperationState,
    /// Milliseconds after 1970.
    pub created_ms: u64,
    /// `None` while it runs, and for ever if the service ended before it.
    pub ended_ms: Option<u64>,
    /// Of its result.
    pub result_bytes: u64,
    /// How often a service ended without a drain while it ran.
    #[serde(default)]
    pub crashes: u32,
}

impl OperationRecord {
    /// When it is forgotten at the latest, in milliseconds after 1970.
    pub fn expires_ms(&self) -> u64 {
        self.ended_ms.unwrap_or(self.created_ms).saturating_add(KEPT_MS)
    }

    pub(super) fn is_expired(&self, now_ms: u64) -> bool {
        self.state != OperationState::Running && self.expires_ms() <= now_ms
    }
}

/// Ids of the ended operations that must go, of a tenant's records with the newest first.
pub(super) fn surplus(records: &[OperationRecord], now_ms: u64) -> Vec<String> {
    let (mut count, mut bytes, mut surplus) = (0, 0, vec![]);
    for record in records.iter().filter(|r| r.state != OperationState::Running) {
        count += 1;
        bytes += record.result_bytes;
        if count > MAX_KEPT || bytes > MAX_KEPT_BYTES || record.is_expired(now_ms) {
            surplus.push(record.id.clone());
        }
    }
    surplus
}

/// Which operations to list; what is absent or empty holds for all.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OperationFilter {
    pub states: Vec<OperationState>,
    pub kinds: Vec<OperationKind>,
    pub video: Option<String>,
}

impl OperationFilter {
    pub(super) fn accepts(&self, record: &OperationRecord) -> bool {
        (self.states.is_empty() || self.states.contains(&record.state))
            && (self.kinds.is_empty() || self.kinds.contains(&record.kind))
            && self.video.as_ref().is_none_or(|video| record.videos.contains(video))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(id: usize, state: OperationState, bytes: u64) -> OperationRecord {
        let (videos, request_id, request_digest) = (vec![], String::new(), String::new());
        let (kind, ended_ms) = (OperationKind::FitModel, Some(1));
        let id = id.to_string();
        OperationRecord {
            id,
            kind,
            videos,
            request_id,
            request_digest,
            state,
            created_ms: 0,
            ended_ms,
            result_bytes: bytes,
            crashes: 0,
        }
    }

    #[test]
    fn the_oldest_go_first_and_running_ones_stay() {
        use OperationState::{Failed, Running, Succeeded};
        let many: Vec<_> =
            (0..MAX_KEPT + 2).map(|k| record(k, if k % 2 == 0 { Succeeded } else { Failed }, 1)).collect();
        assert_eq!(surplus(&many, 2), ["500", "501"]);
        let half = MAX_KEPT_BYTES / 2;
        let large = [
            record(0, Running, 0),
            record(1, Succeeded, half),
            record(2, Succeeded, half),
            record(3, Failed, 1),
        ];
        assert_eq!(surplus(&large, 2), ["3"]);
        assert_eq!(surplus(&large, 1 + KEPT_MS), ["1", "2", "3"], "a week after their end");
        assert!(surplus(&large, KEPT_MS).len() == 1 && !large[0].is_expired(u64::MAX));
    }
}
