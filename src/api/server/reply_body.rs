//! The body of a reply: its bytes are counted until they are sent, and its trailers hold the status of the call.

use super::byte_budget::{ByteBudget, OverBudget, ReservedBytes};
use super::call::Call;
use crate::api::status::clarify;
use bytes::Bytes;
use http::HeaderMap;
use http_body::{Body as _, Frame, SizeHint};
use std::future::poll_fn;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::task::{Context, Poll};
use tonic::Status;
use tonic::body::Body;

/// Frames below this size are not counted: all streams of all connections together hold few of them.
const SMALL: usize = 1024;

pub struct ReplyBody {
    inner: Body,
    call: Call,
    budget: ByteBudget,
    /// The frame that was encoded before it was asked for.
    first: Option<Frame<Bytes>>,
}

/// Bytes with their reservation: it ends when the last of them is sent.
struct CountedBytes {
    bytes: Bytes,
    _reserved: ReservedBytes,
}

impl AsRef<[u8]> for CountedBytes {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

impl ReplyBody {
    pub fn new(inner: Body, call: Call, budget: ByteBudget) -> ReplyBody {
        ReplyBody { inner, call, budget, first: None }
    }

    /// Encodes and counts the first frame.
    pub async fn encode(&mut self) {
        if self.inner.is_end_stream() {
            return;
        }
        // A reply of one message has no error but its status.
        self.first = poll_fn(|context| self.poll_next(context)).await.and_then(Result::ok);
    }

    fn poll_next(&mut self, context: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let entered = self.call.span.clone().entered();
        let inner = &mut self.inner;
        let polled = catch_unwind(AssertUnwindSafe(|| Pin::new(inner).poll_frame(context)));
        drop(entered);
        let frame = match polled {
            Ok(Poll::Ready(Some(Ok(frame)))) => frame,
            Ok(other) => return other,
            Err(panic) => self.end_with(&self.call.panicked(panic.as_ref())),
        };
        let frame = match frame.into_data() {
            Ok(bytes) => match self.counted(bytes) {
                Ok(bytes) => Frame::data(bytes),
                Err(over) => self.end_with(&over.refusal("read replies, or try again later")),
            },
            Err(frame) => frame,
        };
        let frame = match frame.into_trailers() {
            Ok(mut trailers) => {
                clarify(&mut trailers);
                self.call.record_status(&trailers);
                Frame::trailers(trailers)
            }
            Err(frame) => frame,
        };
        Poll::Ready(Some(Ok(frame)))
    }

    /// The trailers of a status; nothing follows.
    fn end_with(&mut self, status: &Status) -> Frame<Bytes> {
        let mut trailers = HeaderMap::new();
        // If the status cannot be encoded, the client sees a stream without one, which is an error too.
        let _ = status.add_header(&mut trailers);
        self.inner = Body::empty();
        Frame::trailers(trailers)
    }

    fn counted(&self, bytes: Bytes) -> Result<Bytes, OverBudget> {
        if bytes.len() < SMALL {
            return Ok(bytes);
        }
        let (holder, close) = self.call.reader();
        let reserved = self.budget.reserve_closable(&holder, bytes.len(), &close)?;
        Ok(counted(bytes, reserved))
    }
}

/// Bytes that hold their reservation.
pub fn counted(bytes: Bytes, reserved: ReservedBytes) -> Bytes {
    Bytes::from_owner(CountedBytes { bytes, _reserved: reserved })
}

impl http_body::Body for ReplyBody {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        match self.first.take() {
            Some(frame) => Poll::Ready(Some(Ok(frame))),
            None => self.poll_next(context),
        }
    }

    fn is_end_stream(&self) -> bool {
        self.first.is_none() && self.inner.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        match self.first {
            Some(_) => SizeHint::default(),
            None => self.inner.size_hint(),
        }
    }
}
