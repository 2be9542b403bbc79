//! What every call gets: a request id, a span in the logs, its metrics, and a reply where it panics.

use super::auth::KnownTenant;
use super::byte_budget::ByteBudget;
use super::call::Call;
use super::connections::connection::ConnectionInfo;
use super::metrics::Methods;
use super::reply_body::ReplyBody;
use crate::api::status::clarify;
use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use http::{HeaderMap, HeaderValue, Request, Response};
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::{SystemTime, UNIX_EPOCH};
use tonic::Code;
use tonic::body::Body;
use tower::{Layer, Service};
use tracing::Instrument;

/// The header with a request's id; a request without one gets one of ours. Every reply has it.
pub const REQUEST_ID: &str = "x-request-id";
/// Longest id that is taken from a request.
const MAX_REQUEST_ID: usize = 128;

/// The layer.
#[derive(Clone)]
pub struct RequestLayer(Arc<CallRegistry>);

struct CallRegistry {
    methods: Arc<Methods>,
    replies: ByteBudget,
    /// Milliseconds after 1970; distinguishes the ids of this start from those of earlier ones.
    start: u64,
    count: AtomicU64,
}

impl RequestLayer {
    /// A layer whose calls have so many bytes of replies in flight.
    pub fn new(methods: Arc<Methods>, replies: ByteBudget) -> RequestLayer {
        let start = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_millis() as u64);
        RequestLayer(Arc::new(CallRegistry { methods, replies, start, count: AtomicU64::new(0) }))
    }
}

impl CallRegistry {
    fn request_id(&self, headers: &HeaderMap) -> HeaderValue {
        let is_valid = |id: &&HeaderValue| {
            (1..=MAX_REQUEST_ID).contains(&id.len()) && id.as_bytes().iter().all(u8::is_ascii_graphic)
        };
        let ours = || format!("{:x}-{:x}", self.start, self.count.fetch_add(1, Ordering::Relaxed));
        let given = headers.get(REQUEST_ID).filter(is_valid).cloned();
        given.or_else(|| HeaderValue::from_str(&ours()).ok()).unwrap_or(HeaderValue::from_static("none"))
    }
}

impl<S> Layer<S> for RequestLayer {
    type Service = Instrumented<S>;

    fn layer(&self, inner: S) -> Instrumented<S> {
        Instrumented { inner, layer: self.clone() }
    }
}

#[derive(Clone)]
pub struct Instrumented<S> {
    inner: S,
    layer: RequestLayer,
}

impl<S, B> Service<Request<B>> for Instrumented<S>
where
    S: Service<Request<B>, Response = Response<Body>>,
    S::Future: Send + 'static,
    S::Error: Send + 'static,
{
    type Response = Response<Body>;
    type Error = S::Error;
    type Future = BoxFuture<'static, Result<Response<Body>, S::Error>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, mut request: Request<B>) -> Self::Future {
        let registry = self.layer.0.clone();
        let path = request.uri().path();
        let method = registry.methods.name(path).to_string();
        let one_reply = !registry.methods.streams_replies(path);
        let id = registry.request_id(request.headers());
        let request_id = id.to_str().unwrap_or_default();
        let span = tracing::info_span!("call", method, request_id);
        let tenant = KnownTenant::default();
        request.extensions_mut().insert(tenant.clone());
        let connection = request.extensions().get::<ConnectionInfo>().cloned();
        let mut call = Call::new(method, id, span.clone(), tenant, connection);
        let reply = span.in_scope(|| self.inner.call(request));
        let instrumented = async move {
            let mut response = match AssertUnwindSafe(reply).catch_unwind().await {
                Ok(reply) => reply.inspect_err(|_| call.code = Code::Unknown)?,
                Err(panic) => call.panicked(panic.as_ref()).into_http(),
            };
            clarify(response.headers_mut());
            response.headers_mut().insert(REQUEST_ID, call.id.clone());
            call.record_status(response.headers());
            let (parts, inner) = response.into_parts();
            let mut body = ReplyBody::new(inner, call, registry.replies.clone());
            if one_reply {
                // Encoded now, so that it is counted even if its caller does not read it.
                body.encode().await;
            }
            Ok(Response::from_parts(parts, Body::new(body)))
        };
        Box::pin(instrumented.instrument(span))
    }
}
