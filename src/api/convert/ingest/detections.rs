//! Detections: messages to domain values, linked into the objects of a video.

use super::camera::{camera, camera_message, image_noise};
use crate::api::convert::video::{DEFAULT_FPS, object_message};
use crate::api::convert::violations::Violations;
use crate::api::v1;
use crate::engine::EngineError;
use crate::num::Stop;
use crate::scene::{
    AttributeScores, BoundingBox, DEFAULT_SIZE, Detection, LinkError, LinkOptions, LinkReport,
    MAX_DETECTIONS, MAX_FRAMES, MAX_NAME, SIZE_RANGE, checked_features, decompress, link, mask_bounds,
};

/// Detections that are read between two checks of the stop token.
const STOP_EVERY: usize = 1024;
/// Most words for one attribute of a detection.
const MAX_WORDS: usize = 64;

/// Links a request's detections into the objects of its video; the report says how.
pub fn linked(request: v1::CreateVideoRequest, stop: Stop) -> Result<(v1::Video, LinkReport), EngineError> {
    let mut r = Violations::default();
    let mut video = request.video.unwrap_or_default();
    if !video.objects.is_empty() {
        r.add("video.objects", "is given beside detections; give one of the two");
    }
    let sigma = image_noise(&mut r, video.image_noise_px);
    let camera = match video.camera.take() {
        Some(given) => camera(&mut r, given),
        None => {
            r.add("video.camera", "is missing; detections need it");
            None
        }
    };
    let size = if request.object_size == 0.0 { DEFAULT_SIZE } else { request.object_size };
    if !(SIZE_RANGE[0]..=SIZE_RANGE[1]).contains(&size) {
        r.add("object_size", format!("is {size}; must be from {:?} to {:?} m", SIZE_RANGE[0], SIZE_RANGE[1]));
    }
    let given = request.detections.len();
    if given > MAX_DETECTIONS {
        return Err(EngineError::invalid(
            "detections",
            format!("has {given}; at most {MAX_DETECTIONS} are linked"),
        ));
    }
    let image_size = camera.map_or([f64::INFINITY; 2], |c| c.image_size);
    let (mut detections, mut length) = (vec![], None);
    for (i, d) in request.detections.into_iter().enumerate() {
        if i % STOP_EVERY == 0 {
            stop(0.0)?;
        }
        let path = format!("detections[{i}]");
        if let Err(message) = checked_features(&d.features, &mut length) {
            r.add(format!("{path}.features"), format!("frame {}: {message}", d.frame));
        }
        detections.extend(detection(&mut r, &path, d, image_size));
    }
    let last = detections.iter().map(|d| d.frame + 1).max().unwrap_or(0);
    let frames = last.max(request.frame_count as usize);
    let fps = if video.fps == 0.0 { DEFAULT_FPS } else { video.fps };
    let Some(camera) = r.finish(camera)? else {
        return Err(EngineError::invalid("video.camera", "is missing; detections need it"));
    };
    let options = LinkOptions { frames, fps, camera, size, sigma };
    let found = link(&detections, &options, stop).map_err(refused)?;
    video.camera = Some(camera_message(&found.camera));
    video.objects =
        found.objects.iter().zip(&found.tracks).map(|(o, t)| object_message(o, &t.samples)).collect();
    if video.times.is_empty() && frames <= MAX_FRAMES {
        video.times = (0..frames).map(|f| f as f64 / fps).collect();
    }
    Ok((video, found.report))
}

fn refused(error: LinkError) -> EngineError {
    match error {
        LinkError::Camera(e) => EngineError::invalid("video.camera.matrix", e.to_string()),
        LinkError::Stopped(stopped) => stopped.into(),
        other => EngineError::invalid("detections", other.to_string()),
    }
}

fn detection(
    r: &mut Violations,
    path: &str,
    d: v1::Detection,
    [width, height]: [f64; 2],
) -> Option<Detection> {
    let frame = d.frame as usize;
    if frame >= MAX_FRAMES {
        r.add(format!("{path}.frame"), format!("is {frame}; at most {MAX_FRAMES} frames are allowed"));
        return None;
    }
    let mut wrong =
        |field: &str, message: String| r.add(format!("{path}.{field}"), format!("frame {frame}: {message}"));
    let bounds = match d.region {
        Some(v1::detection::Region::Box(b)) => {
            let bounds =
                BoundingBox { left: b.left, top: b.top, right: b.left + b.width, bottom: b.top + b.height };
            if let Err(message) = bounds.check([width, height]) {
                wrong("box", message);
                return None;
            }
            bounds
        }
        Some(v1::detection::Region::Mask(m)) => {
            let size = [u64::from(m.height), u64::from(m.width)];
            if [f64::from(m.width), f64::from(m.height)] != [width, height] && width.is_finite() {
                let message = format!("is {} x {}; the image has {height} x {width}", m.height, m.width);
                wrong("mask", message);
                return None;
            }
            let counts = match m.counts.is_empty() {
                true => Ok(m.runs.iter().map(|&run| i64::from(run)).collect()),
                false => decompress(&m.counts),
            };
            match counts.and_then(|counts| mask_bounds(size, &counts)) {
                Ok(bounds) => bounds,
                Err(error) => {
                    wrong("mask", error.to_string());
                    return None;
                }
            }
        }
        None => {
            wrong("region", "is missing; give a box or a mask".into());
            return None;
        }
    };
    let score = if d.score == 0.0 { 1.0 } else { d.score };
    if !(score > 0.0 && score <= 1.0) {
        wrong("score", format!("is {score}; give a number up to 1"));
    }
    let mut words = |field: &str, given: Vec<v1::Score>| {
        let mut scores = AttributeScores::new();
        for (k, one) in given.iter().take(MAX_WORDS).enumerate() {
            let score = if one.score == 0.0 { 1.0 } else { one.score };
            if !(score > 0.0 && score.is_finite()) || one.word.len() > MAX_NAME {
                wrong(&format!("{field}[{k}]"), "give a short word and a positive score".into());
            } else {
                *scores.entry(one.word.to_lowercase()).or_insert(0.0) += score;
            }
        }
        scores
    };
    let (color, material, shape) =
        (words("color", d.color), words("material", d.material), words("shape", d.shape));
    Some(Detection { frame, bounds, color, material, shape, score, features: d.features })
}

pub fn linking_message(report: &LinkReport) -> v1::Linking {
    v1::Linking {
        frames: report.frames as u32,
        detections: report.detections as u32,
        objects: report.objects as u32,
        gaps_bridged: report.gaps_bridged as u32,
        frames_bridged: report.frames_bridged as u32,
        detections_dropped: report.detections_dropped as u32,
    }
}
