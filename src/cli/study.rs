//! What the commands that study a set-up have in common.

use super::connect::Connection;
use super::error::Failure;
use super::{output, progress, wire};
use crate::api::v1::{ModelChoice, RankedEffect, StudyRequest};
use crate::discover::FORMULA;
use crate::scene::Scene;
use tonic::{Response, Status, Streaming};

/// Posts the scenes and names them in a request.
pub async fn request(
    connection: &Connection,
    scenes: &[Scene],
    start: Option<ModelChoice>,
) -> Result<StudyRequest, Failure> {
    let mut videos = Vec::with_capacity(scenes.len());
    for scene in scenes {
        videos.push(connection.post(scene).await.map_err(|e| e.at(&scene.name))?);
    }
    Ok(StudyRequest { videos, start, models: vec![] })
}

/// A streamed reply.
pub type Reply<M> = Result<Response<Streaming<M>>, Status>;

/// What one message of a streamed reply says.
pub enum Said<T> {
    /// How far the work is: 0 to 1.
    Progress(f64),
    /// The last message.
    Result(T),
}

/// Reads a reply to its end, with a bar that says `what` the service does; its result.
pub async fn result<M, T>(
    what: &'static str,
    open: impl AsyncFn() -> Reply<M>,
    said: impl Fn(M) -> Option<Said<T>>,
) -> Result<T, Failure> {
    let bar = progress::percent(what);
    let found = last(open, said, |f| bar.set_position((100.0 * f) as u64)).await;
    bar.finish_and_clear();
    found
}

/// Reads a reply to its end, and tells the progress; its result. Where the service goes away meanwhile, the call is sent anew:
/// what it makes has a name by its content.
pub async fn last<M, T>(
    open: impl AsyncFn() -> Reply<M>,
    said: impl Fn(M) -> Option<Said<T>>,
    progress: impl Fn(f64),
) -> Result<T, Failure> {
    let read = async || -> Result<Option<T>, Status> {
        let mut stream = open().await?.into_inner();
        let mut found = None;
        while let Some(message) = stream.message().await? {
            match said(message) {
                Some(Said::Progress(fraction)) => progress(fraction),
                Some(Said::Result(result)) => found = Some(result),
                None => {}
            }
        }
        Ok(found)
    };
    let found = wire::again(read).await?;
    found.ok_or_else(|| Failure::other("the service ended its reply without a result; try again"))
}

/// The best candidates as a table, and laws that the user wrote wherever they stand; of a single video no other tells how well
/// they foretell.
pub fn ranking(ranked: &[RankedEffect], most: usize, videos: usize) -> String {
    if ranked.is_empty() {
        return String::new();
    }
    let columns = if videos > 1 { 4 } else { 3 };
    let row = |r: &RankedEffect| {
        let evidence = |value: Option<f64>| value.map(|e| format!("{e:.1}")).unwrap_or_default();
        let error = r.held_out_rmse.map(|e| format!("{:.2}", 1e3 * e)).unwrap_or_default();
        let cells = [r.effect.clone(), evidence(r.log_evidence), evidence(r.contact_log_evidence), error];
        cells[..columns].to_vec()
    };
    let told = ranked.iter().enumerate().filter(|(k, r)| *k < most || r.kind == FORMULA);
    let rows: Vec<Vec<String>> = told.map(|(_, r)| row(r)).collect();
    format!(
        "\n{}",
        output::table(&["candidate", "log evidence", "at contacts", "other videos mm"][..columns], &rows)
    )
}
