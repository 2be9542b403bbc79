//! Estimates a camera from points with known coordinates in the image and in the world.
//!
//! Minimised over `theta` (10 numbers, see `lens_pose`) is
//! `C(theta) = sum_i |r_i|^2 / s^2 + sum_k ((theta_k - m_k) / d_k)^2`, with the residual `r_i` (2 numbers, px) of pair i, the
//! pixel noise s (px), and priors of means m and standard deviations d on ln f, ln aspect and the principal point (k = 1..4).
//! The priors matter where points leave the lens undetermined, as points of one plane do. Residuals have 2N + 4 rows for N
//! pairs, the Jacobian `J = d r / d theta` (central differences) is (2N + 4) x 10.
//!
//! 1. Starting values: direct linear transforms (`linear_start`).
//! 2. Levenberg-Marquardt (Marquardt, 1963): `(J^T J + lambda diag(J^T J)) step = J^T r`, lambda divided by 10 after a step that
//!    lowers C, else multiplied by 10, until C falls by less than 1e-10 of its value.
//! 3. s is the median of |r_i| divided by 1.1774 (the median of a Rayleigh distribution); pairs with `|r_i| > 4 s` are outliers
//!    and left out. Steps 2 and 3 repeat until s changes by less than 0.1 %.
//! 4. The standard deviation of ln f is the root of the first diagonal entry of `(J^T J)^-1`.
//!
//! Source: Hartley and Zisserman, Multiple View Geometry, 2nd ed., section 7.2.

use crate::num::{Vec2, vec2};
use crate::scene::camera::lens_pose::{LensPose, PointPair, distance, off, parts, rotation};
use crate::scene::camera::linear_start::{
    LIKELY_FOCAL, MAX_PLANE_THICKNESS, MIN_PAIRS, MIN_VOLUME_THICKNESS, PointPlane, starting_values,
};
use crate::scene::camera::projection::{Camera, Intrinsics};
use nalgebra::{Rotation3, SMatrix, Vector3};

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
/// Standard deviation of the focal length's logarithm in the prior, whose mean is [`LIKELY_FOCAL`].
const FOCAL_DEVIATION: f64 = 0.7;
/// Standard deviation of the logarithm of the pixel aspect in the prior.
const ASPECT_DEVIATION: f64 = 0.01;
/// Standard deviation of the principal point in the prior, as a share of the image's size.
const CENTRE_DEVIATION: f64 = 0.03;
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
}

