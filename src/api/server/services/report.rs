//! Reports: requests to a study and questions, pages to replies.

use crate::api::convert::names::trace_name;
use crate::api::convert::{question, study};
use crate::api::v1;
use crate::engine::{Engine, EngineError, JobHandle, ReportPage, ReportQuestion, Study};
use std::sync::Arc;

/// Most questions of one report.
const MAX_QUESTIONS: usize = 20;
/// Longest start of a link (bytes).
const MAX_PREFIX: usize = 1000;

/// The running study, the questions that the page answers, and the prefix of its links.
pub struct ReportRequest {
    pub job: JobHandle<Study>,
    pub questions: Vec<ReportQuestion>,
    pub prefix: Option<String>,
}

/// Starts the study of a request and converts its questions.
pub async fn report_request(
    engine: &Arc<Engine>,
    given: v1::WriteReportRequest,
) -> Result<ReportRequest, EngineError> {
    if given.questions.len() > MAX_QUESTIONS {
        let message = format!("are {}; at most {MAX_QUESTIONS}", given.questions.len());
        return Err(EngineError::invalid("questions", message));
    }
    // A link with a scheme could run a script.
    if given.trace_prefix.len() > MAX_PREFIX || given.trace_prefix.contains(':') {
        let message = format!("must be a relative link of at most {MAX_PREFIX} bytes, such as `traces/`");
        return Err(EngineError::invalid("trace_prefix", message));
    }
    let first = given.study.as_ref().and_then(|s| s.videos.first()).cloned().unwrap_or_default();
    let search =
        v1::DiscoverEffectsRequest { study: given.study, max_effects: given.max_effects, frames: None };
    let (videos, start, kind) = study::discovery(search)?;
    let mut questions = vec![];
    for mut asked in given.questions {
        if asked.video.is_empty() {
            asked.video = first.clone();
        }
        let (video, source, question, options) = question::ask_request(asked)?;
        questions.push(ReportQuestion { video, source, question, options });
    }
    let job = engine.study(&videos, &start, kind).await?;
    Ok(ReportRequest { job, questions, prefix: Some(given.trace_prefix).filter(|p| !p.is_empty()) })
}

/// The page of a finished study.
pub async fn written(
    engine: &Arc<Engine>,
    study: &Study,
    questions: Vec<ReportQuestion>,
    prefix: Option<String>,
) -> Result<v1::Report, EngineError> {
    Ok(report(engine.page(study, questions, prefix).await?))
}

fn report(page: ReportPage) -> v1::Report {
    v1::Report {
        html: page.html,
        pictures: page.pictures.into_iter().map(|(name, svg)| v1::Picture { name, svg }).collect(),
        traces: page.traces.iter().map(|id| trace_name(id)).collect(),
    }
}
