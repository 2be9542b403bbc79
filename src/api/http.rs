//! The HTTP port: what machines and browsers read. It changes nothing.

use super::metrics;
use crate::engine::Engine;
use axum::Router;
use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::response::IntoResponse;
use axum::routing::get;
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;

/// How often the buffers of figures are emptied: Prometheus reads them about as often.
const UPKEEP: Duration = Duration::from_secs(5);

/// All pages.
pub fn router(engine: Arc<Engine>) -> Router {
    Router::new()
        .route("/healthz", get(async || "serving\n"))
        .route("/metrics", get(figures))
        .with_state(engine)
}

async fn figures(State(engine): State<Arc<Engine>>) -> impl IntoResponse {
    ([(CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], metrics::render(&engine))
}

/// Serves until `shutdown` is ready; readers that are served then may end.
pub async fn serve_http(
    listener: TcpListener,
    engine: Arc<Engine>,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> std::io::Result<()> {
    metrics::count();
    let upkeep = async {
        loop {
            tokio::time::sleep(UPKEEP).await;
            metrics::upkeep();
        }
    };
    let served = axum::serve(listener, router(engine)).with_graceful_shutdown(shutdown).into_future();
    tokio::select! {
        done = served => done,
        () = upkeep => Ok(()),
    }
}