/// Estimates the camera of an image of this size (px) from point pairs. Deterministic. Of eight or more pairs up to about
/// 40 % may be wrong; of fewer none is left out.
pub fn calibrate(pairs: &[PointPair], image_size: [f64; 2]) -> Result<Calibration, CalibrateError> {
    check(pairs, image_size)?;
    let cloud = PointPlane::of(pairs).map_err(|field| CalibrateError::OnALine { field })?;
    let best = best(pairs, &cloud, image_size);
    // No camera fits a mirrored volume, but one fits its mirror image. A mirrored plane looks like one seen from below.
    let mirror = |p: &PointPair| PointPair { image: [p.image[0], image_size[1] - p.image[1]], ..*p };
    if cloud.thickness >= MIN_VOLUME_THICKNESS {
        let mirrored: Vec<PointPair> = pairs.iter().map(mirror).collect();
        let reflected = self::best(&mirrored, &cloud, image_size);
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
fn best(pairs: &[PointPair], cloud: &PointPlane, size: [f64; 2]) -> Option<CameraFit> {
    let refined = starting_values(pairs, cloud, size).into_iter().map(|start| robust(pairs, start, size));
    refined.filter(|f| f.sigma.is_finite()).min_by(|a, b| a.sigma.total_cmp(&b.sigma))
}

/// Least squares without outliers; noise and outliers are estimated again after each fit.
fn robust(pairs: &[PointPair], start: LensPose, size: [f64; 2]) -> CameraFit {
    let sigma = |at: &LensPose| {
        if 2 * pairs.len() < 10 + MIN_SURPLUS {
            return DEFAULT_NOISE;
        }
        let mut all: Vec<f64> = pairs.iter().map(|p| distance(at, p, size)).collect();
        let middle = all.len() / 2;
        // The median of a Rayleigh distribution, the length of a two-dimensional normal deviate.
        (*all.select_nth_unstable_by(middle, f64::total_cmp).1 / 1.177_410_022_515_474_6).max(MIN_NOISE)
    };
    let mut found = CameraFit { at: start, sigma: sigma(&start), focal_sd: FOCAL_DEVIATION };
    for _ in 0..6 {
        let near = |p: &&PointPair| {
            pairs.len() < 2 * MIN_PAIRS || distance(&found.at, p, size) <= OUTLIER_DEVIATIONS * found.sigma
        };
        let inliers: Vec<PointPair> = pairs.iter().filter(near).copied().collect();
        let (at, focal_sd) = refine(&inliers, found.at, found.sigma, size);
        let before = found.sigma;
        found = CameraFit { at, sigma: sigma(&at), focal_sd };
        if (found.sigma / before - 1.0).abs() < 1e-3 {
            break;
        }
    }
    if 2 * pairs.len() < 10 + MIN_SURPLUS {
        // Too few pairs to estimate the noise; this value only ranks the starting values.
        let squares: f64 = pairs.iter().map(|p| distance(&found.at, p, size).powi(2)).sum();
        found.sigma = DEFAULT_NOISE.max((squares / pairs.len() as f64).sqrt());
    }
    found
}

/// Minimises C by Levenberg-Marquardt; also returns the standard deviation of the focal length's logarithm.
fn refine(pairs: &[PointPair], start: LensPose, sigma: f64, size: [f64; 2]) -> (LensPose, f64) {
    let mean = |k: usize| if k == 0 { (LIKELY_FOCAL * size[0]).ln() } else { 0.0 };
    let prior = [FOCAL_DEVIATION, ASPECT_DEVIATION, CENTRE_DEVIATION * size[0], CENTRE_DEVIATION * size[1]];
    let cost = |at: &LensPose| {
        let turn = rotation(at);
        let square =
            |p| off(at, &turn, p, size).map_or(f64::INFINITY, |[u, v]| (u * u + v * v) / (sigma * sigma));
        let of_priors: f64 = prior.iter().enumerate().map(|(k, sd)| ((at[k] - mean(k)) / sd).powi(2)).sum();
        pairs.iter().map(square).sum::<f64>() + of_priors
    };
    let (mut at, mut damping) = (start, 1e-3);
    let mut now = cost(&at);
    let mut focal_sd = prior[0];
    for _ in 0..100 {
        let mut hessian = SMatrix::<f64, 10, 10>::zeros();
        let mut gradient = LensPose::zeros();
        for (k, sd) in prior.iter().enumerate() {
            hessian[(k, k)] += 1.0 / (sd * sd);
            gradient[k] += (at[k] - mean(k)) / (sd * sd);
        }
        let moved: [[(LensPose, Rotation3<f64>, f64); 2]; 10] = std::array::from_fn(|k| {
            let step = 1e-6 * if matches!(k, 2 | 3) { size[0] } else { at[k].abs().max(1.0) };
            [step, -step].map(|step| {
                let mut at = at;
                at[k] += step;
                (at, rotation(&at), step)
            })
        });
        let turn = rotation(&at);
        for pair in pairs {
            let Some(r) = off(&at, &turn, pair, size) else { continue };
            let slope = |k: usize, c: usize| {
                let [(a, ta, step), (b, tb, _)] = &moved[k];
                let value = |at, turn| off(at, turn, pair, size).map_or(r[c], |r| r[c]);
                (value(a, ta) - value(b, tb)) / (2.0 * step * sigma)
            };
            for (c, residual) in r.into_iter().enumerate() {
                let j = LensPose::from_fn(|k, _| slope(k, c));
                hessian += j * j.transpose();
                gradient += j * (residual / sigma);
            }
        }
        focal_sd = hessian.try_inverse().map_or(focal_sd, |inverse| inverse[(0, 0)].max(0.0).sqrt());
        let mut better = false;
        while damping < 1e12 {
            let mut damped = hessian;
            (0..10).for_each(|k| damped[(k, k)] *= 1.0 + damping);
            let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else {
                damping *= 10.0;
                continue;
            };
            let trial = at - step;
            let then = cost(&trial);
            if then < now {
                better = now - then > 1e-10 * (1.0 + now);
                (at, now, damping) = (trial, then, (0.1 * damping).max(1e-12));
                break;
            }
            damping *= 10.0;
        }
        if !better {
            break;
        }
    }
    (at, focal_sd)
}
