//! English to programs: reads a question by the table of forms, whatever its wording. What is not understood is refused with the
//! nearest question that is, about objects of the scene; nothing is guessed.
//!
//! | file | holds |
//! |---|---|
//! | `words.txt`, `lexicon` | the canonical word of each word; spelling |
//! | `forms`, `chart` | the words of each phrase with its program; the parser |
//! | `conversation` | "it", "the other one", "and when?" by the questions before |
//! | `examples.txt`, `choices.txt`, `suggest` | questions to suggest |

mod chart;
mod conversation;
mod forms;
mod lexicon;
mod suggest;

pub use conversation::Conversation;
pub use lexicon::{OwnWord, can_be_learned};
pub use suggest::examples;

use super::ReasonError;
use super::language::{QuestionProgram, read_back};
use super::operations::{self, OperationInfo};
use super::words::{LexiconWord, spellings};
use crate::scene::Scene;
use chart::QuestionReader;
use conversation::{follow_up, with_pronouns};
use lexicon::{TextWord, Vocabulary};

/// A question as a program, and the program in English.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct QuestionReading {
    pub program: Vec<String>,
    pub reading: String,
}

impl QuestionReading {
    /// Whether it asks for the causes of an event of the video.
    pub fn is_explanatory(&self) -> bool {
        self.program.iter().any(|t| t == "filter_ancestor")
    }
}

/// The program of a question that stands alone.
pub fn question_program(text: &str) -> Result<Vec<String>, ReasonError> {
    read_question(text, ReadingContext::default(), &Conversation::default()).map(|read| read.program)
}

/// The program of a choice. `observed`: the question is explanatory, about events of the video.
pub fn choice_program(text: &str, observed: bool) -> Result<Vec<String>, ReasonError> {
    read_choice(text, observed, ReadingContext::default(), &Conversation::default()).map(|read| read.program)
}

/// What a text is about: the scene, and the words of a lexicon.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReadingContext<'a> {
    pub scene: Option<&'a Scene>,
    pub lexicon: &'a [LexiconWord],
}

/// Reads a question, after other questions.
pub fn read_question(
    text: &str,
    about: ReadingContext,
    conversation: &Conversation,
) -> Result<QuestionReading, ReasonError> {
    read("question", text, "events", about, conversation)
}

/// Reads a choice. `observed`: the question is explanatory, about events of the video.
pub fn read_choice(
    text: &str,
    observed: bool,
    about: ReadingContext,
    conversation: &Conversation,
) -> Result<QuestionReading, ReasonError> {
    read("choice", text, if observed { "events" } else { "all_events" }, about, conversation)
}

/// All operations with an example of those that a question of the reader uses.
pub fn list_operations() -> Vec<OperationInfo> {
    let programs: Vec<Vec<String>> = examples()
        .iter()
        .filter_map(|text| question_program(text).or_else(|_| choice_program(text, false)).ok())
        .collect();
    operations::list_operations(&programs)
}

fn read(
    phrase: &'static str,
    text: &str,
    source: &'static str,
    about: ReadingContext,
    conversation: &Conversation,
) -> Result<QuestionReading, ReasonError> {
    let scene = about.scene;
    let vocabulary = Vocabulary::new(scene, &conversation.words, about.lexicon);
    let mut words = vocabulary.read(text);
    if phrase == "question" {
        let program_of = |text: &str, before: &Conversation| Ok(read_question(text, about, before)?.program);
        if let Some(tokens) = follow_up(&words, &vocabulary, conversation, &program_of)? {
            return Ok(with_reading(tokens, &words, about.lexicon));
        }
        words = without_opening(words);
    }
    let mut programs: Vec<(String, Vec<String>)> = vec![];
    let mut furthest = 0;
    for (meant, words) in with_pronouns(&words, &vocabulary, scene, conversation)? {
        let mut reader = QuestionReader::new(&words, &vocabulary);
        if let Some(tokens) = reader.whole(phrase).into_iter().next() {
            let tokens: Vec<String> =
                tokens.into_iter().map(|t| if t == "@events" { source.to_string() } else { t }).collect();
            if !programs.iter().any(|(_, known)| *known == tokens) {
                programs.push((meant, tokens));
            }
        }
        furthest = furthest.max(reader.furthest);
    }
    match &programs[..] {
        [(_, tokens)] => Ok(with_reading(tokens.clone(), &words, about.lexicon)),
        [] => Err(suggest::not_understood(phrase, &words, furthest, &vocabulary, scene)),
        several => {
            let candidates = several.iter().map(|(meant, _)| meant.clone()).collect();
            Err(ReasonError::AmbiguousObject { phrase: "it".to_string(), candidates })
        }
    }
}

/// "And", "but" and "so" before a question say nothing.
fn without_opening(mut words: Vec<TextWord>) -> Vec<TextWord> {
    while words.first().is_some_and(|w| ["and", "but"].contains(&w.text.as_str())) {
        words.remove(0);
    }
    words
}

/// A program with what it was read as, corrected spellings included.
fn with_reading(program: Vec<String>, words: &[TextWord], lexicon: &[LexiconWord]) -> QuestionReading {
    let known = spellings(lexicon);
    let mut reading =
        QuestionProgram::parse_with(&program, &known).map(|p| read_back(&p)).unwrap_or_default();
    let corrected =
        words.iter().filter_map(|w| Some(format!("\"{}\" as \"{}\"", w.text, w.corrected.as_ref()?)));
    let corrected: Vec<String> = corrected.collect();
    if !corrected.is_empty() {
        reading += &format!(" ({})", corrected.join(", "));
    }
    QuestionReading { program, reading }
}
