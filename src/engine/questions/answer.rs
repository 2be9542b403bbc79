//! Answers. Their traces are durable before they are returned.

use super::asked::AskedQuestion;
use super::parse::WordsOfVideo;
use crate::concepts::{Lexicon, word_probabilities};
use crate::engine::error::EngineError;
use crate::engine::limits;
use crate::engine::metric_names;
use crate::engine::model_source::ModelSource;
use crate::engine::pool::{JobContext, JobKind};
use crate::engine::predictions::SHORT_STATES;
use crate::engine::results::{PublishedAnswer, StoredFit, result_digest};
use crate::engine::state::Engine;
use crate::engine::task::{Performed, ReportSink, Task};
use crate::engine::traces::file::{self, TraceFile};
use crate::num::Stop;
use crate::reason::{
    Answer, AskOptions, FUTURE_FRAMES, KnownOfScene, Question, StoredDiscovery, ask_knowing,
};
use crate::scene::Scene;
use std::sync::Arc;

/// The operation that a discovery answers.
const MISSING_PART: &str = "missing_part";

impl Engine {
    /// Answers a question.
    pub async fn ask(
        self: &Arc<Self>,
        video: &str,
        source: &ModelSource,
        asked: AskedQuestion,
        options: AskOptions,
    ) -> Result<Arc<PublishedAnswer>, EngineError> {
        let key = self.result_prefix(&[video]);
        let scene = self.video(video).await?;
        limits::rollouts(&scene, scene.times.len() + FUTURE_FRAMES, options.rollouts)?;
        let fitted = self.drawn(video, &scene, source).await?;
        let digest = result_digest("question", &(video, &fitted.id, &asked, &options));
        let engine = self.clone();
        let work = move |context| async move { engine.answer(scene, fitted, asked, options, context).await };
        self.answers.join(format!("{key}{digest}"), video, self.deadline(), work).await.finish().await
    }

    async fn answer(
        &self,
        scene: Arc<Scene>,
        fitted: Arc<StoredFit>,
        asked: AskedQuestion,
        options: AskOptions,
        context: JobContext,
    ) -> Result<PublishedAnswer, EngineError> {
        metric_names::count_result("answer", "made");
        let lexicon = match &asked.lexicon {
            Some(id) => Some(self.lexicon(id).await?),
            None => None,
        };
        let mut parser = None;
        let mut question = asked.question.clone();
        if self.parser.is_some() {
            let of = WordsOfVideo { scene: Some(scene.clone()), lexicon: lexicon.clone() };
            let parsed = self.parsed(of, &asked, &context).await?;
            if parsed.parser.is_some() {
                let (program, choices) = (parsed.question.program, parsed.question.choices);
                (question, parser) = (Question::Program { program, choices }, parsed.parser);
            }
        }
        let (model, video) = (fitted.id.clone(), fitted.video.clone());
        let task = AnswerTask { scene, fitted, asked, question, options, lexicon, discovery: None };
        let mut done = self.perform(task.clone(), context.clone()).await?;
        // Such a question simulates nothing, so that it is answered twice sooner than all discoveries are read for each question.
        if done.output.program.iter().any(|token| token == MISSING_PART)
            && let Some(found) = self.discovery_of(&video).await?
        {
            done = self.perform(AnswerTask { discovery: Some(found), ..task }, context).await?;
        }
        let Performed { output: mut answer, batch, slot: _slot } = done;
        if let Some(parser) = &parser {
            answer.explanation += &format!(" The language model {parser} wrote this program.");
        }
        let traces = self.publish(batch).await?;
        Ok(PublishedAnswer { model, answer, traces, parser })
    }
}

/// Answers one question.
#[derive(Clone)]
struct AnswerTask {
    scene: Arc<Scene>,
    fitted: Arc<StoredFit>,
    asked: AskedQuestion,
    /// What was asked, or the program that stands for it.
    question: Question,
    options: AskOptions,
    lexicon: Option<Lexicon>,
    discovery: Option<StoredDiscovery>,
}

impl Task for AnswerTask {
    /// Its simulations without their ensembles.
    type Output = Answer;

    fn kind(&self) -> JobKind {
        let frames = self.scene.times.len() + FUTURE_FRAMES;
        let states = self.options.rollouts * frames * self.scene.objects.len();
        if states > SHORT_STATES { JobKind::Ensemble } else { JobKind::Answer }
    }

    fn perform(self, _: ReportSink, stop: Stop) -> Result<(Answer, Vec<TraceFile>), EngineError> {
        let AnswerTask { scene, fitted, asked, question, options, lexicon, discovery } = self;
        let fit = (&fitted.fit, 0);
        let words = match &lexicon {
            Some(lexicon) => Some(word_probabilities(lexicon, &scene, Some(fit))?),
            None => None,
        };
        let known = KnownOfScene { scene: &scene, words: words.as_ref(), discovery: discovery.as_ref() };
        let mut answer = ask_knowing(known, fit, &question, &asked.conversation, &options, stop)?;
        // A choice is named as it was given, whoever wrote its program.
        if let Question::English { choices, .. } = &asked.question {
            for (judged, given) in answer.choices.iter_mut().zip(choices) {
                judged.choice.clone_from(given);
            }
        }
        let request = serde_json::json!({ "ask": &question, "options": &options }).to_string();
        let mut files = Vec::new();
        for prediction in &mut answer.simulations {
            limits::places(&prediction.model, &prediction.interventions)?;
            limits::finite(prediction)?;
            files.push(file::simulation(&scene, &fitted, prediction, (options.seed, &[]), &request)?);
            prediction.ensemble = vec![];
        }
        Ok((answer, files))
    }
}
