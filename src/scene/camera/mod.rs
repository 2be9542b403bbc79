//! The camera: projection, the way back to the ground plane, samples from image points, and calibration.

mod calibrate;
pub(in crate::scene) mod lens_pose;
mod linear_start;
pub(in crate::scene) mod placement;
pub(in crate::scene) mod projection;
mod reprojection;

pub use calibrate::{CalibrateError, Calibration, MAX_PAIRS, calibrate};
pub use lens_pose::PointPair;
pub use placement::{IMAGE_NOISE, IMAGE_NOISE_RANGE, Pixel};
pub use projection::{CLEVRER_CAMERA, Camera, CameraError, CameraPose, Intrinsics, LocateError, Rotation};
