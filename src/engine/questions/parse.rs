//! Questions to programs, without a fit or a simulation.

use super::asked::AskedQuestion;
use crate::concepts::{Lexicon, word_probabilities};
use crate::engine::error::EngineError;
use crate::engine::pool::{JobContext, JobKind};
use crate::engine::state::Engine;
use crate::num::Stop;
use crate::reason::{
    LexiconWord, ParsedQuestion, Question, ReadingContext, ReasonError, dry_run, read_choice, read_question,
    with_best_words,
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
            let scene = words.worded_scene()?;
            Ok(dry_run(scene.as_ref(), &named.question, &named.conversation, &words.uses()))
        };
        let (read, _slot) = self.pool.run((&self.tenant, JobKind::Parsing), context.clone(), read).await?;
        match (read, &asked.question, self.parser.clone()) {
            (Ok(question), ..) => Ok(Parsed { question, parser: None }),
            (Err(ReasonError::NotUnderstood { .. }), Question::English { .. }, Some(parser)) => {
                let program = self.written(&of, asked, context).await?;
                let scene = of.worded_scene()?;
                let question = dry_run(scene.as_ref(), &program, &asked.conversation, &of.uses())
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
        let (scene, lexicon, conversation) = (of.worded_scene()?, of.uses(), &asked.conversation);
        let read_in = ReadingContext { scene: scene.as_ref(), lexicon: &lexicon };
        let about = parser.about(scene.as_ref(), &lexicon, conversation);
        let program = match read_question(question, read_in, conversation) {
            Err(ReasonError::NotUnderstood { .. }) => parser.program(&about, question, None, context).await?,
            read => read?.program,
        };
        let observed = program.iter().any(|token| token == "filter_ancestor");
        let mut programs = vec![];
        for choice in choices {
            programs.push(match read_choice(choice, observed, read_in, conversation) {
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
    /// The scene, its objects with their most probable words of the lexicon.
    fn worded_scene(&self) -> Result<Option<Scene>, EngineError> {
        match (&self.scene, &self.lexicon) {
            (Some(scene), Some(lexicon)) => {
                Ok(Some(with_best_words(scene, &word_probabilities(lexicon, scene, None)?)))
            }
            (scene, _) => Ok(scene.as_deref().cloned()),
        }
    }

    /// The words of the lexicon.
    fn uses(&self) -> Vec<LexiconWord> {
        self.lexicon.as_ref().map_or(vec![], Lexicon::uses)
    }
}
