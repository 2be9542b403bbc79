//! Turns each engine error into a gRPC status; no other file does.

use super::v1;
use crate::concepts::ConceptError;
use crate::engine::EngineError;
use crate::fit::FitError;
use crate::reason::ReasonError;
use crate::scene::Violation;
use crate::store::StoreError;
use http::HeaderMap;
use std::collections::HashMap;
use std::time::Duration;
use tonic::metadata::MetadataValue;
use tonic::{Code, Status};
use tonic_types::{ErrorDetails, FieldViolation, StatusExt};

/// Of `ErrorInfo`.
const DOMAIN: &str = "vrdp";
/// The field that retrying clients read: milliseconds, or -1 for never.
const PUSHBACK: &str = "grpc-retry-pushback-ms";
/// How long a refused caller should wait: about the duration of one fit.
const RETRY_AFTER: Duration = Duration::from_secs(1);

/// Bytes of a message, percent-encoded, and of its violations. Both are sent in headers, of which C-core clients (Python)
/// accept 8 KiB; the details repeat the message and grow by a third in base64.
const MESSAGE_BYTES: usize = 900;
const VIOLATION_BYTES: usize = 3_600;
/// Bytes of one description, and of each violation beside its texts.
const DESCRIPTION_BYTES: usize = 400;
const VIOLATION_OVERHEAD: usize = 8;

const RECORDING_FAILED: &str =
    "the trace cannot be written (the log of the service says why); ask for fewer frames or rollouts";

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
        EngineError::Overloaded { .. } => busy(message, "OVERLOADED"),
        EngineError::ShareFull { .. } => busy(message, "SHARE_FULL"),
        EngineError::Cancelled => plain(Code::Cancelled, message, "CANCELLED"),
        EngineError::DeadlineExceeded => plain(Code::DeadlineExceeded, message, "DEADLINE_EXCEEDED"),
        EngineError::Internal { id, .. } => {
            let mut details = info("INTERNAL");
            details.set_request_info(id, "");
            Status::with_error_details(Code::Internal, message, details)
        }
        EngineError::Store(error) => storage(&error, message),
        EngineError::NotFinite { .. } => plain(Code::OutOfRange, message, "NOT_FINITE"),
        EngineError::Recording(_) => {
            tracing::error!(message, "a trace cannot be written");
            plain(Code::Internal, RECORDING_FAILED.into(), "RECORDING")
        }
        EngineError::Damaged { .. } => plain(Code::DataLoss, message, "TRACE_DAMAGED"),
        EngineError::Fit(FitError::Stopped(_))
        | EngineError::Reason(ReasonError::Stopped(_))
        | EngineError::Concept(ConceptError::Stopped(_)) => plain(Code::Cancelled, message, "CANCELLED"),
        EngineError::Concept(concept) => word_refusal(&concept, message),
        EngineError::Fit(FitError::TooLittleData { .. }) => {
            plain(Code::FailedPrecondition, message, "TOO_LITTLE_DATA")
        }
        EngineError::Fit(FitError::FormulaUndefined { .. }) => {
            refused("UNDEFINED", vec![Violation { path: "formula".into(), message }])
        }
        EngineError::Fit(_) => plain(Code::Internal, message, "FIT"),
        EngineError::NotParsed { .. } => {
            refused("NOT_UNDERSTOOD", vec![Violation { path: "question".into(), message }])
        }
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

/// The status of an error of the data folder. What is damaged or not allowed does not pass by itself.
fn storage(error: &StoreError, message: String) -> Status {
    match error {
        StoreError::VideoGone | StoreError::FileGone { .. } => plain(Code::NotFound, message, "NOT_FOUND"),
        StoreError::Damaged { .. } => plain(Code::DataLoss, message, "RECORD_DAMAGED"),
        StoreError::Quota { kind, needed_bytes, limit_bytes } => {
            let about = [
                ("kind", kind.to_string()),
                ("needed_bytes", needed_bytes.to_string()),
                ("limit_bytes", limit_bytes.to_string()),
            ];
            let about: HashMap<String, String> =
                about.into_iter().map(|(name, value)| (name.to_string(), value)).collect();
            let details = ErrorDetails::with_error_info("QUOTA", DOMAIN, about);
            // Only a deletion helps.
            never_again(Status::with_error_details(Code::ResourceExhausted, message, details))
        }
        StoreError::Full => {
            tracing::error!("the disk of the data folder is full");
            plain(Code::Unavailable, message, "STORAGE_FULL")
        }
        // Its cause names no path.
        StoreError::Failed(_) => {
            tracing::error!(message, "storage failed");
            plain(Code::Unavailable, message, "STORAGE")
        }
        StoreError::Locked { .. }
        | StoreError::Newer { .. }
        | StoreError::Unusable { .. }
        | StoreError::DatabaseGone { .. } => {
            tracing::error!(message, "the data folder cannot be used");
            let advice = "the data folder of the service cannot be used; its log says why";
            plain(Code::Unavailable, advice.into(), "STORAGE")
        }
    }
}

