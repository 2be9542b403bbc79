//! Serves the HTTP port: every head has a deadline, and connections end with the service.

use super::router::{HttpPort, answer};
use crate::api::server::connections::accept::{Accepting, connections};
use crate::api::server::connections::connection::AcceptedConnection;
use crate::api::server::metrics;
use crate::api::server::port_context::PortContext;
use crate::engine::Engine;
use axum::body::Body;
use axum::extract::Request;
use futures_util::StreamExt;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

/// How often the buffers of the metrics are emptied: about as often as Prometheus reads them.
const UPKEEP: Duration = Duration::from_secs(5);
/// Longest time until the head of a request is complete; also the longest pause between two requests.
const HEAD_TIMEOUT: Duration = Duration::from_secs(10);
/// Most bytes of a head.
const MAX_HEAD: usize = 64 * 1024;

/// Serves until `shutdown` is ready, then waits for running requests.
pub async fn serve_http(
    listener: TcpListener,
    engine: Arc<Engine>,
    context: impl Into<PortContext>,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> std::io::Result<()> {
    metrics::install();
    let context = context.into();
    let (most, security) = (context.connections, context.security.clone());
    let certificate = move || security.current().tls.as_ref().map(|tls| tls.http.clone());
    let mut incoming = connections(listener, Accepting { most, first_bytes: 1, certificate });
    let port = Arc::new(HttpPort::new(engine, context));
    let (stop, mut open) = (CancellationToken::new(), JoinSet::new());
    let mut upkeep = tokio::time::interval(UPKEEP);
    tokio::pin!(shutdown);
    loop {
        tokio::select! {
            accepted = incoming.next() => match accepted {
                Some(Ok(connection)) => {
                    open.spawn(serve_connection(port.clone(), connection, stop.clone()));
                }
                Some(Err(_)) => {}
                None => break,
            },
            Some(_) = open.join_next() => {}
            _ = upkeep.tick() => metrics::upkeep(),
            () = &mut shutdown => break,
        }
    }
    drop(incoming);
    stop.cancel();
    while open.join_next().await.is_some() {}
    Ok(())
}

async fn serve_connection(port: Arc<HttpPort>, connection: AcceptedConnection, stop: CancellationToken) {
    let info = connection.info().clone();
    let service = service_fn(move |request: http::Request<Incoming>| {
        let (port, info) = (port.clone(), info.clone());
        let request: Request = request.map(Body::new);
        async move { Ok::<_, Infallible>(answer(&port, &info, request).await) }
    });
    let serving = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIMEOUT)
        .max_buf_size(MAX_HEAD)
        .serve_connection(TokioIo::new(connection), service);
    tokio::pin!(serving);
    tokio::select! {
        // An error is of this connection alone: its peer left, or was too slow.
        _ = serving.as_mut() => return,
        () = stop.cancelled() => serving.as_mut().graceful_shutdown(),
    }
    let _ = serving.await;
}
