//! [`Jet`] and [`JetF32`]: a value v with its derivatives d in N directions, by forward-mode automatic differentiation.
//!
//! Each operation carries both: f(v) and f'(v) d; for a product (v w, v d_w + w d_v). N parameters take ceil(N / LANES) passes.
//! Decisions (which event is next) look at v only, so that a run with derivatives has the events of the run without.
//!
//! Source: Griewank and Walther, Evaluating Derivatives, 2nd ed. (2008), chapter 3.

use super::real::{Differential, Real};
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// Derivatives that one [`Jet`] carries; N parameters take `ceil(N / LANES)` passes.
pub const LANES: usize = 8;

/// The number that holds a derivative: `f64` or `f32`.
pub trait DerivativeScalar:
    Copy
    + Debug
    + Default
    + PartialEq
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + MulAssign
{
    fn from_f64(value: f64) -> Self;
    fn to_f64(self) -> f64;
}

impl DerivativeScalar for f64 {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn from_f64(value: f64) -> f64 {
        value
    }
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn to_f64(self) -> f64 {
        self
    }
}

impl DerivativeScalar for f32 {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn from_f64(value: f64) -> f32 {
        value as f32
    }
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn to_f64(self) -> f64 {
        self.into()
    }
}

/// A value with its derivatives in N directions (forward-mode automatic differentiation).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<D, const N: usize> {
    pub v: f64,
    d: [D; N],
}

/// Derivatives as exact as the value.
pub type Jet = Dual<f64, LANES>;

/// Derivatives of single precision, twice as many in the same time: for searches, not for results.
pub type JetF32 = Dual<f32, { 2 * LANES }>;

impl<D: DerivativeScalar, const N: usize> Default for Dual<D, N> {
    fn default() -> Self {
        Dual::constant(0.0)
    }
}

impl<D: DerivativeScalar, const N: usize> Dual<D, N> {
    /// The variable of lane `lane`: derivative one in that lane.
    pub fn variable(value: f64, lane: usize) -> Self {
        Dual::constant(value).with_derivative(lane, 1.0)
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn zip(self, o: Self, v: f64, f: impl Fn(D, D) -> D) -> Self {
        let mut d = [D::default(); N];
        for (i, d) in d.iter_mut().enumerate() {
            *d = f(self.d[i], o.d[i]);
        }
        Dual { v, d }
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    fn scaled(mut self, v: f64, slope: f64) -> Self {
        let slope = D::from_f64(slope);
        for d in &mut self.d {
            *d *= slope;
        }
        Dual { v, d: self.d }
    }
}

impl<D: DerivativeScalar, const N: usize> Differential for Dual<D, N> {
    const LANES: usize = N;

    fn with_derivative(mut self, lane: usize, derivative: f64) -> Self {
        self.d[lane] = D::from_f64(derivative);
        self
    }
    fn derivative(&self, lane: usize) -> f64 {
        self.d[lane].to_f64()
    }
}

impl<D: DerivativeScalar, const N: usize> Real for Dual<D, N> {
    const DIFFERENTIATES: bool = true;
    fn infinitesimal(self) -> Self {
        Dual { v: 0.0, d: self.d }
    }
    fn is_finite(self) -> bool {
        self.v.is_finite() && self.d.iter().all(|d| d.to_f64().is_finite())
    }
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn is_constant(self) -> bool {
        self.d == [D::default(); N]
    }
    fn constant(value: f64) -> Self {
        Dual { v: value, d: [D::default(); N] }
    }
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn value(self) -> f64 {
        self.v
    }
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn chain(self, value: f64, slope: f64) -> Self {
        self.scaled(value, slope)
    }
}

impl<D: DerivativeScalar, const N: usize> Neg for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn neg(self) -> Self {
        self.scaled(-self.v, -1.0)
    }
}

impl<D: DerivativeScalar, const N: usize> Add for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn add(self, o: Self) -> Self {
        self.zip(o, self.v + o.v, |a, b| a + b)
    }
}

impl<D: DerivativeScalar, const N: usize> Sub for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn sub(self, o: Self) -> Self {
        self.zip(o, self.v - o.v, |a, b| a - b)
    }
}

