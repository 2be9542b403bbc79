//! Reads video files: frames to tracks, with what the user knows of the view.

use super::files::{bytes, last};
use super::stills;
use crate::cli::error::Failure;
use crate::cli::output;
use crate::media::{MAX_VIDEO_BYTES, MediaError, Video, VideoFrame, is_video};
use crate::num::Stopped;
use crate::perception::{Perception, PerceptionError, PerceptionOptions, PerceptionReport, View, perceive};
use crate::scene::{CLEVRER_CAMERA, Camera, Scene, Table};
use serde_json::{Value, json};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Name of the video in the folder of a scene, and of the camera beside it.
pub const VIDEO: &str = "video.mp4";
const CAMERA: &str = "camera.json";
/// Extensions of video files.
const VIDEOS: [&str; 9] = ["mp4", "mov", "m4v", "mkv", "webm", "avi", "gif", "png", "jpg"];
/// Bytes at the start of a file that show whether it is a video.
const HEAD: u64 = 64;

/// What the user knows of the view of a video.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct ViewArgs {
    /// Where the camera of a video stands: `camera` (as --camera or camera.json has it) or straight above [default: camera].
    #[arg(long, value_enum)]
    pub view: Option<ViewKind>,
    /// Radius of the balls in a video (m); it gives the scale of a view from above.
    #[arg(long, value_name = "METRES", value_parser = positive)]
    pub ball_radius: Option<f64>,
    /// Cushions of the table in a video (m).
    #[arg(long, value_name = "X0,X1,Y0,Y1", value_parser = table)]
    pub table: Option<Table>,
    /// Picture of the empty table, from the camera of the video.
    #[arg(long, value_name = "PICTURE")]
    pub background: Option<PathBuf>,
    /// Program that decodes videos [default: vrdp itself].
    #[arg(long, value_enum)]
    pub decoder: Option<Decoder>,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViewKind {
    Camera,
    Top,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decoder {
    Own,
    /// The `ffmpeg` on the path, for codecs that vrdp does not decode.
    Ffmpeg,
}

fn positive(text: &str) -> Result<f64, &'static str> {
    text.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0).ok_or("give a number above 0")
}

fn table(text: &str) -> Result<Table, &'static str> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x0, x1, y0, y1]) if x0 < x1 && y0 < y1 => Ok(Table { x: [x0, x1], y: [y0, y1] }),
        _ => Err("give four numbers: x low, x high, y low, y high"),
    }
}

/// The view, with the lengths that other options give.
#[derive(Clone, Debug, Default)]
pub struct VideoView {
    pub args: ViewArgs,
    pub camera: Option<PathBuf>,
    /// Metres per pixel of a view from above.
    pub scale: Option<f64>,
    /// Radius or half side of the bodies (m).
    pub size: Option<f64>,
}

/// The scene of a video, and how it was seen.
pub struct SeenVideo {
    pub scene: Scene,
    pub report: PerceptionReport,
    /// Of computation (s).
    pub seconds: f64,
}

impl SeenVideo {
    /// The report as JSON.
    pub fn report_json(&self) -> Value {
        let mut report = serde_json::to_value(&self.report).unwrap_or_default();
        report["seconds"] = json!(self.seconds);
        report["frames_per_second"] = json!(self.report.frames as f64 / self.seconds.max(1e-9));
        report
    }

    /// One line: how much was seen, and what was not.
    pub fn line(&self) -> String {
        let unexplained = match self.report.unexplained.len() {
            0 => String::new(),
            n => format!(", {n} regions that are no body"),
        };
        format!(
            "{} frames of {}, {:.0} frames/s{unexplained}",
            self.report.frames,
            self.report.format,
            self.report.frames as f64 / self.seconds.max(1e-9)
        )
    }
}

/// Whether a file is a video, by its content.
pub fn is_video_file(path: &Path) -> bool {
    let mut head = vec![];
    let read = std::fs::File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
    path.is_file() && read.is_ok() && is_video(&head)
}

/// Whether a file in a folder of scenes is a video, by its name.
pub fn is_named_video(path: &Path) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    extension.is_some_and(|e| VIDEOS[..7].contains(&&*e)) && path.is_file()
}

/// Name of the scene that a video becomes: its folder's where the file is called `video`, else the file's stem.
pub fn video_name(path: &Path) -> String {
    let stem = last(path.file_stem()).unwrap_or("video".into());
    let whole = path.canonicalize().unwrap_or(path.to_path_buf());
    let folder = whole.parent().and_then(|p| last(p.file_name()));
    folder.filter(|_| stem == "video").unwrap_or(stem)
}

/// Finds the objects of a video and follows them.
pub fn see(path: &Path, view: &VideoView) -> Result<SeenVideo, Failure> {
    let place = path.display().to_string();
    let start = Instant::now();
    let video = open(path, view.args.decoder).map_err(|f| f.at(&place))?;
    let options = view.options(path)?;
    let progress = Mutex::new(output::progress::TaskProgress::new(1));
    let stop = |fraction: f64| -> Result<(), Stopped> {
        progress.lock().unwrap_or_else(PoisonError::into_inner).show("watching the video", 0, fraction);
        Ok(())
    };
    let seen = perceive(&video, &options, &stop).map_err(|e| Failure::input(advice(&e)).at(&place))?;
    drop(progress);
    let Perception { scene, report, stills } = seen;
    let scene = scene.validate().map_err(|e| Failure::input(e.to_string()).at(&place))?;
    stills::keep(&scene, stills);
    report.warnings.iter().for_each(|warning| output::tell(&format!("{}: {warning}", scene.name)));
    Ok(SeenVideo { scene, report, seconds: start.elapsed().as_secs_f64() })
}

