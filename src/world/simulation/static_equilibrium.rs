//! Static equilibrium: bodies may rest although the load exceeds ground friction, if contacts carry the difference.
//!
//! Bodies at rest in contact are in equilibrium if ground friction forces `f_i` (N) and torques `t_i` (N m) within their limits, and
//! contact forces that only press, with Coulomb friction, balance the loads of all of them. The search is a fixed-point
//! iteration: solve the contacts under the load that friction leaves; add the acceleration that remains to the friction of each
//! body, and project it onto its limits ([`Simulation::project_friction`]). It ends when no load exceeds its limit by more than
//! 0.1 %. Friction alone would never stop such bodies: their segments would become ever shorter.

use crate::body::Wrench;
use crate::effects::Scalar;
use crate::num::Vec2;
use crate::world::contact::contact_solver::{ContactPoint, solve_contacts};
use crate::world::motion::ground_friction::{Mode, SETTLING_SPEED};
use crate::world::motion::kinematics::{IslandVec, Kinematics, Rates};
use crate::world::simulation::state::Simulation;

/// Largest number of projections, and the share of its limit up to which a load counts as held.
const PROJECTIONS: usize = 24;
const HELD: f64 = 1.001;

/// A persistent contact and the positions of its bodies in the island; `None`: a wall.
type IslandContact = (usize, usize, Option<usize>);

/// What touches a body that is not held is not held either.
fn release_neighbours(held: &mut [bool], contacts: &[IslandContact]) {
    let next = |held: &[bool]| {
        contacts.iter().find_map(|&(_, x, y)| Some((x, y?)).filter(|&(x, y)| held[x] != held[y]))
    };
    while let Some((x, y)) = next(held) {
        (held[x], held[y]) = (false, false);
    }
}

