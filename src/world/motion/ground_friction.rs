//! Dry friction of the ground: sliding, rolling and rest of one body, and the changes between them.
//!
//! Coulomb's law bounds the friction force by `F_max = mu m g` ([`Wrench::friction_limit`], N). It is set-valued at rest, so each
//! body has a [`Mode`], and the equations of motion are smooth within a mode (v velocity, m/s; w spin about z, rad/s; F force
//! and tau torque of everything else, N and N m; I moment of inertia about z, kg m^2):
//!
//! - **Slide**, disc or box: `m dv/dt = F - F_max f(v, w)`, `I dw/dt = tau - F_max t(v, w)`. The mean friction direction `f` and
//!   mean arm `t` (m) over the contact patch are those of [`contact_patch`]; sliding and turning share one friction force.
//! - **Slide**, ball of radius r: the lowest point slips with `u = v + r perp(roll)` (m/s) and friction `-F_max u/|u|` acts there.
//!   It slows the ball and turns it until `u = 0`.
//! - **Roll**, ball: `u = 0` holds, so that `roll = perp(v)/r`. Static friction takes 2/7 of a force through the centre and leaves
//!   5/7 of it: `m dv/dt = 5/7 F - F_roll v/|v|`. The ball slides again where `2/7 |F| > F_max`.
//! - **Rest**: `|F| <= F_max` and `|tau| <= tau_max`; all velocities are zero.
//!
//! [`Dynamics::next_change`] extrapolates the slip or the speed linearly to zero and so gives the time of the next change of
//! mode. Sources: Marlow, The Physics of Pocket Billiards (1995), ch. 2; Goyal, Ruina and Papadopoulos, Wear 143 (1991) 307.

use crate::body::Wrench;
use crate::effects::Scalar;
use crate::num::Vec2;
use crate::scene::Shape;
use crate::world::motion::contact_patch::contact_patch;
use crate::world::motion::dynamics::Dynamics;
use crate::world::motion::kinematics::{Kinematics, Rates};

/// How a body moves on the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::world) enum Mode {
    /// It has not entered yet.
    Absent,
    /// Dry friction holds it.
    Rest,
    /// It slides on the ground, or moves without friction.
    Slide,
    /// A ball that rolls without slip.
    Roll,
}

impl Mode {
    pub fn is_moving(self) -> bool {
        matches!(self, Mode::Slide | Mode::Roll)
    }
}

/// What dry friction does to a moving body next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::world) enum ModeChange {
    Stop,
    StartRolling,
    StopSpinning,
    /// Nothing yet: the segment was cut short for accuracy.
    Continue,
}

impl ModeChange {
    /// Whether friction changes its direction or vanishes at the end of the segment.
    pub fn ends_friction(self) -> bool {
        self != ModeChange::Continue
    }
}

/// Slower bodies rest if friction can hold them (m/s, at the rim).
pub(in crate::world) const REST_SPEED: f64 = 1e-7;
/// Turn rate (rad/s) over which the torque against a ball's rotation sets in, so that it is continuous at zero.
const SLOW_TURN: f64 = 0.1;
/// A body in contact that is slower than this and decelerates is put to rest (m/s).
pub(in crate::world) const SETTLING_SPEED: f64 = 1e-3;

/// Whether a force is too strong for ground friction to keep a ball rolling.
fn exceeds_rolling_friction<T: Scalar>(w: &Wrench<T>) -> bool {
    let limit = w.friction_limit.value();
    limit > 0.0 && 2.0 / 7.0 * w.force.value().norm() > limit
}

impl<T: Scalar> Dynamics<T> {
    /// Velocity of the lowest point of ball `i` against the ground (m/s).
    pub fn slip(&self, i: usize, k: &Kinematics<T>) -> Vec2<T> {
        k.velocity + k.roll.perp().scaled(self.shapes[i].bounding_radius())
    }

    /// The mode of body `i` once a wrench acts on it: friction may no longer hold it, or keep it rolling.
    pub fn mode_under(&self, i: usize, mode: Mode, w: &Wrench<T>) -> Mode {
        match mode {
            Mode::Rest if !self.friction_holds(i, w) => Mode::Slide,
            Mode::Roll if exceeds_rolling_friction(w) => Mode::Slide,
            _ => mode,
        }
    }

