//! Estimates a camera from points with known coordinates in the image and in the world.
//!
//! Minimised over `theta` (10 numbers, see `lens_pose`) is
//! `C(theta) = sum_i |r_i|^2 / s^2 + sum_k ((theta_k - m_k) / d_k)^2`, with the residual `r_i` (2 numbers, px) of pair i, the
//! pixel noise s (px), and priors of means m and standard deviations d on ln f, ln aspect and the principal point (k = 1..4).
//! The priors matter where points leave the lens undetermined, as points of one plane do. Residuals have 2N + 4 rows for N
//! pairs, the Jacobian `J = d r / d theta` (central differences) is (2N + 4) x 10.
//!
//! 1. Starting values: direct linear transforms (`linear_start`).
//! 2. Levenberg-Marquardt (`num/least_squares.rs`, `reprojection`), until C falls by less than 1e-10 of its value.
//! 3. s is the median of |r_i| divided by 1.1774 (the median of a Rayleigh distribution); pairs with `|r_i| > 4 s` are outliers
//!    and left out. Steps 2 and 3 repeat until s changes by less than 0.1 %.
//! 4. The standard deviation of ln f is the root of the first diagonal entry of `(J^T J)^-1`.
//!
//! Source: Hartley and Zisserman, Multiple View Geometry, 2nd ed., section 7.2.

use crate::num::{NORMAL_MEDIAN_DISTANCE, Stop, Stopped, Vec2, elementary, quantile, vec2};
use crate::scene::camera::lens_pose::{LensPose, PointPair, distance, parts, rotation};
use crate::scene::camera::linear_start::{
    MAX_PLANE_THICKNESS, MIN_PAIRS, MIN_VOLUME_THICKNESS, PointPlane, starting_values,
};
use crate::scene::camera::projection::{Camera, Intrinsics};
use crate::scene::camera::reprojection::{FOCAL_DEVIATION, refine};
use nalgebra::Vector3;

/// Most pairs; more do not improve the estimate.
pub const MAX_PAIRS: usize = 20_000;
/// Residual in standard deviations from which a pair is an outlier.
const OUTLIER_DEVIATIONS: f64 = 4.0;
/// Area of three of four points in the image, as a share of the largest such area, below which they lie on a line.
const MIN_AREA_SHARE: f64 = 0.01;
/// Pixel noise where the pairs are too few to estimate it (px).
const DEFAULT_NOISE: f64 = 1.0;
/// Least pixel noise (px).
const MIN_NOISE: f64 = 1e-3;
/// Residuals beyond the number of parameters from which the pixel noise is estimated.
const MIN_SURPLUS: usize = 8;
/// Largest root mean square residual of a calibration, as a share of the image's width.
const MAX_ERROR_SHARE: f64 = 0.05;

/// An estimated camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    pub camera: Camera,
    pub intrinsics: Intrinsics,
    /// Standard deviation of the focal length along u (px).
    pub focal_sd: f64,
    /// Position of the camera (m).
    pub position: [f64; 3],
    /// Root mean square residual of a coordinate (px), outliers left out.
    pub reprojection_error: f64,
    /// Indices of the pairs left out.
    pub outliers: Vec<usize>,
    /// Whether the points lie in one plane: for heights far from it the camera then depends on the priors.
    pub planar: bool,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    #[error("pairs: {given} were given; give at least {MIN_PAIRS} that are not on one line")]
    TooFew { given: usize },
    #[error("pairs: {given} were given; give at most {MAX_PAIRS}")]
    TooMany { given: usize },
    #[error("pairs[{index}].{field}: has a number that is not finite or is beyond 1e9; correct it")]
    NotFinite { index: usize, field: &'static str },
    #[error("image_size: is {width} x {height}; give width and height in pixels, from 1 to 1e6")]
    ImageSize { width: f64, height: f64 },
    #[error("pairs: all {field} points lie on one line; give points that span the table")]
    OnALine { field: &'static str },
    #[error(
        "pairs: three of the four points lie on one line in the image; give four corners, or more points"
    )]
    ThreeOnALine,
    #[error(
        "pairs: an axis is mirrored, or corners are in the wrong order; give u to the right, v down, and a right-handed world \
         with z up (seen from above, y is a quarter turn counter-clockwise from x)"
    )]
    Mirrored,
    #[error(
        "pairs: no camera fits; the best has an error of {error:.1} px; check the order of the points and the units"
    )]
    NoCamera { error: f64 },
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

