//! Single flight: each result is computed once however many callers ask at once; recent results stay in memory.
//!
//! Invariants:
//! * At most one job runs under a key. A caller joins it, or starts it if the cache has no result.
//! * The job runs in a task of its own: a caller who leaves does not stop it for the others.
//! * When the last [`JobHandle`] of a job is dropped, its key is freed and its token is cancelled, under one lock. The
//!   next caller starts a new job and never joins one that is being stopped.
//! * Only successful results enter the cache; an error goes to the callers of that job only.
//! * The cache is bounded by the bytes of its results, as `weight` estimates them.

use super::locked;
use super::recent_results::RecentResults;
use crate::engine::error::EngineError;
use crate::engine::metric_names;
use crate::engine::pool::JobContext;
use crate::engine::progress::{JobProgress, Report};
use std::collections::HashMap;
use std::future::Future;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tracing::Instrument;

type JobOutcome<T> = Result<Arc<T>, EngineError>;

pub struct SingleFlightCache<T> {
    /// What the results are; a label of metrics.
    kind: &'static str,
    cache: RecentResults<T>,
    in_flight: InFlightMap<T>,
}

impl<T> Clone for SingleFlightCache<T> {
    fn clone(&self) -> Self {
        SingleFlightCache { kind: self.kind, cache: self.cache.clone(), in_flight: self.in_flight.clone() }
    }
}

type InFlightMap<T> = Arc<Mutex<HashMap<String, Arc<InFlight<T>>>>>;

/// A running job.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    /// What it computes: fit, joint_fit, draws, study, simulation, answer or lexicon.
    pub kind: &'static str,
    /// Id of its (first) video.
    pub video: String,
    /// 0 to 1.
    pub progress: f64,
    pub age: Duration,
}

/// A running job and the number of its callers.
struct InFlight<T> {
    video: String,
    start: Instant,
    stage: watch::Sender<JobStage<T>>,
    token: CancellationToken,
    /// Changed under the lock of `in_flight` only.
    callers: Mutex<usize>,
}

enum JobStage<T> {
    Running(JobProgress),
    Done(JobOutcome<T>),
}

/// What a caller receives next.
pub enum Update<T> {
    Progress(JobProgress),
    Done(JobOutcome<T>),
}

/// One caller's share in a job. When the last one is dropped, the job is stopped.
pub struct JobHandle<T> {
    key: String,
    in_flight: InFlightMap<T>,
    job: Arc<InFlight<T>>,
    stage: watch::Receiver<JobStage<T>>,
}

impl<T: Send + Sync + 'static> SingleFlightCache<T> {
    /// Keeps results of up to `bytes` in memory; `weight` estimates the bytes of each.
    pub fn new(kind: &'static str, bytes: u64, weight: fn(&T) -> usize) -> Self {
        SingleFlightCache { kind, cache: RecentResults::new(bytes, weight), in_flight: Arc::default() }
    }

    /// The running jobs whose keys begin with `prefix`, the oldest first.
    pub fn jobs(&self, prefix: &str) -> Vec<Job> {
        let in_flight = locked(&self.in_flight);
        let ours = in_flight.iter().filter(|(key, _)| key.starts_with(prefix)).map(|(_, job)| job);
        let job = |job: &Arc<InFlight<T>>| {
            let progress = match &*job.stage.borrow() {
                JobStage::Running(at) => at.fraction,
                JobStage::Done(_) => 1.0,
            };
            Job { kind: self.kind, video: job.video.clone(), progress, age: job.start.elapsed() }
        };
        let mut jobs: Vec<Job> = ours.map(job).collect();
        jobs.sort_by(|a, b| b.age.cmp(&a.age).then_with(|| a.video.cmp(&b.video)));
        jobs
    }

    /// Joins the job under `key`, or starts `work`; `video` is shown in [`Job`].
    pub async fn join<F, W>(&self, key: String, video: &str, deadline: Instant, work: F) -> JobHandle<T>
    where
        F: FnOnce(JobContext) -> W + Send,
        W: Future<Output = Result<T, EngineError>> + Send + 'static,
    {
        let cached = self.cache.get(&key);
        let mut in_flight = locked(&self.in_flight);
        if let Some(job) = in_flight.get(&key).filter(|_| cached.is_none()) {
            *locked(&job.callers) += 1;
            metric_names::count_result(self.kind, "flight");
            return self.handle(key, job.clone());
        }
        let stage = match &cached {
            Some(value) => JobStage::Done(Ok(value.clone())),
            None => JobStage::Running(JobProgress::default()),
        };
        let job = Arc::new(InFlight {
            video: video.to_string(),
            start: Instant::now(),
            stage: watch::Sender::new(stage),
            token: CancellationToken::new(),
            callers: Mutex::new(1),
        });
        let handle = self.handle(key.clone(), job.clone());
        if cached.is_some() {
            metric_names::count_result(self.kind, "memory");
            return handle;
        }
        in_flight.insert(key.clone(), job.clone());
        drop(in_flight);
        let listener = job.clone();
        let progress = move |report: Report| {
            listener.stage.send_if_modified(|stage| match stage {
                JobStage::Running(at) => at.update(report),
                JobStage::Done(_) => false,
            });
        };
        let context = JobContext { token: job.token.clone(), deadline, progress: Arc::new(progress) };
        let (cache, in_flight, work) = (self.cache.clone(), self.in_flight.clone(), work(context));
        let kind = self.kind;
        let work = work.instrument(tracing::info_span!("work", kind));
        let finish = async move {
            // Another job may have finished between the look-up in the cache and the lock.
            let task = match cache.get(&key) {
                Some(value) => Ok(Ok(value)),
                None => tokio::spawn(work).await.map(|result| result.map(Arc::new)),
            };
            let outcome = task.unwrap_or_else(|error| {
                tracing::error!(%error, kind, "a job's task failed");
                Err(EngineError::Internal { id: format!("task-{kind}"), message: error.to_string() })
            });
            if let Ok(value) = &outcome {
                cache.insert(key.clone(), value.clone());
            }
            forget(&in_flight, &key, &job);
            job.stage.send_replace(JobStage::Done(outcome));
        };
        tokio::spawn(finish.in_current_span());
        handle
    }

    fn handle(&self, key: String, job: Arc<InFlight<T>>) -> JobHandle<T> {
        let stage = job.stage.subscribe();
        JobHandle { key, in_flight: self.in_flight.clone(), stage, job }
    }
}

