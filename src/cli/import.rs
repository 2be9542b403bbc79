//! `import`: turns files of others into scene folders, and tells what it did.

use super::Target;
use super::connect::Connection;
use super::error::Failure;
use super::{input, output, progress};
use crate::api;
use crate::api::v1::{Box, Camera, CreateVideoRequest, Detection, Score, Video, detection};
use crate::scene::{
    AttributeScores, CLEVRER_CAMERA, DEFAULT_SIZE, Scene, is_tracker, observed_json, parse, parse_csv,
    parse_proposals, parse_tracker,
};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Of detections that do not say otherwise: frame rate (1/s) and deviation of an edge (px).
const FPS: f64 = 25.0;
const NOISE: f64 = 1.0;

/// What is read, for `--help`.
const FORMATS: &str = r#"FILE is known by its content; each becomes DIR/NAME/observed.json:
  annotation  CLEVRER's JSON with object_property and motion_trajectory; objects have a location (m), or an image_center
              (px) and the file a camera_matrix and image_size (without them: CLEVRER's camera)
  proposals   CLEVRER's derender proposals: JSON with frames of objects with a mask (COCO
              run-length) or box [left, top, width, height] (px), and scores
  CSV         columns id, t or frame, x, y, and where known yaw, visible, shape, size, mass, material, color; a unit
              behind a name, as in `x [mm]`; lines before it such as `# fps: 50`, `# unit: cm`, `# world: table`
  Tracker     the text that Tracker exports"#;

#[derive(clap::Args)]
#[command(after_help = FORMATS)]
pub struct Args {
    /// Files of any of the kinds below.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Folder that the scene folders are written into.
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Camera of detections: JSON of `calibrate`, or any with `camera_matrix` and `image_size` [default: CLEVRER's].
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Radius or half side of the objects of detections and of Tracker's text (m) [default: 0.2].
    #[arg(long, value_name = "METRES", value_parser = positive)]
    size: Option<f64>,
    /// Frame rate of detections (1/s) [default: 25].
    #[arg(long, value_parser = positive)]
    fps: Option<f64>,
    /// Deviation of an edge of a detection (px) [default: 1].
    #[arg(long, value_name = "PIXELS", value_parser = positive)]
    noise: Option<f64>,
    /// Unit of the lengths in Tracker's text [default: m].
    #[arg(long, value_enum)]
    unit: Option<Unit>,
    /// Writes what was done as JSON; `-`: to standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Unit {
    M,
    Cm,
    Mm,
}

fn positive(text: &str) -> Result<f64, &'static str> {
    text.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0).ok_or("give a number above 0")
}

pub async fn run(target: &Target, args: Args) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let connection = Connection::open(target).await?;
    let (mut told, mut failures, mut done) = (String::new(), vec![], Map::new());
    for path in &args.files {
        let name = name(path);
        let imported = match done.contains_key(&name) {
            true => Err(Failure::input(format!(
                "another of these files becomes {name} too: rename it, or give it another --out"
            ))),
            false => progress::during("imports", one(&connection, &args, path, &name)).await,
        };
        match imported {
            Ok((text, json)) => {
                told += &text;
                done.insert(name, json);
            }
            Err(failure) => failures.push(failure.at(&path.display().to_string())),
        }
    }
    match args.json.as_deref() {
        Some(file) => output::json(file, &json!({ "scenes": done }))?,
        None => output::print(&told)?,
    }
    connection.close().await?;
    Failure::of(failures, args.files.len())
}

/// Name of the scene that a file becomes.
fn name(path: &Path) -> String {
    let name = match path.file_name().is_some_and(|f| f == input::OBSERVED) {
        true => path.parent().and_then(Path::file_name),
        false => path.file_stem(),
    };
    name.map_or("scene".into(), |n| n.to_string_lossy().into_owned())
}

