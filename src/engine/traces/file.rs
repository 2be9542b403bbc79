//! The record of a trace, and the trace files of simulations, fits and discoveries.

use crate::engine::error::EngineError;
use crate::engine::results::{Discovered, StoredFit};
use crate::fit::{FitOptions, StartPoint, initial_model};
use crate::media::Still;
use crate::reason::Prediction;
use crate::recording::{self, RecordedChange, RecordedRevision, Recording};
use crate::scene::Scene;
use crate::world::{Intervention, Model};
use bytes::Bytes;
use serde::{Deserialize, Serialize};

/// The record of a trace: what is listed without reading its file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TraceRecord {
    pub id: String,
    pub video: String,
    pub model: String,
    pub size_bytes: u64,
    pub frames: u32,
    pub seed: u64,
    /// In plain words.
    pub interventions: Vec<String>,
    #[serde(default)]
    pub kind: TraceKind,
    /// When it was stored last (ms after 1970). It is in no file and in no result: those depend on the request alone.
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

/// An encoded trace that is not stored yet.
pub struct TraceFile {
    pub(super) bytes: Bytes,
    pub(super) record: TraceRecord,
}

/// The trace file of one simulation; with `stills` it shows them too.
pub fn simulation(
    scene: &Scene,
    fitted: &StoredFit,
    prediction: &Prediction,
    (seed, stills): (u64, &[Still]),
    request_json: &str,
) -> Result<TraceFile, EngineError> {
    let (video, model, fit) = (&fitted.video, &fitted.id, &fitted.fit);
    let recording = Recording { scene, prediction, fit, video, model, seed, request_json, stills };
    let bytes = recording::encode(&recording)?;
    let interventions = prediction.interventions.iter().map(in_words).collect();
    let frames = prediction.best.times.len();
    let mut file = TraceFile::new(bytes, video, model, frames, TraceKind::Simulation);
    file.record = TraceRecord { seed, interventions, ..file.record };
    Ok(file)
}

/// The trace file of a fit: the start model and the fitted model.
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

/// The trace files of a discovery, one a video: the models without and with the added effects.
pub fn discovery(
    videos: &[String],
    scenes: &[Scene],
    found: &Discovered,
) -> Result<Vec<TraceFile>, EngineError> {
    let revisions = &found.discovery.revisions;
    let recorded: Vec<RecordedRevision> = revisions
        .iter()
        .map(|r| RecordedRevision {
            effect: r.effect.clone().unwrap_or_default(),
            rmse: r.rmse,
            held_out_rmse: r.held_out_rmse,
            reduced_chi_square: r.reduced_chi_square,
        })
        .collect();
    let Some(((first, last), record)) = revisions.first().zip(revisions.last()).zip(found.records.last())
    else {
        return Ok(vec![]);
    };
    let request = serde_json::json!({ "discover": { "videos": videos } }).to_string();
    let mut files = vec![];
    for (k, ((scene, video), id)) in scenes.iter().zip(videos).zip(&record.models).enumerate() {
        let Some(before) = first.fit.scenes.get(k) else { continue };
        let (video, id, revision) = (video.clone(), id.clone(), record.number);
        let (fit, record) = (last.fit.of_scene(k), Some(record.clone()));
        let fitted = StoredFit { video, id, revision, fit, record };
        files.push(changed(TraceKind::Discovery, scene, &before.model, &fitted, &recorded, &request)?);
    }
    Ok(files)
}

fn changed(
    kind: TraceKind,
    scene: &Scene,
    before: &Model,
    fitted: &StoredFit,
    revisions: &[RecordedRevision],
    request_json: &str,
) -> Result<TraceFile, EngineError> {
    let (video, model, fit) = (&fitted.video, &fitted.id, &fitted.fit);
    let change =
        RecordedChange { kind: kind.word(), scene, before, fit, video, model, revisions, request_json };
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

fn in_words(intervention: &Intervention) -> String {
    match intervention {
        Intervention::Remove { id } => format!("object {id} removed"),
        Intervention::ScaleMass { id, factor } => format!("mass of object {id} times {factor}"),
        Intervention::ScaleRestitution { id, factor } => {
            format!("restitution of object {id} times {factor}")
        }
        Intervention::ScaleFriction { id, factor } => format!("friction of object {id} times {factor}"),
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
