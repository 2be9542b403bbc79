//! Scalars and plane vectors: the model is written once over [`Real`] and compiled for `f64`, [`Jet`] and [`JetF32`]; numerics.

mod hermite;
mod lbfgs;
mod least_squares;
mod statistics;

pub use hermite::{HermiteWeights, hermite};
pub use lbfgs::{Descent, Objective};
pub use least_squares::{
    AtBounds, Bounds, Ended, LeastSquares, Minimum, NormalEquations, Schedule, levenberg_marquardt,
};
pub use statistics::{NORMAL_MEDIAN_ABSOLUTE, NORMAL_MEDIAN_DISTANCE, median, quantile};

pub mod elementary;
mod normal;

pub use elementary::NUMERIC_FINGERPRINT;
pub use normal::standard_normal;

use serde::{Deserialize, Serialize};
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Derivatives that one [`Jet`] carries; N parameters take `ceil(N / LANES)` passes.
pub const LANES: usize = 8;

/// A scalar the physics can be computed in: exactly `f64`, [`Jet`] and [`JetF32`].
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
        self.sin_cos().0
    }
    fn cos(self) -> Self {
        self.sin_cos().1
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

/// The precision of a derivative.
pub trait Lane:
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
    fn of(value: f64) -> Self;
    fn wide(self) -> f64;
}
impl Lane for f64 {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn of(value: f64) -> f64 {
        value
    }
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn wide(self) -> f64 {
        self
    }
}
impl Lane for f32 {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn of(value: f64) -> f32 {
        value as f32
    }
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn wide(self) -> f64 {
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

/// A scalar with derivatives.
pub trait Differential: Real {
    /// How many it carries.
    const LANES: usize;

    /// The same value with another derivative in lane `lane`.
    fn with_derivative(self, lane: usize, derivative: f64) -> Self;
    fn derivative(&self, lane: usize) -> f64;
}

impl<D: Lane, const N: usize> Default for Dual<D, N> {
    fn default() -> Self {
        Dual::constant(0.0)
    }
}

impl<D: Lane, const N: usize> Dual<D, N> {
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
        let slope = D::of(slope);
        for d in &mut self.d {
            *d *= slope;
        }
        Dual { v, d: self.d }
    }
}

impl<D: Lane, const N: usize> Differential for Dual<D, N> {
    const LANES: usize = N;

    fn with_derivative(mut self, lane: usize, derivative: f64) -> Self {
        self.d[lane] = D::of(derivative);
        self
    }
    fn derivative(&self, lane: usize) -> f64 {
        self.d[lane].wide()
    }
}

impl<D: Lane, const N: usize> Real for Dual<D, N> {
    const DIFFERENTIATES: bool = true;
    fn infinitesimal(self) -> Self {
        Dual { v: 0.0, d: self.d }
    }
    fn is_finite(self) -> bool {
        self.v.is_finite() && self.d.iter().all(|d| d.wide().is_finite())
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

impl<D: Lane, const N: usize> Neg for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn neg(self) -> Self {
        self.scaled(-self.v, -1.0)
    }
}
impl<D: Lane, const N: usize> Add for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn add(self, o: Self) -> Self {
        self.zip(o, self.v + o.v, |a, b| a + b)
    }
}
impl<D: Lane, const N: usize> Sub for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn sub(self, o: Self) -> Self {
        self.zip(o, self.v - o.v, |a, b| a - b)
    }
}
impl<D: Lane, const N: usize> Mul for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    #[allow(clippy::suspicious_arithmetic_impl)] // the product rule
    fn mul(self, o: Self) -> Self {
        let (x, y) = (D::of(self.v), D::of(o.v));
        self.zip(o, self.v * o.v, |a, b| a * y + x * b)
    }
}
impl<D: Lane, const N: usize> Div for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn div(self, o: Self) -> Self {
        let v = self.v / o.v;
        let (ratio, inverse) = (D::of(v), D::of(1.0 / o.v));
        self.zip(o, v, |a, b| (a - ratio * b) * inverse)
    }
}
impl<D: Lane, const N: usize> Add<f64> for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn add(self, o: f64) -> Self {
        Dual { v: self.v + o, d: self.d }
    }
}
impl<D: Lane, const N: usize> Sub<f64> for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn sub(self, o: f64) -> Self {
        Dual { v: self.v - o, d: self.d }
    }
}
impl<D: Lane, const N: usize> Mul<f64> for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn mul(self, o: f64) -> Self {
        self.scaled(self.v * o, o)
    }
}
impl<D: Lane, const N: usize> Div<f64> for Dual<D, N> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn div(self, o: f64) -> Self {
        self.scaled(self.v / o, 1.0 / o)
    }
}
impl<D: Lane, const N: usize> AddAssign for Dual<D, N> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
impl<D: Lane, const N: usize> SubAssign for Dual<D, N> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn sub_assign(&mut self, o: Self) {
        *self = *self - o;
    }
}
impl<D: Lane, const N: usize> MulAssign for Dual<D, N> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn mul_assign(&mut self, o: Self) {
        *self = *self * o;
    }
}
impl<D: Lane, const N: usize> DivAssign for Dual<D, N> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn div_assign(&mut self, o: Self) {
        *self = *self / o;
    }
}
impl<D: Lane, const N: usize> MulAssign<f64> for Dual<D, N> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn mul_assign(&mut self, o: f64) {
        *self = *self * o;
    }
}

/// A vector in the bird's-eye plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Vec2<T = f64> {
    pub x: T,
    pub y: T,
}

