//! Motion between events: forces, dry friction by mode (sliding, rolling, rest), and the integrator.

use super::footprint::footprint;
use super::model::{BODY_VALUES, MASS, Model};
use crate::body::{Body, BodyCorrection, Wrench};
use crate::effects::program::Program;
use crate::effects::{Hook, Hooks, Scalar};
use crate::num::{Real, Vec2};
use crate::scene::Shape;
use std::cell::Cell;

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

/// Time derivative of the velocities of [`Kinematics`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Rates<T> {
    pub velocity: Vec2<T>,
    pub spin: T,
    pub roll: Vec2<T>,
}

/// How a body stands to the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    /// Not there yet.
    Absent,
    /// Held by dry friction.
    Rest,
    /// Its foot slides (or floats, where there is no friction).
    Slide,
    /// A ball whose foot does not slide.
    Roll,
}

/// What dry friction will do to a moving body next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    Stop,
    StartRolling,
    StopSpinning,
    /// Nothing yet: the stretch was cut short for accuracy.
    Continue,
}

/// Speeds below this are rest, once friction can hold the body (m/s, at the rim).
pub(super) const REST_SPEED: f64 = 1e-7;

/// Resistance to a ball's turning sets in over this turn rate (rad/s), so that it has no jump at none.
const SLOW_TURN: f64 = 0.1;
/// Speed below which a body that is pressed on and gets slower is at rest (m/s).
pub(super) const SETTLING_SPEED: f64 = 1e-3;

/// The active effects and masses of one simulation, resolved for each body.
pub(super) struct Laws<T: Scalar> {
    pub shapes: Vec<Shape>,
    pub mass: Vec<T>,
    pub inverse_mass: Vec<T>,
    pub inverse_inertia: Vec<T>,
    /// Relative growth of each outline: derivatives only; empty where there are none.
    pub growth: Vec<T>,
    forces: Vec<PerBody<T>>,
    pub(super) pairs: Vec<PerBody<T>>,
    /// Each with its parameters, body by body.
    pub(super) formulas: Vec<(Program, Vec<Vec<T>>)>,
    /// Whether a formula had no finite value since.
    pub undefined: Cell<bool>,
    /// For each body, whether neither its mass nor a parameter of its forces carries derivatives.
    pub constant: Vec<bool>,
    /// The shortest time in which a force may change much by itself (s).
    pub pace: f64,
}

/// One effect's hooks with its parameters, body by body.
pub(super) struct PerBody<T: Scalar> {
    pub hooks: &'static Hooks<T>,
    pub values: Vec<T>,
    count: usize,
}

impl<T: Scalar> PerBody<T> {
    pub fn of(&self, body: usize) -> &[T] {
        &self.values[body * self.count..(body + 1) * self.count]
    }
}

