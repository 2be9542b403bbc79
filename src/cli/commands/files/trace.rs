//! `trace`: shows what is in a trace file, checks it, and exports its numbers. It needs only the file.

use crate::cli::error::Failure;
use crate::cli::output;
use crate::recording::messages::{self as m, v1};
use crate::recording::{
    MAX_TIME, Message, RecordingError, ScanReport, ScannedItem, TraceReader, origin_difference, scan,
};
use prost::Message as _;
use serde_json::json;
use std::fs::File;
use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct TraceArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(clap::Subcommand)]
enum Action {
    /// Shows the content: topics, times, metadata and attachments.
    Info(FileArgs),
    /// Checks whether the file is complete; exit status 1 and a list of what is missing if not.
    Verify(FileArgs),
    /// Exports the numbers of one topic as CSV.
    Export(ExportArgs),
}

#[derive(clap::Args)]
struct FileArgs {
    #[arg(value_name = "FILE.mcap")]
    file: PathBuf,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

#[derive(clap::Args)]
struct ExportArgs {
    #[arg(value_name = "FILE.mcap")]
    file: PathBuf,
    /// The CSV file; `-`: standard output.
    #[arg(long, value_name = "FILE.csv", default_value = "-")]
    out: PathBuf,
    /// The topic (`vrdp trace info` lists them) [default: the simulated states, else the states after a fit]
    #[arg(long, value_name = "TOPIC")]
    topic: Option<String>,
}

pub fn run(args: TraceArgs) -> Result<(), Failure> {
    match args.action {
        Action::Info(named) => info(&named),
        Action::Verify(named) => verify(&named),
        Action::Export(export) => self::export(&export),
    }
}

/// A file that is not a trace is bad input; other errors are not.
pub fn failure(path: &Path, error: RecordingError) -> Failure {
    let message = format!("{}: {error}", path.display());
    match error {
        RecordingError::NoTrace | RecordingError::Missing { .. } | RecordingError::TooMuchWork { .. } => {
            Failure::input(message)
        }
        _ => Failure::other(message),
    }
}

pub fn open(path: &Path) -> Result<File, Failure> {
    let wrong = |e: std::io::Error| Failure::input(format!("{}: {e}; give a trace file", path.display()));
    let file = File::open(path).map_err(wrong)?;
    match file.metadata().map_err(wrong)?.is_file() {
        true => Ok(file),
        false => Err(Failure::input(format!("{}: is not a file; give a trace file", path.display()))),
    }
}

fn info(named: &FileArgs) -> Result<(), Failure> {
    let wrong = |e| failure(&named.file, e);
    let mut reader = TraceReader::open(open(&named.file)?).map_err(wrong)?;
    let metadata = reader.metadata().map_err(wrong)?;
    let [from, to] = reader.span();
    let (topics, attachments) = (reader.topics(), reader.attachments());
    let mut text = format!("{}: {} bytes, {from} to {to} s\n\n", named.file.display(), reader.size_bytes());
    let width = metadata.keys().map(String::len).max().unwrap_or(0);
    for (key, value) in &metadata {
        text += &format!("  {key:width$}  {value}\n");
    }
    let rows: Vec<Vec<String>> =
        topics.iter().map(|t| vec![t.name.clone(), t.schema.clone(), t.messages.to_string()]).collect();
    text += &format!("\n{}", output::table(&["topic", "schema", "messages"], &rows));
    let rows: Vec<Vec<String>> = attachments.iter().map(|(n, b)| vec![n.clone(), b.to_string()]).collect();
    text += &format!("\n{}", output::table(&["attachment", "bytes"], &rows));
    let value = json!({
        "bytes": reader.size_bytes(),
        "chunks": reader.chunks(),
        "from_s": from,
        "to_s": to,
        "metadata": metadata,
        "topics": topics.iter()
            .map(|t| json!({ "topic": t.name, "schema": t.schema, "messages": t.messages }))
            .collect::<Vec<_>>(),
        "attachments": attachments.iter()
            .map(|(name, bytes)| json!({ "name": name, "bytes": bytes }))
            .collect::<Vec<_>>(),
    });
    output::result(named.json.as_deref(), &text, || value)
}

fn verify(named: &FileArgs) -> Result<(), Failure> {
    let mut metadata = None;
    let report = scan(open(&named.file)?, &mut |item| match item {
        ScannedItem::Metadata(found) => metadata = Some(found),
        ScannedItem::Message { .. } | ScannedItem::Attachment { .. } => {}
    })
    .map_err(|e| failure(&named.file, e))?;
    let origin = metadata.as_ref().and_then(origin_difference);
    let missing = missing(&report);
    let value = json!({
        "whole": report.is_whole(),
        "bytes": report.bytes,
        "chunks": report.chunks,
        "messages": report.counts,
        "lost": missing.iter().map(|(topic, n)| json!({ "topic": topic, "messages": n })).collect::<Vec<_>>(),
        "damage": report.damage.iter()
            .map(|d| json!({ "from": d.from, "to": d.to, "what": d.what }))
            .collect::<Vec<_>>(),
        "origin_difference": origin,
    });
    let messages: u64 = report.counts.values().sum();
    let mut text = match report.is_whole() {
        true => format!("complete: {} chunks, {messages} messages; all checksums are right\n", report.chunks),
        false => format!("damaged: {} intact chunks with {messages} messages can be read\n", report.chunks),
    };
    for d in &report.damage {
        text += &format!("  bytes {} to {}: {}\n", d.from, d.to, d.what);
    }
    if let Some(why) = &origin {
        text += &format!("  {why}\n");
    }
    for (topic, n) in &missing {
        text += &format!("  missing on {topic}: {n} messages\n");
    }
    if !report.is_whole() && report.stated.is_none() {
        text += "  the summary is damaged too, so the number of missing messages is unknown\n";
    }
    output::result(named.json.as_deref(), &text, || value)?;
    match report.is_whole() {
        true => Ok(()),
        false => Err(Failure::other(format!(
            "{}: the file is damaged; request the simulation again to rebuild it",
            named.file.display()
        ))),
    }
}

/// Number of messages that the summary states and the file lacks, by topic.
fn missing(report: &ScanReport) -> Vec<(String, u64)> {
    let found = |topic: &String| report.counts.get(topic).copied().unwrap_or(0);
    let stated = report.stated.iter().flatten();
    stated.map(|(topic, n)| (topic.clone(), n.saturating_sub(found(topic)))).filter(|(_, n)| *n > 0).collect()
}

fn export(export: &ExportArgs) -> Result<(), Failure> {
    let wrong = |e| failure(&export.file, e);
    if export.out.as_os_str() != "-" {
        output::writable("--out", &export.out)?;
    }
    let mut reader = TraceReader::open(BufReader::new(open(&export.file)?)).map_err(wrong)?;
    let topics = reader.topics();
    let has = |name: &str| topics.iter().find(|t| t.name == name);
    let topic = match &export.topic {
        Some(name) => has(name),
        None => has(&m::STATES.name).or_else(|| has(&m::AFTER.name)),
    };
    let Some((topic, (header, rows))) = topic.and_then(|t| Some((t.name.clone(), table(&t.schema)?))) else {
        let good: Vec<&str> =
            topics.iter().filter(|t| table(&t.schema).is_some()).map(|t| t.name.as_str()).collect();
        let given = export.topic.as_deref().unwrap_or("the simulated states");
        let message =
            format!("--topic {given}: this topic has no numbers; choose one of {}", good.join(", "));
        return Err(Failure::input(message));
    };
    let out: Box<dyn Write> = match export.out.as_os_str() == "-" {
        true => Box::new(std::io::stdout().lock()),
        false => Box::new(File::create(&export.out).map_err(Failure::other)?),
    };
    let mut out = csv::Writer::from_writer(out);
    let written = out.write_record(header).and_then(|()| {
        for message in reader.messages(&[topic.as_str()], [0.0, MAX_TIME]) {
            for row in message.map_err(|e| std::io::Error::other(e.to_string())).map(|m| rows(&m))? {
                out.write_record(row)?;
            }
        }
        Ok(out.flush()?)
    });
    match written {
        Err(e) if is_broken_pipe(&e) => Ok(()),
        other => other.map_err(|e| Failure::other(format!("{}: {e}", export.file.display()))),
    }
}

/// A closed pipe at standard output is not an error.
fn is_broken_pipe(error: &csv::Error) -> bool {
    matches!(error.kind(), csv::ErrorKind::Io(e) if e.kind() == std::io::ErrorKind::BrokenPipe)
}

/// The rows of a message as texts.
type RowReader = fn(&Message) -> Vec<Vec<String>>;

/// Columns and rows of each kind of message that holds numbers; SI units.
fn table(schema: &str) -> Option<(&'static [&'static str], RowReader)> {
    Some(match schema {
        "vrdp.v1.TraceFrame" => (
            &["frame", "time_s", "object_id", "x", "y", "yaw", "vx", "vy", "spin", "roll_x", "roll_y", "sd"],
            state_rows,
        ),
        "vrdp.v1.TraceRollouts" => {
            (&["rollout", "frame", "time_s", "object_id", "x", "y", "yaw"], rollout_rows)
        }
        "vrdp.v1.TraceResiduals" => (&["frame", "time_s", "object_id", "x", "y"], residual_rows),
        "vrdp.v1.TraceEvent" => (
            &[
                "kind",
                "frame",
                "time_s",
                "object_ids",
                "x",
                "y",
                "normal_x",
                "normal_y",
                "impulse",
                "wall",
                "probability",
            ],
            event_rows,
        ),
        "vrdp.v1.TraceParameters" => {
            (&["name", "value", "sd", "unit", "identified", "low95", "high95"], parameter_rows)
        }
        "vrdp.v1.TraceIteration" => (&["iteration", "loss"], |m| {
            let i = v1::TraceIteration::decode(m.data.as_slice()).unwrap_or_default();
            vec![vec![i.iteration.to_string(), number(i.loss)]]
        }),
        "vrdp.v1.TraceRevision" => {
            (&["revision", "effect", "rmse", "held_out_rmse", "reduced_chi_square"], |m| {
                let r = v1::TraceRevision::decode(m.data.as_slice()).unwrap_or_default();
                let numbers = [r.rmse, r.held_out_rmse, r.reduced_chi_square].map(number);
                vec![[r.revision.to_string(), r.effect].into_iter().chain(numbers).collect()]
            })
        }
        _ => return None,
    })
}

