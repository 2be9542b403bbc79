//! The engine: what all jobs and tenants share, and how a job reaches it.

use super::cache::{Deletions, Job, RecentResults, SMALL_RESULT, SingleFlightCache};
use super::error::EngineError;
use super::limits::MAX_REPLAYS;
use super::metric_names;
use super::operations::RunningOperations;
use super::pool::{Admission, JobContext, JobKind, Load, Pool};
use super::questions::ChatParser;
use super::results::{PublishedAnswer, PublishedSimulation, StoredFit, Study};
use super::traces::backlog::Backlog;
use super::traces::retention::TraceRetention;
use crate::concepts::Lexicon;
use crate::num::Stop;
use crate::scene::Scene;
use crate::store::{Store, TableKind, Tenant};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Bytes of each kind of result in memory; all of them can be read or computed again.
const CACHED_BYTES: u64 = 48 << 20;
/// Marks keys of results in memory: no id begins with it.
const RESULT_MARK: &str = "@";
/// Bytes of one state or sample in a large result.
const STATE_BYTES: usize = 96;

/// How much an engine may do at once.
#[derive(Debug, Clone, Copy)]
pub struct Capacity {
    pub workers: usize,
    /// Jobs that may wait for a worker.
    pub queue: usize,
    /// Longest duration of one job, its waiting time included.
    pub job_timeout: Duration,
}

/// All tenants share one pool, one memory and one folder; an engine shows one tenant's part of it.
#[derive(Clone)]
pub struct Engine {
    pub(super) store: Store,
    pub(super) tenant: Tenant,
    pub(super) pool: Arc<Pool>,
    capacity: Capacity,
    start: Instant,
    pub(super) scenes: RecentResults<Scene>,
    pub(super) fits: SingleFlightCache<StoredFit>,
    pub(super) joint_fits: SingleFlightCache<Vec<StoredFit>>,
    /// Fits with draws from their posteriors.
    pub(super) draws: SingleFlightCache<StoredFit>,
    pub(super) studies: SingleFlightCache<Study>,
    pub(super) simulations: SingleFlightCache<PublishedSimulation>,
    pub(super) answers: SingleFlightCache<PublishedAnswer>,
    pub(super) lexica: SingleFlightCache<Lexicon>,
    /// For questions that our reader does not understand.
    pub(super) parser: Option<Arc<ChatParser>>,
    pub(super) backlog: Arc<Backlog>,
    pub(super) retention: Arc<TraceRetention>,
    pub(super) replays: Arc<Admission>,
    pub(super) operations: Arc<RunningOperations>,
    /// Of videos, lexica and traces; their counts are part of every key in memory.
    pub(super) deletions: Deletions,
    fits_run: Arc<AtomicU64>,
}

impl Engine {
    /// An engine on a data folder that no other process uses.
    pub fn open(data_dir: &Path, capacity: Capacity) -> Result<Engine, EngineError> {
        Ok(Engine {
            store: Store::open(data_dir)?,
            tenant: Tenant::default(),
            pool: Arc::new(Pool::new(capacity.workers, capacity.queue)?),
            capacity,
            start: Instant::now(),
            scenes: RecentResults::new(CACHED_BYTES, scene_bytes),
            fits: SingleFlightCache::new("fit", CACHED_BYTES, fit_bytes),
            joint_fits: SingleFlightCache::new("joint_fit", CACHED_BYTES, |fits| {
                fits.iter().map(fit_bytes).sum()
            }),
            draws: SingleFlightCache::new("draws", CACHED_BYTES, fit_bytes),
            studies: SingleFlightCache::new("study", CACHED_BYTES, |_| 64 * SMALL_RESULT),
            simulations: SingleFlightCache::new("simulation", CACHED_BYTES, |s| {
                let best = &s.prediction.best;
                SMALL_RESULT + STATE_BYTES * best.states.len() * best.ids.len()
            }),
            answers: SingleFlightCache::new("answer", CACHED_BYTES, |a| {
                let states = a.answer.simulations.iter().map(|s| s.best.states.len() * s.best.ids.len());
                SMALL_RESULT + STATE_BYTES * states.sum::<usize>()
            }),
            lexica: SingleFlightCache::new("lexicon", CACHED_BYTES, lexicon_bytes),
            parser: None,
            backlog: Arc::default(),
            retention: Arc::default(),
            replays: Admission::new(MAX_REPLAYS),
            operations: Arc::default(),
            deletions: Deletions::default(),
            fits_run: Arc::default(),
        })
    }

    /// The engine as a tenant sees it: what belongs to another tenant does not exist.
    pub fn of(self: &Arc<Self>, tenant: &Tenant) -> Arc<Engine> {
        match tenant.is_unnamed() {
            true => self.clone(),
            false => {
                let (store, tenant) = (self.store.of(tenant), tenant.clone());
                Arc::new(Engine { store, tenant, ..Engine::clone(self) })
            }
        }
    }