/// The refusal of words: of the request's field that is wrong, or of the videos or the lexicon that do not fit.
fn word_refusal(error: &ConceptError, message: String) -> Status {
    let (path, reason) = match error {
        ConceptError::NoFeatures { .. } => return plain(Code::FailedPrecondition, message, "NO_FEATURES"),
        ConceptError::Layout { .. } => return plain(Code::FailedPrecondition, message, "OTHER_FEATURES"),
        ConceptError::Version { .. } => return plain(Code::FailedPrecondition, message, "OTHER_VERSION"),
        ConceptError::UnknownWord { .. } => return plain(Code::NotFound, message, "UNKNOWN_WORD"),
        ConceptError::Undetermined { .. } | ConceptError::FactorBeyond { .. } => {
            return plain(Code::FailedPrecondition, message, "UNDETERMINED");
        }
        ConceptError::Incomplete => ("content", "INCOMPLETE"),
        ConceptError::UnusableWord { .. } => ("content", "UNUSABLE_WORD"),
        ConceptError::KnownWord { .. } => ("name", "KNOWN_WORD"),
        ConceptError::ReservedWord { .. } => ("name", "RESERVED_WORD"),
        ConceptError::TooFewExamples { .. } => ("examples", "TOO_FEW_EXAMPLES"),
        ConceptError::Contradiction { .. } | ConceptError::ContradictoryChanges { .. } => {
            ("examples", "CONTRADICTION")
        }
        ConceptError::NotSeparable { .. } => ("examples", "NOT_SEPARABLE"),
        ConceptError::NoEncounter { .. } => ("examples", "NO_ENCOUNTER"),
        ConceptError::NoSuchObject { .. }
        | ConceptError::NoFit { .. }
        | ConceptError::OtherObjects { .. }
        | ConceptError::NotFollowed { .. }
        | ConceptError::Fit(_) => ("examples", "INVALID"),
        _ => ("lessons", "INVALID"),
    };
    let path = error.example().map_or(path.to_string(), |example| example.to_string());
    refused(reason, vec![Violation { path, message }])
}

/// A refusal for want of room: the same request may succeed later.
pub fn busy(message: String, reason: &str) -> Status {
    let mut details = info(reason);
    details.set_retry_info(Some(RETRY_AFTER));
    let mut status = Status::with_error_details(Code::ResourceExhausted, short(message), details);
    // Clients that retry by themselves read this field, not the details.
    let wait = MetadataValue::from(RETRY_AFTER.as_millis() as u64);
    status.metadata_mut().insert(PUSHBACK, wait);
    status
}

/// The refusal of a message that is larger than allowed. RESOURCE_EXHAUSTED is what gRPC's own libraries return; clients that
/// retry by themselves are asked not to.
pub fn too_large(message: String) -> Status {
    never_again(plain(Code::ResourceExhausted, short(message), "TOO_LARGE"))
}

/// The same status, after which clients that retry by themselves do not.
fn never_again(mut status: Status) -> Status {
    status.metadata_mut().insert(PUSHBACK, MetadataValue::from(-1));
    status
}

/// The refusal of bytes that are no message.
pub fn malformed(problem: &str) -> Status {
    let message = format!(
        "cannot be read ({problem}); send it as proto/vrdp/v1 describes it, in Protobuf's binary form"
    );
    refused("MALFORMED", vec![Violation { path: "message".into(), message }])
}

/// Replaces a status that the transport made without knowing what is ours: it blames the service for bytes of the caller, and
/// gives a size that is too large a code that no other gRPC library uses.
pub fn clarify(fields: &mut HeaderMap) {
    if fields.contains_key(Status::GRPC_STATUS_DETAILS) {
        return;
    }
    let code = fields.get(Status::GRPC_STATUS).map(|code| Code::from_bytes(code.as_bytes()));
    if !matches!(code, Some(Code::Internal | Code::OutOfRange)) {
        return;
    }
    let Some(found) = Status::from_header_map(fields) else { return };
    let clear = match found.code() {
        Code::Internal => malformed(found.message()),
        _ => too_large(format!("{}; ask for less, such as fewer frames or a smaller page", found.message())),
    };
    for name in [Status::GRPC_STATUS, Status::GRPC_MESSAGE] {
        fields.remove(name);
    }
    // If it cannot be encoded, the client sees a reply without a status, which is an error too.
    let _ = clear.add_header(fields);
}

/// The reason in `ErrorInfo`, by which a program distinguishes errors.
fn reason_of(error: &ReasonError) -> &'static str {
    match error {
        ReasonError::NoSuchObject { .. } => "NO_SUCH_OBJECT",
        ReasonError::AmbiguousObject { .. } => "AMBIGUOUS_OBJECT",
        ReasonError::NoSingleEvent { .. } => "NO_SINGLE_EVENT",
        ReasonError::NotUnderstood { .. } => "NOT_UNDERSTOOD",
        _ => "INVALID",
    }
}

