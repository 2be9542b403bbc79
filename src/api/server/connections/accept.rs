//! Accepts connections within the places of a port, and encrypts them. One that says nothing is closed.

use super::connection::AcceptedConnection;
use super::seats::{Seats, TakenSeat};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_stream::wrappers::ReceiverStream;

/// Longest time until a connection has sent its first bytes, and until its handshake is done.
const FIRST_BYTES_TIMEOUT: Duration = Duration::from_secs(10);
/// How often a connection is looked at for its first bytes.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Pause after an error of the listener, such as too many open files.
const ERROR_PAUSE: Duration = Duration::from_millis(50);
/// Bytes of HTTP/2's preface (RFC 9113, 3.4); TLS's first message has more.
pub const HTTP2_PREFACE: usize = 24;

/// How connections of a port are accepted.
pub struct Accepting<F> {
    /// Most connections at a time.
    pub most: usize,
    /// Bytes that a connection must send first, at most [`HTTP2_PREFACE`].
    pub first_bytes: usize,
    /// The certificate of the moment; `None`: no encryption.
    pub certificate: F,
}

/// The connections that have sent their first bytes. The task ends when the stream is dropped.
pub fn connections<F>(
    listener: TcpListener,
    accepting: Accepting<F>,
) -> ReceiverStream<std::io::Result<AcceptedConnection>>
where
    F: Fn() -> Option<Arc<ServerConfig>> + Send + Sync + 'static,
{
    let (ready, reader) = mpsc::channel(1);
    let Accepting { most, first_bytes, certificate } = accepting;
    let seats = Seats::new(most);
    tokio::spawn(async move {
        loop {
            let accepted = tokio::select! {
                accepted = listener.accept() => accepted,
                () = ready.closed() => return,
            };
            let stream = match accepted {
                Ok((stream, _)) => stream,
                Err(error) => {
                    tracing::warn!(%error, "a connection could not be accepted");
                    tokio::time::sleep(ERROR_PAUSE).await;
                    continue;
                }
            };
            let Some(seat) = seats.take().await else {
                metrics::counter!(crate::api::server::metrics::REFUSED_CONNECTIONS).increment(1);
                continue;
            };
            let (ready, certificate) = (ready.clone(), certificate());
            let close = seat.seat.close.clone();
            tokio::spawn(close.run_until_cancelled_owned(async move {
                let opening = opened(stream, seat, first_bytes, certificate);
                if let Ok(Some(connection)) = tokio::time::timeout(FIRST_BYTES_TIMEOUT, opening).await {
                    // The server may have ended.
                    let _ = ready.send(Ok(connection)).await;
                }
            }));
        }
    });
    ReceiverStream::new(reader)
}

/// The connection once its first bytes are there and it is encrypted; `None` if it was closed or its handshake failed.
async fn opened(
    stream: TcpStream,
    seat: TakenSeat,
    first_bytes: usize,
    certificate: Option<Arc<ServerConfig>>,
) -> Option<AcceptedConnection> {
    let mut bytes = [0; HTTP2_PREFACE];
    let first = bytes.get_mut(..first_bytes)?;
    loop {
        match stream.peek(first).await {
            Ok(0) | Err(_) => return None,
            Ok(length) if length >= first_bytes => break,
            Ok(_) => tokio::time::sleep(POLL_INTERVAL).await,
        }
    }
    stream.set_nodelay(true).ok()?;
    let Some(certificate) = certificate else { return Some(AcceptedConnection::plain(stream, seat)) };
    match TlsAcceptor::from(certificate).accept(stream).await {
        Ok(stream) => Some(AcceptedConnection::encrypted(stream, seat)),
        Err(error) => {
            tracing::debug!(%error, "a TLS handshake failed");
            None
        }
    }
}
