//! The CPU pool: a fixed number of threads behind a bounded queue; jobs can be stopped and may panic.

use super::{EngineError, figures};
use crate::num::{Stop, Stopped};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};
use tokio_util::sync::CancellationToken;

/// What ends a job early, and where its progress goes.
#[derive(Clone)]
pub struct Control {
    pub token: CancellationToken,
    pub deadline: Instant,
    pub progress: Arc<dyn Fn(f64) + Send + Sync>,
}

impl Control {
    /// The error that fits, if the job should end now.
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
    state: Arc<State>,
}

/// The place of a job among those that were admitted. Who keeps it until the result is stored too is admitted no faster
/// than the disk can follow.
pub type Place = OwnedSemaphorePermit;

/// How busy the pool is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Load {
    pub waiting: usize,
    pub running: usize,
    /// How long the job that waits longest has waited.
    pub oldest: Duration,
}

#[derive(Default)]
struct State {
    running: AtomicUsize,
    /// When each job that waits came, in the order of their coming.
    waiting: Mutex<(u64, BTreeMap<u64, Instant>)>,
}

impl State {
    /// No code panics while it holds this lock.
    fn waiting(&self) -> MutexGuard<'_, (u64, BTreeMap<u64, Instant>)> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn comes(&self) -> u64 {
        let (next, jobs) = &mut *self.waiting();
        *next += 1;
        jobs.insert(*next, Instant::now());
        *next
    }

    fn begins(&self, job: u64) {
        self.running.fetch_add(1, Ordering::Relaxed);
        if let Some(came) = self.waiting().1.remove(&job) {
            metrics::histogram!(figures::WAIT_SECONDS).record(came.elapsed());
        }
    }

    fn ends(&self, began: Instant) {
        self.running.fetch_sub(1, Ordering::Relaxed);
        metrics::histogram!(figures::JOB_SECONDS).record(began.elapsed());
    }
}

impl Pool {
    /// `workers` threads, and room for `queue` jobs that wait.
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

    /// Runs a job; refuses it at once where the queue is full. A panic is this job's error and nobody else's.
    /// The caller hears of the deadline and of a cancellation at once; the job keeps its place until it notices.
    pub async fn run<T, F>(&self, control: Control, work: F) -> Result<(T, Place), EngineError>
    where
        T: Send + 'static,
        F: FnOnce(Stop) -> Result<T, EngineError> + Send + 'static,
    {
        let Ok(place) = self.admission.clone().try_acquire_owned() else {
            metrics::counter!(figures::REFUSED).increment(1);
            return Err(EngineError::Overloaded { capacity: self.capacity });
        };
        let (reply, answer) = oneshot::channel();
        let (token, deadline) = (control.token.clone(), control.deadline);
        let (state, job) = (self.state.clone(), self.state.comes());
        let caller = tracing::Span::current();
        self.threads.spawn_fifo(move || {
            let _span = tracing::info_span!(parent: &caller, "job").entered();
            state.begins(job);
            let began = Instant::now();
            let result = catch_unwind(AssertUnwindSafe(|| {
                control.check()?;
                let stop = |progress: f64| {
                    (control.progress)(progress);
                    control.check().map_err(|_| Stopped)
                };
                work(&stop).map_err(|error| match error.is_stopped() {
                    // What stopped it: a caller, unless only the clock did.
                    true => control.check().err().unwrap_or(EngineError::Cancelled),
                    false => error,
                })
            }));
            state.ends(began);
            // The caller may have gone.
            let _ = reply.send((result, place));
        });
        let answer = tokio::select! {
            biased;
            answer = answer => answer,
            () = token.cancelled() => return Err(EngineError::Cancelled),
            () = tokio::time::sleep_until(deadline.into()) => return Err(EngineError::DeadlineExceeded),
        };
        match answer {
            Ok((Ok(result), place)) => Ok((result?, place)),
            Ok((Err(panic), _)) => Err(self.panicked(panic.as_ref())),
            Err(_) => Err(self.panicked(&"the job was lost")),
        }
    }

    fn panicked(&self, panic: &(dyn std::any::Any + Send)) -> EngineError {
        metrics::counter!(figures::PANICKED).increment(1);
        let message = panic_message(panic);
        let id = format!("panic-{}", self.panics.fetch_add(1, Ordering::Relaxed) + 1);
        tracing::error!(id, message, "a job panicked");
        EngineError::Internal { id, message }
    }
}

/// What a panic said.
pub fn panic_message(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|s| s.to_string());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn control() -> Control {
        Control {
            token: CancellationToken::new(),
            deadline: Instant::now() + Duration::from_secs(3600),
            progress: Arc::new(|_| {}),
        }
    }

    #[tokio::test]
    async fn a_panic_stays_in_its_job() {
        let pool = Pool::new(1, 4).unwrap();
        let broken = pool.run::<(), _>(control(), |_| panic!("injected")).await;
        assert!(matches!(broken, Err(EngineError::Internal { ref message, .. }) if message == "injected"));
        assert_eq!(pool.run(control(), |_| Ok(7)).await.unwrap().0, 7);
    }

    #[tokio::test]
    async fn a_full_queue_refuses_and_recovers() {
        let pool = Arc::new(Pool::new(1, 1).unwrap());
        let (go, wait) = std::sync::mpsc::channel::<()>();
        let busy = {
            let pool = pool.clone();
            tokio::spawn(async move { pool.run(control(), move |_| Ok(wait.recv().is_ok())).await })
        };
        while pool.admission.available_permits() == 2 {
            tokio::task::yield_now().await;
        }
        let queued = {
            let pool = pool.clone();
            tokio::spawn(async move { pool.run(control(), |_| Ok(())).await })
        };
        while pool.admission.available_permits() == 1 {
            tokio::task::yield_now().await;
        }
        let refused = pool.run(control(), |_| Ok(())).await;
        assert!(matches!(refused, Err(EngineError::Overloaded { capacity: 2 })));
        go.send(()).unwrap();
        let (done, place) = busy.await.unwrap().unwrap();
        assert!(done);
        drop(queued.await.unwrap().unwrap());
        // What is done and not yet stored counts.
        assert_eq!(pool.admission.available_permits(), 1);
        drop(place);
        assert_eq!(pool.admission.available_permits(), 2);
        drop(pool.run(control(), |_| Ok(())).await.unwrap());
    }

    #[tokio::test]
    async fn a_stopped_job_says_what_stopped_it() {
        let pool = Pool::new(1, 1).unwrap();
        let late = Control { deadline: Instant::now(), ..control() };
        assert!(matches!(pool.run(late, |_| Ok(())).await, Err(EngineError::DeadlineExceeded)));
        let (go, wait) = std::sync::mpsc::channel::<()>();
        let soon = Control { deadline: Instant::now() + Duration::from_millis(20), ..control() };
        let deaf = pool.run(soon, move |_| Ok(wait.recv().is_ok()));
        assert!(matches!(deaf.await, Err(EngineError::DeadlineExceeded)));
        go.send(()).unwrap();
        let cancelled = control();
        let token = cancelled.token.clone();
        let stopped = pool.run::<(), _>(cancelled, move |stop| {
            token.cancel();
            Err(crate::fit::FitError::from(stop(0.5).unwrap_err()).into())
        });
        assert!(matches!(stopped.await, Err(EngineError::Cancelled)));
    }
}
