//! Cameras, image points and detections: messages to domain values and back.

use super::request::Report;
use super::v1;
use crate::engine::EngineError;
use crate::scene::{
    AttributeScores, BoundingBox, CalibrateError, Calibration, Camera, CameraPose, Covariance, DEFAULT_SIZE,
    Detection, IMAGE_NOISE, IMAGE_NOISE_RANGE, Intrinsics, LinkError, LinkOptions, LinkReport,
    MAX_DETECTIONS, MAX_FRAMES, MAX_NAME, Object, Pixel, PointPair, Rotation, SIZE_RANGE, Track, Violation,
    decompress, link, mask_bounds,
};

/// Most words that one detection has for an attribute.
const MAX_WORDS: usize = 64;

/// The camera of a video.
pub fn camera(r: &mut Report, camera: v1::Camera) -> Option<Camera> {
    let path = "video.camera";
    let image_size = [camera.image_width, camera.image_height];
    let (intrinsics, pose) = match (camera.intrinsics, camera.pose) {
        (None, None) => {
            let Ok(m) = <[f64; 12]>::try_from(camera.matrix.as_slice()) else {
                r.add(format!("{path}.matrix"), format!("has {} numbers; give 12", camera.matrix.len()));
                return None;
            };
            let matrix = [0, 4, 8].map(|row| [0, 1, 2, 3].map(|column| m[row + column]));
            return Some(Camera { matrix, image_size });
        }
        (Some(intrinsics), Some(pose)) => (intrinsics, pose),
        (None, _) => {
            r.add(format!("{path}.intrinsics"), "is missing beside pose; give both, or a matrix");
            return None;
        }
        (_, None) => {
            r.add(format!("{path}.pose"), "is missing beside intrinsics; give both, or a matrix");
            return None;
        }
    };
    if !camera.matrix.is_empty() {
        r.add(format!("{path}.matrix"), "is given beside intrinsics and pose; give one of the two");
    }
    let rotation = match pose.rotation[..] {
        [x, y, z] => Rotation::Vector([x, y, z]),
        [a, b, c, d, e, f, g, h, i] => Rotation::Matrix([[a, b, c], [d, e, f], [g, h, i]]),
        _ => {
            let message = format!("has {} numbers; give 3 (axis times angle, rad) or 9", pose.rotation.len());
            r.add(format!("{path}.pose.rotation"), message);
            return None;
        }
    };
    let [x, y, z] = pose.translation[..] else {
        let message = format!("has {} numbers; give 3 (m)", pose.translation.len());
        r.add(format!("{path}.pose.translation"), message);
        return None;
    };
    let focal_v = if intrinsics.focal_v == 0.0 { intrinsics.focal_u } else { intrinsics.focal_v };
    let lens = Intrinsics {
        focal: [intrinsics.focal_u, focal_v],
        centre: [intrinsics.centre_u, intrinsics.centre_v],
    };
    let made = Camera::from_parts(&lens, &CameraPose { rotation, translation: [x, y, z] }, image_size);
    let field = |field| if field == "focal_length" { "intrinsics.focal_u" } else { "pose.rotation" };
    made.map_err(|e| r.add(format!("{path}.{}", field(e.field())), e.to_string())).ok()
}

pub fn camera_message(camera: &Camera) -> v1::Camera {
    let (matrix, [image_width, image_height]) = (camera.matrix.concat(), camera.image_size);
    v1::Camera { matrix, image_width, image_height, ..Default::default() }
}

/// Deviation of image points (px).
pub fn image_noise(r: &mut Report, given: f64) -> f64 {
    let sigma = if given == 0.0 { IMAGE_NOISE } else { given };
    if IMAGE_NOISE_RANGE.contains(&sigma) {
        return sigma;
    }
    let (low, high) = (IMAGE_NOISE_RANGE.start(), IMAGE_NOISE_RANGE.end());
    r.add("video.image_noise_px", format!("is {sigma}; must be from {low} to {high} px"));
    IMAGE_NOISE
}

