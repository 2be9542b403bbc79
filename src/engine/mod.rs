//! Joins core and edges: finds or makes what a request needs, once, on the CPU pool, and keeps it.

mod check;
pub mod figures;
mod joint;
mod memo;
mod overview;
mod pool;
mod replay;
mod report;
mod revision;
mod shelf;
mod start;
mod study;
mod trace;

pub use crate::store::Tenant;
pub use check::{MAX_REPLY_STATES, MAX_ROLLOUT_STATES, MAX_ROLLOUTS, MAX_SPEED};
pub use joint::Others;
pub use memo::{Job, Update, Waiting};
pub use pool::{Control, Load, panic_message};
pub use replay::{MAX_REPLAYS, Played, Replay, ReplayOptions};
pub use report::{Page, Query};
pub use revision::Step;
pub use shelf::{Lease, Retention};
pub use start::{Choice, ChoiceKind};
pub use study::{Course, Discovered, Findings, Inquiry, MAX_STUDY_VIDEOS, Pose, Study};
pub use trace::{Download, TraceFilter, TraceKind, TraceRecord};

use crate::fit::{Fit, FitError, FitOptions, estimate_one, with_draws};
use crate::reason::{
    Answer, AskOptions, FUTURE_FRAMES, Prediction, PredictionRequest, Question, ReasonError, ask, predict,
};
use crate::scene::{Scene, Violation, canonical_digest};
use crate::store::{Kind, Store, StoreError};
use crate::world::Intervention;
use memo::Memo;
use moka::future::Cache;
use pool::Pool;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Frames after the video that a simulation has where none are asked for.
pub const DEFAULT_FUTURE_FRAMES: usize = 60;
/// Rollouts where none are asked for.
pub const DEFAULT_ROLLOUTS: usize = 32;
/// Bytes of results that stay in memory, each kind; all can be read or made again.
const CACHED_BYTES: u64 = 48 << 20;
/// Bytes of a small result, and of one state or sample in a large one.
const BASE_BYTES: usize = 16 * 1024;
const STATE_BYTES: usize = 96;

#[derive(Debug, Clone, thiserror::Error)]
pub enum EngineError {
    #[error("the request is not valid")]
    Invalid(Vec<Violation>),
    #[error("{name} does not exist")]
    NotFound { name: String },
    #[error("the queue is full ({capacity} jobs); try again later")]
    Overloaded { capacity: usize },
    #[error("cancelled by the caller")]
    Cancelled,
    #[error("the deadline passed before the work was done")]
    DeadlineExceeded,
    #[error(transparent)]
    Store(StoreError),
    #[error("internal error {id}")]
    Internal { id: String, message: String },
    #[error(transparent)]
    Fit(FitError),
    #[error(transparent)]
    Reason(ReasonError),
    #[error(
        "object {object} has no finite state at frame {frame}: the numbers overflow; ask for fewer frames, smaller \
         changes or another model"
    )]
    NotFinite { object: u32, frame: usize },
    #[error("the trace cannot be written: {0}")]
    Recording(String),
    #[error(
        "the file of trace {id} is damaged ({what}): put it back from a copy, or ask again for what it is of, which writes \
         it anew"
    )]
    Damaged { id: String, what: String },
}

impl EngineError {
    pub fn invalid(path: impl Into<String>, message: impl Into<String>) -> Self {
        EngineError::Invalid(vec![Violation { path: path.into(), message: message.into() }])
    }

    fn is_stopped(&self) -> bool {
        matches!(self, EngineError::Fit(FitError::Stopped(_)) | EngineError::Reason(ReasonError::Stopped(_)))
    }
}

impl From<FitError> for EngineError {
    fn from(error: FitError) -> Self {
        EngineError::Fit(error)
    }
}
impl From<ReasonError> for EngineError {
    fn from(error: ReasonError) -> Self {
        EngineError::Reason(error)
    }
}
impl From<StoreError> for EngineError {
    fn from(error: StoreError) -> Self {
        EngineError::Store(error)
    }
}