fn forget<T>(in_flight: &InFlightMap<T>, key: &str, job: &Arc<InFlight<T>>) {
    let mut in_flight = locked(in_flight);
    if in_flight.get(key).is_some_and(|f| Arc::ptr_eq(f, job)) {
        in_flight.remove(key);
    }
}

impl<T> JobHandle<T> {
    /// Waits for the next update: progress, or the end.
    pub async fn next(&mut self) -> Update<T> {
        let gone = self.stage.changed().await.is_err();
        let stage = self.stage.borrow_and_update();
        match &*stage {
            JobStage::Running(at) if !gone => Update::Progress(*at),
            JobStage::Running(_) => Update::Done(Err(EngineError::Cancelled)),
            JobStage::Done(outcome) => Update::Done(outcome.clone()),
        }
    }

    /// The next update; after `period` without one, the progress again.
    pub async fn next_within(&mut self, period: Duration) -> Update<T> {
        match tokio::time::timeout(period, self.next()).await {
            Ok(update) => update,
            Err(_) => match &*self.stage.borrow_and_update() {
                JobStage::Running(at) => Update::Progress(*at),
                JobStage::Done(outcome) => Update::Done(outcome.clone()),
            },
        }
    }

    /// The error, if the job fails within that time.
    pub async fn failed_within(&self, period: Duration) -> Option<EngineError> {
        let mut stage = self.stage.clone();
        let ended = stage.wait_for(|stage| matches!(stage, JobStage::Done(_)));
        match tokio::time::timeout(period, ended).await.ok()?.as_deref() {
            Ok(JobStage::Done(Err(error))) => Some(error.clone()),
            _ => None,
        }
    }

    /// Waits for the end.
    pub async fn finish(mut self) -> JobOutcome<T> {
        match self.stage.wait_for(|stage| matches!(stage, JobStage::Done(_))).await.as_deref() {
            Ok(JobStage::Done(outcome)) => outcome.clone(),
            _ => Err(EngineError::Cancelled),
        }
    }

    /// The outcome, if the job has ended.
    pub fn outcome(&self) -> Option<JobOutcome<T>> {
        match &*self.stage.borrow() {
            JobStage::Done(outcome) => Some(outcome.clone()),
            JobStage::Running(_) => None,
        }
    }
}

impl<T> Drop for JobHandle<T> {
    fn drop(&mut self) {
        let mut in_flight = locked(&self.in_flight);
        let mut callers = locked(&self.job.callers);
        *callers -= 1;
        if *callers == 0 && in_flight.get(&self.key).is_some_and(|f| Arc::ptr_eq(f, &self.job)) {
            in_flight.remove(&self.key);
            self.job.token.cancel();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn later() -> Instant {
        Instant::now() + Duration::from_secs(3600)
    }

    #[tokio::test]
    async fn equal_jobs_run_once_though_the_first_caller_leaves() {
        let cache = SingleFlightCache::<usize>::new("test", 9, |_| 1);
        let runs = Arc::new(AtomicUsize::new(0));
        let release = Arc::new(tokio::sync::Semaphore::new(0));
        let mut callers = Vec::new();
        for _ in 0..100 {
            let (runs, release) = (runs.clone(), release.clone());
            let join = cache.join("k".into(), "v", later(), |_| async move {
                runs.fetch_add(1, Ordering::SeqCst);
                let _open = release.acquire().await;
                Ok(5)
            });
            callers.push(join.await);
        }
        let jobs = cache.jobs("k");
        assert_eq!((jobs.len(), jobs[0].video.as_str(), cache.jobs("l").len()), (1, "v", 0));
        drop(callers.remove(0));
        release.add_permits(1);
        for caller in callers {
            assert_eq!(*caller.finish().await.unwrap(), 5);
        }
        assert_eq!(runs.load(Ordering::SeqCst), 1);
        assert!(cache.jobs("").is_empty());
    }

    #[tokio::test]
    async fn a_job_without_callers_is_stopped_and_never_joined() {
        let cache = SingleFlightCache::<usize>::new("test", 9, |_| 1);
        let (send, receive) = tokio::sync::oneshot::channel();
        let first = cache.join("k".into(), "v", later(), |context| async move {
            context.token.cancelled().await;
            let _ = send.send(());
            Err(EngineError::Cancelled)
        });
        drop(first.await);
        let second = cache.join("k".into(), "v", later(), |_| async { Ok(2) }).await;
        receive.await.unwrap();
        assert_eq!(*second.finish().await.unwrap(), 2);
    }
}