    /// Acceleration of the centre per force (1/kg): 5/7 of `1/m` for a rolling ball.
    pub fn compliance(&self, i: usize, mode: Mode) -> T {
        match mode {
            Mode::Roll => self.inverse_mass[i] * (5.0 / 7.0),
            Mode::Slide => self.inverse_mass[i],
            Mode::Rest | Mode::Absent => T::zero(),
        }
    }

    /// Whether dry friction holds the body at rest: there is some, and no force exceeds it.
    pub fn friction_holds(&self, i: usize, w: &Wrench<T>) -> bool {
        let (force, torque) = self.static_limits(i, w);
        force > 0.0 && w.force.value().norm() <= force && w.torque.value().abs() <= torque
    }

    /// Largest force (N), and torque about z (N m), that dry friction balances for a body at rest.
    pub fn static_limits(&self, i: usize, w: &Wrench<T>) -> (f64, f64) {
        let (limit, rolling) = (w.friction_limit.value(), w.rolling_resistance.value());
        if self.shapes[i].is_ball() {
            // Without sliding friction the ball glides, and its rolling resistance alone holds it.
            (if limit > 0.0 { rolling.min(3.5 * limit) } else { rolling }, f64::INFINITY)
        } else {
            (limit, limit * self.shapes[i].bounding_radius() + w.spin_friction_limit.value())
        }
    }

    /// Time until a slow body that decelerates is at rest (s).
    pub fn time_to_settle(&self, i: usize, k: &Kinematics<T>, r: &Rates<T>) -> Option<T> {
        let inertia = self.shapes[i].unit_inertia();
        let squared = k.velocity.norm_squared() + (k.spin * k.spin + k.roll.norm_squared()) * inertia;
        let power = k.velocity.dot(r.velocity) + (k.spin * r.spin + k.roll.dot(r.roll)) * inertia;
        let slow = squared.value() > 0.0 && squared.value() < SETTLING_SPEED * SETTLING_SPEED;
        (slow && power.value() < 0.0).then(|| -(squared / power))
    }

    /// Accelerations under the wrench, with the dry friction of the mode.
    pub fn rates(&self, i: usize, k: &Kinematics<T>, mode: Mode, w: &Wrench<T>) -> Rates<T> {
        if !mode.is_moving() {
            return Rates::zero();
        }
        let mut rates = match self.shapes[i] {
            Shape::Ball { radius } => self.ball_rates(i, radius, k, mode, w),
            _ => self.sliding_rates(i, k, w),
        };
        if w.damping.value() != 0.0 || w.spin_damping.value() != 0.0 || T::DIFFERENTIATES {
            let of_spins = w.damping + w.spin_damping;
            // Where a ball rolls, its spin carries 2/7 of the momentum that damping reduces.
            let rolls = mode == Mode::Roll;
            let of_velocity = if rolls { w.damping + w.spin_damping * (2.0 / 7.0) } else { w.damping };
            rates.velocity -= k.velocity * of_velocity;
            rates.spin -= k.spin * of_spins;
            if self.shapes[i].is_ball() {
                rates.roll -= k.roll * if rolls { of_velocity } else { of_spins };
            }
        }
        rates
    }

    /// Torque about z with the spin friction that `friction_limit` does not contain (N m). A spin below [`REST_SPEED`] is a rounding
    /// error, and its sign changes from stage to stage.
    fn torque(&self, i: usize, k: &Kinematics<T>, w: &Wrench<T>) -> T {
        let mut torque = w.torque;
        if k.spin.value().abs() * self.shapes[i].bounding_radius() > REST_SPEED {
            torque -= w.spin_friction_limit * k.spin.value().signum();
        }
        torque
    }

