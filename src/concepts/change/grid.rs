//! The posterior of the logarithm of a factor, on a grid.
//!
//! The prior of ln f is normal around 0 with deviation ln 5, the factor of Generalized CLEVRER. An even grid is laid over all
//! factors, and then over what the grid before leaves, until its step is below the posterior's deviation.

use crate::num::elementary::exp;

/// Points of a grid, over ln f from -GRID_END to GRID_END: 1/20 to 20.
const GRID: usize = 41;
const GRID_END: f64 = 3.0;
/// All of ln f.
pub const ALL_FACTORS: [f64; 2] = [-GRID_END, GRID_END];
/// Deviation of ln f before anything is known: ln 5.
const PRIOR_SIGMA: f64 = 1.609;
/// Least difference of the log likelihood over all factors (nat) that says something of the factor.
const LEAST_DIFFERENCE: f64 = 1.0;
/// (end - mean)/sd of a normal distribution that is cut off at its maximum, sqrt(2/pi)/sqrt(1 - 2/pi): where it is less, the maximum
/// lies beyond the end.
const AT_THE_END: f64 = 1.3236;
/// Most grids: each is at least ten times as fine as the one before, unless it is as wide.
const MOST_GRIDS: usize = 4;

/// What is known of ln f.
#[derive(Debug, Clone)]
pub struct FactorPosterior {
    /// On the last grid.
    points: Vec<f64>,
    weights: Vec<f64>,
    /// Difference of the log likelihood over all factors (nat).
    pub spread: f64,
}

impl FactorPosterior {
    /// From a log likelihood at many points of ln f between two ends; its second operand is the part of the work that it is. `has_prior`: else
    /// all factors are alike. `None` where all of them explain what is seen.
    pub fn on_grids<E>(
        has_prior: bool,
        [least, most]: [f64; 2],
        mut log_likelihood: impl FnMut(&[f64], [f64; 2]) -> Result<Vec<f64>, E>,
    ) -> Result<Option<FactorPosterior>, E> {
        let mut points = even(least, most);
        let mut log = log_likelihood(&points, [0.0, 0.5])?;
        let spread = largest(&log) - log.iter().copied().fold(f64::INFINITY, f64::min);
        if spread.is_nan() || spread < LEAST_DIFFERENCE {
            return Ok(None);
        }
        let mut found = FactorPosterior::at(points, &log, has_prior, spread);
        let mut left = 0.5;
        for _ in 1..MOST_GRIDS {
            let step = found.step();
            points = even((found.below(0.01) - step).max(least), (found.below(0.99) + step).min(most));
            log = log_likelihood(&points, [1.0 - left, 1.0 - 0.5 * left])?;
            left *= 0.5;
            found = FactorPosterior::at(points, &log, has_prior, spread);
            if found.sigma() > found.step() {
                break;
            }
        }
        Ok(Some(found))
    }

    fn at(points: Vec<f64>, log: &[f64], has_prior: bool, spread: f64) -> FactorPosterior {
        let precision = if has_prior { 1.0 / (PRIOR_SIGMA * PRIOR_SIGMA) } else { 0.0 };
        let log: Vec<f64> = points.iter().zip(log).map(|(x, l)| l - 0.5 * precision * x * x).collect();
        let weights = crate::concepts::lexicon::softmax(&log);
        FactorPosterior { points, weights, spread }
    }

    /// The ends of the last grid.
    pub fn range(&self) -> [f64; 2] {
        [self.points.first(), self.points.last()].map(|end| end.copied().unwrap_or(0.0))
    }

    /// Whether the likeliest factor may be smaller or larger than all that were tried.
    pub fn is_beyond_all(&self) -> bool {
        let is_near = |end: f64| (end - self.mean()).abs() < AT_THE_END * self.sigma();
        let ([first, last], [least, most]) = (self.range(), ALL_FACTORS);
        (first <= least && is_near(least)) || (last >= most && is_near(most))
    }

    fn step(&self) -> f64 {
        self.points.get(1).zip(self.points.first()).map_or(0.0, |(b, a)| b - a)
    }

    /// Mean of ln f.
    pub fn mean(&self) -> f64 {
        self.points.iter().zip(&self.weights).map(|(x, w)| x * w).sum()
    }

    /// Standard deviation of ln f; not less than that within a step of the grid.
    pub fn sigma(&self) -> f64 {
        let mean = self.mean();
        let variance: f64 =
            self.points.iter().zip(&self.weights).map(|(x, w)| (x - mean) * (x - mean) * w).sum();
        (variance + self.step() * self.step() / 12.0).sqrt()
    }

    /// The least point up to which this share of the weight lies.
    fn below(&self, share: f64) -> f64 {
        let mut sum = 0.0;
        for (x, w) in self.points.iter().zip(&self.weights) {
            sum += w;
            if sum >= share {
                return *x;
            }
        }
        self.points.last().copied().unwrap_or(0.0)
    }

    pub fn factor(&self) -> f64 {
        exp(self.mean())
    }

    /// The 95 % interval of the factor; a point of the grid stands for half a step on each side.
    pub fn interval(&self) -> [f64; 2] {
        let half = 0.5 * self.step();
        [exp(self.below(0.025) - half), exp(self.below(0.975) + half)]
    }
}

fn even(from: f64, to: f64) -> Vec<f64> {
    (0..GRID).map(|k| from + (to - from) * k as f64 / (GRID - 1) as f64).collect()
}

pub fn largest(log: &[f64]) -> f64 {
    log.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(log: impl Fn(f64) -> f64) -> FactorPosterior {
        let at = |points: &[f64], _: [f64; 2]| Ok::<_, ()>(points.iter().map(|x| log(*x)).collect());
        FactorPosterior::on_grids(false, ALL_FACTORS, at).expect("it is computed").expect("it says something")
    }

    #[test]
    fn a_factor_beyond_all_that_are_tried_is_not_taken_for_the_last_one() {
        let normal = |mean: f64, sd: f64| move |x: f64| -0.5 * ((x - mean) / sd) * ((x - mean) / sd);
        for sd in [0.5, 0.05, 0.002] {
            for (mean, is_beyond) in [(3.2 + sd, true), (-4.0, true), (2.95 - sd, false), (0.0, false)] {
                let found = found(normal(mean, sd));
                assert_eq!(found.is_beyond_all(), is_beyond, "{mean} +- {sd}: {}", found.mean());
            }
        }
        // That it is at least three says nothing of a factor beyond 20.
        let plateau = found(|x| if x < 1.1 { -10.0 } else { 0.0 });
        assert!(!plateau.is_beyond_all());
    }
}
