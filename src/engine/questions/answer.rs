//! Answers. Their traces are durable before they are returned.

use super::asked::AskedQuestion;
use super::parse::WordsOfVideo;
use crate::concepts::{Lexicon, word_probabilities};
use crate::engine::error::EngineError;
use crate::engine::limits;
use crate::engine::metric_names;
use crate::engine::model_source::ModelSource;
use crate::engine::pool::JobContext;
use crate::engine::results::{PublishedAnswer, StoredFit, result_digest};
use crate::engine::state::Engine;
use crate::engine::traces::file;
use crate::num::Stop;
use crate::reason::{Answer, AskOptions, FUTURE_FRAMES, Question, ask_in};
use crate::scene::Scene;
use std::sync::Arc;

impl Engine {
    /// Answers a question.
    pub async fn ask(
        self: &Arc<Self>,
        video: &str,
        source: &ModelSource,
        asked: AskedQuestion,
        options: AskOptions,
    ) -> Result<Arc<PublishedAnswer>, EngineError> {
        let key = self.key("");
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
        let (model, backlog) = (fitted.id.clone(), self.backlog.clone());
        let job = move |stop: Stop| {
            let mut answer =
                answer(&scene, (&fitted, lexicon.as_ref()), (&asked, &question), &options, stop)?;
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
        let ((mut answer, batch), _slot) = self.pool.run(context, job).await?;
        if let Some(parser) = &parser {
            answer.explanation += &format!(" The language model {parser} wrote this program.");
        }
        let traces = self.publish(batch).await?;
        Ok(PublishedAnswer { model, answer, traces, parser })
    }
}

/// The answer to `question`, which is what was asked or the program that stands for it.
fn answer(
    scene: &Scene,
    (fitted, lexicon): (&StoredFit, Option<&Lexicon>),
    (asked, question): (&AskedQuestion, &Question),
    options: &AskOptions,
    stop: Stop,
) -> Result<Answer, EngineError> {
    let fit = (&fitted.fit, 0);
    let words = lexicon.map(|lexicon| word_probabilities(lexicon, scene, Some(fit))).transpose()?;
    let mut answer = ask_in((scene, words.as_ref()), fit, question, &asked.conversation, options, stop)?;
    // A choice is named as it was given, whoever wrote its program.
    if let Question::English { choices, .. } = &asked.question {
        for (judged, given) in answer.choices.iter_mut().zip(choices) {
            judged.choice.clone_from(given);
        }
    }
    Ok(answer)
}
