//! Coulomb friction shared between sliding and turning over the foot of a body.

use super::motion::Kinematics;
use crate::num::{Real, Vec2, vec2};
use crate::scene::Shape;

/// Friction over the foot for unit grip: mean of the unit slip velocities over the points that carry the
/// weight, and the mean of their torque (m). Boxes stand on their corners, `rock` more on one diagonal than on the other
/// (four supports leave it open); discs stand on their rim. `growth` carries the derivatives by the shape's size.
pub(super) fn footprint<T: Real>(
    shape: &Shape,
    growth: Option<T>,
    rock: T,
    k: &Kinematics<T>,
) -> (Vec2<T>, T) {
    let Some(growth) = growth else { return of_size(shape, rock, k) };
    // Lengths times a factor do what the spin times the factor does, but for the arm of the torque.
    let factor = growth + 1.0;
    let (force, torque) = of_size(shape, rock, &Kinematics { spin: k.spin * factor, ..*k });
    (force, torque * factor)
}

fn of_size<T: Real>(shape: &Shape, rock: T, k: &Kinematics<T>) -> (Vec2<T>, T) {
    if k.spin.value() == 0.0 && !T::DIFFERENTIATES {
        return (k.velocity.unit(), T::zero());
    }
    match *shape {
        Shape::Disc { radius } | Shape::Ball { radius } => rim(radius, k),
        Shape::Square { half_side } => corners(half_side, half_side, rock, k),
        Shape::Rectangle { half_length, half_width } => corners(half_length, half_width, rock, k),
    }
}

fn corners<T: Real>(a: f64, b: f64, rock: T, k: &Kinematics<T>) -> (Vec2<T>, T) {
    let turn = Vec2::from_angle(k.yaw);
    // Of the corners one after the other, and of one diagonal against the other.
    let mut sum = (Vec2::zero(), T::zero());
    let mut difference = sum;
    for (x, y, sign) in [(a, b, 0.25), (-a, b, -0.25), (-a, -b, 0.25), (a, -b, -0.25)] {
        let arm = vec2(T::constant(x), T::constant(y)).rotated(turn);
        let slip = (k.velocity + arm.perp() * k.spin).unit();
        let torque = arm.cross(slip);
        sum = (sum.0 + slip.scaled(0.25), sum.1 + torque * 0.25);
        difference = (difference.0 + slip.scaled(sign), difference.1 + torque * sign);
    }
    (sum.0 + difference.0 * rock, sum.1 + difference.1 * rock)
}

/// The mean slip speed M(v, w) over a rim that slides with v and turns with w = spin x radius is the
/// perimeter of an ellipse with half axes v + w and |v - w| over 2 pi; force and torque are its slopes.
/// Perimeter by Ramanujan (1914), off by less than 5e-4.
fn rim<T: Real>(radius: f64, k: &Kinematics<T>) -> (Vec2<T>, T) {
    let (v, w) = (k.velocity.norm(), k.spin * radius);
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
        (k.velocity.unit() * along_large, along_small * (radius * sign))
    } else {
        (k.velocity.unit() * along_small, along_large * (radius * sign))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            let (f, t) = rim(0.2, &k);
            assert!(
                (f - force).norm() < 0.02 && (t - torque).abs() < 0.02 * 0.2,
                "{f:?} {force:?} {t} {torque}"
            );
        }
    }

    #[test]
    fn a_box_on_one_diagonal_turns_without_friction_while_it_slides_across_it() {
        let along = |yaw: f64| {
            let k = Kinematics { yaw, velocity: vec2(1.0, 0.0), ..kinematics(1.0, 0.1) };
            corners(0.2, 0.2, 1.0, &k).1
        };
        let quarter = std::f64::consts::FRAC_PI_4;
        assert!(along(quarter).abs() < 1e-4 || along(-quarter).abs() < 1e-4);
        assert!((along(quarter) - along(-quarter)).abs() > 5e-3);
    }

    #[test]
    fn a_body_that_does_not_turn_feels_all_of_it_along_the_velocity() {
        let (f, t) = corners(0.2, 0.2, 0.4, &kinematics(1.0, 0.0));
        assert!((f - vec2(1.0, 0.2).unit()).norm() < 1e-15 && t.abs() < 1e-15);
    }
}