impl<T: Scalar> Simulation<'_, T> {
    /// Sets the modes of an island under these wrenches, and stops the bodies in static equilibrium, which are returned. `k`
    /// takes their new states.
    pub(in crate::world) fn apply_static_equilibrium(
        &mut self,
        island: &[usize],
        k: &mut [Kinematics<T>],
        w: &[Wrench<T>],
    ) -> IslandVec<usize> {
        let before: IslandVec<Mode> = island.iter().map(|&j| self.bodies[j].mode()).collect();
        let held = self.in_equilibrium(island, k, w);
        self.set_modes(island, k, w);
        for &x in &held {
            let j = island[x];
            if before[x] == Mode::Rest {
                self.bodies[j].set_mode(Mode::Rest);
            } else {
                self.stop(j, self.bodies[j].since().value());
                k[x] = *self.bodies[j].state();
            }
        }
        held.into_iter().map(|x| island[x]).collect()
    }

    /// Positions in the island of bodies that rest together although ground friction alone does not hold all of them.
    fn in_equilibrium(&mut self, island: &[usize], k: &[Kinematics<T>], w: &[Wrench<T>]) -> IslandVec<usize> {
        let position = |body: usize| island.iter().position(|&j| j == body);
        let contacts: Vec<IslandContact> = (self.contacts.all().iter().enumerate())
            .filter_map(|(c, contact)| Some((c, position(contact.a)?, position(contact.b))))
            .collect();
        contacts.iter().for_each(|&(c, ..)| self.contacts.set_in_equilibrium(c, false));
        let mut held: IslandVec<bool> = island.iter().map(|_| false).collect();
        for &(_, x, y) in &contacts {
            for x in [Some(x), y].into_iter().flatten() {
                held[x] = self.is_slow(island[x], &k[x]);
            }
        }
        release_neighbours(&mut held, &contacts);
        let overloaded = |(x, &j): (usize, &usize)| held[x] && !self.dynamics.friction_holds(j, &w[x]);
        if !island.iter().enumerate().any(overloaded) {
            return IslandVec::new();
        }
        let mut points = self.points_at_rest(island, k, &held);
        let rest = self.project_friction(island, w, &held, &mut points);
        held.iter_mut().zip(rest).for_each(|(held, rests)| *held &= rests);
        release_neighbours(&mut held, &contacts);
        for p in points.iter().filter(|p| p.normal_force.value() > 0.0) {
            self.contacts.set_in_equilibrium(p.contact, p.sides.iter().flatten().all(|s| held[s.at]));
        }
        (0..island.len()).filter(|&x| held[x]).collect()
    }

    /// Contact points between the held bodies, as if these slid with zero velocity; their gaps stay as they are.
    fn points_at_rest(
        &mut self,
        island: &[usize],
        k: &[Kinematics<T>],
        held: &[bool],
    ) -> Vec<ContactPoint<T>> {
        let modes: IslandVec<Mode> = island.iter().map(|&j| self.bodies[j].mode()).collect();
        let mut still: IslandVec<Kinematics<T>> = k.into();
        for (x, &j) in island.iter().enumerate().filter(|(x, _)| held[*x]) {
            self.bodies[j].set_mode(Mode::Slide);
            (still[x].velocity, still[x].spin, still[x].roll) = (Vec2::zero(), T::zero(), Vec2::zero());
        }
        let mut points = self.contact_points(island, &still);
        points.retain(|p| p.sides.iter().flatten().all(|s| held[s.at]));
        points.iter_mut().for_each(|p| p.bias = T::zero());
        island.iter().zip(modes).for_each(|(&j, mode)| self.bodies[j].set_mode(mode));
        points
    }

    /// Which of the held bodies rest, and the forces of the points between them. Ground friction takes of each load what it can;
    /// the rest passes through the contacts to other bodies, whose friction may take more.
    fn project_friction(
        &self,
        island: &[usize],
        w: &[Wrench<T>],
        held: &[bool],
        points: &mut [ContactPoint<T>],
    ) -> IslandVec<bool> {
        let one = T::constant(1.0);
        let mut taken: IslandVec<(Vec2<T>, T)> = island.iter().map(|_| (Vec2::zero(), T::zero())).collect();
        let mut rests: IslandVec<bool> = IslandVec::new();
        for _ in 0..PROJECTIONS {
            let mut rates: IslandVec<Rates<T>> = island.iter().map(|_| Rates::zero()).collect();
            for (x, &j) in island.iter().enumerate().filter(|(x, _)| held[*x]) {
                rates[x].velocity = (w[x].force - taken[x].0) * self.dynamics.inverse_mass[j];
                rates[x].spin = (w[x].torque - taken[x].1) * self.dynamics.inverse_inertia[j];
            }
            solve_contacts(points, &mut rates);
            rests.clear();
            for (x, &j) in island.iter().enumerate() {
                let force = rates[x].velocity * (one / self.dynamics.inverse_mass[j]) + taken[x].0;
                let torque = rates[x].spin * (one / self.dynamics.inverse_inertia[j]) + taken[x].1;
                let (most, most_torque) = self.dynamics.static_limits(j, &w[x]);
                let (load, load_torque) = (force.value().norm(), torque.value().abs());
                rests.push(most > 0.0 && load <= most * HELD && load_torque <= most_torque * HELD);
                taken[x] =
                    (force.scaled((most / load).min(1.0)), torque * (most_torque / load_torque).min(1.0));
            }
            if (0..island.len()).all(|x| !held[x] || rests[x]) {
                break;
            }
        }
        rests
    }

    /// Whether contacts, and not the ground, nearly hold a body: no friction ends its motion, so its stop is not searched for.
    pub(in crate::world) fn is_quasi_static(&self, j: usize, k: &Kinematics<T>, w: &Wrench<T>) -> bool {
        self.is_slow(j, k) && !self.dynamics.friction_holds(j, w) && self.contacts.any_of(j)
    }

    /// Whether a body without cluster is slow enough to rest. Friction does not stop the spin of a ball about z.
    fn is_slow(&self, j: usize, k: &Kinematics<T>) -> bool {
        let (shape, mode) = (self.shape(j), self.bodies[j].mode());
        let spin = if shape.is_ball() { k.roll.value().norm() } else { k.spin.value().abs() };
        let turn = spin * shape.bounding_radius();
        let slow = k.velocity.value().norm() + turn < SETTLING_SPEED;
        self.bonds.cluster(j).is_none() && mode != Mode::Absent && (!mode.is_moving() || slow)
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
    fn three_balls(laws: &[(&str, &[f64])]) -> crate::world::Model {
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
    fn bodies_that_attract_each_other_more_than_friction_holds_come_to_rest_in_contact() {
        let m = three_balls(&[("pair_attraction", &[0.3, 0.3])]);
        let run = simulate_observed(&m, &m.flatten(), &seconds(150), &SimulationLimits::default());
        assert_eq!(run.ending, Ending::Completed);
        assert!(run.steps < 1500, "{} steps", run.steps);
        let last = trace(&m, &seconds(150)).states.remove(150);
        for state in last.iter().flatten() {
            assert_eq!(state.velocity, vec2(0.0, 0.0), "{last:?}");
        }
        let apart = |a: usize, b: usize| {
            let at = |k: usize| last[k].expect("present").position;
            (at(a) - at(b)).norm()
        };
        for (a, b) in [(0, 1), (1, 2), (0, 2)] {
            assert!(apart(a, b) > 0.4 - 1e-3, "{a} {b}: {}", apart(a, b));
        }
    }

    #[test]
    fn a_body_that_friction_does_not_hold_rests_against_one_that_it_does() {
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
        let at = |k: usize| last[k].expect("present");
        assert!(at(1).position.x - at(0).position.x < 0.4 + 1e-3, "{last:?}");
        assert_eq!([at(0).velocity, at(1).velocity], [vec2(0.0, 0.0); 2], "{last:?}");
    }

    #[test]
    fn bodies_that_slide_together_are_not_in_equilibrium() {
        // The ground holds 0.2 m/s^2.
        let m = three_balls(&[("pair_attraction", &[0.3, 0.3]), ("tilt", &[0.5, 0.0])]);
        let last = trace(&m, &seconds(150)).states.remove(150);
        assert!(last.iter().flatten().all(|s| s.velocity.x > 0.5), "{last:?}");
    }
}
