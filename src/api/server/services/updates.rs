//! Long calls: progress, then a result.

use super::{RpcResult, RpcStream};
use crate::api::convert::progress::progress_message;
use crate::api::status::status;
use crate::api::v1;
use crate::engine::{EngineError, JobHandle, JobProgress, Update};
use futures_util::stream::{self, BoxStream, StreamExt};
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;
use tonic::Response;

/// How often unchanged progress is repeated, so that a client sees that the job is alive.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// A job that fails within this time is refused without a stream, so that clients can retry by themselves.
const EARLY_FAILURE: Duration = Duration::from_millis(30);

/// What a long call does next.
pub enum CallUpdate<R> {
    Progress(JobProgress),
    /// The end.
    Done(Result<R, EngineError>),
}

/// Progress that ends with a result. It owns the job handle: who drops it leaves the job.
pub type LongCall<R> = BoxStream<'static, CallUpdate<R>>;

/// The call of a job; `finish` makes its result of what the job found.
pub async fn long_call<T, R, F>(
    job: JobHandle<T>,
    finish: impl FnOnce(Arc<T>) -> F + Send + 'static,
) -> Result<LongCall<R>, EngineError>
where
    T: Send + Sync + 'static,
    R: Send + 'static,
    F: Future<Output = Result<R, EngineError>> + Send + 'static,
{
    if let Some(error) = job.failed_within(EARLY_FAILURE).await {
        return Err(error);
    }
    let updates = stream::unfold(Some((job, finish)), |state| async move {
        let (mut job, finish) = state?;
        let update = match job.outcome() {
            Some(outcome) => Update::Done(outcome),
            None => job.next_within(HEARTBEAT).await,
        };
        Some(match update {
            Update::Progress(at) => (CallUpdate::Progress(at), Some((job, finish))),
            Update::Done(Ok(found)) => (CallUpdate::Done(finish(found).await), None),
            Update::Done(Err(error)) => (CallUpdate::Done(Err(error)), None),
        })
    });
    Ok(updates.boxed())
}

/// The call of work that reports no progress.
pub async fn long_call_of<R: Send + 'static>(
    work: impl Future<Output = Result<R, EngineError>> + Send + 'static,
) -> Result<LongCall<R>, EngineError> {
    let mut work = Box::pin(work);
    match tokio::time::timeout(EARLY_FAILURE, &mut work).await {
        Ok(early) => {
            let found = early?;
            Ok(stream::once(async { CallUpdate::Done(Ok(found)) }).boxed())
        }
        Err(_) => Ok(stream::once(async { CallUpdate::Done(work.await) }).boxed()),
    }
}

/// A long call as the stream of its method.
pub fn replies<R: Send + 'static, M: Send + 'static>(
    call: Result<LongCall<R>, EngineError>,
    progress: impl Fn(v1::Progress) -> M + Send + 'static,
    done: impl Fn(R) -> M + Send + 'static,
) -> RpcResult<RpcStream<M>> {
    let mut progress_was_sent = false;
    let replies = call.map_err(status)?.flat_map(move |update| {
        let messages = match update {
            CallUpdate::Progress(at) => {
                progress_was_sent = true;
                vec![Ok(progress(progress_message(&at)))]
            }
            // Progress comes before the result, however fast the job was.
            CallUpdate::Done(Ok(result)) if !progress_was_sent => {
                let all = v1::Progress { fraction: 1.0, ..Default::default() };
                vec![Ok(progress(all)), Ok(done(result))]
            }
            CallUpdate::Done(result) => vec![result.map(&done).map_err(status)],
        };
        stream::iter(messages)
    });
    Ok(Response::new(replies.boxed()))
}
