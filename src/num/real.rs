//! [`Real`]: a scalar in which the physics can be computed, with or without derivatives.

use super::elementary;
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A scalar the physics can be computed in: exactly `f64`, [`Jet`](super::Jet) and [`JetF32`](super::JetF32).
pub trait Real:
    Copy
    + Debug
    + Default
    + Send
    + Sync
    + 'static
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
    + MulAssign<f64>
{
    /// Whether values carry derivatives.
    const DIFFERENTIATES: bool;

    /// A constant: its derivatives are zero.
    fn constant(value: f64) -> Self;
    /// The real part; decisions about events look at nothing else.
    fn value(self) -> f64;
    /// The derivatives alone: value zero.
    fn infinitesimal(self) -> Self;
    /// Whether value and derivatives are finite.
    fn is_finite(self) -> bool;
    /// Whether all derivatives are zero.
    fn is_constant(self) -> bool;
    /// `f(self)` for a function whose value and slope at the real part are known.
    fn chain(self, value: f64, slope: f64) -> Self;

    fn zero() -> Self {
        Self::constant(0.0)
    }
    fn sqrt(self) -> Self {
        let root = self.value().sqrt();
        self.chain(root, 0.5 / root)
    }
    /// Square root that is exactly zero, without a derivative, at zero.
    fn sqrt_or_zero(self) -> Self {
        if self.value() > 0.0 { self.sqrt() } else { Self::zero() }
    }
    fn exp(self) -> Self {
        let e = elementary::exp(self.value());
        self.chain(e, e)
    }
    fn ln(self) -> Self {
        self.chain(elementary::ln(self.value()), 1.0 / self.value())
    }
    fn sin(self) -> Self {
        if Self::DIFFERENTIATES { self.sin_cos().0 } else { Self::constant(elementary::sin(self.value())) }
    }
    fn cos(self) -> Self {
        if Self::DIFFERENTIATES { self.sin_cos().1 } else { Self::constant(elementary::cos(self.value())) }
    }
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = elementary::sin_cos(self.value());
        (self.chain(sin, cos), self.chain(cos, -sin))
    }
    fn tanh(self) -> Self {
        let t = elementary::tanh(self.value());
        self.chain(t, 1.0 - t * t)
    }
    fn abs(self) -> Self {
        if self.value() < 0.0 { -self } else { self }
    }
    fn max(self, other: Self) -> Self {
        if other.value() > self.value() { other } else { self }
    }
    fn min(self, other: Self) -> Self {
        if other.value() < self.value() { other } else { self }
    }
}

impl Real for f64 {
    const DIFFERENTIATES: bool = false;
    fn infinitesimal(self) -> Self {
        0.0
    }
    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }
    fn is_constant(self) -> bool {
        true
    }
    fn constant(value: f64) -> Self {
        value
    }
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn value(self) -> f64 {
        self
    }
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn chain(self, value: f64, _slope: f64) -> Self {
        value
    }
}

/// A scalar with derivatives.
pub trait Differential: Real {
    /// How many it carries.
    const LANES: usize;

    /// The same value with another derivative in lane `lane`.
    fn with_derivative(self, lane: usize, derivative: f64) -> Self;
    fn derivative(&self, lane: usize) -> f64;
}
