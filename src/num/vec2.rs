//! Vectors in the bird's-eye plane.

use super::real::Real;
use serde::{Deserialize, Serialize};
use std::ops::{Add, AddAssign, Mul, Neg, Sub, SubAssign};

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

#[cfg(test)]
mod tests {
    use super::super::Jet;
    use super::*;

    #[test]
    fn the_zero_vector_has_no_direction_and_no_nan() {
        let zero = vec2(Jet::variable(0.0, 0), Jet::variable(0.0, 1));
        assert_eq!(zero.norm(), Jet::constant(0.0));
        assert_eq!(zero.unit(), Vec2::zero());
    }
}
