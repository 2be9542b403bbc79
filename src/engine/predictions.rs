//! Predictions and counterfactuals. Their traces are durable before the result is returned.

use super::error::EngineError;
use super::limits;
use super::metric_names;
use super::model_source::ModelSource;
use super::pool::JobKind;
use super::results::{PublishedSimulation, StoredFit, result_digest};
use super::state::Engine;
use super::task::{Performed, ReportSink, Task};
use super::traces::file::{self, TraceFile};
use crate::media::Still;
use crate::num::Stop;
use crate::reason::{Prediction, PredictionRequest, predict};
use crate::scene::Scene;
use crate::world::{Intervention, Model};
use serde::Serialize;
use std::sync::Arc;

/// Frames after the video in a simulation whose request names none.
pub const DEFAULT_FUTURE_FRAMES: usize = 60;
/// Rollouts of a request that names none.
pub const DEFAULT_ROLLOUTS: usize = 32;

/// Object states of all rollouts up to which a prediction is short work: ten times those of a usual one.
pub(super) const SHORT_STATES: usize = 300_000;

/// What a simulation is asked for.
#[derive(Debug, Clone, Serialize)]
pub struct SimulateOptions {
    pub interventions: Vec<Intervention>,
    /// `None`: those of the video and [`DEFAULT_FUTURE_FRAMES`] more.
    pub frames: Option<usize>,
    pub rollouts: usize,
    pub seed: u64,
    /// Whether the trace shows the stills of the video.
    pub stills: bool,
}

/// Simulates one request.
struct SimulationTask {
    scene: Arc<Scene>,
    fitted: Arc<StoredFit>,
    /// The fitted model with the interventions.
    edited: Model,
    request: PredictionRequest,
    stills: Vec<Still>,
}

impl Task for SimulationTask {
    /// Without its ensemble.
    type Output = Prediction;

    fn kind(&self) -> JobKind {
        let states = self.request.rollouts * self.request.frames * self.scene.objects.len();
        if states > SHORT_STATES { JobKind::Ensemble } else { JobKind::Simulation }
    }

    fn perform(self, _: ReportSink, stop: Stop) -> Result<(Prediction, Vec<TraceFile>), EngineError> {
        let SimulationTask { scene, fitted, edited, request, stills } = self;
        limits::places(&edited, &request.interventions)?;
        let prediction = predict(&scene, &fitted.fit, 0, &request, stop)?;
        limits::finite(&prediction)?;
        let json = serde_json::json!({ "simulate": &request }).to_string();
        let file = file::simulation(&scene, &fitted, &prediction, (request.seed, &stills), &json)?;
        Ok((Prediction { ensemble: vec![], ..prediction }, vec![file]))
    }
}

impl Engine {
    /// Predicts, or simulates a counterfactual where there are interventions.
    pub async fn simulate(
        self: &Arc<Self>,
        video: &str,
        source: &ModelSource,
        options: SimulateOptions,
    ) -> Result<Arc<PublishedSimulation>, EngineError> {
        let key = self.result_prefix(&[video]);
        let scene = self.video(video).await?;
        let frames = options.frames.unwrap_or(scene.times.len() + DEFAULT_FUTURE_FRAMES);
        limits::size(&scene, frames, options.rollouts)?;
        let fitted = self.drawn(video, &scene, source).await?;
        let model = &fitted.fit.scenes.first().ok_or_else(|| EngineError::no_video(video))?.model;
        let edited = limits::edit(model, &options.interventions)?;
        let stills = if options.stills { self.stills(video).await? } else { vec![] };
        let SimulateOptions { interventions, rollouts, seed, .. } = options;
        let request = PredictionRequest { interventions, frames, rollouts, seed };
        let digest = match stills.is_empty() {
            true => result_digest("simulation", &(video, &fitted.id, &request)),
            false => result_digest("simulation", &(video, &fitted.id, &request, &stills)),
        };
        let engine = self.clone();
        let work = move |context| async move {
            metric_names::count_result("simulation", "made");
            let (model, fps) = (fitted.id.clone(), scene.fps);
            let task = SimulationTask { scene, fitted, edited, request, stills };
            let Performed { output: prediction, batch, slot: _slot } = engine.perform(task, context).await?;
            let trace = engine.publish(batch).await?.pop().unwrap_or_default();
            Ok(PublishedSimulation { model, fps, prediction, trace })
        };
        self.simulations.join(format!("{key}{digest}"), video, self.deadline(), work).await.finish().await
    }
}
