//! Errors of neighbouring frames that depend on each other: positions that were smoothed, filtered or interpolated.
//!
//! The third differences of independent errors are independent beyond three frames: motion leaves little in them, and where it does
//! (a contact) it leaves it in few frames, which are cut off at three deviations. Smoothing over n frames makes differences depend
//! over n frames and more. So errors depend where the correlation r_k of third differences at some lag k of 4 to 16 frames is beyond
//! chance: |r_k| > z sqrt((1 + 2 sum_j rho_j^2) / N) (Bartlett, J. Roy. Stat. Soc. Suppl. 8 (1946) 27; rho_j of the third differences of
//! independent numbers) and as large as smoothing makes it.
//!
//! By how much slow errors are larger than fast ones: each window of N samples, taken at even times, is written in N orthonormal
//! polynomials (Gram). Motion is in those of the lowest degrees, slow errors in the next ones, fast ones in the rest. The slow variance
//! follows from the lower quartile of the windows' sums of squares (of six numbers: that of chi-square with six degrees of
//! freedom), as contacts add to some; the fast deviation from a median. Motion between contacts lives where errors are slow, so
//! that the slow deviation is the noise of a fit (Whittle's likelihood: Hannan, J. Appl. Prob. 10 (1973) 130).

use crate::num::{NORMAL_MEDIAN_ABSOLUTE, quantile};
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
/// Slow errors that are larger by less than this change no result.
const SLIGHT: f64 = 1.25;
/// Lower quartile of chi-square with six degrees of freedom: three slow degrees in two coordinates.
const QUARTILE: f64 = 3.454_6;
/// A gap or a time that differs by more than this share of a frame makes a window uneven.
const EVEN: f64 = 0.05;

/// Deviation of slow errors over that of fast ones where neighbouring errors depend on each other; else 1.
pub fn dependence(scene: &Scene) -> f64 {
    if !depends(scene) {
        return 1.0;
    }
    let basis = gram(WINDOW);
    let (mut slow, mut fast) = (vec![], vec![]);
    for track in &scene.tracks {
        for window in track.samples.windows(WINDOW).step_by(WINDOW / 2).filter(|w| is_even(scene, w)) {
            let mut squares = 0.0;
            for axis in AXES {
                let coefficient = |degree: usize| -> f64 {
                    basis[degree].iter().zip(window).map(|(b, s)| b * axis(s)).sum()
                };
                squares += SLOW.map(coefficient).map(|c| c * c).sum::<f64>();
                fast.extend(FAST.map(coefficient).map(f64::abs));
            }
            slow.push(squares);
        }
    }
    match (quantile(&mut slow, 0.25), quantile(&mut fast, 0.5)) {
        (Some(quartile), Some(median)) if median > 0.0 => {
            let ratio = (quartile / QUARTILE).sqrt() * NORMAL_MEDIAN_ABSOLUTE / median;
            if ratio > SLIGHT { ratio } else { 1.0 }
        }
        _ => 1.0,
    }
}

const AXES: [fn(&Sample) -> f64; 2] = [|s| s.position.x, |s| s.position.y];

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
