//! A video to a scene and a report.

use super::appearance::AppearanceFeatures;
use super::attributes;
use super::body_size::{ball_scale, common_size};
use super::body_track::BodyTrack;
use super::report::{PerceivedObject, PerceptionReport, joined};
use super::tracking::{Setting, Tracker};
use crate::media::{MediaError, Still, Video, VideoFrame, still_frames};
use crate::num::{Stop, Stopped, median, wrap_angle};
use crate::perception::image::ground::{GROUND_FRAMES, Ground};
use crate::perception::outlines::outline::{BodyForm, FORMS};
use crate::perception::outlines::viewpoint::{Viewpoint, top_camera};
use crate::scene::{Camera, Covariance, Object, Sample, Scene, Shape, Table, Track, WorldKind};

/// Bytes of frames that are kept for following new bodies back.
const PAST_BYTES: usize = 192 << 20;
/// Least frames that are kept.
const LEAST_PAST: usize = 16;
/// Deviation of the exposure (ln L) over the video that is reported.
const EXPOSURE_DRIFT: f64 = 0.1;

/// Where the camera stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum View {
    /// A calibrated camera.
    Calibrated(Camera),
    /// Straight above, with so many metres per pixel; `None`: from the balls' radius.
    Above { scale: Option<f64> },
}

/// Cosine of the largest angle between the vertical and the axis of a camera that looks straight down (10 degrees).
const STRAIGHT_DOWN: f64 = 0.985;

impl View {
    /// Whether the camera looks straight down, as on a table.
    fn is_from_above(&self) -> bool {
        match self {
            View::Above { .. } => true,
            View::Calibrated(camera) => {
                let [x, y, z, _] = camera.matrix[2];
                z.abs() >= STRAIGHT_DOWN * (x * x + y * y + z * z).sqrt()
            }
        }
    }
}

/// Deviation of ln L over time from which a ground with a pattern cannot be the median: bodies differ by 1, and must by five of it.
const MOVING: f64 = 0.2;
/// Unexplained regions a frame that are reported.
const MANY_UNEXPLAINED: f64 = 5.0;

/// What is known besides the video.
#[derive(Debug, Clone)]
pub struct PerceptionOptions {
    pub name: String,
    pub view: View,
    /// Radius or half side of the bodies (m); `None`: it is found from their outlines.
    pub size: Option<f64>,
    /// Which forms there are.
    pub forms: Vec<BodyForm>,
    pub world: WorldKind,
    pub table: Option<Table>,
    /// A picture of the empty ground, of the video's size.
    pub background: Option<VideoFrame>,
}

impl PerceptionOptions {
    /// What follows of the view, of the balls' radius where all objects are balls, and of the size of other objects (m).
    pub fn of_view(
        name: String,
        view: View,
        ball_radius: Option<f64>,
        size: Option<f64>,
    ) -> PerceptionOptions {
        let above = view.is_from_above();
        let forms = match ball_radius {
            Some(_) => vec![BodyForm::Ball],
            None => vec![BodyForm::Ball, BodyForm::Cylinder, BodyForm::Cube],
        };
        let world = match (ball_radius, above) {
            (Some(_), _) => WorldKind::Billiards,
            (None, true) => WorldKind::Table,
            (None, false) => WorldKind::Clevrer,
        };
        let size = ball_radius.or(size);
        PerceptionOptions { name, view, size, forms, world, table: None, background: None }
    }
}

/// What was perceived.
#[derive(Debug, Clone)]
pub struct Perception {
    pub scene: Scene,
    pub report: PerceptionReport,
    /// A few frames at even distances in time.
    pub stills: Vec<Still>,
}

/// Why a video gives no tracks.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PerceptionError {
    #[error(transparent)]
    Media(#[from] MediaError),
    #[error(transparent)]
    Stopped(#[from] Stopped),
    #[error(
        "camera is of an image of {camera:?} px, but the video has {video:?} px; give the camera of this video"
    )]
    ImageSize { camera: [usize; 2], video: [usize; 2] },
    #[error(
        "background has {background:?} px, but the video has {video:?} px; give a picture of this camera"
    )]
    BackgroundSize { background: [usize; 2], video: [usize; 2] },
    #[error("scale is not given and no ball stands alone in the image; give metres per pixel")]
    NoScale,
    #[error("has a single frame; give a video")]
    SingleFrame,
    #[error(
        "the ground has a pattern (ln L deviates by {pattern:.2}) that moves or changes: give --background PICTURE of the empty table, and \
         a camera at rest"
    )]
    Pattern { pattern: f64 },
    #[error("shows no body in enough frames{hint}")]
    NoBody { hint: String },
}

