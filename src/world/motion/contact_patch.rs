//! Coulomb friction over the contact patch, shared between sliding and turning.
//!
//! Each point of the patch at `r` (m, from the centre) slips with `s = v + w perp(r)` (m/s). Friction of unit limit has the
//! force `f = <s/|s|>` and the torque arm `t = <r x s/|s|>` (m), means over the points that carry the weight. Both are the
//! gradient of the mean slip speed `M(v, w) = <|s|>`: `f = dM/dv`, `t = dM/dw`. A box stands on its corners, a disc on its rim.
//! Source: Goyal, Ruina and Papadopoulos, Wear 143 (1991) 307.

use crate::num::{Real, Vec2, elementary};
use crate::scene::Shape;
use crate::world::motion::kinematics::Kinematics;

/// Force `f` and torque arm `t` (m) of friction of unit limit over the contact patch. `diagonal_load` is the share by which a
/// box loads one diagonal more: four supports leave it open. `growth` scales the lengths of the patch by `1 + growth`.
pub(in crate::world) fn contact_patch<T: Real>(
    shape: &Shape,
    growth: Option<T>,
    diagonal_load: T,
    k: &Kinematics<T>,
) -> (Vec2<T>, T) {
    let Some(growth) = growth else { return unscaled(shape, diagonal_load, k, k.spin) };
    // Scaling the lengths acts as scaling the spin, except for the arm of the torque.
    let factor = growth + 1.0;
    let (force, torque) = unscaled(shape, diagonal_load, k, k.spin * factor);
    (force, torque * factor)
}

/// The same where `spin` takes the place of the body's.
fn unscaled<T: Real>(shape: &Shape, diagonal_load: T, k: &Kinematics<T>, spin: T) -> (Vec2<T>, T) {
    if spin.value() == 0.0 && !T::DIFFERENTIATES {
        return (k.velocity.unit(), T::zero());
    }
    match *shape {
        Shape::Disc { radius } | Shape::Ball { radius } => rim(radius, k.velocity, spin),
        Shape::Square { half_side } => corners([half_side; 2], diagonal_load, k, spin),
        Shape::Rectangle { half_length, half_width } => {
            corners([half_length, half_width], diagonal_load, k, spin)
        }
    }
}

/// Radius of the small patch that supports a corner, as a share of the box's half diagonal. Its points slip by
/// `patch x spin` where the corner does not, so that friction is continuous when a box pivots about a corner. Most boxes do
/// so before they stop (Goyal, Ruina and Papadopoulos, 1991).
const CORNER_PATCH: f64 = 0.05;

/// Gradient of the mean slip speed over the corners, each `sqrt(slip^2 + (patch x spin)^2)`.
fn corners<T: Real>([a, b]: [f64; 2], diagonal_load: T, k: &Kinematics<T>, spin: T) -> (Vec2<T>, T) {
    let turn = Vec2::from_angle(k.yaw);
    let patch = CORNER_PATCH * elementary::hypot(a, b);
    let own = spin * patch;
    let of_patch = own * own;
    // Of both diagonals, one corner and the one across.
    let diagonal = |x: f64, y: f64| {
        let arm = turn.scaled(x) + turn.perp().scaled(y);
        let turning = arm.perp() * spin;
        let unit = |slip: Vec2<T>| {
            let squared = slip.norm_squared() + of_patch;
            let q = squared.value();
            let inverse = if q > 0.0 { 1.0 / q.sqrt() } else { return (Vec2::zero(), T::zero()) };
            let share = squared.chain(inverse, -0.5 * inverse / q);
            (slip * share, share)
        };
        let ((near, s), (far, t)) = (unit(k.velocity + turning), unit(k.velocity - turning));
        ((near + far).scaled(0.25), (arm.cross(near - far) + own * (s + t) * patch) * 0.25)
    };
    let ((f, t), (g, u)) = (diagonal(a, b), diagonal(-a, b));
    (f + g + (f - g) * diagonal_load, t + u + (t - u) * diagonal_load)
}

/// Gradient of the mean slip speed over a rim that slides with v and turns with w = spin x radius. `2 pi M(v, w)` is the
/// perimeter of an ellipse with half axes v + w and |v - w|, by Ramanujan's approximation (1914), relative error below 5e-4.
fn rim<T: Real>(radius: f64, velocity: Vec2<T>, spin: T) -> (Vec2<T>, T) {
    let (v, w) = (velocity.norm(), spin * radius);
    let speed = w.abs();
    let (large, small) = if v.value() >= speed.value() { (v, speed) } else { (speed, v) };
    if large.value() == 0.0 {
        return (Vec2::zero(), T::zero());
    }
    let q = small / large;
    let x = q * q;
    let s = (-x * 3.0 + 4.0).sqrt();
    let below = s + 10.0;
    let g = x * 3.0 / below + 1.0;
    let slope = (below * 3.0 + x * 4.5 / s) / (below * below);
    let (along_large, along_small) = (g - x * slope * 2.0, q * slope * 2.0);
    let sign = if w.value() < 0.0 { -1.0 } else { 1.0 };
    if v.value() >= speed.value() {
        (velocity.unit() * along_large, along_small * (radius * sign))
    } else {
        (velocity.unit() * along_small, along_large * (radius * sign))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::vec2;

    fn kinematics(vx: f64, spin: f64) -> Kinematics<f64> {
        Kinematics { position: vec2(0., 0.), yaw: 0.3, velocity: vec2(vx, 0.2), spin, roll: vec2(0., 0.) }
    }

    #[test]
    fn the_rim_formula_is_the_mean_over_many_points() {
        for (vx, spin) in [(1.0, 0.5), (0.3, 4.0), (2.0, -3.0), (0.1, 0.0)] {
            let k = kinematics(vx, spin);
            let (mut force, mut torque) = (vec2(0.0, 0.0), 0.0);
            for n in 0..100_000 {
                let arm = Vec2::from_angle(n as f64 * std::f64::consts::TAU / 1e5).scaled(0.2);
                let slip = (k.velocity + arm.perp().scaled(spin)).unit();
                force += slip.scaled(1e-5);
                torque += arm.cross(slip) * 1e-5;
            }
            let (f, t) = rim(0.2, k.velocity, spin);
            assert!(
                (f - force).norm() < 0.02 && (t - torque).abs() < 0.02 * 0.2,
                "{f:?} {force:?} {t} {torque}"
            );
        }
    }

    #[test]
    fn a_box_on_one_diagonal_spins_without_friction_while_it_slides_across_it() {
        let along = |yaw: f64| {
            let k = Kinematics { yaw, velocity: vec2(1.0, 0.0), ..kinematics(1.0, 0.1) };
            corners([0.2; 2], 1.0, &k, k.spin).1
        };
        let quarter = std::f64::consts::FRAC_PI_4;
        assert!(along(quarter).abs() < 1e-4 || along(-quarter).abs() < 1e-4);
        assert!((along(quarter) - along(-quarter)).abs() > 5e-3);
    }

    #[test]
    fn without_spin_all_friction_acts_along_the_velocity() {
        let (f, t) = corners([0.2; 2], 0.4, &kinematics(1.0, 0.0), 0.0);
        assert!((f - vec2(1.0, 0.2).unit()).norm() < 1e-15 && t.abs() < 1e-15);
    }
}
