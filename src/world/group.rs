//! Undisturbed motion of bodies that contacts, bonds or forces join: one stretch of Runge-Kutta to the end of the step, the next
//! change of mode or the next look at how they press.

use super::flight::{APPROACH_SHARE, INSTANT, ROUGH, SHORTEST_APPROACH, SHORTEST_STRETCH, bend};
use super::impact::Path;
use super::motion::{Change, Kinematics, Mode, Rates};
use super::simulate::{Few, MAX_STEP, Run};
use crate::body::Wrench;
use crate::effects::Scalar;

/// Longest stretch of bodies that press on each other, and of such that pull at each other, too, or at one that may wake (s).
const CONTACT_STEP: f64 = 0.04;
const PULL_STEP: f64 = 0.02;
/// Share of the longest even stretch that the next one is given.
const EVEN: f64 = 0.9;
/// Overlap at which a stretch of touching bodies is halved (m).
const CUT_IN: f64 = 1e-4;

impl<T: Scalar> Run<'_, T> {
    /// The undisturbed motion of the group of `i` to the end of the step, or to its next change of mode.
    pub(super) fn predict(&mut self, i: usize) {
        if self.is_alone(i) {
            return self.fly(i);
        }
        let group = std::mem::take(&mut self.bodies[i].group);
        let mut start: Few<Kinematics<T>> = group.iter().map(|&j| self.bodies[j].from).collect();
        let since = self.bodies[i].since;
        let h = T::constant(self.step_end) - since;
        let awake =
            |run: &Self| group.iter().any(|&j| matches!(run.bodies[j].mode, Mode::Slide | Mode::Roll));
        let wrenches = self.wrenches(&group, &start, since);
        let jammed = self.jam(&group, &mut start, &wrenches);
        let mut end = start.clone();
        let mut until = T::constant(self.step_end);
        let mut change = None;
        if awake(self) && h.value() > 0.0 {
            let mut first = self.rates(&group, &start, &wrenches, true);
            let settled = self.settle(&group, &mut start, &wrenches, &first);
            if self.wake(&group, &jammed, &start, &wrenches) || settled {
                first = self.rates(&group, &start, &wrenches, true);
            }
            for (x, &j) in group.iter().enumerate() {
                let next = match self.cluster(j) {
                    Some(_) => self.cluster_change(j, &group, &start, &wrenches, &first),
                    None => self.laws.next_change(j, &start[x], self.bodies[j].mode, &wrenches[x], &first[x]),
                };
                if let Some((kind, after)) = next
                    && !(kind == Change::Stop && self.creeps(j, &start[x], &wrenches[x]))
                    && matches!(self.bodies[j].mode, Mode::Slide | Mode::Roll)
                    && (since + after).value() < until.value()
                {
                    until = since + after;
                    change = Some((j, kind));
                }
            }
            let left = (until - since).value();
            if change.is_some() && left > SHORTEST_APPROACH {
                until = since + (until - since) * APPROACH_SHARE;
                change = Some((i, Change::Continue));
            }
            let pulls = self.laws.has_pair_forces();
            let rests = group.iter().any(|&j| self.bodies[j].mode == Mode::Rest);
            let touches = self.touching.iter().any(|t| group.contains(&t.a));
            let smooth = pulls && self.bonds.is_empty() && !touches && !rests;
            let longest = match smooth {
                true => self.stretch,
                false if pulls || !self.bonds.is_empty() => PULL_STEP,
                false => CONTACT_STEP,
            };
            if left > longest + INSTANT {
                until = since + longest;
                change = Some((i, Change::Continue));
            }
            loop {
                let midpoint = change.is_some_and(|c| c.1 != Change::Continue);
                let h = until - since;
                let unevenness;
                (end, unevenness) = self.integrate(&group, &start, &first, since, h, midpoint);
                // Unevenness grows with the fourth power of the time.
                let share = if smooth { EVEN * (ROUGH / unevenness).sqrt().sqrt() } else { f64::INFINITY };
                self.stretch = (h.value() * share).clamp(SHORTEST_STRETCH, MAX_STEP);
                let rough = share < EVEN;
                if h.value() <= SHORTEST_STRETCH || (!rough && self.narrowest(&group, &end) > -CUT_IN) {
                    break;
                }
                // Another corner cuts in, or the pull changes too much: look again before it does.
                until = since + h * if rough { share } else { 0.5 };
                change = Some((i, Change::Continue));
            }
        }
        for (x, &j) in group.iter().enumerate() {
            let shape = self.laws.shapes[j];
            let body = &mut self.bodies[j];
            body.since = since;
            body.until = until;
            body.to = end[x];
            body.change = change.filter(|c| c.0 == j).map(|c| c.1);
            body.path = Path::new(shape, since.value(), until.value(), body.from.value(), body.to.value());
        }
        self.bodies[i].group = group;
    }

    /// Fourth-order Runge-Kutta, or the midpoint rule on the way to a change of mode: friction has no
    /// direction at its end, and the midpoint never looks there. Also how far positions would be off had the accelerations
    /// been linear (m).
    pub(super) fn integrate(
        &mut self,
        group: &[usize],
        start: &[Kinematics<T>],
        k1: &[Rates<T>],
        since: T,
        h: T,
        midpoint: bool,
    ) -> (Few<Kinematics<T>>, f64) {
        let half = h * 0.5;
        let stage = |from: &[Kinematics<T>], rates: &[Rates<T>], h: T| -> Few<Kinematics<T>> {
            start.iter().zip(from).zip(rates).map(|((s, k), r)| s.stepped(k, r, h)).collect()
        };
        let y2 = stage(start, k1, half);
        let k2 = self.rates_at(group, &y2, since + half);
        if midpoint {
            let mut end = stage(&y2, &k2, h);
            self.assemble(group, start, &mut end);
            return (end, 0.0);
        }
        let y3 = stage(&y2, &k2, half);
        let k3 = self.rates_at(group, &y3, since + half);
        let y4 = stage(&y3, &k3, h);
        let k4 = self.rates_at(group, &y4, since + h);
        let stages = |x: usize| [(&y2[x], &k2[x]), (&y3[x], &k3[x]), (&y4[x], &k4[x])];
        let mut end = (0..group.len()).map(|x| start[x].summed(&k1[x], stages(x), h)).collect::<Few<_>>();
        self.assemble(group, start, &mut end);
        let bend = |x: usize| bend([&k1[x], &k2[x], &k3[x], &k4[x]], h.value());
        (end, (0..group.len()).map(bend).fold(0.0, f64::max))
    }

    pub(super) fn wrenches(&self, group: &[usize], k: &[Kinematics<T>], time: T) -> Few<Wrench<T>> {
        let mut out: Few<Wrench<T>> =
            group.iter().zip(k).map(|(&j, k)| self.laws.wrench(j, k, time)).collect();
        if self.laws.has_pair_forces() {
            self.laws.add_pair_forces(group, k, &mut out);
        }
        out
    }

    pub(super) fn rates_at(&mut self, group: &[usize], k: &[Kinematics<T>], time: T) -> Few<Rates<T>> {
        let wrenches = self.wrenches(group, k, time);
        self.rates(group, k, &wrenches, false)
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
    fn a_law_without_a_value_ends_the_simulation_of_bodies_that_pull_at_each_other() {
        let disc = Shape::Disc { radius: 0.05 };
        let bodies = vec![
            body(0, disc, vec2(-1.0, 0.0), vec2(0.6, 0.0)),
            body(1, disc, vec2(1.0, 0.25), vec2(0.0, 0.0)),
        ];
        let mut model = model(bodies, &[("pair_attraction", &[0.1, 0.05])]);
        let formula = Formula::new("ax = sqrt(0.5 - t)", vec![]).expect("it is one");
        model.effects.push(ActiveEffect::of_formula("root", formula, &model.bodies).expect("it is one"));
        assert_eq!(trace(&model, &seconds(100)).ending, Ending::FormulaUndefined);
    }

    /// Two discs swing past each other without friction: energy and momentum stay, however long the stretches are.
    #[test]
    fn bodies_that_pull_at_each_other_keep_their_energy() {
        let (strength, eps) = (0.1, 0.05);
        let disc = Shape::Disc { radius: 0.05 };
        let bodies = vec![
            body(0, disc, vec2(-1.0, 0.0), vec2(0.6, 0.0)),
            body(1, disc, vec2(1.0, 0.25), vec2(-0.6, 0.0)),
        ];
        let mass = bodies[0].mass;
        let run = trace(&model(bodies, &[("pair_attraction", &[strength, eps])]), &seconds(100));
        let energy = |row: &[Option<State>]| {
            let [a, b] = [0, 1].map(|k| row[k].expect("there"));
            let moving = 0.5 * mass * (a.velocity.norm_squared() + b.velocity.norm_squared());
            moving - strength / ((a.position - b.position).norm_squared() + eps * eps).sqrt()
        };
        let first = energy(&run.states[0]);
        let nearest = |row: &Vec<Option<State>>| {
            (row[0].expect("there").position - row[1].expect("there").position).norm()
        };
        let passed = run.states.iter().map(nearest).fold(f64::INFINITY, f64::min);
        assert!((0.1..0.25).contains(&passed), "they pass near each other, {passed} m");
        for row in &run.states {
            assert!((energy(row) - first).abs() < 1e-4 * strength / passed, "{} {first}", energy(row));
        }
    }
}
