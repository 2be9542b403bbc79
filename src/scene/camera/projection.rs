//! A pinhole camera: world to pixel, and a pixel back to a horizontal plane with its uncertainty.
//!
//! A world point `X = (x, y, z, 1)` (m) has the pixel `(u, v) = (a/c, b/c)` with `(a, b, c) = P X` and c its depth. The 3x4
//! projection matrix is `P = K [R | t]`: K holds focal lengths and principal point (px), R and t the pose (t in m).
//! Lens distortion is not modelled. Points at a known height z lie on a plane; `H_z = [p1 p2 (z p3 + p4)]`, with p the columns
//! of P, maps `(x, y, 1)` to the image. A pixel is located by its inverse, `(x, y) = (g1/g3, g2/g3)` with
//! `g = H_z^-1 (u, v, 1)`, where g3 is the reciprocal of the depth (zero on the horizon, negative above it).
//! Pixel errors of standard deviations s_u, s_v (px) give to first order the covariance (m^2)
//! `J diag(s_u^2, s_v^2) J^T`, `J = d(x, y)/d(u, v)` (2x2, m/px).
//! Sources: Hartley and Zisserman, Multiple View Geometry, 2nd ed., chapters 6 and 8.1.1; Ding et al. (2021), supplement, eq. 1.

use crate::num::{Vec2, elementary, vec2};
use crate::scene::covariance::Covariance;
use crate::scene::limits::MAX_POSITION;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// Least distance of a pixel from the horizon in its standard deviations; nearer ones have no usable position.
const MIN_HORIZON_DEVIATIONS: f64 = 3.0;
/// Least size of the largest 3x3 minor of a camera matrix, as a share of the product of the lengths of its rows. Below it the
/// matrix has a rank below 3 up to round-off.
const MIN_MINOR: f64 = 1e-9;
/// Largest deviation of a rotation's `R R^T` from the identity: matrices are typed with few digits.
const MAX_NON_ORTHONORMAL: f64 = 1e-3;

/// CLEVRER's published camera.
pub const CLEVRER_CAMERA: Camera = Camera {
    matrix: [[-207.846, 525.0, -120.0, 1200.0], [123.936, 0.0, -534.663, 800.0], [-0.866025, 0.0, -0.5, 5.0]],
    image_size: [480.0, 320.0],
};

/// A pinhole camera: world (m) to pixel, u to the right and v down; the world is right-handed with z up.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Rows of the 3x4 projection matrix.
    pub matrix: [[f64; 4]; 3],
    /// Width and height in pixels.
    pub image_size: [f64; 2],
}

/// Focal lengths and principal point of a camera without distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Focal lengths along u and v (px).
    pub focal: [f64; 2],
    /// Principal point: where the optical axis meets the image (px).
    pub centre: [f64; 2],
}

/// Position and orientation of a camera: a world point X has the camera coordinates `rotation X + translation`, with x to the
/// right, y down and z forward (OpenCV's convention).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPose {
    pub rotation: Rotation,
    /// m.
    pub translation: [f64; 3],
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rotation {
    /// Rotation vector: axis times angle (rad).
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
    #[error("turns by {angle:.1} rad, more than a full turn, which looks like degrees; give radians")]
    Degrees { angle: f64 },
    #[error("is singular: it maps a plane to a line or a point; give the 3x4 projection matrix")]
    Singular,
    #[error(
        "puts every image point behind the camera, so that an axis is mirrored; give u to the right, v down, and a \
         right-handed world with z up"
    )]
    Behind,
    #[error("is not a rotation matrix; give rows of length 1 that are perpendicular to each other")]
    NoRotation,
    #[error(
        "has the determinant -1, so that an axis is mirrored; give a right-handed rotation, with v down and z up"
    )]
    Mirrored,
}

impl CameraError {
    /// The field of the camera that is wrong.
    pub fn field(&self) -> &'static str {
        match self {
            CameraError::Focal { .. } => "focal_length",
            CameraError::Singular | CameraError::Behind => "matrix",
            _ => "rotation",
        }
    }
}

/// Why a pixel has no position on a horizontal plane.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LocateError {
    #[error("({u}, {v}) px is not finite; give finite pixel coordinates")]
    NotFinite { u: f64, v: f64 },
    #[error(
        "({u}, {v}) px lies far outside the image of {width} x {height} px; give pixels of this image, u to the right, v down"
    )]
    Outside { u: f64, v: f64, width: f64, height: f64 },
    #[error(
        "({u}, {v}) px lies on or above the horizon of the plane {z} m above the ground, so that it has no position; check the \
         camera, and that v increases downwards"
    )]
    Horizon { u: f64, v: f64, z: f64 },
    #[error(
        "the plane {z} m above the ground passes through the camera; check the camera and the object's size"
    )]
    EdgeOn { z: f64 },
}

impl Camera {
    /// The projection matrix `K [R | t]`.
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
                if (rotation * rotation.transpose() - Matrix3::identity()).amax() > MAX_NON_ORTHONORMAL {
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

    /// The point at height `z` (m) that a pixel shows, and its covariance for pixel coordinates with the standard deviations
    /// `sigma` (px).
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
        // `ray.z` is the reciprocal of the depth.
        let spread = elementary::hypot(sigma[0] * inverse[(2, 0)], sigma[1] * inverse[(2, 1)]);
        if !(ray.z > MIN_HORIZON_DEVIATIONS * spread && ray.z > 1e-12) {
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

    /// The same camera with the sign of its matrix, which is free, chosen so that points in front have a positive depth. Fails
    /// if all these pixels of the plane at height `z` (m) are behind the camera: an axis is mirrored then.
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

    /// Whether a finite matrix has a rank below 3.
    pub(in crate::scene) fn is_singular(&self) -> bool {
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
        largest <= MIN_MINOR * self.matrix.iter().map(length).product::<f64>()
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
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn locate_inverts_project_and_its_covariance_is_first_order(x in -3.0..4.0f64, y in -4.0..4.0f64, z in 0.0..0.5f64) {
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
    fn pixels_on_or_above_the_horizon_are_refused() {
        let horizon = |pixel| CLEVRER_CAMERA.locate(pixel, 0.2, [0.5; 2]);
        // CLEVRER's camera looks down by 30 degrees: its horizon is at v = 160 - 525 tan 30 degrees, above the image.
        assert!(matches!(horizon([240.0, -143.2]), Err(LocateError::Horizon { .. })));
        assert!(horizon([240.0, -139.0]).is_ok());
        assert!(matches!(horizon([240.0, -500.0]), Err(LocateError::Outside { .. })));
        assert!(matches!(horizon([f64::NAN, 1.0]), Err(LocateError::NotFinite { .. })));
    }

    #[test]
    fn intrinsics_and_pose_give_the_matrix_and_wrong_ones_are_named() {
        // CLEVRER's camera: focal length 525 px, tilted by 30 degrees; its axis meets the ground at a distance of 5.77 m.
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
    fn the_sign_of_the_matrix_is_chosen_and_a_mirrored_one_is_refused() {
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
