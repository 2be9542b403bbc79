//! Why words cannot be learned or used.

use crate::fit::FitError;
use crate::num::Stopped;
use crate::reason::ReasonError;

/// Which example it is: of those that fit the word, or of those that do not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ExampleNumber {
    pub fits: bool,
    pub index: usize,
}

impl ExampleNumber {
    /// Example `index` of `yes` that fit, followed by those that do not.
    pub fn of(index: usize, yes: usize) -> ExampleNumber {
        match index.checked_sub(yes) {
            None => ExampleNumber { fits: true, index },
            Some(index) => ExampleNumber { fits: false, index },
        }
    }
}

impl std::fmt::Display for ExampleNumber {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "examples.{}[{}]", if self.fits { "yes" } else { "no" }, self.index)
    }
}

/// Why a lexicon is refused, or cannot be learned.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConceptError {
    #[error("{video} has no features of its objects; perceive the video, or give `features` for each object")]
    NoFeatures { video: String },
    #[error(
        "{video} has features of layout {found}, but {expected} was expected; use one layout, or learn the lexicon again from videos of this layout"
    )]
    Layout { video: String, found: String, expected: String },
    #[error(
        "the lexicon has version {found}, this program reads {expected}; learn it again with this program"
    )]
    Version { found: u32, expected: u32 },
    #[error("the lexicon lacks some of its numbers; take its whole content, or learn it again")]
    Incomplete,
    #[error("the lexicon cannot be used: {problem}; learn it again with other words")]
    UnusableWord { problem: String },
    #[error("questions is empty; give questions with their answers")]
    NoQuestions,
    #[error("videos[{video}].questions[{question}]: {source}")]
    Question { video: usize, question: usize, source: ReasonError },
    #[error("videos[{video}].questions[{question}].answer is \"{answer}\"; give {expected}")]
    Answer { video: usize, question: usize, answer: String, expected: String },
    #[error("\"{name}\" is no word of the lexicon; it knows {}; learn it or use one of these", .known.join(", "))]
    UnknownWord { name: String, known: Vec<String> },
    #[error("\"{name}\" is known already, as {kind}; take another name, or write a new lexicon")]
    KnownWord { name: String, kind: &'static str },
    #[error("\"{name}\" cannot name a word, as questions use it for something else; take another name")]
    ReservedWord { name: String },
    #[error("{yes} fit \"{name}\" and {no} do not; give at least 2 of each")]
    TooFewExamples { name: String, yes: usize, no: usize },
    #[error("examples of \"{name}\" contradict each other: {}; they look alike, but one fits and the other does not", .pairs.join("; "))]
    Contradiction { name: String, pairs: Vec<String> },
    #[error(
        "nothing that is measured separates the examples of \"{name}\"; {nearest}; give clearer examples, or more"
    )]
    NotSeparable { name: String, nearest: String },
    #[error("is of object {object}, but the scene has {objects}")]
    NoSuchObject { example: ExampleNumber, object: usize, objects: usize },
    #[error("has no fit, which says how objects meet; fit its video")]
    NoFit { example: ExampleNumber },
    #[error("the objects {} and {} neither collide nor come near each other; take two that do", .objects[0], .objects[1])]
    NoEncounter { example: ExampleNumber, objects: [u32; 2] },
    #[error("the second video {problem}; both must show the same set-up and objects, with the same ids")]
    OtherObjects { example: ExampleNumber, problem: String },
    #[error("examples of \"{name}\" contradict each other: {}", .pairs.join("; "))]
    ContradictoryChanges { name: String, pairs: Vec<String> },
    #[error("examples: {0}")]
    Fit(FitError),
    #[error(
        "nothing says how large \"{name}\" is: every factor from {least:.3} to {most:.3} explains what is given; give more questions or examples"
    )]
    Undetermined { name: String, least: f64, most: f64 },
    #[error(
        "the factor that {what} shows is not between {least:.3} and {most:.3}, where factors are sought; give examples of a smaller change"
    )]
    FactorBeyond { what: String, least: f64, most: f64 },
    #[error(
        "the model does not follow the {which} video (reduced chi-square {chi_square:.0}), so it says nothing of a factor; see that only this object is changed, and that a model follows both videos"
    )]
    NotFollowed { example: ExampleNumber, which: &'static str, chi_square: f64 },
    #[error(transparent)]
    Stopped(#[from] Stopped),
    #[error(transparent)]
    Reason(#[from] ReasonError),
}

impl ConceptError {
    /// The example that is wrong, if it is one.
    pub fn example(&self) -> Option<ExampleNumber> {
        match self {
            ConceptError::NoSuchObject { example, .. }
            | ConceptError::NoFit { example }
            | ConceptError::NoEncounter { example, .. }
            | ConceptError::OtherObjects { example, .. }
            | ConceptError::NotFollowed { example, .. } => Some(*example),
            _ => None,
        }
    }
}
