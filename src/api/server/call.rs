//! A running call: its id, its span, who makes it, and what is recorded when it ends.

use super::auth::KnownTenant;
use super::byte_budget::Holder;
use super::connections::connection::ConnectionInfo;
use super::connections::seats::RunningCall;
use super::metrics::{CALL_SECONDS, CALLS};
use crate::api::status::status;
use crate::engine::{EngineError, panic_message};
use http::{HeaderMap, HeaderValue};
use std::time::Instant;
use tokio_util::sync::CancellationToken;
use tonic::{Code, Status};
use tracing::Span;

/// Calls whose lines in the log are of interest only when something is wrong: probes make them every few seconds.
const PROBES: &str = "grpc.health.v1.Health/";

/// A running call; its metrics are recorded when it is dropped, however it ends.
pub struct Call {
    method: String,
    pub id: HeaderValue,
    start: Instant,
    /// `Cancelled` until a status is seen: a call that is dropped before its end was cancelled.
    pub code: Code,
    pub span: Span,
    tenant: KnownTenant,
    connection: Option<ConnectionInfo>,
    _running: Option<RunningCall>,
}

impl Call {
    pub fn new(
        method: String,
        id: HeaderValue,
        span: Span,
        tenant: KnownTenant,
        connection: Option<ConnectionInfo>,
    ) -> Call {
        // Who only watches the health keeps nobody's place.
        let counts = !method.starts_with(PROBES);
        let running = connection.as_ref().filter(|_| counts).map(|info| info.seat.call());
        let (start, code) = (Instant::now(), Code::Cancelled);
        Call { method, id, start, code, span, tenant, connection, _running: running }
    }

    /// Takes the status from header fields, if they have one.
    pub fn record_status(&mut self, fields: &HeaderMap) {
        if let Some(code) = fields.get(Status::GRPC_STATUS) {
            self.code = Code::from_bytes(code.as_bytes());
        }
    }

    pub fn panicked(&self, panic: &(dyn std::any::Any + Send)) -> Status {
        let message = panic_message(panic);
        tracing::error!(message, "a call panicked");
        let id = self.id.to_str().unwrap_or_default();
        status(EngineError::Internal { id: id.into(), message })
    }

    /// Who the bytes of its reply are counted for, and what closes the connection of a caller that does not read them.
    pub fn reader(&self) -> (Holder, CancellationToken) {
        let seat = self.connection.as_ref().map(|info| &info.seat);
        let holder = Holder::of(self.tenant.0.get(), seat.map(|seat| seat.id));
        (holder, seat.map(|seat| seat.close.clone()).unwrap_or_default())
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        let (seconds, method) = (self.start.elapsed().as_secs_f64(), self.method.clone());
        let code = format!("{:?}", self.code);
        let tenant = self.tenant.0.get().map_or("", |tenant| tenant.name());
        self.span.in_scope(|| match method.starts_with(PROBES) {
            true => tracing::debug!(code, seconds, "call ended"),
            false => tracing::info!(code, seconds, tenant, "call ended"),
        });
        metrics::histogram!(CALL_SECONDS, "method" => method.clone()).record(seconds);
        metrics::counter!(CALLS, "method" => method, "code" => code).increment(1);
    }
}
