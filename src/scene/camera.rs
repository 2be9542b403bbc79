//! The camera: world to pixel, and a pixel back to the bird's-eye plane with its uncertainty.

use super::{Covariance, DEFAULT_SIZE, MAX_POSITION, Object, Track, Violation};
use crate::num::{Vec2, vec2};
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// A pixel within this many deviations of the horizon is on it: where it lies on the ground is anyone's guess.
const HORIZON: f64 = 3.0;
/// Share of the product of its rows' lengths that a camera matrix's largest minor has at least: below it the
/// matrix maps the plane to a line or a point, up to round-off.
const SINGULAR: f64 = 1e-9;
/// Largest part by which the rows of a rotation matrix may fail to be orthonormal: matrices are typed with few digits.
const ORTHONORMAL: f64 = 1e-3;
/// Share of the image's width by which the middle image point may lie off where the camera shows its sample: much more
/// than noise and what a box's middle is off the centre.
const ASTRAY: f64 = 0.03;

/// A sample that has an image point in place of a position: indices of its track and in it, and the point (px).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pixel {
    pub object: usize,
    pub sample: usize,
    pub point: [f64; 2],
}

/// Deviation of an image point's coordinates that is taken where nobody tells (px), and what it may be.
pub const IMAGE_NOISE: f64 = 1.0;
pub const IMAGE_NOISE_RANGE: RangeInclusive<f64> = 1e-4..=100.0;

/// A pinhole camera: world (m) to pixel, u to the right and v down; the world is right-handed with z up.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Rows of the 3x4 projection matrix.
    pub matrix: [[f64; 4]; 3],
    /// Width and height in pixels.
    pub image_size: [f64; 2],
}

/// What a lens and sensor do, without distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Focal lengths along u and v (px).
    pub focal: [f64; 2],
    /// Where the optical axis meets the image (px).
    pub centre: [f64; 2],
}

/// Where a camera is: a world point x has the camera coordinates `rotation x + translation`, with x to the right, y down
/// and z forward (OpenCV's convention).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPose {
    pub rotation: Rotation,
    /// m.
    pub translation: [f64; 3],
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rotation {
    /// Axis times angle (rad): Rodrigues' vector.
    Vector([f64; 3]),
    Matrix([[f64; 3]; 3]),
}

/// Why a camera cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CameraError {
    #[error("is {value}; give a number of pixels greater than 0")]
    Focal { value: f64 },
    #[error("is not finite; give finite numbers")]
    NotFinite,
    #[error("turns by {angle:.1} rad, more than a whole turn: these look like degrees; give radians")]
    Degrees { angle: f64 },
    #[error("is singular, so that it sees no plane; give the 3x4 projection matrix")]
    Singular,
    #[error(
        "has every image point behind the camera: an axis is mirrored; u goes right, v down, and the world is right-handed \
         with z up"
    )]
    Behind,
    #[error("is no rotation: its rows must be of length one and perpendicular")]
    NoRotation,
    #[error(
        "has the determinant -1: an axis is mirrored; give a right-handed rotation, with v down and z up"
    )]
    Mirrored,
}

impl CameraError {
    /// The field that it speaks of, below the camera.
    pub fn field(&self) -> &'static str {
        match self {
            CameraError::Focal { .. } => "focal_length",
            CameraError::Singular | CameraError::Behind => "matrix",
            _ => "rotation",
        }
    }
}

/// Why a pixel is no point of the bird's-eye plane.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LocateError {
    #[error("({u}, {v}) is not finite; give pixels")]
    NotFinite { u: f64, v: f64 },
    #[error(
        "({u}, {v}) lies far outside the image of {width} x {height} px; give pixels of this image, u to the right, v down"
    )]
    Outside { u: f64, v: f64, width: f64, height: f64 },
    #[error(
        "({u}, {v}) lies on or above the horizon of the plane {z} m above the ground; only what is below it has a place: \
         check the camera, and that v goes down"
    )]
    Horizon { u: f64, v: f64, z: f64 },
    #[error("the plane {z} m above the ground passes through the camera; check camera and size")]
    EdgeOn { z: f64 },
}

