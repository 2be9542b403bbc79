//! Operations: requests to domain values, and how operations stand to replies.

use super::names::{model_ids, operation_name, video_name};
use super::progress::progress_message;
use super::trace::timestamp;
use super::violations::Violations;
use crate::api::v1;
use crate::api::v1::learn_concepts_request::Source;
use crate::api::v1::operation::Result as OperationResult;
use crate::api::v1::start_operation_request::Work;
use crate::engine::{
    EngineError, NewOperation, OperationFilter, OperationKind, OperationOutcome, OperationState,
    OperationStatus,
};
use prost::Message;
use tonic::Code;

const KINDS: [(OperationKind, v1::OperationKind); 9] = [
    (OperationKind::FitModel, v1::OperationKind::FitModel),
    (OperationKind::CompareModels, v1::OperationKind::CompareModels),
    (OperationKind::DiagnoseModel, v1::OperationKind::DiagnoseModel),
    (OperationKind::DiscoverEffects, v1::OperationKind::DiscoverEffects),
    (OperationKind::AddEffect, v1::OperationKind::AddEffect),
    (OperationKind::RemoveEffect, v1::OperationKind::RemoveEffect),
    (OperationKind::WriteReport, v1::OperationKind::WriteReport),
    (OperationKind::CreateVideo, v1::OperationKind::CreateVideo),
    (OperationKind::LearnConcepts, v1::OperationKind::LearnConcepts),
];

const STATES: [(OperationState, v1::OperationState); 5] = [
    (OperationState::Running, v1::OperationState::Running),
    (OperationState::Succeeded, v1::OperationState::Succeeded),
    (OperationState::Failed, v1::OperationState::Failed),
    (OperationState::Cancelled, v1::OperationState::Cancelled),
    (OperationState::Aborted, v1::OperationState::Aborted),
];

/// What a new operation is about, and its work; the work's own fields are checked when it starts.
pub fn start(mut given: v1::StartOperationRequest) -> Result<(NewOperation, Work), EngineError> {
    let mut violations = Violations::default();
    let request_id = std::mem::take(&mut given.request_id);
    violations.request_id(&request_id);
    // The same work under another name is kept as the same request.
    let request = given.encode_to_vec();
    let Some(work) = given.work else {
        violations.add("work", "is missing; give the request of the call that does the same");
        return Err(EngineError::Invalid(violations.0));
    };
    let request_digest = blake3::hash(&request).to_hex().to_string();
    let (kind, videos) = subject(&work);
    let videos = ids(videos);
    violations.finish((NewOperation { kind, videos, request_id, request_digest, request }, work))
}

/// The work of a request that [`start`] kept.
pub fn kept_work(request: &[u8]) -> Result<Work, EngineError> {
    let kept = v1::StartOperationRequest::decode(request).ok().and_then(|kept| kept.work);
    kept.ok_or_else(|| EngineError::invalid("work", "is of another program; start the operation again"))
}

/// The kind of the work, and the names of its videos.
fn subject(work: &Work) -> (OperationKind, Vec<String>) {
    let of = |study: &Option<v1::StudyRequest>| study.as_ref().map(|s| s.videos.clone()).unwrap_or_default();
    match work {
        Work::FitModel(r) => (OperationKind::FitModel, [vec![r.parent.clone()], r.others.clone()].concat()),
        Work::CompareModels(r) => (OperationKind::CompareModels, of(&r.study)),
        Work::DiagnoseModel(r) => (OperationKind::DiagnoseModel, of(&r.study)),
        Work::DiscoverEffects(r) => (OperationKind::DiscoverEffects, of(&r.study)),
        Work::AddEffect(r) => (OperationKind::AddEffect, of(&r.study)),
        Work::RemoveEffect(r) => (OperationKind::RemoveEffect, of(&r.study)),
        Work::WriteReport(r) => {
            let asked = r.questions.iter().map(|q| q.video.clone()).collect();
            (OperationKind::WriteReport, [of(&r.study), asked].concat())
        }
        Work::CreateVideo(_) => (OperationKind::CreateVideo, vec![]),
        Work::LearnConcepts(r) => (OperationKind::LearnConcepts, lesson_videos(r)),
    }
}

/// Names of the videos from which words are learned.
fn lesson_videos(request: &v1::LearnConceptsRequest) -> Vec<String> {
    let of = |lessons: &v1::Lessons| lessons.videos.iter().map(|v| v.video.clone()).collect();
    match &request.source {
        Some(Source::Lessons(lessons)) => of(lessons),
        Some(Source::Change(change)) => change.lessons.as_ref().map_or(vec![], of),
        Some(Source::Examples(examples)) => {
            examples.yes.iter().chain(&examples.no).map(|e| e.video.clone()).collect()
        }
        None => vec![],
    }
}

