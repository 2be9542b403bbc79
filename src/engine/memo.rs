//! Results by key: each is worked out once however many ask at once, and recent ones stay in memory.

use super::pool::Control;
use super::{EngineError, figures};
use moka::future::Cache;
use std::collections::HashMap;
use std::future::Future;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tracing::Instrument;

/// Smallest step of progress that is reported: a watcher needs no more.
const PROGRESS_STEP: f64 = 0.005;

type Outcome<T> = Result<Arc<T>, EngineError>;

pub struct Memo<T> {
    /// What the results are, for the figures.
    kind: &'static str,
    cache: Cache<String, Arc<T>>,
    flights: Flights<T>,
}

impl<T> Clone for Memo<T> {
    fn clone(&self) -> Self {
        Memo { kind: self.kind, cache: self.cache.clone(), flights: self.flights.clone() }
    }
}

type Flights<T> = Arc<Mutex<HashMap<String, Arc<Flight<T>>>>>;

/// A piece of work that goes on.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    /// What its result is: fit, draws, study, simulation, answer.
    pub kind: &'static str,
    /// Id of the (first) video that it is about.
    pub video: String,
    /// 0 to 1.
    pub progress: f64,
    pub age: Duration,
}

/// One piece of work and those who wait for it.
struct Flight<T> {
    video: String,
    began: Instant,
    stage: watch::Sender<Stage<T>>,
    token: CancellationToken,
    /// Changed under the lock of `flights` only.
    callers: Mutex<usize>,
}

enum Stage<T> {
    Running(f64),
    Done(Outcome<T>),
}

/// What a caller hears next.
pub enum Update<T> {
    Progress(f64),
    Done(Outcome<T>),
}

/// A caller's place at a flight. When the last one is dropped, the work stops.
pub struct Waiting<T> {
    key: String,
    flights: Flights<T>,
    flight: Arc<Flight<T>>,
    stage: watch::Receiver<Stage<T>>,
}

impl<T: Send + Sync + 'static> Memo<T> {
    /// Keeps results of up to `bytes` in memory, each as heavy as `weight` says.
    pub fn new(kind: &'static str, bytes: u64, weight: fn(&T) -> usize) -> Self {
        let weigher = move |_: &String, value: &Arc<T>| u32::try_from(weight(value)).unwrap_or(u32::MAX);
        let cache = Cache::builder().max_capacity(bytes).weigher(weigher).build();
        Memo { kind, cache, flights: Arc::default() }
    }

    /// What goes on under keys that begin so, the oldest first.
    pub fn jobs(&self, prefix: &str) -> Vec<Job> {
        let flights = locked(&self.flights);
        let ours = flights.iter().filter(|(key, _)| key.starts_with(prefix)).map(|(_, flight)| flight);
        let job = |flight: &Arc<Flight<T>>| {
            let progress = match &*flight.stage.borrow() {
                Stage::Running(fraction) => *fraction,
                Stage::Done(_) => 1.0,
            };
            Job { kind: self.kind, video: flight.video.clone(), progress, age: flight.began.elapsed() }
        };
        let mut jobs: Vec<Job> = ours.map(job).collect();
        jobs.sort_by(|a, b| b.age.cmp(&a.age).then_with(|| a.video.cmp(&b.video)));
        jobs
    }

    /// Joins the work under `key`, or starts it: something about a video. It runs in a task of its own: no caller
    /// carries it.
    pub async fn join<F, W>(&self, key: String, video: &str, deadline: Instant, work: F) -> Waiting<T>
    where
        F: FnOnce(Control) -> W + Send,
        W: Future<Output = Result<T, EngineError>> + Send + 'static,
    {
        let known = self.cache.get(&key).await;
        let mut flights = locked(&self.flights);
        if let Some(flight) = flights.get(&key).filter(|_| known.is_none()) {
            *locked(&flight.callers) += 1;
            figures::result(self.kind, "flight");
            return self.waiting(key, flight.clone());
        }
        let stage = match &known {
            Some(value) => Stage::Done(Ok(value.clone())),
            None => Stage::Running(0.0),
        };
        let flight = Arc::new(Flight {
            video: video.to_string(),
            began: Instant::now(),
            stage: watch::Sender::new(stage),
            token: CancellationToken::new(),
            callers: Mutex::new(1),
        });
        let waiting = self.waiting(key.clone(), flight.clone());
        if known.is_some() {
            figures::result(self.kind, "memory");
            return waiting;
        }
        flights.insert(key.clone(), flight.clone());
        drop(flights);
        let listener = flight.clone();
        let progress = move |fraction: f64| {
            listener.stage.send_if_modified(|stage| match stage {
                Stage::Running(at) if fraction >= *at + PROGRESS_STEP => {
                    *at = fraction.min(1.0);
                    true
                }
                _ => false,
            });
        };
        let control = Control { token: flight.token.clone(), deadline, progress: Arc::new(progress) };
        let (cache, flights, work) = (self.cache.clone(), self.flights.clone(), work(control));
        let kind = self.kind;
        let work = work.instrument(tracing::info_span!("work", kind));
        let finish = async move {
            // It may have been finished between our look into the cache and the lock.
            let task = match cache.get(&key).await {
                Some(value) => Ok(Ok(value)),
                None => tokio::spawn(work).await.map(|result| result.map(Arc::new)),
            };
            let outcome = task.unwrap_or_else(|error| {
                tracing::error!(%error, kind, "the work around a job failed");
                Err(EngineError::Internal { id: format!("task-{kind}"), message: error.to_string() })
            });
            if let Ok(value) = &outcome {
                cache.insert(key.clone(), value.clone()).await;
            }
            forget(&flights, &key, &flight);
            flight.stage.send_replace(Stage::Done(outcome));
        };
        tokio::spawn(finish.in_current_span());
        waiting
    }

    fn waiting(&self, key: String, flight: Arc<Flight<T>>) -> Waiting<T> {
        let stage = flight.stage.subscribe();
        Waiting { key, flights: self.flights.clone(), stage, flight }
    }
}

