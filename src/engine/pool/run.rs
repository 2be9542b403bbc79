//! Hands a job to the workers, and its result back to its caller.

use super::admission::{Admission, QueueSlot};
use super::class::JobKind;
use super::context::JobContext;
use super::fair_queue::QueueTicket;
use super::scheduler::{Delivery, JobWork, Load, QueuedJob, Scheduler, WorkerHold};
use crate::engine::error::EngineError;
use crate::engine::metric_names;
use crate::engine::progress::{Phase, Report};
use crate::num::{Stop, Stopped};
use crate::store::Tenant;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;

pub struct Pool {
    scheduler: Arc<Scheduler>,
    admission: Arc<Admission>,
    panics: AtomicU64,
}

impl Drop for Pool {
    fn drop(&mut self) {
        self.scheduler.close();
    }
}

/// What a job has made, or its panic.
type JobResult<T> = std::thread::Result<Result<T, EngineError>>;

/// Takes a job out of the queue, or stops it, when its caller no longer waits for it.
struct Withdrawal {
    scheduler: Arc<Scheduler>,
    ticket: QueueTicket,
    token: CancellationToken,
}

impl Drop for Withdrawal {
    fn drop(&mut self) {
        self.token.cancel();
        drop(self.scheduler.withdraw(&self.ticket));
    }
}

impl Pool {
    /// `workers` workers, and a queue of `queue` jobs.
    pub fn new(workers: usize, queue: usize) -> Result<Pool, EngineError> {
        let workers = workers.max(1);
        let (scheduler, admission) = (Scheduler::start(workers)?, Admission::new(workers + queue));
        Ok(Pool { scheduler, admission, panics: AtomicU64::new(0) })
    }

    pub fn load(&self) -> Load {
        self.scheduler.load()
    }

    /// Runs a job of the tenant and returns its result with its slot; the module lists its errors. The job is stopped when
    /// this future is dropped.
    pub async fn run<T, F>(
        &self,
        (tenant, kind): (&Tenant, JobKind),
        context: JobContext,
        work: F,
    ) -> Result<(T, QueueSlot), EngineError>
    where
        T: Send + 'static,
        F: FnOnce(Stop) -> Result<T, EngineError> + Send + 'static,
    {
        let slot = self.admission.admit(tenant).inspect_err(|_| {
            metrics::counter!(metric_names::REFUSED).increment(1);
        })?;
        let (reply, answer) = oneshot::channel();
        let (token, deadline) = (context.token.clone(), context.deadline);
        let of_job = token.child_token();
        let context = JobContext { token: of_job.clone(), ..context };
        let caller = tracing::Span::current();
        let work: JobWork = Box::new(move |hold| -> Delivery {
            let span = tracing::info_span!(parent: &caller, "job", kind = kind.name());
            let result = span.in_scope(|| perform(context, work, hold));
            // The caller may have left.
            Box::new(move || drop(reply.send((result, slot))))
        });
        let job = QueuedJob { admitted: Instant::now(), work };
        let ticket = self.scheduler.push(tenant, kind.class(), job);
        let _withdrawal = Withdrawal { scheduler: self.scheduler.clone(), ticket, token: of_job };
        let answer = tokio::select! {
            biased;
            answer = answer => answer,
            () = token.cancelled() => return Err(EngineError::Cancelled),
            () = tokio::time::sleep_until(deadline.into()) => return Err(EngineError::DeadlineExceeded),
        };
        match answer {
            Ok((Ok(result), slot)) => Ok((result?, slot)),
            Ok((Err(panic), _)) => Err(self.panicked(panic.as_ref())),
            Err(_) => Err(self.panicked(&"the job ended without a result")),
        }
    }

    fn panicked(&self, panic: &(dyn Any + Send)) -> EngineError {
        metrics::counter!(metric_names::PANICKED).increment(1);
        let message = panic_message(panic);
        let id = format!("panic-{}", self.panics.fetch_add(1, Ordering::Relaxed) + 1);
        tracing::error!(id, message, "a job panicked");
        EngineError::Internal { id, message }
    }
}

/// Performs a job on a worker, until it is done or must end.
fn perform<T, F>(context: JobContext, work: F, hold: &WorkerHold) -> JobResult<T>
where
    F: FnOnce(Stop) -> Result<T, EngineError>,
{
    catch_unwind(AssertUnwindSafe(|| {
        context.check()?;
        (context.progress)(Report::Phase(Phase::Computing));
        let stop = |progress: f64| {
            (context.progress)(Report::Fraction(progress));
            hold.give_way(&|| context.check().is_err());
            context.check().map_err(|_| Stopped)
        };
        work(&stop).map_err(|error| match error.is_stopped() {
            // The token or the deadline stopped it; `check` says which.
            true => context.check().err().unwrap_or(EngineError::Cancelled),
            false => error,
        })
    }))
}

/// The message of a panic.
pub fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|s| s.to_string());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default()
}