impl Camera {
    /// K [R | t] with K of the intrinsics.
    pub fn from_parts(
        intrinsics: &Intrinsics,
        pose: &CameraPose,
        image_size: [f64; 2],
    ) -> Result<Camera, CameraError> {
        let Intrinsics { focal, centre } = *intrinsics;
        if let Some(&value) = focal.iter().find(|f| !(f.is_finite() && **f > 0.0)) {
            return Err(CameraError::Focal { value });
        }
        let rotation = match pose.rotation {
            Rotation::Vector(vector) => {
                let vector = Vector3::from(vector);
                let angle = vector.norm();
                if !angle.is_finite() {
                    return Err(CameraError::NotFinite);
                }
                if angle > std::f64::consts::TAU {
                    return Err(CameraError::Degrees { angle });
                }
                Rotation3::from_scaled_axis(vector).into_inner()
            }
            Rotation::Matrix(rows) => {
                let rotation = Matrix3::from(rows).transpose();
                if rotation.iter().any(|v| !v.is_finite()) {
                    return Err(CameraError::NotFinite);
                }
                if (rotation * rotation.transpose() - Matrix3::identity()).amax() > ORTHONORMAL {
                    return Err(CameraError::NoRotation);
                }
                if rotation.determinant() < 0.0 {
                    return Err(CameraError::Mirrored);
                }
                rotation
            }
        };
        let lens = Matrix3::new(focal[0], 0.0, centre[0], 0.0, focal[1], centre[1], 0.0, 0.0, 1.0);
        let (left, last) = (lens * rotation, lens * Vector3::from(pose.translation));
        let row = |i: usize| [left[(i, 0)], left[(i, 1)], left[(i, 2)], last[i]];
        Ok(Camera { matrix: [row(0), row(1), row(2)], image_size })
    }

    /// Pixel of a world point at height `z` (m); `None` behind the camera.
    pub fn project(&self, position: Vec2, z: f64) -> Option<[f64; 2]> {
        let [u, v, w] = self.matrix.map(|r| r[0] * position.x + r[1] * position.y + r[2] * z + r[3]);
        (w > 1e-9).then(|| [u / w, v / w])
    }

    /// Whether the world point lies inside the image.
    pub fn sees(&self, position: Vec2, z: f64) -> bool {
        self.project(position, z)
            .is_some_and(|[u, v]| u > 0.0 && u < self.image_size[0] && v > 0.0 && v < self.image_size[1])
    }

    /// The point at height `z` (m) that a pixel shows: `K^-1 [x z, y z, z, 1]` of Ding et al. (2021, supplement, eq. 1).
    /// A pixel's coordinates have the deviations `sigma` (px), from which the covariance follows to first order.
    pub fn locate(
        &self,
        pixel: [f64; 2],
        z: f64,
        sigma: [f64; 2],
    ) -> Result<(Vec2, Covariance), LocateError> {
        let [u, v] = pixel;
        let [width, height] = self.image_size;
        if !(u.is_finite() && v.is_finite()) {
            return Err(LocateError::NotFinite { u, v });
        }
        if (u / width - 0.5).abs() > 1.0 || (v / height - 0.5).abs() > 1.0 {
            return Err(LocateError::Outside { u, v, width, height });
        }
        let inverse = self.plane(z).try_inverse().ok_or(LocateError::EdgeOn { z })?;
        let ray = inverse * Vector3::new(u, v, 1.0);
        // The reciprocal of the depth: zero on the horizon, negative above it.
        let spread = (sigma[0] * inverse[(2, 0)]).hypot(sigma[1] * inverse[(2, 1)]);
        if !(ray.z > HORIZON * spread && ray.z > 1e-12) {
            return Err(LocateError::Horizon { u, v, z });
        }
        let (x, y) = (ray.x / ray.z, ray.y / ray.z);
        if x.abs() > MAX_POSITION || y.abs() > MAX_POSITION {
            return Err(LocateError::Horizon { u, v, z });
        }
        let by = |k: usize| {
            let by = |row: usize, at: f64| sigma[k] * (inverse[(row, k)] - at * inverse[(2, k)]) / ray.z;
            (by(0, x), by(1, y))
        };
        let ((xu, yu), (xv, yv)) = (by(0), by(1));
        let covariance = Covariance { xx: xu * xu + xv * xv, xy: xu * yu + xv * yv, yy: yu * yu + yv * yv };
        Ok((vec2(x, y), covariance))
    }

