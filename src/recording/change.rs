//! Writes what a fit or a discovery did to a model: simulated before and after, the loss of each iteration, revisions.

use super::draft::Draft;
use super::encode::{cbor, measured, parameters, residuals, run};
use super::messages::{self as m, v1};
use super::{RecordingError, metadata};
use crate::fit::Fit;
use crate::scene::Scene;
use crate::world::{Model, trace};
use serde::{Deserialize, Serialize};

/// A change of one scene's model. The same change gives the same bytes.
#[derive(Debug, Clone, Copy)]
pub struct Change<'a> {
    /// `fit` or `discovery`.
    pub kind: &'a str,
    pub scene: &'a Scene,
    /// Where the change began.
    pub before: &'a Model,
    /// Of this scene alone; its model is the one after.
    pub fit: &'a Fit,
    /// Id of the video.
    pub video: &'a str,
    /// Id of the model after.
    pub model: &'a str,
    /// Of a discovery; the first is the model without any effect added.
    pub revisions: &'a [Step],
    pub request_json: &'a str,
}

/// A revision as a trace tells it; errors in m.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Step {
    pub effect: String,
    pub rmse: f64,
    pub held_out_rmse: f64,
    pub reduced_chi_square: f64,
}

/// The trace file of a change: both models over the frames of the video.
pub fn encode_change(change: &Change) -> Result<Vec<u8>, RecordingError> {
    let Change { kind, scene, before, fit, .. } = *change;
    let after = fit.scenes.first().map_or(before, |s| &s.model);
    let mut draft = Draft::new(m::CHANGE.to_vec());
    measured(scene, &mut draft)?;
    let ways = [
        (before, [&m::BEFORE, &m::BEFORE_POSES], &m::RESIDUALS_BEFORE),
        (after, [&m::AFTER, &m::AFTER_POSES], &m::RESIDUALS_AFTER),
    ];
    for (model, topics, residual) in ways {
        let simulated = trace(model, &scene.times).as_observed(model);
        run(&simulated, &[], model, topics, &mut draft)?;
        residuals(scene, &simulated, residual, &mut draft)?;
    }
    for (iteration, &loss) in fit.losses.iter().enumerate() {
        let message = v1::TraceIteration { iteration: iteration as u32, loss };
        draft.push(&m::LOSS, scene.time_of(iteration), &message)?;
    }
    for (number, step) in change.revisions.iter().enumerate() {
        let message = v1::TraceRevision {
            revision: number as u32,
            effect: step.effect.clone(),
            rmse: step.rmse,
            held_out_rmse: step.held_out_rmse,
            reduced_chi_square: step.reduced_chi_square,
        };
        draft.push(&m::REVISIONS, scene.time_of(number), &message)?;
    }
    parameters(&fit.posterior.estimates, &mut draft)?;
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
    draft.finish(metadata, &attachments)
}
