//! The body of a call while it arrives: its messages have a limit, a budget and a deadline.
//!
//! A gRPC message says its length in front. It is reserved before a byte of the message is kept, so that a caller is refused at
//! once and not when the memory is full.

use super::byte_budget::{ByteBudget, HeldBytes, Holder, PREFIX};
use super::connections::connection::ConnectionInfo;
use super::metrics::Methods;
use crate::api::status::{malformed, plain, too_large};
use bytes::Bytes;
use http::Request;
use http_body::{Frame, SizeHint};
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::time::{Instant, Sleep, sleep_until};
use tonic::body::Body;
use tonic::{Code, Status};
use tower::{Layer, Service};

/// Longest time without a byte of a message that has started, or of a call with one message.
const IDLE: Duration = Duration::from_secs(10);
/// Slowest rate at which a message must arrive (bytes/s): half a megabit a second.
const SLOWEST: u64 = 64 << 10;

/// The layer.
#[derive(Clone)]
pub struct BodyLayer {
    /// Longest message (bytes).
    pub most: usize,
    pub budget: ByteBudget,
    pub methods: Arc<Methods>,
}

impl<S> Layer<S> for BodyLayer {
    type Service = Budgeted<S>;

    fn layer(&self, inner: S) -> Budgeted<S> {
        Budgeted { inner, layer: self.clone() }
    }
}

#[derive(Clone)]
pub struct Budgeted<S> {
    inner: S,
    layer: BodyLayer,
}

impl<S, B> Service<Request<B>> for Budgeted<S>
where
    S: Service<Request<Body>>,
    B: http_body::Body<Data = Bytes> + Send + 'static,
    B::Error: Into<Box<dyn std::error::Error + Send + Sync>>,
{
    type Response = S::Response;
    type Error = S::Error;
    type Future = S::Future;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, request: Request<B>) -> Self::Future {
        let (mut parts, body) = request.into_parts();
        let streams = self.layer.methods.streams_requests(parts.uri.path());
        let held = HeldBytes::default();
        let body = RequestBody {
            inner: Body::new(body),
            most: self.layer.most,
            budget: self.layer.budget.clone(),
            holder: holder(&parts.extensions),
            held: held.clone(),
            framing: Framing::default(),
            streams,
            received: 0,
            waited: Duration::ZERO,
            idle: None,
        };
        parts.extensions.insert(held);
        self.inner.call(Request::from_parts(parts, Body::new(body)))
    }
}

/// Who a call's bytes are counted for.
pub fn holder(extensions: &http::Extensions) -> Holder {
    Holder::of(extensions.get(), extensions.get().map(|info: &ConnectionInfo| info.seat.id))
}

/// Where a body is: in a prefix, or with so many bytes of a message to come.
#[derive(Debug, Default, PartialEq)]
struct Framing {
    prefix: Vec<u8>,
    left: usize,
}

impl Framing {
    fn is_between(&self) -> bool {
        self.prefix.is_empty() && self.left == 0
    }

    /// Passes bytes; the lengths of the messages that start in them go to `start`.
    fn pass(
        &mut self,
        mut bytes: &[u8],
        mut start: impl FnMut(usize) -> Result<(), Status>,
    ) -> Result<(), Status> {
        while !bytes.is_empty() {
            if self.left > 0 {
                let part = self.left.min(bytes.len());
                self.left -= part;
                bytes = bytes.get(part..).unwrap_or_default();
                continue;
            }
            let (head, rest) = bytes.split_at(bytes.len().min(PREFIX - self.prefix.len()));
            self.prefix.extend_from_slice(head);
            bytes = rest;
            if let Ok([flag, length @ ..]) = <[u8; PREFIX]>::try_from(self.prefix.as_slice()) {
                if flag > 1 {
                    return Err(malformed("its first byte, the flag of compression, is neither 0 nor 1"));
                }
                self.prefix.clear();
                self.left = u32::from_be_bytes(length) as usize;
                start(self.left)?;
            }
        }
        Ok(())
    }
}

