//! Samples from image points: each is placed on the ground plane by the camera.

use crate::num::elementary;
use crate::scene::camera::projection::{Camera, CameraError, LocateError};
use crate::scene::limits::DEFAULT_SIZE;
use crate::scene::object::Object;
use crate::scene::observation::Track;
use crate::scene::violations::Violation;
use std::ops::RangeInclusive;

/// Standard deviation of an image point's coordinates where none is given (px).
pub const IMAGE_NOISE: f64 = 1.0;
/// Allowed standard deviations of an image point's coordinates (px).
pub const IMAGE_NOISE_RANGE: RangeInclusive<f64> = 1e-4..=100.0;
/// Largest median distance of image points from the projections of their samples, as a share of the image's width. It is much
/// more than noise and the offset of a box's middle from the projected centre.
const MAX_MISMATCH: f64 = 0.03;

/// An image point of a sample: indices of its object and of the sample in its track, and the point (px).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pixel {
    pub object: usize,
    pub sample: usize,
    pub point: [f64; 2],
}

impl Camera {
    /// Gives samples the positions that their image points (standard deviation `sigma` px) show. Returns the camera with the
    /// sign that puts the points in front of it, and the indices of the pixels that have no position.
    pub fn place(
        &self,
        pixels: &[Pixel],
        sigma: f64,
        objects: &[Object],
        tracks: &mut [Track],
    ) -> Result<(Camera, Vec<(usize, LocateError)>), CameraError> {
        let points: Vec<[f64; 2]> = pixels.iter().map(|p| p.point).collect();
        let camera = self.facing(&points, DEFAULT_SIZE)?;
        let mut refused = vec![];
        for (k, pixel) in pixels.iter().enumerate() {
            let sample = tracks.get_mut(pixel.object).and_then(|t| t.samples.get_mut(pixel.sample));
            let (Some(object), Some(sample)) = (objects.get(pixel.object), sample) else { continue };
            match camera.locate(pixel.point, object.shape.centre_height(), [sigma; 2]) {
                Ok((position, covariance)) => {
                    (sample.position, sample.covariance) = (position, Some(covariance));
                }
                Err(error) => refused.push((k, error)),
            }
        }
        Ok((camera, refused))
    }

    /// A violation if the median distance between image points and the projections of their samples is too large: camera and
    /// positions disagree.
    pub(in crate::scene) fn mismatch(
        &self,
        shown: &[Pixel],
        objects: &[Object],
        tracks: &[Track],
    ) -> Option<Violation> {
        let one = |p: &Pixel| {
            let (object, sample) = (objects.get(p.object)?, tracks.get(p.object)?.samples.get(p.sample)?);
            let [u, v] = self.project(sample.position, object.shape.centre_height())?;
            Some((
                elementary::hypot(u - p.point[0], v - p.point[1]),
                p.point,
                [u, v],
                object.id,
                sample.frame,
            ))
        };
        let mut distances: Vec<_> = shown.iter().filter_map(one).collect();
        distances.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (distance, [u, v], [a, b], id, frame) = *distances.get(distances.len() / 2)?;
        (distance > MAX_MISMATCH * self.image_size[0]).then(|| Violation {
            path: format!("frame {frame}, object {id}: location"),
            message: format!(
                "is at ({a:.0}, {b:.0}) px by camera_matrix, but image_center is ({u:.0}, {v:.0}), as for most samples; check for \
                 a mirrored axis or a unit other than m"
            ),
        })
    }
}