/// Puts image points in their places; the camera as it faces them.
pub fn place(
    r: &mut Report,
    camera: Option<Camera>,
    sigma: f64,
    pixels: &[Pixel],
    objects: &[Object],
    tracks: &mut [Track],
) -> Option<Camera> {
    let Some(camera) = camera else {
        r.add("video.camera", "is missing; image points need it");
        return None;
    };
    let placed = camera.place(pixels, sigma, objects, tracks);
    let (camera, refused) = placed.map_err(|e| r.add("video.camera.matrix", e.to_string())).ok()?;
    for (k, error) in refused {
        let Pixel { object, sample, .. } = pixels[k];
        let frame = tracks[object].samples[sample].frame;
        r.add(format!("video.objects[{object}].samples[{sample}].image"), format!("frame {frame}: {error}"));
    }
    Some(camera)
}

/// Links a request's detections into its video's objects.
pub fn linked(request: v1::CreateVideoRequest) -> Result<(v1::Video, LinkReport), EngineError> {
    let mut r = Report::default();
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
    let mut detections = vec![];
    for (i, d) in request.detections.into_iter().enumerate() {
        detections.extend(detection(&mut r, &format!("detections[{i}]"), d, image_size));
    }
    let last = detections.iter().map(|d| d.frame + 1).max().unwrap_or(0);
    let frames = last.max(request.frame_count as usize);
    let fps = if video.fps == 0.0 { super::video::DEFAULT_FPS } else { video.fps };
    let Some(camera) = r.finish(camera)? else {
        return Err(EngineError::invalid("video.camera", "is missing; detections need it"));
    };
    let options = LinkOptions { frames, fps, camera, size, sigma };
    let found = link(&detections, &options).map_err(refused)?;
    video.camera = Some(camera_message(&found.camera));
    video.objects =
        found.objects.iter().zip(&found.tracks).map(|(o, t)| super::video::object(o, &t.samples)).collect();
    if video.times.is_empty() && frames <= MAX_FRAMES {
        video.times = (0..frames).map(|f| f as f64 / fps).collect();
    }
    Ok((video, found.report))
}

fn refused(error: LinkError) -> EngineError {
    match error {
        LinkError::Camera(e) => EngineError::invalid("video.camera.matrix", e.to_string()),
        other => EngineError::invalid("detections", other.to_string()),
    }
}

fn detection(r: &mut Report, path: &str, d: v1::Detection, [width, height]: [f64; 2]) -> Option<Detection> {
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
    Some(Detection { frame, bounds, color, material, shape, score })
}

pub fn linking(report: &LinkReport) -> v1::Linking {
    v1::Linking {
        frames: report.frames as u32,
        detections: report.detections as u32,
        objects: report.objects as u32,
        gaps_bridged: report.gaps_bridged as u32,
        frames_bridged: report.frames_bridged as u32,
        detections_dropped: report.detections_dropped as u32,
    }
}

/// Pairs and image size of a request.
pub fn pairs(request: v1::CalibrateCameraRequest) -> (Vec<PointPair>, [f64; 2]) {
    let pair = |p: v1::PointPair| PointPair { image: [p.u, p.v], world: [p.x, p.y, p.z] };
    (request.pairs.into_iter().map(pair).collect(), [request.image_width, request.image_height])
}

/// What is wrong with the pairs, by field.
pub fn uncalibrated(error: CalibrateError) -> EngineError {
    let text = error.to_string();
    let (path, message) = text.split_once(": ").unwrap_or(("pairs", &text));
    let path = if path == "image_size" { "image_width" } else { path };
    EngineError::Invalid(vec![Violation { path: path.into(), message: message.into() }])
}

pub fn calibration(found: &Calibration) -> v1::CalibrateCameraResponse {
    v1::CalibrateCameraResponse {
        camera: Some(camera_message(&found.camera)),
        reprojection_error: found.reprojection_error,
        outliers: found.outliers.iter().map(|&i| i as u32).collect(),
        planar: found.planar,
        focal_length: found.intrinsics.focal[0],
        focal_length_sd: found.focal_sd,
        position: found.position.to_vec(),
    }
}

pub fn covariance(given: v1::Covariance) -> Covariance {
    Covariance { xx: given.xx, xy: given.xy, yy: given.yy }
}

pub fn covariance_message(c: Covariance) -> v1::Covariance {
    v1::Covariance { xx: c.xx, xy: c.xy, yy: c.yy }
}
