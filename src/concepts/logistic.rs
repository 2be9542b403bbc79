//! Logistic regression with a normal prior, its Laplace posterior and its evidence.
//!
//! With z the standardised features and a one, y = +-1: `C(w) = sum_i ln(1 + e^(-y_i w.z_i)) + sum_k w_k^2/(2 s_k^2)`. At the minimum w* with
//! Hessian H, `ln p(y) = -C(w*) - sum_k ln s_k - (1/2) ln det H` (MacKay, Neural Computation 4 (1992) 720).

use crate::num::elementary::{exp, ln};
use crate::reason::{LogisticWord, logistic};
use nalgebra::{DMatrix, DVector};

/// Standard deviations of a weight that are tried: a feature that hints, and one that decides.
const WEIGHT_SIGMAS: [f64; 3] = [1.0, 3.0, 10.0];
/// Of the bias: examples need not be as many of both kinds as objects are.
const BIAS_SIGMA: f64 = 5.0;
/// Newton steps; a convex cost of ten examples needs about eight.
const STEPS: usize = 40;

/// A regression on some columns, with its log evidence (nat).
pub struct LogisticFit {
    pub word: LogisticWord,
    pub evidence: f64,
}

/// Fits the columns of the rows to whether each fits the word; the best of the deviations that are tried.
pub fn fit_columns(rows: &[Vec<f64>], fits: &[bool], columns: &[usize]) -> LogisticFit {
    let chosen: Vec<Vec<f64>> = rows.iter().map(|r| columns.iter().map(|c| r[*c]).collect()).collect();
    let (mean, scale) = super::features::standard(&chosen);
    let n = columns.len() + 1;
    let mut best: Option<LogisticFit> = None;
    for sigma in WEIGHT_SIGMAS {
        let blank = LogisticWord {
            columns: columns.to_vec(),
            mean: mean.clone(),
            scale: scale.clone(),
            weights: vec![0.0; n],
            covariance: vec![0.0; n * n],
        };
        let fitted = posterior(blank, rows, fits, sigma);
        if best.as_ref().is_none_or(|b| fitted.evidence > b.evidence) {
            best = Some(fitted);
        }
        if columns.is_empty() {
            break;
        }
    }
    best.unwrap_or(LogisticFit {
        word: LogisticWord {
            columns: vec![],
            mean: vec![],
            scale: vec![],
            weights: vec![0.0],
            covariance: vec![1.0],
        },
        evidence: f64::NEG_INFINITY,
    })
}

fn posterior(mut word: LogisticWord, rows: &[Vec<f64>], fits: &[bool], sigma: f64) -> LogisticFit {
    let n = word.weights.len();
    let inputs: Vec<DVector<f64>> = rows.iter().map(|r| DVector::from_vec(word.inputs(r))).collect();
    // The prior of the weights together is that of one: more columns are no stronger.
    let spread = sigma / ((n - 1).max(1) as f64).sqrt();
    let sigma_of = |k: usize| if k + 1 == n { BIAS_SIGMA } else { spread };
    let precision: Vec<f64> = (0..n).map(|k| 1.0 / (sigma_of(k) * sigma_of(k))).collect();
    let cost = |w: &DVector<f64>| {
        let each = inputs.iter().zip(fits).map(|(z, fit)| {
            let m = if *fit { w.dot(z) } else { -w.dot(z) };
            // ln(1 + e^-m) without overflow.
            (-m).max(0.0) + ln(1.0 + exp(-m.abs()))
        });
        each.sum::<f64>() + 0.5 * (0..n).map(|k| precision[k] * w[k] * w[k]).sum::<f64>()
    };
    let mut w = DVector::zeros(n);
    let mut hessian = DMatrix::identity(n, n);
    for _ in 0..STEPS {
        let mut gradient = DVector::from_fn(n, |k, _| precision[k] * w[k]);
        hessian = DMatrix::from_diagonal(&DVector::from_vec(precision.clone()));
        for (z, fit) in inputs.iter().zip(fits) {
            let p = logistic(w.dot(z));
            gradient += z * (p - f64::from(u8::from(*fit)));
            hessian += z * z.transpose() * (p * (1.0 - p));
        }
        let Some(factor) = hessian.clone().cholesky() else { break };
        let step = factor.solve(&gradient);
        let (mut length, before) = (1.0, cost(&w));
        while length > 1e-3 && cost(&(&w - &step * length)) > before {
            length *= 0.5;
        }
        w -= &step * length;
        if step.norm() < 1e-9 {
            break;
        }
    }
    let (mut covariance, mut half_log_det) = (DMatrix::identity(n, n), 0.0);
    if let Some(factor) = hessian.cholesky() {
        half_log_det = (0..n).map(|k| ln(factor.l_dirty()[(k, k)])).sum();
        covariance = factor.inverse();
    }
    let log_sigmas: f64 = (0..n).map(|k| ln(sigma_of(k))).sum();
    let evidence = -cost(&w) - log_sigmas - half_log_det;
    word.weights = w.iter().copied().collect();
    word.covariance = covariance.iter().copied().collect();
    LogisticFit { word, evidence }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_prefers_the_feature_that_decides() {
        let rows: Vec<Vec<f64>> = (0..12).map(|k| vec![f64::from(k), f64::from(k * 7 % 12)]).collect();
        let fits: Vec<bool> = (0..12).map(|k| k >= 6).collect();
        let right = fit_columns(&rows, &fits, &[0]);
        let wrong = fit_columns(&rows, &fits, &[1]);
        let none = fit_columns(&rows, &fits, &[]);
        assert!(right.evidence > none.evidence + 2.0 && wrong.evidence < none.evidence + 0.5);
        assert!(right.word.probability(&[11.0, 0.0]) > 0.9 && right.word.probability(&[0.0, 0.0]) < 0.1);
        let middle = right.word.probability(&[5.5, 0.0]);
        assert!((middle - 0.5).abs() < 0.02, "{middle}");
    }

    /// The evidence of the bias alone against the integral over it.
    #[test]
    fn the_evidence_is_the_integral_of_the_likelihood() {
        let rows = vec![vec![]; 9];
        let fits: Vec<bool> = (0..9).map(|k| k < 5).collect();
        let (mut sum, h) = (0.0, 0.001);
        for k in -40_000..40_000 {
            let b = f64::from(k) * h;
            let prior = exp(-0.5 * b * b / 25.0) / (5.0 * (2.0 * std::f64::consts::PI).sqrt());
            let p = logistic(b);
            sum += h * prior * crate::num::elementary::powi(p, 5) * crate::num::elementary::powi(1.0 - p, 4);
        }
        let found = fit_columns(&rows, &fits, &[]).evidence;
        assert!((found - ln(sum)).abs() < 0.1, "{found} {}", ln(sum));
    }
}
