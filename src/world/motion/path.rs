//! Bounded path of one body over a segment: a cubic between its ends, with bounds on its accelerations and its box.

use crate::effects::MOST_MARGIN;
use crate::num::{Vec2, hermite};
use crate::scene::Shape;
use crate::world::motion::kinematics::Kinematics;

/// Motion of one body over a segment: cubic Hermite between its ends, real parts only.
#[derive(Debug, Clone, Copy)]
pub(in crate::world) struct BoundedPath {
    /// s.
    pub start: f64,
    pub end: f64,
    pub shape: Shape,
    from: Kinematics<f64>,
    to: Kinematics<f64>,
    /// Largest acceleration (m/s^2), turn rate (rad/s) and angular acceleration (rad/s^2) over the segment.
    pub acceleration: f64,
    pub turn_rate: f64,
    pub turn_acceleration: f64,
    /// Corners of the axis-aligned box that contains the outline over the segment (m).
    pub low: Vec2,
    pub high: Vec2,
}

impl BoundedPath {
    pub fn new(shape: Shape, start: f64, end: f64, from: Kinematics<f64>, to: Kinematics<f64>) -> Self {
        let h = end - start;
        let (mut acceleration, mut turn_rate, mut turn_acceleration) = (0.0, 0.0, 0.0);
        if h > 0.0 {
            let chord = (to.position - from.position).scaled(6.0 / (h * h));
            let a0 = chord - from.velocity.scaled(4.0 / h) - to.velocity.scaled(2.0 / h);
            let a1 = to.velocity.scaled(4.0 / h) + from.velocity.scaled(2.0 / h) - chord;
            acceleration = a0.norm().max(a1.norm());
            let mean = (to.yaw - from.yaw) / h;
            let t0 = 6.0 * mean / h - (4.0 * from.spin + 2.0 * to.spin) / h;
            let t1 = (4.0 * to.spin + 2.0 * from.spin) / h - 6.0 * mean / h;
            turn_acceleration = f64::max(t0.abs(), t1.abs());
            turn_rate = from.spin.abs().max(to.spin.abs()).max((1.5 * mean).abs());
        }
        let bulge = acceleration * h * h / 8.0;
        let reach = shape.bounding_radius() + bulge + 0.5 * MOST_MARGIN + 1e-9;
        let (a, b) = (from.position, to.position);
        let low = Vec2 { x: a.x.min(b.x) - reach, y: a.y.min(b.y) - reach };
        let high = Vec2 { x: a.x.max(b.x) + reach, y: a.y.max(b.y) + reach };
        BoundedPath { start, end, shape, from, to, acceleration, turn_rate, turn_acceleration, low, high }
    }

    /// The state at `time` (s), which is clamped to the segment.
    pub fn at(&self, time: f64) -> Kinematics<f64> {
        let h = self.end - self.start;
        if h <= 0.0 {
            return self.from;
        }
        let s = ((time - self.start) / h).clamp(0.0, 1.0);
        let w = hermite(s);
        let d1 = w.rate_x / h;
        let (p, q) = (&self.from, &self.to);
        let value = |x0: f64, v0: f64, x1: f64, v1: f64| w.x0 * x0 + w.x1 * x1 + h * (w.v0 * v0 + w.v1 * v1);
        let slope = |x0: f64, v0: f64, x1: f64, v1: f64| d1 * (x1 - x0) + w.rate_v0 * v0 + w.rate_v1 * v1;
        let vector = |f: &dyn Fn(f64, f64, f64, f64) -> f64| Vec2 {
            x: f(p.position.x, p.velocity.x, q.position.x, q.velocity.x),
            y: f(p.position.y, p.velocity.y, q.position.y, q.velocity.y),
        };
        Kinematics {
            position: vector(&value),
            velocity: vector(&slope),
            yaw: value(p.yaw, p.spin, q.yaw, q.spin),
            spin: slope(p.yaw, p.spin, q.yaw, q.spin),
            roll: p.roll,
        }
    }

    /// Whether the boxes of two paths overlap.
    pub fn overlaps(&self, o: &BoundedPath) -> bool {
        self.low.x <= o.high.x && o.low.x <= self.high.x && self.low.y <= o.high.y && o.low.y <= self.high.y
    }
}
