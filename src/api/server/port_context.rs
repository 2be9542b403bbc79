//! What both ports share: who may come in, how much memory and how many files they may take, and whether the service is ready.

use super::auth::{LiveSecurity, Security};
use super::byte_budget::Budgets;
use super::process_metrics::max_open_files;
use super::readiness::{Readiness, ReadinessLimits};
use super::sessions::Sessions;
use std::sync::Arc;

/// Most connections of one port, however many files are allowed: each may hold a window of 256 KiB.
const MAX_CONNECTIONS: u64 = 1024;
/// Least connections of one port.
const MIN_CONNECTIONS: u64 = 16;
/// Files that are kept for the data folder, traces and logs where so many are allowed, else a quarter.
const FILES_KEPT: u64 = 256;

/// Limits of both ports together.
#[derive(Debug, Clone)]
pub struct PortLimits {
    /// Most connections of each port.
    pub connections: usize,
    /// Bytes of requests in flight; decoded, they take about four times as much. One caller has at most a half.
    pub request_bytes: usize,
    /// Bytes of replies that are not sent yet. One caller has at most a half.
    pub reply_bytes: usize,
    /// Host names under which the HTTP port may be opened, beside `localhost` and addresses.
    pub hosts: Vec<String>,
    pub readiness: ReadinessLimits,
}

impl Default for PortLimits {
    fn default() -> Self {
        PortLimits {
            connections: default_connections(),
            request_bytes: 64 << 20,
            reply_bytes: 128 << 20,
            hosts: vec![],
            readiness: ReadinessLimits::default(),
        }
    }
}

/// Connections of each port for which the limit of open files leaves enough for the data folder.
fn default_connections() -> usize {
    let files = max_open_files();
    let kept = FILES_KEPT.min(files / 4);
    // At most 1024.
    ((files - kept) / 2).clamp(MIN_CONNECTIONS, MAX_CONNECTIONS) as usize
}

/// What both ports of one service share.
#[derive(Clone)]
pub struct PortContext {
    pub security: LiveSecurity,
    pub(in crate::api) budgets: Budgets,
    pub(in crate::api) connections: usize,
    pub(in crate::api) hosts: Arc<[String]>,
    pub(in crate::api) sessions: Arc<Sessions>,
    pub(in crate::api) readiness: Arc<Readiness>,
}

impl PortContext {
    pub fn new(security: Security, limits: PortLimits) -> PortContext {
        let PortLimits { connections, request_bytes, reply_bytes, hosts, readiness } = limits;
        PortContext {
            security: security.into(),
            budgets: Budgets::new(request_bytes, reply_bytes),
            connections,
            hosts: hosts.into(),
            sessions: Arc::default(),
            readiness: Arc::new(Readiness::new(readiness)),
        }
    }
}

impl From<Security> for PortContext {
    fn from(security: Security) -> Self {
        PortContext::new(security, PortLimits::default())
    }
}
