//! Turns every error of the house into a gRPC status: the only place that does.

use super::v1;
use crate::engine::EngineError;
use crate::fit::FitError;
use crate::reason::ReasonError;
use crate::scene::Violation;
use crate::store::StoreError;
use std::collections::HashMap;
use std::time::Duration;
use tonic::{Code, Status};
use tonic_types::{ErrorDetails, FieldViolation, StatusExt};

/// Of `ErrorInfo`.
const DOMAIN: &str = "vrdp";
/// How long a refused caller should wait: about one fit.
const RETRY_AFTER: Duration = Duration::from_secs(1);

/// Characters of a message and bytes of its violations: both travel in headers, of which clients take 16 KiB by
/// default; base64 adds a third to the violations, percent-encoding up to eleven bytes to a character.
const MESSAGE_CHARS: usize = 300;
const VIOLATION_BYTES: usize = 8_000;
/// Most violations in one reply, and bytes that each needs beside its texts.
const MAX_VIOLATIONS: usize = 100;
const VIOLATION_OVERHEAD: usize = 8;

/// The status of an error. Retriable: RESOURCE_EXHAUSTED (after its `RetryInfo`) and UNAVAILABLE.
pub fn status(error: EngineError) -> Status {
    let message = short(error.to_string());
    match error {
        EngineError::Invalid(violations) => refused("INVALID", violations),
        EngineError::NotFound { name } => {
            let mut details = info("NOT_FOUND");
            details.set_resource_info("", name, "", "does not exist");
            Status::with_error_details(Code::NotFound, message, details)
        }
        EngineError::Overloaded { .. } => {
            let mut details = info("OVERLOADED");
            details.set_retry_info(Some(RETRY_AFTER));
            Status::with_error_details(Code::ResourceExhausted, message, details)
        }
        EngineError::Cancelled => plain(Code::Cancelled, message, "CANCELLED"),
        EngineError::DeadlineExceeded => plain(Code::DeadlineExceeded, message, "DEADLINE_EXCEEDED"),
        EngineError::Internal { id, .. } => {
            let mut details = info("INTERNAL");
            details.set_request_info(id, "");
            Status::with_error_details(Code::Internal, message, details)
        }
        EngineError::Store(StoreError::VideoGone) => plain(Code::NotFound, message, "NOT_FOUND"),
        EngineError::Store(_) => {
            tracing::error!(message, "storage");
            plain(Code::Unavailable, message, "STORAGE")
        }
        EngineError::Recording(_) => plain(Code::Internal, message, "RECORDING"),
        EngineError::Fit(FitError::Stopped(_)) | EngineError::Reason(ReasonError::Stopped(_)) => {
            plain(Code::Cancelled, message, "CANCELLED")
        }
        EngineError::Fit(FitError::TooLittleData { .. }) => {
            plain(Code::FailedPrecondition, message, "TOO_LITTLE_DATA")
        }
        EngineError::Fit(_) => plain(Code::Internal, message, "FIT"),
        EngineError::Reason(reason) => {
            let path = match &reason {
                ReasonError::Frames { .. } => "frames".to_string(),
                ReasonError::Intervention(_) => "interventions".to_string(),
                ReasonError::UnknownToken { position, .. } | ReasonError::ProgramType { position, .. } => {
                    format!("program.tokens[{position}]")
                }
                ReasonError::ProgramLength { .. } | ReasonError::ProgramResult { .. } => {
                    "program.tokens".to_string()
                }
                _ => "question".to_string(),
            };
            refused(reason_of(&reason), vec![Violation { path, message: reason.to_string() }])
        }
    }
}

/// For `ErrorInfo`: what a program can tell apart.
fn reason_of(error: &ReasonError) -> &'static str {
    match error {
        ReasonError::NoSuchObject { .. } => "NO_SUCH_OBJECT",
        ReasonError::AmbiguousObject { .. } => "AMBIGUOUS_OBJECT",
        ReasonError::NoSingleEvent { .. } => "NO_SINGLE_EVENT",
        ReasonError::NotUnderstood { .. } => "NOT_UNDERSTOOD",
        _ => "INVALID",
    }
}

fn refused(reason: &str, mut violations: Vec<Violation>) -> Status {
    if violations.len() > MAX_VIOLATIONS + 1 {
        violations.truncate(MAX_VIOLATIONS);
        let message = "there is more; correct these first".to_string();
        violations.push(Violation { path: "...".into(), message });
    }
    let message = match violations.as_slice() {
        [only] => format!("{}: {}", only.path, only.message),
        [first, others @ ..] => format!("{}: {} (and {} more)", first.path, first.message, others.len()),
        [] => "the request is not valid".to_string(),
    };
    // Every path is told; where there are many, their descriptions are cut.
    let paths: usize = violations.iter().map(|v| v.path.len() + VIOLATION_OVERHEAD).sum();
    let each = VIOLATION_BYTES.saturating_sub(paths) / violations.len().max(1);
    let fields: Vec<FieldViolation> =
        violations.into_iter().map(|v| FieldViolation::new(v.path, cut(&v.message, each))).collect();
    let mut details = info(reason);
    details.set_bad_request(fields);
    Status::with_error_details(Code::InvalidArgument, short(message), details)
}

/// The beginning of a text, at most that many bytes.
fn cut(text: &str, bytes: usize) -> &str {
    (0..=bytes).rev().find_map(|end| text.get(..end.min(text.len()))).unwrap_or_default()
}

fn short(mut message: String) -> String {
    if let Some((at, _)) = message.char_indices().nth(MESSAGE_CHARS) {
        message.truncate(at);
        message.push_str("...");
    }
    message
}

fn plain(code: Code, message: String, reason: &str) -> Status {
    Status::with_error_details(code, message, info(reason))
}

fn info(reason: &str) -> ErrorDetails {
    ErrorDetails::with_error_info(reason, DOMAIN, HashMap::new())
}

/// The same as a message, for one question of a stream.
pub fn error(error: EngineError) -> v1::Error {
    let status = status(error);
    let details = status.get_error_details();
    let violations = details.bad_request().map(|b| b.field_violations.clone()).unwrap_or_default();
    v1::Error {
        code: status.code() as i32,
        message: status.message().to_string(),
        violations: violations
            .into_iter()
            .map(|v| v1::FieldViolation { field: v.field, description: v.description })
            .collect(),
    }
}
