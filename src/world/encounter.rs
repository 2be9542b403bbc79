//! Encounters: bodies brought to where they meet, and what their impulses do.

use super::blow::BLOW_SPEED;
use super::geometry::{Pose, Proximity, manifold};
use super::impact::{APPROACH, Side, against_edge, effective_mass, facing, point_velocity, resolve};
use super::motion::{Change, Kinematics, Mode};
use super::pressing::Touching;
use super::rigid::cling;
use super::simulate::{AtContact, Blow, Few, Moving, Run};
use super::trace::{Event, EventKind};
use crate::body::{Contact, ContactLaw};
use crate::effects::{ContactFn, MarginFn, Scalar};
use crate::scene::Shape;
use std::borrow::Cow;

/// Contacts slower than this do not rebound (m/s): the hop would be under 0.2 mm.
pub(super) const REBOUND_SPEED: f64 = 0.01;
/// Impacts of one pair within this time (s) are told as one event.
pub(super) const SAME_CONTACT: f64 = 0.1;
/// Approach speed that still counts at a blow while a contact lasts, whose own forces see to what is slower (m/s).
pub(super) const CUT_IN_SPEED: f64 = 1e-4;
/// Gap at which a kept contact's point takes part in blows (m).
pub(super) const CLOSED: f64 = 1e-5;

/// A body before it moved to an impact.
struct Before<T> {
    body: usize,
    from: Kinematics<T>,
    since: T,
    change: Option<Change>,
}

/// A body or wall and where it is.
type Placed<'k, T> = (usize, &'k Kinematics<T>);

