//! The CPU pool: a fixed number of threads behind a bounded queue; jobs can be stopped and may panic.
//!
//! Invariants:
//! * At most `workers + queue` jobs are admitted at a time; a further one is refused at once with
//!   [`EngineError::Overloaded`], so that memory and waiting times stay bounded under any load.
//! * A job holds its [`QueueSlot`] until its caller has stored the result: while the disk is slow, fewer jobs start.
//! * Jobs start in the order in which they were admitted.
//! * A job that panics fails alone, with an id that the log has too.
//! * A caller gets its error as soon as its token is cancelled or its deadline passes. The job itself ends at its next
//!   check of [`JobContext::check`] (once an iteration or every few simulation steps) and keeps its slot until then.

use super::error::EngineError;
use super::metric_names;
use super::progress::{Phase, Report};
use crate::num::{Stop, Stopped};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};
use tokio_util::sync::CancellationToken;

/// What a job gets from its caller: when it must end early, and where its progress goes.
#[derive(Clone)]
pub struct JobContext {
    pub token: CancellationToken,
    pub deadline: Instant,
    pub progress: Arc<dyn Fn(Report) + Send + Sync>,
}

impl JobContext {
    /// An error if the job must end now.
    pub fn check(&self) -> Result<(), EngineError> {
        if self.token.is_cancelled() {
            Err(EngineError::Cancelled)
        } else if Instant::now() >= self.deadline {
            Err(EngineError::DeadlineExceeded)
        } else {
            Ok(())
        }
    }
}

pub struct Pool {
    threads: rayon::ThreadPool,
    admission: Arc<Semaphore>,
    capacity: usize,
    panics: AtomicU64,
    state: Arc<PoolState>,
}

/// Admission of one job. It is kept until the result is stored, so that jobs are admitted no faster than the disk writes.
pub type QueueSlot = OwnedSemaphorePermit;

/// How busy the pool is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Load {
    pub waiting: usize,
    pub running: usize,
    /// Waiting time of the oldest queued job.
    pub oldest: Duration,
}

#[derive(Default)]
struct PoolState {
    running: AtomicUsize,
    /// The number of the last job, and when each waiting job was admitted, by number.
    waiting: Mutex<(u64, BTreeMap<u64, Instant>)>,
}

impl PoolState {
    /// No code panics while it holds this lock.
    fn waiting(&self) -> MutexGuard<'_, (u64, BTreeMap<u64, Instant>)> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn enqueued(&self) -> u64 {
        let (next, jobs) = &mut *self.waiting();
        *next += 1;
        jobs.insert(*next, Instant::now());
        *next
    }

    fn started(&self, job: u64) {
        self.running.fetch_add(1, Ordering::Relaxed);
        if let Some(admitted) = self.waiting().1.remove(&job) {
            metrics::histogram!(metric_names::WAIT_SECONDS).record(admitted.elapsed());
        }
    }

    fn finished(&self, start: Instant) {
        self.running.fetch_sub(1, Ordering::Relaxed);
        metrics::histogram!(metric_names::JOB_SECONDS).record(start.elapsed());
    }
}

impl Pool {
    /// `workers` threads, and a queue of `queue` jobs.
    pub fn new(workers: usize, queue: usize) -> Result<Pool, EngineError> {
        let threads = rayon::ThreadPoolBuilder::new()
            .num_threads(workers.max(1))
            .thread_name(|i| format!("physics-{i}"))
            .build()
            .map_err(|e| EngineError::Internal { id: "pool".into(), message: e.to_string() })?;
        let capacity = workers.max(1) + queue;
        let admission = Arc::new(Semaphore::new(capacity));
        let (panics, state) = (AtomicU64::new(0), Arc::default());
        Ok(Pool { threads, admission, capacity, panics, state })
    }

    pub fn load(&self) -> Load {
        let running = self.state.running.load(Ordering::Relaxed);
        let jobs = &self.state.waiting().1;
        let oldest = jobs.values().next().map(Instant::elapsed).unwrap_or_default();
        Load { waiting: jobs.len(), running, oldest }
    }

