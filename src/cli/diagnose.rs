//! `diagnose`: where the model of a set-up fails, and ranked candidates for the missing effect.

use super::Target;
use super::connect::Connection;
use super::error::Failure;
use super::study::Said;
use super::{compare, input, output, study};
use crate::api::v1::{
    DiagnoseModelRequest, DiagnoseModelResponse, Diagnosis, diagnose_model_response::Event,
};
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// Candidates that a person is shown.
const SHOWN: usize = 10;

#[derive(clap::Args)]
pub struct Args {
    /// Scenes of one set-up: files, folders, or folders of scene folders.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Preset or model file [default: what suits the scenes' world].
    #[arg(long, value_name = "NAME|FILE")]
    model: Option<String>,
    /// A law of your own that is ranked too: a text such as `let k = 0.1; ax = -k * vx; ay = -k * vy`, or a file with it
    /// (see `vrdp revise --help`).
    #[arg(long, value_name = "TEXT|FILE")]
    formula: Vec<String>,
    /// Writes the result as JSON; `-`: to standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub async fn run(target: &Target, args: Args) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let scenes = input::scenes(&args.scenes)?.into_iter().collect::<Result<Vec<_>, _>>()?;
    let start = input::model(args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let study = Some(study::request(&connection, &scenes, start).await?);
    let mut candidates = vec![];
    for (k, given) in args.formula.iter().enumerate() {
        let name = given.contains('=').then(|| format!("formula_{}", k + 1));
        candidates.push(input::formula(given, name.as_deref())?);
    }
    let request = DiagnoseModelRequest { study, candidates };
    let open = async || connection.models().diagnose_model(request.clone()).await;
    let said = |m: DiagnoseModelResponse| match m.event? {
        Event::Progress(fraction) => Some(Said::Progress(fraction)),
        Event::Diagnosis(diagnosis) => Some(Said::Result(diagnosis)),
    };
    let found = study::result("diagnoses", open, said).await?;
    let names: Vec<String> = scenes.iter().map(|s| s.name.clone()).collect();
    match args.json.as_deref() {
        Some(target) => output::json(target, &to_json(&found, &names))?,
        None => output::print(&text(&found, names.len()))?,
    }
    connection.close().await
}

fn text(found: &Diagnosis, videos: usize) -> String {
    let summary = found.comparison.as_ref().map_or("", |c| c.summary.as_str());
    let mut text = match found.not_identifiable_reason.as_str() {
        "" => String::new(),
        why => format!("NOT_IDENTIFIABLE: {why}\n"),
    };
    text +=
        &format!("{summary}\n  between contacts: reduced chi-square {:.2}\n", found.free_motion_chi_square);
    for jump in &found.change_points {
        let at = jump.position.unwrap_or_default();
        text += &format!(
            "  a jump that no object explains: frame {} at ({:.2}, {:.2}) m, {:.0} sigmas\n",
            jump.frame, at.x, at.y, jump.sigmas
        );
    }
    text + &study::ranking(&found.ranked, SHOWN, videos)
}

fn to_json(found: &Diagnosis, names: &[String]) -> Value {
    let videos = found.comparison.as_ref().map_or(&[][..], |c| &c.videos);
    let scenes: Map<String, Value> =
        names.iter().zip(videos).map(|(name, v)| (name.clone(), compare::to_json(v))).collect();
    let ranked = |r: &crate::api::v1::RankedEffect| json!({ "kind": r.kind, "effect": r.effect, "log_evidence": r.log_evidence, "contact_log_evidence": r.contact_log_evidence, "held_out_rmse_m": r.held_out_rmse });
    let jump = |j: &crate::api::v1::ChangePoint| {
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
        "jumps": found.change_points.iter().map(jump).collect::<Vec<_>>(),
    })
}
