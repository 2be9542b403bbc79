//! Bodies of an island that come to rest, stay at rest or start to move, alone or as a cluster.
//!
//! Lists named `island`, `k`, `w` and `r` have one entry per body of the island: index, state, wrench, acceleration.

use crate::body::Wrench;
use crate::effects::Scalar;
use crate::num::Vec2;
use crate::world::motion::ground_friction::{Mode, ModeChange, REST_SPEED, SETTLING_SPEED};
use crate::world::motion::kinematics::{IslandVec, Kinematics, Rates};
use crate::world::simulation::state::{Simulation, member_state};

impl<T: Scalar> Simulation<'_, T> {
    /// Whether dry friction holds body `j`, with its cluster, against these wrenches.
    pub(in crate::world) fn is_held(
        &self,
        j: usize,
        island: &[usize],
        k: &[Kinematics<T>],
        w: &[Wrench<T>],
    ) -> bool {
        let position = |i: usize| island.iter().position(|&g| g == i);
        let Some(cluster) = self.rigid_cluster(j, |i| member_state(island, k, i)) else {
            return position(j).is_some_and(|x| self.dynamics.friction_holds(j, &w[x]));
        };
        let center = cluster.kinematics.position.value();
        let (mut force, mut torque, mut force_limit, mut torque_limit) = (Vec2::zero(), 0.0, 0.0, 0.0);
        for x in self.bonds.cluster(j).into_iter().flatten().filter_map(|&i| position(i)) {
            let shape = &self.dynamics.shapes[island[x]];
            let (arm, pull) = (k[x].position.value() - center, w[x].force.value());
            force += pull;
            torque += w[x].torque.value() + arm.cross(pull);
            // A ball that cannot roll is held as a box is.
            let (own, reach) = match shape.is_ball() {
                true => (w[x].friction_limit.value().max(w[x].rolling_resistance.value()), 0.0),
                false => (w[x].friction_limit.value(), shape.bounding_radius()),
            };
            force_limit += own;
            torque_limit += own * (arm.norm() + reach) + w[x].spin_friction_limit.value();
        }
        force_limit > 0.0 && force.norm() <= force_limit && torque.abs() <= torque_limit
    }

    /// Sets the modes of an island under these wrenches. A cluster rests as a whole or not at all.
    pub(in crate::world) fn set_modes(&mut self, island: &[usize], k: &[Kinematics<T>], w: &[Wrench<T>]) {
        for (x, &j) in island.iter().enumerate() {
            if self.bonds.cluster(j).is_none() {
                let mode = self.dynamics.mode_under(j, self.bodies[j].mode(), &w[x]);
                self.bodies[j].set_mode(mode);
            }
        }
        for members in self.bonds.clusters_of(island).collect::<Vec<_>>() {
            let resting = members.iter().all(|&x| self.bodies[island[x]].mode() == Mode::Rest);
            let mode = match resting && self.is_held(island[members[0]], island, k, w) {
                true => Mode::Rest,
                false => Mode::Slide,
            };
            members.iter().for_each(|&x| self.bodies[island[x]].set_mode(mode));
        }
    }

    /// Stops slow bodies that friction is about to stop, since contact forces would only make them jitter. `k` takes their new
    /// states. Returns whether there were any.
    pub(in crate::world) fn settle(
        &mut self,
        island: &[usize],
        k: &mut [Kinematics<T>],
        w: &[Wrench<T>],
        r: &[Rates<T>],
    ) -> bool {
        let mut settled = false;
        for (x, &j) in island.iter().enumerate() {
            let moves = self.bodies[j].mode().is_moving();
            let left = match self.bonds.cluster(j) {
                Some(_) => self.cluster_time_to_settle(j, island, k, r),
                None => self.dynamics.time_to_settle(j, &k[x], &r[x]),
            };
            if let Some(left) = left.filter(|_| moves && self.is_held(j, island, k, w)) {
                // The distance up to the stop, at constant deceleration.
                for i in self.bonds.members(j) {
                    let mut state = *self.bodies[i].state();
                    state.position += state.velocity * (left * 0.5);
                    state.yaw += state.spin * left * 0.5;
                    self.bodies[i].set_state(state);
                }
                self.stop(j, self.bodies[j].since().value());
                settled = true;
            }
        }
        if settled {
            island.iter().zip(k).for_each(|(&j, k)| *k = *self.bodies[j].state());
        }
        settled
    }

    /// Lets bodies at rest slide where contacts press them harder than friction can hold, except those in static equilibrium.
    /// Returns whether there were any.
    pub(in crate::world) fn wake(
        &mut self,
        island: &[usize],
        in_equilibrium: &[usize],
        k: &[Kinematics<T>],
        w: &[Wrench<T>],
    ) -> bool {
        let rests = |sim: &Self, j: usize| sim.bodies[j].mode() == Mode::Rest;
        if self.contacts.all().is_empty() || !island.iter().any(|&j| rests(self, j)) {
            return false;
        }
        let mut rates = self.free_rates(island, k, w);
        self.join_clusters(island, k, &mut rates);
        let points = self.solve(island, k, &mut rates);
        let mut pressed: IslandVec<Wrench<T>> = w.into();
        for p in &points {
            let force = p.force();
            for s in p.sides.iter().flatten() {
                pressed[s.at].force += force.scaled(s.sign);
            }
        }
        let mut woken = false;
        for &j in island {
            if rests(self, j) && !in_equilibrium.contains(&j) && !self.is_held(j, island, k, &pressed) {
                for i in self.bonds.members(j) {
                    self.bodies[i].set_mode(Mode::Slide);
                }
                woken = true;
            }
        }
        woken
    }

    /// Mean square speed of the cluster of body `j` (m^2/s^2), rotation included, and half its rate of change.
    fn cluster_speed(&self, j: usize, island: &[usize], k: &[Kinematics<T>], r: &[Rates<T>]) -> (T, T) {
        let (mut energy, mut power, mut mass) = (T::zero(), T::zero(), T::zero());
        let position = |i: &usize| island.iter().position(|g| g == i);
        for x in self.bonds.cluster(j).into_iter().flatten().filter_map(position) {
            let (m, inertia) =
                (self.dynamics.mass[island[x]], T::constant(1.0) / self.dynamics.inverse_inertia[island[x]]);
            energy += k[x].velocity.norm_squared() * m + k[x].spin * k[x].spin * inertia;
            power += k[x].velocity.dot(r[x].velocity) * m + k[x].spin * r[x].spin * inertia;
            mass += m;
        }
        (energy / mass, power / mass)
    }

    /// Time until a slow cluster that decelerates is at rest (s).
    fn cluster_time_to_settle(
        &self,
        j: usize,
        island: &[usize],
        k: &[Kinematics<T>],
        r: &[Rates<T>],
    ) -> Option<T> {
        let (squared, power) = self.cluster_speed(j, island, k, r);
        let slow = squared.value() > 0.0 && squared.value() < SETTLING_SPEED * SETTLING_SPEED;
        (slow && power.value() < 0.0).then(|| -(squared / power))
    }

    /// When friction stops the cluster of body `j` (s), if its deceleration lasts.
    pub(in crate::world) fn cluster_change(
        &self,
        j: usize,
        island: &[usize],
        k: &[Kinematics<T>],
        w: &[Wrench<T>],
        r: &[Rates<T>],
    ) -> Option<(ModeChange, T)> {
        let has_friction =
            |w: &Wrench<T>| w.friction_limit.value() > 0.0 || w.rolling_resistance.value() > 0.0;
        if self.bonds.cluster(j)?[0] != j || !w.iter().any(has_friction) {
            return None;
        }
        let (squared, power) = self.cluster_speed(j, island, k, r);
        if squared.value() <= REST_SPEED * REST_SPEED {
            let pushed = power.value() > 0.0 || squared.value() == 0.0;
            return (!pushed && self.is_held(j, island, k, w)).then(|| (ModeChange::Stop, T::zero()));
        }
        (power.value() < 0.0).then(|| (ModeChange::Stop, -(squared / power)))
    }
}