    /// The same engine with a language model for questions that our reader does not understand.
    pub fn with_parser(self, parser: ChatParser) -> Engine {
        Engine { parser: Some(Arc::new(parser)), ..self }
    }

    /// The same engine, whose jobs have another limit of time.
    pub(super) fn with_capacity(&self, capacity: Capacity) -> Arc<Engine> {
        Arc::new(Engine { capacity, ..self.clone() })
    }

    /// Fits that were computed since the start, not read from the store.
    pub fn fits_run(&self) -> u64 {
        self.fits_run.load(Ordering::Relaxed)
    }

    /// How busy the pool is.
    pub fn load(&self) -> Load {
        self.pool.load()
    }

    pub fn capacity(&self) -> Capacity {
        self.capacity
    }

    pub fn uptime(&self) -> Duration {
        self.start.elapsed()
    }

    /// The running jobs of this tenant, the oldest first.
    pub fn jobs(&self) -> Vec<Job> {
        let ours = self.store.key(RESULT_MARK);
        let mut jobs = self.fits.jobs(&ours);
        jobs.extend(self.joint_fits.jobs(&ours));
        jobs.extend(self.draws.jobs(&ours));
        jobs.extend(self.studies.jobs(&ours));
        jobs.extend(self.simulations.jobs(&ours));
        jobs.extend(self.answers.jobs(&ours));
        jobs.extend(self.lexica.jobs(&ours));
        jobs.sort_by_key(|job| std::cmp::Reverse(job.age));
        jobs
    }

    /// Runs small work whose result is not stored on the CPU pool.
    pub async fn compute<T, F>(&self, work: F) -> Result<T, EngineError>
    where
        T: Send + 'static,
        F: FnOnce() -> Result<T, EngineError> + Send + 'static,
    {
        self.compute_as(JobKind::Computation, move |_| work()).await
    }

    /// Runs work of a kind on the CPU pool; its stop token says when its deadline has passed or its caller has left.
    pub async fn compute_as<T, F>(&self, kind: JobKind, work: F) -> Result<T, EngineError>
    where
        T: Send + 'static,
        F: FnOnce(Stop) -> Result<T, EngineError> + Send + 'static,
    {
        Ok(self.pool.run((&self.tenant, kind), self.uncancelled(), work).await?.0)
    }

    /// The context of a job without progress that ends at its deadline, or when its caller leaves.
    pub(super) fn uncancelled(&self) -> JobContext {
        JobContext { token: Default::default(), deadline: self.deadline(), progress: Arc::new(|_| {}) }
    }

    pub(super) fn count_fit(&self) {
        self.fits_run.fetch_add(1, Ordering::Relaxed);
        metrics::counter!(metric_names::FITS).increment(1);
    }

    pub(super) fn deadline(&self) -> Instant {
        Instant::now() + self.capacity.job_timeout
    }

    /// Drops the results of a video in memory: they may name what no longer exists.
    pub(super) fn forget_video(&self, video: &str) {
        self.deletions.add(self.store.key(video));
    }

    /// Drops all results of this tenant in memory.
    pub(super) fn forget_all(&self) {
        self.deletions.add(self.store.key(RESULT_MARK));
    }

    /// The start of the keys in memory of the tenant's results that depend on these videos. It must be read before the
    /// videos are: the results of what is deleted meanwhile are then not found.
    pub(super) fn result_prefix(&self, videos: &[&str]) -> String {
        let mut keys: Vec<String> = videos.iter().map(|video| self.store.key(video)).collect();
        keys.push(self.store.key(RESULT_MARK));
        self.store.key(&format!("{RESULT_MARK}{}/", self.deletions.count(keys.iter().map(String::as_str))))
    }

    /// Stores a value that belongs to a video; an error if the video was deleted meanwhile.
    pub(super) async fn put_of_video<T: Serialize>(
        &self,
        kind: TableKind,
        video: &str,
        key: &str,
        value: &T,
    ) -> Result<(), EngineError> {
        let stored = self.store.put_of_video(kind, video, key, value).await;
        stored.map_err(|error| EngineError::of_video(video, error))
    }
}

fn scene_bytes(scene: &Scene) -> usize {
    let samples: usize = scene.tracks.iter().map(|t| t.samples.len()).sum();
    SMALL_RESULT + STATE_BYTES * samples + 8 * scene.times.len()
}

fn lexicon_bytes(lexicon: &Lexicon) -> usize {
    let numbers = lexicon.families.iter().map(|f| f.map.len() + f.vectors.len());
    SMALL_RESULT + 8 * numbers.sum::<usize>()
}

/// A fit with draws has some of every parameter.
fn fit_bytes(stored: &StoredFit) -> usize {
    SMALL_RESULT + 1024 * stored.fit.posterior.estimates.len()
}
