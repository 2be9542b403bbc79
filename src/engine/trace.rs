//! Trace files: encoded on the pool, published whole, listed and read back.

use super::shelf::Lease;
use super::{Discovered, Engine, EngineError, StoredFit, figures};
use crate::fit::{FitError, FitOptions, StartPoint, initial_model};
use crate::num::Stop;
use crate::reason::Prediction;
use crate::recording::{self, Change, Recording, RecordingError, Step};
use crate::scene::Scene;
use crate::store::Kind;
use crate::world::{Intervention, InterventionError, Model};
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Most bytes of a trace that are read at a time.
pub const CHUNK: u64 = 256 * 1024;
/// KiB of encoded traces that may wait for the disk: about a hundred usual ones.
const BACKLOG: u32 = 64 * 1024;
/// How often a job looks whether the backlog has room again.
const LOOK: Duration = Duration::from_millis(1);

/// What is known of a trace file without reading it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TraceRecord {
    pub id: String,
    pub video: String,
    pub model: String,
    pub size_bytes: u64,
    pub frames: u32,
    pub seed: u64,
    /// In words.
    pub interventions: Vec<String>,
    #[serde(default)]
    pub kind: TraceKind,
    /// When it was stored last (ms after 1970); it is in no file and in no result.
    #[serde(default)]
    pub stored_ms: u64,
}

/// What a trace is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TraceKind {
    #[default]
    Simulation,
    Fit,
    Discovery,
}

impl TraceKind {
    fn word(self) -> &'static str {
        match self {
            TraceKind::Simulation => "simulation",
            TraceKind::Fit => "fit",
            TraceKind::Discovery => "discovery",
        }
    }
}

/// Which traces are listed.
#[derive(Debug, Clone, Default)]
pub struct TraceFilter {
    pub video: Option<String>,
    pub model: Option<String>,
    /// Stored from the first on and before the second (ms after 1970).
    pub stored_ms: (Option<u64>, Option<u64>),
}

/// An encoded trace that is not stored yet.
pub struct TraceFile {
    bytes: Bytes,
    record: TraceRecord,
}

/// Traces of one piece of work, with their place among those that wait for the disk.
pub struct Batch {
    files: Vec<TraceFile>,
    _place: OwnedSemaphorePermit,
}

/// How many bytes wait for the disk. It is bounded: work waits for room before its result may leave the pool.
pub struct Backlog(Arc<Semaphore>);

impl Default for Backlog {
    fn default() -> Self {
        Backlog(Arc::new(Semaphore::new(BACKLOG as usize)))
    }
}

impl Backlog {
    /// Waits for room for all the files at once, so that no two wait for each other.
    pub fn admit(&self, files: Vec<TraceFile>, stop: Stop) -> Result<Batch, EngineError> {
        let bytes: usize = files.iter().map(|f| f.bytes.len()).sum();
        let kib = u32::try_from(bytes / 1024 + 1).unwrap_or(BACKLOG).min(BACKLOG);
        loop {
            if let Ok(place) = self.0.clone().try_acquire_many_owned(kib) {
                return Ok(Batch { files, _place: place });
            }
            stop(1.0).map_err(FitError::from)?;
            std::thread::sleep(LOOK);
        }
    }
}

/// The trace file of one simulation; its id follows from its bytes.
pub fn simulation(
    scene: &Scene,
    fitted: &StoredFit,
    prediction: &Prediction,
    seed: u64,
    request_json: &str,
) -> Result<TraceFile, EngineError> {
    let (video, model, fit) = (&fitted.video, &fitted.id, &fitted.fit);
    let bytes = recording::encode(&Recording { scene, prediction, fit, video, model, seed, request_json })?;
    let interventions = prediction.interventions.iter().map(words).collect();
    let frames = prediction.best.times.len();
    let mut file = TraceFile::new(bytes, video, model, frames, TraceKind::Simulation);
    file.record = TraceRecord { seed, interventions, ..file.record };
    Ok(file)
}

/// The trace file of a fit: the model where the search began, and fitted.
pub fn fit(
    scene: &Scene,
    start: &Model,
    options: &FitOptions,
    fitted: &StoredFit,
) -> Result<TraceFile, EngineError> {
    let before = match options.start_point {
        StartPoint::Tracks => initial_model(scene, start),
        StartPoint::Models | StartPoint::YawSearched | StartPoint::NearOptimum => start.clone(),
    };
    let request = serde_json::json!({ "fit": options }).to_string();
    changed(TraceKind::Fit, scene, &before, fitted, &[], &request)
}