impl<D: DerivativeScalar, const N: usize> Mul for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    #[allow(clippy::suspicious_arithmetic_impl)] // the product rule
    fn mul(self, o: Self) -> Self {
        let (x, y) = (D::from_f64(self.v), D::from_f64(o.v));
        self.zip(o, self.v * o.v, |a, b| a * y + x * b)
    }
}

impl<D: DerivativeScalar, const N: usize> Div for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn div(self, o: Self) -> Self {
        let v = self.v / o.v;
        let (ratio, inverse) = (D::from_f64(v), D::from_f64(1.0 / o.v));
        self.zip(o, v, |a, b| (a - ratio * b) * inverse)
    }
}

impl<D: DerivativeScalar, const N: usize> Add<f64> for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn add(self, o: f64) -> Self {
        Dual { v: self.v + o, d: self.d }
    }
}

impl<D: DerivativeScalar, const N: usize> Sub<f64> for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn sub(self, o: f64) -> Self {
        Dual { v: self.v - o, d: self.d }
    }
}

impl<D: DerivativeScalar, const N: usize> Mul<f64> for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn mul(self, o: f64) -> Self {
        self.scaled(self.v * o, o)
    }
}

impl<D: DerivativeScalar, const N: usize> Div<f64> for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn div(self, o: f64) -> Self {
        self.scaled(self.v / o, 1.0 / o)
    }
}

impl<D: DerivativeScalar, const N: usize> AddAssign for Dual<D, N> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}

impl<D: DerivativeScalar, const N: usize> SubAssign for Dual<D, N> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn sub_assign(&mut self, o: Self) {
        *self = *self - o;
    }
}

impl<D: DerivativeScalar, const N: usize> MulAssign for Dual<D, N> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn mul_assign(&mut self, o: Self) {
        *self = *self * o;
    }
}

impl<D: DerivativeScalar, const N: usize> DivAssign for Dual<D, N> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn div_assign(&mut self, o: Self) {
        *self = *self / o;
    }
}

impl<D: DerivativeScalar, const N: usize> MulAssign<f64> for Dual<D, N> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn mul_assign(&mut self, o: f64) {
        *self = *self * o;
    }
}

#[cfg(test)]
mod tests {
    use super::super::vec2;
    use super::*;
    use num_dual::{Dual64, DualNum};
    use proptest::prelude::*;

    fn ours<T: Real>(x: T, y: T) -> T {
        let v = vec2(x * y + 0.5, (x / y).sin());
        (v.norm() + 1.0).ln() * (x * 0.3).exp() - (y - x).tanh() / v.unit().x + (y * y + x.cos()).sqrt()
    }
    fn theirs<D: DualNum<f64> + Copy>(x: D, y: D) -> D {
        let (a, b) = (x * y + 0.5, (x / y).sin());
        let n = (a * a + b * b).sqrt();
        (n + 1.0).ln() * (x * 0.3).exp() - (y - x).tanh() / (a / n) + (y * y + x.cos()).sqrt()
    }

    proptest! {
        #[test]
        fn jet_agrees_with_num_dual(x in 0.1..3.0f64, y in 1.1..3.0f64) {
            let j = ours(Jet::variable(x, 0), Jet::variable(y, 5));
            let (a, b) = (Dual64::from(x), Dual64::from(y));
            let (v, g) = (theirs(x, y), [theirs(a.derivative(), b).eps, theirs(a, b.derivative()).eps]);
            prop_assert!((j.v - v).abs() < 1e-12 && (ours(x, y) - v).abs() < 1e-12);
            prop_assert!((j.d[0] - g[0]).abs() < 1e-10 * (1.0 + g[0].abs()));
            prop_assert!((j.d[5] - g[1]).abs() < 1e-10 * (1.0 + g[1].abs()));
            prop_assert_eq!(j.d[1], 0.0);
            let single = ours(JetF32::variable(x, 0), JetF32::variable(y, 5));
            prop_assert_eq!(single.v, j.v);
            let size: f64 = 1e-5 * (1.0 + g[0].abs() + g[1].abs());
            prop_assert!((single.derivative(0) - g[0]).abs() < size && (single.derivative(5) - g[1]).abs() < size);
        }
    }
}
