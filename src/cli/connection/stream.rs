//! Streamed replies: progress, then one result.

use super::remote::retried;
use crate::cli::error::Failure;
use crate::cli::output::progress::TaskProgress;
use tonic::{Response, Status, Streaming};

/// A streamed reply.
pub type StreamReply<M> = Result<Response<Streaming<M>>, Status>;

/// One message of a streamed reply.
pub enum StreamEvent<T> {
    /// Fraction of the work that is done: 0 to 1.
    Progress(f64),
    /// The last message.
    Result(T),
}

/// Reads a reply to its end and shows a progress bar labelled `what`; returns the result.
pub async fn result<M, T>(
    what: &'static str,
    open: impl AsyncFn() -> StreamReply<M>,
    event: impl Fn(M) -> Option<StreamEvent<T>>,
) -> Result<T, Failure> {
    let progress = TaskProgress::new(1);
    progress.show(what, 0, 0.0);
    final_result(open, event, |fraction| progress.show(what, 0, fraction)).await
}

/// Reads a reply to its end and reports its progress; returns the result. Repeats the call if the connection breaks.
pub async fn final_result<M, T>(
    open: impl AsyncFn() -> StreamReply<M>,
    event: impl Fn(M) -> Option<StreamEvent<T>>,
    progress: impl Fn(f64),
) -> Result<T, Failure> {
    let read = async || -> Result<Option<T>, Status> {
        let mut stream = open().await?.into_inner();
        let mut found = None;
        while let Some(message) = stream.message().await? {
            match event(message) {
                Some(StreamEvent::Progress(fraction)) => progress(fraction),
                Some(StreamEvent::Result(result)) => found = Some(result),
                None => {}
            }
        }
        Ok(found)
    };
    let found = retried(read).await?;
    found.ok_or_else(|| Failure::other("the reply of the service has no result; try again"))
}
