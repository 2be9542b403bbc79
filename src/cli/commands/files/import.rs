//! `import`: converts files of other programs to scene folders.

use crate::api;
use crate::api::v1::{Box, CreateVideoRequest, Detection, Linking, Score, Video, detection};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::progress;
use crate::cli::{input, output};
use crate::scene::{
    AttributeScores, CLEVRER_CAMERA, DEFAULT_SIZE, Object, Scene, SceneFile, TableDefaults, Track, decoded,
    holds_records, observed_json, parse_proposals, read_scene,
};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Default frame rate (1/s) of detections, and standard deviation of their edges (px).
const DEFAULT_FPS: f64 = 25.0;
const DEFAULT_NOISE: f64 = 1.0;

/// The file formats, for `--help`.
const FILE_FORMATS: &str = r#"The content of FILE decides its format; each file becomes DIR/NAME/observed.json:
  annotation  CLEVRER's JSON with object_property and motion_trajectory; objects have a location (m), or an image_center
              (px) and the file a camera_matrix and image_size (without them: CLEVRER's camera)
  proposals   CLEVRER's derender proposals: JSON with frames of objects with a mask (COCO
              run-length) or box [left, top, width, height] (px), and scores
  table       text with columns id, t or frame, x, y, and optionally yaw, visible, shape, size, mass, material, color; a name
              may have a unit, as in `x [mm]`; lines above may set `# fps: 50`, `# unit: cm`, `# world: table`; also as
              spreadsheets (.xlsx too), Tracker, DeepLabCut, SLEAP, TRex, idtracker.ai, trackpy and others write it
  records     lines of a log with names and values, JSON with records, XML of TrackMate and CVAT
  Tracker     a project of the program Tracker (.trk, .trz)
  video       MP4, MOV, MKV, WebM, AVI, GIF: its objects are found and followed; perception.json beside observed.json says how"#;

