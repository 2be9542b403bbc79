//! Time of impact of two moving outlines, by conservative advancement.
//!
//! Let g(t) be the gap (m) between the outlines. If it opens at the rate r = dg/dt (m/s) and its second derivative is at least
//! -B (m/s^2) over the interval, then `g + r s - B s^2 / 2` bounds the gap after s seconds from below. The search repeats:
//!
//! 1. advance the time by the first root `s` of that bound; no impact can happen earlier;
//! 2. stop when the gap is at most [`TOUCH`] and the outlines approach: this is the impact.
//!
//! The distance of convex outlines is convex in translation, so B is the bound on the relative acceleration. Where a face of a
//! rotating box is nearest, B includes the terms of that rotating frame ([`turning_bound`]). A last Newton step closes a
//! small gap. Source: Mirtich, Impulse-based Dynamic Simulation of Rigid Body Systems (PhD thesis, Berkeley 1996).

use crate::num::{Real, Vec2};
use crate::scene::Shape;
use crate::world::contact::geometry::{Feature, OutlinePose, Proximity, proximity};
use crate::world::motion::kinematics::Kinematics;
use crate::world::motion::path::BoundedPath;

/// Gap that counts as touching (m).
const TOUCH: f64 = 1e-10;
/// Approach speed below which touching bodies do not approach (m/s).
pub(in crate::world) const APPROACH: f64 = 1e-9;
/// A Newton step shorter than this is taken in full (s).
const NEWTON: f64 = 1e-5;
/// Touching bodies that do not approach are tested again after this time (s).
const GRAZE: f64 = 1e-4;
/// After this number of advances each one covers at least this share of the interval.
const FREE_ADVANCES: usize = 48;
const SMALLEST_ADVANCE: f64 = 1.0 / 256.0;

/// Closest points of two bodies, and the rate at which the gap opens (m/s).
pub(in crate::world) fn facing<T: Real>(
    a: &Kinematics<T>,
    sa: &Shape,
    b: &Kinematics<T>,
    sb: &Shape,
) -> (Proximity<T>, T) {
    let near =
        proximity(&OutlinePose::new(a.position, a.yaw, sa), sa, &OutlinePose::new(b.position, b.yaw, sb), sb);
    let rate = near.normal.dot(b.velocity_at(near.on_b) - a.velocity_at(near.on_a));
    (near, rate)
}

/// A body on its path at one instant.
struct OnPath<'p> {
    path: &'p BoundedPath,
    k: Kinematics<f64>,
}

/// First time in `from..to` (s) at which the two are `margin` (m) apart and approach.
pub(in crate::world) fn time_of_impact(
    a: &BoundedPath,
    b: &BoundedPath,
    margin: f64,
    from: f64,
    to: f64,
) -> Option<f64> {
    let radii = a.shape.bounding_radius() + b.shape.bounding_radius() + margin;
    let bound = a.acceleration + b.acceleration;
    let mut time = from;
    for advance in 0.. {
        let (on_a, on_b) = (OnPath { path: a, k: a.at(time) }, OnPath { path: b, k: b.at(time) });
        let (ka, kb) = (&on_a.k, &on_b.k);
        let delta = kb.position - ka.position;
        let distance = delta.norm();
        let opening = if distance > 0.0 { delta.dot(kb.velocity - ka.velocity) / distance } else { 0.0 };
        let mut step = safe_step(distance - radii, opening, bound);
        if distance - radii <= TOUCH {
            let (mut near, rate) = facing(ka, &a.shape, kb, &b.shape);
            near.gap -= margin;
            if near.gap <= TOUCH && rate < -APPROACH {
                return Some(time);
            }
            let speed = (kb.velocity - ka.velocity).norm() + bound * (to - time);
            step = match near.feature {
                Feature::FaceOfB => face_step(&on_b, &on_a, -near.normal, margin, speed),
                Feature::FaceOfA => face_step(&on_a, &on_b, near.normal, margin, speed),
                Feature::Points if a.shape.is_round() => {
                    safe_step(near.gap, rate, turning_bound(b, a, distance, speed))
                }
                Feature::Points => safe_step(near.gap, rate, turning_bound(a, b, distance, speed)),
            };
            let newton = -near.gap / rate;
            if near.gap > TOUCH && rate < 0.0 && newton < NEWTON && time + newton < to {
                step = step.max(newton);
            } else if near.gap <= TOUCH {
                step = step.max(GRAZE);
            }
        }
        let floor = if advance < FREE_ADVANCES { 1e-12 } else { (to - from) * SMALLEST_ADVANCE };
        time += step.max(floor);
        if time >= to {
            return None;
        }
    }
    None
}

/// Bound on the second derivative of the height of a point of `guest` above a face of `host` (m/s^2), at this distance of
/// the centres (m) and relative speed (m/s): the accelerations, and the Euler, Coriolis and centrifugal terms of the face's frame.
fn turning_bound(host: &BoundedPath, guest: &BoundedPath, distance: f64, speed: f64) -> f64 {
    let of =
        |p: &BoundedPath| if p.shape.is_round() { (0.0, 0.0) } else { (p.turn_rate, p.turn_acceleration) };
    let ((wh, ah), (wg, ag)) = (of(host), of(guest));
    let reach = guest.shape.bounding_radius();
    host.acceleration
        + guest.acceleration
        + (wg * wg + ag) * reach
        + 2.0 * wh * (speed + wg * reach)
        + (wh * wh + ah) * (distance + reach)
}

/// Time in which no point of `guest` can reach the face of `host` with this outward normal (s).
fn face_step(host: &OnPath, guest: &OnPath, normal: Vec2, margin: f64, speed: f64) -> f64 {
    let (kh, kg) = (&host.k, &guest.k);
    let delta = kg.position - kh.position;
    let bound = turning_bound(host.path, guest.path, delta.norm(), speed);
    let turn = Vec2::from_angle(kh.yaw);
    let half = match host.path.shape.half_extents() {
        Some([x, y]) => {
            if normal.dot(turn).abs() > 0.5 {
                x
            } else {
                y
            }
        }
        None => 0.0,
    };
    let step = |arm: Vec2, radius: f64| {
        let d = delta + arm;
        let velocity = kg.velocity + arm.perp().scaled(kg.spin) - kh.velocity;
        safe_step(
            normal.dot(d) - half - radius - margin,
            normal.dot(velocity) + kh.spin * normal.perp().dot(d),
            bound,
        )
    };
    match guest.path.shape.half_extents() {
        None => step(Vec2::zero(), guest.path.shape.bounding_radius()),
        Some([x, y]) => {
            let turn = Vec2::from_angle(kg.yaw);
            let corners = [(x, y), (-x, y), (-x, -y), (x, -y)];
            corners.iter().map(|&(x, y)| step(Vec2 { x, y }.rotated(turn), 0.0)).fold(f64::INFINITY, f64::min)
        }
    }
}

/// Time in which a gap (m) that opens at `rate` (m/s), with a second derivative of at least `-bound` (m/s^2), cannot close (s).
fn safe_step(gap: f64, rate: f64, bound: f64) -> f64 {
    if gap <= 0.0 && rate <= 0.0 {
        return 0.0;
    }
    if bound <= 0.0 {
        return if rate < 0.0 { -gap / rate } else { f64::INFINITY };
    }
    let root = (rate * rate + 2.0 * bound * gap.max(0.0)).sqrt();
    if rate < 0.0 { 2.0 * gap / (root - rate) } else { (rate + root) / bound }
}
