//! `compare`: the residuals of each scene, by object and by kind of motion.

use crate::api::v1::{
    CompareModelsRequest, CompareModelsResponse, VideoComparison, compare_models_response::Event,
};
use crate::cli::connection::stream::{self, StreamEvent};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::progress::TaskProgress;
use crate::cli::output::revisions;
use crate::cli::{input, output};
use serde_json::{Map, Value, json};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct CompareArgs {
    /// Scene files, scene folders, or folders of scene folders; each scene is fitted separately.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Preset or model file to compare with [default: by the scene's world].
    #[arg(long, visible_alias = "model", value_name = "NAME|FILE")]
    with: Option<String>,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub async fn run(target: &Target, args: CompareArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let scenes = input::scenes(&args.scenes)?.into_iter().collect::<Result<Vec<_>, _>>()?;
    let start = input::model("--with", args.with.as_deref())?;
    let connection = Connection::open(target).await?;
    let progress = TaskProgress::new(scenes.len());
    let (mut found, mut summaries, mut tables) = (Map::new(), vec![], String::new());
    for (i, scene) in scenes.iter().enumerate() {
        let request = connection.study(std::slice::from_ref(scene), start.clone()).await?;
        let request = CompareModelsRequest { study: Some(request) };
        let at = |e: Failure| e.at(&scene.name);
        let open = async || connection.models().compare_models(request.clone()).await;
        let event = |m: CompareModelsResponse| match m.event? {
            Event::Progress(fraction) => Some(StreamEvent::Progress(fraction)),
            Event::Comparison(comparison) => Some(StreamEvent::Result(comparison)),
        };
        let show = |fraction: f64| progress.show(&format!("comparing {}", scene.name), i, fraction);
        let comparison = stream::final_result(open, event, show).await.map_err(at)?;
        if let Some(video) = comparison.videos.first() {
            tables += &format!("{}: {}\n{}\n", scene.name, comparison.summary, table(video));
            found.insert(scene.name.clone(), to_json(video));
        }
        summaries.push(format!("{}: {}", scene.name, comparison.summary));
    }
    drop(progress);
    let value = || json!({ "scenes": found, "summary": summaries.join("\n") });
    output::result(args.json.as_deref(), &tables, value)?;
    connection.close().await
}

fn table(video: &VideoComparison) -> String {
    let row = |name: String, rmse: f64, chi: f64, last: String| {
        vec![name, format!("{:.2}", 1e3 * rmse), format!("{chi:.2}"), last]
    };
    let objects = video.objects.iter().map(|o| {
        let worst = format!("{:.1} mm at frame {}", 1e3 * o.worst, o.worst_frame);
        row(format!("object {}", o.object_id), o.rmse, o.reduced_chi_square, worst)
    });
    let regimes = video
        .regimes
        .iter()
        .map(|r| row(r.regime.clone(), r.rmse, r.reduced_chi_square, format!("{} frames", r.frames)));
    let rows: Vec<Vec<String>> = objects.chain(regimes).collect();
    format!(
        "{}  noise {:.2} mm, rmse {:.2} mm, held out {:.2} mm, reduced chi-square {:.2}\n{}",
        output::table(&["", "rmse mm", "chi-square", ""], &rows),
        1e3 * video.noise_sigma,
        1e3 * video.rmse,
        1e3 * video.held_out_rmse,
        video.reduced_chi_square,
        revisions::HELD_OUT,
    )
}

pub fn to_json(video: &VideoComparison) -> Value {
    let object = |o: &crate::api::v1::ObjectComparison| {
        json!({
            "object_id": o.object_id,
            "rmse_m": o.rmse,
            "worst_m": o.worst,
            "worst_frame": o.worst_frame,
            "reduced_chi_square": o.reduced_chi_square,
            "autocorrelation": o.autocorrelation,
        })
    };
    let regime = |r: &crate::api::v1::Regime| {
        json!({
            "regime": r.regime,
            "rmse_m": r.rmse,
            "reduced_chi_square": r.reduced_chi_square,
            "frames": r.frames,
        })
    };
    json!({
        "rmse_m": video.rmse,
        "noise_sigma_m": video.noise_sigma,
        "reduced_chi_square": video.reduced_chi_square,
        "held_out_rmse_m": video.held_out_rmse,
        "objects": video.objects.iter().map(object).collect::<Vec<_>>(),
        "regimes": video.regimes.iter().map(regime).collect::<Vec<_>>(),
    })
}
