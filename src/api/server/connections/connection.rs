//! One connection of either port, encrypted or not: it can be closed from outside, and ends where its peer takes no bytes.

use super::seats::{Seat, TakenSeat};
use std::future::Future;
use std::io::{Error, ErrorKind, Result};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::{Sleep, sleep};
use tokio_rustls::server::TlsStream;
use tokio_util::sync::WaitForCancellationFutureOwned;
use tonic::transport::server::Connected;

/// Longest time in which a peer takes no byte of a reply.
const WRITE_STALL: Duration = Duration::from_secs(30);

enum Wire {
    Plain(TcpStream),
    Encrypted(Box<TlsStream<TcpStream>>),
}

/// An accepted connection.
pub struct AcceptedConnection {
    wire: Wire,
    info: ConnectionInfo,
    closed: Pin<Box<WaitForCancellationFutureOwned>>,
    /// Runs while the peer takes nothing.
    stalled: Option<Pin<Box<Sleep>>>,
    _seat: TakenSeat,
}

/// What requests know of their connection.
#[derive(Clone)]
pub struct ConnectionInfo {
    pub seat: Arc<Seat>,
    /// Whether the peer has shown a certificate that the authority of clients signed.
    pub has_certificate: bool,
}

impl AcceptedConnection {
    pub fn plain(stream: TcpStream, seat: TakenSeat) -> AcceptedConnection {
        AcceptedConnection::new(Wire::Plain(stream), seat, false)
    }

    pub fn encrypted(stream: TlsStream<TcpStream>, seat: TakenSeat) -> AcceptedConnection {
        let has_certificate = stream.get_ref().1.peer_certificates().is_some();
        AcceptedConnection::new(Wire::Encrypted(Box::new(stream)), seat, has_certificate)
    }

    fn new(wire: Wire, seat: TakenSeat, has_certificate: bool) -> AcceptedConnection {
        let closed = Box::pin(seat.seat.close.clone().cancelled_owned());
        let info = ConnectionInfo { seat: seat.seat.clone(), has_certificate };
        AcceptedConnection { wire, info, closed, stalled: None, _seat: seat }
    }

    pub fn info(&self) -> &ConnectionInfo {
        &self.info
    }

    fn check(&mut self, context: &mut Context<'_>) -> Result<()> {
        match self.closed.as_mut().poll(context) {
            Poll::Ready(()) => Err(Error::new(ErrorKind::ConnectionAborted, "closed for another connection")),
            Poll::Pending => Ok(()),
        }
    }

    /// An error if a write has been pending for too long.
    fn written<T>(&mut self, context: &mut Context<'_>, written: Poll<Result<T>>) -> Poll<Result<T>> {
        if written.is_ready() {
            self.stalled = None;
            return written;
        }
        let stalled = self.stalled.get_or_insert_with(|| Box::pin(sleep(WRITE_STALL)));
        ready!(stalled.as_mut().poll(context));
        Poll::Ready(Err(Error::new(ErrorKind::TimedOut, "the peer takes no bytes")))
    }
}

impl Connected for AcceptedConnection {
    type ConnectInfo = ConnectionInfo;

    fn connect_info(&self) -> ConnectionInfo {
        self.info.clone()
    }
}

impl AsyncRead for AcceptedConnection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        to: &mut ReadBuf<'_>,
    ) -> Poll<Result<()>> {
        self.check(context)?;
        match &mut self.wire {
            Wire::Plain(stream) => Pin::new(stream).poll_read(context, to),
            Wire::Encrypted(stream) => Pin::new(stream).poll_read(context, to),
        }
    }
}

impl AsyncWrite for AcceptedConnection {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, from: &[u8]) -> Poll<Result<usize>> {
        self.check(context)?;
        let written = match &mut self.wire {
            Wire::Plain(stream) => Pin::new(stream).poll_write(context, from),
            Wire::Encrypted(stream) => Pin::new(stream).poll_write(context, from),
        };
        self.written(context, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        from: &[std::io::IoSlice<'_>],
    ) -> Poll<Result<usize>> {
        self.check(context)?;
        let written = match &mut self.wire {
            Wire::Plain(stream) => Pin::new(stream).poll_write_vectored(context, from),
            Wire::Encrypted(stream) => Pin::new(stream).poll_write_vectored(context, from),
        };
        self.written(context, written)
    }

    fn is_write_vectored(&self) -> bool {
        match &self.wire {
            Wire::Plain(stream) => stream.is_write_vectored(),
            Wire::Encrypted(stream) => stream.is_write_vectored(),
        }
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        let flushed = match &mut self.wire {
            Wire::Plain(stream) => Pin::new(stream).poll_flush(context),
            Wire::Encrypted(stream) => Pin::new(stream).poll_flush(context),
        };
        self.written(context, flushed)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        let ended = match &mut self.wire {
            Wire::Plain(stream) => Pin::new(stream).poll_shutdown(context),
            Wire::Encrypted(stream) => Pin::new(stream).poll_shutdown(context),
        };
        self.written(context, ended)
    }
}
