//! Predictions, counterfactuals and answers. Their traces are durable before the result is returned.

use super::error::EngineError;
use super::limits;
use super::metric_names;
use super::model_source::ModelSource;
use super::results::{PublishedAnswer, PublishedSimulation, result_digest};
use super::state::Engine;
use super::traces::file;
use crate::concepts::word_probabilities;
use crate::num::Stop;
use crate::reason::{
    AskOptions, FUTURE_FRAMES, Prediction, PredictionRequest, Question, WordedScene, ask, ask_with_words,
    predict,
};
use crate::world::Intervention;
use serde::Serialize;
use std::sync::Arc;

/// Frames after the video in a simulation whose request names none.
pub const DEFAULT_FUTURE_FRAMES: usize = 60;
/// Rollouts of a request that names none.
pub const DEFAULT_ROLLOUTS: usize = 32;

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

impl Engine {
    /// Predicts, or simulates a counterfactual where there are interventions.
    pub async fn simulate(
        self: &Arc<Self>,
        video: &str,
        source: &ModelSource,
        options: SimulateOptions,
    ) -> Result<Arc<PublishedSimulation>, EngineError> {
        let key = self.key("");
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
            let ((prediction, batch), _slot) = {
                let (scene, fitted, backlog) = (scene.clone(), fitted.clone(), engine.backlog.clone());
                let job = move |stop: Stop| {
                    limits::places(&edited, &request.interventions)?;
                    let prediction = predict(&scene, &fitted.fit, 0, &request, stop)?;
                    limits::finite(&prediction)?;
                    let json = serde_json::json!({ "simulate": &request }).to_string();
                    let file =
                        file::simulation(&scene, &fitted, &prediction, (request.seed, &stills), &json)?;
                    Ok((Prediction { ensemble: vec![], ..prediction }, backlog.admit(vec![file], stop)?))
                };
                engine.pool.run(context, job).await?
            };
            let trace = engine.publish(batch).await?.pop().unwrap_or_default();
            Ok(PublishedSimulation { model: fitted.id.clone(), fps: scene.fps, prediction, trace })
        };
        self.simulations.join(format!("{key}{digest}"), video, self.deadline(), work).await.finish().await
    }

    /// Answers a question.
    pub async fn ask(
        self: &Arc<Self>,
        video: &str,
        source: &ModelSource,
        question: Question,
        options: AskOptions,
        lexicon: Option<&str>,
    ) -> Result<Arc<PublishedAnswer>, EngineError> {
        let key = self.key("");
        let scene = self.video(video).await?;
        limits::rollouts(&scene, scene.times.len() + FUTURE_FRAMES, options.rollouts)?;
        let fitted = self.drawn(video, &scene, source).await?;
        let digest = result_digest("question", &(video, &fitted.id, &question, &options, lexicon));
        let (engine, lexicon) = (self.clone(), lexicon.map(str::to_string));
        let work = move |context| async move {
            let lexicon = match lexicon {
                Some(id) => Some(engine.lexicon(&id).await?),
                None => None,
            };
            metric_names::count_result("answer", "made");
            let (model, backlog) = (fitted.id.clone(), engine.backlog.clone());
            let job = move |stop: Stop| {
                let mut answer = match &lexicon {
                    None => ask(&scene, &fitted.fit, 0, &question, &options, stop)?,
                    Some(lexicon) => {
                        let words = word_probabilities(lexicon, &scene, Some((&fitted.fit, 0)))?;
                        let worded = WordedScene { scene: &scene, words: &words };
                        ask_with_words(worded, &fitted.fit, 0, &question, &options, stop)?
                    }
                };
                let request = serde_json::json!({ "ask": &question, "options": &options }).to_string();
                let mut files = Vec::new();
                for prediction in &mut answer.simulations {
                    limits::places(&prediction.model, &prediction.interventions)?;
                    limits::finite(prediction)?;
                    files.push(file::simulation(&scene, &fitted, prediction, (options.seed, &[]), &request)?);
                    prediction.ensemble = vec![];
                }
                Ok((answer, backlog.admit(files, stop)?))
            };
            let ((answer, batch), _slot) = engine.pool.run(context, job).await?;
            let traces = engine.publish(batch).await?;
            Ok(PublishedAnswer { model, answer, traces })
        };
        self.answers.join(format!("{key}{digest}"), video, self.deadline(), work).await.finish().await
    }
}
