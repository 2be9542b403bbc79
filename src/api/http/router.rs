//! The routes of the HTTP port, and who may read them.

use super::pages;
use crate::api::server::auth::Tokens;
use crate::api::server::metrics;
use crate::engine::Engine;
use axum::Router;
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_TYPE, HOST, WWW_AUTHENTICATE};
use axum::http::uri::Authority;
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use std::future::Future;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tower::Service;

/// How often the buffers of the metrics are emptied: about as often as Prometheus reads them.
const UPKEEP: Duration = Duration::from_secs(5);

/// All routes, over the part of the engine that the caller may see.
pub fn router(engine: Arc<Engine>) -> Router {
    Router::new()
        .route("/", get(pages::home))
        .route("/videos/{id}/report", get(pages::report))
        .route("/traces/{file}", get(pages::trace))
        .route("/favicon.ico", get(async || StatusCode::NO_CONTENT))
        .route("/healthz", get(async || "serving\n"))
        .route("/metrics", get(prometheus))
        .with_state(engine)
}

async fn prometheus(State(engine): State<Arc<Engine>>) -> impl IntoResponse {
    ([(CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], metrics::render(&engine))
}

/// Refuses requests whose host name is not this machine's: against DNS rebinding, where a foreign page's name is made to
/// point here.
async fn require_local_host(request: Request, next: Next) -> Response {
    let named = request.headers().get(HOST).and_then(|host| host.to_str().ok()?.parse::<Authority>().ok());
    let host = named.as_ref().map_or("", |authority| authority.host().trim_matches(['[', ']']));
    match host == "localhost" || host.parse::<IpAddr>().is_ok() {
        true => next.run(request).await,
        false => {
            let advice = "open this machine's pages as localhost or by its address\n";
            (StatusCode::MISDIRECTED_REQUEST, advice).into_response()
        }
    }
}

/// The routes as the caller's tenant sees them. Where tokens are needed, a caller without one reads health and metrics only.
fn authenticated(engine: Arc<Engine>, tokens: Option<Arc<Tokens>>) -> Router {
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

/// Serves until `shutdown` is ready, then waits for running requests.
pub async fn serve_http(
    listener: TcpListener,
    engine: Arc<Engine>,
    tokens: Option<Arc<Tokens>>,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> std::io::Result<()> {
    metrics::install();
    let upkeep = async {
        loop {
            tokio::time::sleep(UPKEEP).await;
            metrics::upkeep();
        }
    };
    let mut pages = authenticated(engine, tokens);
    if listener.local_addr()?.ip().is_loopback() {
        pages = pages.layer(middleware::from_fn(require_local_host));
    }
    let served = axum::serve(listener, pages).with_graceful_shutdown(shutdown).into_future();
    tokio::select! {
        done = served => done,
        () = upkeep => Ok(()),
    }
}
