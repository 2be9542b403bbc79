//! The routes of the HTTP port, who may read them, and the header fields of every response.

use super::login::{self, session_name};
use super::pages;
use super::visitor::Visitor;
use crate::api::server::byte_budget::Holder;
use crate::api::server::connections::connection::ConnectionInfo;
use crate::api::server::connections::seats::RunningCall;
use crate::api::server::metrics;
use crate::api::server::port_context::PortContext;
use crate::engine::{Engine, Tenant};
use axum::body::{Body, Bytes};
use axum::extract::Request;
use axum::http::header::{
    CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, HeaderName, HeaderValue, REFERRER_POLICY,
    X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS,
};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Extension, Router};
use http_body::{Frame, SizeHint};
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Instant;
use tower::Service;

/// Read by probes and by Prometheus, without a token or a certificate; their lines in the log are of little interest.
const OPEN: [&str; 4] = ["/livez", "/readyz", "/healthz", "/metrics"];
/// What a response that is no page of ours may load: nothing.
const NO_PAGE_POLICY: HeaderValue = HeaderValue::from_static("default-src 'none'; frame-ancestors 'none'");
const SAME_ORIGIN: (HeaderName, HeaderValue) =
    (HeaderName::from_static("cross-origin-resource-policy"), HeaderValue::from_static("same-origin"));

/// One HTTP port.
pub struct HttpPort {
    engine: Arc<Engine>,
    context: PortContext,
    routes: Router,
}

impl HttpPort {
    pub fn new(engine: Arc<Engine>, context: PortContext) -> HttpPort {
        let routes = Router::new()
            .route("/", get(pages::home))
            .route("/videos/{id}/report", get(pages::report))
            .route("/traces/{file}", get(pages::trace))
            .route("/login", get(login::show).post(login::log_in))
            .route("/logout", post(login::log_out))
            .route("/favicon.ico", get(async || StatusCode::NO_CONTENT))
            .route("/livez", get(async || "live\n"))
            .route("/readyz", get(ready))
            .route("/healthz", get(async || "serving\n"))
            .route("/metrics", get(prometheus));
        HttpPort { engine, context, routes }
    }

    /// Refuses a request whose host name is not this service's: against DNS rebinding, where a foreign page's name is made to
    /// point here.
    fn check_host(&self, headers: &HeaderMap) -> Option<Response> {
        let named = headers.get(HOST).and_then(|host| host.to_str().ok()?.parse::<Authority>().ok());
        let host = named.as_ref().map_or("", |authority| authority.host().trim_matches(['[', ']']));
        let allowed = |name: &String| name.eq_ignore_ascii_case(host);
        let is_ours =
            host == "localhost" || host.parse::<IpAddr>().is_ok() || self.context.hosts.iter().any(allowed);
        let advice = "open these pages as localhost, by address, or by a name of the setting http_hosts\n";
        (!is_ours).then(|| (StatusCode::MISDIRECTED_REQUEST, advice).into_response())
    }

    /// The visitor, or the response that asks it to say who it is.
    fn visitor(&self, connection: &ConnectionInfo, request: &Request) -> Result<Visitor, Box<Response>> {
        let security = self.context.security.current();
        let path = request.uri().path();
        let visitor = |tenant: Option<&Tenant>| Visitor {
            engine: tenant.map_or_else(|| self.engine.clone(), |tenant| self.engine.of(tenant)),
            context: self.context.clone(),
            tenant: tenant.cloned(),
            holder: Holder::of(tenant, Some(connection.seat.id)),
            is_encrypted: security.tls.is_some(),
        };
        if OPEN.contains(&path) {
            return Ok(visitor(None));
        }
        if security.tls.as_ref().is_some_and(|tls| tls.needs_certificate) && !connection.has_certificate {
            let advice =
                "show a certificate that the service's authority of clients (tls_client_ca) signed\n";
            return Err(Box::new((StatusCode::FORBIDDEN, advice).into_response()));
        }
        let Some(tokens) = &security.tokens else { return Ok(visitor(None)) };
        let headers = request.headers();
        let of_session = || {
            let token = self.context.sessions.token(session_name(headers)?)?;
            tokens.of_digest(&token)
        };
        match tokens.tenant(headers).or_else(of_session) {
            Some(tenant) => Ok(visitor(Some(tenant))),
            None if path == "/login" => Ok(visitor(None)),
            None => Err(Box::new(login::asked(request))),
        }
    }
}

/// The response to one request.
pub async fn answer(port: &HttpPort, connection: &ConnectionInfo, mut request: Request) -> Response {
    let mut log = RequestLog {
        method: request.method().to_string(),
        path: request.uri().path().to_string(),
        start: Instant::now(),
        code: 0,
        tenant: None,
        _running: connection.seat.call(),
    };
    let response = match port.check_host(request.headers()) {
        Some(refused) => refused,
        None => match port.visitor(connection, &request) {
            Ok(visitor) => {
                log.tenant = visitor.tenant.clone();
                request.extensions_mut().insert(visitor);
                match port.routes.clone().call(request).await {
                    Ok(response) => response,
                    Err(never) => match never {},
                }
            }
            Err(asked) => *asked,
        },
    };
    log.code = response.status().as_u16();
    let (mut parts, inner) = response.into_parts();
    protect(&mut parts.headers);
    Response::from_parts(parts, Body::new(LoggedBody { inner, _log: log }))
}

/// No other page may show, load or guess at what this port serves.
fn protect(headers: &mut HeaderMap) {
    headers.entry(CONTENT_SECURITY_POLICY).or_insert(NO_PAGE_POLICY);
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(X_FRAME_OPTIONS, HeaderValue::from_static("DENY"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(SAME_ORIGIN.0, SAME_ORIGIN.1);
}

/// One request; its line in the log is written when its response ends.
struct RequestLog {
    method: String,
    path: String,
    start: Instant,
    code: u16,
    tenant: Option<Tenant>,
    _running: RunningCall,
}

impl Drop for RequestLog {
    fn drop(&mut self) {
        let RequestLog { method, path, code, .. } = self;
        let seconds = self.start.elapsed().as_secs_f64();
        let tenant = self.tenant.as_ref().map_or("", Tenant::name);
        match OPEN.contains(&path.as_str()) {
            true => tracing::debug!(method, path, code, seconds, "request ended"),
            false => tracing::info!(method, path, code, seconds, tenant, "request ended"),
        }
    }
}

struct LoggedBody {
    inner: Body,
    _log: RequestLog,
}

impl http_body::Body for LoggedBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        http_body::Body::poll_frame(Pin::new(&mut self.inner), context)
    }

    fn is_end_stream(&self) -> bool {
        http_body::Body::is_end_stream(&self.inner)
    }

    fn size_hint(&self) -> SizeHint {
        http_body::Body::size_hint(&self.inner)
    }
}

async fn prometheus(Extension(visitor): Extension<Visitor>) -> impl IntoResponse {
    let text = metrics::render(&visitor.engine, &visitor.context.budgets);
    ([(CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text)
}

async fn ready(Extension(visitor): Extension<Visitor>) -> Response {
    match visitor.context.readiness.check(&visitor.engine).await {
        Ok(()) => "ready\n".into_response(),
        Err(why) => (StatusCode::SERVICE_UNAVAILABLE, format!("{why}\n")).into_response(),
    }
}