    /// Runs a job and returns its result with its slot; see the invariants above for its errors.
    pub async fn run<T, F>(&self, context: JobContext, work: F) -> Result<(T, QueueSlot), EngineError>
    where
        T: Send + 'static,
        F: FnOnce(Stop) -> Result<T, EngineError> + Send + 'static,
    {
        let Ok(slot) = self.admission.clone().try_acquire_owned() else {
            metrics::counter!(metric_names::REFUSED).increment(1);
            return Err(EngineError::Overloaded { capacity: self.capacity });
        };
        let (reply, answer) = oneshot::channel();
        let (token, deadline) = (context.token.clone(), context.deadline);
        let (state, job) = (self.state.clone(), self.state.enqueued());
        let caller = tracing::Span::current();
        self.threads.spawn_fifo(move || {
            let _span = tracing::info_span!(parent: &caller, "job").entered();
            state.started(job);
            let start = Instant::now();
            let result = catch_unwind(AssertUnwindSafe(|| {
                context.check()?;
                (context.progress)(Report::Phase(Phase::Computing));
                let stop = |progress: f64| {
                    (context.progress)(Report::Fraction(progress));
                    context.check().map_err(|_| Stopped)
                };
                work(&stop).map_err(|error| match error.is_stopped() {
                    // The token or the deadline stopped it; `check` says which.
                    true => context.check().err().unwrap_or(EngineError::Cancelled),
                    false => error,
                })
            }));
            state.finished(start);
            // The caller may have left.
            let _ = reply.send((result, slot));
        });
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

    fn panicked(&self, panic: &(dyn std::any::Any + Send)) -> EngineError {
        metrics::counter!(metric_names::PANICKED).increment(1);
        let message = panic_message(panic);
        let id = format!("panic-{}", self.panics.fetch_add(1, Ordering::Relaxed) + 1);
        tracing::error!(id, message, "a job panicked");
        EngineError::Internal { id, message }
    }
}

/// The message of a panic.
pub fn panic_message(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|s| s.to_string());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn context() -> JobContext {
        JobContext {
            token: CancellationToken::new(),
            deadline: Instant::now() + Duration::from_secs(3600),
            progress: Arc::new(|_| {}),
        }
    }

    #[tokio::test]
    async fn a_panic_stays_in_its_job() {
        let pool = Pool::new(1, 4).unwrap();
        let broken = pool.run::<(), _>(context(), |_| panic!("injected")).await;
        assert!(matches!(broken, Err(EngineError::Internal { ref message, .. }) if message == "injected"));
        assert_eq!(pool.run(context(), |_| Ok(7)).await.unwrap().0, 7);
    }

    #[tokio::test]
    async fn a_full_queue_refuses_and_recovers() {
        let pool = Arc::new(Pool::new(1, 1).unwrap());
        let (go, wait) = std::sync::mpsc::channel::<()>();
        let busy = {
            let pool = pool.clone();
            tokio::spawn(async move { pool.run(context(), move |_| Ok(wait.recv().is_ok())).await })
        };
        while pool.admission.available_permits() == 2 {
            tokio::task::yield_now().await;
        }
        let queued = {
            let pool = pool.clone();
            tokio::spawn(async move { pool.run(context(), |_| Ok(())).await })
        };
        while pool.admission.available_permits() == 1 {
            tokio::task::yield_now().await;
        }
        let refused = pool.run(context(), |_| Ok(())).await;
        assert!(matches!(refused, Err(EngineError::Overloaded { capacity: 2 })));
        go.send(()).unwrap();
        let (done, slot) = busy.await.unwrap().unwrap();
        assert!(done);
        drop(queued.await.unwrap().unwrap());
        // A result that is not stored yet still holds its slot.
        assert_eq!(pool.admission.available_permits(), 1);
        drop(slot);
        assert_eq!(pool.admission.available_permits(), 2);
        drop(pool.run(context(), |_| Ok(())).await.unwrap());
    }

    #[tokio::test]
    async fn a_stopped_job_names_the_reason() {
        let pool = Pool::new(1, 1).unwrap();
        let late = JobContext { deadline: Instant::now(), ..context() };
        assert!(matches!(pool.run(late, |_| Ok(())).await, Err(EngineError::DeadlineExceeded)));
        let (go, wait) = std::sync::mpsc::channel::<()>();
        let soon = JobContext { deadline: Instant::now() + Duration::from_millis(20), ..context() };
        let unstopped = pool.run(soon, move |_| Ok(wait.recv().is_ok()));
        assert!(matches!(unstopped.await, Err(EngineError::DeadlineExceeded)));
        go.send(()).unwrap();
        let cancelled = context();
        let token = cancelled.token.clone();
        let stopped = pool.run::<(), _>(cancelled, move |stop| {
            token.cancel();
            Err(crate::fit::FitError::from(stop(0.5).unwrap_err()).into())
        });
        assert!(matches!(stopped.await, Err(EngineError::Cancelled)));
    }
}
