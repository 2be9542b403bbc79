//! Jams: bodies that something pulls harder than the ground holds rest all the same where contacts take the rest.

use super::motion::{Kinematics, Mode, Rates, SETTLING_SPEED};
use super::pressure::{PressurePoint, balance};
use super::simulate::{Few, Run};
use crate::body::Wrench;
use crate::effects::Scalar;
use crate::num::Vec2;

/// How often what the ground does not take is shared out anew, and what counts as held after that.
const SHARINGS: usize = 24;
const HELD: f64 = 1.001;

impl<T: Scalar> Run<'_, T> {
    /// Gives the bodies of a group the modes that they have once these forces act. Those that hold each other come to rest,
    /// which are given: friction alone would never stop one, and they would go on by ever smaller steps.
    pub(super) fn jam(&mut self, group: &[usize], k: &mut [Kinematics<T>], w: &[Wrench<T>]) -> Few<usize> {
        let before: Few<Mode> = group.iter().map(|&j| self.bodies[j].mode).collect();
        let jammed = self.jammed(group, k, w);
        self.set_modes(group, k, w);
        for &x in &jammed {
            let j = group[x];
            if before[x] == Mode::Rest {
                self.bodies[j].mode = Mode::Rest;
            } else {
                self.stop(j, self.bodies[j].since.value());
                k[x] = self.bodies[j].from;
            }
        }
        jammed.into_iter().map(|x| group[x]).collect()
    }

    /// Places in the group of bodies that can rest together, though the ground alone does not hold all of them: contacts that
    /// press take of the pulls what they can, and the grip of each body what is left.
    fn jammed(&mut self, group: &[usize], k: &[Kinematics<T>], w: &[Wrench<T>]) -> Few<usize> {
        let place = |body: usize| group.iter().position(|&j| j == body);
        let contacts: Vec<(usize, usize, Option<usize>)> = (self.touching.iter().enumerate())
            .filter_map(|(c, t)| Some((c, place(t.a)?, place(t.b))))
            .collect();
        contacts.iter().for_each(|&(c, ..)| self.touching[c].jams = false);
        let mut held: Few<bool> = group.iter().map(|_| false).collect();
        for &(_, x, y) in &contacts {
            for x in [Some(x), y].into_iter().flatten() {
                held[x] = self.is_slow(group[x], &k[x]);
            }
        }
        // What touches a body that is not held is not held either.
        let spread = |held: &mut Few<bool>| {
            let parted = |held: &Few<bool>| {
                contacts.iter().find_map(|&(_, x, y)| Some((x, y?)).filter(|&(x, y)| held[x] != held[y]))
            };
            while let Some((x, y)) = parted(held) {
                (held[x], held[y]) = (false, false);
            }
        };
        spread(&mut held);
        let pulled = |(x, &j): (usize, &usize)| held[x] && !self.laws.holds(j, &w[x]);
        if !group.iter().enumerate().any(pulled) {
            return Few::new();
        }
        let modes: Few<Mode> = group.iter().map(|&j| self.bodies[j].mode).collect();
        let mut still: Few<Kinematics<T>> = k.into();
        for (x, &j) in group.iter().enumerate().filter(|(x, _)| held[*x]) {
            self.bodies[j].mode = Mode::Slide;
            (still[x].velocity, still[x].spin, still[x].roll) = (Vec2::zero(), T::zero(), Vec2::zero());
        }
        let mut points = self.pressure_points(group, &still);
        points.retain(|p| p.sides.iter().flatten().all(|s| held[s.at]));
        // They stay where they are, however deep.
        points.iter_mut().for_each(|p| p.bias = T::zero());
        group.iter().zip(modes).for_each(|(&j, mode)| self.bodies[j].mode = mode);
        let rest = self.shared_out(group, w, &held, &mut points);
        held.iter_mut().zip(rest).for_each(|(held, rests)| *held &= rests);
        spread(&mut held);
        for p in points.iter().filter(|p| p.force.value() > 0.0) {
            self.touching[p.contact].jams = p.sides.iter().flatten().all(|s| held[s.at]);
        }
        (0..group.len()).filter(|&x| held[x]).collect()
    }

    /// Which of the bodies that may be held rest, and the forces of the points between them. The ground takes of each what it can;
    /// the rest goes through the contacts to others, whose ground may take more (a projected search for the friction that
    /// leaves no acceleration).
    fn shared_out(
        &self,
        group: &[usize],
        w: &[Wrench<T>],
        held: &[bool],
        points: &mut [PressurePoint<T>],
    ) -> Few<bool> {
        let one = T::constant(1.0);
        let mut taken: Few<(Vec2<T>, T)> = group.iter().map(|_| (Vec2::zero(), T::zero())).collect();
        let mut rests: Few<bool> = Few::new();
        for _ in 0..SHARINGS {
            let mut rates: Few<Rates<T>> = group.iter().map(|_| Rates::zero()).collect();
            for (x, &j) in group.iter().enumerate().filter(|(x, _)| held[*x]) {
                rates[x].velocity = (w[x].force - taken[x].0) * self.laws.inverse_mass[j];
                rates[x].spin = (w[x].torque - taken[x].1) * self.laws.inverse_inertia[j];
            }
            balance(points, &mut rates);
            rests.clear();
            for (x, &j) in group.iter().enumerate() {
                let force = rates[x].velocity * (one / self.laws.inverse_mass[j]) + taken[x].0;
                let torque = rates[x].spin * (one / self.laws.inverse_inertia[j]) + taken[x].1;
                let (most, most_torque) = self.laws.hold(j, &w[x]);
                let (asked, turned) = (force.value().norm(), torque.value().abs());
                rests.push(most > 0.0 && asked <= most * HELD && turned <= most_torque * HELD);
                taken[x] = (force.scaled((most / asked).min(1.0)), torque * (most_torque / turned).min(1.0));
            }
            if (0..group.len()).all(|x| !held[x] || rests[x]) {
                break;
            }
        }
        rests
    }

    /// Whether contacts, and not the ground, all but hold a body: no friction ends its motion, and to look for that end would take
    /// ever smaller steps.
    pub(super) fn creeps(&self, j: usize, k: &Kinematics<T>, w: &Wrench<T>) -> bool {
        self.is_slow(j, k) && !self.laws.holds(j, w) && self.touching.iter().any(|t| t.a == j || t.b == j)
    }

    /// Whether a body on its own is so slow that it may as well rest. What friction stops of a ball is not its spin about z.
    fn is_slow(&self, j: usize, k: &Kinematics<T>) -> bool {
        let shape = self.shape(j);
        let spin = if shape.is_ball() { k.roll.value().norm() } else { k.spin.value().abs() };
        let turn = spin * shape.bounding_radius();
        let moves = !matches!(self.bodies[j].mode, Mode::Absent | Mode::Rest);
        let slow = k.velocity.value().norm() + turn < SETTLING_SPEED;
        self.cluster(j).is_none() && self.bodies[j].mode != Mode::Absent && (!moves || slow)
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::Scope;
    use crate::num::vec2;
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::{Ending, Parameter, Prior, SimulationLimits, simulate_observed, trace};

    /// Three balls that glide towards each other.
    fn heap(laws: &[(&str, &[f64])]) -> crate::world::Model {
        let ball = |id: u32| {
            let (sin, cos) = (2.1 * f64::from(id)).sin_cos();
            let mut ball =
                body(id, Shape::Ball { radius: 0.2 }, vec2(0.5 * cos, 0.5 * sin), vec2(-0.2 * cos, 0.1));
            ball.start.state.spin = 0.5;
            ball
        };
        let common: [(&str, &[f64]); 2] = [("restitution", &[0.6, 1.0]), ("gliding_friction", &[0.02, 0.02])];
        model((0..3).map(ball).collect(), &[&common[..], laws].concat())
    }

    #[test]
    fn bodies_that_pull_each_other_harder_than_the_ground_holds_come_to_rest_in_a_heap() {
        let m = heap(&[("pair_attraction", &[0.3, 0.3])]);
        let run = simulate_observed(&m, &m.flatten(), &seconds(150), &SimulationLimits::default());
        assert_eq!(run.ending, Ending::Completed);
        assert!(run.steps < 1500, "{} steps", run.steps);
        let last = trace(&m, &seconds(150)).states.remove(150);
        for state in last.iter().flatten() {
            assert_eq!(state.velocity, vec2(0.0, 0.0), "{last:?}");
        }
        let apart = |a: usize, b: usize| {
            let at = |k: usize| last[k].expect("it is there").position;
            (at(a) - at(b)).norm()
        };
        for (a, b) in [(0, 1), (1, 2), (0, 2)] {
            assert!(apart(a, b) > 0.4 - 1e-3, "{a} {b}: {}", apart(a, b));
        }
    }

    #[test]
    fn one_that_the_ground_does_not_hold_leans_on_one_that_it_does() {
        let disc = |id: u32, x: f64| body(id, Shape::Disc { radius: 0.2 }, vec2(x, 0.0), vec2(0.0, 0.0));
        let mut m = model(
            vec![disc(0, -0.45), disc(1, 0.0)],
            &[("restitution", &[0.3, 1.0]), ("gliding_friction", &[0.02, 0.02]), ("tilt", &[0.3, 0.0])],
        );
        m.bodies[1].material = "rough".into();
        let sliding = &mut m.effects[1].parameters[0];
        *sliding = Parameter::new("sliding", Scope::Material, Prior { mean: 0.02, sd: 0.0 }, &m.bodies);
        assert_eq!(sliding.labels, ["m", "rough"]);
        sliding.values[1] = 0.06;
        let run = simulate_observed(&m, &m.flatten(), &seconds(200), &SimulationLimits::default());
        assert_eq!(run.ending, Ending::Completed);
        assert!(run.steps < 1500, "{} steps", run.steps);
        let last = trace(&m, &seconds(200)).states.remove(200);
        let at = |k: usize| last[k].expect("it is there");
        assert!(at(1).position.x - at(0).position.x < 0.4 + 1e-3, "{last:?}");
        assert_eq!([at(0).velocity, at(1).velocity], [vec2(0.0, 0.0); 2], "{last:?}");
    }

    #[test]
    fn a_heap_that_slides_off_is_no_jam() {
        // The ground holds 0.2 m/s^2.
        let m = heap(&[("pair_attraction", &[0.3, 0.3]), ("tilt", &[0.5, 0.0])]);
        let last = trace(&m, &seconds(150)).states.remove(150);
        assert!(last.iter().flatten().all(|s| s.velocity.x > 0.5), "{last:?}");
    }
}
