//! The pages that a browser opens: the dashboard, the report of a video, a trace file.

use super::visitor::Visitor;
use crate::api::convert::names::{is_id, video_name};
use crate::api::convert::study;
use crate::api::server::byte_budget::OverBudget;
use crate::api::server::reply_body::counted;
use crate::api::server::sessions::random_name;
use crate::api::status::status;
use crate::api::v1;
use crate::engine::{EngineError, ReportContents, Tenant};
use crate::report::dashboard::dashboard;
use axum::Extension;
use axum::body::Body;
use axum::extract::{Path, Query};
use axum::http::StatusCode;
use axum::http::header::{
    CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HeaderName,
    RETRY_AFTER,
};
use axum::response::{IntoResponse, Response};
use futures_util::{StreamExt, stream};
use serde::Deserialize;
use tonic::{Code, Status};

/// The prefix of a report's links to traces.
const TRACE_PREFIX: &str = "/traces/";

/// A status as an HTTP response.
pub struct Refusal(Status);

impl From<EngineError> for Refusal {
    fn from(error: EngineError) -> Self {
        Refusal(status(error))
    }
}

impl From<OverBudget> for Refusal {
    fn from(over: OverBudget) -> Self {
        Refusal(over.into())
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let status = self.0;
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

/// A page of ours. It runs its own script only, which this response names, and loads nothing from elsewhere.
pub fn page(html: String) -> Response {
    let (head, html) = headed(html);
    (head, html).into_response()
}

fn headed(html: String) -> ([(HeaderName, String); 3], String) {
    let own = random_name().unwrap_or_default();
    let script = if own.is_empty() { "'none'".to_string() } else { format!("'nonce-{own}'") };
    let policy = format!(
        "default-src 'none'; style-src 'unsafe-inline'; script-src {script}; img-src data:; connect-src 'self'; \
         form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    );
    let head = [
        (CONTENT_TYPE, "text/html; charset=utf-8".to_string()),
        (CONTENT_SECURITY_POLICY, policy),
        (CACHE_CONTROL, "no-store".to_string()),
    ];
    (head, named_script(html, &own))
}

/// The page whose one script has this name. Texts in it have no tags.
fn named_script(mut html: String, own: &str) -> String {
    const SCRIPT: &str = "<script";
    if let Some(at) = html.rfind("<script>") {
        html.insert_str(at + SCRIPT.len(), &format!(" nonce=\"{own}\""));
    }
    html
}

/// A page whose bytes are counted until they are sent.
fn counted_page(visitor: &Visitor, html: String) -> Result<Response, Refusal> {
    let (head, html) = headed(html);
    let reserved = visitor.context.budgets.replies.reserve(&visitor.holder, html.len())?;
    Ok((head, Body::from(counted(html.into(), reserved))).into_response())
}

#[derive(Deserialize)]
pub struct PageAfter {
    #[serde(default)]
    after: String,
}

pub async fn home(
    Extension(visitor): Extension<Visitor>,
    Query(PageAfter { after }): Query<PageAfter>,
) -> Result<impl IntoResponse, Refusal> {
    if !after.is_empty() && !is_id(&after) {
        return Err(EngineError::invalid("after", format!("is {after:?}; must be a video's id")).into());
    }
    let shown = visitor.engine.overview(&after).await?;
    let tenant = visitor.tenant.as_ref().map(Tenant::name);
    counted_page(&visitor, dashboard(&shown, tenant))
}

#[derive(Deserialize)]
pub struct ReportVideos {
    /// Ids of the other videos of the set-up, with commas.
    #[serde(default)]
    with: String,
}

/// The report of a discovery with default options. It is computed once and stored; a caller who leaves early stops it.
pub async fn report(
    Extension(visitor): Extension<Visitor>,
    Path(video): Path<String>,
    Query(ReportVideos { with }): Query<ReportVideos>,
) -> Result<impl IntoResponse, Refusal> {
    let named = [video.as_str()].into_iter().chain(with.split(',').filter(|id| !id.is_empty()));
    let videos = named.map(video_name).collect();
    let study = Some(v1::StudyRequest { videos, ..Default::default() });
    let search = v1::DiscoverEffectsRequest { study, ..Default::default() };
    let (videos, start, kind) = study::discovery(search)?;
    let found = visitor.engine.study(&videos, &start, kind).await?.finish().await?;
    let contents = ReportContents { prefix: Some(TRACE_PREFIX.into()), ..Default::default() };
    let written = visitor.engine.page(&found, contents).await?;
    counted_page(&visitor, written.html)
}

/// The MCAP file of a trace: `{id}.mcap`.
pub async fn trace(
    Extension(visitor): Extension<Visitor>,
    Path(file): Path<String>,
) -> Result<impl IntoResponse, Refusal> {
    let id = file.strip_suffix(".mcap").unwrap_or(&file);
    let missing = || EngineError::NotFound { name: format!("traces/{file}") };
    let id = Some(id).filter(|id| is_id(id)).ok_or_else(missing)?;
    let mut download = visitor.engine.download(id).await?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_script_of_a_page_is_named() {
        let named = named_script("<p>x</p><script>run()</script>".into(), "abc");
        assert_eq!(named, "<p>x</p><script nonce=\"abc\">run()</script>");
        assert_eq!(named_script("<p>x</p>".into(), "abc"), "<p>x</p>");
    }
}
