//! The HTTP port: what machines and browsers read.

use super::guard::Tokens;
use super::{metrics, pages};
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

/// How often the buffers of figures are emptied: Prometheus reads them about as often.
const UPKEEP: Duration = Duration::from_secs(5);

/// All pages, of what the engine shows.
pub fn router(engine: Arc<Engine>) -> Router {
    Router::new()
        .route("/", get(pages::home))
        .route("/videos/{id}/report", get(pages::report))
        .route("/traces/{file}", get(pages::trace))
        .route("/favicon.ico", get(async || StatusCode::NO_CONTENT))
        .route("/healthz", get(async || "serving\n"))
        .route("/metrics", get(figures))
        .with_state(engine)
}

async fn figures(State(engine): State<Arc<Engine>>) -> impl IntoResponse {
    ([(CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], metrics::render(&engine))
}

/// Lets through what was meant for this machine: a page from elsewhere whose name was made to point here does not get
/// in (DNS rebinding).
async fn local(request: Request, next: Next) -> Response {
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
    let mut pages = guarded(engine, tokens);
    if listener.local_addr()?.ip().is_loopback() {
        pages = pages.layer(middleware::from_fn(local));
    }
    let served = axum::serve(listener, pages).with_graceful_shutdown(shutdown).into_future();
    tokio::select! {
        done = served => done,
        () = upkeep => Ok(()),
    }
}