/// The trace files of a discovery, one a video: the model without and with the effects that were added.
pub fn discovery(
    videos: &[String],
    scenes: &[Scene],
    found: &Discovered,
) -> Result<Vec<TraceFile>, EngineError> {
    let revisions = &found.discovery.revisions;
    let steps: Vec<Step> = revisions
        .iter()
        .map(|r| Step {
            effect: r.effect.clone().unwrap_or_default(),
            rmse: r.rmse,
            held_out_rmse: r.held_out_rmse,
            reduced_chi_square: r.reduced_chi_square,
        })
        .collect();
    let Some(((first, last), step)) = revisions.first().zip(revisions.last()).zip(found.steps.last()) else {
        return Ok(vec![]);
    };
    let request = serde_json::json!({ "discover": { "videos": videos } }).to_string();
    let mut files = vec![];
    for (k, ((scene, video), id)) in scenes.iter().zip(videos).zip(&step.models).enumerate() {
        let Some(before) = first.fit.scenes.get(k) else { continue };
        let (video, id, revision) = (video.clone(), id.clone(), step.number);
        let (fit, step) = (last.fit.of_scene(k), Some(step.clone()));
        let fitted = StoredFit { video, id, revision, fit, step };
        files.push(changed(TraceKind::Discovery, scene, &before.model, &fitted, &steps, &request)?);
    }
    Ok(files)
}

fn changed(
    kind: TraceKind,
    scene: &Scene,
    before: &Model,
    fitted: &StoredFit,
    revisions: &[Step],
    request_json: &str,
) -> Result<TraceFile, EngineError> {
    let (video, model, fit) = (&fitted.video, &fitted.id, &fitted.fit);
    let change = Change { kind: kind.word(), scene, before, fit, video, model, revisions, request_json };
    let bytes = recording::encode_change(&change)?;
    Ok(TraceFile::new(bytes, video, model, scene.times.len(), kind))
}

impl TraceFile {
    fn new(bytes: Vec<u8>, video: &str, model: &str, frames: usize, kind: TraceKind) -> TraceFile {
        let record = TraceRecord {
            id: blake3::hash(&bytes).to_hex().to_string(),
            video: video.into(),
            model: model.into(),
            size_bytes: bytes.len() as u64,
            frames: frames as u32,
            seed: 0,
            interventions: vec![],
            kind,
            stored_ms: 0,
        };
        TraceFile { bytes: bytes.into(), record }
    }
}

impl From<RecordingError> for EngineError {
    fn from(error: RecordingError) -> Self {
        EngineError::Recording(error.to_string())
    }
}

/// Milliseconds after 1970.
pub fn now_ms() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_millis() as u64)
}

impl Engine {
    /// Stores the files and gives their ids. Each file first, then the record that names it: what is listed is whole.
    #[tracing::instrument(skip_all)]
    pub(super) async fn publish(&self, batch: Batch) -> Result<Vec<String>, EngineError> {
        let mut ids = Vec::with_capacity(batch.files.len());
        for TraceFile { bytes, record } in batch.files {
            let _lease = self.shelf.lease_when_free(&self.store.key(&record.id)).await;
            let record = TraceRecord { stored_ms: now_ms(), ..record };
            self.store.put_blob(&record.id, bytes).await?;
            metrics::counter!(figures::TRACES).increment(1);
            metrics::counter!(figures::TRACE_BYTES).increment(record.size_bytes);
            self.put_of_video(Kind::Traces, &record.video, &record.id, &record).await?;
            ids.push(record.id);
        }
        self.shelf.filled.notify_one();
        Ok(ids)
    }

    /// Up to `limit` traces that the filter lets through, after the id `after`, by id.
    pub async fn traces(
        &self,
        filter: TraceFilter,
        after: &str,
        limit: usize,
    ) -> Result<Vec<TraceRecord>, EngineError> {
        if let Some(video) = &filter.video {
            self.video(video).await?;
        }
        let keep = move |record: &TraceRecord| {
            let is = |wanted: &Option<String>, found: &String| wanted.as_ref().is_none_or(|w| w == found);
            let (from, to) = filter.stored_ms;
            is(&filter.video, &record.video)
                && is(&filter.model, &record.model)
                && from.is_none_or(|from| record.stored_ms >= from)
                && to.is_none_or(|to| record.stored_ms < to)
        };
        let rows = self.store.list(Kind::Traces, "", after, limit, keep).await?;
        Ok(rows.into_iter().map(|(_, record)| record).collect())
    }

