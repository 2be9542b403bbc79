//! The least-squares problem of a calibration: reprojection errors and priors, minimised by Levenberg-Marquardt.

use crate::num::{
    Bounds, LeastSquares, NormalEquations, Schedule, Stop, Stopped, elementary, levenberg_marquardt,
};
use crate::scene::camera::lens_pose::{LensPose, PointPair, residual, rotation};
use crate::scene::camera::linear_start::LIKELY_FOCAL;
use nalgebra::{DMatrix, DVector, Rotation3, SMatrix};

/// Standard deviation of the focal length's logarithm in the prior, whose mean is [`LIKELY_FOCAL`].
pub(super) const FOCAL_DEVIATION: f64 = 0.7;
/// Standard deviation of the logarithm of the pixel aspect in the prior.
const ASPECT_DEVIATION: f64 = 0.01;
/// Standard deviation of the principal point in the prior, as a share of the image's size.
const CENTRE_DEVIATION: f64 = 0.03;
/// Most iterations.
const MAX_ITERATIONS: usize = 100;

/// Pairs of which the derivatives are taken between two polls: some milliseconds.
const POLL_PAIRS: usize = 512;

/// Minimises the cost of `calibrate` at a fixed pixel noise `sigma` (px); also returns the standard deviation of the focal
/// length's logarithm.
pub(super) fn refine(
    pairs: &[PointPair],
    start: LensPose,
    (sigma, size): (f64, [f64; 2]),
    stop: Stop,
) -> Result<(LensPose, f64), Stopped> {
    let mut problem = Reprojection { pairs, sigma, size, focal_sd: FOCAL_DEVIATION, stop };
    let start = start.as_slice().to_vec();
    let found = levenberg_marquardt(&mut problem, start, None, &Schedule::MARQUARDT, MAX_ITERATIONS)?;
    stop(1.0)?;
    Ok((LensPose::from_column_slice(&found.point), problem.focal_sd))
}

/// The cost C of `calibrate`: residuals `r = (projected - measured) / s`, two rows a pair, and four rows of priors. C is infinite
/// where a pair lies behind the camera.
struct Reprojection<'p> {
    pairs: &'p [PointPair],
    sigma: f64,
    size: [f64; 2],
    /// Standard deviation of the logarithm of the focal length, at the last point with an invertible Hessian.
    focal_sd: f64,
    stop: Stop<'p>,
}

impl Reprojection<'_> {
    /// Mean and standard deviation of the priors.
    fn priors(&self) -> [(f64, f64); 4] {
        let focal = elementary::ln(LIKELY_FOCAL * self.size[0]);
        [
            (focal, FOCAL_DEVIATION),
            (0.0, ASPECT_DEVIATION),
            (0.0, CENTRE_DEVIATION * self.size[0]),
            (0.0, CENTRE_DEVIATION * self.size[1]),
        ]
    }

    fn cost(&self, at: &LensPose) -> f64 {
        let turn = rotation(at);
        let square = |p| {
            residual(at, &turn, p, self.size)
                .map_or(f64::INFINITY, |[u, v]| (u * u + v * v) / (self.sigma * self.sigma))
        };
        let of_priors: f64 = self
            .priors()
            .iter()
            .enumerate()
            .map(|(k, (mean, sd))| elementary::powi((at[k] - mean) / sd, 2))
            .sum();
        self.pairs.iter().map(square).sum::<f64>() + of_priors
    }

    /// Gradient `J^T r` (10) and Hessian `J^T J` (10 x 10), with J by central differences of the projection.
    fn normal(&self, at: &LensPose) -> (LensPose, SMatrix<f64, 10, 10>) {
        let mut hessian = SMatrix::<f64, 10, 10>::zeros();
        let mut gradient = LensPose::zeros();
        for (k, (mean, sd)) in self.priors().iter().enumerate() {
            hessian[(k, k)] += 1.0 / (sd * sd);
            gradient[k] += (at[k] - mean) / (sd * sd);
        }
        let moved: [[(LensPose, Rotation3<f64>, f64); 2]; 10] = std::array::from_fn(|k| {
            let step = 1e-6 * if matches!(k, 2 | 3) { self.size[0] } else { at[k].abs().max(1.0) };
            [step, -step].map(|step| {
                let mut at = *at;
                at[k] += step;
                (at, rotation(&at), step)
            })
        });
        let turn = rotation(at);
        for (i, pair) in self.pairs.iter().enumerate() {
            // Whoever stops takes no result: the next poll ends the search.
            if i % POLL_PAIRS == 0 && self.poll(0.0).is_err() {
                break;
            }
            let Some(r) = residual(at, &turn, pair, self.size) else { continue };
            let slope = |k: usize, c: usize| {
                let [(a, ta, step), (b, tb, _)] = &moved[k];
                let value = |at, turn| residual(at, turn, pair, self.size).map_or(r[c], |r| r[c]);
                (value(a, ta) - value(b, tb)) / (2.0 * step * self.sigma)
            };
            for (c, value) in r.into_iter().enumerate() {
                let j = LensPose::from_fn(|k, _| slope(k, c));
                hessian += j * j.transpose();
                gradient += j * (value / self.sigma);
            }
        }
        (gradient, hessian)
    }
}

impl LeastSquares for Reprojection<'_> {
    /// The cost.
    type Evaluation = f64;
    type Linearization = ();
    type Error = Stopped;

    fn evaluate(&mut self, point: &[f64]) -> Option<(f64, f64)> {
        let cost = self.cost(&LensPose::from_column_slice(point));
        Some((cost, cost))
    }
    fn linearize(&mut self, point: &[f64], known: Option<&f64>) -> ((), NormalEquations) {
        let at = LensPose::from_column_slice(point);
        let (gradient, hessian) = self.normal(&at);
        let inverse = hessian.try_inverse();
        self.focal_sd = inverse.map_or(self.focal_sd, |inverse| inverse[(0, 0)].max(0.0).sqrt());
        let normal = NormalEquations {
            cost: known.copied().unwrap_or_else(|| self.cost(&at)),
            gradient: DVector::from_column_slice(gradient.as_slice()),
            hessian: DMatrix::from_column_slice(10, 10, hessian.as_slice()),
        };
        ((), normal)
    }
    fn bounds(&self) -> &[Bounds] {
        &[Bounds::NONE; 10]
    }
    fn tolerance(&self, before: f64, _after: f64) -> f64 {
        1e-10 * (1.0 + before)
    }
    fn poll(&self, progress: f64) -> Result<(), Stopped> {
        (self.stop)(progress)
    }
}
