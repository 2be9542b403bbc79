//! `report`: what a discovery found, and answers, as one page to look at.

use super::Target;
use super::connect::Connection;
use super::error::Failure;
use super::study::Said;
use super::{ask, input, output, study};
use crate::api::v1::{Report, WriteReportRequest, WriteReportResponse, write_report_response::Event};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Scenes of one set-up: files, folders, or folders of scene folders.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// The page: one HTML file that needs no network.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Writes each picture as an SVG file too, for papers.
    #[arg(long, value_name = "DIR")]
    svg: Option<PathBuf>,
    /// Saves the traces, so that the page can link to them.
    #[arg(long, value_name = "DIR")]
    traces: Option<PathBuf>,
    /// A question about the first scene to answer on the page (see `vrdp ask --help`); may be repeated.
    #[arg(long, value_name = "TEXT")]
    question: Vec<String>,
    /// Preset or model file to begin with [default: what suits the scenes' world].
    #[arg(long, value_name = "NAME|FILE")]
    model: Option<String>,
    /// Most effects that are added [default: 2].
    #[arg(long, value_name = "N")]
    max_effects: Option<u32>,
}

pub async fn run(target: &Target, args: Args) -> Result<(), Failure> {
    output::writable("--out", &args.out)?;
    let scenes = input::scenes(&args.scenes)?.into_iter().collect::<Result<Vec<_>, _>>()?;
    let start = input::model(args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let study = study::request(&connection, &scenes, start).await?;
    let choices: [&str; 0] = [];
    let questions = args.question.iter().map(|q| ask::request(String::new(), q, &choices)).collect();
    let trace_prefix = args.traces.as_deref().map(|dir| prefix(&args.out, dir)).unwrap_or_default();
    let request =
        WriteReportRequest { study: Some(study), max_effects: args.max_effects, questions, trace_prefix };
    let report = write(&connection, request).await?;
    let place = save(&connection, &report, &args.out, args.svg.as_deref(), args.traces.as_deref()).await?;
    output::print(&format!("{place}\n"))?;
    connection.close().await
}

/// Asks for a page, and shows the progress of the search for it.
pub async fn write(connection: &Connection, request: WriteReportRequest) -> Result<Report, Failure> {
    let open = async || connection.models().write_report(request.clone()).await;
    let said = |m: WriteReportResponse| match m.event? {
        Event::Progress(fraction) => Some(Said::Progress(fraction)),
        Event::Report(report) => Some(Said::Result(report)),
    };
    study::result("discovers", open, said).await
}

/// How the page names a folder of traces: as seen from its own, where that is possible.
fn prefix(page: &Path, traces: &Path) -> String {
    let home = page.parent().unwrap_or(Path::new(""));
    let shown = traces.strip_prefix(home).unwrap_or(traces).display().to_string();
    if shown.is_empty() { String::from("./") } else { format!("{shown}/") }
}

/// Writes the page, its pictures and its traces; says where.
pub async fn save(
    connection: &Connection,
    report: &Report,
    page: &Path,
    svg: Option<&Path>,
    traces: Option<&Path>,
) -> Result<String, Failure> {
    let folder = |dir: &Path| {
        std::fs::create_dir_all(dir)
            .map_err(|e| Failure::input(format!("{}: {e}; give a folder", dir.display())))
    };
    output::file(page, report.html.as_bytes())?;
    let mut said = format!("Report: {}", page.display());
    if let Some(dir) = svg {
        folder(dir)?;
        for picture in &report.pictures {
            output::file(&dir.join(&picture.name), picture.svg.as_bytes())?;
        }
        said += &format!("\n{} pictures: {}", report.pictures.len(), dir.display());
    }
    if let Some(dir) = traces {
        folder(dir)?;
        for trace in &report.traces {
            let file = trace.strip_prefix("traces/").unwrap_or(trace);
            output::file(&dir.join(format!("{file}.mcap")), &connection.download(trace).await?)?;
        }
        said += &format!("\n{} traces: {}", report.traces.len(), dir.display());
    }
    Ok(said)
}