impl<T: Scalar> Laws<T> {
    pub fn new(model: &Model, flat: &[T]) -> Self {
        let (mut forces, mut pairs, mut pace) = (vec![], vec![], f64::INFINITY);
        let one = T::constant(1.0);
        let mut matter = vec![BodyCorrection { mass: one, size: one }; model.bodies.len()];
        for (active, entry, first) in model.active() {
            let hooks = T::hooks(entry);
            let values = |body| active.values_for(first, flat, body, body);
            if entry.uses(Hook::Matter) {
                for (body, matter) in model.bodies.iter().zip(&mut matter) {
                    (hooks.matter)(&values(body), matter);
                }
            }
            let (force, pair) = (entry.uses(Hook::Force), entry.uses(Hook::Pair));
            if !force && !pair {
                continue;
            }
            let (values, count): (Vec<T>, _) =
                (model.bodies.iter().flat_map(values).collect(), active.parameters.len());
            pace = values.chunks_exact(count.max(1)).map(hooks.pace).fold(pace, f64::min);
            let list = if force { &mut forces } else { &mut pairs };
            list.push(PerBody { hooks, values, count });
        }
        let (mut formulas, mut undefined) = (vec![], false);
        for (active, formula, first) in model.formulas() {
            let Ok(program) = formula.read() else {
                undefined = true;
                continue;
            };
            pace = pace.min(program.pace());
            let values = |body| active.values_for(first, flat, body, body);
            formulas.push((program, model.bodies.iter().map(values).collect::<Vec<_>>()));
        }
        let shapes: Vec<Shape> =
            model.bodies.iter().zip(&matter).map(|(b, m)| b.shape.scaled(m.size.value())).collect();
        let mut growth: Vec<T> = matter.iter().map(|m| (m.size / m.size.value()).infinitesimal()).collect();
        if growth.iter().all(|g| g.is_constant()) {
            growth.clear();
        }
        let believed = (0..shapes.len()).map(|i| flat[i * BODY_VALUES.len() + MASS]);
        let mass: Vec<T> = believed.zip(&matter).map(|(m, real)| m * real.mass).collect();
        let inverse_mass: Vec<T> = mass.iter().map(|&m| one / m).collect();
        let mut inverse_inertia: Vec<T> =
            inverse_mass.iter().zip(&shapes).map(|(&m, s)| m / s.unit_inertia()).collect();
        for ((inertia, shape), growth) in inverse_inertia.iter_mut().zip(&shapes).zip(&growth) {
            // A ball's speeds at its surface do not depend on its size.
            if !shape.is_ball() {
                *inertia *= -*growth * 2.0 + 1.0;
            }
        }
        let plain = |values: &[T]| values.iter().all(|p| p.is_constant());
        let constant = (0..shapes.len()).map(|i| {
            let formulas = formulas.iter().all(|(_, values): &(_, Vec<Vec<T>>)| plain(&values[i]));
            mass[i].is_constant() && formulas && forces.iter().all(|law| plain(law.of(i)))
        });
        let constant = constant.collect();
        let undefined = Cell::new(undefined);
        Laws {
            shapes,
            mass,
            inverse_mass,
            inverse_inertia,
            growth,
            forces,
            pairs,
            formulas,
            undefined,
            constant,
            pace,
        }
    }

    /// Whether nothing that acts on body `i` alone has another number than in `other`, which is of the same model.
    pub fn same(&self, other: &Self, i: usize) -> bool
    where
        T: PartialEq,
    {
        let forces = self.forces.iter().zip(&other.forces).all(|(a, b)| a.of(i) == b.of(i));
        forces && self.same_written(other, i)
    }

    pub fn body(&self, i: usize, k: &Kinematics<T>) -> Body<T> {
        Body {
            shape: self.shapes[i],
            mass: self.mass[i],
            position: k.position,
            yaw: k.yaw,
            velocity: k.velocity,
            spin: k.spin,
            roll: k.roll,
        }
    }

    /// What the force effects do to body `i`.
    pub fn wrench(&self, i: usize, k: &Kinematics<T>, time: T) -> Wrench<T> {
        let mut out = self.of_library(i, k, time);
        self.add_written(i, k, time, &mut out);
        out
    }

    /// The same without formulas.
    pub fn of_library(&self, i: usize, k: &Kinematics<T>, time: T) -> Wrench<T> {
        let body = self.body(i, k);
        let mut out = Wrench::zero();
        for law in &self.forces {
            (law.hooks.force)(law.of(i), time, &body, &mut out);
        }
        if out.friction_excess.value() != 0.0 || !out.friction_excess.is_constant() {
            let factor = out.friction_excess + 1.0;
            out.friction_limit *= factor;
            out.rolling_resistance *= factor;
            out.rolling_torque *= factor;
            out.spin_friction_limit *= factor;
        }
        out
    }

    /// Velocity of the lowest point of ball `i` against the ground (m/s).
    pub fn slip(&self, i: usize, k: &Kinematics<T>) -> Vec2<T> {
        k.velocity + k.roll.perp().scaled(self.shapes[i].bounding_radius())
    }

    /// The mode of body `i` once a force acts on it: friction may no longer hold it, or let it roll.
    pub fn mode_under(&self, i: usize, mode: Mode, w: &Wrench<T>) -> Mode {
        match mode {
            Mode::Rest if !self.holds(i, w) => Mode::Slide,
            Mode::Roll if tears(w) => Mode::Slide,
            _ => mode,
        }
    }

    /// Share of a force that moves the centre: 5/7 of a rolling ball.
    pub fn compliance(&self, i: usize, mode: Mode) -> T {
        match mode {
            Mode::Roll => self.inverse_mass[i] * (5.0 / 7.0),
            Mode::Slide => self.inverse_mass[i],
            Mode::Rest | Mode::Absent => T::zero(),
        }
    }

