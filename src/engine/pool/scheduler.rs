//! The workers: plain threads, each of which takes the next job from the queue and runs it on threads of that job alone.
//!
//! Where longer jobs hold all workers and a shorter one waits, one of them pauses in its next check: it holds its state and its
//! slot, but no worker. It runs again when no shorter job waits, or when it has paused for as long as it ran before. There are
//! two more threads than workers, which take the jobs that run meanwhile.

use super::class::JobClass;
use super::fair_queue::{FairQueue, QueueTicket, StartedJob};
use super::job_threads::{IdleThreads, thread_pool, timed};
use crate::engine::error::EngineError;
use crate::engine::metric_names;
use crate::store::Tenant;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Jobs that may pause at a time: one medium and one long.
const MOST_PAUSED: usize = 2;
/// Least time for which a job runs between two pauses.
const LEAST_RUN: Duration = Duration::from_millis(20);
/// How often a paused job looks whether it was cancelled.
const PAUSE_CHECK: Duration = Duration::from_millis(5);

/// What a job does when its worker is free again: it hands its result over.
pub type Delivery = Box<dyn FnOnce() + Send>;
/// A job: it runs with its hold on a worker.
pub type JobWork = Box<dyn FnOnce(&WorkerHold) -> Delivery + Send>;

/// A job in the queue.
pub struct QueuedJob {
    pub admitted: Instant,
    pub work: JobWork,
}

/// How busy the pool is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Load {
    /// Paused jobs wait, too.
    pub waiting: usize,
    pub running: usize,
    /// Waiting time of the oldest queued job.
    pub oldest: Duration,
}

/// What the workers share.
pub struct Scheduler {
    queue: Mutex<FairQueue<QueuedJob>>,
    /// A job may start.
    ready: Condvar,
    /// A paused job may go on.
    resumed: Condvar,
    /// By class: whether its jobs should ask to pause.
    is_pressed: [AtomicBool; 3],
    closed: AtomicBool,
    idle_threads: IdleThreads,
}

/// A running job's hold on a worker, which it can lend.
pub struct WorkerHold {
    scheduler: Arc<Scheduler>,
    class: JobClass,
    paused: AtomicBool,
    /// When it got its worker last.
    since: Mutex<Instant>,
}

impl Scheduler {
    /// Starts the threads.
    pub fn start(workers: usize) -> Result<Arc<Scheduler>, EngineError> {
        let scheduler = Arc::new(Scheduler {
            queue: Mutex::new(FairQueue::new(workers)),
            ready: Condvar::new(),
            resumed: Condvar::new(),
            is_pressed: Default::default(),
            closed: AtomicBool::new(false),
            idle_threads: IdleThreads::new(workers),
        });
        let failed = |message: String| EngineError::Internal { id: "pool".into(), message };
        for k in 0..workers + MOST_PAUSED {
            let own = thread_pool(1).map_err(|e| failed(e.to_string()))?;
            let shared = scheduler.clone();
            let thread = std::thread::Builder::new().name(format!("worker-{k}"));
            thread.spawn(move || shared.work(&own)).map_err(|e| failed(e.to_string()))?;
        }
        Ok(scheduler)
    }

    pub fn push(&self, tenant: &Tenant, class: JobClass, job: QueuedJob) -> QueueTicket {
        let mut queue = self.queue();
        let ticket = queue.push(tenant, class, job);
        self.changed(&queue);
        ticket
    }

    /// Takes out a job that still waits; its slot is free when it is dropped.
    pub fn withdraw(&self, ticket: &QueueTicket) -> Option<QueuedJob> {
        let mut queue = self.queue();
        let job = queue.remove(ticket);
        self.changed(&queue);
        job
    }

    pub fn load(&self) -> Load {
        let queue = self.queue();
        let oldest = queue.fronts().map(|job| job.admitted.elapsed()).max().unwrap_or_default();
        Load { waiting: queue.waiting() + queue.paused(), running: queue.running(), oldest }
    }

    /// Ends the threads when their jobs have ended; what waits is dropped.
    pub fn close(&self) {
        self.closed.store(true, Ordering::SeqCst);
        let queue = self.queue();
        self.ready.notify_all();
        self.resumed.notify_all();
        drop(queue);
    }

