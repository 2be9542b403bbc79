//! Positions in steps, such as whole pixels or rounded decimals.
//!
//! Coordinates x_i are multiples of a step q, with an offset, where all differences of their sorted values are. The largest such q is
//! the greatest common divisor of the differences, by Euclid's algorithm with a tolerance. A rounded coordinate has the error of a
//! uniform distribution of width q: variance q^2 / 12 (Bennett, Bell System Technical Journal 27 (1948) 446).

use crate::scene::observation::Scene;

/// Remainders up to this share of a step are round-off.
const TOLERANCE: f64 = 1e-2;
/// A step that is this much smaller than the spread of the values cannot be distinguished from round-off.
const FINEST: f64 = 1e-8;
/// Different values that tell a step: of fewer, any has one.
const FEWEST: usize = 8;

/// The step of all coordinates of the scene (m); 0 where they have none.
pub fn step(scene: &Scene) -> f64 {
    let of = |axis: fn(crate::num::Vec2) -> f64| {
        let samples = scene.tracks.iter().flat_map(|t| &t.samples);
        divisor(samples.map(|s| axis(s.position)).filter(|x| x.is_finite()).collect())
    };
    match (of(|p| p.x), of(|p| p.y)) {
        (Some(x), Some(y)) => x.min(y),
        (Some(one), None) | (None, Some(one)) => one,
        (None, None) => 0.0,
    }
}

/// The step of these values: 0 if they have none, `None` if they are too few.
fn divisor(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let spread = values.last()? - values.first()?;
    let least = FINEST * spread;
    values.dedup_by(|b, a| *b - *a <= least);
    if values.len() < FEWEST {
        return None;
    }
    let mut q = 0.0;
    for gap in values.windows(2).map(|pair| pair[1] - pair[0]) {
        q = common(q, gap, 10.0 * least);
        if q <= 0.0 {
            return Some(0.0);
        }
    }
    Some(q)
}

/// The greatest common divisor of two lengths; 0 where it is below `least`.
fn common(a: f64, b: f64, least: f64) -> f64 {
    let (mut large, mut small) = (a.max(b), a.min(b));
    while small > 0.0 {
        if small < least {
            return 0.0;
        }
        let rest = large % small;
        // A remainder just below the divisor is round-off, too.
        let rest = rest.min(small - rest);
        (large, small) = (small, if rest > TOLERANCE * small { rest } else { 0.0 });
    }
    large
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn multiples_have_their_step_and_real_numbers_none(
            q in 1e-5..0.01f64, offset in -1.0..1.0f64, of in proptest::collection::vec(-400..400i32, 30..200)
        ) {
            let found = divisor(of.iter().map(|k| offset + q * f64::from(*k)).collect()).unwrap_or(q);
            // By chance all may be even.
            let times = found / q;
            prop_assert!(times > 0.99 && (times - times.round()).abs() < 0.01, "{q} {found}");
            let rough = of.iter().enumerate().map(|(i, k)| q * f64::from(*k) + 0.4 * q * (12.9 * i as f64).sin());
            prop_assert!(divisor(rough.collect()).is_none_or(|found| found < 0.02 * q));
        }
    }
}
