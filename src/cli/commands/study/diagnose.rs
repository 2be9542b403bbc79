//! `diagnose`: shows where the model of a set-up fails, and ranks candidates for the missing effect.

use super::errors;
use super::ranking::ranking;
use crate::api::v1::{
    DiagnoseModelRequest, DiagnoseModelResponse, Diagnosis, diagnose_model_response::Event,
};
use crate::cli::connection::stream::{self, StreamEvent};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::{input, output};
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// Number of candidates in the table.
const CANDIDATES_IN_DIAGNOSIS: usize = 10;

#[derive(clap::Args)]
pub struct DiagnoseArgs {
    /// Scenes of one set-up: scene files, scene folders, or folders of scene folders.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Preset, id of a kept model (`vrdp show`), or model file [default: by the scenes' world].
    #[arg(long, value_name = "NAME|ID|FILE")]
    model: Option<String>,
    /// A formula of your own to rank too: a text such as `let k = 0.1; ax = -k * vx; ay = -k * vy`, or a file
    /// with it (see `vrdp revise --help`); may be repeated.
    #[arg(long, value_name = "TEXT|FILE")]
    formula: Vec<String>,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub async fn run(target: &Target, args: DiagnoseArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let scenes = input::scenes(&args.scenes)?.into_iter().collect::<Result<Vec<_>, _>>()?;
    let start = input::model("--model", args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let study = Some(connection.study(&scenes, start.as_ref()).await?);
    let mut candidates = vec![];
    for (k, given) in args.formula.iter().enumerate() {
        let name = given.contains('=').then(|| format!("formula_{}", k + 1));
        candidates.push(input::formula(given, name.as_deref())?);
    }
    let request = DiagnoseModelRequest { study, candidates };
    let open = async || connection.models().diagnose_model(request.clone()).await;
    let event = |m: DiagnoseModelResponse| match m.event? {
        Event::Progress(fraction) => Some(StreamEvent::Progress(fraction)),
        Event::Diagnosis(diagnosis) => Some(StreamEvent::Result(diagnosis)),
    };
    let found = stream::result("diagnosing", open, event).await?;
    let names: Vec<String> = scenes.iter().map(|s| s.name.clone()).collect();
    let [flag, place] = target.words();
    let text = text(&found, names.len()) + &output::next("discover", &args.scenes, &[&flag, &place]);
    output::result(args.json.as_deref(), &text, || to_json(&found, &names))?;
    connection.close().await
}

fn text(found: &Diagnosis, videos: usize) -> String {
    let summary = found.comparison.as_ref().map_or("", |c| c.summary.as_str());
    let mut text = match found.not_identifiable_reason.as_str() {
        "" => String::new(),
        why => format!("NOT_IDENTIFIABLE: {why}\n"),
    };
    text += &format!(
        "{summary}\n  reduced chi-square of the motion between contacts: {:.2}\n",
        found.free_motion_chi_square
    );
    for point in &found.change_points {
        let at = point.position.unwrap_or_default();
        text += &format!(
            "  a sudden change of motion without a visible contact: frame {} at ({:.2}, {:.2}) m, {:.0} standard deviations\n",
            point.frame, at.x, at.y, point.sigmas
        );
    }
    text + &ranking(&found.ranked, CANDIDATES_IN_DIAGNOSIS, videos)
}

fn to_json(found: &Diagnosis, names: &[String]) -> Value {
    let videos = found.comparison.as_ref().map_or(&[][..], |c| &c.videos);
    let scenes: Map<String, Value> =
        names.iter().zip(videos).map(|(name, v)| (name.clone(), errors::to_json(v))).collect();
    let ranked = |r: &crate::api::v1::RankedEffect| json!({ "kind": r.kind, "effect": r.effect, "log_evidence": r.log_evidence, "contact_log_evidence": r.contact_log_evidence, "held_out_rmse_m": r.held_out_rmse });
    let change_point = |j: &crate::api::v1::ChangePoint| {
        let scene = videos.iter().position(|v| v.video == j.video).and_then(|k| names.get(k));
        let (at, change) = (j.position.unwrap_or_default(), j.change.unwrap_or_default());
        json!({ "scene": scene, "frame": j.frame, "position": [at.x, at.y], "change": [change.x, change.y], "sigmas": j.sigmas })
    };
    let too_little = (!found.not_identifiable_reason.is_empty()).then_some(&found.not_identifiable_reason);
    json!({
        "not_identifiable": too_little,
        "scenes": scenes,
        "summary": found.comparison.as_ref().map(|c| c.summary.clone()),
        "free_motion_chi_square": found.free_motion_chi_square,
        "ranked": found.ranked.iter().map(ranked).collect::<Vec<_>>(),
        "change_points": found.change_points.iter().map(change_point).collect::<Vec<_>>(),
    })
}