#[derive(clap::Args)]
#[command(after_help = FILE_FORMATS)]
pub struct ImportArgs {
    /// Files to convert; formats below.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Folder for the scene folders.
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Camera of detections or videos: the JSON of `calibrate`, or one with `camera_matrix` and `image_size` [default: CLEVRER's]
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Standard deviation of the edges of detections (px) [default: 1].
    #[arg(long, value_name = "PIXELS", value_parser = positive)]
    noise: Option<f64>,
    /// Finds the objects of videos by your own network: an ONNX model, with a JSON beside it that says what its outputs are.
    #[arg(long, value_name = "MODEL")]
    detector: Option<PathBuf>,
    #[command(flatten)]
    stated: StatedArgs,
    #[command(flatten)]
    view: input::ViewArgs,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

/// What holds where a file does not state it.
#[derive(clap::Args)]
pub struct StatedArgs {
    /// Radius or half side of objects where the file does not state it (m) [default: 0.2].
    #[arg(long, value_name = "METRES", value_parser = positive)]
    size: Option<f64>,
    /// Frame rate where the file does not state it (1/s) [default: 25].
    #[arg(long, value_parser = positive)]
    fps: Option<f64>,
    /// Unit of lengths where the table does not state it [default: m].
    #[arg(long, value_enum)]
    unit: Option<Unit>,
    /// Size of a pixel where the table does not state it (m).
    #[arg(long, value_name = "METRES", value_parser = positive)]
    scale: Option<f64>,
}

impl StatedArgs {
    pub fn defaults(&self) -> TableDefaults {
        let unit = self.unit.map(|unit| match unit {
            Unit::M => "m",
            Unit::Cm => "cm",
            Unit::Mm => "mm",
            Unit::Px => "px",
        });
        let unit = unit.map(String::from);
        TableDefaults { fps: self.fps, unit, scale: self.scale, size: self.size }
    }
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Unit {
    M,
    Cm,
    Mm,
    Px,
}

fn positive(text: &str) -> Result<f64, &'static str> {
    text.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0).ok_or("give a number above 0")
}

pub async fn run(target: &Target, args: ImportArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let connection = Connection::open(target).await?;
    let (mut lines, mut failures, mut done) = (String::new(), vec![], Map::new());
    for path in &args.files {
        let (name, place) = (name(path), path.display().to_string());
        let at = |failure: Failure| failure.at(&place);
        let imported = match done.contains_key(&name) {
            true => Err(at(Failure::input(format!(
                "another of these files also becomes {name}; rename one, or use another --out"
            )))),
            false => {
                let bytes = input::bytes(path);
                let imported = async { one(&connection, &args, (path, &bytes?), &name).await.map_err(at) };
                progress::during("importing", imported).await
            }
        };
        match imported {
            Ok((text, json)) => {
                lines += &text;
                done.insert(name, json);
            }
            Err(failure) => failures.push(failure),
        }
    }
    if let Some(first) = done.keys().next() {
        lines += &output::next("fit", &[args.out.join(first)], &[]);
    }
    output::result(args.json.as_deref(), &lines, || json!({ "scenes": done }))?;
    connection.close().await?;
    Failure::combined(failures, args.files.len())
}

/// Name of the scene that a file becomes.
pub fn name(path: &Path) -> String {
    if input::is_video_file(path) {
        return input::video_name(path);
    }
    let name = match path.file_name().is_some_and(|f| f == input::OBSERVED) {
        true => path.parent().and_then(Path::file_name),
        false => path.file_stem(),
    };
    name.map_or("scene".into(), |n| n.to_string_lossy().into_owned())
}

/// Imports one file: posts it, writes its scene file, and returns the message and the JSON about it.
async fn one(
    connection: &Connection,
    args: &ImportArgs,
    (path, bytes): (&Path, &[u8]),
    name: &str,
) -> Result<(String, Value), Failure> {
    let parsed = match input::is_video_file(path) {
        true => args.seen(path)?,
        false => args.parsed(name, bytes)?,
    };
    let video = connection.create(parsed.request).await?;
    let linking = video.linking.or(parsed.linking);
    let scene = api::scene_from_message(Some(video)).map_err(Failure::other)?;
    let file = args.out.join(name).join(input::OBSERVED);
    if file.canonicalize().ok().is_some_and(|f| path.canonicalize().is_ok_and(|p| p == f)) {
        return Err(Failure::input(format!(
            "the result would overwrite the input; use another --out than {}",
            args.out.display()
        )));
    }
    std::fs::create_dir_all(args.out.join(name))
        .map_err(|e| Failure::other(format!("{}: {e}", args.out.display())))?;
    let mut observed = observed_json(&scene);
    if let Some((report, _)) = &parsed.report {
        observed["times"] = json!(scene.times);
        output::file(&args.out.join(name).join("perception.json"), report.to_string().as_bytes())?;
    }
    output::file(&file, observed.to_string().as_bytes())?;
    let (kind, file) = (parsed.kind, file.display().to_string());
    let (gaps, frames) = linking.map_or_else(|| gaps(&scene), |l| (l.gaps_bridged, l.frames_bridged));
    let (given, dropped) = linking.map_or((None, None), |l| (Some(l.detections), Some(l.detections_dropped)));
    let mut text = format!(
        "{file}: {kind}, {} frames, {} objects, {gaps} gaps bridged ({frames} frames)",
        scene.times.len(),
        scene.objects.len()
    );
    if let (Some(given), Some(dropped)) = (given, dropped) {
        text += &format!(", {dropped} of {given} detections dropped");
    }
    text.extend(parsed.report.iter().map(|(_, line)| format!("\n  {line}")));
    text += &object_lines(&scene);
    text.extend(input::outlier_message(&scene).map(|line| format!("\n  {line}")));
    let json = json!({
        "file": file,
        "kind": kind,
        "frames": scene.times.len(),
        "objects": scene.objects.len(),
        "gaps_bridged": gaps,
        "frames_bridged": frames,
        "outliers": scene.outliers.len(),
        "detections": given,
        "detections_dropped": dropped,
    });
    Ok((text + "\n", json))
}

/// A line for each object.
fn object_lines(scene: &Scene) -> String {
    let line = |(object, track): (&Object, &Track)| {
        let (first, last) = (track.samples.first(), track.samples.last());
        format!(
            "\n  {} {}: {} samples, frames {} to {}",
            object.id,
            object.description(),
            track.samples.len(),
            first.map_or(0, |s| s.frame),
            last.map_or(0, |s| s.frame)
        )
    };
    scene.objects.iter().zip(&scene.tracks).map(line).collect()
}

/// A parsed file: the name of its format, and the request that posts it.
struct ImportedFile {
    kind: &'static str,
    request: CreateVideoRequest,
    /// How the objects of a video were found: as JSON, and in a line.
    report: Option<(Value, String)>,
    /// How detections were linked here.
    linking: Option<Linking>,
}

/// Whether a file holds detections.
fn holds_detections(bytes: &[u8]) -> bool {
    let is_braced = |text: &String| text.trim_start().starts_with('{');
    let text = decoded(bytes).ok().filter(is_braced);
    let root = text.and_then(|text| serde_json::from_str::<Map<String, Value>>(&text).ok());
    let is_one =
        |root: &Map<String, Value>| root.contains_key("frames") && !root.contains_key("motion_trajectory");
    // Frames of objects with positions or identities are tracks.
    root.is_some_and(|root| is_one(&root) && (has_unlinked(&root) || !holds_records(bytes)))
}

/// Whether frames hold objects with a box or a mask, of which none has an identity.
fn has_unlinked(root: &Map<String, Value>) -> bool {
    let list = |value: Option<&Value>| value.and_then(Value::as_array).cloned().unwrap_or_default();
    let objects: Vec<Value> =
        list(root.get("frames")).iter().flat_map(|frame| list(frame.get("objects"))).collect();
    let any = |names: &[&str]| objects.iter().any(|o| names.iter().any(|name| o.get(name).is_some()));
    any(&["box", "mask"]) && !any(&["id", "object_id", "track_id"])
}

impl ImportArgs {
    /// The tracks of a video, found by a detector if there is one.
    fn seen(&self, path: &Path) -> Result<ImportedFile, Failure> {
        let unused = [
            ("--fps", self.stated.fps.is_some()),
            ("--noise", self.noise.is_some() && self.detector.is_none()),
        ];
        if let Some((flag, _)) = unused.into_iter().find(|(_, given)| *given) {
            let message = format!("{flag} has no effect on a video; leave it out");
            return Err(Failure::input(message).at(&path.display().to_string()));
        }
        let view = input::VideoView {
            args: self.view.clone(),
            camera: self.camera.clone(),
            scale: self.stated.scale,
            size: self.stated.size,
        };
        if let Some(model) = &self.detector {
            let found = input::detect(path, model, &view, self.noise)?;
            let (report, linking) =
                ((found.report_json(), found.line()), api::linking_message(&found.linking));
            let request = input::post_request(&found.scene);
            return Ok(ImportedFile { kind: "video", request, report: Some(report), linking: Some(linking) });
        }
        let seen = input::see(path, &view)?;
        let report = Some((seen.report_json(), seen.line()));
        Ok(ImportedFile { kind: "video", request: input::post_request(&seen.scene), report, linking: None })
    }

