//! What the commands that study a set-up have in common.

use super::connect::Connection;
use super::error::Failure;
use super::output;
use crate::api::v1::{ModelChoice, RankedEffect, StudyRequest};
use crate::scene::Scene;
use indicatif::{ProgressBar, ProgressStyle};

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

/// A bar of 100 steps.
pub fn bar(what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(100);
    if let Ok(style) = ProgressStyle::with_template("{msg:10} {bar:40} {percent:>3} %  {elapsed}") {
        bar.set_style(style);
    }
    bar.set_message(what);
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    bar
}

/// The best candidates as a table.
pub fn ranking(ranked: &[RankedEffect], most: usize) -> String {
    if ranked.is_empty() {
        return String::new();
    }
    let row = |r: &RankedEffect| {
        // The kind of a user's law says nothing.
        let name = if r.kind == crate::discover::FORMULA { &r.effect } else { &r.kind };
        vec![name.clone(), format!("{:.1}", r.log_evidence), format!("{:.2}", 1e3 * r.held_out_rmse)]
    };
    let rows: Vec<Vec<String>> = ranked.iter().take(most).map(row).collect();
    format!("\n{}", output::table(&["candidate", "log evidence", "held out mm"], &rows))
}
