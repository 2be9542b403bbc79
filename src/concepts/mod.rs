//! Words learned from questions and answers, and from a few examples.
//!
//! | file | job |
//! |---|---|
//! | `features` | numbers of an object's looks and motion, with a version |
//! | `tape`, `soft`, `soft_value` | derivatives; programs with uncertain words |
//! | `lessons`, `observed` | questions with answers, read; events of a video without a fit |
//! | `training` | the words of families, learned from lessons |
//! | `lexicon`, `moderated` | what was learned; P(word) for a scene |
//! | `few_examples`, `logistic` | a new word from examples |
//! | `change` | the factor that a change stands for, from answers or from examples |
//! | `describe` | what a word looks at, its neighbours, its figures |
//!
//! `learn` or `learn_word` -> `Lexicon` -> `word_probabilities` -> `reason::ask_with_words`.

mod change;
mod describe;
mod error;
mod features;
mod few_examples;
mod lessons;
mod lexicon;
mod logistic;
mod moderated;
mod observed;
mod soft;
mod soft_value;
mod tape;
#[cfg(test)]
mod tests;
mod training;

pub use change::{ChangeExample, ChangeOptions, learn_change, learn_change_from_examples};
pub use describe::{WordDescription, describe};
pub use error::{ConceptError, ExampleNumber};
pub use features::{APPEARANCE, FEATURES_VERSION, FeatureLayout, MOTION};
pub use few_examples::{Example, ExampleOf, learn_word};
pub use lessons::{Lesson, LessonAnswer, LessonVideo};
pub use lexicon::{
    CalibrationBin, LEXICON_VERSION, LONGEST_NAME, LearnedFamily, LearnedWord, Lexicon, Meaning,
    WordCalibration, WordKind, word_probabilities,
};
pub use observed::observed_scenario;
pub use training::{LearnOptions, LearnProgress, learn};
