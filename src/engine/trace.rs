//! Trace files: encoded on the pool, published whole, listed and read back.

use super::{Engine, EngineError, StoredFit};
use crate::reason::Imagined;
use crate::recording::{self, Recording};
use crate::scene::Scene;
use crate::store::Kind;
use crate::world::{Intervention, InterventionError};
use bytes::Bytes;
use serde::{Deserialize, Serialize};

/// Most bytes of a trace that are read at a time.
pub const CHUNK: u64 = 256 * 1024;

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
}

/// The trace file of one simulation; its id follows from its bytes.
pub fn encode(
    scene: &Scene,
    fitted: &StoredFit,
    imagined: &Imagined,
    seed: u64,
    request_json: &str,
) -> Result<(Bytes, TraceRecord), EngineError> {
    let recording = Recording {
        scene,
        imagined,
        estimates: &fitted.fit.posterior.estimates,
        video: &fitted.video,
        model: &fitted.id,
        seed,
        request_json,
    };
    let bytes = recording::encode(&recording).map_err(|e| EngineError::Recording(e.to_string()))?;
    let record = TraceRecord {
        id: blake3::hash(&bytes).to_hex().to_string(),
        video: fitted.video.clone(),
        model: fitted.id.clone(),
        size_bytes: bytes.len() as u64,
        frames: imagined.best.times.len() as u32,
        seed,
        interventions: imagined.interventions.iter().map(words).collect(),
    };
    Ok((bytes.into(), record))
}

impl Engine {
    /// The file first, then the record that names it: what is listed is whole.
    pub(super) async fn publish(&self, bytes: Bytes, record: TraceRecord) -> Result<String, EngineError> {
        self.store.put_blob(&record.id, bytes).await?;
        self.put_of_video(Kind::Traces, &record.video, &record.id, &record).await?;
        Ok(record.id)
    }

    /// Up to `limit` traces (of one video, or all) after the id `after`, by id.
    pub async fn traces(
        &self,
        video: Option<String>,
        after: &str,
        limit: usize,
    ) -> Result<Vec<TraceRecord>, EngineError> {
        if let Some(video) = &video {
            self.video(video).await?;
        }
        let keep = move |record: &TraceRecord| video.as_ref().is_none_or(|v| *v == record.video);
        let rows = self.store.list(Kind::Traces, "", after, limit, keep).await?;
        Ok(rows.into_iter().map(|(_, record)| record).collect())
    }

    pub async fn trace(&self, id: &str) -> Result<TraceRecord, EngineError> {
        let found = self.store.get(Kind::Traces, id).await?;
        found.ok_or_else(|| EngineError::NotFound { name: format!("traces/{id}") })
    }

    /// The next bytes of a trace from `offset` on; empty at its end.
    pub async fn read_trace(&self, record: &TraceRecord, offset: u64) -> Result<Bytes, EngineError> {
        let len = record.size_bytes.saturating_sub(offset).min(CHUNK);
        if len == 0 {
            return Ok(Bytes::new());
        }
        Ok(self.store.read_blob(&record.id, offset, len).await?)
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
