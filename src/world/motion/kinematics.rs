//! Position, velocity and acceleration of one body, and the formulas that integrate and interpolate them.

use crate::num::{Real, Vec2, hermite};
use smallvec::SmallVec;

/// A list with one entry for each body of an island; most islands are small.
pub(in crate::world) type IslandVec<T> = SmallVec<[T; 4]>;

/// Position and motion of one body.
#[derive(Debug, Clone, Copy)]
pub struct Kinematics<T> {
    /// m.
    pub position: Vec2<T>,
    /// rad.
    pub yaw: T,
    /// m/s.
    pub velocity: Vec2<T>,
    /// rad/s about z.
    pub spin: T,
    /// rad/s about the horizontal axes; balls only.
    pub roll: Vec2<T>,
}

/// Time derivative of the velocities of [`Kinematics`] (m/s^2 and rad/s^2).
#[derive(Debug, Clone, Copy)]
pub(in crate::world) struct Rates<T> {
    pub velocity: Vec2<T>,
    pub spin: T,
    pub roll: Vec2<T>,
}

impl<T: Real> Rates<T> {
    pub fn zero() -> Self {
        Rates { velocity: Vec2::zero(), spin: T::zero(), roll: Vec2::zero() }
    }

    /// The real parts.
    pub fn value(&self) -> Rates<f64> {
        Rates { velocity: self.velocity.value(), spin: self.spin.value(), roll: self.roll.value() }
    }
}

impl<T: Real> Kinematics<T> {
    /// From the body's part of [`Model::flatten`](crate::world::Model::flatten).
    pub(in crate::world) fn starting(p: &[T]) -> Self {
        let vector = |k: usize| Vec2 { x: p[k], y: p[k + 1] };
        Kinematics { position: vector(0), yaw: p[2], velocity: vector(3), spin: p[5], roll: vector(6) }
    }

    /// A body that does not move.
    pub(in crate::world) fn at_rest(position: Vec2<T>, yaw: T) -> Self {
        Kinematics { position, yaw, velocity: Vec2::zero(), spin: T::zero(), roll: Vec2::zero() }
    }

    /// A constant: its derivatives are zero.
    pub(in crate::world) fn constant(k: &Kinematics<f64>) -> Self {
        Kinematics {
            position: Vec2::constant(k.position),
            yaw: T::constant(k.yaw),
            velocity: Vec2::constant(k.velocity),
            spin: T::constant(k.spin),
            roll: Vec2::constant(k.roll),
        }
    }

    /// The real parts.
    pub fn value(&self) -> Kinematics<f64> {
        Kinematics {
            position: self.position.value(),
            yaw: self.yaw.value(),
            velocity: self.velocity.value(),
            spin: self.spin.value(),
            roll: self.roll.value(),
        }
    }

    /// Whether all derivatives are zero.
    pub(in crate::world) fn is_constant(&self) -> bool {
        let Kinematics { position: p, yaw, velocity: v, spin, roll } = self;
        [p.x, p.y, *yaw, v.x, v.y, *spin, roll.x, roll.y].iter().all(|n| n.is_constant())
    }

    /// Whether all velocities are zero, their derivatives aside.
    pub(in crate::world) fn is_still(&self) -> bool {
        let (v, roll) = (self.velocity.value(), self.roll.value());
        v == Vec2::zero() && self.spin.value() == 0.0 && roll == Vec2::zero()
    }

    /// Velocity in the plane of the body's material point at `point` (m/s).
    pub(in crate::world) fn velocity_at(&self, point: Vec2<T>) -> Vec2<T> {
        self.velocity + (point - self.position).perp() * self.spin
    }

    /// One explicit step over `h` (s): positions by the velocities of `at`, velocities by the rates `r`.
    pub(in crate::world) fn stepped(&self, at: &Kinematics<T>, r: &Rates<T>, h: T) -> Self {
        Kinematics {
            position: self.position + at.velocity * h,
            yaw: self.yaw + at.spin * h,
            velocity: self.velocity + r.velocity * h,
            spin: self.spin + r.spin * h,
            roll: self.roll + r.roll * h,
        }
    }

    /// Last stage of the classical fourth-order Runge-Kutta method over `h` (s): weights 1/6, 1/3, 1/3 and 1/6 of the
    /// rates of this state and of the three `stages`.
    pub(in crate::world) fn summed(&self, k1: &Rates<T>, stages: [(&Self, &Rates<T>); 3], h: T) -> Self {
        let (third, sixth) = (h * (1.0 / 3.0), h * (1.0 / 6.0));
        let [(y2, k2), (y3, k3), (y4, k4)] = stages;
        self.stepped(self, k1, sixth).stepped(y2, k2, third).stepped(y3, k3, third).stepped(y4, k4, sixth)
    }

    /// Cubic Hermite interpolation between this state at `since` and `to` at `until` (s).
    pub(in crate::world) fn between(&self, since: T, to: &Self, until: T, time: f64) -> Self {
        let h = until - since;
        let s = (-since + time) / h;
        let w = hermite(s);
        let (c0, c1, d1) = (w.v0 * h, w.v1 * h, w.rate_x / h);
        let place = |x0: T, v0: T, x1: T, v1: T| x0 + w.x1 * (x1 - x0) + c0 * v0 + c1 * v1;
        let speed = |x0: T, v0: T, x1: T, v1: T| d1 * (x1 - x0) + w.rate_v0 * v0 + w.rate_v1 * v1;
        let (x0, v0, x1, v1) = (self.position, self.velocity, to.position, to.velocity);
        Kinematics {
            position: Vec2 { x: place(x0.x, v0.x, x1.x, v1.x), y: place(x0.y, v0.y, x1.y, v1.y) },
            velocity: Vec2 { x: speed(x0.x, v0.x, x1.x, v1.x), y: speed(x0.y, v0.y, x1.y, v1.y) },
            yaw: place(self.yaw, self.spin, to.yaw, to.spin),
            spin: speed(self.yaw, self.spin, to.yaw, to.spin),
            roll: self.roll + (to.roll - self.roll) * s,
        }
    }
}

/// Position error after `h` (s) had the acceleration been linear (m), from the rates k1 .. k4 of four Runge-Kutta stages:
/// `|k1 - k2 - k3 + k4| h^2 / 12`. It grows with the fourth power of `h`.
pub(in crate::world) fn linearity_error<T: Real>(stages: [&Rates<T>; 4], h: f64) -> f64 {
    let [k1, k2, k3, k4] = stages.map(|k| k.velocity.value());
    (k1 - k2 - k3 + k4).norm() * h * h / 12.0
}

/// Error of the angle of a roll (rad) that is taken to be linear over `h` (s), from its rates at both ends: `|k4 - k1| h^2 / 8`.
pub(in crate::world) fn roll_error<T: Real>(k1: &Rates<T>, k4: &Rates<T>, h: f64) -> f64 {
    (k4.roll - k1.roll).value().norm() * h * h / 8.0
}