    /// Whether dry friction holds the body where it is: at least some of it, and no force beyond it.
    pub fn holds(&self, i: usize, w: &Wrench<T>) -> bool {
        let (force, torque) = self.hold(i, w);
        force > 0.0 && w.force.value().norm() <= force && w.torque.value().abs() <= torque
    }

    /// Most force (N), and torque about z (N m), that dry friction takes of a body at rest.
    pub fn hold(&self, i: usize, w: &Wrench<T>) -> (f64, f64) {
        let (grip, rolling) = (w.friction_limit.value(), w.rolling_resistance.value());
        if self.shapes[i].is_ball() {
            // Without grip it rests as a glider does.
            (if grip > 0.0 { rolling.min(3.5 * grip) } else { rolling }, f64::INFINITY)
        } else {
            (grip, grip * self.shapes[i].bounding_radius() + w.spin_friction_limit.value())
        }
    }

    /// When a body that is slow and gets slower will be at rest (s).
    pub fn time_to_settle(&self, i: usize, k: &Kinematics<T>, r: &Rates<T>) -> Option<T> {
        let lever = self.shapes[i].unit_inertia();
        let squared = k.velocity.norm_squared() + (k.spin * k.spin + k.roll.norm_squared()) * lever;
        let power = k.velocity.dot(r.velocity) + (k.spin * r.spin + k.roll.dot(r.roll)) * lever;
        let slow = squared.value() > 0.0 && squared.value() < SETTLING_SPEED * SETTLING_SPEED;
        (slow && power.value() < 0.0).then(|| -(squared / power))
    }

