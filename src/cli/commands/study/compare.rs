//! `compare`: the residuals of each scene, by object and by kind of motion.

use super::{errors, side_by_side};
use crate::api::v1::{
    CompareModelsRequest, CompareModelsResponse, VideoComparison, compare_models_response::Event,
};
use crate::cli::connection::stream::{self, StreamEvent};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::progress::TaskProgress;
use crate::cli::output::revisions;
use crate::cli::{input, output};
use serde_json::{Map, json};
use std::path::PathBuf;

const SIDE_BY_SIDE: &str = "\
Two models side by side, by their errors, evidence, numbers, and where they differ most:

  vrdp compare 0a1b2c3d 4e5f6071 --data-dir lab       two kept models (`vrdp show` lists them) on their videos
  vrdp compare table 4e5f6071 SCENE... --data-dir lab a preset and a kept model
  vrdp compare table SCENE --against other.csv        a model and what another simulator says of the scene, as a scene file";

#[derive(clap::Args)]
#[command(after_help = SIDE_BY_SIDE)]
pub struct CompareArgs {
    /// Scene files, scene folders, or folders of scene folders. Before them one or two models: presets, ids of kept
    /// models, model files. With one model each scene is compared with it separately.
    #[arg(required = true, value_name = "MODEL|SCENE")]
    named: Vec<PathBuf>,
    /// Preset, id of a kept model (`vrdp show`), or model file to compare with [default: by the scene's world].
    #[arg(long, visible_alias = "model", value_name = "NAME|ID|FILE")]
    with: Option<String>,
    /// A second model beside the first, or a scene file (CSV) with the positions of another simulator.
    #[arg(long, value_name = "NAME|ID|FILE")]
    against: Option<String>,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub async fn run(target: &Target, args: CompareArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let (mut models, paths) = sorted(args.named);
    models.extend(args.with.iter().cloned());
    let has_tracks = args.against.as_ref().is_some_and(|file| is_csv(file));
    models.extend(args.against.iter().filter(|_| !has_tracks).cloned());
    let tracks = args.against.as_deref().filter(|_| has_tracks).map(std::path::Path::new);
    let scenes = input::scenes(&paths)?.into_iter().collect::<Result<Vec<_>, _>>()?;
    let with = match &models[..] {
        [a, b] if tracks.is_none() => {
            return side_by_side::models(target, [a, b], scenes, args.json.as_deref()).await;
        }
        [_, _, ..] => {
            return Err(Failure::input(format!("{}: at most two can be compared", models.join(", "))));
        }
        _ if tracks.is_some() && !scenes.is_empty() => {
            let model = models.first().map(String::as_str);
            return side_by_side::tracks(target, model, &scenes, tracks, args.json.as_deref()).await;
        }
        one => one.first(),
    };
    if scenes.is_empty() {
        return Err(Failure::input("one model and no scene is given; add a second model, or scenes"));
    }
    let start = input::model("--with", with.map(String::as_str))?;
    let connection = Connection::open(target).await?;
    let progress = TaskProgress::new(scenes.len());
    let (mut found, mut summaries, mut tables) = (Map::new(), vec![], String::new());
    for (i, scene) in scenes.iter().enumerate() {
        let request = connection.study(std::slice::from_ref(scene), start.as_ref()).await?;
        let request = CompareModelsRequest { study: Some(request), against: None };
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
            found.insert(scene.name.clone(), errors::to_json(video));
        }
        summaries.push(format!("{}: {}", scene.name, comparison.summary));
    }
    drop(progress);
    let value = || json!({ "scenes": found, "summary": summaries.join("\n") });
    output::result(args.json.as_deref(), &tables, value)?;
    connection.close().await
}

/// The models among what stands before the flags, and the paths of scenes.
fn sorted(named: Vec<PathBuf>) -> (Vec<String>, Vec<PathBuf>) {
    let (mut models, mut paths) = (vec![], vec![]);
    for path in named {
        let text = path.to_string_lossy().into_owned();
        match input::is_model(&text) {
            true => models.push(text),
            false => paths.push(path),
        }
    }
    (models, paths)
}

fn is_csv(file: &str) -> bool {
    std::path::Path::new(file).extension().is_some_and(|e| e.eq_ignore_ascii_case("csv"))
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
