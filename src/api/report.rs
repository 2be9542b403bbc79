//! Reports: requests to what is asked, pages to replies.

use super::reply::trace_name;
use super::{request, study, v1};
use crate::engine::{Engine, EngineError, Page, Query, Study, Waiting};
use std::sync::Arc;

/// Most questions of one report.
const MAX_QUESTIONS: usize = 20;
/// Longest start of a link (bytes).
const MAX_PREFIX: usize = 1000;

/// What is searched for, what the page is to answer, and where its links lead.
pub struct Asked {
    pub waiting: Waiting<Study>,
    pub queries: Vec<Query>,
    pub prefix: Option<String>,
}

pub async fn asked(engine: &Arc<Engine>, given: v1::WriteReportRequest) -> Result<Asked, EngineError> {
    if given.questions.len() > MAX_QUESTIONS {
        let message = format!("are {}; at most {MAX_QUESTIONS}", given.questions.len());
        return Err(EngineError::invalid("questions", message));
    }
    // A link that could run something is none.
    if given.trace_prefix.len() > MAX_PREFIX || given.trace_prefix.contains(':') {
        let message = format!("must be a relative link of at most {MAX_PREFIX} bytes, such as `traces/`");
        return Err(EngineError::invalid("trace_prefix", message));
    }
    let first = given.study.as_ref().and_then(|s| s.videos.first()).cloned().unwrap_or_default();
    let search =
        v1::DiscoverEffectsRequest { study: given.study, max_effects: given.max_effects, frames: None };
    let (videos, start, inquiry) = study::discovery(search)?;
    let mut queries = vec![];
    for mut question in given.questions {
        if question.video.is_empty() {
            question.video = first.clone();
        }
        let (video, choice, question, options) = request::ask(question)?;
        queries.push(Query { video, choice, question, options });
    }
    let waiting = engine.study(&videos, &start, inquiry).await?;
    Ok(Asked { waiting, queries, prefix: Some(given.trace_prefix).filter(|p| !p.is_empty()) })
}

/// The page of what was found.
pub async fn written(
    engine: &Arc<Engine>,
    study: &Study,
    queries: Vec<Query>,
    prefix: Option<String>,
) -> Result<v1::Report, EngineError> {
    Ok(report(engine.page(study, queries, prefix).await?))
}

fn report(page: Page) -> v1::Report {
    v1::Report {
        html: page.html,
        pictures: page.pictures.into_iter().map(|(name, svg)| v1::Picture { name, svg }).collect(),
        traces: page.traces.iter().map(|id| trace_name(id)).collect(),
    }
}
