//! Huber's loss of a whitened residual.

/// Residuals beyond this many standard deviations count linearly, so that a wrong track cannot dominate the fit.
const THRESHOLD: f64 = 5.0;

/// The loss rho(r): r^2 / 2 up to the threshold h, beyond it h (abs(r) - h / 2).
pub(in super::super) fn huber(r: f64) -> f64 {
    if r.abs() <= THRESHOLD { 0.5 * r * r } else { THRESHOLD * (r.abs() - 0.5 * THRESHOLD) }
}

/// The weight rho'(r) / r of a residual in the normal equations (iteratively reweighted least squares).
pub(super) fn weight(r: f64) -> f64 {
    if r.abs() <= THRESHOLD { 1.0 } else { THRESHOLD / r.abs() }
}

/// The derivative rho'(r): the residual, clipped at the threshold.
pub(in super::super) fn influence(r: f64) -> f64 {
    r.clamp(-THRESHOLD, THRESHOLD)
}