/// How much an engine may do at once.
#[derive(Debug, Clone, Copy)]
pub struct Capacity {
    pub workers: usize,
    /// Jobs that may wait for a worker.
    pub queue: usize,
    /// Longest that one piece of work may take, its wait included.
    pub job_timeout: Duration,
}

/// A fit as it is kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredFit {
    pub video: String,
    pub id: String,
    /// Effects that were added since the preset.
    #[serde(default)]
    pub revision: u32,
    /// Of one scene, the video.
    pub fit: Fit,
    /// How it came about, where it is a revision.
    #[serde(default)]
    pub step: Option<Step>,
}

/// A simulation with its published trace.
#[derive(Debug)]
pub struct Simulated {
    pub model: String,
    pub fps: f64,
    /// Without its ensemble.
    pub prediction: Prediction,
    pub trace: String,
}

/// An answer with its published traces.
#[derive(Debug)]
pub struct Answered {
    pub model: String,
    /// Its simulations without their ensembles.
    pub answer: Answer,
    pub traces: Vec<String>,
}

/// What a simulation is asked for.
#[derive(Debug, Clone, Serialize)]
pub struct SimulateOptions {
    pub interventions: Vec<Intervention>,
    /// `None`: those of the video and [`DEFAULT_FUTURE_FRAMES`] more.
    pub frames: Option<usize>,
    pub rollouts: usize,
    pub seed: u64,
}

/// All tenants share one pool, one memory and one folder; an engine shows one tenant's part of it.
#[derive(Clone)]
pub struct Engine {
    store: Store,
    pool: Arc<Pool>,
    /// Takes videos in: long jobs do not hold that up.
    gate: Arc<Pool>,
    capacity: Capacity,
    began: Instant,
    scenes: Cache<String, Arc<Scene>>,
    fits: Memo<StoredFit>,
    joint_fits: Memo<Vec<StoredFit>>,
    /// Fits with draws from their posteriors.
    draws: Memo<StoredFit>,
    studies: Memo<Study>,
    simulations: Memo<Simulated>,
    answers: Memo<Answered>,
    backlog: Arc<trace::Backlog>,
    shelf: Arc<shelf::Shelf>,
    replays: Arc<tokio::sync::Semaphore>,
    /// Grows with every deletion and damage, and is part of every key in memory, so that nothing deleted is found there.
    epoch: Arc<AtomicU64>,
    fits_run: Arc<AtomicU64>,
}

impl Engine {
    /// An engine on a data folder that it has for itself.
    pub fn open(data_dir: &Path, capacity: Capacity) -> Result<Engine, EngineError> {
        Ok(Engine {
            store: Store::open(data_dir)?,
            pool: Arc::new(Pool::new(capacity.workers, capacity.queue)?),
            gate: Arc::new(Pool::new(1, capacity.queue)?),
            capacity,
            began: Instant::now(),
            scenes: Cache::builder()
                .max_capacity(CACHED_BYTES)
                .weigher(|_, scene: &Arc<Scene>| u32::try_from(scene_bytes(scene)).unwrap_or(u32::MAX))
                .build(),
            fits: Memo::new("fit", CACHED_BYTES, fit_bytes),
            joint_fits: Memo::new("joint_fit", CACHED_BYTES, |fits| fits.iter().map(fit_bytes).sum()),
            draws: Memo::new("draws", CACHED_BYTES, fit_bytes),
            studies: Memo::new("study", CACHED_BYTES, |_| 64 * BASE_BYTES),
            simulations: Memo::new("simulation", CACHED_BYTES, |s| {
                let best = &s.prediction.best;
                BASE_BYTES + STATE_BYTES * best.states.len() * best.ids.len()
            }),
            answers: Memo::new("answer", CACHED_BYTES, |a| {
                let states = a.answer.simulations.iter().map(|s| s.best.states.len() * s.best.ids.len());
                BASE_BYTES + STATE_BYTES * states.sum::<usize>()
            }),
            backlog: Arc::default(),
            shelf: Arc::default(),
            replays: Arc::new(tokio::sync::Semaphore::new(MAX_REPLAYS)),
            epoch: Arc::default(),
            fits_run: Arc::default(),
        })
    }

