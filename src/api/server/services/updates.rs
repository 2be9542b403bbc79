//! Streams of progress that end with a result.

use super::{RpcResult, RpcStream};
use crate::api::status::status;
use crate::engine::{EngineError, JobHandle, Update};
use futures_util::stream::{self, StreamExt};
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;
use tonic::{Response, Status};

/// How often unchanged progress is repeated, so that a client sees that the job is alive.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// A job that fails within this time is refused without a stream, so that clients can retry by themselves.
const EARLY_FAILURE: Duration = Duration::from_millis(30);

/// A stream of progress that ends with the result. The stream owns the job handle: a caller who leaves drops it.
pub async fn updates<T: Send + Sync + 'static, M: Send + 'static>(
    job: JobHandle<T>,
    progress: impl Fn(f64) -> M + Copy + Send + 'static,
    done: impl Fn(&T) -> Option<M> + Send + 'static,
) -> RpcResult<RpcStream<M>> {
    updates_then(job, progress, move |found: Arc<T>| std::future::ready(Ok(done(&found)))).await
}

/// The same, where more work turns what was found into the result.
pub async fn updates_then<T, M, F>(
    job: JobHandle<T>,
    progress: impl Fn(f64) -> M + Copy + Send + 'static,
    done: impl FnOnce(Arc<T>) -> F + Send + 'static,
) -> RpcResult<RpcStream<M>>
where
    T: Send + Sync + 'static,
    M: Send + 'static,
    F: Future<Output = Result<Option<M>, EngineError>> + Send,
{
    if let Some(error) = job.failed_within(EARLY_FAILURE).await {
        return Err(status(error));
    }
    let updates = stream::unfold(Some((job, done, false)), move |state| async move {
        let (mut job, done, progress_was_sent) = state?;
        let update = match job.outcome() {
            Some(outcome) => Update::Done(outcome),
            None => job.next_within(HEARTBEAT).await,
        };
        Some(match update {
            Update::Progress(fraction) => (Ok(progress(fraction)), Some((job, done, true))),
            // Progress comes before the result, however fast the job was.
            Update::Done(Ok(_)) if !progress_was_sent => (Ok(progress(1.0)), Some((job, done, true))),
            Update::Done(Ok(found)) => {
                let other = || Status::internal("the job has another kind of result than the request");
                (done(found).await.map_err(status).and_then(|made| made.ok_or_else(other)), None)
            }
            Update::Done(Err(error)) => (Err(status(error)), None),
        })
    });
    Ok(Response::new(updates.boxed()))
}
