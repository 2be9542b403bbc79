//! Elementary functions whose bits are the same on every processor.
//!
//! The C library picks its `sin`, `exp`, `pow` ... at run time, with or without fused multiply-add, so the methods of
//! `f64` differ in the last bit from machine to machine. These come from `libm`, which is compiled into the program.
//! `clippy.toml` forbids the methods everywhere else. `sqrt`, `abs`, `floor` and `mul_add` are exact by IEEE 754 and
//! stay methods.

use std::sync::LazyLock;

/// Sine of `x` (rad).
pub fn sin(x: f64) -> f64 {
    libm::sin(x)
}
/// Cosine of `x` (rad).
pub fn cos(x: f64) -> f64 {
    libm::cos(x)
}
/// Sine and cosine of `x` (rad).
pub fn sin_cos(x: f64) -> (f64, f64) {
    libm::sincos(x)
}
/// Tangent of `x` (rad).
pub fn tan(x: f64) -> f64 {
    libm::tan(x)
}
/// The angle in 0..=pi whose cosine is `x`.
pub fn acos(x: f64) -> f64 {
    libm::acos(x)
}
/// Inverse hyperbolic cosine of `x` >= 1.
pub fn acosh(x: f64) -> f64 {
    libm::acosh(x)
}
/// The angle in -pi..=pi of the point (`x`, `y`).
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}
/// e^x.
pub fn exp(x: f64) -> f64 {
    libm::exp(x)
}
/// Natural logarithm.
pub fn ln(x: f64) -> f64 {
    libm::log(x)
}
/// ln(1 + x), exact also for small `x`.
pub fn ln_1p(x: f64) -> f64 {
    libm::log1p(x)
}
/// Logarithm to base 10.
pub fn log10(x: f64) -> f64 {
    libm::log10(x)
}
/// x^y.
pub fn powf(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}
/// Hyperbolic tangent.
pub fn tanh(x: f64) -> f64 {
    libm::tanh(x)
}
/// sqrt(x^2 + y^2) without overflow.
pub fn hypot(x: f64, y: f64) -> f64 {
    libm::hypot(x, y)
}
/// x^n by repeated squaring: a fixed order of products, where `f64::powi` leaves it to the compiler.
#[inline]
pub fn powi(x: f64, n: i32) -> f64 {
    let (mut base, mut left, mut power) = (x, n.unsigned_abs(), 1.0);
    while left > 0 {
        if left & 1 == 1 {
            power *= base;
        }
        base *= base;
        left >>= 1;
    }
    if n < 0 { 1.0 / power } else { power }
}

/// Names the arithmetic of this build: 16 hexadecimal digits over what the functions return on a fixed grid.
/// Results with equal requests and equal fingerprints have equal bits.
pub static NUMERIC_FINGERPRINT: LazyLock<String> = LazyLock::new(|| {
    let mut hasher = blake3::Hasher::new();
    for step in -400..=400 {
        let x = f64::from(step) * 0.037 + 0.001;
        let positive = x.abs();
        let values =
            [sin(x), cos(x), tan(x), acos(x / 16.0), atan2(x, 0.7), exp(x), ln(positive), ln_1p(positive)]
                .into_iter()
                .chain([
                    log10(positive),
                    powf(positive, 1.3),
                    tanh(x),
                    hypot(x, 1.1),
                    powi(x, 5),
                    positive.sqrt(),
                ]);
        values.for_each(|value| {
            hasher.update(&value.to_le_bytes());
        });
    }
    hasher.finalize().to_hex()[..16].to_string()
});

#[cfg(test)]
mod tests {
    use super::*;

    /// The figure that every processor and every build must give; it changes only with the functions themselves.
    #[test]
    fn the_fingerprint_is_the_one_of_every_machine() {
        assert_eq!(*NUMERIC_FINGERPRINT, "34281124e6a314bc");
    }

    #[test]
    #[allow(clippy::disallowed_methods)] // The C library's functions are what these are compared with.
    fn they_agree_with_the_c_library_to_the_last_digits() {
        for step in -300..=300 {
            let x = f64::from(step) * 0.1 + 0.003;
            let a = x.abs();
            let pairs = [
                (sin(x), x.sin()),
                (cos(x), x.cos()),
                (sin_cos(x).0, x.sin_cos().0),
                (sin_cos(x).1, x.sin_cos().1),
                (tan(x), x.tan()),
                (acos(x / 31.0), (x / 31.0).acos()),
                (acosh(1.0 + a), (1.0 + a).acosh()),
                (atan2(x, 0.3), x.atan2(0.3)),
                (exp(x), x.exp()),
                (ln(a), a.ln()),
                (ln_1p(a), a.ln_1p()),
                (log10(a), a.log10()),
                (powf(a, -1.7), a.powf(-1.7)),
                (tanh(x), x.tanh()),
                (hypot(x, 2.0), x.hypot(2.0)),
                (powi(x, -3), x.powi(-3)),
            ];
            for (k, (ours, theirs)) in pairs.into_iter().enumerate() {
                assert!(
                    (ours - theirs).abs() <= 4.0 * f64::EPSILON * theirs.abs(),
                    "{k}: {ours} {theirs} at {x}"
                );
            }
        }
    }
}
