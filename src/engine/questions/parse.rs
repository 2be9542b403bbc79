//! Questions to programs, without a fit or a simulation.

use super::asked::AskedQuestion;
use crate::concepts::{Lexicon, word_probabilities};
use crate::engine::error::EngineError;
use crate::engine::pool::{JobContext, JobKind};
use crate::engine::state::Engine;
use crate::num::Stop;
use crate::reason::{
    ParsedQuestion, Question, ReasonError, dry_run, read_choice, read_question, with_best_words,
};
use crate::scene::Scene;
use std::sync::Arc;

/// How a question is understood, and the name of the language model that wrote its program, if one did.
#[derive(Debug, Clone, PartialEq)]
pub struct Parsed {
    pub question: ParsedQuestion,
    pub parser: Option<String>,
}

/// What the words of a question may name.
pub(super) struct WordsOfVideo {
    pub scene: Option<Arc<Scene>>,
    pub lexicon: Option<Lexicon>,
}

impl Engine {
    /// How a question is understood. With a video its objects are resolved.
    pub async fn parse_question(
        &self,
        video: Option<&str>,
        asked: &AskedQuestion,
    ) -> Result<Parsed, EngineError> {
        let scene = match video {
            Some(video) => Some(self.video(video).await?),
            None => None,
        };
        let lexicon = match &asked.lexicon {
            Some(id) => Some(self.lexicon(id).await?),
            None => None,
        };
        self.parsed(WordsOfVideo { scene, lexicon }, asked, &self.uncancelled()).await
    }

    /// Reads a question; what our reader does not understand is asked of the language model, if the service has one.
    pub(super) async fn parsed(
        &self,
        of: WordsOfVideo,
        asked: &AskedQuestion,
        context: &JobContext,
    ) -> Result<Parsed, EngineError> {
        let (named, of) = (asked.clone(), Arc::new(of));
        let words = of.clone();
        let read = move |_: Stop| -> Result<Result<ParsedQuestion, ReasonError>, EngineError> {
            let (scene, vocabulary) = words.scene_and_vocabulary()?;
            Ok(dry_run(scene.as_ref(), &named.question, &named.conversation, &vocabulary))
        };
        let (read, _slot) = self.pool.run((&self.tenant, JobKind::Parsing), context.clone(), read).await?;
        match (read, &asked.question, self.parser.clone()) {
            (Ok(question), ..) => Ok(Parsed { question, parser: None }),
            (Err(ReasonError::NotUnderstood { .. }), Question::English { .. }, Some(parser)) => {
                let program = self.written(&of, asked, context).await?;
                let (scene, vocabulary) = of.scene_and_vocabulary()?;
                let question = dry_run(scene.as_ref(), &program, &asked.conversation, &vocabulary)
                    .map_err(|error| parser.refused(error.to_string()))?;
                Ok(Parsed { question, parser: Some(parser.model().to_string()) })
            }
            (Err(error), ..) => Err(error.into()),
        }
    }

    /// The question as programs: those of our reader where it understands a text, else the language model's.
    async fn written(
        &self,
        of: &WordsOfVideo,
        asked: &AskedQuestion,
        context: &JobContext,
    ) -> Result<Question, EngineError> {
        let (Question::English { question, choices }, Some(parser)) = (&asked.question, &self.parser) else {
            return Ok(asked.question.clone());
        };
        let (scene, vocabulary) = of.scene_and_vocabulary()?;
        let (scene, conversation) = (scene.as_ref(), &asked.conversation);
        let about = parser.about(scene, &vocabulary, conversation);
        let read = read_question(question, scene, conversation);
        let program = match read {
            Err(ReasonError::NotUnderstood { .. }) => parser.program(&about, question, None, context).await?,
            read => read?.program,
        };
        let observed = program.iter().any(|token| token == "filter_ancestor");
        let mut programs = vec![];
        for choice in choices {
            programs.push(match read_choice(choice, observed, scene, conversation) {
                Err(ReasonError::NotUnderstood { .. }) => {
                    parser.program(&about, choice, Some(&program), context).await?
                }
                read => read?.program,
            });
        }
        Ok(Question::Program { program, choices: programs })
    }
}

impl WordsOfVideo {
    /// The scene, its objects with their most probable words, and the words of the lexicon.
    fn scene_and_vocabulary(&self) -> Result<(Option<Scene>, Vec<String>), EngineError> {
        let Some(lexicon) = &self.lexicon else {
            return Ok((self.scene.as_deref().cloned(), vec![]));
        };
        let Some(scene) = &self.scene else { return Ok((None, lexicon.names())) };
        let words = word_probabilities(lexicon, scene, None)?;
        Ok((Some(with_best_words(scene, &words)), words.vocabulary()))
    }
}
