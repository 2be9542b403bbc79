//! Reports: requests to a study and questions, pages to replies.

use super::comparison;
use crate::api::convert::names::{trace_name, video_name};
use crate::api::convert::reasoning::question;
use crate::api::convert::study;
use crate::api::convert::violations::Violations;
use crate::api::v1;
use crate::engine::{
    Engine, EngineError, JobHandle, ModelSource, ReportContents, ReportPage, ReportQuestion, Study,
};
use std::sync::Arc;

/// Most questions of one report.
const MAX_QUESTIONS: usize = 20;
/// Longest start of a link (bytes).
const MAX_PREFIX: usize = 1000;

/// The running study, and what the page shows beside its models.
pub struct ReportRequest {
    pub job: JobHandle<Study>,
    pub contents: ReportContents,
}

/// A page of models as they are: the videos and models, those beside them, and what else it shows.
pub struct AsIsRequest {
    models: (Vec<String>, ModelSource),
    against: Option<(Vec<String>, ModelSource)>,
    contents: ReportContents,
}

/// Checks a request for a page of models as they are.
pub fn as_is_request(given: v1::WriteReportRequest) -> Result<AsIsRequest, EngineError> {
    check(&given)?;
    if given.max_effects.is_some() {
        return Err(EngineError::invalid("max_effects", "has no effect with as_is; leave it out"));
    }
    let models = study::request(given.study)?;
    let against = comparison::other_side(&models.0, given.against)?;
    let contents = contents(given.questions, models.0.first(), given.trace_prefix, &given.lexicon)?;
    Ok(AsIsRequest { models, against, contents })
}

/// The page of models as they are.
pub async fn written_as_is(engine: &Arc<Engine>, asked: AsIsRequest) -> Result<v1::Report, EngineError> {
    let (videos, source) = asked.models;
    let models = engine.side(&videos, &source).await?;
    let against = match asked.against {
        None => None,
        Some((their_videos, source)) => {
            let theirs = engine.side(&their_videos, &source).await?;
            let of = |video: &String| theirs.iter().find(|f| f.video == *video).cloned();
            Some(videos.iter().filter_map(of).collect())
        }
    };
    Ok(report(engine.models_page(models, against, asked.contents).await?))
}

fn check(given: &v1::WriteReportRequest) -> Result<(), EngineError> {
    if given.questions.len() > MAX_QUESTIONS {
        let message = format!("are {}; at most {MAX_QUESTIONS}", given.questions.len());
        return Err(EngineError::invalid("questions", message));
    }
    // A link with a scheme could run a script.
    if given.trace_prefix.len() > MAX_PREFIX || given.trace_prefix.contains(':') {
        let message = format!("must be a relative link of at most {MAX_PREFIX} bytes, such as `traces/`");
        return Err(EngineError::invalid("trace_prefix", message));
    }
    if given.against.is_some() && !given.as_is {
        return Err(EngineError::invalid("against", "needs as_is: a search has no models beside it"));
    }
    Ok(())
}

/// What a page shows beside its models.
fn contents(
    asked: Vec<v1::AskRequest>,
    first: Option<&String>,
    prefix: String,
    lexicon: &str,
) -> Result<ReportContents, EngineError> {
    let mut violations = Violations::default();
    let lexicon = violations.optional_id("lexicon", lexicon, "lexica");
    let lexicon = violations.finish(lexicon)?;
    let prefix = Some(prefix).filter(|p| !p.is_empty());
    Ok(ReportContents { questions: questions(asked, first)?, prefix, lexicon })
}

/// The questions of a page; the default video is the first one.
fn questions(given: Vec<v1::AskRequest>, first: Option<&String>) -> Result<Vec<ReportQuestion>, EngineError> {
    let one = |mut asked: v1::AskRequest| {
        if asked.video.is_empty() {
            asked.video = first.map_or(String::new(), |id| video_name(id));
        }
        let (video, source, asked, options) = question::ask_request(asked)?;
        Ok(ReportQuestion { video, source, asked, options })
    };
    given.into_iter().map(one).collect()
}

/// Starts the study of a request and converts its questions.
pub async fn report_request(
    engine: &Arc<Engine>,
    given: v1::WriteReportRequest,
) -> Result<ReportRequest, EngineError> {
    check(&given)?;
    let named = given.study.as_ref().and_then(|s| s.videos.first()).cloned();
    let search =
        v1::DiscoverEffectsRequest { study: given.study, max_effects: given.max_effects, frames: None };
    let (videos, start, kind) = study::discovery(search)?;
    let first = named.as_deref().map(|name| name.trim_start_matches("videos/").to_string());
    let contents = contents(given.questions, first.as_ref(), given.trace_prefix, &given.lexicon)?;
    let job = engine.study(&videos, &start, kind).await?;
    Ok(ReportRequest { job, contents })
}

/// The page of a finished study.
pub async fn written(
    engine: &Arc<Engine>,
    study: &Study,
    contents: ReportContents,
) -> Result<v1::Report, EngineError> {
    Ok(report(engine.page(study, contents).await?))
}

fn report(page: ReportPage) -> v1::Report {
    v1::Report {
        html: page.html,
        pictures: page.pictures.into_iter().map(|(name, svg)| v1::Picture { name, svg }).collect(),
        traces: page.traces.iter().map(|id| trace_name(id)).collect(),
    }
}
