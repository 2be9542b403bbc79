//! Errors of neighbouring frames that depend on each other: positions that were smoothed, filtered or interpolated.
//!
//! Each window of N samples, taken at even times, is written in N orthonormal polynomials (Gram). Motion is in those of the lowest
//! degrees, slow errors in the next ones, fast ones in the rest. Of independent errors the mean squares of slow and fast ones have the
//! ratio 1, that is r = F(6, 24) for two coordinates. A filter, a mean, or a spline multiplies it in *every* window by one
//! factor rho > 1: it lets slow errors through, and it lags behind after each contact. A contact multiplies it in its own window by
//! anything. So the ratios of all windows are a mixture, and its likelihood is compared with that for rho = 1:
//!
//! L(rho) = max over f of sum log((1 - f) F(r / rho) + f B(r)),
//!
//! where B is F with a factor that is log-uniform from 10^-3 to 10^6. Windows overlap by half, so that their likelihoods count 3/4.
//!
//! Short videos have few windows. In them a mean of n frames, with its sharp ends, still shows in the correlation r_k of third
//! differences at lags of 4 to 16 frames, where independent errors have none: |r_k| > z sqrt((1 + 2 sum_j rho_j^2) / N) (Bartlett, J. Roy.
//! Stat. Soc. Suppl. 8 (1946) 27; rho_j of the third differences of independent numbers). Contacts are cut off at three deviations. Motion between contacts lives where errors are slow, so that the slow
//! deviation, sqrt(rho) times the fast one, is the noise of a fit (Whittle's likelihood: Hannan, J. Appl. Prob. 10 (1973) 130).

use crate::num::{NORMAL_MEDIAN_ABSOLUTE, elementary, quantile};
use crate::scene::observation::{Sample, Scene, Track};

/// Lags at which third differences of independent errors do not depend on each other (frames).
const LAGS: std::ops::RangeInclusive<usize> = 4..=16;
/// One plus twice the sum of squares of the first three correlations of third differences: -3/4, 3/10, -1/20.
const BARTLETT: f64 = 2.31;
/// Deviations beyond chance, for 13 lags.
const CERTAIN: f64 = 4.0;
/// Least correlation that is reported: smoothing over three samples gives 0.33, over seven 0.5.
const LEAST: f64 = 0.15;
/// Third differences are cut off at so many deviations.
const CUT: f64 = 3.0;

/// Samples of a window, and degrees of slow and of fast errors in it.
const WINDOW: usize = 24;
const SLOW: std::ops::Range<usize> = 5..8;
const FAST: std::ops::Range<usize> = 12..24;
/// Gain in log likelihood that shows a factor: odds of 10^5 to 1.
const GAIN: f64 = 11.5;
/// Windows overlap by half.
const INDEPENDENT: f64 = 0.75;
/// Slow errors that are larger by less than this change no result.
const SLIGHT: f64 = 1.25;
/// Factors (logarithms) that one window may have.
const ANY: std::ops::Range<f64> = -6.9..13.8;
/// Factors that all windows may have in common: largest logarithm, and steps of the search.
const LARGEST: f64 = 9.2;
const STEPS: usize = 184;
/// A gap or a time that differs by more than this share of a frame makes a window uneven.
const EVEN: f64 = 0.05;
/// The measured point of an object moves about its centre by this share of its radius: it turns, and gives way.
const OFF_CENTRE: f64 = 3e-3;
/// Smaller deviations (m) are round-off.
const ROUND_OFF: f64 = 1e-9;

/// Deviation of slow errors over that of fast ones where neighbouring errors depend on each other; else 1. Rounding to `step` (m) of
/// what moves little is slow, too, and no filter.
pub fn dependence(scene: &Scene, step: f64) -> f64 {
    let (gain, _) = common_factor(&ratios(scene, |radius| step + OFF_CENTRE * radius));
    let (_, ratio) = common_factor(&ratios(scene, |_| step));
    if (gain > GAIN || depends(scene)) && ratio > SLIGHT { ratio } else { 1.0 }
}