    /// The engine as a tenant sees it: what is another's does not exist.
    pub fn of(self: &Arc<Self>, tenant: &Tenant) -> Arc<Engine> {
        match tenant.is_nobody() {
            true => self.clone(),
            false => Arc::new(Engine { store: self.store.of(tenant), ..Engine::clone(self) }),
        }
    }

    /// Fits that were computed, and not found.
    pub fn fits_run(&self) -> u64 {
        self.fits_run.load(Ordering::Relaxed)
    }

    /// How busy it is.
    pub fn load(&self) -> Load {
        self.pool.load()
    }

    pub fn capacity(&self) -> Capacity {
        self.capacity
    }

    pub fn uptime(&self) -> Duration {
        self.began.elapsed()
    }

    /// The work that goes on, the oldest first.
    pub fn jobs(&self) -> Vec<Job> {
        let ours = self.key("");
        let mut jobs = self.fits.jobs(&ours);
        jobs.extend(self.joint_fits.jobs(&ours));
        jobs.extend(self.draws.jobs(&ours));
        jobs.extend(self.studies.jobs(&ours));
        jobs.extend(self.simulations.jobs(&ours));
        jobs.extend(self.answers.jobs(&ours));
        jobs.sort_by_key(|job| std::cmp::Reverse(job.age));
        jobs
    }

    fn fitted_anew(&self) {
        self.fits_run.fetch_add(1, Ordering::Relaxed);
        metrics::counter!(figures::FITS).increment(1);
    }

    fn deadline(&self) -> Instant {
        Instant::now() + self.capacity.job_timeout
    }

    /// Lets go of all results in memory: they may name what is gone.
    fn forget(&self) {
        self.epoch.fetch_add(1, Ordering::SeqCst);
    }

    fn key(&self, id: &str) -> String {
        self.store.key(&format!("{}/{id}", self.epoch.load(Ordering::SeqCst)))
    }

    /// Stores the scene that `make` gives (on a thread for that) and returns its id; the same scene again changes nothing.
    pub async fn create_video<F>(&self, make: F) -> Result<(String, Arc<Scene>), EngineError>
    where
        F: FnOnce() -> Result<Scene, EngineError> + Send + 'static,
    {
        let control =
            Control { token: Default::default(), deadline: self.deadline(), progress: Arc::new(|_| {}) };
        let made = self.gate.run(control, move |_| {
            let scene = make()?;
            Ok((scene.digest(), scene))
        });
        let ((id, scene), _place) = made.await?;
        self.store.put_video(&id, &scene).await?;
        Ok((id, Arc::new(scene)))
    }

    /// Runs a piece of work that nothing is stored of on the CPU pool.
    pub async fn compute<T, F>(&self, work: F) -> Result<T, EngineError>
    where
        T: Send + 'static,
        F: FnOnce() -> Result<T, EngineError> + Send + 'static,
    {
        let control =
            Control { token: Default::default(), deadline: self.deadline(), progress: Arc::new(|_| {}) };
        Ok(self.pool.run(control, move |_| work()).await?.0)
    }

    pub async fn video(&self, id: &str) -> Result<Arc<Scene>, EngineError> {
        let key = self.key(id);
        if let Some(scene) = self.scenes.get(&key).await {
            return Ok(scene);
        }
        let found = self.store.get::<Scene>(Kind::Videos, id).await?;
        let scene = Arc::new(found.ok_or_else(|| no_video(id))?);
        self.scenes.insert(key, scene.clone()).await;
        Ok(scene)
    }

    /// Up to `limit` videos after `after`, by id.
    pub async fn videos(&self, after: &str, limit: usize) -> Result<Vec<(String, Scene)>, EngineError> {
        Ok(self.store.list(Kind::Videos, "", after, limit, |_: &Scene| true).await?)
    }

    /// Deletes a video with its models and traces.
    pub async fn delete_video(&self, id: &str) -> Result<(), EngineError> {
        let found = self.store.delete_video(id).await;
        self.forget();
        if found? { Ok(()) } else { Err(no_video(id)) }
    }

