//! Encodes what a fit or a discovery changed: both models simulated, the loss of each iteration, the revisions.

use super::RecordingError;
use super::encode::{cbor, measured, parameters, residuals, run};
use super::messages::{self as m, v1};
use super::origin::metadata;
use super::writer::TraceWriter;
use crate::fit::Fit;
use crate::scene::Scene;
use crate::world::{Model, trace};
use serde::{Deserialize, Serialize};

/// A change of the model of one scene.
#[derive(Debug, Clone, Copy)]
pub struct RecordedChange<'a> {
    /// `fit` or `discovery`.
    pub kind: &'a str,
    pub scene: &'a Scene,
    /// The model before the change.
    pub before: &'a Model,
    /// The fit of this scene alone; its model is the one after the change.
    pub fit: &'a Fit,
    /// Id of the video.
    pub video: &'a str,
    /// Id of the model after.
    pub model: &'a str,
    /// Of a discovery; the first is the model without any effect added.
    pub revisions: &'a [RecordedRevision],
    pub request_json: &'a str,
}

/// A revision in a trace; errors in m.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedRevision {
    pub effect: String,
    pub rmse: f64,
    pub held_out_rmse: f64,
    pub reduced_chi_square: f64,
}

/// The trace file of a change: both models over the frames of the video.
pub fn encode_change(change: &RecordedChange) -> Result<Vec<u8>, RecordingError> {
    let RecordedChange { kind, scene, before, fit, .. } = *change;
    let after = fit.scenes.first().map_or(before, |s| &s.model);
    let mut writer = TraceWriter::new(m::CHANGE.to_vec());
    measured(scene, &mut writer)?;
    let runs = [
        (before, [&m::BEFORE, &m::BEFORE_POSES], &m::RESIDUALS_BEFORE),
        (after, [&m::AFTER, &m::AFTER_POSES], &m::RESIDUALS_AFTER),
    ];
    for (model, topics, residual) in runs {
        let simulated = trace(model, &scene.times).as_observed(model);
        run(&simulated, &[], model, topics, &mut writer)?;
        residuals(scene, &simulated, residual, &mut writer)?;
    }
    for (iteration, &loss) in fit.losses.iter().enumerate() {
        let message = v1::TraceIteration { iteration: iteration as u32, loss };
        writer.push(&m::LOSS, scene.time_of(iteration), &message)?;
    }
    for (number, step) in change.revisions.iter().enumerate() {
        let message = v1::TraceRevision {
            revision: number as u32,
            effect: step.effect.clone(),
            rmse: step.rmse,
            held_out_rmse: step.held_out_rmse,
            reduced_chi_square: step.reduced_chi_square,
        };
        writer.push(&m::REVISIONS, scene.time_of(number), &message)?;
    }
    parameters(fit, &mut writer)?;
    let json = "application/json";
    let attachments = [
        ("request.json", json, change.request_json.as_bytes().to_vec()),
        ("before.json", json, serde_json::to_vec(before)?),
        ("model.json", json, serde_json::to_vec(after)?),
        ("scene.json", json, serde_json::to_vec(scene)?),
        ("revisions.json", json, serde_json::to_vec(change.revisions)?),
        ("fit.cbor", "application/cbor", cbor(fit)?),
    ];
    let mut metadata = metadata(kind, scene, change.video, change.model);
    metadata.extend(
        [
            ("preset", after.preset.clone()),
            ("frames", scene.times.len().to_string()),
            ("observed_frames", scene.times.len().to_string()),
            ("iterations", fit.iterations.to_string()),
        ]
        .map(|(key, value)| (key.to_string(), value)),
    );
    writer.finish(metadata, &attachments)
}
