//! The server: limits, health, reflection, and a shutdown that drains running calls within a bounded time.

use super::auth::AuthLayer;
use super::connections::accept::{Accepting, HTTP2_PREFACE, connections};
use super::metrics::Methods;
use super::port_context::PortContext;
use super::readiness::Readiness;
use super::request_body::BodyLayer;
use super::request_layer::RequestLayer;
use super::services::Services;
use crate::api::{DESCRIPTORS, v1};
use crate::engine::Engine;
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;
use tonic::transport::Server;
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;

/// Bytes of header fields: names and tokens are short.
const MAX_HEADERS: u32 = 16 * 1024;
/// Bytes of a call, and of all calls of a connection, that may arrive before somebody reads them.
const STREAM_WINDOW: u32 = 256 * 1024;
const CONNECTION_WINDOW: u32 = 512 * 1024;
/// How often the health of the services is set.
const HEALTH_INTERVAL: Duration = Duration::from_secs(1);

/// Limits of one connection and of one call.
#[derive(Debug, Clone, Copy)]
pub struct ServerLimits {
    /// Bytes of one request: about 100 objects in 1,000 frames.
    pub request_bytes: usize,
    /// Bytes of one reply.
    pub reply_bytes: usize,
    /// Concurrent calls on one connection.
    pub streams: u32,
    /// Longest call that is no stream; the engine's own limit is shorter, and its error says more.
    pub timeout: Duration,
    /// Longest that calls may run after the shutdown started.
    pub drain: Duration,
}

impl Default for ServerLimits {
    fn default() -> Self {
        ServerLimits {
            request_bytes: 16 << 20,
            reply_bytes: 64 << 20,
            streams: 100,
            timeout: Duration::from_secs(310),
            drain: Duration::from_secs(8),
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    #[error("serving failed: {0}")]
    Transport(#[from] tonic::transport::Error),
    #[error("reflection has no descriptors: {0}")]
    Reflection(#[from] tonic_reflection::server::Error),
}

/// Sets the health of every service, and of the whole under the empty name.
async fn set_health(health: &HealthReporter, methods: &Methods, is_ready: bool) {
    let status = if is_ready { ServingStatus::Serving } else { ServingStatus::NotServing };
    for service in methods.services().into_iter().chain([""]) {
        health.set_service_status(service, status).await;
    }
}

/// Keeps the health of the services as ready as the engine is, until it is dropped.
async fn watch_health(health: &HealthReporter, methods: &Methods, engine: &Engine, readiness: &Readiness) {
    let mut known = None;
    loop {
        let found = readiness.check(engine).await;
        if known != Some(found.is_ok()) {
            set_health(health, methods, found.is_ok()).await;
            match &found {
                Err(why) => tracing::warn!(%why, "not ready"),
                Ok(()) => tracing::info!("ready"),
            }
            known = Some(found.is_ok());
        }
        tokio::time::sleep(HEALTH_INTERVAL).await;
    }
}

/// Reflection over all services.
fn reflection() -> tonic_reflection::server::Builder<'static> {
    tonic_reflection::server::Builder::configure()
        .register_encoded_file_descriptor_set(DESCRIPTORS)
        .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
}

/// Serves until `shutdown` is ready, then waits for running calls, at most for `limits.drain`.
pub async fn serve(
    listener: TcpListener,
    engine: Arc<Engine>,
    limits: ServerLimits,
    context: impl Into<PortContext>,
    shutdown: impl Future<Output = ()> + Send,
) -> Result<(), ServeError> {
    let PortContext { security, budgets, connections: most, readiness, .. } = context.into();
    let services = Services { engine: engine.clone(), imports: budgets.imports };
    macro_rules! limited {
        ($server:ty) => {
            <$server>::new(services.clone())
                .max_decoding_message_size(limits.request_bytes)
                .max_encoding_message_size(limits.reply_bytes)
        };
    }
    let methods = Arc::new(Methods::new());
    let (health, health_service) = tonic_health::server::health_reporter();
    set_health(&health, &methods, readiness.check(&engine).await.is_ok()).await;
    let draining = CancellationToken::new();
    let body = BodyLayer { most: limits.request_bytes, budget: budgets.requests, methods: methods.clone() };
    let server = Server::builder()
        .layer(RequestLayer::new(methods.clone(), budgets.replies))
        .layer(AuthLayer(security.clone()))
        .layer(body)
        .max_concurrent_streams(limits.streams)
        .timeout(limits.timeout)
        .initial_stream_window_size(STREAM_WINDOW)
        .initial_connection_window_size(CONNECTION_WINDOW)
        .http2_keepalive_interval(Some(Duration::from_secs(30)))
        .http2_keepalive_timeout(Some(Duration::from_secs(20)))
        .http2_max_header_list_size(MAX_HEADERS)
        .add_service(limited!(v1::videos_server::VideosServer<Services>))
        .add_service(limited!(v1::models_server::ModelsServer<Services>))
        .add_service(limited!(v1::reasoning_server::ReasoningServer<Services>))
        .add_service(limited!(v1::concepts_server::ConceptsServer<Services>))
        .add_service(limited!(v1::traces_server::TracesServer<Services>))
        .add_service(limited!(v1::statistics_server::StatisticsServer<Services>))
        .add_service(limited!(v1::operations_server::OperationsServer<Services>))
        .add_service(health_service)
        .add_service(reflection().build_v1()?)
        .add_service(reflection().build_v1alpha()?);
    let certificate = move || security.current().tls.as_ref().map(|tls| tls.grpc.clone());
    let incoming = connections(listener, Accepting { most, first_bytes: HTTP2_PREFACE, certificate });
    let stop = draining.clone();
    let running = server.serve_with_incoming_shutdown(incoming, async move { stop.cancelled().await });
    tokio::pin!(running);
    tokio::select! {
        result = &mut running => return Ok(result?),
        () = watch_health(&health, &methods, &engine, &readiness) => {}
        () = shutdown => {}
    }
    // Load balancers see the health status first; then no new calls are accepted, and running ones may end.
    tracing::info!(seconds = limits.drain.as_secs(), "draining: running calls may end within this time");
    readiness.drain();
    set_health(&health, &methods, false).await;
    draining.cancel();
    let drained = tokio::time::timeout(limits.drain, running).await;
    engine.abort_operations().await;
    if drained.is_err() {
        tracing::warn!("some calls were still running at the end of the drain time");
    }
    tracing::info!("stopped");
    drained.unwrap_or(Ok(())).map_err(ServeError::from)
}
