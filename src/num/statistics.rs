//! Order statistics of a sample.

/// The q-quantile of a sample of n numbers without interpolation: the one of rank floor(q n) in ascending order, counted from 0,
/// at most the last; `None` of an empty sample. NaN ranks above infinity. The sample is reordered.
///
/// With q = 0.5 it is the upper median, as robust estimates of scale use it.
pub fn quantile(sample: &mut [f64], q: f64) -> Option<f64> {
    let rank = ((q * sample.len() as f64) as usize).min(sample.len().checked_sub(1)?);
    Some(*sample.select_nth_unstable_by(rank, f64::total_cmp).1)
}

/// The median: the middle number, or the mean of the two in the middle; `None` of an empty sample. The sample is reordered.
pub fn median(sample: &mut [f64]) -> Option<f64> {
    let upper = quantile(sample, 0.5)?;
    if sample.len() % 2 == 1 {
        return Some(upper);
    }
    let lower = sample[..sample.len() / 2].iter().copied().max_by(f64::total_cmp)?;
    Some(0.5 * (lower + upper))
}

/// Standard deviations to either end of the 95 % interval of a normal number.
pub const NINETY_FIVE: f64 = 1.96;
/// Median of the absolute value of a standard normal number.
pub const NORMAL_MEDIAN_ABSOLUTE: f64 = 0.674_489_750_196_081_7;
/// Median of the length of a plane vector of two independent standard normal numbers: sqrt(2 ln 2).
pub const NORMAL_MEDIAN_DISTANCE: f64 = 1.177_410_022_515_474_6;

/// The 95 % interval of a share of `count`, of which `right` were seen (Wilson, J. Am. Stat. Assoc. 22 (1927) 209); `count` is at least 1.
pub fn share_interval(right: usize, count: usize) -> [f64; 2] {
    let (n, z) = (count as f64, NINETY_FIVE);
    let p = right as f64 / n;
    let scale = 1.0 + z * z / n;
    let centre = (p + z * z / (2.0 * n)) / scale;
    let half = z / scale * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    [(centre - half).max(0.0), (centre + half).min(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_and_medians_of_small_samples() {
        #[track_caller]
        fn check(sample: &[f64], medians: Option<(f64, f64)>) {
            let (mut a, mut b) = (sample.to_vec(), sample.to_vec());
            assert_eq!(quantile(&mut a, 0.5).zip(median(&mut b)), medians);
        }
        check(&[], None);
        check(&[3.0], Some((3.0, 3.0)));
        check(&[4.0, 1.0], Some((4.0, 2.5)));
        check(&[5.0, 1.0, 2.0], Some((2.0, 2.0)));
        check(&[9.0, 1.0, 2.0, 4.0], Some((4.0, 3.0)));
        assert_eq!(quantile(&mut [3.0, 1.0, 2.0], 1.0), Some(3.0));
        assert_eq!(quantile(&mut [3.0, 1.0, 2.0], 0.0), Some(1.0));
    }
}
