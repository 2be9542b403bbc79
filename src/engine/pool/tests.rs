//! The pool as a whole: order, lanes, nesting, stops and panics. All waiting is for events, none for time.

use super::class::JobClass;
use super::fair_queue::FairQueue;
use super::*;
use crate::engine::error::EngineError;
use crate::store::Tenant;
use rayon::prelude::*;
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;

fn context() -> JobContext {
    JobContext {
        token: CancellationToken::new(),
        deadline: Instant::now() + Duration::from_secs(3600),
        progress: Arc::new(|_| {}),
    }
}

fn tenant(name: &str) -> Tenant {
    Tenant::new(name).unwrap()
}

/// Takes all that waits in the order in which it starts; each job costs what its class usually costs.
fn drained(queue: &mut FairQueue<&'static str>) -> Vec<&'static str> {
    let mut order = vec![];
    while let Some(started) = queue.pop() {
        queue.finish(&started.ticket, started.ticket.class.usual_cost());
        order.push(started.job);
    }
    order
}

#[test]
fn equals_keep_their_order_and_tenants_take_turns() {
    let (a, b) = (tenant("a"), tenant("b"));
    let mut queue = FairQueue::new(1);
    for job in ["a1", "a2", "a3", "a4", "a5", "a6", "a7", "a8", "a9", "a10"] {
        queue.push(&a, JobClass::Short, job);
    }
    for job in ["b1", "b2"] {
        queue.push(&b, JobClass::Short, job);
    }
    let order = drained(&mut queue);
    assert_eq!(order, ["a1", "b1", "a2", "b2", "a3", "a4", "a5", "a6", "a7", "a8", "a9", "a10"]);
    assert_eq!(queue.waiting(), 0);
}

#[test]
fn cpu_time_is_shared_and_not_the_number_of_jobs() {
    let (dear, cheap) = (tenant("dear"), tenant("cheap"));
    let mut queue = FairQueue::new(1);
    for _ in 0..20 {
        queue.push(&dear, JobClass::Short, 0.9);
        queue.push(&cheap, JobClass::Short, 0.1);
        queue.push(&cheap, JobClass::Short, 0.1);
    }
    let mut used = [0.0; 2];
    while used[0] + used[1] < 6.0 {
        let started = queue.pop().unwrap();
        used[usize::from(started.ticket.tenant == cheap)] += started.job;
        queue.finish(&started.ticket, started.job);
    }
    assert!((used[0] - used[1]).abs() < 1.0, "{used:?}");
}

#[test]
fn who_pauses_saves_up_nothing() {
    let (a, b) = (tenant("a"), tenant("b"));
    let mut queue = FairQueue::new(2);
    queue.push(&b, JobClass::Short, "b0");
    let first = queue.pop().unwrap();
    for job in ["a1", "a2", "a3", "a4", "a5", "a6"] {
        queue.push(&a, JobClass::Short, job);
    }
    for _ in 0..3 {
        let started = queue.pop().unwrap();
        queue.finish(&started.ticket, 1.0);
    }
    queue.finish(&first.ticket, 0.0);
    for job in ["b1", "b2", "b3"] {
        queue.push(&b, JobClass::Short, job);
    }
    // With saved service b would take four turns at once; with one clock they alternate.
    let mut order = vec![];
    while let Some(started) = queue.pop() {
        queue.finish(&started.ticket, 1.0);
        order.push(started.job);
    }
    assert_eq!(order[..2].iter().filter(|job| job.starts_with('b')).count(), 1, "{order:?}");
}

#[test]
fn lanes_leave_workers_to_shorter_work() {
    let owner = tenant("a");
    let counts = |workers: usize| {
        let mut queue = FairQueue::new(workers);
        let mut started = [0; 3];
        for class in JobClass::ALL.into_iter().rev() {
            (0..40).for_each(|_| drop(queue.push(&owner, class, ())));
            while queue.pop().is_some() {
                started[class as usize] += 1;
            }
        }
        started
    };
    assert_eq!(counts(1), [0, 0, 1]);
    assert_eq!(counts(2), [0, 1, 1], "longer jobs give way where they hold all workers");
    assert_eq!(counts(3), [1, 1, 1]);
    assert_eq!(counts(8), [1, 1, 6]);
}

#[test]
fn a_long_job_gives_way_where_no_worker_is_left() {
    let owner = tenant("a");
    let mut queue = FairQueue::new(1);
    queue.push(&owner, JobClass::Long, "long");
    let long = queue.pop().unwrap();
    assert!(!queue.must_pause(JobClass::Long));
    queue.push(&owner, JobClass::Short, "short");
    queue.push(&owner, JobClass::Long, "next");
    assert!(queue.must_pause(JobClass::Long) && queue.pop().is_none());
    queue.pause(JobClass::Long);
    assert!(!queue.resume(JobClass::Long, false), "a shorter job waits");
    let short = queue.pop().unwrap();
    assert_eq!(short.job, "short");
    assert!(!queue.resume(JobClass::Long, false), "no worker is free");
    queue.reserve();
    queue.finish(&short.ticket, 0.02);
    queue.push(&owner, JobClass::Short, "later");
    assert!(queue.pop().is_none(), "the worker is kept");
    assert!(queue.resume(JobClass::Long, true));
    queue.finish(&long.ticket, 30.0);
    let rest = drained(&mut queue);
    assert_eq!(rest, ["later", "next"]);
}

#[test]
fn a_job_alone_gets_all_threads_and_one_in_a_crowd_its_own() {
    let owner = tenant("a");
    let mut queue = FairQueue::new(4);
    queue.push(&owner, JobClass::Medium, ());
    let alone = queue.pop().unwrap();
    assert_eq!(alone.threads, 4);
    queue.finish(&alone.ticket, 1.0);
    (0..9).for_each(|_| drop(queue.push(&owner, JobClass::Short, ())));
    assert_eq!(queue.pop().unwrap().threads, 1);
    let mut queue = FairQueue::new(4);
    (0..9).for_each(|_| drop(queue.push(&owner, JobClass::Long, ())));
    assert_eq!(queue.pop().unwrap().threads, 2, "two of four workers are for long jobs");
}

#[tokio::test(flavor = "multi_thread")]
async fn forty_long_jobs_of_one_tenant_do_not_delay_another() {
    let pool = Arc::new(Pool::new(2, 128).unwrap());
    let (release, held) = mpsc::channel::<()>();
    let held = Arc::new(Mutex::new(held));
    let mut long = tokio::task::JoinSet::new();
    for _ in 0..40 {
        let (pool, held) = (pool.clone(), held.clone());
        long.spawn(async move {
            let work = move |_: crate::num::Stop| Ok(held.lock().unwrap().recv().is_err());
            pool.run((&tenant("b"), JobKind::Discovery), context(), work).await.unwrap().0
        });
    }
    while pool.load().waiting < 39 {
        tokio::task::yield_now().await;
    }
    // All of them end though no long job does.
    for k in 0..200 {
        let done = pool.run((&tenant("a"), JobKind::Answer), context(), move |_| Ok(k)).await.unwrap();
        assert_eq!(done.0, k);
    }
    assert_eq!((pool.load().running, pool.load().waiting), (1, 39));
    drop(release);
    assert!(long.join_all().await.into_iter().all(|ended| ended));
}

#[tokio::test(flavor = "multi_thread")]
async fn jobs_never_nest_and_never_exceed_the_workers() {
    thread_local! {
        static DEPTH: Cell<usize> = const { Cell::new(0) };
    }
    let workers = 3;
    let pool = Arc::new(Pool::new(workers, 4000).unwrap());
    let (running, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
    let mut jobs = tokio::task::JoinSet::new();
    for k in 0..3000_u64 {
        let (pool, running, most) = (pool.clone(), running.clone(), most.clone());
        let kind = [JobKind::Answer, JobKind::Fit, JobKind::Discovery][k as usize % 3];
        jobs.spawn(async move {
            let work = move |_: crate::num::Stop| {
                most.fetch_max(running.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                let outer = DEPTH.get();
                DEPTH.set(outer + 1);
                let sum: u64 = (0..64_u64).into_par_iter().map(|i| (0..50).fold(i, |a, b| a ^ (b * i))).sum();
                DEPTH.set(outer);
                running.fetch_sub(1, Ordering::SeqCst);
                Ok((outer, sum))
            };
            pool.run((&Tenant::default(), kind), context(), work).await.unwrap().0
        });
    }
    let mut sampled = 0;
    while let Some(job) = jobs.join_next().await {
        assert_eq!(job.unwrap().0, 0, "a job ran on the stack of another");
        sampled = sampled.max(pool.load().running);
    }
    assert!(sampled <= workers && most.load(Ordering::SeqCst) <= workers, "{sampled} {most:?}");
    assert_eq!(pool.load(), Load::default());
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_ends_while_a_discovery_holds_the_only_worker() {
    let pool = Arc::new(Pool::new(1, 8).unwrap());
    let (started, start) = tokio::sync::oneshot::channel();
    let (token, finish) = (CancellationToken::new(), Arc::new(AtomicUsize::new(0)));
    let long = {
        let (pool, finish, token) = (pool.clone(), finish.clone(), token.clone());
        tokio::spawn(async move {
            let work = move |stop: crate::num::Stop| {
                let _ = started.send(());
                while finish.load(Ordering::SeqCst) == 0 {
                    stop(0.5)?;
                }
                Ok(())
            };
            pool.run((&tenant("b"), JobKind::Discovery), JobContext { token, ..context() }, work).await
        })
    };
    start.await.unwrap();
    for k in 0..20 {
        let upload = pool.run((&tenant("a"), JobKind::Conversion), context(), move |_| Ok(k)).await;
        assert_eq!(upload.unwrap().0, k);
    }
    finish.store(1, Ordering::SeqCst);
    assert!(long.await.unwrap().is_ok());
}

#[tokio::test(flavor = "multi_thread")]
async fn who_leaves_the_queue_frees_the_slot_at_once() {
    let pool = Arc::new(Pool::new(1, 1).unwrap());
    let owner = Tenant::default();
    let (release, held) = mpsc::channel::<()>();
    let (started, start) = tokio::sync::oneshot::channel();
    let busy = {
        let pool = pool.clone();
        tokio::spawn(async move {
            let work = move |_: crate::num::Stop| {
                let _ = started.send(());
                Ok(held.recv().is_err())
            };
            pool.run((&Tenant::default(), JobKind::Answer), context(), work).await
        })
    };
    start.await.unwrap();
    let waiting = context();
    let token = waiting.token.clone();
    let queued = {
        let pool = pool.clone();
        tokio::spawn(async move {
            pool.run((&Tenant::default(), JobKind::Answer), waiting, |_| Ok(())).await.map(|_| ())
        })
    };
    while pool.load().waiting == 0 {
        tokio::task::yield_now().await;
    }
    let refused = pool.run((&owner, JobKind::Answer), context(), |_| Ok(())).await;
    assert!(matches!(refused, Err(EngineError::Overloaded { capacity: 2 })));
    token.cancel();
    assert!(matches!(queued.await.unwrap(), Err(EngineError::Cancelled)));
    assert_eq!(pool.load().waiting, 0);
    // Its slot is free; a caller who is dropped leaves the queue, too.
    let dropped = {
        let pool = pool.clone();
        tokio::spawn(async move {
            pool.run((&Tenant::default(), JobKind::Answer), context(), |_| Ok(())).await.map(|_| ())
        })
    };
    while pool.load().waiting == 0 {
        tokio::task::yield_now().await;
    }
    dropped.abort();
    assert!(dropped.await.unwrap_err().is_cancelled());
    assert_eq!(pool.load().waiting, 0);
    drop(release);
    let (done, slot) = busy.await.unwrap().unwrap();
    // A result that is not stored yet still holds its slot.
    let other = pool.run((&owner, JobKind::Answer), context(), |_| Ok(())).await.unwrap();
    assert!(done && pool.run((&owner, JobKind::Answer), context(), |_| Ok(())).await.is_err());
    drop((slot, other));
    assert!(pool.run((&owner, JobKind::Answer), context(), |_| Ok(())).await.is_ok());
}

#[tokio::test]
async fn a_panic_stays_in_its_job() {
    let pool = Pool::new(1, 4).unwrap();
    let owner = Tenant::default();
    let broken = pool.run::<(), _>((&owner, JobKind::Answer), context(), |_| panic!("injected")).await;
    assert!(matches!(broken, Err(EngineError::Internal { ref message, .. }) if message == "injected"));
    assert_eq!(pool.run((&owner, JobKind::Answer), context(), |_| Ok(7)).await.unwrap().0, 7);
}

#[tokio::test]
async fn a_stopped_job_names_the_reason() {
    let pool = Pool::new(1, 1).unwrap();
    let owner = Tenant::default();
    let late = JobContext { deadline: Instant::now(), ..context() };
    let late = pool.run((&owner, JobKind::Fit), late, |_| Ok(())).await;
    assert!(matches!(late, Err(EngineError::DeadlineExceeded)));
    let (go, wait) = mpsc::channel::<()>();
    let soon = JobContext { deadline: Instant::now() + Duration::from_millis(20), ..context() };
    let unstopped = pool.run((&owner, JobKind::Fit), soon, move |_| Ok(wait.recv().is_ok()));
    assert!(matches!(unstopped.await, Err(EngineError::DeadlineExceeded)));
    drop(go);
    let cancelled = context();
    let token = cancelled.token.clone();
    let stopped = pool.run::<(), _>((&owner, JobKind::Fit), cancelled, move |stop| {
        token.cancel();
        Err(crate::fit::FitError::from(stop(0.5).unwrap_err()).into())
    });
    assert!(matches!(stopped.await, Err(EngineError::Cancelled)));
}
