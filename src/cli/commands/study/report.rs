//! `report`: writes the result of a discovery, and answers, as one HTML page.

use crate::api::v1::{Report, WriteReportRequest, WriteReportResponse, write_report_response::Event};
use crate::cli::commands::scene::ask;
use crate::cli::connection::stream::{self, StreamEvent};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::input::{self, ModelArgument};
use crate::cli::output;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct ReportArgs {
    /// Scenes of one set-up: scene files, scene folders, or folders of scene folders.
    /// With the id of a kept model they may be left out.
    #[arg(value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// The HTML file; it needs no network. `-`: to standard output.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Also writes each picture as an SVG file into this folder.
    #[arg(long, value_name = "DIR")]
    svg: Option<PathBuf>,
    /// Also writes the traces into this folder; the page links to them.
    #[arg(long, value_name = "DIR")]
    traces: Option<PathBuf>,
    /// A question about the first scene that the page answers (see `vrdp ask --help`); may be repeated.
    #[arg(long, value_name = "TEXT")]
    question: Vec<String>,
    /// A lexicon that `learn` wrote: the page shows which objects its words fit, and answers with them.
    #[arg(long, value_name = "FILE")]
    lexicon: Option<PathBuf>,
    /// Preset or model file from which the search starts [default: by the scenes' world]; or the id of a kept model
    /// (`vrdp show`), which is shown as it is, beside the first one of its history.
    #[arg(long, value_name = "NAME|ID|FILE")]
    model: Option<String>,
    /// Largest number of effects to add [default: 2].
    #[arg(long, value_name = "N")]
    max_effects: Option<u32>,
    /// Shows a second model beside that of --model, and searches nothing: a preset, an id, or a model file.
    #[arg(long, value_name = "NAME|ID|FILE", requires = "model", conflicts_with = "max_effects")]
    against: Option<String>,
}

pub async fn run(target: &Target, args: ReportArgs) -> Result<(), Failure> {
    output::writable("--out", &args.out)?;
    let scenes = input::scenes(&args.scenes)?.into_iter().collect::<Result<Vec<_>, _>>()?;
    let start = input::model("--model", args.model.as_deref())?;
    let against = input::model("--against", args.against.as_deref())?;
    let is_kept = matches!(start, Some(ModelArgument::Kept { .. }));
    if scenes.is_empty() && !is_kept {
        return Err(Failure::input("no scene is given; name scenes, or the id of a kept model with --model"));
    }
    let connection = Connection::open(target).await?;
    let study = match scenes.is_empty() {
        true => connection.kept_study(start.as_ref()).await?,
        false => connection.study(&scenes, start.as_ref()).await?,
    };
    let against = match &against {
        None => None,
        Some(_) => Some(connection.study_of(study.videos.clone(), against.as_ref()).await?),
    };
    let as_is = is_kept || against.is_some();
    let choices: [&str; 0] = [];
    let questions = args.question.iter().map(|q| ask::request(String::new(), q, &choices)).collect();
    let trace_prefix = args.traces.as_deref().map(|dir| prefix(&args.out, dir)).unwrap_or_default();
    let (study, max_effects) = (Some(study), args.max_effects);
    let lexicon = connection.lexicon(args.lexicon.as_deref()).await?;
    let request = WriteReportRequest { study, max_effects, questions, trace_prefix, as_is, against, lexicon };
    let report = write(&connection, request).await?;
    let place = save(&connection, &report, &args.out, args.svg.as_deref(), args.traces.as_deref()).await?;
    match args.out.as_os_str() == "-" {
        true => output::tell(&place),
        false => output::print(&format!("{place}\n"))?,
    }
    connection.close().await
}

/// Requests a page and shows the progress of its search.
pub async fn write(connection: &Connection, request: WriteReportRequest) -> Result<Report, Failure> {
    let open = async || connection.models().write_report(request.clone()).await;
    let event = |m: WriteReportResponse| match m.event? {
        Event::Progress(fraction) => Some(StreamEvent::Progress(fraction)),
        Event::Report(report) => Some(StreamEvent::Result(report)),
    };
    stream::result("writing the report", open, event).await
}

/// The path of the folder of traces, relative to the page where possible.
fn prefix(page: &Path, traces: &Path) -> String {
    let home = page.parent().unwrap_or(Path::new(""));
    let shown = traces.strip_prefix(home).unwrap_or(traces).display().to_string();
    if shown.is_empty() { String::from("./") } else { format!("{shown}/") }
}

/// Writes the page, its pictures and its traces; returns lines that say where.
pub async fn save(
    connection: &Connection,
    report: &Report,
    page: &Path,
    svg: Option<&Path>,
    traces: Option<&Path>,
) -> Result<String, Failure> {
    let folder = |dir: &Path| {
        std::fs::create_dir_all(dir)
            .map_err(|e| Failure::input(format!("{}: {e}; give a folder that can be created", dir.display())))
    };
    let mut places = format!("Report: {}", page.display());
    match page == Path::new("-") {
        true => {
            output::print(&report.html)?;
            places = "Report: standard output".into();
        }
        false => output::file(page, report.html.as_bytes())?,
    }
    if let Some(dir) = svg {
        folder(dir)?;
        for picture in &report.pictures {
            output::file(&dir.join(&picture.name), picture.svg.as_bytes())?;
        }
        places += &format!("\n{} pictures: {}", report.pictures.len(), dir.display());
    }
    if let Some(dir) = traces {
        folder(dir)?;
        for trace in &report.traces {
            let file = trace.strip_prefix("traces/").unwrap_or(trace);
            output::file(&dir.join(format!("{file}.mcap")), &connection.download(trace).await?)?;
        }
        places += &format!("\n{} traces: {}", report.traces.len(), dir.display());
    }
    Ok(places)
}