impl<T: Scalar> Run<'_, T> {
    /// Moves the group of `i` to `time`.
    fn move_group(&mut self, i: usize, time: T) {
        let Moving { from, since, mode, change, .. } = self.bodies[i];
        let h = time - since;
        if h.value() <= 0.0 && !h.is_constant() {
            // Only the derivatives have a way to go.
            self.shift_group(i, h);
        } else if self.is_alone(i) {
            self.bodies[i].from = match self.plainly(i).filter(|_| time.is_constant()) {
                Some(laws) => {
                    let (from, since) = (from.value(), since.value());
                    Kinematics::constant(&laws.moved(i, &from, mode, since, time.value(), change))
                }
                None => self.laws.moved(i, &from, mode, since, time, change),
            };
        } else if h.value() > 0.0 {
            let group = self.bodies[i].group.clone();
            let start: Few<Kinematics<T>> = group.iter().map(|&j| self.bodies[j].from).collect();
            if !group.iter().all(|&j| matches!(self.bodies[j].mode, Mode::Rest | Mode::Absent)) {
                let midpoint =
                    group.iter().any(|&j| self.bodies[j].change.is_some_and(|c| c != Change::Continue));
                let first = self.rates_at(&group, &start, since);
                let (end, _) = self.integrate(&group, &start, &first, since, h, midpoint);
                for (x, &j) in group.iter().enumerate() {
                    self.bodies[j].from = end[x];
                }
            }
        }
        for x in 0..self.bodies[i].group.len() {
            let j = self.bodies[i].group[x];
            (self.bodies[j].since, self.bodies[j].change) = (time, None);
        }
    }

    /// Moves body `a`, and body `b` of another group, to `time`.
    fn move_both(&mut self, a: usize, b: usize, time: T) {
        self.move_group(a, time);
        if b < self.bodies.len() && !self.bodies[a].group.contains(&b) {
            self.move_group(b, time);
        }
    }

    fn shift_both(&mut self, a: usize, b: usize, by: T) {
        self.shift_group(a, by);
        if b < self.bodies.len() && !self.bodies[a].group.contains(&b) {
            self.shift_group(b, by);
        }
    }

    /// Moves the group of `i` by an infinitesimal time: values stay, derivatives change.
    fn shift_group(&mut self, i: usize, by: T) {
        let group = self.bodies[i].group.clone();
        let k: Few<Kinematics<T>> = group.iter().map(|&j| self.bodies[j].from).collect();
        let time = self.bodies[i].since;
        // The search for pressing forces begins the same with and without derivatives.
        let touching = self.touching.clone();
        let rates = self.rates_at(&group, &k, time);
        self.touching = touching;
        for (x, &j) in group.iter().enumerate() {
            if !matches!(self.bodies[j].mode, Mode::Rest | Mode::Absent) {
                self.bodies[j].from = k[x].stepped(&k[x], &rates[x], by);
            }
            self.bodies[j].since += by;
        }
    }

    pub(super) fn facing_now(&self, a: usize, b: usize) -> (Proximity<T>, T) {
        let (near, rate) = facing(&self.bodies[a].from, self.shape(a), self.kinematics(b), self.shape(b));
        (self.grown(near, (a, &self.bodies[a].from), (b, self.kinematics(b))), rate)
    }

    /// Gap between the outlines of two bodies at which they touch (m).
    pub(super) fn margin(&self, a: usize, b: usize) -> T {
        if self.margin_effects.is_empty() || b >= self.bodies.len() {
            return T::zero();
        }
        let (one, other) = (&self.model.bodies[a], &self.model.bodies[b]);
        let of = |effect: &AtContact<MarginFn<T>>| {
            (effect.hook)(&effect.active.values_for(effect.first, self.flat, one, other))
        };
        let sum = || self.margin_effects.iter().fold(T::zero(), |sum, effect| sum + of(effect));
        *self.margins.borrow_mut().entry((a, b)).or_insert_with(sum)
    }

    /// With the margin of the two, and with the derivatives by the sizes of the outlines.
    pub(super) fn grown(&self, mut near: Proximity<T>, a: Placed<T>, b: Placed<T>) -> Proximity<T> {
        near.gap -= self.margin(a.0, b.0);
        let growth = |i: usize| match i.checked_sub(self.bodies.len()) {
            Some(wall) => self.walls[wall].growth,
            None => self.laws.growth.get(i).copied().unwrap_or_default(),
        };
        let (of_a, of_b) = (growth(a.0), growth(b.0));
        if of_a.is_constant() && of_b.is_constant() {
            return near;
        }
        near.grown((a.1.position, self.shape(a.0), of_a), (b.1.position, self.shape(b.0), of_b))
    }

    pub(super) fn impact(&mut self, mut time: f64, a: usize, b: usize) {
        if !self.met.contains_key(&(a, b)) {
            let values = self.contact_values(a, b);
            self.met.insert((a, b), values);
        }
        let solid = b < self.bodies.len();
        let earliest =
            self.bodies[a].path.start.max(if solid { self.bodies[b].path.start } else { f64::MIN });
        // The path's cubic is off by the step's fourth power: one Newton step on the true motion.
        let saved: Vec<Before<T>> = self.involved(a, b).iter().map(|&j| self.before(j)).collect();
        for attempt in 0..3 {
            self.move_both(a, b, T::constant(time));
            let (near, _) = self.facing_now(a, b);
            let (gap, rate) = (near.gap.value(), self.opening(a, b, &near).value());
            let better = time - gap / rate;
            if attempt == 2
                || gap.abs() < 1e-11
                || rate > -1e-4
                || better < earliest
                || better > self.step_end
            {
                break;
            }
            self.restore(&saved);
            time = better;
        }
        if T::DIFFERENTIATES {
            self.differentiate_time(time, a, b, &saved);
        }
        for &Before { body, from, since, .. } in &saved {
            let Moving { from: to, since: until, .. } = self.bodies[body];
            self.note(body, &from, since, &to, until);
        }
        let (near, _) = self.facing_now(a, b);
        if let Some(delay) = self.delay(a, b, &near) {
            if delay.value() > 0.0 {
                self.blows.push(Blow { time: self.bodies[a].since + delay, a, b });
                return self.go_on(a, b);
            }
            self.shift_both(a, b, delay);
        }
        self.strike(time, a, b);
    }

    /// The time of impact moves with the parameters: implicit function theorem on gap = 0. Where the bodies touch
    /// as soon as their ways begin, it is the time at which these do.
    fn differentiate_time(&mut self, time: f64, a: usize, b: usize, saved: &[Before<T>]) {
        let later = |run: &Self| {
            let (near, _) = run.facing_now(a, b);
            let rate = run.opening(a, b, &near);
            if rate.value() < -1e-6 { -(near.gap.infinitesimal() / rate).infinitesimal() } else { T::zero() }
        };
        let begun = saved.iter().find(|s| s.since.value() == time).map(|s| s.since);
        let mut at = begun.unwrap_or_else(|| later(self) + time);
        if at.is_constant() {
            return;
        }
        self.restore(saved);
        self.move_both(a, b, at);
        if begun.is_some() {
            return;
        }
        // The gap opens at the rate of the velocities only as far as the integrator is exact, which it is not where another
        // corner comes to press on the way.
        if saved.len() > 2 {
            at += later(self);
            self.restore(saved);
            self.move_both(a, b, at);
        }
        let rest = later(self);
        self.shift_both(a, b, rest);
    }

    fn before(&self, body: usize) -> Before<T> {
        let Moving { from, since, change, .. } = self.bodies[body];
        Before { body, from, since, change }
    }

    fn restore(&mut self, saved: &[Before<T>]) {
        for &Before { body, from, since, change } in saved {
            let body = &mut self.bodies[body];
            (body.from, body.since, body.change) = (from, since, change);
        }
    }

    /// A soft contact gives its blow.
    pub(super) fn blow(&mut self, which: usize) {
        let Blow { time, a, b } = self.blows.swap_remove(which);
        let saved: Vec<Before<T>> = self.involved(a, b).iter().map(|&j| self.before(j)).collect();
        self.move_both(a, b, time);
        for Before { body, from, since, .. } in saved {
            let Moving { from: to, since: until, .. } = self.bodies[body];
            self.note(body, &from, since, &to, until);
        }
        let (near, _) = self.facing_now(a, b);
        if self.approach_at(a, b, &near).value() <= 0.0 {
            return self.go_on(a, b);
        }
        self.strike(time.value(), a, b);
    }

    /// How long after touching the blow of a soft contact comes (s); `None` where contacts are hard.
    ///
    /// A linear spring and damper that never pulls gives back `e` of the approach speed after `duration` (Schwager and
    /// Poeschel 2007). In between the bodies go straight on until the blow, so that the motion after is the same.
    fn delay(&self, a: usize, b: usize, near: &Proximity<T>) -> Option<T> {
        let approach = self.approach_at(a, b, near);
        let law = self.law(a, b, near, approach);
        if law.softness.value() == 0.0 && law.softness.is_constant() {
            return None;
        }
        let (_, duration) = law.spring(self.effective_mass(a, b, near));
        let e = self.restitution(&law, a, b, near, approach);
        Some(e * (duration + law.damping * law.softness * law.softness) / (e + 1.0))
    }

    /// Mass that the normal blow moves (kg).
    fn effective_mass(&self, a: usize, b: usize, near: &Proximity<T>) -> T {
        effective_mass(&self.side(a), &self.side(b), near)
    }

    /// Restitution with all that lowers it.
    fn restitution(&self, law: &ContactLaw<T>, a: usize, b: usize, near: &Proximity<T>, approach: T) -> T {
        if approach.value() < REBOUND_SPEED {
            return T::zero();
        }
        let mut e = law.restitution;
        if law.restitution_decay.value() != 0.0 || !law.restitution_decay.is_constant() {
            e *= (-(law.restitution_decay * approach)).exp();
        }
        if law.softness.value() != 0.0 || !law.softness.is_constant() {
            e *= law.spring(self.effective_mass(a, b, near)).0;
        }
        e
    }

    /// Contact and what follows from it, the bodies being where they touch at `time`.
    fn strike(&mut self, time: f64, a: usize, b: usize) {
        let (near, _) = self.facing_now(a, b);
        let approach = self.approach_at(a, b, &near);
        let law = self.bounce(time, a, b, &near);
        let (near, rate) = self.facing_now(a, b);
        if law.stick.value() >= 1.0 && b < self.bodies.len() {
            self.bond(a, b, &near, law.inverse_strength);
        } else if self.passes(a, b, rate) {
            self.passing.push((a, b));
        } else if rate.value() < REBOUND_SPEED * 0.1
            && near.gap.value() < 1e-6
            && rate.value() > -APPROACH.sqrt()
        {
            self.touching.push(Touching::new(a, b, &law));
            self.join(a, b);
        }
        self.lean(a, b);
        self.pass_on(time, &self.involved(a, b), BLOW_SPEED);
        if law.stick.value() == 0.0 {
            self.hold_off(time, a, b, law.restitution * approach);
        }
        self.go_on(a, b);
    }

    /// Presence and restitution that an obstacle has for body `a`.
    pub(super) fn obstacle(&self, a: usize, b: usize) -> Option<(T, T)> {
        let wall = b.checked_sub(self.bodies.len()).and_then(|w| self.walls.get(w))?;
        wall.obstacle.as_ref()?.get(a).copied()
    }

    /// Whether an obstacle lets the body through that still approaches it.
    fn passes(&self, a: usize, b: usize, rate: T) -> bool {
        self.obstacle(a, b).is_some_and(|(presence, _)| {
            presence.value() < 1.0 && rate.value() < -APPROACH && self.bodies[a].mode != Mode::Rest
        })
    }

    /// New ways of the bodies that have met.
    fn go_on(&mut self, a: usize, b: usize) {
        let changed = self.involved(a, b);
        if !self.bonds.is_empty() {
            self.part(&changed);
            self.predict_all(&changed);
            return self.refresh(&changed);
        }
        self.predict(a);
        if b < self.bodies.len() && !self.bodies[a].group.contains(&b) {
            self.predict(b);
        }
        self.refresh(&changed);
    }

    pub(super) fn points_now(&self, a: usize, b: usize) -> [Option<Proximity<T>>; 2] {
        let (sa, sb) = (self.shape(a), self.shape(b));
        let (ka, kb) = (self.kinematics(a), self.kinematics(b));
        let points = manifold(&Pose::of(ka, sa), sa, &Pose::of(kb, sb), sb);
        points.map(|near| near.map(|near| self.grown(near, (a, ka), (b, kb))))
    }

    /// Speed at which the gap closes (m/s).
    pub(super) fn approach_at(&self, a: usize, b: usize, near: &Proximity<T>) -> T {
        let velocity = |i: usize, point| point_velocity(self.kinematics(i), point);
        near.normal.dot(velocity(a, near.on_a) - velocity(b, near.on_b))
    }

    /// Rate of the gap itself (m/s): of the corner that is lowest, where a box faces a box.
    fn opening(&self, a: usize, b: usize, near: &Proximity<T>) -> T {
        let velocity = |i: usize| point_velocity(self.kinematics(i), near.lowest);
        near.normal.dot(velocity(b) - velocity(a))
    }

    pub(super) fn involved(&self, a: usize, b: usize) -> Vec<usize> {
        let mut all = self.bodies[a].group.clone();
        if let Some(other) = self.bodies.get(b) {
            all.extend(other.group.iter().filter(|j| !self.bodies[a].group.contains(j)));
        }
        all
    }

    /// Applies the impulses of the contact, notes the event, and gives the contact's law.
    pub(super) fn bounce(&mut self, time: f64, a: usize, b: usize, near: &Proximity<T>) -> ContactLaw<T> {
        let approach = self.approach_at(a, b, near);
        let point = (near.on_a + near.on_b).scaled(0.5);
        let mut law = self.law(a, b, near, approach);
        law.restitution = self.restitution(&law, a, b, near, approach);
        let mut side_a = self.side(a);
        let mut side_b = self.side(b);
        let mut impulse = match side_a.ball {
            Some(radius) if b >= self.bodies.len() => against_edge(&mut side_a, radius, near, &law),
            _ => resolve(&mut side_a, &mut side_b, near, &law),
        };
        if b < self.bodies.len() && (law.stick.value() != 0.0 || !law.stick.is_constant()) {
            let rebound = side_b.kinematics.velocity;
            cling(&mut side_a, &mut side_b, law.stick.min(T::constant(1.0)));
            impulse += near.normal.dot(side_b.kinematics.velocity - rebound) / side_b.inverse_mass;
        }
        let there = law.presence.value() > 0.0;
        for (i, side) in [(a, side_a), (b, side_b)] {
            if i < self.bodies.len() {
                self.receive(i, side.kinematics, there.then_some(Mode::Slide));
            }
        }
        if !there {
            return law;
        }
        let id = |i: usize| self.model.bodies.get(i).map(|body| body.id);
        let objects: Vec<u32> = [id(a), id(b)].into_iter().flatten().collect();
        let wall = self.walls.get(b.wrapping_sub(self.bodies.len())).map(|w| w.name.clone());
        let earlier = self.events.iter_mut().rev().take_while(|e| e.time > time - SAME_CONTACT);
        let same = earlier
            .filter(|e| e.kind == EventKind::Collision)
            .find(|e| e.objects == objects && e.wall == wall);
        if let Some(event) = same {
            event.impulse = event.impulse.map(|j| j + impulse.value());
            return law;
        }
        self.events.push(Event {
            kind: EventKind::Collision,
            time,
            objects,
            position: point.value(),
            normal: Some(near.normal.value()),
            impulse: Some(impulse.value()),
            wall,
        });
        law
    }

    /// What the contact effects say of this contact.
    pub(super) fn law(&self, a: usize, b: usize, near: &Proximity<T>, approach: T) -> ContactLaw<T> {
        let body = |i: usize| self.laws.body(i, &self.bodies[i].from);
        let other = (b < self.bodies.len()).then(|| body(b));
        let point = (near.on_a + near.on_b).scaled(0.5);
        let contact = Contact { a: body(a), b: other, normal: near.normal, point, approach };
        let mut law = ContactLaw::plain();
        let found =
            self.met.get(&(a, b)).map_or_else(|| Cow::Owned(self.contact_values(a, b)), Cow::Borrowed);
        for (effect, [pa, pb]) in self.contact_effects.iter().zip(found.iter()) {
            (effect.hook)(pa, pb, &contact, &mut law);
        }
        if let Some((presence, restitution)) = self.obstacle(a, b) {
            (law.presence, law.restitution) = (presence, restitution);
        }
        law
    }

    /// How body `i`, with what sticks to it, answers an impulse.
    pub(super) fn side(&self, i: usize) -> Side<T> {
        if let Some(rigid) = self.rigid(i, |j| self.bodies[j].from) {
            return rigid.side();
        }
        match self.bodies.get(i) {
            Some(body) => Side {
                kinematics: body.from,
                inverse_mass: self.laws.inverse_mass[i],
                inverse_inertia: self.laws.inverse_inertia[i],
                ball: match self.laws.shapes[i] {
                    Shape::Ball { radius } => Some(radius),
                    _ => None,
                },
            },
            None => Side {
                kinematics: *self.kinematics(i),
                inverse_mass: T::zero(),
                inverse_inertia: T::zero(),
                ball: None,
            },
        }
    }

    /// Parameters of each contact effect as they apply to body `a` when it touches `b`, and the other way round.
    fn contact_values(&self, a: usize, b: usize) -> Vec<[Vec<T>; 2]> {
        let body = |k: usize| self.model.bodies.get(k);
        let values = |effect: &AtContact<ContactFn<T>>, i: usize, j: usize| {
            let (Some(this), other) = (body(i).or(body(j)), body(j).or(body(i))) else { return vec![] };
            effect.active.values_for(effect.first, self.flat, this, other.unwrap_or(this))
        };
        self.contact_effects.iter().map(|effect| [values(effect, a, b), values(effect, b, a)]).collect()
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
