//! The threads of one job: a rayon pool that no other job uses meanwhile, and the CPU time that they took.

use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Idle threads kept for later jobs, for each worker.
const IDLE_THREADS: usize = 4;
/// Pools of several threads that no job uses now.
pub struct IdleThreads {
    pools: Mutex<Vec<ThreadPool>>,
    most: usize,
}

impl IdleThreads {
    pub fn new(workers: usize) -> IdleThreads {
        IdleThreads { pools: Mutex::default(), most: IDLE_THREADS * workers }
    }

    /// A pool of that many threads; `None` if the system gives no more threads.
    pub fn take(&self, threads: usize) -> Option<ThreadPool> {
        let mut pools = self.pools.lock().unwrap_or_else(PoisonError::into_inner);
        match pools.iter().position(|pool| pool.current_num_threads() == threads) {
            Some(at) => Some(pools.swap_remove(at)),
            None => {
                drop(pools);
                thread_pool(threads).inspect_err(|error| tracing::warn!(%error, threads, "no threads")).ok()
            }
        }
    }

    /// Keeps a pool for a later job, unless many are idle.
    pub fn put(&self, pool: ThreadPool) {
        let mut pools = self.pools.lock().unwrap_or_else(PoisonError::into_inner);
        let idle: usize = pools.iter().map(ThreadPool::current_num_threads).sum();
        if idle + pool.current_num_threads() <= self.most {
            pools.push(pool);
        }
    }
}

/// Threads that only the jobs given to them use.
pub fn thread_pool(threads: usize) -> Result<ThreadPool, rayon::ThreadPoolBuildError> {
    ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("physics-{i}")).build()
}

/// Runs `work` on the pool; returns what it returns, and its CPU time (s). Short work runs on one thread, and is timed by the
/// clock: the system counts CPU time in steps of up to 10 ms.
pub fn timed<T: Send>(pool: &ThreadPool, is_short: bool, work: impl FnOnce() -> T + Send) -> (T, f64) {
    let before = if is_short { None } else { cpu_time(pool) };
    // The clock starts on the thread of the work: how long that took to wake is not the work's.
    let (made, elapsed) = pool.install(|| {
        let start = Instant::now();
        (work(), start.elapsed())
    });
    let used = before.and_then(|before| cpu_time(pool)?.checked_sub(before));
    (made, used.unwrap_or(elapsed).as_secs_f64())
}

/// CPU time of all threads of the pool so far; `None` where the system does not say.
fn cpu_time(pool: &ThreadPool) -> Option<Duration> {
    let of_thread = |_: rayon::BroadcastContext<'_>| {
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
        text.split(' ').next()?.parse().ok().map(Duration::from_nanos)
    };
    pool.broadcast(of_thread).into_iter().sum()
}
