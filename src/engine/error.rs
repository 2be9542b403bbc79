//! The engine's errors, and how the errors of the rooms below become one of them.

use crate::concepts::ConceptError;
use crate::fit::FitError;
use crate::num::Stopped;
use crate::reason::ReasonError;
use crate::recording::RecordingError;
use crate::scene::Violation;
use crate::store::StoreError;

#[derive(Debug, Clone, thiserror::Error)]
pub enum EngineError {
    #[error("the request is not valid")]
    Invalid(Vec<Violation>),
    #[error("{name} does not exist")]
    NotFound { name: String },
    #[error("the queue is full ({capacity} jobs); try again later")]
    Overloaded { capacity: usize },
    #[error(
        "you hold {share} of {capacity} places, which is your share; wait until some of your calls end, then try again"
    )]
    ShareFull { share: usize, capacity: usize },
    #[error("cancelled by the caller")]
    Cancelled,
    #[error("the deadline passed before the work was done")]
    DeadlineExceeded,
    #[error(transparent)]
    Store(StoreError),
    #[error("internal error {id}")]
    Internal { id: String, message: String },
    #[error(transparent)]
    Fit(FitError),
    #[error(transparent)]
    Reason(ReasonError),
    #[error(transparent)]
    Concept(ConceptError),
    #[error(
        "not understood, and the language model {model} did not help: {problem}; ask in other words, or give a program"
    )]
    NotParsed { model: String, problem: String },
    #[error(
        "object {object} has no finite state at frame {frame}: the numbers overflow; ask for fewer frames, smaller \
         changes or another model"
    )]
    NotFinite { object: u32, frame: usize },
    #[error("the trace cannot be written: {0}")]
    Recording(String),
    #[error(
        "the file of trace {id} is damaged ({what}): restore it from a copy, or request its simulation again, which \
         rewrites the file"
    )]
    Damaged { id: String, what: String },
}

impl EngineError {
    /// One violation: the dotted path of a field, and what is wrong with its value.
    pub fn invalid(path: impl Into<String>, message: impl Into<String>) -> Self {
        EngineError::Invalid(vec![Violation { path: path.into(), message: message.into() }])
    }

    pub(super) fn no_video(id: &str) -> Self {
        EngineError::NotFound { name: format!("videos/{id}") }
    }

    /// Why what belongs to a video was not stored.
    pub(super) fn of_video(id: &str, error: StoreError) -> Self {
        match error {
            StoreError::VideoGone => EngineError::no_video(id),
            other => other.into(),
        }
    }

    /// Whether the work ended because its stop token said so.
    pub(super) fn is_stopped(&self) -> bool {
        matches!(
            self,
            EngineError::Fit(FitError::Stopped(_))
                | EngineError::Reason(ReasonError::Stopped(_))
                | EngineError::Concept(ConceptError::Stopped(_))
        )
    }
}

impl From<FitError> for EngineError {
    fn from(error: FitError) -> Self {
        EngineError::Fit(error)
    }
}

impl From<Stopped> for EngineError {
    fn from(stopped: Stopped) -> Self {
        EngineError::Fit(FitError::Stopped(stopped))
    }
}

impl From<ReasonError> for EngineError {
    fn from(error: ReasonError) -> Self {
        EngineError::Reason(error)
    }
}

impl From<ConceptError> for EngineError {
    fn from(error: ConceptError) -> Self {
        match error {
            // The same refusal, whether a lexicon is used or not.
            ConceptError::Reason(reason) => EngineError::Reason(reason),
            other => EngineError::Concept(other),
        }
    }
}

impl From<StoreError> for EngineError {
    fn from(error: StoreError) -> Self {
        EngineError::Store(error)
    }
}

impl From<RecordingError> for EngineError {
    fn from(error: RecordingError) -> Self {
        EngineError::Recording(error.to_string())
    }
}