    /// Accelerations of a disc or box, undamped.
    fn sliding_rates(&self, i: usize, k: &Kinematics<T>, w: &Wrench<T>) -> Rates<T> {
        let (mut force, mut torque) = (w.force, self.torque(i, k, w));
        if w.friction_limit.value() > 0.0 {
            let growth = self.growth.get(i).copied();
            let growth = match growth {
                None if w.load_concentration.value() == 0.0 && !T::DIFFERENTIATES => None,
                None => Some(w.load_concentration),
                Some(g) => Some(g + w.load_concentration + g * w.load_concentration),
            };
            let (f, t) = contact_patch(&self.shapes[i], growth, w.diagonal_load, k);
            force -= (f - f.perp() * w.friction_skew) * w.friction_limit;
            torque -= (t - w.friction_arm * f.norm()) * w.friction_limit;
        }
        Rates {
            velocity: force * self.inverse_mass[i],
            spin: torque * self.inverse_inertia[i],
            roll: Vec2::zero(),
        }
    }

    /// Accelerations of a ball, undamped.
    fn ball_rates(&self, i: usize, radius: f64, k: &Kinematics<T>, mode: Mode, w: &Wrench<T>) -> Rates<T> {
        let mut force = w.force;
        let spin = self.torque(i, k, w) * self.inverse_inertia[i];
        if mode == Mode::Roll {
            let velocity = force * (self.inverse_mass[i] * (5.0 / 7.0))
                - k.velocity.unit() * (w.rolling_resistance * self.inverse_mass[i]);
            return Rates { velocity, spin, roll: velocity.perp().scaled(1.0 / radius) };
        }
        if w.friction_limit.value() <= 0.0 {
            force -= k.velocity.unit() * w.rolling_resistance;
            return Rates { velocity: force * self.inverse_mass[i], spin, roll: Vec2::zero() };
        }
        let slip = self.slip(i, k);
        // A force that ends rolling makes the lowest point slip along that force.
        let starts_to_slip = slip.value().norm() <= REST_SPEED && exceeds_rolling_friction(w);
        let friction = -((if starts_to_slip { force } else { slip }).unit() * w.friction_limit);
        let mut roll = friction.perp() * (-(self.inverse_inertia[i] * radius));
        if w.rolling_torque.value() > 0.0 || T::DIFFERENTIATES {
            // Rolling resistance also opposes the rotation that friction starts in a ball without roll.
            let turn = k.roll + roll.unit() * T::constant(2.0 * SLOW_TURN);
            let rate = (turn.norm_squared() + SLOW_TURN * SLOW_TURN).sqrt();
            roll -= turn * (w.rolling_torque * self.inverse_inertia[i] / rate);
        }
        Rates { velocity: (force + friction) * self.inverse_mass[i], spin, roll }
    }

    /// The next change of mode of a moving body and the time until then (s), if its deceleration lasts.
    pub fn next_change(
        &self,
        i: usize,
        k: &Kinematics<T>,
        mode: Mode,
        w: &Wrench<T>,
        r: &Rates<T>,
    ) -> Option<(ModeChange, T)> {
        let ball = self.shapes[i].is_ball();
        let until_zero =
            |size: T, slope: T| (size.value() > 0.0 && slope.value() < 0.0).then(|| -(size / slope));
        let change = if ball && mode == Mode::Slide && w.friction_limit.value() > 0.0 {
            let slip = self.slip(i, k);
            let slope = slip.unit().dot(r.velocity + r.roll.perp().scaled(self.shapes[i].bounding_radius()));
            if slip.value().norm() <= REST_SPEED {
                return (!exceeds_rolling_friction(w)).then(|| (ModeChange::StartRolling, T::zero()));
            }
            until_zero(slip.norm(), slope).map(|t| (ModeChange::StartRolling, t))
        } else {
            if w.friction_limit.value() <= 0.0 && w.rolling_resistance.value() <= 0.0 {
                return None;
            }
            let inertia = if ball { 0.0 } else { self.shapes[i].unit_inertia() };
            let size = (k.velocity.norm_squared() + k.spin * k.spin * inertia).sqrt_or_zero();
            if size.value() <= REST_SPEED {
                // Friction does not stop a body that a force accelerates.
                let (v, a) = (k.velocity.value(), r.velocity.value());
                let pushed = v.dot(a) > 0.0 || (v == Vec2::zero() && a != Vec2::zero());
                return (!pushed && self.friction_holds(i, w)).then(|| (ModeChange::Stop, T::zero()));
            }
            let slope = (k.velocity.dot(r.velocity) + k.spin * r.spin * inertia) / size;
            until_zero(size, slope).map(|t| (ModeChange::Stop, t))
        };
        // Friction over the contact patch ends spin and sliding together. Only a torque of its own ends the spin earlier.
        let pivots = (w.spin_friction_limit * self.inverse_inertia[i]).value() > 0.5 * r.spin.value().abs();
        if pivots && k.spin.value() != 0.0 && k.velocity.value().norm() > REST_SPEED {
            let stop = until_zero(k.spin.abs(), r.spin * k.spin.value().signum());
            if let Some(t) = stop
                && change.as_ref().is_none_or(|(_, u)| t.value() < u.value())
            {
                return Some((ModeChange::StopSpinning, t));
            }
        }
        change
    }
}