/// The error, with the options that mend it.
fn advice(error: &PerceptionError) -> String {
    let flags = match error {
        PerceptionError::NoScale => " (--scale METRES, or --ball-radius METRES)",
        PerceptionError::ImageSize { .. } => " (--camera FILE, or --view top)",
        PerceptionError::BackgroundSize { .. } => " (--background PICTURE)",
        _ => "",
    };
    format!("{error}{flags}")
}

pub(super) fn open(path: &Path, decoder: Option<Decoder>) -> Result<Video, Failure> {
    if decoder == Some(Decoder::Ffmpeg) {
        return Video::open(decoded_by_ffmpeg(path)?).map_err(|e| Failure::input(e.to_string()));
    }
    Video::open(bytes(path)?).map_err(|e| match e {
        MediaError::Codec { .. } | MediaError::Feature { .. } => {
            Failure::input(format!("{e}; or give --decoder ffmpeg, where that program is installed"))
        }
        e => Failure::input(e.to_string()),
    })
}

/// The video with all frames as they are, in a codec that is read, by a process that reads this one file only.
fn decoded_by_ffmpeg(path: &Path) -> Result<Vec<u8>, Failure> {
    let mut child = Command::new("ffmpeg")
        .args(["-nostdin", "-v", "error", "-protocol_whitelist", "file,pipe", "-i"])
        .arg(path)
        .args(["-an", "-fps_mode", "passthrough", "-c:v", "mjpeg", "-q:v", "2", "-pix_fmt", "yuvj420p"])
        .args(["-f", "matroska", "pipe:1"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| {
            Failure::input(format!("--decoder ffmpeg: {e}; install ffmpeg, or leave the flag out"))
        })?;
    let mut found = vec![];
    if let Some(out) = child.stdout.take() {
        out.take(MAX_VIDEO_BYTES as u64 + 1).read_to_end(&mut found).map_err(Failure::other)?;
    }
    if found.len() > MAX_VIDEO_BYTES {
        let _ = child.kill();
        let _ = child.wait();
        return Err(Failure::input(format!("has more than {MAX_VIDEO_BYTES} bytes decoded; cut the video")));
    }
    let done = child.wait_with_output().map_err(Failure::other)?;
    let said = String::from_utf8_lossy(&done.stderr);
    match done.status.success() {
        true => Ok(found),
        false => Err(Failure::input(format!("ffmpeg: {}", said.lines().next().unwrap_or("it failed")))),
    }
}

impl VideoView {
    pub(super) fn options(&self, path: &Path) -> Result<PerceptionOptions, Failure> {
        let radius = self.args.ball_radius;
        let above = match self.args.view {
            Some(view) => view == ViewKind::Top,
            None => self.camera.is_none() && (self.scale.is_some() || radius.is_some()),
        };
        let beside = path.parent().map(|folder| folder.join(CAMERA)).filter(|file| file.is_file());
        let view = match (above, self.camera.clone().or(beside)) {
            (true, _) => View::Above { scale: self.scale },
            (false, Some(file)) => View::Calibrated(camera(&file)?),
            (false, None) => View::Calibrated(CLEVRER_CAMERA),
        };
        let background = self.args.background.as_deref().map(picture).transpose()?;
        let usual = PerceptionOptions::of_view(video_name(path), view, radius, self.size);
        Ok(PerceptionOptions { table: self.args.table, background, ..usual })
    }
}

fn picture(path: &Path) -> Result<VideoFrame, Failure> {
    let at = |e: MediaError| Failure::input(format!("--background {}: {e}", path.display()));
    Video::first_frame(bytes(path)?).map_err(at)
}

/// Reads a camera from a JSON file.
pub fn camera(path: &Path) -> Result<Camera, Failure> {
    let wrong = |what: &str| Failure::input(format!("camera {}: {what}", path.display()));
    let root: Value = serde_json::from_slice(&bytes(path)?).map_err(|e| wrong(&e.to_string()))?;
    let numbers = |value: &Value| -> Vec<f64> {
        value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
    };
    let rows = root["camera_matrix"].as_array().map(Vec::as_slice).unwrap_or_default();
    let rows: Vec<[f64; 4]> = rows.iter().filter_map(|row| numbers(row).try_into().ok()).collect();
    let [width, height] = numbers(&root["image_size"])[..] else {
        return Err(wrong("image_size is missing; give [width, height] in pixels"));
    };
    match rows[..] {
        [a, b, c] | [a, b, c, _] => Ok(Camera { matrix: [a, b, c], image_size: [width, height] }),
        _ => Err(wrong("camera_matrix is not 3 rows of 4 numbers; give the JSON of `vrdp calibrate`")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_video_is_named_after_its_folder_or_its_file() {
        assert_eq!(video_name(Path::new("/nowhere/scene_3/video.mp4")), "scene_3");
        assert_eq!(video_name(Path::new("/nowhere/scene_3/first.mp4")), "first");
    }

    #[test]
    fn four_numbers_are_a_table() {
        assert_eq!(table("-1, 1,-0.5,0.5"), Ok(Table { x: [-1.0, 1.0], y: [-0.5, 0.5] }));
        assert!(table("1,-1,0,1").is_err() && table("1,2,3").is_err());
    }
}
