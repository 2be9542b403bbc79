//! The HTTP port: what machines and browsers read. It changes nothing.

use super::guard::Tokens;
use super::metrics;
use crate::engine::Engine;
use axum::Router;
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_TYPE, WWW_AUTHENTICATE};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tower::Service;

/// How often the buffers of figures are emptied: Prometheus reads them about as often.
const UPKEEP: Duration = Duration::from_secs(5);

/// All pages, of what the engine shows.
pub fn router(engine: Arc<Engine>) -> Router {
    Router::new()
        .route("/healthz", get(async || "serving\n"))
        .route("/metrics", get(figures))
        .with_state(engine)
}

async fn figures(State(engine): State<Arc<Engine>>) -> impl IntoResponse {
    ([(CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], metrics::render(&engine))
}

/// The pages as the caller's tenant sees them; with tokens, anybody sees only those that tell of nobody.
fn guarded(engine: Arc<Engine>, tokens: Option<Arc<Tokens>>) -> Router {
    let Some(tokens) = tokens else { return router(engine) };
    Router::new().fallback(async move |request: Request| -> Response {
        let open = ["/healthz", "/metrics"].contains(&request.uri().path());
        let owner = match tokens.tenant(request.headers()) {
            Some(tenant) => engine.of(tenant),
            None if open => engine,
            None => {
                let advice = "send the header authorization: Bearer TOKEN\n";
                return (StatusCode::UNAUTHORIZED, [(WWW_AUTHENTICATE, "Bearer")], advice).into_response();
            }
        };
        match router(owner).call(request).await {
            Ok(response) => response,
            Err(never) => match never {},
        }
    })
}

/// Serves until `shutdown` is ready; readers that are served then may end.
pub async fn serve_http(
    listener: TcpListener,
    engine: Arc<Engine>,
    tokens: Option<Arc<Tokens>>,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> std::io::Result<()> {
    metrics::count();
    let upkeep = async {
        loop {
            tokio::time::sleep(UPKEEP).await;
            metrics::upkeep();
        }
    };
    let served =
        axum::serve(listener, guarded(engine, tokens)).with_graceful_shutdown(shutdown).into_future();
    tokio::select! {
        done = served => done,
        () = upkeep => Ok(()),
    }
}