    /// The record of a trace, and the right to read it: retention leaves it alone as long as the lease is held.
    pub async fn trace(&self, id: &str) -> Result<(TraceRecord, Lease), EngineError> {
        let missing = || EngineError::NotFound { name: format!("traces/{id}") };
        let lease = self.shelf.lease(&self.store.key(id)).ok_or_else(missing)?;
        let record = self.store.get(Kind::Traces, id).await?.ok_or_else(missing)?;
        Ok((record, lease))
    }

    /// Begins to read the file of a trace.
    pub async fn download(self: &Arc<Self>, id: &str) -> Result<Download, EngineError> {
        let (record, lease) = self.trace(id).await?;
        let found = self.store.blob_size(id).await?;
        if found != record.size_bytes {
            return Err(self.damaged(id, format!("it has {found} bytes of {}", record.size_bytes)));
        }
        let (engine, hasher) = (self.clone(), blake3::Hasher::new());
        Ok(Download { engine, record, offset: 0, hasher, _lease: lease })
    }

    /// A trace that cannot be read. From now on no result in memory names it, so that it is written anew when it is asked for.
    pub(super) fn damaged(&self, id: &str, what: String) -> EngineError {
        tracing::error!(trace = id, what, "a trace is damaged");
        self.forget();
        EngineError::Damaged { id: id.into(), what }
    }
}

/// A trace file that is being read. Its id follows from its bytes: the last of them are given only if all are as written.
pub struct Download {
    engine: Arc<Engine>,
    record: TraceRecord,
    offset: u64,
    hasher: blake3::Hasher,
    _lease: Lease,
}

impl Download {
    pub fn record(&self) -> &TraceRecord {
        &self.record
    }

    /// Where the next bytes begin, and the bytes; empty at the end.
    pub async fn next(&mut self) -> Result<(u64, Bytes), EngineError> {
        let (id, offset) = (&self.record.id, self.offset);
        let len = self.record.size_bytes.saturating_sub(offset).min(CHUNK);
        if len == 0 {
            return Ok((offset, Bytes::new()));
        }
        let bytes = self.engine.store.read_blob(id, offset, len).await?;
        self.hasher.update(&bytes);
        self.offset += bytes.len() as u64;
        let ends = self.offset == self.record.size_bytes;
        if (bytes.len() as u64) < len || ends && self.hasher.finalize().to_hex().as_str() != id {
            return Err(self.engine.damaged(id, "its checksum is wrong".into()));
        }
        Ok((offset, bytes))
    }
}

fn words(intervention: &Intervention) -> String {
    match intervention {
        Intervention::Remove { id } => format!("object {id} removed"),
        Intervention::ScaleMass { id, factor } => format!("mass of object {id} times {factor}"),
        Intervention::ScaleRestitution { id, factor } => {
            format!("restitution of object {id} times {factor}")
        }
        Intervention::ScaleVelocity { id, factor } => format!("velocity of object {id} times {factor}"),
        Intervention::Shift { id, by } => format!("object {id} starts ({}, {}) m off", by.x, by.y),
        Intervention::SetVelocity { id, velocity: v } => {
            format!("object {id} starts with ({}, {}) m/s", v.x, v.y)
        }
        Intervention::Place { id, position: p, .. } => format!("object {id} starts at ({}, {}) m", p.x, p.y),
        Intervention::Add { body } => format!("object {} added", body.id),
        Intervention::SwitchEffect { name, on } => format!("{name} {}", if *on { "on" } else { "off" }),
    }
}

/// The request's field that an intervention error is about.
pub fn refused(index: usize, intervention: &Intervention, error: &InterventionError) -> EngineError {
    let kind = match intervention {
        Intervention::Remove { .. } => "remove",
        Intervention::ScaleMass { .. } => "scale_mass",
        Intervention::ScaleRestitution { .. } => "scale_restitution",
        Intervention::SetVelocity { .. } => "set_velocity",
        Intervention::ScaleVelocity { .. } => "scale_velocity",
        Intervention::Shift { .. } => "shift",
        Intervention::Place { .. } => "place",
        Intervention::Add { .. } => "add",
        Intervention::SwitchEffect { .. } => "switch_effect",
    };
    let field = match error {
        InterventionError::UnknownObject { .. } | InterventionError::DuplicateObject { .. } => "object_id",
        InterventionError::UnknownEffect { .. } => "effect",
        InterventionError::BadValue { what, .. } if what.ends_with("factor") => "factor",
        InterventionError::BadValue { what: "shift", .. } => "by",
        InterventionError::BadValue { what, .. } => what,
    };
    EngineError::invalid(format!("interventions[{index}].{kind}.{field}"), error.to_string())
}
