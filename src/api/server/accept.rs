//! Accepts connections. One that sends nothing is closed, so that idle connections never block others.

use std::collections::VecDeque;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::task::AbortHandle;
use tokio_stream::wrappers::ReceiverStream;

/// Bytes that a connection must send first: HTTP/2's preface (RFC 9113, 3.4) has 24, TLS's first message has more.
const FIRST_BYTES: usize = 24;
/// Longest time until they have arrived.
const FIRST_BYTES_TIMEOUT: Duration = Duration::from_secs(10);
/// How often a connection is looked at for its first bytes.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Most connections that have not sent their first bytes; beyond it the oldest is closed.
const MAX_SILENT: usize = 256;
/// Pause after an error of the listener, such as too many open files.
const ERROR_PAUSE: Duration = Duration::from_millis(50);

/// The connections that have sent their first bytes. The task ends when the stream is dropped.
pub fn connections(listener: TcpListener) -> ReceiverStream<std::io::Result<TcpStream>> {
    let (ready, reader) = mpsc::channel(1);
    tokio::spawn(async move {
        let mut silent: VecDeque<AbortHandle> = VecDeque::new();
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
            let ready = ready.clone();
            let waiting = tokio::spawn(async move {
                if let Ok(Some(stream)) = tokio::time::timeout(FIRST_BYTES_TIMEOUT, first_bytes(stream)).await
                {
                    // The server may have ended.
                    let _ = ready.send(Ok(stream)).await;
                }
            });
            silent.retain(|s| !s.is_finished());
            silent.push_back(waiting.abort_handle());
            if silent.len() > MAX_SILENT
                && let Some(oldest) = silent.pop_front()
            {
                oldest.abort();
            }
        }
    });
    ReceiverStream::new(reader)
}

/// The connection once its first bytes are there; `None` if it was closed.
async fn first_bytes(stream: TcpStream) -> Option<TcpStream> {
    let mut bytes = [0; FIRST_BYTES];
    loop {
        match stream.peek(&mut bytes).await {
            Ok(0) | Err(_) => return None,
            Ok(FIRST_BYTES..) => break,
            Ok(_) => tokio::time::sleep(POLL_INTERVAL).await,
        }
    }
    stream.set_nodelay(true).ok()?;
    Some(stream)
}