/// The gain in log likelihood of the best common factor, and that of deviations.
fn common_factor(ratios: &[f64]) -> (f64, f64) {
    let likelihoods: Vec<f64> = (0..=STEPS).map(|k| log_likelihood(ratios, factor(k))).collect();
    let best = (0..=STEPS).max_by(|a, b| likelihoods[*a].total_cmp(&likelihoods[*b])).unwrap_or(0);
    (INDEPENDENT * (likelihoods[best] - likelihoods[0]), elementary::exp(0.5 * factor(best)))
}

fn factor(step: usize) -> f64 {
    LARGEST * step as f64 / STEPS as f64
}

const AXES: [fn(&Sample) -> f64; 2] = [|s| s.position.x, |s| s.position.y];

/// Logarithms of the ratios of mean squares of all windows, with slow errors (m) that are none of a filter, given the object's radius.
fn ratios(scene: &Scene, other: impl Fn(f64) -> f64) -> Vec<f64> {
    let basis = gram(WINDOW);
    let mut all = vec![];
    for (object, track) in scene.objects.iter().zip(&scene.tracks) {
        let other = other(object.shape.inscribed_radius());
        for window in track.samples.windows(WINDOW).step_by(WINDOW / 2).filter(|w| is_even(scene, w)) {
            let mean_square = |degrees: std::ops::Range<usize>| {
                let count = 2.0 * degrees.len() as f64;
                let square = |degree: usize, axis: fn(&Sample) -> f64| {
                    let from = axis(&window[0]);
                    let c: f64 = basis[degree].iter().zip(window).map(|(b, s)| b * (axis(s) - from)).sum();
                    c * c
                };
                degrees.map(|d| AXES.map(|axis| square(d, axis)).iter().sum::<f64>()).sum::<f64>() / count
            };
            let (slow, fast) = (mean_square(SLOW), mean_square(FAST));
            if fast > ROUND_OFF * ROUND_OFF {
                all.push(elementary::ln((slow + other * other) / (fast + other * other)));
            }
        }
    }
    all
}

/// Greatest log likelihood of ratios with a common factor (logarithms), over the share of windows that have their own, by the EM algorithm
/// (Dempster, Laird and Rubin, J. Roy. Stat. Soc. B 39 (1977) 1).
fn log_likelihood(ratios: &[f64], factor: f64) -> f64 {
    let parts: Vec<[f64; 2]> = ratios
        .iter()
        .map(|r| {
            [
                density(r - factor),
                (share_below(r - ANY.start) - share_below(r - ANY.end)) / (ANY.end - ANY.start),
            ]
        })
        .collect();
    let mut own = 0.1;
    let mixed = |own: f64, [common, any]: &[f64; 2]| (1.0 - own) * common + own * any + f64::MIN_POSITIVE;
    for _ in 0..EM_STEPS {
        let sum: f64 = parts.iter().map(|p| own * p[1] / mixed(own, p)).sum();
        own = sum / f64::max(parts.len() as f64, 1.0);
    }
    parts.iter().map(|p| elementary::ln(mixed(own, p))).sum()
}

const EM_STEPS: usize = 30;

/// Density of the logarithm of F(6, 24): z^3 / (1 + z)^15 / B(3, 12), with z = r / 4.
fn density(log_ratio: f64) -> f64 {
    let z = 0.25 * elementary::exp(log_ratio.clamp(-60.0, 60.0));
    1092.0 * elementary::exp(3.0 * elementary::ln(z) - 15.0 * elementary::ln(1.0 + z))
}

/// Its distribution function: I_y(3, 12), y = z / (1 + z), a binomial sum.
fn share_below(log_ratio: f64) -> f64 {
    let z = 0.25 * elementary::exp(log_ratio.clamp(-60.0, 60.0));
    let (y, x) = (z / (1.0 + z), 1.0 / (1.0 + z));
    1.0 - elementary::powi(x, 12) * (x * x + 14.0 * x * y + 91.0 * y * y)
}