    /// No code panics while it holds this lock.
    fn queue(&self) -> MutexGuard<'_, FairQueue<QueuedJob>> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wakes whom a change of the queue concerns.
    fn changed(&self, queue: &FairQueue<QueuedJob>) {
        for class in JobClass::ALL {
            self.is_pressed[class as usize].store(queue.must_pause(class), Ordering::Relaxed);
        }
        if queue.waiting() > 0 && !queue.is_full() {
            self.ready.notify_one();
        }
        self.resumed.notify_all();
    }

    /// One worker thread.
    fn work(self: Arc<Self>, own: &rayon::ThreadPool) {
        while let Some(StartedJob { ticket, job, threads }) = self.next() {
            metrics::histogram!(metric_names::WAIT_SECONDS).record(job.admitted.elapsed());
            let start = Instant::now();
            let hold = WorkerHold {
                scheduler: self.clone(),
                class: ticket.class,
                paused: AtomicBool::new(false),
                since: Mutex::new(start),
            };
            let several = (threads > 1).then(|| self.idle_threads.take(threads)).flatten();
            let is_short = ticket.class == JobClass::Short;
            let run = || timed(several.as_ref().unwrap_or(own), is_short, || (job.work)(&hold));
            // The work catches its own panics; this is for those of what it drops.
            let ended = catch_unwind(AssertUnwindSafe(run));
            if let Some(several) = several {
                self.idle_threads.put(several);
            }
            metrics::histogram!(metric_names::JOB_SECONDS).record(start.elapsed());
            let (delivery, cost) = match ended {
                Ok((delivery, cost)) => (Some(delivery), cost),
                Err(_) => (None, start.elapsed().as_secs_f64()),
            };
            let mut queue = self.queue();
            queue.finish(&ticket, cost);
            self.changed(&queue);
            drop(queue);
            if let Some(deliver) = delivery {
                deliver();
            }
        }
    }

    /// Waits for the next job; `None` when the pool is closed.
    fn next(&self) -> Option<StartedJob<QueuedJob>> {
        let mut queue = self.queue();
        loop {
            if self.closed.load(Ordering::SeqCst) {
                return None;
            }
            if let Some(started) = queue.pop() {
                self.changed(&queue);
                return Some(started);
            }
            queue = self.ready.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl WorkerHold {
    /// Lends the worker to a shorter job that has none; `ends` says that this job must end now.
    pub fn give_way(&self, ends: &dyn Fn() -> bool) {
        let scheduler = &*self.scheduler;
        let is_pressed = scheduler.is_pressed[self.class as usize].load(Ordering::Relaxed);
        if !is_pressed && !self.paused.load(Ordering::Relaxed) {
            return;
        }
        let ran = self.since().elapsed();
        let mut queue = scheduler.queue();
        if self.paused.load(Ordering::SeqCst) {
            // Another thread of this job has paused it.
            while self.paused.load(Ordering::SeqCst) {
                queue = self.wait(queue);
            }
            return;
        }
        if ran < LEAST_RUN || !queue.must_pause(self.class) {
            return;
        }
        queue.pause(self.class);
        self.paused.store(true, Ordering::SeqCst);
        scheduler.changed(&queue);
        let (pause, mut is_reserved) = (Instant::now(), false);
        while !queue.resume(self.class, is_reserved) {
            if !is_reserved && (pause.elapsed() >= ran || ends()) {
                queue.reserve();
                is_reserved = true;
            } else {
                queue = self.wait(queue);
            }
        }
        self.paused.store(false, Ordering::SeqCst);
        *self.since() = Instant::now();
        scheduler.changed(&queue);
    }

    fn wait<'q>(&self, queue: MutexGuard<'q, FairQueue<QueuedJob>>) -> MutexGuard<'q, FairQueue<QueuedJob>> {
        let woken = self.scheduler.resumed.wait_timeout(queue, PAUSE_CHECK);
        woken.unwrap_or_else(PoisonError::into_inner).0
    }

    fn since(&self) -> MutexGuard<'_, Instant> {
        self.since.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
