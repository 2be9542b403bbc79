//! What every call gets: a request id, a span in the logs, its metrics, and a reply where it panics.

use super::metrics::{CALL_SECONDS, CALLS, methods};
use crate::api::status::status;
use crate::engine::{EngineError, panic_message};
use bytes::Bytes;
use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use http::{HeaderMap, HeaderValue, Request, Response};
use http_body::{Frame, SizeHint};
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::{Instant, SystemTime, UNIX_EPOCH};
use tonic::body::Body;
use tonic::{Code, Status};
use tower::{Layer, Service};
use tracing::{Instrument, Span};

/// The header with a request's id; a request without one gets one of ours. Every reply has it.
pub const REQUEST_ID: &str = "x-request-id";
/// Longest id that is taken from a request.
const MAX_REQUEST_ID: usize = 128;

/// The layer.
#[derive(Clone)]
pub struct RequestLayer(Arc<CallRegistry>);

struct CallRegistry {
    methods: BTreeSet<String>,
    /// Milliseconds after 1970; distinguishes the ids of this start from those of earlier ones.
    start: u64,
    count: AtomicU64,
}

impl RequestLayer {
    pub fn new() -> RequestLayer {
        let start = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_millis() as u64);
        RequestLayer(Arc::new(CallRegistry { methods: methods(), start, count: AtomicU64::new(0) }))
    }
}

impl CallRegistry {
    fn method(&self, path: &str) -> &str {
        self.methods.get(path).map_or("other", |path| path.trim_start_matches('/'))
    }

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

    fn call(&mut self, request: Request<B>) -> Self::Future {
        let registry = &self.layer.0;
        let method = registry.method(request.uri().path()).to_string();
        let id = registry.request_id(request.headers());
        let request_id = id.to_str().unwrap_or_default();
        let span = tracing::info_span!("call", method, request_id);
        let mut call = Call { method, id, start: Instant::now(), code: Code::Cancelled, span: span.clone() };
        let reply = span.in_scope(|| self.inner.call(request));
        let instrumented = async move {
            let mut response = match AssertUnwindSafe(reply).catch_unwind().await {
                Ok(reply) => reply.inspect_err(|_| call.code = Code::Unknown)?,
                Err(panic) => call.panicked(panic.as_ref()).into_http(),
            };
            response.headers_mut().insert(REQUEST_ID, call.id.clone());
            call.record_status(response.headers());
            Ok(response.map(|inner| Body::new(InstrumentedBody { inner, call })))
        };
        Box::pin(instrumented.instrument(span))
    }
}

/// A running call; its metrics are recorded when it is dropped, however it ends.
struct Call {
    method: String,
    id: HeaderValue,
    start: Instant,
    /// `Cancelled` until a status is seen: a call that is dropped before its end was cancelled.
    code: Code,
    span: Span,
}

impl Call {
    fn record_status(&mut self, fields: &HeaderMap) {
        if let Some(code) = fields.get(Status::GRPC_STATUS) {
            self.code = Code::from_bytes(code.as_bytes());
        }
    }

    fn panicked(&self, panic: &(dyn std::any::Any + Send)) -> Status {
        let message = panic_message(panic);
        tracing::error!(message, "a call panicked");
        let id = self.id.to_str().unwrap_or_default();
        status(EngineError::Internal { id: id.into(), message })
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        let (seconds, method) = (self.start.elapsed().as_secs_f64(), self.method.clone());
        let code = format!("{:?}", self.code);
        self.span.in_scope(|| tracing::debug!(code, seconds, "call ended"));
        metrics::histogram!(CALL_SECONDS, "method" => method.clone()).record(seconds);
        metrics::counter!(CALLS, "method" => method, "code" => code).increment(1);
    }
}

/// The reply's body; its trailers hold the status of the call.
struct InstrumentedBody {
    inner: Body,
    call: Call,
}

impl http_body::Body for InstrumentedBody {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let InstrumentedBody { inner, call } = &mut *self;
        let entered = call.span.clone().entered();
        let polled = catch_unwind(AssertUnwindSafe(|| Pin::new(&mut *inner).poll_frame(context)));
        drop(entered);
        let polled = polled.unwrap_or_else(|panic| {
            let mut trailers = HeaderMap::new();
            // If the status cannot be encoded, the client sees a stream without one, which is an error too.
            let _ = call.panicked(panic.as_ref()).add_header(&mut trailers);
            *inner = Body::empty();
            Poll::Ready(Some(Ok(Frame::trailers(trailers))))
        });
        if let Poll::Ready(Some(Ok(frame))) = &polled
            && let Some(trailers) = frame.trailers_ref()
        {
            call.record_status(trailers);
        }
        polled
    }

    fn is_end_stream(&self) -> bool {
        self.inner.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.inner.size_hint()
    }
}