/// Share of the work that finding the ground takes.
const GROUND_SHARE: f64 = 0.2;

/// Finds the bodies of a video and follows them; `stop` is polled once a frame.
pub fn perceive(
    video: &Video,
    options: &PerceptionOptions,
    stop: Stop,
) -> Result<Perception, PerceptionError> {
    let info = video.info();
    if let View::Calibrated(camera) = &options.view {
        let camera = Viewpoint::new(*camera).size();
        if camera != info.size {
            return Err(PerceptionError::ImageSize { camera, video: info.size });
        }
    }
    if info.times.len() < 2 {
        return Err(PerceptionError::SingleFrame);
    }
    let frame_bytes = 3 * info.size[0] * info.size[1];
    let past = (PAST_BYTES / frame_bytes).max(LEAST_PAST);
    let (ground, sample, kept) = find_ground(video, options, past, stop)?;
    if let Some(pattern) = ground.pattern.filter(|_| ground.deviation > MOVING) {
        return Err(PerceptionError::Pattern { pattern });
    }
    let camera = camera_of(options, &ground, &sample)?;
    let view = Viewpoint::new(camera);
    let size = options.size.or_else(|| common_size(&sample, &ground, &view, &options.forms));
    let setting = Setting { view, ground, times: info.times.clone(), size, forms: options.forms.clone() };
    let mut tracker = Tracker::new(setting, past);
    let frames: Box<dyn Iterator<Item = Result<VideoFrame, MediaError>>> = match kept {
        Some(frames) => Box::new(frames.into_iter().map(Ok)),
        None => video.frames(),
    };
    let (shown, mut stills) = (still_frames(&info.times), vec![]);
    for (k, frame) in frames.enumerate() {
        stop(GROUND_SHARE + (1.0 - GROUND_SHARE) * k as f64 / info.times.len() as f64)?;
        let frame = frame?;
        if shown.binary_search(&k).is_ok() {
            stills.extend(Still::of(&frame));
        }
        tracker.step(k, frame);
    }
    tracker.finish();
    let (scene, report) = conclude(tracker, video, options)?;
    Ok(Perception { scene, report, stills })
}

/// The camera that the options say or imply.
fn camera_of(
    options: &PerceptionOptions,
    ground: &Ground,
    sample: &[VideoFrame],
) -> Result<Camera, PerceptionError> {
    let image_size = ground.size.map(|s| s as f64);
    match (options.view, options.size) {
        (View::Calibrated(camera), _) => Ok(camera),
        (View::Above { scale: Some(scale) }, _) if scale > 0.0 && scale.is_finite() => {
            Ok(top_camera(scale, image_size))
        }
        (View::Above { scale: None }, Some(radius)) => {
            let scale = ball_scale(sample, ground, radius).ok_or(PerceptionError::NoScale)?;
            Ok(top_camera(scale, image_size))
        }
        _ => Err(PerceptionError::NoScale),
    }
}

/// The ground, the frames it was found from, and all frames of a short video, so that it is decoded once.
type GroundFrames = (Ground, Vec<VideoFrame>, Option<Vec<VideoFrame>>);

