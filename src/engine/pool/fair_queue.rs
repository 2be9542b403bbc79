//! The order in which jobs start: start-time fair queueing between tenants, then between the classes of a tenant.
//!
//! A tenant's tag is its virtual service: it grows with the CPU time of the tenant's jobs, by an estimate when a job starts
//! and by the difference when it ends. The tenant with the least tag is next. The clock is the tag of the last start; who
//! comes back after a pause starts at the clock, so that nobody saves up service. When nothing waits or runs, all begin again
//! from 0. Within a tenant the classes share in the same way, and each class keeps the order of arrival.
//!
//! Source: Goyal, Vin and Cheng, Start-time fair queueing, IEEE/ACM Transactions on Networking 5 (1997).

use super::class::JobClass;
use crate::store::Tenant;
use std::collections::{BTreeMap, VecDeque};

/// Jobs that wait, and how many run, on `workers` workers.
pub struct FairQueue<T> {
    workers: usize,
    clock: f64,
    arrivals: u64,
    tenants: BTreeMap<Tenant, TenantFlow<T>>,
    running: [usize; 3],
    paused: [usize; 3],
    /// Paused jobs that get the next free worker.
    resuming: usize,
}

/// One tenant's jobs.
struct TenantFlow<T> {
    tag: f64,
    clock: f64,
    lanes: [ClassLane<T>; 3],
    /// With paused jobs.
    running: usize,
}

/// One tenant's jobs of one class.
struct ClassLane<T> {
    tag: f64,
    running: usize,
    waiting: VecDeque<(u64, T)>,
}

impl<T> Default for TenantFlow<T> {
    fn default() -> Self {
        let lane = || ClassLane { tag: 0.0, running: 0, waiting: VecDeque::new() };
        TenantFlow { tag: 0.0, clock: 0.0, lanes: [lane(), lane(), lane()], running: 0 }
    }
}

impl<T> TenantFlow<T> {
    fn is_idle(&self) -> bool {
        self.running == 0 && self.lanes.iter().all(|lane| lane.waiting.is_empty())
    }
}

/// Where a job waits or waited.
#[derive(Debug, Clone, PartialEq)]
pub struct QueueTicket {
    pub tenant: Tenant,
    pub class: JobClass,
    number: u64,
}

/// A job that starts now.
pub struct StartedJob<T> {
    pub ticket: QueueTicket,
    pub job: T,
    /// On so many threads.
    pub threads: usize,
}

impl<T> FairQueue<T> {
    pub fn new(workers: usize) -> FairQueue<T> {
        let (running, paused) = ([0; 3], [0; 3]);
        FairQueue { workers, clock: 0.0, arrivals: 0, tenants: BTreeMap::new(), running, paused, resuming: 0 }
    }

    /// Appends a job to its lane.
    pub fn push(&mut self, tenant: &Tenant, class: JobClass, job: T) -> QueueTicket {
        self.arrivals += 1;
        let number = self.arrivals;
        let flow = self.tenants.entry(tenant.clone()).or_default();
        if flow.is_idle() {
            flow.tag = flow.tag.max(self.clock);
        }
        let lane = &mut flow.lanes[class as usize];
        if lane.running == 0 && lane.waiting.is_empty() {
            lane.tag = lane.tag.max(flow.clock);
        }
        lane.waiting.push_back((number, job));
        QueueTicket { tenant: tenant.clone(), class, number }
    }

    /// The next job, if a worker is free for one.
    pub fn pop(&mut self) -> Option<StartedJob<T>> {
        if self.is_full() {
            return None;
        }
        let open: Vec<JobClass> = JobClass::ALL.into_iter().filter(|class| self.has_room(*class)).collect();
        // By tag, then by arrival.
        let next = |flow: &TenantFlow<T>| {
            let first = |class: &JobClass| {
                let lane = &flow.lanes[*class as usize];
                lane.waiting.front().map(|(number, _)| (lane.tag, *number, *class))
            };
            open.iter().filter_map(first).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
        };
        let ready = self.tenants.iter_mut().filter_map(|(tenant, flow)| Some((next(flow)?, tenant, flow)));
        let ((_, number, class), tenant, flow) =
            ready.min_by(|(a, _, x), (b, _, y)| x.tag.total_cmp(&y.tag).then(a.1.cmp(&b.1)))?;
        let lane = &mut flow.lanes[class as usize];
        let (_, job) = lane.waiting.pop_front()?;
        self.clock = self.clock.max(flow.tag);
        flow.clock = flow.clock.max(lane.tag);
        flow.tag += class.usual_cost();
        lane.tag += class.usual_cost();
        lane.running += 1;
        flow.running += 1;
        self.running[class as usize] += 1;
        let ticket = QueueTicket { tenant: tenant.clone(), class, number };
        Some(StartedJob { ticket, job, threads: self.threads(class) })
    }

