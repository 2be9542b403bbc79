//! The ten numbers of a camera that calibration fits, and the residual of a point pair.
//!
//! `theta = (ln f, ln aspect, c_u, c_v, w, t)`: focal length f along u (px) and pixel aspect f_v/f, offset of the principal point
//! from the image's middle (px), rotation vector w (rad, 3 numbers) and translation t (m, 3 numbers). With `q = R(w) X + t` a
//! world point X (m) has the pixel `u = W/2 + c_u + f q_x/q_z`, `v = H/2 + c_v + f aspect q_y/q_z` in an image of W x H px.

use crate::num::elementary;
use crate::scene::camera::projection::{CameraPose, Intrinsics, Rotation};
use nalgebra::{Matrix3, Rotation3, SVector, UnitQuaternion, Vector3};

/// A point with known coordinates in the image (px) and in the world (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointPair {
    pub image: [f64; 2],
    pub world: [f64; 3],
}

/// `theta` of the module's doc.
pub(super) type LensPose = SVector<f64, 10>;

/// `theta` from focal length (px), principal point offset (px), rotation and translation (m), if all is finite.
pub(super) fn lens_pose(
    focal: f64,
    centre: [f64; 2],
    turn: &Matrix3<f64>,
    t: Vector3<f64>,
) -> Option<LensPose> {
    // Through the quaternion, as the skew part of the matrix has no axis for a half turn (a camera that looks straight down).
    let axis = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*turn)).scaled_axis();
    let all = [elementary::ln(focal), 0.0, centre[0], centre[1], axis.x, axis.y, axis.z, t.x, t.y, t.z];
    all.iter().all(|v| v.is_finite()).then(|| LensPose::from(all))
}

pub(super) fn rotation(at: &LensPose) -> Rotation3<f64> {
    Rotation3::from_scaled_axis(Vector3::new(at[4], at[5], at[6]))
}

/// Intrinsics and pose in an image of this size (px).
pub(super) fn parts(at: &LensPose, size: [f64; 2]) -> (Intrinsics, CameraPose) {
    let (focal, aspect) = (elementary::exp(at[0]), elementary::exp(at[1]));
    let centre = [0.5 * size[0] + at[2], 0.5 * size[1] + at[3]];
    let turn = rotation(at);
    let rows = [0, 1, 2].map(|i| [0, 1, 2].map(|j| turn[(i, j)]));
    let pose = CameraPose { rotation: Rotation::Matrix(rows), translation: [at[7], at[8], at[9]] };
    (Intrinsics { focal: [focal, focal * aspect], centre }, pose)
}

/// Residual of a pair: projected minus measured pixel (px); `None` behind the camera.
pub(super) fn residual(
    at: &LensPose,
    turn: &Rotation3<f64>,
    pair: &PointPair,
    size: [f64; 2],
) -> Option<[f64; 2]> {
    let p = turn * Vector3::from(pair.world) + Vector3::new(at[7], at[8], at[9]);
    let (focal, aspect) = (elementary::exp(at[0]), elementary::exp(at[1]));
    let u = 0.5 * size[0] + at[2] + focal * p.x / p.z;
    let v = 0.5 * size[1] + at[3] + focal * aspect * p.y / p.z;
    (p.z > 0.0).then(|| [u - pair.image[0], v - pair.image[1]])
}

/// Length of the residual (px); infinite behind the camera.
pub(super) fn distance(at: &LensPose, pair: &PointPair, size: [f64; 2]) -> f64 {
    residual(at, &rotation(at), pair, size).map_or(f64::INFINITY, |[u, v]| elementary::hypot(u, v))
}