    /// Fits a model to a video, unless that was done before; the result is stored before it is given.
    pub async fn fit(
        self: &Arc<Self>,
        video: &str,
        start: &Choice,
        options: FitOptions,
    ) -> Result<Waiting<StoredFit>, EngineError> {
        let key = self.key("");
        let scene = self.video(video).await?;
        let model = start.unfitted(&scene)?;
        let id = canonical_digest("model", &(video, &model, &options, env!("CARGO_PKG_VERSION")));
        let work = {
            let (engine, video, id) = (self.clone(), video.to_string(), id.clone());
            move |control| async move { engine.run_fit(video, id, scene, model, options, control).await }
        };
        Ok(self.fits.join(format!("{key}{id}"), video, self.deadline(), work).await)
    }

    async fn run_fit(
        &self,
        video: String,
        id: String,
        scene: Arc<Scene>,
        model: crate::world::Model,
        options: FitOptions,
        control: Control,
    ) -> Result<StoredFit, EngineError> {
        let key = format!("{video}/{id}");
        if let Some(found) = self.store.get(Kind::Fits, &key).await? {
            figures::result("fit", "store");
            return Ok(found);
        }
        self.fitted_anew();
        figures::result("fit", "made");
        let backlog = self.backlog.clone();
        let job = move |stop: crate::num::Stop| {
            let fit = estimate_one(&scene, &model, &options, stop)?;
            let stored = StoredFit { video, id, revision: 0, fit, step: None };
            let file = trace::fit(&scene, &model, &options, &stored)?;
            Ok((stored, backlog.admit(vec![file], stop)?))
        };
        let ((stored, batch), _place) = self.pool.run(control, job).await?;
        self.publish(batch).await?;
        self.put_of_video(Kind::Fits, &stored.video, &key, &stored).await?;
        Ok(stored)
    }

    /// A model that was fitted.
    pub async fn model(&self, video: &str, id: &str) -> Result<StoredFit, EngineError> {
        let found = self.store.get(Kind::Fits, &format!("{video}/{id}")).await?;
        found.ok_or_else(|| EngineError::NotFound { name: format!("videos/{video}/models/{id}") })
    }

    /// Up to `limit` models of a video after the one with the id `after`, by id.
    pub async fn models(
        &self,
        video: &str,
        after: &str,
        limit: usize,
    ) -> Result<Vec<StoredFit>, EngineError> {
        self.video(video).await?;
        let prefix = format!("{video}/");
        let after = format!("{prefix}{after}");
        let rows = self.store.list(Kind::Fits, &prefix, &after, limit, |_: &StoredFit| true).await?;
        Ok(rows.into_iter().map(|(_, fit)| fit).collect())
    }

    /// A fit with the draws from its posterior that predictions need.
    async fn drawn(
        self: &Arc<Self>,
        video: &str,
        scene: &Arc<Scene>,
        choice: &Choice,
    ) -> Result<Arc<StoredFit>, EngineError> {
        let fitted = match &choice.kind {
            ChoiceKind::Fitted(id) => Arc::new(self.model(video, id).await?),
            _ => self.fit(video, choice, FitOptions::default()).await?.finish().await?,
        };
        if fitted.fit.draws() > 0 {
            return Ok(fitted);
        }
        let key = self.key(&fitted.id);
        let (engine, scene) = (self.clone(), scene.clone());
        let work = move |control| async move {
            figures::result("draws", "made");
            let job = move |stop: crate::num::Stop| {
                let stored = StoredFit::clone(&fitted);
                Ok(StoredFit {
                    fit: with_draws(std::slice::from_ref(scene.as_ref()), stored.fit, stop)?,
                    ..stored
                })
            };
            Ok(engine.pool.run(control, job).await?.0)
        };
        self.draws.join(key, video, self.deadline(), work).await.finish().await
    }