struct RequestBody {
    inner: Body,
    most: usize,
    budget: ByteBudget,
    holder: Holder,
    held: HeldBytes,
    framing: Framing,
    /// Whether the call takes a stream of messages: between two of them it may wait.
    streams: bool,
    /// Bytes of the message that have come, and the time in which this service waited for them.
    received: u64,
    waited: Duration,
    /// Since when no byte arrives, and until when one must.
    idle: Option<(Instant, Pin<Box<Sleep>>)>,
}

impl RequestBody {
    fn take(&mut self, bytes: &[u8]) -> Result<(), Status> {
        let RequestBody { most, budget, holder, held, framing, streams, received, waited, .. } = self;
        framing.pass(bytes, |length| {
            if length > *most {
                let message = format!(
                    "the message has {length} bytes, the limit is {most}; leave out stills, send fewer objects or frames, or \
                     send the video's file with ImportVideo"
                );
                return Err(too_large(message));
            }
            if *streams {
                // The message before has been handed on.
                held.clear();
            }
            (*received, *waited) = (0, Duration::ZERO);
            held.add(budget.reserve(holder, length)?);
            Ok(())
        })?;
        *received += bytes.len() as u64;
        Ok(())
    }

    /// A status if the body has been silent or slow for too long.
    fn overdue(&mut self, context: &mut Context<'_>) -> Option<Status> {
        if self.streams && self.framing.is_between() {
            self.idle = None;
            return None;
        }
        if self.idle.is_none() {
            // A sender of single bytes is late as soon as one that sends nothing.
            let allowed = (IDLE + Duration::from_secs(self.received / SLOWEST)).saturating_sub(self.waited);
            let since = Instant::now();
            self.idle = Some((since, Box::pin(sleep_until(since + allowed.min(IDLE)))));
        }
        let (_, sleep) = self.idle.as_mut()?;
        sleep.as_mut().poll(context).is_ready().then(|| {
            let message = format!(
                "the request stopped arriving: at most {} s may pass without a byte, and {SLOWEST} bytes/s is the slowest rate",
                IDLE.as_secs()
            );
            plain(Code::DeadlineExceeded, message, "REQUEST_TOO_SLOW")
        })
    }
}

impl http_body::Body for RequestBody {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let polled = http_body::Body::poll_frame(Pin::new(&mut self.inner), context);
        match &polled {
            Poll::Ready(Some(Ok(frame))) => {
                if let Some((since, _)) = self.idle.take() {
                    self.waited += since.elapsed();
                }
                if let Some(Err(refusal)) = frame.data_ref().map(|bytes| self.take(bytes)) {
                    return Poll::Ready(Some(Err(refusal)));
                }
                polled
            }
            Poll::Ready(_) => polled,
            Poll::Pending => match self.overdue(context) {
                Some(status) => Poll::Ready(Some(Err(status))),
                None => Poll::Pending,
            },
        }
    }

    fn is_end_stream(&self) -> bool {
        http_body::Body::is_end_stream(&self.inner)
    }

    fn size_hint(&self) -> SizeHint {
        http_body::Body::size_hint(&self.inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_found_wherever_the_frames_are_cut() {
        let bodies = [&[0, 0, 0, 0, 3, 7, 7, 7][..], &[0, 0, 0, 0, 0], &[0, 0, 0, 1, 0], &[9; 256]].concat();
        for size in 1..20 {
            let (mut framing, mut found) = (Framing::default(), vec![]);
            for part in bodies.chunks(size) {
                let start = |length| {
                    found.push(length);
                    Ok(())
                };
                framing.pass(part, start).unwrap();
            }
            assert_eq!((found, framing), (vec![3, 0, 256], Framing::default()));
        }
        let refused = Framing::default().pass(&[7, 0, 0, 0, 0], |_| Ok(())).unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument);
    }
}