    /// Accelerations under the wrench, dry friction resolved by mode.
    pub fn rates(&self, i: usize, k: &Kinematics<T>, mode: Mode, w: &Wrench<T>) -> Rates<T> {
        if matches!(mode, Mode::Rest | Mode::Absent) {
            return Rates::zero();
        }
        let mut rates = self.undamped(i, k, mode, w);
        if w.damping.value() != 0.0 || w.spin_damping.value() != 0.0 || T::DIFFERENTIATES {
            let of_spins = w.damping + w.spin_damping;
            // Where a ball's foot holds, its spin has 2/7 of all that moves.
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

    fn undamped(&self, i: usize, k: &Kinematics<T>, mode: Mode, w: &Wrench<T>) -> Rates<T> {
        let mut force = w.force;
        let mut torque = w.torque;
        if k.spin.value() != 0.0 {
            torque -= w.spin_friction_limit * k.spin.value().signum();
        }
        let shape = &self.shapes[i];
        let Shape::Ball { radius } = *shape else {
            if w.friction_limit.value() > 0.0 {
                let growth = self.growth.get(i).copied();
                let growth = match growth {
                    None if w.load_concentration.value() == 0.0 && !T::DIFFERENTIATES => None,
                    None => Some(w.load_concentration),
                    Some(g) => Some(g + w.load_concentration + g * w.load_concentration),
                };
                let (f, t) = footprint(shape, growth, w.diagonal_load, k);
                force -= (f - f.perp() * w.friction_skew) * w.friction_limit;
                torque -= (t - w.friction_arm * f.norm()) * w.friction_limit;
            }
            return Rates {
                velocity: force * self.inverse_mass[i],
                spin: torque * self.inverse_inertia[i],
                roll: Vec2::zero(),
            };
        };
        let spin = torque * self.inverse_inertia[i];
        if mode == Mode::Roll {
            let velocity = force * (self.inverse_mass[i] * (5.0 / 7.0))
                - k.velocity.unit() * (w.rolling_resistance * self.inverse_mass[i]);
            return Rates { velocity, spin, roll: velocity.perp().scaled(1.0 / radius) };
        }
        if w.friction_limit.value() > 0.0 {
            let slip = self.slip(i, k);
            // Where it is torn from rolling, its foot will slip along the force.
            let torn = slip.value().norm() <= REST_SPEED && tears(w);
            let friction = -((if torn { force } else { slip }).unit() * w.friction_limit);
            let mut roll = friction.perp() * (-(self.inverse_inertia[i] * radius));
            if w.rolling_torque.value() > 0.0 || T::DIFFERENTIATES {
                // A ball that does not turn yet is hindered from what its foot's friction begins.
                let turn = k.roll + roll.unit() * T::constant(2.0 * SLOW_TURN);
                let rate = (turn.norm_squared() + SLOW_TURN * SLOW_TURN).sqrt();
                roll -= turn * (w.rolling_torque * self.inverse_inertia[i] / rate);
            }
            Rates { velocity: (force + friction) * self.inverse_mass[i], spin, roll }
        } else {
            force -= k.velocity.unit() * w.rolling_resistance;
            Rates { velocity: force * self.inverse_mass[i], spin, roll: Vec2::zero() }
        }
    }

    /// What friction will do next to a moving body, and after which time (s), if its deceleration lasts.
    pub fn next_change(
        &self,
        i: usize,
        k: &Kinematics<T>,
        mode: Mode,
        w: &Wrench<T>,
        r: &Rates<T>,
    ) -> Option<(Change, T)> {
        let ball = self.shapes[i].is_ball();
        let until_zero =
            |size: T, slope: T| (size.value() > 0.0 && slope.value() < 0.0).then(|| -(size / slope));
        let change = if ball && mode == Mode::Slide && w.friction_limit.value() > 0.0 {
            let slip = self.slip(i, k);
            let slope = slip.unit().dot(r.velocity + r.roll.perp().scaled(self.shapes[i].bounding_radius()));
            if slip.value().norm() <= REST_SPEED {
                return (!tears(w)).then(|| (Change::StartRolling, T::zero()));
            }
            until_zero(slip.norm(), slope).map(|t| (Change::StartRolling, t))
        } else {
            if w.friction_limit.value() <= 0.0 && w.rolling_resistance.value() <= 0.0 {
                return None;
            }
            let lever = if ball { 0.0 } else { self.shapes[i].unit_inertia() };
            let size = (k.velocity.norm_squared() + k.spin * k.spin * lever).sqrt_or_zero();
            if size.value() <= REST_SPEED {
                // A body that something pushes off is not stopped by friction alone.
                let (v, a) = (k.velocity.value(), r.velocity.value());
                let pushed = v.dot(a) > 0.0 || (v == Vec2::zero() && a != Vec2::zero());
                return (!pushed && self.holds(i, w)).then(|| (Change::Stop, T::zero()));
            }
            let slope = (k.velocity.dot(r.velocity) + k.spin * r.spin * lever) / size;
            until_zero(size, slope).map(|t| (Change::Stop, t))
        };
        // What the footprint does to the spin fades with it; only a torque of its own ends it before the motion.
        let pivots = (w.spin_friction_limit * self.inverse_inertia[i]).value() > 0.5 * r.spin.value().abs();
        if pivots && k.spin.value() != 0.0 && k.velocity.value().norm() > REST_SPEED {
            let stop = until_zero(k.spin.abs(), r.spin * k.spin.value().signum());
            if let Some(t) = stop
                && change.as_ref().is_none_or(|(_, u)| t.value() < u.value())
            {
                return Some((Change::StopSpinning, t));
            }
        }
        change
    }
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
    /// Moved on by `h` (s) at constant rates of the velocities of `at`.
    pub(super) fn stepped(&self, at: &Kinematics<T>, r: &Rates<T>, h: T) -> Self {
        Kinematics {
            position: self.position + at.velocity * h,
            yaw: self.yaw + at.spin * h,
            velocity: self.velocity + r.velocity * h,
            spin: self.spin + r.spin * h,
            roll: self.roll + r.roll * h,
        }
    }

    /// Fourth-order Runge-Kutta's last stage: from here by the rates of this state and of three stages on the way.
    pub(super) fn summed(&self, k1: &Rates<T>, stages: [(&Self, &Rates<T>); 3], h: T) -> Self {
        let (third, sixth) = (h * (1.0 / 3.0), h * (1.0 / 6.0));
        let [(y2, k2), (y3, k3), (y4, k4)] = stages;
        self.stepped(self, k1, sixth).stepped(y2, k2, third).stepped(y3, k3, third).stepped(y4, k4, sixth)
    }

    /// A constant: its derivatives are zero.
    pub(super) fn constant(k: &Kinematics<f64>) -> Self {
        Kinematics {
            position: Vec2::constant(k.position),
            yaw: T::constant(k.yaw),
            velocity: Vec2::constant(k.velocity),
            spin: T::constant(k.spin),
            roll: Vec2::constant(k.roll),
        }
    }

    /// Whether all derivatives are zero.
    pub(super) fn is_constant(&self) -> bool {
        let Kinematics { position: p, yaw, velocity: v, spin, roll } = self;
        [p.x, p.y, *yaw, v.x, v.y, *spin, roll.x, roll.y].iter().all(|n| n.is_constant())
    }

    /// Between this state at `since` and `to` at `until`: a cubic through places and velocities.
    pub(super) fn between(&self, since: T, to: &Self, until: T, time: f64) -> Self {
        let h = until - since;
        let s = (-since + time) / h;
        let (s2, s3) = (s * s, s * s * s);
        let b1 = s2 * 3.0 - s3 * 2.0;
        let (c0, c1) = ((s - s2 * 2.0 + s3) * h, (s3 - s2) * h);
        let (d1, e0, e1) = ((s - s2) * 6.0 / h, -s * 4.0 + s2 * 3.0 + 1.0, s2 * 3.0 - s * 2.0);
        let place = |x0: T, v0: T, x1: T, v1: T| x0 + b1 * (x1 - x0) + c0 * v0 + c1 * v1;
        let speed = |x0: T, v0: T, x1: T, v1: T| d1 * (x1 - x0) + e0 * v0 + e1 * v1;
        let (x0, v0, x1, v1) = (self.position, self.velocity, to.position, to.velocity);
        Kinematics {
            position: Vec2 { x: place(x0.x, v0.x, x1.x, v1.x), y: place(x0.y, v0.y, x1.y, v1.y) },
            velocity: Vec2 { x: speed(x0.x, v0.x, x1.x, v1.x), y: speed(x0.y, v0.y, x1.y, v1.y) },
            yaw: place(self.yaw, self.spin, to.yaw, to.spin),
            spin: speed(self.yaw, self.spin, to.yaw, to.spin),
            roll: self.roll + (to.roll - self.roll) * s,
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
}

/// Whether a force is too strong for the grip of a ball's foot to keep the ball rolling.
fn tears<T: Scalar>(w: &Wrench<T>) -> bool {
    let grip = w.friction_limit.value();
    grip > 0.0 && 2.0 / 7.0 * w.force.value().norm() > grip
}

#[cfg(test)]
mod tests {
    use crate::num::vec2;
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::{Ending, trace};

    #[test]
    fn a_force_beyond_the_grip_of_its_foot_carries_a_rolling_ball_off_sliding() {
        let (slide, force) = (0.01, 0.6);
        let mut ball = body(0, Shape::Ball { radius: 0.2 }, vec2(0.0, 0.0), vec2(0.5, 0.0));
        ball.start.rolling = true;
        let laws: &[(&str, &[f64])] = &[("ball_spin", &[slide, 0.005]), ("uniform_force", &[force, 0.0])];
        let run = trace(&model(vec![ball.clone()], laws), &seconds(2));
        assert_eq!(run.ending, Ending::Completed);
        let (end, time) =
            (run.states.last().and_then(|row| row[0]).expect("there"), run.times[run.times.len() - 1]);
        let expected = 0.5 + (force / ball.mass - slide * 9.81) * time;
        assert!((end.velocity.x - expected).abs() < 1e-6 * expected, "{} {expected}", end.velocity.x);
    }

    /// Slip closes at 7/2 (mu_slide - mu_roll) g, while the ball slows at mu_slide g.
    #[test]
    fn resistance_to_rolling_hinders_the_turn_of_a_ball_that_slides() {
        let (slide, roll, speed) = (0.15, 0.03, 1.0);
        let ball = body(0, Shape::Ball { radius: 0.2 }, vec2(0.0, 0.0), vec2(speed, 0.0));
        let run = trace(&model(vec![ball], &[("ball_spin", &[slide, roll])]), &seconds(20));
        let until = speed / (3.5 * (slide - roll) * 9.81);
        let rolls = speed - slide * 9.81 * until;
        let frame = (until / 0.04).ceil() as usize + 1;
        let expected = rolls - roll * 9.81 * (run.times[frame] - until);
        let found = run.states[frame][0].expect("there").velocity.x;
        assert!(
            (found - expected).abs() < 0.004 && (found / (5.0 / 7.0) - 1.0).abs() > 0.05,
            "{found} {expected}"
        );
    }

    /// The solution of x' = -(a + b x) x; rolling, the force takes 5/7 of its share and the spin 2/7.
    #[test]
    fn damping_slows_a_spin_and_a_rolling_ball_as_its_equation_says() {
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
        let (ball, square) = (row[0].expect("there"), row[1].expect("there"));
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