async fn one(
    connection: &Connection,
    args: &Args,
    path: &Path,
    name: &str,
) -> Result<(String, Value), Failure> {
    let text = input::text(path)?;
    let bad = |e: crate::scene::SceneError| Failure::input(e.to_string());
    let mut named = vec![];
    let found = kind(&text);
    let (kind, request) = match found {
        Kind::Proposals => ("proposals", detections(args, name, &text)?),
        Kind::Annotation => ("annotation", of_scene(&parse(name, &text).map_err(bad)?)),
        Kind::Tracker => {
            let scale = match args.unit {
                None | Some(Unit::M) => 1.0,
                Some(Unit::Cm) => 1e-2,
                Some(Unit::Mm) => 1e-3,
            };
            let (scene, names) =
                parse_tracker(name, &text, scale, args.size.unwrap_or(DEFAULT_SIZE)).map_err(bad)?;
            named = names;
            ("tracker", of_scene(&scene))
        }
        Kind::Csv => ("csv", of_scene(&parse_csv(name, &text).map_err(bad)?)),
        Kind::Unknown => {
            let message = "is neither a CLEVRER annotation (motion_trajectory), nor proposals (frames), nor CSV (a header with id, x, y \
                           and t or frame), nor Tracker's text (a header with t, x and y)";
            return Err(Failure::input(message));
        }
    };
    // Of a broken file its reader has said more.
    if let Some(flag) = args.useless(&found) {
        return Err(Failure::input(format!("{flag} says nothing of such a file: leave it out")));
    }
    let video = connection.create(request).await?;
    let linking = video.linking;
    let scene = api::scene_from_message(Some(video)).map_err(Failure::other)?;
    let file = args.out.join(name).join(input::OBSERVED);
    if file.canonicalize().ok().is_some_and(|f| path.canonicalize().is_ok_and(|p| p == f)) {
        return Err(Failure::input(format!(
            "would be overwritten; give another folder than {}",
            args.out.display()
        )));
    }
    std::fs::create_dir_all(args.out.join(name))
        .map_err(|e| Failure::other(format!("{}: {e}", args.out.display())))?;
    output::file(&file, observed_json(&scene).to_string().as_bytes())?;
    let (gaps, frames) = linking.map_or_else(|| gaps(&scene), |l| (l.gaps_bridged, l.frames_bridged));
    let (given, dropped) = linking.map_or((None, None), |l| (Some(l.detections), Some(l.detections_dropped)));
    let mut text = format!(
        "{}: {kind}, {} frames, {} objects, {gaps} gaps bridged ({frames} frames)",
        file.display(),
        scene.times.len(),
        scene.objects.len()
    );
    if let (Some(given), Some(dropped)) = (given, dropped) {
        text += &format!(", {dropped} of {given} detections dropped");
    }
    for (k, (object, track)) in scene.objects.iter().zip(&scene.tracks).enumerate() {
        let of = named.get(k).map_or(String::new(), |n| format!(" ({n})"));
        let (first, last) = (track.samples.first(), track.samples.last());
        text += &format!(
            "\n  {} {}{of}: {} samples, frames {} to {}",
            object.id,
            object.description(),
            track.samples.len(),
            first.map_or(0, |s| s.frame),
            last.map_or(0, |s| s.frame)
        );
    }
    text.extend(input::set_aside(&scene).map(|line| format!("\n  {line}")));
    let json = json!({
        "file": file.display().to_string(),
        "kind": kind,
        "frames": scene.times.len(),
        "objects": scene.objects.len(),
        "gaps_bridged": gaps,
        "frames_bridged": frames,
        "strays": scene.outliers.len(),
        "detections": given,
        "detections_dropped": dropped,
    });
    Ok((text + "\n", json))
}

enum Kind {
    Annotation,
    Proposals,
    Tracker,
    Csv,
    Unknown,
}

fn kind(text: &str) -> Kind {
    match serde_json::from_str::<Map<String, Value>>(text.trim_start_matches('\u{feff}')) {
        Ok(root) if root.contains_key("motion_trajectory") => Kind::Annotation,
        Ok(root) if root.contains_key("frames") => Kind::Proposals,
        // Its own reader says what is wrong with the JSON.
        Err(_) if text.trim_start().starts_with('{') => Kind::Annotation,
        Ok(_) => Kind::Unknown,
        _ if is_tracker(text) => Kind::Tracker,
        _ if text.contains([',', ';', '\t']) && !text.trim_start().starts_with('[') => Kind::Csv,
        _ => Kind::Unknown,
    }
}

