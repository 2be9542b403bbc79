//! Response to an impact: exact time, impulse, propagation, and new segments of the bodies that take part.
//!
//! The scheduled time of impact comes from cubic paths. Newton steps `t <- t - g / g'` on the integrated motion make the gap g (m)
//! vanish to 1e-11. Its derivative by the parameters p follows from the implicit function theorem on `g(t, p) = 0`:
//! `dt/dp = -(dg/dp) / g'`. A soft contact delays its impulse by the time that a spring and damper would need.

use crate::effects::Scalar;
use crate::world::contact::compression::Compression;
use crate::world::contact::geometry::Proximity;
use crate::world::contact::impulse::soft_response;
use crate::world::contact::persistent_contact::PersistentContact;
use crate::world::contact::time_of_impact::APPROACH;
use crate::world::motion::ground_friction::Mode;
use crate::world::motion::moving_body::Checkpoint;
use crate::world::simulation::event_queue::DelayedImpulse;
use crate::world::simulation::facing::REBOUND_SPEED;
use crate::world::simulation::impact_propagation::IMPACT_SPEED;
use crate::world::simulation::state::Simulation;

impl<T: Scalar> Simulation<'_, T> {
    /// Bodies `a` and `b` (or wall `b`) collide near `time` (s).
    pub(in crate::world) fn collide(&mut self, time: f64, a: usize, b: usize) {
        self.contact_laws.remember(a, b);
        let saved = self.checkpoints(a, b);
        let time = self.move_to_impact(time, a, b, &saved);
        if T::DIFFERENTIATES {
            self.differentiate_time(time, a, b, &saved);
        }
        self.record_motion(&saved);
        let (near, _) = self.facing_now(a, b);
        if let Some(contact) = self.compression(a, b, &near) {
            if contact.delay.value() > 0.0 {
                self.queue.delay(DelayedImpulse { time: contact.since + contact.delay, a, b });
                self.recorder.record_compression(contact);
                return self.resume(a, b);
            }
            self.shift_both(a, b, contact.delay);
        }
        self.resolve_collision(time, a, b);
    }

    /// The impulse of a soft contact acts.
    pub(in crate::world) fn apply_delayed_impulse(&mut self, which: usize) {
        let DelayedImpulse { time, a, b } = self.queue.take_delayed(which);
        let saved = self.checkpoints(a, b);
        self.move_both(a, b, time);
        self.record_motion(&saved);
        let (near, _) = self.facing_now(a, b);
        if self.approach_at(a, b, &near).value() <= 0.0 {
            self.recorder.remove_compression(a, b);
            return self.resume(a, b);
        }
        self.resolve_collision(time.value(), a, b);
    }

    /// Moves both islands to the instant at which `a` and `b` touch, and returns it (s).
    fn move_to_impact(&mut self, mut time: f64, a: usize, b: usize, saved: &[Checkpoint<T>]) -> f64 {
        let solid = b < self.bodies.len();
        let start = |i: usize| self.bodies[i].path().start;
        let earliest = start(a).max(if solid { start(b) } else { f64::MIN });
        for attempt in 0..3 {
            self.move_both(a, b, T::constant(time));
            let (near, _) = self.facing_now(a, b);
            let (gap, rate) = (near.gap.value(), self.opening_rate(a, b, &near).value());
            let better = time - gap / rate;
            if attempt == 2
                || gap.abs() < 1e-11
                || rate > -1e-4
                || better < earliest
                || better > self.step_end
            {
                break;
            }
            self.restore(saved);
            time = better;
        }
        time
    }

    /// Gives the time of impact its derivatives by the implicit function theorem. Where the bodies touch as soon as their
    /// segments start, it has those of that start.
    fn differentiate_time(&mut self, time: f64, a: usize, b: usize, saved: &[Checkpoint<T>]) {
        let later = |sim: &Self| {
            let (near, _) = sim.facing_now(a, b);
            let rate = sim.opening_rate(a, b, &near);
            if rate.value() < -1e-6 { -(near.gap.infinitesimal() / rate).infinitesimal() } else { T::zero() }
        };
        let start = saved.iter().map(|s| s.start.time).find(|start| start.value() == time);
        let mut at = start.unwrap_or_else(|| later(self) + time);
        if at.is_constant() {
            return;
        }
        self.restore(saved);
        self.move_both(a, b, at);
        if start.is_some() {
            return;
        }
        // In an island the gap opens at the rate of the velocities only up to the integration error: iterate once.
        if saved.len() > 2 {
            at += later(self);
            self.restore(saved);
            self.move_both(a, b, at);
        }
        let rest = later(self);
        self.shift_both(a, b, rest);
    }

    /// The present states of the islands of `a` and `b`.
    fn checkpoints(&self, a: usize, b: usize) -> Vec<Checkpoint<T>> {
        self.islands.union(a, b).iter().map(|&j| self.bodies[j].checkpoint(j)).collect()
    }

    fn restore(&mut self, saved: &[Checkpoint<T>]) {
        for checkpoint in saved {
            self.bodies[checkpoint.body].restore(checkpoint);
        }
    }

    /// Records the states between the checkpoints and now.
    fn record_motion(&mut self, saved: &[Checkpoint<T>]) {
        for checkpoint in saved {
            let body = &self.bodies[checkpoint.body];
            self.recorder.record(&checkpoint.start, body.state(), body.since());
        }
    }

    /// A soft contact that begins now; `None` for hard contacts.
    ///
    /// A linear spring and damper that never pulls reverses the share `e` of the approach speed after `duration` (Schwager and
    /// Poeschel, Granular Matter 9 (2007) 465). The bodies move uniformly until the impulse, which is delayed so that their motion
    /// after it is the same; where they are meanwhile, the record says.
    fn compression(&self, a: usize, b: usize, near: &Proximity<T>) -> Option<Compression<T>> {
        let approach = self.approach_at(a, b, near);
        let law = self.contact_law(a, b, near, approach);
        if law.softness.value() == 0.0 && law.softness.is_constant() {
            return None;
        }
        let mass = self.contact_mass(a, b, near);
        let (_, duration) = soft_response(&law, mass);
        let restitution = self.restitution(&law, a, b, near, approach);
        let compliance = law.softness * law.softness;
        let delay = restitution * (duration + law.damping * compliance) / (restitution + 1.0);
        let decay = law.damping / (mass * 2.0);
        let [one, other] = [a, b].map(|i| self.collision_body(i).inverse_mass);
        let shares = [one / (one + other), other / (one + other)];
        Some(Compression {
            a,
            b,
            since: self.bodies[a].since(),
            delay,
            duration,
            normal: near.normal,
            approach,
            restitution,
            decay,
            // Of a contact without softness only the derivative counts: it takes no time.
            square: if compliance.value() > 0.0 {
                T::constant(1.0) / (mass * compliance) - decay * decay
            } else {
                T::zero()
            },
            shares,
        })
    }

    /// Applies the impulse of two bodies that touch at `time` (s), with all that follows from it.
    fn resolve_collision(&mut self, time: f64, a: usize, b: usize) {
        let (near, _) = self.facing_now(a, b);
        let approach = self.approach_at(a, b, &near);
        let law = self.apply_impulse(time, a, b, &near);
        let (near, rate) = self.facing_now(a, b);
        if law.stick.value() >= 1.0 && b < self.bodies.len() {
            self.bond(a, b, &near, law.inverse_strength);
        } else if self.passes_through(a, b, rate) {
            self.contacts.pass(a, b);
        } else if rate.value() < REBOUND_SPEED * 0.1
            && near.gap.value() < 1e-6
            && rate.value() > -APPROACH.sqrt()
        {
            self.contacts.add(PersistentContact::new(a, b, &law));
            self.islands.join(a, b);
        }
        self.add_wall_contacts(a, b);
        let island = self.islands.union(a, b);
        self.propagate_impulses(time, &island, IMPACT_SPEED);
        if law.stick.value() == 0.0 {
            self.enforce_separation(time, a, b, law.restitution * approach);
        }
        self.resume(a, b);
    }

    /// Whether an obstacle lets a body through, which still approaches it.
    fn passes_through(&self, a: usize, b: usize, rate: T) -> bool {
        self.obstacle(a, b).is_some_and(|(presence, _)| {
            presence.value() < 1.0 && rate.value() < -APPROACH && self.bodies[a].mode() != Mode::Rest
        })
    }

    /// New segments and events of the islands of `a` and `b`.
    fn resume(&mut self, a: usize, b: usize) {
        let changed = self.islands.union(a, b);
        if !self.bonds.is_empty() {
            self.break_bonds(&changed);
            self.predict_all(&changed);
            return self.reschedule(&changed);
        }
        self.predict(a);
        if b < self.bodies.len() && !self.islands.same(a, b) {
            self.predict(b);
        }
        self.reschedule(&changed);
    }
}

#[cfg(test)]
mod tests {
    use crate::num::vec2;
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::trace;

    #[test]
    fn outlines_touch_at_their_distance() {
        for (distance, spheres) in [(0.0, true), (0.01, true), (-0.015, true), (0.01, false), (-0.015, false)]
        {
            let shape = if spheres { Shape::Ball { radius: 0.2 } } else { Shape::Square { half_side: 0.2 } };
            let bodies = vec![
                body(0, shape, vec2(0.0, 0.0), vec2(1.0, 0.0)),
                body(1, shape, vec2(1.0, 0.05), vec2(0.0, 0.0)),
            ];
            let t = trace(&model(bodies, &[("contact_distance", &[distance])]), &seconds(50));
            let reach = if spheres { (0.4 + distance).powi(2) - 0.0025 } else { (0.4 + distance).powi(2) };
            assert_eq!(t.events.len(), 1, "{distance}");
            assert!(
                (t.events[0].time - (1.0 - reach.sqrt())).abs() < 1e-9,
                "{distance} {}",
                t.events[0].time
            );
        }
    }
}