    /// Predicts or imagines; the trace is durable before the result is given.
    pub async fn simulate(
        self: &Arc<Self>,
        video: &str,
        choice: &Choice,
        options: SimulateOptions,
    ) -> Result<Arc<Simulated>, EngineError> {
        let key = self.key("");
        let scene = self.video(video).await?;
        let frames = options.frames.unwrap_or(scene.times.len() + DEFAULT_FUTURE_FRAMES);
        check::size(&scene, frames, options.rollouts)?;
        let fitted = self.drawn(video, &scene, choice).await?;
        let model = &fitted.fit.scenes.first().ok_or_else(|| no_video(video))?.model;
        let edited = check::edit(model, &options.interventions)?;
        let SimulateOptions { interventions, rollouts, seed, .. } = options;
        let request = PredictionRequest { interventions, frames, rollouts, seed };
        let digest = canonical_digest("simulation", &(video, &fitted.id, &request));
        let engine = self.clone();
        let work = move |control| async move {
            figures::result("simulation", "made");
            let ((prediction, batch), _place) = {
                let (scene, fitted, backlog) = (scene.clone(), fitted.clone(), engine.backlog.clone());
                let job = move |stop: crate::num::Stop| {
                    check::places(&edited, &request.interventions)?;
                    let prediction = predict(&scene, &fitted.fit, 0, &request, stop)?;
                    check::finite(&prediction)?;
                    let json = serde_json::json!({ "simulate": &request }).to_string();
                    let file = trace::simulation(&scene, &fitted, &prediction, request.seed, &json)?;
                    Ok((Prediction { ensemble: vec![], ..prediction }, backlog.admit(vec![file], stop)?))
                };
                engine.pool.run(control, job).await?
            };
            let trace = engine.publish(batch).await?.pop().unwrap_or_default();
            Ok(Simulated { model: fitted.id.clone(), fps: scene.fps, prediction, trace })
        };
        self.simulations.join(format!("{key}{digest}"), video, self.deadline(), work).await.finish().await
    }

    /// Answers a question; the traces it stands on are durable before the answer is given.
    pub async fn ask(
        self: &Arc<Self>,
        video: &str,
        choice: &Choice,
        question: Question,
        options: AskOptions,
    ) -> Result<Arc<Answered>, EngineError> {
        let key = self.key("");
        let scene = self.video(video).await?;
        check::rollouts(&scene, scene.times.len() + FUTURE_FRAMES, options.rollouts)?;
        let fitted = self.drawn(video, &scene, choice).await?;
        let digest = canonical_digest("question", &(video, &fitted.id, &question, &options));
        let engine = self.clone();
        let work = move |control| async move {
            figures::result("answer", "made");
            let (model, backlog) = (fitted.id.clone(), engine.backlog.clone());
            let job = move |stop: crate::num::Stop| {
                let mut answer = ask(&scene, &fitted.fit, 0, &question, &options, stop)?;
                let request = serde_json::json!({ "ask": &question, "options": &options }).to_string();
                let mut files = Vec::new();
                for prediction in &mut answer.simulations {
                    check::places(&prediction.model, &prediction.interventions)?;
                    check::finite(prediction)?;
                    files.push(trace::simulation(&scene, &fitted, prediction, options.seed, &request)?);
                    prediction.ensemble = vec![];
                }
                Ok((answer, backlog.admit(files, stop)?))
            };
            let ((answer, batch), _place) = engine.pool.run(control, job).await?;
            let traces = engine.publish(batch).await?;
            Ok(Answered { model, answer, traces })
        };
        self.answers.join(format!("{key}{digest}"), video, self.deadline(), work).await.finish().await
    }

    async fn put_of_video<T: Serialize>(
        &self,
        kind: Kind,
        video: &str,
        key: &str,
        value: &T,
    ) -> Result<(), EngineError> {
        self.store.put_of_video(kind, video, key, value).await.map_err(|error| match error {
            StoreError::VideoGone => no_video(video),
            other => other.into(),
        })
    }
}

fn scene_bytes(scene: &Scene) -> usize {
    let samples: usize = scene.tracks.iter().map(|t| t.samples.len()).sum();
    BASE_BYTES + STATE_BYTES * samples + 8 * scene.times.len()
}

/// A fit that predictions begin with has draws of every parameter.
fn fit_bytes(stored: &StoredFit) -> usize {
    BASE_BYTES + 1024 * stored.fit.posterior.estimates.len()
}

fn no_video(id: &str) -> EngineError {
    EngineError::NotFound { name: format!("videos/{id}") }
}
