//! Motion of islands between events: one Runge-Kutta segment to the end of the step, the next change of mode, or the next
//! solution of the contact forces.
//!
//! A free body follows [`Dynamics::segment`](crate::world::motion::dynamics::Dynamics). Bodies of an island are integrated
//! together; each stage solves the contact forces again. Segments of an island are limited to [`CONTACT_STEP`] with contacts, to
//! [`PULL_STEP`] with contacts and pair forces, and by the error of the last segment with pair forces alone. One in which friction
//! turns a ball too unevenly for its record ([`roll_error`]) is halved.
//!
//! Lists named `island`, `k`, `w` and `start` have one entry per body of the island: index, state, wrench, state.

use crate::body::Wrench;
use crate::effects::Scalar;
use crate::num::Vec2;
use crate::world::motion::ground_friction::{Mode, ModeChange};
use crate::world::motion::kinematics::{IslandVec, Kinematics, Rates, linearity_error, roll_error};
use crate::world::motion::segment::{
    APPROACH_SHARE, INSTANT, LINEARITY_TOLERANCE, SHORTEST_APPROACH, SHORTEST_SEGMENT, Segment,
};
use crate::world::simulation::state::{MAX_STEP, Simulation, member_state};

/// Longest segment of bodies in contact (s).
const CONTACT_STEP: f64 = 0.04;
/// The same with pair forces or bonds, or where a pair force may wake a body at rest (s).
const PULL_STEP: f64 = 0.02;
/// Safety factor of the length of the next segment.
const SAFETY: f64 = 0.9;
/// Overlap, and [`roll_error`] of a surface, at which a segment of touching bodies is halved (m).
const MAX_OVERLAP: f64 = 1e-4;

/// Errors of a segment (m), of the body where they are largest.
#[derive(Default)]
struct SegmentErrors {
    linearity: f64,
    roll: f64,
}

/// Where the segment of an island ends.
struct IslandSegment<T> {
    end: IslandVec<Kinematics<T>>,
    /// s.
    end_time: T,
    /// At the end, of which body.
    change: Option<(usize, ModeChange)>,
}