/// Estimates the camera of an image of this size (px) from point pairs. Deterministic. Of eight or more pairs up to about
/// 40 % may be wrong; of fewer none is left out.
pub fn calibrate(
    pairs: &[PointPair],
    image_size: [f64; 2],
    stop: Stop,
) -> Result<Calibration, CalibrateError> {
    check(pairs, image_size)?;
    let cloud = PointPlane::of(pairs).map_err(|field| CalibrateError::OnALine { field })?;
    let best = best(pairs, &cloud, image_size, stop)?;
    // No camera fits a mirrored volume, but one fits its mirror image. A mirrored plane looks like one seen from below.
    let mirror = |p: &PointPair| PointPair { image: [p.image[0], image_size[1] - p.image[1]], ..*p };
    if cloud.thickness >= MIN_VOLUME_THICKNESS {
        let mirrored: Vec<PointPair> = pairs.iter().map(mirror).collect();
        let reflected = self::best(&mirrored, &cloud, image_size, stop)?;
        if reflected.as_ref().map_or(f64::INFINITY, |m| m.sigma)
            < 0.5 * best.as_ref().map_or(f64::INFINITY, |b| b.sigma)
        {
            return Err(CalibrateError::Mirrored);
        }
    }
    let Some(found) = best else { return Err(CalibrateError::NoCamera { error: image_size[0] }) };
    let (intrinsics, pose) = parts(&found.at, image_size);
    let (rotation, translation) = (rotation(&found.at), Vector3::from(pose.translation));
    let position = -(rotation.inverse() * translation);
    // A table is seen from above; a wall may be seen from either side.
    let below = (position - cloud.centre).dot(&cloud.normal) < 0.0;
    if below && cloud.normal.z > 0.5 && cloud.thickness < MAX_PLANE_THICKNESS {
        return Err(CalibrateError::Mirrored);
    }
    let residuals: Vec<f64> = pairs.iter().map(|p| distance(&found.at, p, image_size)).collect();
    let kept = |r: &&f64| pairs.len() < 2 * MIN_PAIRS || **r <= OUTLIER_DEVIATIONS * found.sigma;
    let inliers = residuals.iter().filter(kept).count();
    let squares: f64 = residuals.iter().filter(kept).map(|r| r * r).sum();
    let error = (squares / (2 * inliers).max(1) as f64).sqrt();
    if inliers < MIN_PAIRS || !error.is_finite() || error > MAX_ERROR_SHARE * image_size[0] {
        return Err(CalibrateError::NoCamera { error });
    }
    let camera =
        Camera::from_parts(&intrinsics, &pose, image_size).map_err(|_| CalibrateError::NoCamera { error })?;
    Ok(Calibration {
        camera,
        intrinsics,
        focal_sd: intrinsics.focal[0] * found.focal_sd,
        position: position.into(),
        reprojection_error: error,
        outliers: (0..pairs.len()).filter(|&i| !kept(&&residuals[i])).collect(),
        planar: cloud.thickness < MIN_VOLUME_THICKNESS,
    })
}