    fn parsed(&self, name: &str, bytes: &[u8]) -> Result<ImportedFile, Failure> {
        let bad = |e: crate::scene::SceneError| Failure::input(e.to_string());
        let (kind, request) = if holds_detections(bytes) {
            ("proposals", detections(self, name, &decoded(bytes).map_err(bad)?)?)
        } else {
            let SceneFile { scene, kind, assumed } =
                read_scene(name, bytes, &self.stated.defaults()).map_err(bad)?;
            output::assumptions::add(&scene, assumed);
            (kind, input::post_request(&scene))
        };
        // After the parser: its error about a broken file says more.
        if let Some(flag) = self.unused_flag(kind) {
            return Err(Failure::input(format!("{flag} has no effect on this format; leave it out")));
        }
        Ok(ImportedFile { kind, request, report: None, linking: None })
    }

    /// A given flag that has no effect on this format.
    fn unused_flag(&self, kind: &str) -> Option<&'static str> {
        let (detected, stated) = (kind == "proposals", kind == "annotation");
        let given = [
            ("--camera", self.camera.is_some() && !detected),
            ("--detector", self.detector.is_some()),
            ("--fps", self.stated.fps.is_some() && stated),
            ("--noise", self.noise.is_some() && !detected),
            ("--size", self.stated.size.is_some() && stated),
            ("--unit", self.stated.unit.is_some() && (stated || detected)),
            ("--scale", self.stated.scale.is_some() && (stated || detected)),
        ];
        given.into_iter().find(|(_, unused)| *unused).map(|(flag, _)| flag)
    }
}