fn state_rows(m: &Message) -> Vec<Vec<String>> {
    let row = v1::TraceFrame::decode(m.data.as_slice()).unwrap_or_default();
    let one = |s: &v1::TraceState| {
        let numbers = [s.x, s.y, s.yaw, s.vx, s.vy, s.spin, s.roll_x, s.roll_y].map(number);
        let head = [row.frame.to_string(), number(row.time), s.object_id.to_string()];
        let sd = s.sd.map(number).unwrap_or_default();
        head.into_iter().chain(numbers).chain([sd]).collect()
    };
    row.states.iter().map(one).collect()
}

fn rollout_rows(m: &Message) -> Vec<Vec<String>> {
    let row = v1::TraceRollouts::decode(m.data.as_slice()).unwrap_or_default();
    let objects = row.object_ids.len();
    let poses = row.x.iter().zip(&row.y).zip(&row.yaw).enumerate();
    let one = |(at, ((x, y), yaw)): (usize, ((&f32, &f32), &f32))| {
        let (rollout, id) = (at.checked_div(objects)?, row.object_ids.get(at.checked_rem(objects)?)?);
        let head = [rollout.to_string(), row.frame.to_string(), number(m.time), id.to_string()];
        (!x.is_nan()).then(|| head.into_iter().chain([*x, *y, *yaw].map(|v| v.to_string())).collect())
    };
    poses.filter_map(one).collect()
}

