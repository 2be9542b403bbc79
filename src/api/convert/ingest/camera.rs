//! Cameras, image points and calibrations: messages to domain values and back.

use crate::api::convert::violations::Violations;
use crate::api::v1;
use crate::engine::EngineError;
use crate::scene::{
    CalibrateError, Calibration, Camera, CameraPose, Covariance, IMAGE_NOISE, IMAGE_NOISE_RANGE, Intrinsics,
    Object, Pixel, PointPair, Rotation, Track, Violation,
};

/// The camera of a video.
pub fn camera(r: &mut Violations, camera: v1::Camera) -> Option<Camera> {
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

/// Standard deviation of image points (px).
pub fn image_noise(r: &mut Violations, given: f64) -> f64 {
    let sigma = if given == 0.0 { IMAGE_NOISE } else { given };
    if IMAGE_NOISE_RANGE.contains(&sigma) {
        return sigma;
    }
    let (low, high) = (IMAGE_NOISE_RANGE.start(), IMAGE_NOISE_RANGE.end());
    r.add("video.image_noise_px", format!("is {sigma}; must be from {low} to {high} px"));
    IMAGE_NOISE
}

/// Places image points in the bird's-eye plane. The returned camera has the sign by which they lie in front of it.
pub fn place(
    r: &mut Violations,
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

/// Pairs and image size of a request.
pub fn pairs(request: v1::CalibrateCameraRequest) -> (Vec<PointPair>, [f64; 2]) {
    let pair = |p: v1::PointPair| PointPair { image: [p.u, p.v], world: [p.x, p.y, p.z] };
    (request.pairs.into_iter().map(pair).collect(), [request.image_width, request.image_height])
}

/// The error of a calibration with the path of its field.
pub fn uncalibrated(error: CalibrateError) -> EngineError {
    if let CalibrateError::Stopped(stopped) = error {
        return stopped.into();
    }
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