fn detections(args: &ImportArgs, name: &str, text: &str) -> Result<CreateVideoRequest, Failure> {
    let camera = match &args.camera {
        Some(path) => api::camera_message(&input::camera(path)?),
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
        features: d.features.clone(),
    };
    let video = Video {
        display_name: name.into(),
        fps: args.stated.fps.unwrap_or(DEFAULT_FPS),
        camera: Some(camera),
        image_noise_px: args.noise.unwrap_or(DEFAULT_NOISE),
        ..Default::default()
    };
    Ok(CreateVideoRequest {
        video: Some(video),
        detections: proposals.detections.iter().map(one).collect(),
        object_size: args.stated.size.unwrap_or(DEFAULT_SIZE),
        frame_count: proposals.frames as u32,
        ..Default::default()
    })
}

/// Number of gaps in the tracks, and of frames in them.
fn gaps(scene: &Scene) -> (u32, u32) {
    let steps = scene.tracks.iter().flat_map(|t| t.samples.windows(2)).map(|w| w[1].frame - w[0].frame - 1);
    steps.filter(|&s| s > 0).fold((0, 0), |(gaps, frames), s| (gaps + 1, frames + s as u32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_content_decides_the_format() {
        let kind = |text: &str| match holds_detections(text.as_bytes()) {
            true => Ok("proposals"),
            false => read_scene("a", text.as_bytes(), &TableDefaults::default()).map(|file| file.kind),
        };
        assert_eq!(kind(r#"{"frames": []}"#), Ok("proposals"));
        assert_eq!(kind(r#"{"frames": [{"objects": [{"mask": {"size": [1, 1]}}]}]}"#), Ok("proposals"));
        let tracks = r#"{"frames": [{"objects": [{"id": 1, "x": 0, "y": 0}]}, {"objects": [{"id": 1, "x": 1, "y": 0}]}]}"#;
        assert_eq!(kind(tracks), Ok("csv"));
        let boxes =
            r#"{"frames": [{"objects": [{"box": [10, 20, 4, 6]}]}, {"objects": [{"box": [12, 20, 4, 6]}]}]}"#;
        assert_eq!(kind(boxes), Ok("proposals"));
        assert_eq!(kind(&boxes.replace("{\"box\"", "{\"id\": 3, \"box\"")), Ok("csv"));
        assert_eq!(kind("mass A\nt\tx\ty\n0\t1\t2\n1\t1\t2\n"), Ok("csv"));
        assert_eq!(kind("# unit: mm\nid,t,x,y\n1,0,1,2\n1,1,1,2\n"), Ok("csv"));
        // The parser of annotations explains what is wrong with JSON.
        for (text, place) in [
            (r#"{"frames": "#, "(file): is not JSON"),
            ("[1, 2]", "(file): is a list"),
            (r#"{"motion_trajectory": []}"#, "object_property"),
        ] {
            let message = kind(text).unwrap_err().to_string();
            assert!(message.contains(place), "{message}");
        }
    }
}