fn find_ground(
    video: &Video,
    options: &PerceptionOptions,
    most: usize,
    stop: Stop,
) -> Result<GroundFrames, PerceptionError> {
    let info = video.info();
    let count = info.times.len();
    let used = GROUND_FRAMES.min(count).min(most.max(4));
    let chosen: Vec<usize> = (0..used).map(|k| (2 * k + 1) * count / (2 * used)).collect();
    let (mut sample, mut kept) = (vec![], None);
    if count <= most {
        let mut frames: Vec<VideoFrame> = vec![];
        for frame in video.frames() {
            stop(GROUND_SHARE * frames.len() as f64 / count as f64)?;
            frames.push(frame?);
        }
        sample.extend(chosen.iter().filter_map(|&k| frames.get(k).cloned()));
        kept = Some(frames);
    } else {
        for frame in video.frames() {
            let frame = frame?;
            stop(GROUND_SHARE * frame.index as f64 / count as f64)?;
            if chosen.binary_search(&frame.index).is_ok() {
                sample.push(frame);
            }
            if sample.len() == used {
                break;
            }
        }
    }
    let ground = match &options.background {
        Some(picture) if picture.size != info.size => {
            return Err(PerceptionError::BackgroundSize { background: picture.size, video: info.size });
        }
        Some(picture) => Ground::of_picture(picture),
        None => Ground::fit(&sample).ok_or(PerceptionError::Media(MediaError::Empty))?,
    };
    Ok((ground, sample, kept))
}

fn conclude(
    tracker: Tracker,
    video: &Video,
    options: &PerceptionOptions,
) -> Result<(Scene, PerceptionReport), PerceptionError> {
    let info = video.info();
    let fps = info.fps.unwrap_or(25.0);
    let mut order: Vec<&BodyTrack> = tracker.tracks.iter().collect();
    order.sort_by_key(|t| t.first_frame());
    let warnings = warnings(&tracker, video);
    if order.is_empty() {
        let hint = warnings.first().map_or(String::new(), |w| format!(": {w}"));
        return Err(PerceptionError::NoBody { hint });
    }
    let shift = tracker.setting.ground.colour_shift();
    let words = if options.world == WorldKind::Clevrer { attributes::CLEVR_COLOURS } else { usize::MAX };
    let (mut objects, mut tracks, mut perceived) = (vec![], vec![], vec![]);
    for (id, track) in order.into_iter().enumerate() {
        let (object, seen) = described(id as u32, track, (words, shift));
        tracks.push(samples(track));
        objects.push(object);
        perceived.push(seen);
    }
    let stated = tracks.iter().flat_map(|t: &Track| &t.samples).map(|s| s.covariance);
    let scene = Scene {
        name: options.name.clone(),
        setup: None,
        world: options.world,
        fps,
        times: info.times.clone(),
        camera: Some(tracker.setting.view.camera),
        table: options.table,
        noise_sigma: Covariance::mean_variance(stated).map(f64::sqrt),
        objects,
        tracks,
        outliers: vec![],
        findings: vec![],
        feature_layout: Some(FEATURE_LAYOUT.to_string()),
        absent: vec![],
    };
    let report = PerceptionReport {
        format: info.format.clone(),
        image_size: info.size,
        frames: info.times.len(),
        fps,
        objects: perceived,
        merged: tracker.counts.merged_frames,
        hidden: tracker.counts.hidden_frames,
        unexplained: joined(&tracker.counts.unexplained),
        warnings,
    };
    Ok((scene, report))
}

fn samples(track: &BodyTrack) -> Track {
    let mut samples = vec![];
    for (frame, placement) in track.placements.iter().enumerate() {
        let Some(p) = placement else { continue };
        let yaw = (track.form == BodyForm::Cube).then(|| wrap_angle(p.pose.yaw));
        samples.push(Sample { frame, position: p.pose.at, yaw, covariance: Some(p.covariance) });
    }
    Track { samples }
}

fn described(
    id: u32,
    track: &BodyTrack,
    (words, shift): (usize, Option<[f64; 3]>),
) -> (Object, PerceivedObject) {
    let own = track.appearance.features();
    let features = shift.map_or(own, |shift| own.shifted(shift));
    let (color, color_probability) = attributes::color(&features, words);
    let (material, material_probability) = attributes::material(&features, color);
    let size = track.size;
    let shape = match track.form {
        BodyForm::Ball => Shape::Ball { radius: size },
        BodyForm::Cylinder => Shape::Disc { radius: size },
        BodyForm::Cube => Shape::Square { half_side: size },
    };
    let mut residuals: Vec<f64> = track.placements.iter().flatten().map(|p| p.rms).collect();
    let mut supports: Vec<f64> = track.placements.iter().flatten().map(|p| p.support).collect();
    let first = track.first_frame().unwrap_or(0);
    let last = track.placements.iter().rposition(Option::is_some).unwrap_or(0);
    let object = Object {
        id,
        color: color.into(),
        material: material.into(),
        shape,
        mass: None,
        features: stored(&features, color, track),
    };
    let seen = PerceivedObject {
        id,
        shape: object.shape.word().into(),
        color: color.into(),
        material: material.into(),
        shape_probability: form_probability(track),
        color_probability,
        material_probability,
        first_frame: first,
        last_frame: last,
        frames_placed: track.placed_frames(),
        outline_residual: median(&mut residuals).unwrap_or(0.0),
        outline_support: median(&mut supports).unwrap_or(0.0),
        form_costs: track.form_costs,
        appearance: features,
    };
    (object, seen)
}