impl Args {
    /// A flag that says nothing of this kind of file.
    fn useless(&self, kind: &Kind) -> Option<&'static str> {
        let detected = matches!(kind, Kind::Proposals);
        let sized = detected || matches!(kind, Kind::Tracker);
        let given = [
            ("--camera", self.camera.is_some() && !detected),
            ("--fps", self.fps.is_some() && !detected),
            ("--noise", self.noise.is_some() && !detected),
            ("--size", self.size.is_some() && !sized),
            ("--unit", self.unit.is_some() && !matches!(kind, Kind::Tracker)),
        ];
        given.into_iter().find(|(_, useless)| *useless).map(|(flag, _)| flag)
    }
}

fn of_scene(scene: &Scene) -> CreateVideoRequest {
    CreateVideoRequest { video: Some(api::video_message("", scene, true)), ..Default::default() }
}

fn detections(args: &Args, name: &str, text: &str) -> Result<CreateVideoRequest, Failure> {
    let camera = match &args.camera {
        Some(path) => camera(path)?,
        None => api::camera_message(&CLEVRER_CAMERA),
    };
    let proposals = parse_proposals(text, [camera.image_width, camera.image_height])
        .map_err(|e| Failure::input(e.to_string()))?;
    let scores = |scores: &AttributeScores| {
        scores
            .iter()
            .filter(|s| *s.1 > 0.0)
            .map(|(word, &score)| Score { word: word.clone(), score })
            .collect()
    };
    let one = |d: &crate::scene::Detection| Detection {
        frame: d.frame as u32,
        region: Some(detection::Region::Box(Box {
            left: d.bounds.left,
            top: d.bounds.top,
            width: d.bounds.right - d.bounds.left,
            height: d.bounds.bottom - d.bounds.top,
        })),
        color: scores(&d.color),
        material: scores(&d.material),
        shape: scores(&d.shape),
        score: d.score,
    };
    let video = Video {
        display_name: name.into(),
        fps: args.fps.unwrap_or(FPS),
        camera: Some(camera),
        image_noise_px: args.noise.unwrap_or(NOISE),
        ..Default::default()
    };
    Ok(CreateVideoRequest {
        video: Some(video),
        detections: proposals.detections.iter().map(one).collect(),
        object_size: args.size.unwrap_or(DEFAULT_SIZE),
        frame_count: proposals.frames as u32,
        ..Default::default()
    })
}

/// A camera of a JSON file.
fn camera(path: &Path) -> Result<Camera, Failure> {
    let wrong = |what: &str| Failure::input(format!("--camera {}: {what}", path.display()));
    let root: Value = serde_json::from_str(&input::text(path)?).map_err(|e| wrong(&e.to_string()))?;
    let numbers = |value: &Value| -> Vec<f64> {
        value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
    };
    let rows = root["camera_matrix"].as_array().map(Vec::as_slice).unwrap_or_default();
    let matrix: Vec<f64> = rows.iter().take(3).flat_map(numbers).collect();
    let [image_width, image_height] = numbers(&root["image_size"])[..] else {
        return Err(wrong("image_size is missing; give [width, height] in pixels"));
    };
    if matrix.len() != 12 {
        return Err(wrong("camera_matrix is not 3 rows of 4 numbers"));
    }
    Ok(Camera { matrix, image_width, image_height, ..Default::default() })
}

/// Gaps in the tracks, and the frames in them.
fn gaps(scene: &Scene) -> (u32, u32) {
    let steps = scene.tracks.iter().flat_map(|t| t.samples.windows(2)).map(|w| w[1].frame - w[0].frame - 1);
    steps.filter(|&s| s > 0).fold((0, 0), |(gaps, frames), s| (gaps + 1, frames + s as u32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_known_by_their_content() {
        assert!(matches!(kind(r#"{"motion_trajectory": []}"#), Kind::Annotation));
        assert!(matches!(kind(r#"{"frames": []}"#), Kind::Proposals));
        assert!(matches!(kind(r#"{"frames": "#), Kind::Annotation));
        assert!(matches!(kind("mass A\nt\tx\ty\n0\t1\t2\n"), Kind::Tracker));
        assert!(matches!(kind("# unit: mm\nid,t,x,y\n1,0,1,2\n"), Kind::Csv));
        assert!(matches!(kind("[1, 2]"), Kind::Unknown));
    }
}