/// Shorthand for [`Vec2`].
pub fn vec2<T>(x: T, y: T) -> Vec2<T> {
    Vec2 { x, y }
}

impl<T: Real> Vec2<T> {
    pub fn zero() -> Self {
        vec2(T::zero(), T::zero())
    }
    /// A constant vector: its derivatives are zero.
    pub fn constant(v: Vec2<f64>) -> Self {
        vec2(T::constant(v.x), T::constant(v.y))
    }
    /// The unit vector at `angle` (rad) from the x axis.
    pub fn from_angle(angle: T) -> Self {
        let (sin, cos) = angle.sin_cos();
        vec2(cos, sin)
    }
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn dot(self, o: Self) -> T {
        self.x * o.x + self.y * o.y
    }
    /// z component of the cross product.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn cross(self, o: Self) -> T {
        self.x * o.y - self.y * o.x
    }
    /// z^ x self: a quarter turn to the left.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn perp(self) -> Self {
        vec2(-self.y, self.x)
    }
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn norm_squared(self) -> T {
        self.dot(self)
    }
    /// Length; exactly zero (with zero derivatives) at the origin.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn norm(self) -> T {
        self.norm_squared().sqrt_or_zero()
    }
    /// Unit vector, or zero at the origin.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn unit(self) -> Self {
        let n = self.norm();
        if n.value() > 0.0 { self * (T::constant(1.0) / n) } else { Self::zero() }
    }
    /// Rotated by the angle whose cosine and sine are the components of `turn`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn rotated(self, turn: Self) -> Self {
        vec2(self.x * turn.x - self.y * turn.y, self.x * turn.y + self.y * turn.x)
    }
    /// Rotated back by the angle of `turn`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn unrotated(self, turn: Self) -> Self {
        vec2(self.x * turn.x + self.y * turn.y, self.y * turn.x - self.x * turn.y)
    }
    /// Scaled by a plain number.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn scaled(self, s: f64) -> Self {
        vec2(self.x * s, self.y * s)
    }
    /// The real parts.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn value(self) -> Vec2<f64> {
        vec2(self.x.value(), self.y.value())
    }
}

impl<T: Real> Add for Vec2<T> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn add(self, o: Self) -> Self {
        vec2(self.x + o.x, self.y + o.y)
    }
}
impl<T: Real> Sub for Vec2<T> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn sub(self, o: Self) -> Self {
        vec2(self.x - o.x, self.y - o.y)
    }
}
impl<T: Real> Neg for Vec2<T> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn neg(self) -> Self {
        vec2(-self.x, -self.y)
    }
}
impl<T: Real> Mul<T> for Vec2<T> {
    type Output = Self;
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn mul(self, s: T) -> Self {
        vec2(self.x * s, self.y * s)
    }
}
impl<T: Real> AddAssign for Vec2<T> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
impl<T: Real> SubAssign for Vec2<T> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn sub_assign(&mut self, o: Self) {
        *self = *self - o;
    }
}

/// Asks whether to go on: long work calls it once an iteration with its progress in 0..=1.
pub type Stop<'a> = &'a (dyn Fn(f64) -> Result<(), Stopped> + Sync);

/// For work that is the part from `from` to `to` of the whole.
pub fn progress_within<'s>(
    stop: Stop<'s>,
    [from, to]: [f64; 2],
) -> impl Fn(f64) -> Result<(), Stopped> + Sync + 's {
    move |progress| stop(from + (to - from) * progress.clamp(0.0, 1.0))
}

/// The same where the part is made of about so many pieces, each of which tells its own progress up to 1.
pub fn progress_of_jobs<'s>(
    stop: Stop<'s>,
    [from, to]: [f64; 2],
    pieces: usize,
) -> impl Fn(f64) -> Result<(), Stopped> + Sync + 's {
    let done = AtomicUsize::new(0);
    move |progress| {
        let ended = usize::from(progress >= 1.0);
        let share = (done.fetch_add(ended, Ordering::Relaxed) + ended) as f64 / pieces.max(1) as f64;
        stop(from + (to - from) * share.min(1.0))
    }
}

/// The caller no longer wants the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped by the caller")]
pub struct Stopped;

/// Never stops.
pub fn never(_progress: f64) -> Result<(), Stopped> {
    Ok(())
}

/// The angle in -pi..=pi that differs by whole turns.
pub fn wrap_angle(angle: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle - turn * (angle / turn).round()
}

#[cfg(test)]
mod tests {
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

    #[test]
    fn progress_of_parts_is_progress_of_the_whole() {
        let reported = std::sync::Mutex::new(vec![]);
        let stop =
            |f: f64| -> Result<(), Stopped> { reported.lock().map(|mut t| t.push(f)).map_err(|_| Stopped) };
        let half = progress_within(&stop, [0.5, 1.0]);
        let pieces = progress_of_jobs(&half, [0.0, 0.5], 2);
        assert_eq!([half(0.5), pieces(0.9), pieces(1.0), pieces(1.0), pieces(1.0)], [Ok(()); 5]);
        assert_eq!(*reported.lock().expect("nobody panicked"), [0.75, 0.5, 0.625, 0.75, 0.75]);
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

    #[test]
    fn the_zero_vector_has_no_direction_and_no_nan() {
        let zero = vec2(Jet::variable(0.0, 0), Jet::variable(0.0, 1));
        assert_eq!(zero.norm(), Jet::constant(0.0));
        assert_eq!(zero.unit(), Vec2::zero());
    }
}