impl<T: Scalar> Simulation<'_, T> {
    /// Computes the segment of each island among these bodies.
    pub(in crate::world) fn predict_all(&mut self, bodies: &[usize]) {
        for &j in bodies {
            if self.islands.of(j)[0] == j {
                self.predict(j);
            }
        }
    }

    /// Computes the segment of the island of `i`.
    pub(in crate::world) fn predict(&mut self, i: usize) {
        if self.is_free(i) {
            return self.predict_free(i);
        }
        let island: IslandVec<usize> = self.islands.of(i).into();
        let mut start: IslandVec<Kinematics<T>> = island.iter().map(|&j| *self.bodies[j].state()).collect();
        let since = self.bodies[i].since();
        let end_time = T::constant(self.step_end);
        let w = self.wrenches(&island, &start, since);
        let in_equilibrium = self.apply_static_equilibrium(&island, &mut start, &w);
        let awake = island.iter().any(|&j| self.bodies[j].mode().is_moving());
        let segment = match awake && (end_time - since).value() > 0.0 {
            true => {
                let first = self.first_rates(&island, &mut start, &w, &in_equilibrium);
                self.island_segment(i, &island, &start, &w, &first)
            }
            false => IslandSegment { end: start, end_time, change: None },
        };
        for (x, &j) in island.iter().enumerate() {
            let shape = self.dynamics.shapes[j];
            let change = segment.change.filter(|c| c.0 == j).map(|c| c.1);
            self.bodies[j].set_time(since);
            self.bodies[j].set_segment(shape, segment.end[x], segment.end_time, change);
        }
    }

    fn predict_free(&mut self, i: usize) {
        let start = self.bodies[i].segment_start(i);
        let segment = match self.without_derivatives(i) {
            Some(dynamics) => {
                let found = dynamics.segment(&start.value(), self.step_end);
                let (end, end_time) = (Kinematics::constant(&found.end), T::constant(found.end_time));
                Segment { mode: found.mode, end, end_time, change: found.change }
            }
            None => self.dynamics.segment(&start, self.step_end),
        };
        let shape = self.dynamics.shapes[i];
        let body = &mut self.bodies[i];
        body.set_mode(segment.mode);
        body.set_segment(shape, segment.end, segment.end_time, segment.change);
    }

    /// Accelerations at the start of a segment, once bodies have settled or woken. `start` takes the states of settled bodies.
    fn first_rates(
        &mut self,
        island: &[usize],
        start: &mut [Kinematics<T>],
        w: &[Wrench<T>],
        in_equilibrium: &[usize],
    ) -> IslandVec<Rates<T>> {
        let first = self.rates(island, start, w, true);
        let settled = self.settle(island, start, w, &first);
        match self.wake(island, in_equilibrium, start, w) || settled {
            true => self.rates(island, start, w, true),
            false => first,
        }
    }

    /// The segment of the island of `i` from these states and accelerations.
    fn island_segment(
        &mut self,
        i: usize,
        island: &[usize],
        start: &[Kinematics<T>],
        w: &[Wrench<T>],
        first: &[Rates<T>],
    ) -> IslandSegment<T> {
        let since = self.bodies[i].since();
        let (mut end_time, mut change) = self.next_island_change(since, island, start, w, first);
        let left = (end_time - since).value();
        if change.is_some() && left > SHORTEST_APPROACH {
            end_time = since + (end_time - since) * APPROACH_SHARE;
            change = Some((i, ModeChange::Continue));
        }
        let pulls = self.dynamics.has_pair_forces();
        let rests = island.iter().any(|&j| self.bodies[j].mode() == Mode::Rest);
        let smooth = pulls && self.bonds.is_empty() && !self.contacts.any_within(island) && !rests;
        let longest = match smooth {
            true => self.segment_length,
            false if pulls || !self.bonds.is_empty() => PULL_STEP,
            false => CONTACT_STEP,
        };
        if left > longest + INSTANT {
            end_time = since + longest;
            change = Some((i, ModeChange::Continue));
        }
        loop {
            let midpoint = change.is_some_and(|c| c.1.ends_friction());
            let h = end_time - since;
            let (end, errors) = self.integrate(island, start, first, since, h, midpoint);
            // The error grows with the fourth power of the time.
            let share = match smooth {
                true => SAFETY * (LINEARITY_TOLERANCE / errors.linearity).sqrt().sqrt(),
                false => f64::INFINITY,
            };
            self.segment_length = (h.value() * share).clamp(SHORTEST_SEGMENT, MAX_STEP);
            let too_long = share < SAFETY;
            let is_accurate = !too_long && errors.roll <= MAX_OVERLAP;
            if h.value() <= SHORTEST_SEGMENT
                || (is_accurate && self.narrowest_gap(island, &end) > -MAX_OVERLAP)
            {
                return IslandSegment { end, end_time, change };
            }
            // A force or a roll changes too much, or another corner would overlap: end the segment earlier.
            end_time = since + h * if too_long { share } else { 0.5 };
            change = Some((i, ModeChange::Continue));
        }
    }

    /// The first change of mode in the island, and its time; without one the end of the step (s).
    fn next_island_change(
        &self,
        since: T,
        island: &[usize],
        start: &[Kinematics<T>],
        w: &[Wrench<T>],
        first: &[Rates<T>],
    ) -> (T, Option<(usize, ModeChange)>) {
        let (mut end_time, mut change) = (T::constant(self.step_end), None);
        for (x, &j) in island.iter().enumerate() {
            let mode = self.bodies[j].mode();
            let next = match self.bonds.cluster(j) {
                Some(_) => self.cluster_change(j, island, start, w, first),
                None => self.dynamics.next_change(j, &start[x], mode, &w[x], &first[x]),
            };
            if let Some((kind, after)) = next
                && !(kind == ModeChange::Stop && self.is_quasi_static(j, &start[x], &w[x]))
                && mode.is_moving()
                && (since + after).value() < end_time.value()
            {
                end_time = since + after;
                change = Some((j, kind));
            }
        }
        (end_time, change)
    }

    /// The classical fourth-order Runge-Kutta method over `h` (s), or the midpoint rule on the way to a change of mode, which
    /// never evaluates friction at the end, where it has no direction.
    fn integrate(
        &mut self,
        island: &[usize],
        start: &[Kinematics<T>],
        k1: &[Rates<T>],
        since: T,
        h: T,
        midpoint: bool,
    ) -> (IslandVec<Kinematics<T>>, SegmentErrors) {
        let half = h * 0.5;
        let stage = |from: &[Kinematics<T>], rates: &[Rates<T>], h: T| -> IslandVec<Kinematics<T>> {
            start.iter().zip(from).zip(rates).map(|((s, k), r)| s.stepped(k, r, h)).collect()
        };
        let y2 = stage(start, k1, half);
        let k2 = self.rates_at(island, &y2, since + half);
        if midpoint {
            let mut end = stage(&y2, &k2, h);
            self.restore_clusters(island, start, &mut end);
            return (end, SegmentErrors::default());
        }
        let y3 = stage(&y2, &k2, half);
        let k3 = self.rates_at(island, &y3, since + half);
        let y4 = stage(&y3, &k3, h);
        let k4 = self.rates_at(island, &y4, since + h);
        let stages = |x: usize| [(&y2[x], &k2[x]), (&y3[x], &k3[x]), (&y4[x], &k4[x])];
        let mut end =
            (0..island.len()).map(|x| start[x].summed(&k1[x], stages(x), h)).collect::<IslandVec<_>>();
        self.restore_clusters(island, start, &mut end);
        let mut errors = SegmentErrors::default();
        for (x, &j) in island.iter().enumerate() {
            let linearity = linearity_error([&k1[x], &k2[x], &k3[x], &k4[x]], h.value());
            let roll = roll_error(&k1[x], &k4[x], h.value()) * self.dynamics.shapes[j].bounding_radius();
            errors =
                SegmentErrors { linearity: errors.linearity.max(linearity), roll: errors.roll.max(roll) };
        }
        (end, errors)
    }

    /// Moves the bodies of each cluster as one rigid body, which removes rounding errors of their distances.
    fn restore_clusters(&self, island: &[usize], start: &[Kinematics<T>], end: &mut [Kinematics<T>]) {
        for members in self.bonds.clusters_of(island) {
            let first = members[0];
            let before = self.rigid_cluster(island[first], |j| member_state(island, start, j));
            let after = self.rigid_cluster(island[first], |j| member_state(island, end, j));
            let (Some(before), Some(mut after)) = (before, after) else { continue };
            if self.bodies[island[first]].mode() == Mode::Rest {
                continue;
            }
            after.kinematics.spin = end[first].spin;
            let angle = end[first].yaw - start[first].yaw;
            let turn = Vec2::from_angle(angle);
            for &x in &members {
                let arm = start[x].position - before.kinematics.position;
                end[x].position = after.kinematics.position + arm.rotated(turn);
                end[x].yaw = start[x].yaw + angle;
                after.carry(&mut end[x]);
            }
        }
    }

    /// The wrenches of all forces but those of contacts.
    pub(in crate::world) fn wrenches(
        &self,
        island: &[usize],
        k: &[Kinematics<T>],
        time: T,
    ) -> IslandVec<Wrench<T>> {
        let mut out: IslandVec<Wrench<T>> =
            island.iter().zip(k).map(|(&j, k)| self.dynamics.wrench(j, k, time)).collect();
        if self.dynamics.has_pair_forces() {
            self.dynamics.add_pair_forces(island, k, &mut out);
        }
        out
    }

    fn rates_at(&mut self, island: &[usize], k: &[Kinematics<T>], time: T) -> IslandVec<Rates<T>> {
        let w = self.wrenches(island, k, time);
        self.rates(island, k, &w, false)
    }

    /// Moves the island of `i` to `time` (s) within its segment.
    fn move_island(&mut self, i: usize, time: T) {
        let body = &self.bodies[i];
        let (start, change) = (body.segment_start(i), body.change());
        let since = start.time;
        let h = time - since;
        if h.value() <= 0.0 && !h.is_constant() {
            // Only the derivatives move.
            self.shift_island(i, h);
        } else if self.is_free(i) {
            let state = match self.without_derivatives(i).filter(|_| time.is_constant()) {
                Some(dynamics) => {
                    Kinematics::constant(&dynamics.state_at(&start.value(), time.value(), change))
                }
                None => self.dynamics.state_at(&start, time, change),
            };
            self.bodies[i].set_state(state);
        } else if h.value() > 0.0 {
            let island: IslandVec<usize> = self.islands.of(i).into();
            let start: IslandVec<Kinematics<T>> = island.iter().map(|&j| *self.bodies[j].state()).collect();
            if island.iter().any(|&j| self.bodies[j].mode().is_moving()) {
                let ends = |&j: &usize| self.bodies[j].change().is_some_and(ModeChange::ends_friction);
                let midpoint = island.iter().any(ends);
                let first = self.rates_at(&island, &start, since);
                let (end, _) = self.integrate(&island, &start, &first, since, h, midpoint);
                for (x, &j) in island.iter().enumerate() {
                    self.bodies[j].set_state(end[x]);
                }
            }
        }
        for &j in self.islands.of(i) {
            self.bodies[j].arrive_at(time);
        }
    }

    /// Moves the island of `i` by an infinitesimal time (s): values stay, derivatives change.
    fn shift_island(&mut self, i: usize, by: T) {
        let island: IslandVec<usize> = self.islands.of(i).into();
        let k: IslandVec<Kinematics<T>> = island.iter().map(|&j| *self.bodies[j].state()).collect();
        let time = self.bodies[i].since();
        // The next solution of the contact forces must start the same with and without derivatives.
        let contacts = self.contacts.all().to_vec();
        let rates = self.rates_at(&island, &k, time);
        self.contacts.restore(contacts);
        for (x, &j) in island.iter().enumerate() {
            let body = &mut self.bodies[j];
            if body.mode().is_moving() {
                body.set_state(k[x].stepped(&k[x], &rates[x], by));
            }
            body.set_time(body.since() + by);
        }
    }

    /// Moves the islands of `a` and `b` to `time` (s).
    pub(in crate::world) fn move_both(&mut self, a: usize, b: usize, time: T) {
        self.move_island(a, time);
        if b < self.bodies.len() && !self.islands.same(a, b) {
            self.move_island(b, time);
        }
    }

    /// Moves the islands of `a` and `b` by an infinitesimal time (s).
    pub(in crate::world) fn shift_both(&mut self, a: usize, b: usize, by: T) {
        self.shift_island(a, by);
        if b < self.bodies.len() && !self.islands.same(a, b) {
            self.shift_island(b, by);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::formula::Formula;
    use crate::num::vec2;
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::{ActiveEffect, Ending, State, trace};

    #[test]
    fn a_formula_without_a_value_ends_the_simulation_of_bodies_with_pair_forces() {
        let disc = Shape::Disc { radius: 0.05 };
        let bodies = vec![
            body(0, disc, vec2(-1.0, 0.0), vec2(0.6, 0.0)),
            body(1, disc, vec2(1.0, 0.25), vec2(0.0, 0.0)),
        ];
        let mut model = model(bodies, &[("pair_attraction", &[0.1, 0.05])]);
        let formula = Formula::new("ax = sqrt(0.5 - t)", vec![]).expect("a formula");
        model.effects.push(ActiveEffect::of_formula("root", formula, &model.bodies).expect("a formula"));
        assert_eq!(trace(&model, &seconds(100)).ending, Ending::FormulaUndefined);
    }

    /// Two discs swing past each other without friction: energy is conserved whatever the length of the segments.
    #[test]
    fn bodies_with_pair_forces_conserve_energy() {
        let (strength, eps) = (0.1, 0.05);
        let disc = Shape::Disc { radius: 0.05 };
        let bodies = vec![
            body(0, disc, vec2(-1.0, 0.0), vec2(0.6, 0.0)),
            body(1, disc, vec2(1.0, 0.25), vec2(-0.6, 0.0)),
        ];
        let mass = bodies[0].mass;
        let run = trace(&model(bodies, &[("pair_attraction", &[strength, eps])]), &seconds(100));
        let energy = |row: &[Option<State>]| {
            let [a, b] = [0, 1].map(|k| row[k].expect("present"));
            let moving = 0.5 * mass * (a.velocity.norm_squared() + b.velocity.norm_squared());
            moving - strength / ((a.position - b.position).norm_squared() + eps * eps).sqrt()
        };
        let first = energy(&run.states[0]);
        let nearest = |row: &Vec<Option<State>>| {
            (row[0].expect("present").position - row[1].expect("present").position).norm()
        };
        let passed = run.states.iter().map(nearest).fold(f64::INFINITY, f64::min);
        assert!((0.1..0.25).contains(&passed), "they pass near each other, {passed} m");
        for row in &run.states {
            assert!((energy(row) - first).abs() < 1e-4 * strength / passed, "{} {first}", energy(row));
        }
    }
}