/// Layout of the features that a perceived object has: chroma (red, blue), lightness at 5, 25, 50, 75, 95 and 99 %, chroma of the
/// highlights (red, blue), the signs of a mirror (lightness below that of the nearest of perception's colours, highlights above the
/// median, chroma as a share of that colour's), and the mean cost a frame of each form (ball, cylinder, cube).
pub const FEATURE_LAYOUT: &str = "perception-1";

fn stored(look: &AppearanceFeatures, color: &str, track: &BodyTrack) -> Vec<f32> {
    let frames = track.form_frames.max(1) as f64;
    let costs = track.form_costs.iter().map(|c| c / frames);
    let signs = attributes::mirror_signs(look, color).unwrap_or_default();
    let look = look.chroma.into_iter().chain(look.lightness).chain(look.highlight_chroma);
    look.chain(signs).chain(costs).map(|x| x as f32).collect()
}

/// Probability of the chosen form: costs are log likelihoods of about 30 independent points a frame; frames are not
/// independent, so that their mean counts and not their sum.
fn form_probability(track: &BodyTrack) -> f64 {
    const POINTS: f64 = 30.0;
    let frames = track.form_frames.max(1) as f64;
    let least = track.form_costs.iter().copied().fold(f64::INFINITY, f64::min);
    let weight = |c: &f64| crate::num::elementary::exp(-0.5 * POINTS * (c - least) / frames);
    let total: f64 = track.form_costs.iter().map(weight).sum();
    let chosen = FORMS.iter().position(|f| *f == track.form).unwrap_or(0);
    weight(&track.form_costs[chosen]) / total.max(1e-300)
}

fn warnings(tracker: &Tracker, video: &Video) -> Vec<String> {
    let mut warnings = vec![];
    let counts = &tracker.counts;
    if let (Some(first), count @ 1..) = (counts.covered_frames.first(), counts.covered_frames.len()) {
        warnings.push(format!(
            "{count} frames from {first} on show another scene than the rest (a title, a cut or a camera that moved) and are ignored; cut \
             the video there; if it has no cuts, the ground has a pattern: give --background PICTURE of the empty table"
        ));
    }
    let spread = |c: usize| {
        let values = counts.exposure.iter().map(|e| f64::from(e[c]));
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        high - low
    };
    if (0..3).any(|c| spread(c) > EXPOSURE_DRIFT) {
        warnings.push(
            "the exposure or the white balance drifts; it is corrected, but a locked exposure is more accurate".into(),
        );
    }
    if let Some(pattern) = tracker.setting.ground.pattern {
        warnings.push(format!(
            "the ground has a pattern (ln L deviates by {pattern:.2}) or little of it shows: what rests through most of the video is taken as ground; give \
             --background PICTURE of the empty table"
        ));
    }
    if let Some(shake) = tracker.shake {
        warnings.push(format!(
            "the camera moves: it shakes by {:.2} px; the common motion of bodies at rest was taken off in {} of {} frames",
            shake.rms,
            shake.corrected,
            video.info().times.len()
        ));
    }
    let unexplained = counts.unexplained.len() as f64 / video.info().times.len() as f64;
    if unexplained > MANY_UNEXPLAINED {
        warnings.push(format!(
            "{unexplained:.0} regions a frame are neither ground nor body: the camera may move, or the ground is not plain"
        ));
    }
    if (video.info().pixel_aspect - 1.0).abs() > 1e-3 {
        warnings.push(format!(
            "pixels are {} times as wide as high; the camera must be that of the stored pixels",
            video.info().pixel_aspect
        ));
    }
    warnings
}
