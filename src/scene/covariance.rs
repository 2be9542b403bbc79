//! The covariance of the error of a measured position.

use serde::{Deserialize, Serialize};

/// Covariance of the error of a position (m^2). Its directions and its size relative to other samples matter; a fit
/// multiplies all covariances of a video by one factor, so that they agree with the scatter of its tracks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Covariance {
    pub xx: f64,
    pub xy: f64,
    pub yy: f64,
}

impl Covariance {
    /// The lower triangular factor L with `L L^T = covariance` (m): its xx, yx and yy. `None` where the covariance is not
    /// positive definite.
    pub fn factor(&self) -> Option<[f64; 3]> {
        let xx = self.xx.sqrt();
        let yx = self.xy / xx;
        let yy = (self.yy - yx * yx).sqrt();
        (xx > 0.0 && yy > 0.0 && xx.is_finite() && yy.is_finite()).then_some([xx, yx, yy])
    }

    /// Mean variance of a coordinate (m^2).
    pub fn mean(&self) -> f64 {
        0.5 * (self.xx + self.yy)
    }

    /// Mean of the mean variances of those that are stated (m^2); `None` where none is.
    pub fn mean_variance(stated: impl Iterator<Item = Option<Covariance>>) -> Option<f64> {
        let all = stated.flatten().map(|c| c.mean());
        let (sum, count) = all.fold((0.0, 0), |(sum, n), variance| (sum + variance, n + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    pub fn scaled(&self, factor: f64) -> Covariance {
        Covariance { xx: factor * self.xx, xy: factor * self.xy, yy: factor * self.yy }
    }
}
