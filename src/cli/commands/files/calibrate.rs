//! `calibrate`: estimates a camera from points whose image and world positions are known.

use crate::api::v1::{CalibrateCameraRequest, CalibrateCameraResponse, PointPair};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::progress;
use crate::cli::{input, output};
use crate::scene::parse_pairs;
use serde_json::{Value, json};
use std::path::PathBuf;

/// The file formats, for `--help`.
const POINT_FORMATS: &str = r#"FILE is JSON, one of:
  points      {"image_size": [480, 320], "pairs": [{"image": [u, v], "world": [x, y, z]}, ...]}
  a table     {"image_size": [480, 320], "table": {"x": [lo, hi], "y": [lo, hi]},
               "corners": [[u, v], [u, v], [u, v], [u, v]]}
              corners at (x lo, y lo), (x hi, y lo), (x hi, y hi), (x lo, y hi); height 0
  a scene     a CLEVRER annotation whose objects have both `location` and `image_center`, or its folder
Pixels count from the upper left corner of the image, u to the right and v down; the world is in metres, z up (0 if left out).
Six points that are not in one plane determine the camera. Four points in a plane determine it at that height only.
The points of all files are pooled: they must be of one camera."#;

#[derive(clap::Args)]
#[command(after_help = POINT_FORMATS)]
pub struct CalibrateArgs {
    /// Files of points of one camera; formats below.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Writes the result as JSON (`import --camera` reads it); `-`: to standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub async fn run(target: &Target, args: CalibrateArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let mut request = CalibrateCameraRequest::default();
    // The number of pairs of each file: outliers are numbered through all files.
    let mut counts = vec![];
    for path in &args.files {
        let path = if path.is_dir() { &path.join(input::OBSERVED) } else { path };
        let place = path.display().to_string();
        let (pairs, [width, height]) =
            parse_pairs(&input::text(path)?).map_err(|e| Failure::input(e.to_string()).at(&place))?;
        if !counts.is_empty() && [request.image_width, request.image_height] != [width, height] {
            let message = format!(
                "image_size is {width} x {height}, but {} x {} in the files before; give files of one camera",
                request.image_width, request.image_height
            );
            return Err(Failure::input(message).at(&place));
        }
        (request.image_width, request.image_height) = (width, height);
        counts.push((place, pairs.len()));
        let pair = |p: crate::scene::PointPair| {
            let ([u, v], [x, y, z]) = (p.image, p.world);
            PointPair { u, v, x, y, z }
        };
        request.pairs.extend(pairs.into_iter().map(pair));
    }
    let size = [request.image_width, request.image_height];
    let given = request.pairs.len();
    let connection = Connection::open(target).await?;
    let found =
        progress::during("calibrating", connection.videos().calibrate_camera(request)).await?.into_inner();
    output::result(args.json.as_deref(), &text(&found, given, &counts), || to_json(&found, size))?;
    connection.close().await
}

fn text(found: &CalibrateCameraResponse, given: usize, counts: &[(String, usize)]) -> String {
    let camera = found.camera.clone().unwrap_or_default();
    let mut text = String::from("camera matrix (world in m to pixels)\n");
    for row in camera.matrix.chunks(4) {
        let cells: Vec<String> = row.iter().map(|v| format!("{v:12.5}")).collect();
        text += &format!("  {}\n", cells.join(" "));
    }
    text += &format!(
        "reprojection error {:.3} px per coordinate over {} of {given} points; {} outliers are ignored\n",
        found.reprojection_error,
        given - found.outliers.len(),
        found.outliers.len()
    );
    let mut first = 0;
    for (place, count) in counts {
        let own = found.outliers.iter().map(|&i| i as usize).filter(|i| (first..first + count).contains(i));
        let own: Vec<String> = own.take(10).map(|i| (i - first).to_string()).collect();
        if !own.is_empty() {
            text += &format!("  outliers in {place}: pairs {}\n", own.join(", "));
        }
        first += count;
    }
    text += &format!("focal length {:.1} +- {:.1} px\n", found.focal_length, found.focal_length_sd);
    if let [x, y, z] = found.position[..] {
        text += &format!("camera at {x:.3}, {y:.3}, {z:.3} m\n");
    }
    if found.planar {
        text += "all points lie in one plane: at other heights the camera is less accurate\n";
    }
    text
}

fn to_json(found: &CalibrateCameraResponse, size: [f64; 2]) -> Value {
    let matrix = found.camera.as_ref().map(|c| c.matrix.chunks(4).map(<[f64]>::to_vec).collect::<Vec<_>>());
    json!({
        "camera_matrix": matrix,
        "image_size": size,
        "reprojection_error_px": found.reprojection_error,
        "outliers": found.outliers,
        "planar": found.planar,
        "focal_length_px": found.focal_length,
        "focal_length_sd_px": found.focal_length_sd,
        "position_m": found.position,
    })
}
