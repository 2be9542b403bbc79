//! Draws from the standard normal distribution, with the same bits on every processor.
//!
//! The ziggurat of Marsaglia and Tsang (2000) as Doornik (2005, "ZIGNOR") gives it: the density f(x) = exp(-x^2/2) is
//! covered by 256 layers of equal area V, the lowest holding the tail beyond R. A uniform point in a random layer is
//! accepted if it lies below f. `rand_distr` draws the same numbers but takes `exp` and `ln` from the C library.

use super::elementary::{exp, ln};
use rand_chacha::rand_core::Rng;
use std::sync::LazyLock;

const LAYERS: usize = 256;
/// Where the tail begins: the root of Doornik's equation for 256 layers.
const R: f64 = 3.654_152_885_361_009;
/// Area of each layer for that root.
const V: f64 = 0.004_928_673_233_989_998;

/// Right edges of the layers, from the widest (V / f(R)) to 0.
static EDGES: LazyLock<[f64; LAYERS + 1]> = LazyLock::new(|| {
    let mut x = [0.0; LAYERS + 1];
    (x[0], x[1]) = (V / density(R), R);
    for i in 2..LAYERS {
        x[i] = (-2.0 * ln(V / x[i - 1] + density(x[i - 1]))).sqrt();
    }
    x
});

/// Not normalised.
fn density(x: f64) -> f64 {
    exp(-x * x / 2.0)
}

/// Uniform in [0, 1).
fn uniform(random: &mut impl Rng) -> f64 {
    (random.next_u64() >> 11) as f64 * (f64::EPSILON / 2.0)
}

/// Uniform in (0, 1).
fn open_uniform(random: &mut impl Rng) -> f64 {
    ((random.next_u64() >> 12) as f64 + 0.5) * f64::EPSILON
}

/// One draw of mean 0 and variance 1.
pub fn standard_normal(random: &mut impl Rng) -> f64 {
    let x = &*EDGES;
    loop {
        let bits = random.next_u64();
        let layer = bits as usize & (LAYERS - 1);
        let u = (bits >> 12) as f64 * (2.0 * f64::EPSILON) - 1.0;
        let draw = u * x[layer];
        if draw.abs() < x[layer + 1] {
            return draw;
        }
        if layer == 0 {
            return tail(random).copysign(u);
        }
        let (low, high) = (density(x[layer]), density(x[layer + 1]));
        if high + (low - high) * uniform(random) < density(draw) {
            return draw;
        }
    }
}

/// A draw beyond R, by Marsaglia's rejection of an exponential.
fn tail(random: &mut impl Rng) -> f64 {
    loop {
        let x = ln(open_uniform(random)) / R;
        let y = ln(open_uniform(random));
        if -2.0 * y >= x * x {
            return R - x;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn draws_are_those_of_rand_distr() {
        let (mut ours, mut theirs) = (ChaCha8Rng::seed_from_u64(3), ChaCha8Rng::seed_from_u64(3));
        for _ in 0..200_000 {
            let (a, b): (f64, f64) = (standard_normal(&mut ours), StandardNormal.sample(&mut theirs));
            assert!((a - b).abs() < 1e-12 * (1.0 + b.abs()), "{a} {b}");
        }
    }
}