/// Ids of the videos or of the models' videos, each once.
fn ids(names: Vec<String>) -> Vec<String> {
    let mut ids: Vec<String> = vec![];
    for name in names {
        let id = match model_ids(&name) {
            Some((video, _)) => video,
            None => name.strip_prefix("videos/").unwrap_or_default(),
        };
        if !id.is_empty() && !ids.iter().any(|known| known == id) {
            ids.push(id.to_string());
        }
    }
    ids
}

/// A result or an error as the engine keeps it.
pub fn outcome(result: OperationResult) -> OperationOutcome {
    let names = match &result {
        OperationResult::Fitted(found) => {
            found.model.iter().chain(&found.others).map(|m| m.name.clone()).collect()
        }
        OperationResult::Video(video) => vec![video.name.clone()],
        _ => vec![],
    };
    let succeeded = !matches!(result, OperationResult::Error(_));
    let result = v1::Operation { result: Some(result), ..Default::default() }.encode_to_vec();
    OperationOutcome { succeeded, result, videos: ids(names) }
}

/// An operation without its result.
pub fn operation(status: &OperationStatus) -> v1::Operation {
    let OperationStatus { record, progress } = status;
    let kind = KINDS.iter().find(|(kind, _)| *kind == record.kind);
    let state = STATES.iter().find(|(state, _)| *state == record.state);
    v1::Operation {
        name: operation_name(&record.id),
        kind: kind.map_or(0, |(_, kind)| (*kind).into()),
        state: state.map_or(0, |(_, state)| (*state).into()),
        done: status.is_done(),
        videos: record.videos.iter().map(|id| video_name(id)).collect(),
        request_id: record.request_id.clone(),
        create_time: Some(timestamp(record.created_ms)),
        end_time: record.ended_ms.map(timestamp),
        expire_time: status.is_done().then(|| timestamp(record.expires_ms())),
        progress: progress.as_ref().map(progress_message),
        result: None,
    }
}

/// An operation with its result; `bytes` are those of [`outcome`].
pub fn ended(status: &OperationStatus, bytes: &[u8]) -> Result<v1::Operation, EngineError> {
    let error = |code: Code, message: &str| {
        let (code, message) = (code as i32, message.to_string());
        Some(OperationResult::Error(v1::Error { code, message, violations: vec![] }))
    };
    let result = match status.record.state {
        OperationState::Running => None,
        OperationState::Cancelled => error(Code::Cancelled, "cancelled by a caller"),
        OperationState::Aborted => error(
            Code::Aborted,
            "the service ended before it, and the next one goes on with it if it can; or start it again, which reuses what is stored",
        ),
        OperationState::Succeeded | OperationState::Failed => {
            let kept = v1::Operation::decode(bytes).ok().and_then(|kept| kept.result);
            let lost = || EngineError::NotFound { name: operation_name(&status.record.id) };
            Some(kept.ok_or_else(lost)?)
        }
    };
    Ok(v1::Operation { result, ..operation(status) })
}

/// Which operations to list, how many and after which.
pub fn list(given: v1::ListOperationsRequest) -> Result<(OperationFilter, usize, String), EngineError> {
    let mut violations = Violations::default();
    let video = violations.optional_id("video", &given.video, "videos");
    let mut filter = OperationFilter { video, ..Default::default() };
    for (i, number) in given.states.into_iter().enumerate() {
        match STATES.iter().find(|(_, state)| i32::from(*state) == number) {
            Some((state, _)) => filter.states.push(*state),
            None => violations.add(format!("states[{i}]"), format!("is {number}, which is no state")),
        }
    }
    for (i, number) in given.kinds.into_iter().enumerate() {
        match KINDS.iter().find(|(_, kind)| i32::from(*kind) == number) {
            Some((kind, _)) => filter.kinds.push(*kind),
            None => violations.add(format!("kinds[{i}]"), format!("is {number}, which is no kind")),
        }
    }
    let (size, after) = violations.page(given.page_size, given.page_token);
    violations.finish((filter, size, after))
}

/// Id of an operation.
pub fn id(name: &str) -> Result<String, EngineError> {
    let mut violations = Violations::default();
    let id = violations.id("name", name, "operations");
    violations.finish(id)
}
