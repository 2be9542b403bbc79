//! The server: limits, health, reflection, and a shutdown that drains running calls within a bounded time.

use super::accept::connections;
use super::auth::{AuthLayer, Security};
use super::request_layer::RequestLayer;
use super::services::{Services, resume_operations};
use crate::api::{DESCRIPTORS, v1};
use crate::engine::Engine;
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;
use tonic::transport::Server;
use tonic_health::server::HealthReporter;

/// Bytes of header fields: names and tokens are short.
const MAX_HEADERS: u32 = 16 * 1024;

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

/// Says that all services serve.
async fn set_serving(health: &HealthReporter) {
    health.set_serving::<v1::videos_server::VideosServer<Services>>().await;
    health.set_serving::<v1::models_server::ModelsServer<Services>>().await;
    health.set_serving::<v1::reasoning_server::ReasoningServer<Services>>().await;
    health.set_serving::<v1::concepts_server::ConceptsServer<Services>>().await;
    health.set_serving::<v1::traces_server::TracesServer<Services>>().await;
    health.set_serving::<v1::statistics_server::StatisticsServer<Services>>().await;
    health.set_serving::<v1::operations_server::OperationsServer<Services>>().await;
}

/// Serves until `shutdown` is ready, then waits for running calls, at most for `limits.drain`.
pub async fn serve(
    listener: TcpListener,
    engine: Arc<Engine>,
    limits: ServerLimits,
    security: Security,
    shutdown: impl Future<Output = ()> + Send,
) -> Result<(), ServeError> {
    if let Err(error) = resume_operations(&engine).await {
        tracing::error!(%error, "operations of the last service do not go on");
    }
    let services = Services(engine.clone());
    macro_rules! limited {
        ($server:ty) => {
            <$server>::new(services.clone())
                .max_decoding_message_size(limits.request_bytes)
                .max_encoding_message_size(limits.reply_bytes)
        };
    }
    let (health, health_service) = tonic_health::server::health_reporter();
    set_serving(&health).await;
    let reflection = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(DESCRIPTORS)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    let draining = CancellationToken::new();
    let mut server = Server::builder();
    if let Some(tls) = security.tls {
        server = server.tls_config(tls)?;
    }
    let server = server
        .layer(RequestLayer::new())
        .layer(AuthLayer(security.tokens))
        .max_concurrent_streams(limits.streams)
        .timeout(limits.timeout)
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
    let incoming = connections(listener);
    let stop = draining.clone();
    let running = server.serve_with_incoming_shutdown(incoming, async move { stop.cancelled().await });
    tokio::pin!(running);
    tokio::select! {
        result = &mut running => return Ok(result?),
        () = shutdown => {}
    }
    // Load balancers see the health status first; then no new calls are accepted, and running ones may end.
    health.set_service_status("", tonic_health::ServingStatus::NotServing).await;
    draining.cancel();
    let drained = tokio::time::timeout(limits.drain, running).await;
    engine.abort_operations().await;
    match drained {
        Ok(result) => Ok(result?),
        Err(_) => {
            tracing::warn!("some calls were still running at the end of the drain time");
            Ok(())
        }
    }
}