fn check(pairs: &[PointPair], [width, height]: [f64; 2]) -> Result<(), CalibrateError> {
    if pairs.len() < MIN_PAIRS {
        return Err(CalibrateError::TooFew { given: pairs.len() });
    }
    if pairs.len() > MAX_PAIRS {
        return Err(CalibrateError::TooMany { given: pairs.len() });
    }
    if !((1.0..=1e6).contains(&width) && (1.0..=1e6).contains(&height)) {
        return Err(CalibrateError::ImageSize { width, height });
    }
    for (index, pair) in pairs.iter().enumerate() {
        let fields = [("image", &pair.image[..]), ("world", &pair.world[..])];
        if let Some((field, _)) = fields.iter().find(|f| f.1.iter().any(|v| !(-1e9..1e9).contains(v))) {
            return Err(CalibrateError::NotFinite { index, field });
        }
    }
    if let [a, b, c, d] = pairs {
        let [a, b, c, d] = [a, b, c, d].map(|p| vec2(p.image[0], p.image[1]));
        let area = |[p, q, r]: [Vec2; 3]| (q - p).cross(r - p).abs();
        let areas = [[a, b, c], [a, b, d], [a, c, d], [b, c, d]].map(area);
        let widest = areas.into_iter().fold(0.0, f64::max);
        // Four points on one line are reported as such elsewhere.
        if widest > 0.0 && areas.into_iter().any(|area| area <= MIN_AREA_SHARE * widest) {
            return Err(CalibrateError::ThreeOnALine);
        }
    }
    Ok(())
}

/// A fitted camera.
struct CameraFit {
    at: LensPose,
    /// Pixel noise (px).
    sigma: f64,
    /// Standard deviation of the focal length's logarithm.
    focal_sd: f64,
}

/// The best camera over all starting values.
fn best(
    pairs: &[PointPair],
    cloud: &PointPlane,
    size: [f64; 2],
    stop: Stop,
) -> Result<Option<CameraFit>, Stopped> {
    let starts = starting_values(pairs, cloud, size, stop)?.into_iter();
    let refined: Vec<CameraFit> =
        starts.map(|start| robust(pairs, start, size, stop)).collect::<Result<_, _>>()?;
    Ok(refined.into_iter().filter(|f| f.sigma.is_finite()).min_by(|a, b| a.sigma.total_cmp(&b.sigma)))
}

/// Least squares without outliers; noise and outliers are estimated again after each fit.
fn robust(pairs: &[PointPair], start: LensPose, size: [f64; 2], stop: Stop) -> Result<CameraFit, Stopped> {
    let sigma = |at: &LensPose| {
        if 2 * pairs.len() < 10 + MIN_SURPLUS {
            return DEFAULT_NOISE;
        }
        let mut all: Vec<f64> = pairs.iter().map(|p| distance(at, p, size)).collect();
        let noise = quantile(&mut all, 0.5).map(|median| median / NORMAL_MEDIAN_DISTANCE);
        noise.map_or(DEFAULT_NOISE, |noise| noise.max(MIN_NOISE))
    };
    let mut found = CameraFit { at: start, sigma: sigma(&start), focal_sd: FOCAL_DEVIATION };
    for _ in 0..6 {
        let near = |p: &&PointPair| {
            pairs.len() < 2 * MIN_PAIRS || distance(&found.at, p, size) <= OUTLIER_DEVIATIONS * found.sigma
        };
        let inliers: Vec<PointPair> = pairs.iter().filter(near).copied().collect();
        let (at, focal_sd) = refine(&inliers, found.at, (found.sigma, size), stop)?;
        let before = found.sigma;
        found = CameraFit { at, sigma: sigma(&at), focal_sd };
        if (found.sigma / before - 1.0).abs() < 1e-3 {
            break;
        }
    }
    if 2 * pairs.len() < 10 + MIN_SURPLUS {
        // Too few pairs to estimate the noise; this value only ranks the starting values.
        let squares: f64 = pairs.iter().map(|p| elementary::powi(distance(&found.at, p, size), 2)).sum();
        found.sigma = DEFAULT_NOISE.max((squares / pairs.len() as f64).sqrt());
    }
    Ok(found)
}
