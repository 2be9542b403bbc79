//! The pages that a browser opens: the dashboard, the report of a video, a trace file.

use crate::api::convert::names::{is_id, video_name};
use crate::api::convert::study;
use crate::api::status::status;
use crate::api::v1;
use crate::engine::{Engine, EngineError, ReportContents};
use crate::report::dashboard::dashboard;
use axum::body::Body;
use axum::extract::{Path, Query, State};
use axum::http::StatusCode;
use axum::http::header::{CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_TYPE, RETRY_AFTER};
use axum::response::{Html, IntoResponse, Response};
use futures_util::{StreamExt, stream};
use serde::Deserialize;
use std::sync::Arc;
use tonic::Code;

/// The prefix of a report's links to traces.
const TRACE_PREFIX: &str = "/traces/";

/// An error as an HTTP response.
pub struct Refusal(EngineError);

impl From<EngineError> for Refusal {
    fn from(error: EngineError) -> Self {
        Refusal(error)
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let status = status(self.0);
        let code = match status.code() {
            Code::InvalidArgument | Code::OutOfRange => StatusCode::BAD_REQUEST,
            Code::NotFound => StatusCode::NOT_FOUND,
            Code::FailedPrecondition => StatusCode::UNPROCESSABLE_ENTITY,
            Code::ResourceExhausted | Code::Unavailable | Code::Cancelled => StatusCode::SERVICE_UNAVAILABLE,
            Code::DeadlineExceeded => StatusCode::GATEWAY_TIMEOUT,
            _ => StatusCode::INTERNAL_SERVER_ERROR,
        };
        let text = format!("{}\n", status.message());
        match code {
            StatusCode::SERVICE_UNAVAILABLE => (code, [(RETRY_AFTER, "1")], text).into_response(),
            _ => (code, text).into_response(),
        }
    }
}

#[derive(Deserialize)]
pub struct PageAfter {
    #[serde(default)]
    after: String,
}

pub async fn home(
    State(engine): State<Arc<Engine>>,
    Query(PageAfter { after }): Query<PageAfter>,
) -> Result<impl IntoResponse, Refusal> {
    if !after.is_empty() && !is_id(&after) {
        return Err(EngineError::invalid("after", format!("is {after:?}; must be a video's id")).into());
    }
    let shown = engine.overview(&after).await?;
    Ok(([(CACHE_CONTROL, "no-store")], Html(dashboard(&shown))))
}

#[derive(Deserialize)]
pub struct ReportVideos {
    /// Ids of the other videos of the set-up, with commas.
    #[serde(default)]
    with: String,
}

/// The report of a discovery with default options. It is computed once and stored; a caller who leaves early stops it.
pub async fn report(
    State(engine): State<Arc<Engine>>,
    Path(video): Path<String>,
    Query(ReportVideos { with }): Query<ReportVideos>,
) -> Result<impl IntoResponse, Refusal> {
    let named = [video.as_str()].into_iter().chain(with.split(',').filter(|id| !id.is_empty()));
    let videos = named.map(video_name).collect();
    let study = Some(v1::StudyRequest { videos, ..Default::default() });
    let search = v1::DiscoverEffectsRequest { study, ..Default::default() };
    let (videos, start, kind) = study::discovery(search)?;
    let found = engine.study(&videos, &start, kind).await?.finish().await?;
    let contents = ReportContents { prefix: Some(TRACE_PREFIX.into()), ..Default::default() };
    let page = engine.page(&found, contents).await?;
    Ok(([(CACHE_CONTROL, "no-cache")], Html(page.html)))
}

/// The MCAP file of a trace: `{id}.mcap`.
pub async fn trace(
    State(engine): State<Arc<Engine>>,
    Path(file): Path<String>,
) -> Result<impl IntoResponse, Refusal> {
    let id = file.strip_suffix(".mcap").unwrap_or(&file);
    let missing = || EngineError::NotFound { name: format!("traces/{file}") };
    let id = Some(id).filter(|id| is_id(id)).ok_or_else(missing)?;
    let mut download = engine.download(id).await?;
    let size = download.record().size_bytes;
    // The first bytes are read here, while the response can still be an error.
    let (_, first) = download.next().await?;
    let head = [
        (CONTENT_TYPE, "application/octet-stream".to_string()),
        (CONTENT_LENGTH, size.to_string()),
        (CONTENT_DISPOSITION, format!("attachment; filename=\"{id}.mcap\"")),
    ];
    let others = stream::try_unfold(download, async |mut download| {
        let (_, chunk) = download.next().await?;
        Ok::<_, EngineError>((!chunk.is_empty()).then_some((chunk, download)))
    });
    Ok((head, Body::from_stream(stream::once(async { Ok(first) }).chain(others))))
}