    /// Ends a job that has taken `cost` s of CPU time.
    pub fn finish(&mut self, ticket: &QueueTicket, cost: f64) {
        self.running[ticket.class as usize] -= 1;
        if let Some(flow) = self.tenants.get_mut(&ticket.tenant) {
            let lane = &mut flow.lanes[ticket.class as usize];
            let unknown = cost - ticket.class.usual_cost();
            flow.tag += unknown;
            lane.tag += unknown;
            lane.running -= 1;
            flow.running -= 1;
        }
        if self.tenants.values().all(TenantFlow::is_idle) {
            self.clock = 0.0;
            self.tenants.clear();
        } else {
            let clock = self.clock;
            self.tenants.retain(|_, flow| !flow.is_idle() || flow.tag > clock);
        }
    }

    /// Takes a job out that waits; `None` if it has started.
    pub fn remove(&mut self, ticket: &QueueTicket) -> Option<T> {
        let waiting = &mut self.tenants.get_mut(&ticket.tenant)?.lanes[ticket.class as usize].waiting;
        let at = waiting.binary_search_by_key(&ticket.number, |(number, _)| *number).ok()?;
        waiting.remove(at).map(|(_, job)| job)
    }

    pub fn running(&self) -> usize {
        self.running.iter().sum()
    }

    pub fn paused(&self) -> usize {
        self.paused.iter().sum()
    }

    pub fn waiting(&self) -> usize {
        JobClass::ALL.into_iter().map(|class| self.waiting_of(class)).sum()
    }

    /// The job of each lane that waits longest.
    pub fn fronts(&self) -> impl Iterator<Item = &T> {
        let lanes = self.tenants.values().flat_map(|flow| &flow.lanes);
        lanes.filter_map(|lane| lane.waiting.front().map(|(_, job)| job))
    }

    /// Whether a running job of that class must give way: jobs of a shorter class wait, and longer ones hold all workers.
    pub fn must_pause(&self, class: JobClass) -> bool {
        let starves = |short: JobClass| {
            let served = JobClass::ALL.into_iter().filter(|c| *c <= short).map(|c| self.running[c as usize]);
            self.waiting_of(short) > 0 && served.sum::<usize>() == 0
        };
        let mut shorter = JobClass::ALL.into_iter().filter(|other| *other < class);
        self.is_full() && self.paused[class as usize] == 0 && shorter.any(starves)
    }

    pub fn pause(&mut self, class: JobClass) {
        self.running[class as usize] -= 1;
        self.paused[class as usize] += 1;
    }

    /// Keeps the next free worker for a paused job.
    pub fn reserve(&mut self) {
        self.resuming += 1;
    }

    /// Whether a paused job runs again: nothing shorter waits, or a worker is kept for it (`is_reserved`), and one is free.
    pub fn resume(&mut self, class: JobClass, is_reserved: bool) -> bool {
        let shorter = || JobClass::ALL.into_iter().filter(|other| *other < class);
        let is_next = is_reserved || !shorter().any(|c| self.waiting_of(c) > 0);
        let resumes = is_next && self.running() < self.workers;
        if resumes {
            self.resuming -= usize::from(is_reserved);
            self.paused[class as usize] -= 1;
            self.running[class as usize] += 1;
        }
        resumes
    }

    /// Whether no worker is free.
    pub fn is_full(&self) -> bool {
        self.running() + self.resuming >= self.workers
    }

    /// Whether the lanes leave a worker for that class; a paused job keeps its room.
    fn has_room(&self, class: JobClass) -> bool {
        let held = |from: JobClass| -> usize {
            let longer = JobClass::ALL.into_iter().filter(|other| *other >= from);
            longer.map(|c| self.running[c as usize] + self.paused[c as usize]).sum()
        };
        let limits = JobClass::ALL.into_iter().filter(|limit| *limit <= class && *limit > JobClass::Short);
        // With two workers or one, a class has no room of its own below the long ones: these give way.
        let counts = |limit: &JobClass| *limit == JobClass::Long || self.workers > 2;
        limits.filter(counts).all(|limit| held(limit) < limit.most(self.workers))
    }

    fn waiting_of(&self, class: JobClass) -> usize {
        self.tenants.values().map(|flow| flow.lanes[class as usize].waiting.len()).sum()
    }

    /// Threads of a job that has just started: all if it is alone, one in a crowd. Long jobs share with each other only, as
    /// the others come and go.
    fn threads(&self, class: JobClass) -> usize {
        let long = self.running[2] + self.waiting_of(JobClass::Long);
        let crowd = match class {
            JobClass::Long => long.min(class.most(self.workers)),
            _ => self.running() + self.waiting_of(JobClass::Short) + self.waiting_of(JobClass::Medium),
        };
        (self.workers / crowd.max(1)).max(1)
    }
}
