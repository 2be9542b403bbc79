//! Reasoning: predictions, counterfactuals, and answers to questions, all by simulation of the fitted model.
//!
//! `ask` (English or a program) -> `reader` (text to program) -> `language` (type check) -> `predict` (rollouts) -> `events` (what
//! happens) -> `run`, `operations` (the program on each rollout) -> `summary` (one answer with its probability). With a lexicon,
//! `words` are drawn for each rollout.

mod ask;
mod context;
mod describe;
mod discovery;
mod encounters;
mod events;
mod language;
mod operations;
mod predict;
mod reader;
mod run;
mod summary;
#[cfg(test)]
mod tests;
mod types;
mod units;
mod value;
mod words;

pub use ask::{
    Answer, AskOptions, ChoiceAnswer, KnownOfScene, ParsedQuestion, Question, WordedScene, ask, ask_knowing,
    ask_with_words, dry_run, with_best_words,
};
pub use context::{Halt, RolloutContext, active_effects};
pub use discovery::{MissingPart, StoredDiscovery};
pub use encounters::{ENCOUNTER_FEATURES, Encounter, Encounters};
pub use events::{
    FUTURE_FRAMES, MAX_FUTURE_FRAMES, MOVING_SPEED, RolloutEvents, Scenario, SceneEvent, SceneEventKind,
    scenario, simulated,
};
pub use language::{Op, QuestionProgram, WORDS, gbnf_grammar, json_schema, operand_count, read_back};
pub use operations::{OPERATIONS, Operation, OperationInfo, ops};
pub use predict::{CutShort, LikelyEvent, MAX_SIMULATED_FRAMES, Prediction, PredictionRequest, predict};
pub use reader::{
    Conversation, OwnWord, QuestionReading, ReadingContext, can_be_learned, choice_program, examples,
    list_operations, question_program, read_choice, read_question,
};
pub use run::{DerivationStep, step};
pub use summary::estimated_share;
pub use types::{Gives, Type};
pub use units::{MeasureUnit, UNITS};
pub use value::{ProgramValue, SpanKind};
pub use words::{
    ChangeWord, ChangedQuantity, ConceptProbabilities, ConceptTruth, DrawnWords, FamilyProbabilities,
    LexiconWord, LogisticWord, WordDraw, WordFamily, WordOfObject, WordProbabilities, WordUse, logistic,
};

use crate::num::Stopped;
use crate::world::InterventionError;

/// Why a question has no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReasonError {
    #[error(transparent)]
    Intervention(#[from] InterventionError),
    #[error("frames is {frames}; give 1 to {most}")]
    Frames { frames: usize, most: usize },
    #[error(transparent)]
    Stopped(#[from] Stopped),
    #[error("the program has {tokens} tokens; give 1 to {most}")]
    ProgramLength { tokens: usize, most: usize },
    #[error("token {position}, {token}: is not in the vocabulary; the nearest token is {nearest}")]
    UnknownToken { position: usize, token: String, nearest: String },
    #[error("token {position}, {token}: expected {expected}, found {found}")]
    ProgramType { position: usize, token: String, expected: &'static str, found: String },
    #[error("the result of the program is {found}; it must be {expected}")]
    ProgramResult { expected: &'static str, found: String },
    #[error("\"{phrase}\" fits no object; name one of: {}", .candidates.join(", "))]
    NoSuchObject { phrase: String, candidates: Vec<String> },
    #[error("\"{phrase}\" fits {} objects: {}; name one of them", .candidates.len(), .candidates.join(", "))]
    AmbiguousObject { phrase: String, candidates: Vec<String> },
    #[error(
        "the answer needs one event, but the rollouts have {found}; ask about an event that happens once"
    )]
    NoSingleEvent { found: String },
    #[error("not understood: \"{part}\"; the nearest supported form is: {nearest}")]
    NotUnderstood { part: String, nearest: String },
    #[error("\"{word}\" is not a word of the lexicon; it knows {}; learn the word or use one of these", .known.join(", "))]
    UnknownWord { word: String, known: Vec<String> },
    #[error("scene {index} is not in the fit; give an index below {scenes}")]
    NoSuchScene { index: usize, scenes: usize },
}