fn residual_rows(m: &Message) -> Vec<Vec<String>> {
    let row = v1::TraceResiduals::decode(m.data.as_slice()).unwrap_or_default();
    let one = |r: &v1::TraceResidual| {
        let id = r.object_id.to_string();
        vec![row.frame.to_string(), number(m.time), id, number(r.x), number(r.y)]
    };
    row.residuals.iter().map(one).collect()
}

fn event_rows(m: &Message) -> Vec<Vec<String>> {
    let e = v1::TraceEvent::decode(m.data.as_slice()).unwrap_or_default();
    let ids: Vec<String> = e.object_ids.iter().map(u32::to_string).collect();
    let optional = |v: Option<f64>| v.map(number).unwrap_or_default();
    vec![vec![
        e.kind,
        e.frame.to_string(),
        number(e.time),
        ids.join(" "),
        number(e.x),
        number(e.y),
        optional(e.normal_x),
        optional(e.normal_y),
        optional(e.impulse),
        e.wall,
        number(e.probability),
    ]]
}

fn parameter_rows(m: &Message) -> Vec<Vec<String>> {
    let all = v1::TraceParameters::decode(m.data.as_slice()).unwrap_or_default().parameters;
    let one = |p: v1::TraceParameter| {
        let [value, sd, low, high] = [p.value, p.sd, p.low95, p.high95].map(number);
        vec![p.name, value, sd, p.unit, p.identified.to_string(), low, high]
    };
    all.into_iter().map(one).collect()
}

/// The shortest text that parses to the same number.
fn number(value: f64) -> String {
    format!("{value:?}")
}
