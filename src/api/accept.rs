//! Lets connections in: who connects and says nothing is sent away, and takes nobody's place.

use std::collections::VecDeque;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::task::AbortHandle;
use tokio_stream::wrappers::ReceiverStream;

/// First bytes of a connection: HTTP/2's preface (RFC 9113, 3.4) has as many, TLS's greeting has more.
const GREETING: usize = 24;
/// Longest that they may take.
const PATIENCE: Duration = Duration::from_secs(10);
/// How often a beginning is looked at again.
const LOOK: Duration = Duration::from_millis(20);
/// Connections that have not greeted yet; of more, the one that has waited longest is closed.
const STRANGERS: usize = 256;
/// After an error of the listener, such as too many open files.
const PAUSE: Duration = Duration::from_millis(50);

/// The connections that have greeted. It ends with its reader.
pub fn connections(listener: TcpListener) -> ReceiverStream<std::io::Result<TcpStream>> {
    let (greeted, reader) = mpsc::channel(1);
    tokio::spawn(async move {
        let mut strangers: VecDeque<AbortHandle> = VecDeque::new();
        loop {
            let accepted = tokio::select! {
                accepted = listener.accept() => accepted,
                () = greeted.closed() => return,
            };
            let stream = match accepted {
                Ok((stream, _)) => stream,
                Err(error) => {
                    tracing::warn!(%error, "a connection could not be taken");
                    tokio::time::sleep(PAUSE).await;
                    continue;
                }
            };
            let known = greeted.clone();
            let stranger = tokio::spawn(async move {
                if let Ok(Some(stream)) = tokio::time::timeout(PATIENCE, greeting(stream)).await {
                    // The server may have ended.
                    let _ = known.send(Ok(stream)).await;
                }
            });
            strangers.retain(|s| !s.is_finished());
            strangers.push_back(stranger.abort_handle());
            if strangers.len() > STRANGERS
                && let Some(oldest) = strangers.pop_front()
            {
                oldest.abort();
            }
        }
    });
    ReceiverStream::new(reader)
}

/// The connection once it has greeted; `None` if it has closed.
async fn greeting(stream: TcpStream) -> Option<TcpStream> {
    let mut bytes = [0; GREETING];
    loop {
        match stream.peek(&mut bytes).await {
            Ok(0) | Err(_) => return None,
            Ok(GREETING..) => break,
            Ok(_) => tokio::time::sleep(LOOK).await,
        }
    }
    stream.set_nodelay(true).ok()?;
    Some(stream)
}