fn forget<T>(flights: &Flights<T>, key: &str, flight: &Arc<Flight<T>>) {
    let mut flights = locked(flights);
    if flights.get(key).is_some_and(|f| Arc::ptr_eq(f, flight)) {
        flights.remove(key);
    }
}

impl<T> Waiting<T> {
    /// Waits for the next news: some progress, or the end.
    pub async fn next(&mut self) -> Update<T> {
        let gone = self.stage.changed().await.is_err();
        let stage = self.stage.borrow_and_update();
        match &*stage {
            Stage::Running(fraction) if !gone => Update::Progress(*fraction),
            Stage::Running(_) => Update::Done(Err(EngineError::Cancelled)),
            Stage::Done(outcome) => Update::Done(outcome.clone()),
        }
    }

    /// The next news, or after a while the progress as it stands.
    pub async fn news(&mut self, patience: Duration) -> Update<T> {
        match tokio::time::timeout(patience, self.next()).await {
            Ok(update) => update,
            Err(_) => match &*self.stage.borrow_and_update() {
                Stage::Running(fraction) => Update::Progress(*fraction),
                Stage::Done(outcome) => Update::Done(outcome.clone()),
            },
        }
    }

    /// The error, if it ends with one within that time.
    pub async fn refused(&self, patience: Duration) -> Option<EngineError> {
        let mut stage = self.stage.clone();
        let ended = stage.wait_for(|stage| matches!(stage, Stage::Done(_)));
        match tokio::time::timeout(patience, ended).await.ok()?.as_deref() {
            Ok(Stage::Done(Err(error))) => Some(error.clone()),
            _ => None,
        }
    }

    /// Waits for the end.
    pub async fn finish(mut self) -> Outcome<T> {
        match self.stage.wait_for(|stage| matches!(stage, Stage::Done(_))).await.as_deref() {
            Ok(Stage::Done(outcome)) => outcome.clone(),
            _ => Err(EngineError::Cancelled),
        }
    }

    /// The end, if it is there already.
    pub fn ready(&self) -> Option<Outcome<T>> {
        match &*self.stage.borrow() {
            Stage::Done(outcome) => Some(outcome.clone()),
            Stage::Running(_) => None,
        }
    }
}

impl<T> Drop for Waiting<T> {
    fn drop(&mut self) {
        let mut flights = locked(&self.flights);
        let mut callers = locked(&self.flight.callers);
        *callers -= 1;
        // The key is free at once: who comes next starts anew and never joins work that is being stopped.
        if *callers == 0 && flights.get(&self.key).is_some_and(|f| Arc::ptr_eq(f, &self.flight)) {
            flights.remove(&self.key);
            self.flight.token.cancel();
        }
    }
}

/// No code panics while it holds these locks, and the maps stay whole if one did.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn later() -> Instant {
        Instant::now() + Duration::from_secs(3600)
    }

    #[tokio::test]
    async fn equal_work_is_done_once_though_the_first_caller_leaves() {
        let memo = Memo::<usize>::new("test", 9, |_| 1);
        let runs = Arc::new(AtomicUsize::new(0));
        let gate = Arc::new(tokio::sync::Semaphore::new(0));
        let mut callers = Vec::new();
        for _ in 0..100 {
            let (runs, gate) = (runs.clone(), gate.clone());
            let join = memo.join("k".into(), "v", later(), |_| async move {
                runs.fetch_add(1, Ordering::SeqCst);
                let _open = gate.acquire().await;
                Ok(5)
            });
            callers.push(join.await);
        }
        let jobs = memo.jobs("k");
        assert_eq!((jobs.len(), jobs[0].video.as_str(), memo.jobs("l").len()), (1, "v", 0));
        drop(callers.remove(0));
        gate.add_permits(1);
        for caller in callers {
            assert_eq!(*caller.finish().await.unwrap(), 5);
        }
        assert_eq!(runs.load(Ordering::SeqCst), 1);
        assert!(memo.jobs("").is_empty());
    }

    #[tokio::test]
    async fn work_that_nobody_waits_for_is_stopped_and_never_joined() {
        let memo = Memo::<usize>::new("test", 9, |_| 1);
        let (send, receive) = tokio::sync::oneshot::channel();
        let first = memo.join("k".into(), "v", later(), |control| async move {
            control.token.cancelled().await;
            let _ = send.send(());
            Err(EngineError::Cancelled)
        });
        drop(first.await);
        let second = memo.join("k".into(), "v", later(), |_| async { Ok(2) }).await;
        receive.await.unwrap();
        assert_eq!(*second.finish().await.unwrap(), 2);
    }
}