    /// The same camera with the sign of its matrix such that what it shows has a positive depth: a projection matrix is
    /// known up to a factor. If an axis is mirrored, these pixels of the plane at height `z` (m) are behind it.
    pub fn facing(&self, pixels: &[[f64; 2]], z: f64) -> Result<Camera, CameraError> {
        if self.matrix.iter().flatten().any(|v| !v.is_finite()) {
            return Err(CameraError::NotFinite);
        }
        if self.is_singular() {
            return Err(CameraError::Singular);
        }
        let left = Matrix3::from_fn(|i, j| self.matrix[i][j]);
        let sign = left.determinant().signum();
        let camera = Camera { matrix: self.matrix.map(|row| row.map(|v| sign * v)), ..*self };
        let Some(inverse) = camera.plane(z).try_inverse() else { return Ok(camera) };
        let ahead = |p: &&[f64; 2]| (inverse * Vector3::new(p[0], p[1], 1.0)).z > 0.0;
        let ahead = pixels.iter().filter(ahead).count();
        if pixels.is_empty() || ahead > 0 { Ok(camera) } else { Err(CameraError::Behind) }
    }

    /// Puts samples in the places that their image points (deviation `sigma` px) show; the camera as it faces them, and
    /// which of the pixels cannot be placed.
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

    /// What is wrong where this camera shows most of the samples elsewhere than their image points say.
    pub(super) fn astray(&self, shown: &[Pixel], objects: &[Object], tracks: &[Track]) -> Option<Violation> {
        let one = |p: &Pixel| {
            let (object, sample) = (objects.get(p.object)?, tracks.get(p.object)?.samples.get(p.sample)?);
            let [u, v] = self.project(sample.position, object.shape.centre_height())?;
            Some(((u - p.point[0]).hypot(v - p.point[1]), p.point, [u, v], object.id, sample.frame))
        };
        let mut off: Vec<_> = shown.iter().filter_map(one).collect();
        off.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (distance, [u, v], [a, b], id, frame) = *off.get(off.len() / 2)?;
        (distance > ASTRAY * self.image_size[0]).then(|| Violation {
            path: format!("frame {frame}, object {id}: location"),
            message: format!(
                "is shown at ({a:.0}, {b:.0}) px by camera_matrix, but image_center is ({u:.0}, {v:.0}), and most are so: is an \
                 axis mirrored, or another unit than m used?"
            ),
        })
    }