/// A refusal with the first violations and the number of those left out.
fn refused(reason: &str, violations: Vec<Violation>) -> Status {
    let message = match violations.as_slice() {
        [only] => format!("{}: {}", only.path, only.message),
        [first, others @ ..] => format!("{}: {} (and {} more)", first.path, first.message, others.len()),
        [] => "the request is not valid".to_string(),
    };
    let mut left = VIOLATION_BYTES;
    let mut fields: Vec<FieldViolation> = Vec::new();
    for violation in &violations {
        let (path, text) =
            (cut(&violation.path, DESCRIPTION_BYTES), cut(&violation.message, DESCRIPTION_BYTES));
        let Some(rest) = left.checked_sub(path.len() + text.len() + VIOLATION_OVERHEAD) else { break };
        left = rest;
        fields.push(FieldViolation::new(path, text));
    }
    let out = violations.len() - fields.len();
    if out > 0 {
        fields.push(FieldViolation::new(
            "...",
            format!("at least {out} more were left out; correct these first"),
        ));
    }
    let mut details = info(reason);
    details.set_bad_request(fields);
    Status::with_error_details(Code::InvalidArgument, short(message), details)
}

/// The beginning of a text, at most that many bytes.
fn cut(text: &str, bytes: usize) -> &str {
    (0..=bytes).rev().find_map(|end| text.get(..end.min(text.len()))).unwrap_or_default()
}

/// The beginning of a message that is too long for a header.
fn short(mut message: String) -> String {
    let mut encoded = 0;
    let too_long = |c: char| {
        encoded += if c.is_ascii_alphanumeric() { 1 } else { 3 * c.len_utf8() };
        encoded > MESSAGE_BYTES
    };
    if let Some(end) = message.find(too_long) {
        message.truncate(end);
        message.push_str("...");
    }
    message
}

/// A status with a reason in `ErrorInfo`.
pub fn plain(code: Code, message: String, reason: &str) -> Status {
    Status::with_error_details(code, message, info(reason))
}

fn info(reason: &str) -> ErrorDetails {
    ErrorDetails::with_error_info(reason, DOMAIN, HashMap::new())
}

/// The error as a message, for one question of a stream.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes as HTTP/2 counts them, beside the few fields that every reply has.
    fn header_bytes(status: Status) -> usize {
        let response = status.into_http::<()>();
        response.headers().iter().map(|(name, value)| name.as_str().len() + value.len() + 32).sum()
    }

    #[test]
    fn callers_do_not_learn_where_the_service_keeps_its_files() {
        let failed = status(StoreError::Failed("Not a directory".into()).into());
        assert!(failed.message().contains("Not a directory"), "the cause is said: {failed:?}");
        let unusable = StoreError::Unusable { path: "/srv/secret".into(), cause: "gone".into() };
        for error in [unusable.into(), EngineError::Recording("/srv/secret/t.mcap".into())] {
            let status = status(error);
            assert!(!status.message().contains("/srv"), "{status:?}");
        }
    }

    #[test]
    fn what_the_transport_says_is_said_as_other_services_do() {
        let clear = |status: Status| {
            let mut fields = HeaderMap::new();
            status.add_header(&mut fields).unwrap();
            clarify(&mut fields);
            Status::from_header_map(&fields).unwrap()
        };
        let garbage = clear(Status::internal("invalid wire type"));
        assert_eq!(garbage.code(), Code::InvalidArgument);
        assert_eq!(garbage.get_details_error_info().unwrap().reason, "MALFORMED");
        assert_eq!(clear(Status::out_of_range("too long")).code(), Code::ResourceExhausted);
        let ours = clear(status(EngineError::Internal { id: "x".into(), message: String::new() }));
        assert_eq!(ours.code(), Code::Internal);
    }

    #[test]
    fn every_refusal_fits_into_the_headers_that_clients_take() {
        for text in ["x", "long ", "\"<ö>\" "] {
            for count in [1, 3, 30, 300] {
                let violation =
                    |i| Violation { path: format!("video.objects[{i}]"), message: text.repeat(2000) };
                let status = refused("INVALID", (0..count).map(violation).collect());
                let fields = status.get_details_bad_request().unwrap().field_violations;
                let kept = fields.iter().filter(|f| f.field != "...").count();
                assert_eq!(fields[0].field, "video.objects[0]");
                match fields.last().filter(|f| f.field == "...") {
                    Some(rest) => assert!(rest.description.contains(&format!("{} more", count - kept))),
                    None => assert_eq!(kept, count),
                }
                assert!(header_bytes(status) < 8 * 1024 - 512, "{count} of {text:?}");
            }
        }
    }
}
