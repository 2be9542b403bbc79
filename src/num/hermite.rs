//! Cubic Hermite interpolation: between two instants, from values and rates at both.
//!
//! With h = t1 - t0 (s), the share q = (t - t0) / h, values x0, x1 and rates v0, v1 (1/s) at the ends,
//!
//! x(q)  = (1 - 3 q^2 + 2 q^3) x0 + (3 q^2 - 2 q^3) x1 + h [(q - 2 q^2 + q^3) v0 + (q^3 - q^2) v1]
//! x'(q) = 6 (q - q^2) / h (x1 - x0) + (1 - 4 q + 3 q^2) v0 + (3 q^2 - 2 q) v1.
//!
//! Source: de Boor, A Practical Guide to Splines (1978), chapter IV.

use super::real::Real;

/// Weights of the ends at one share of the interval.
#[derive(Debug, Clone, Copy)]
pub struct HermiteWeights<T> {
    /// Weights of x0, x1, h v0 and h v1 in the value.
    pub x0: T,
    pub x1: T,
    pub v0: T,
    pub v1: T,
    /// Weights of (x1 - x0) / h, v0 and v1 in the rate.
    pub rate_x: T,
    pub rate_v0: T,
    pub rate_v1: T,
}

/// The weights at the share `q` of the interval, 0..=1.
#[inline]
pub fn hermite<T: Real>(q: T) -> HermiteWeights<T> {
    let (q2, q3) = (q * q, q * q * q);
    let one = T::constant(1.0);
    HermiteWeights {
        x0: one - q2 * 3.0 + q3 * 2.0,
        x1: q2 * 3.0 - q3 * 2.0,
        v0: q - q2 * 2.0 + q3,
        v1: q3 - q2,
        rate_x: (q - q2) * 6.0,
        rate_v0: one - q * 4.0 + q2 * 3.0,
        rate_v1: q2 * 3.0 - q * 2.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_reproduced() {
        let (x, v) = (|t: f64| 1.0 + t * (2.0 - t * (3.0 - t)), |t: f64| 2.0 - t * (6.0 - 3.0 * t));
        let (t0, h) = (0.4, 1.5);
        let (x0, v0, x1, v1) = (x(t0), v(t0), x(t0 + h), v(t0 + h));
        for q in [0.0, 0.3, 0.8, 1.0] {
            let w = hermite(q);
            let value = w.x0 * x0 + w.x1 * x1 + h * (w.v0 * v0 + w.v1 * v1);
            let rate = w.rate_x / h * (x1 - x0) + w.rate_v0 * v0 + w.rate_v1 * v1;
            let t = t0 + q * h;
            assert!((value - x(t)).abs() < 1e-12 && (rate - v(t)).abs() < 1e-12, "{q}: {value} {rate}");
        }
    }
}