/// Whether third differences depend on each other at some lag.
fn depends(scene: &Scene) -> bool {
    let series: Vec<Vec<f64>> = scene
        .tracks
        .iter()
        .flat_map(|track| AXES.map(|axis| third_differences(scene, track, axis)))
        .collect();
    let square: f64 = series.iter().flatten().map(|d| d * d).sum();
    let count = series.iter().map(Vec::len).sum::<usize>() as f64;
    let correlation = |lag: usize| {
        let products = series.iter().flat_map(|d| d.iter().zip(d.iter().skip(lag)).map(|(a, b)| a * b));
        products.sum::<f64>() / square.max(f64::MIN_POSITIVE)
    };
    let beyond = f64::max(LEAST, CERTAIN * (BARTLETT / count.max(1.0)).sqrt());
    LAGS.map(correlation).any(|r| r.abs() > beyond)
}

/// Third differences of one coordinate in their deviations, cut off; 0 where samples are not at even times.
fn third_differences(scene: &Scene, track: &Track, axis: fn(&Sample) -> f64) -> Vec<f64> {
    let one = |w: &[Sample]| {
        let difference = axis(&w[3]) - 3.0 * axis(&w[2]) + 3.0 * axis(&w[1]) - axis(&w[0]);
        if is_even(scene, w) { difference } else { 0.0 }
    };
    let mut all: Vec<f64> = track.samples.windows(4).map(one).collect();
    let mut sizes: Vec<f64> = all.iter().filter(|d| **d != 0.0).map(|d| d.abs()).collect();
    let deviation = quantile(&mut sizes, 0.5).unwrap_or(0.0) / NORMAL_MEDIAN_ABSOLUTE;
    if deviation <= 0.0 {
        return vec![];
    }
    all.iter_mut().for_each(|d| *d = (*d / deviation).clamp(-CUT, CUT));
    all
}

fn is_even(scene: &Scene, window: &[Sample]) -> bool {
    let time = |k: usize| scene.time_of(window[k].frame);
    let steps = window.len() - 1;
    let frame = (time(steps) - time(0)) / steps as f64;
    (1..=steps).all(|k| (time(k) - time(k - 1) - frame).abs() < EVEN * frame)
}

/// Orthonormal polynomials of all degrees below `n` over n even points, by Gram and Schmidt, twice for round-off.
fn gram(n: usize) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = vec![];
    for degree in 0..n {
        // The one before times the place is of this degree, and no power grows.
        let mut next: Vec<f64> = match basis.last() {
            None => vec![1.0; n],
            Some(last) => {
                last.iter().enumerate().map(|(k, b)| b * (2.0 * k as f64 / (n - 1) as f64 - 1.0)).collect()
            }
        };
        for _ in 0..2 {
            for known in &basis {
                let share: f64 = known.iter().zip(&next).map(|(a, b)| a * b).sum();
                next.iter_mut().zip(known).for_each(|(v, a)| *v -= share * a);
            }
        }
        let norm = next.iter().map(|v| v * v).sum::<f64>().sqrt();
        debug_assert!(norm > 0.0, "degree {degree}");
        next.iter_mut().for_each(|v| *v /= norm);
        basis.push(next);
    }
    basis
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_density_is_the_slope_of_the_distribution() {
        for k in -30..30 {
            let x = 0.1 * f64::from(k);
            let slope = (share_below(x + 1e-4) - share_below(x - 1e-4)) / 2e-4;
            assert!((slope - density(x)).abs() < 1e-6, "{x} {slope} {}", density(x));
        }
        assert!(share_below(-9.0) < 1e-6 && share_below(9.0) > 1.0 - 1e-6);
    }

    #[test]
    fn polynomials_are_orthonormal() {
        let basis = gram(WINDOW);
        for (i, a) in basis.iter().enumerate() {
            for (j, b) in basis.iter().enumerate() {
                let product: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                assert!((product - f64::from(u8::from(i == j))).abs() < 1e-9, "{i} {j} {product}");
            }
        }
    }
}