    /// Whether a finite matrix has a rank below 3.
    pub(super) fn is_singular(&self) -> bool {
        let [a, b, c] = &self.matrix;
        let minor = |i: usize, j: usize, k: usize| {
            a[i] * (b[j] * c[k] - b[k] * c[j]) - a[j] * (b[i] * c[k] - b[k] * c[i])
                + a[k] * (b[i] * c[j] - b[j] * c[i])
        };
        let largest = [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)]
            .map(|(i, j, k)| minor(i, j, k).abs())
            .into_iter()
            .fold(0.0, f64::max);
        let length = |row: &[f64; 4]| row.iter().map(|v| v * v).sum::<f64>().sqrt();
        largest <= SINGULAR * self.matrix.iter().map(length).product::<f64>()
    }

    /// Homography from the plane at height `z` to the image.
    fn plane(&self, z: f64) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| match j {
            2 => self.matrix[i][2] * z + self.matrix[i][3],
            _ => self.matrix[i][j],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::CLEVRER_CAMERA;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn locate_undoes_project_and_its_covariance_is_the_slope(x in -3.0..4.0f64, y in -4.0..4.0f64, z in 0.0..0.5f64) {
            let camera = CLEVRER_CAMERA;
            let pixel = camera.project(vec2(x, y), z).unwrap();
            prop_assume!(camera.sees(vec2(x, y), z));
            let (found, covariance) = camera.locate(pixel, z, [0.5; 2]).unwrap();
            prop_assert!((found - vec2(x, y)).norm() < 1e-9);
            let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
            for k in 0..2 {
                let moved = |by: f64| {
                    let mut pixel = pixel;
                    pixel[k] += by;
                    camera.locate(pixel, z, [0.0; 2]).unwrap().0
                };
                let by = (moved(1e-4) - moved(-1e-4)).scaled(0.5 / 2e-4);
                (xx, xy, yy) = (xx + by.x * by.x, xy + by.x * by.y, yy + by.y * by.y);
            }
            let near = |a: f64, b: f64| (a - b).abs() < 1e-5 * covariance.mean();
            prop_assert!(near(xx, covariance.xx) && near(xy, covariance.xy) && near(yy, covariance.yy));
        }
    }

    #[test]
    fn what_is_not_below_the_horizon_is_refused() {
        let horizon = |pixel| CLEVRER_CAMERA.locate(pixel, 0.2, [0.5; 2]);
        // CLEVRER's camera looks down by 30 degrees: its horizon is at v = 160 - 525 tan 30 degrees, above the image.
        assert!(matches!(horizon([240.0, -143.2]), Err(LocateError::Horizon { .. })));
        assert!(horizon([240.0, -139.0]).is_ok());
        assert!(matches!(horizon([240.0, -500.0]), Err(LocateError::Outside { .. })));
        assert!(matches!(horizon([f64::NAN, 1.0]), Err(LocateError::NotFinite { .. })));
    }

    #[test]
    fn parts_make_the_matrix_and_wrong_parts_are_named() {
        // CLEVRER's camera: 525 px, tilted by 30 degrees, 5.77 m from where its axis meets the ground.
        let intrinsics = Intrinsics { focal: [525.0, 525.0], centre: [240.0, 160.0] };
        let (c, s) = (0.866025, 0.5);
        let rows = [[0.0, 1.0, 0.0], [s, 0.0, -c], [-c, 0.0, -s]];
        let translation = [0.0, 0.0, 5.0];
        let with =
            |rotation| Camera::from_parts(&intrinsics, &CameraPose { rotation, translation }, [480.0, 320.0]);
        let camera = with(Rotation::Matrix(rows)).unwrap();
        for (row, expected) in camera.matrix.iter().zip(CLEVRER_CAMERA.matrix) {
            assert!(row.iter().zip(expected).all(|(a, b)| (a - b).abs() < 2e-2), "{row:?}");
        }
        let vector = Rotation3::from_matrix_unchecked(Matrix3::from(rows).transpose()).scaled_axis();
        let same = with(Rotation::Vector(vector.into())).unwrap();
        assert!((same.matrix[0][1] - 525.0).abs() < 1e-3);
        assert!(matches!(with(Rotation::Vector([120.0, 0.0, 0.0])), Err(CameraError::Degrees { .. })));
        let mirrored = [rows[0].map(|v: f64| -v), rows[1], rows[2]];
        assert_eq!(with(Rotation::Matrix(mirrored)), Err(CameraError::Mirrored));
        assert_eq!(with(Rotation::Matrix([[1.0; 3]; 3])), Err(CameraError::NoRotation));
    }

    #[test]
    fn a_camera_faces_what_it_shows_or_is_mirrored() {
        let flipped = Camera { matrix: CLEVRER_CAMERA.matrix.map(|r| r.map(|v| -v)), ..CLEVRER_CAMERA };
        let pixels = [[240.0, 200.0], [100.0, 150.0]];
        assert_eq!(flipped.facing(&pixels, 0.2), Ok(CLEVRER_CAMERA));
        let mut mirrored = CLEVRER_CAMERA;
        mirrored.matrix[0] = mirrored.matrix[0].map(|v| -v);
        assert_eq!(mirrored.facing(&pixels, 0.2), Err(CameraError::Behind));
        mirrored.matrix[0] = mirrored.matrix[1];
        assert_eq!(mirrored.facing(&pixels, 0.2), Err(CameraError::Singular));
    }
}