#[cfg(test)]
mod tests {
    use crate::num::vec2;
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::{Ending, trace};

    #[test]
    fn a_force_beyond_ground_friction_makes_a_rolling_ball_slide() {
        let (slide, force) = (0.01, 0.6);
        let mut ball = body(0, Shape::Ball { radius: 0.2 }, vec2(0.0, 0.0), vec2(0.5, 0.0));
        ball.start.rolling = true;
        let laws: &[(&str, &[f64])] = &[("ball_spin", &[slide, 0.005]), ("uniform_force", &[force, 0.0])];
        let run = trace(&model(vec![ball.clone()], laws), &seconds(2));
        assert_eq!(run.ending, Ending::Completed);
        let (end, time) =
            (run.states.last().and_then(|row| row[0]).expect("present"), run.times[run.times.len() - 1]);
        let expected = 0.5 + (force / ball.mass - slide * 9.81) * time;
        assert!((end.velocity.x - expected).abs() < 1e-6 * expected, "{} {expected}", end.velocity.x);
    }

    /// Slip closes at 7/2 (mu_slide - mu_roll) g, while the ball slows at mu_slide g.
    #[test]
    fn rolling_resistance_opposes_the_rotation_of_a_sliding_ball() {
        let (slide, roll, speed) = (0.15, 0.03, 1.0);
        let ball = body(0, Shape::Ball { radius: 0.2 }, vec2(0.0, 0.0), vec2(speed, 0.0));
        let run = trace(&model(vec![ball], &[("ball_spin", &[slide, roll])]), &seconds(20));
        let until = speed / (3.5 * (slide - roll) * 9.81);
        let rolls = speed - slide * 9.81 * until;
        let frame = (until / 0.04).ceil() as usize + 1;
        let expected = rolls - roll * 9.81 * (run.times[frame] - until);
        let found = run.states[frame][0].expect("present").velocity.x;
        assert!(
            (found - expected).abs() < 0.004 && (found / (5.0 / 7.0) - 1.0).abs() > 0.05,
            "{found} {expected}"
        );
    }

    /// The solution of x' = -(a + b x) x; rolling, the force takes 5/7 of its share and the spin 2/7.
    #[test]
    fn damping_slows_a_spin_and_a_rolling_ball_as_its_equation_gives() {
        let [linear, quadratic, turn] = [0.05, 0.04, 0.06];
        let after = |x: f64, b: f64, t: f64| linear / ((linear / x + b) * (linear * t).exp() - b);
        let (radius, speed, spin) = (0.2, 1.2, 2.5);
        let mut ball = body(0, Shape::Ball { radius }, vec2(0.0, 0.0), vec2(speed, 0.0));
        ball.start.rolling = true;
        let mut square = body(1, Shape::Square { half_side: 0.2 }, vec2(0.0, 2.0), vec2(speed, 0.0));
        square.start.state.spin = spin;
        let laws: &[(&str, &[f64])] = &[("damping", &[linear, quadratic, turn]), ("ball_spin", &[0.5, 0.0])];
        let run = trace(&model(vec![ball, square], laws), &seconds(50));
        let (time, row) = (run.times[50], &run.states[50]);
        let (ball, square) = (row[0].expect("present"), row[1].expect("present"));
        let rolls = after(speed, (5.0 * quadratic + 2.0 * turn / radius) / 7.0, time);
        for (found, expected) in [
            (ball.velocity.x, rolls),
            (ball.roll.y, rolls / radius),
            (square.velocity.x, after(speed, quadratic, time)),
            (square.spin, after(spin, turn, time)),
        ] {
            assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
        }
    }
}
