//! Bodies that stick together: they move as one rigid body until a pull parts them.

use super::geometry::Proximity;
use super::impact::Side;
use super::motion::{Change, Kinematics, Mode, REST_SPEED, Rates, SETTLING_SPEED};
use super::pressure::PressurePoint;
use super::simulate::{Few, Run};
use crate::body::Wrench;
use crate::effects::Scalar;
use crate::num::{Real, Vec2};

/// Bodies `a` and `b` stick together.
#[derive(Clone, Copy)]
pub(super) struct Bond<T> {
    a: usize,
    b: usize,
    /// Unit normal from a to b, in the frame of a.
    normal: Vec2<T>,
    /// One over the pull that parts them (1/N).
    weakness: T,
}

/// Several bodies as one rigid body.
pub(super) struct Rigid<T> {
    /// kg.
    pub mass: T,
    /// About z and the common centre (kg m^2).
    pub inertia: T,
    /// Of the common centre.
    pub kinematics: Kinematics<T>,
}

impl<T: Real> Rigid<T> {
    /// The rigid body that has the momentum and angular momentum of its parts: mass, moment of inertia, motion.
    pub fn of(parts: impl Iterator<Item = (T, T, Kinematics<T>)> + Clone) -> Self {
        let sum = |f: &dyn Fn((T, T, Kinematics<T>)) -> T| parts.clone().map(f).fold(T::zero(), |s, v| s + v);
        let mean = |f: &dyn Fn(Kinematics<T>) -> Vec2<T>, mass: T| {
            let total = parts.clone().fold(Vec2::zero(), |s, (m, _, k)| s + f(k) * m);
            total * (T::constant(1.0) / mass)
        };
        let mass = sum(&|(m, ..)| m);
        let (position, velocity) = (mean(&|k| k.position, mass), mean(&|k| k.velocity, mass));
        let inertia = sum(&|(m, inertia, k)| inertia + m * (k.position - position).norm_squared());
        let turning = sum(&|(m, inertia, k)| {
            inertia * k.spin + m * (k.position - position).cross(k.velocity - velocity)
        });
        let spin = turning / inertia;
        let kinematics = Kinematics { position, yaw: T::zero(), velocity, spin, roll: Vec2::zero() };
        Rigid { mass, inertia, kinematics }
    }

    /// The motion of a part, which does not roll.
    fn carry(&self, part: &mut Kinematics<T>) {
        let Kinematics { position, velocity, spin, .. } = self.kinematics;
        part.velocity = velocity + (part.position - position).perp() * spin;
        part.spin = spin;
        part.roll = Vec2::zero();
    }

    pub fn side(&self) -> Side<T> {
        let inverse = |v: T| T::constant(1.0) / v;
        Side {
            kinematics: self.kinematics,
            inverse_mass: inverse(self.mass),
            inverse_inertia: inverse(self.inertia),
            ball: None,
        }
    }
}

/// Takes `share` of the relative motion of two bodies: at 1 they go on as one. Momentum and angular momentum stay.
pub(super) fn cling<T: Real>(a: &mut Side<T>, b: &mut Side<T>, share: T) {
    let inverse = |v: T| T::constant(1.0) / v;
    let part = |s: &Side<T>| (inverse(s.inverse_mass), inverse(s.inverse_inertia), s.kinematics);
    let rigid = Rigid::of([part(a), part(b)].into_iter());
    for k in [&mut a.kinematics, &mut b.kinematics] {
        let mut joined = *k;
        rigid.carry(&mut joined);
        k.velocity += (joined.velocity - k.velocity) * share;
        k.spin += (joined.spin - k.spin) * share;
        k.roll -= k.roll * share;
    }
}

impl<T: Scalar> Run<'_, T> {
    /// The bodies that stick together with body `i`, itself included, if any do.
    pub(super) fn cluster(&self, i: usize) -> Option<&[usize]> {
        self.clusters.iter().find(|c| c.contains(&i)).map(Vec::as_slice)
    }

    /// Body `i` and all that sticks to it.
    pub(super) fn stuck_to(&self, i: usize) -> Few<usize> {
        self.cluster(i).map_or_else(|| Few::from_elem(i, 1), Few::from_slice)
    }

    pub(super) fn one_body(&self, a: usize, b: usize) -> bool {
        self.cluster(a).is_some_and(|c| c.contains(&b))
    }

    /// The cluster of body `i` as one body, its members being where `k` says.
    pub(super) fn rigid(&self, i: usize, k: impl Fn(usize) -> Kinematics<T>) -> Option<Rigid<T>> {
        let one = T::constant(1.0);
        let part = |&j: &usize| (self.laws.mass[j], one / self.laws.inverse_inertia[j], k(j));
        self.cluster(i).map(|members| Rigid::of(members.iter().map(part)))
    }

    /// Body `i`, and what sticks to it, moves on as the blow says.
    pub(super) fn receive(&mut self, i: usize, after: Kinematics<T>, mode: Option<Mode>) {
        let members = self.stuck_to(i);
        let (one, zero) = (members.len() == 1, T::zero());
        let rigid = Rigid { mass: zero, inertia: zero, kinematics: after };
        for j in members {
            let body = &mut self.bodies[j];
            if one {
                body.from = after;
            } else {
                rigid.carry(&mut body.from);
            }
            body.mode = mode.unwrap_or(body.mode);
        }
    }

    /// Bodies `a` and `b` stick from now on.
    pub(super) fn bond(&mut self, a: usize, b: usize, near: &Proximity<T>, weakness: T) {
        let normal = near.normal.unrotated(Vec2::from_angle(self.bodies[a].from.yaw));
        self.bonds.push(Bond { a, b, normal, weakness });
        self.recluster();
        if let Some(rigid) = self.rigid(a, |j| self.bodies[j].from) {
            self.receive(a, rigid.kinematics, Some(Mode::Slide));
        }
        let touching = std::mem::take(&mut self.touching);
        self.touching = touching.into_iter().filter(|t| !self.one_body(t.a, t.b)).collect();
        self.join(a, b);
    }

    fn recluster(&mut self) {
        self.clusters.clear();
        for Bond { a, b, .. } in &self.bonds {
            let (near, far): (Vec<_>, Vec<_>) =
                self.clusters.drain(..).partition(|c: &Vec<usize>| c.contains(a) || c.contains(b));
            let mut joined = near.concat();
            joined.extend([a, b]);
            joined.sort_unstable();
            joined.dedup();
            self.clusters = far;
            self.clusters.push(joined);
        }
    }

    pub(super) fn join_bonds(&mut self) {
        for k in 0..self.bonds.len() {
            let Bond { a, b, .. } = self.bonds[k];
            self.join(a, b);
        }
    }

    /// The clusters of a group, as places in it.
    fn clusters_of(&self, group: &[usize]) -> impl Iterator<Item = Few<usize>> {
        let own = self.clusters.iter().filter(|c| group.contains(&c[0]));
        own.map(|c| c.iter().filter_map(|j| group.iter().position(|i| i == j)).collect())
    }

    /// Accelerations of bodies that stick together become those of one body.
    pub(super) fn fuse(&self, group: &[usize], k: &[Kinematics<T>], rates: &mut [Rates<T>]) {
        for members in self.clusters_of(group) {
            let first = members[0];
            let Some(rigid) = self.rigid(group[first], |j| in_group(group, k, j)) else { continue };
            if self.bodies[group[first]].mode == Mode::Rest {
                continue;
            }
            let (mut force, mut torque) = (Vec2::zero(), T::zero());
            for &x in &members {
                let j = group[x];
                let pull = rates[x].velocity * self.laws.mass[j];
                force += pull;
                torque += (k[x].position - rigid.kinematics.position).cross(pull)
                    + rates[x].spin / self.laws.inverse_inertia[j];
            }
            let (push, turn) = (force * (T::constant(1.0) / rigid.mass), torque / rigid.inertia);
            let spin = k[first].spin;
            for &x in &members {
                let arm = k[x].position - rigid.kinematics.position;
                let velocity = push + arm.perp() * turn - arm * (spin * spin);
                rates[x] = Rates { velocity, spin: turn, roll: Vec2::zero() };
            }
        }
    }

    /// Bodies that stick together turn and shift as one, to round-off.
    pub(super) fn assemble(&self, group: &[usize], start: &[Kinematics<T>], end: &mut [Kinematics<T>]) {
        for members in self.clusters_of(group) {
            let first = members[0];
            let before = self.rigid(group[first], |j| in_group(group, start, j));
            let after = self.rigid(group[first], |j| in_group(group, end, j));
            let (Some(before), Some(mut after)) = (before, after) else { continue };
            if self.bodies[group[first]].mode == Mode::Rest {
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

    /// Whether dry friction holds body `j` of the group, and what sticks to it, against these forces.
    pub(super) fn held(&self, j: usize, group: &[usize], k: &[Kinematics<T>], w: &[Wrench<T>]) -> bool {
        let place = |i: usize| group.iter().position(|&g| g == i);
        let Some(rigid) = self.rigid(j, |i| in_group(group, k, i)) else {
            return place(j).is_some_and(|x| self.laws.holds(j, &w[x]));
        };
        let center = rigid.kinematics.position.value();
        let (mut force, mut torque, mut grip, mut most) = (Vec2::zero(), 0.0, 0.0, 0.0);
        for x in self.cluster(j).into_iter().flatten().filter_map(|&i| place(i)) {
            let shape = &self.laws.shapes[group[x]];
            let (arm, pull) = (k[x].position.value() - center, w[x].force.value());
            force += pull;
            torque += w[x].torque.value() + arm.cross(pull);
            // A ball that cannot roll is held as a box is.
            let (own, reach) = match shape.is_ball() {
                true => (w[x].friction_limit.value().max(w[x].rolling_resistance.value()), 0.0),
                false => (w[x].friction_limit.value(), shape.bounding_radius()),
            };
            grip += own;
            most += own * (arm.norm() + reach) + w[x].spin_friction_limit.value();
        }
        grip > 0.0 && force.norm() <= grip && torque.abs() <= most
    }

    /// The modes of a group once these forces act; bodies that stick together rest together or not at all.
    pub(super) fn set_modes(&mut self, group: &[usize], k: &[Kinematics<T>], w: &[Wrench<T>]) {
        for (x, &j) in group.iter().enumerate() {
            if self.cluster(j).is_none() {
                self.bodies[j].mode = self.laws.mode_under(j, self.bodies[j].mode, &w[x]);
            }
        }
        for members in self.clusters_of(group).collect::<Vec<_>>() {
            let resting = members.iter().all(|&x| self.bodies[group[x]].mode == Mode::Rest);
            let mode = match resting && self.held(group[members[0]], group, k, w) {
                true => Mode::Rest,
                false => Mode::Slide,
            };
            members.iter().for_each(|&x| self.bodies[group[x]].mode = mode);
        }
    }

    /// Mean square speed of what sticks to body `j` (m^2/s^2), turning included, and half the rate at which it changes.
    fn motion_of(&self, j: usize, group: &[usize], k: &[Kinematics<T>], r: &[Rates<T>]) -> (T, T) {
        let (mut energy, mut power, mut mass) = (T::zero(), T::zero(), T::zero());
        let place = |i: &usize| group.iter().position(|g| g == i);
        for x in self.cluster(j).into_iter().flatten().filter_map(place) {
            let (m, inertia) =
                (self.laws.mass[group[x]], T::constant(1.0) / self.laws.inverse_inertia[group[x]]);
            energy += k[x].velocity.norm_squared() * m + k[x].spin * k[x].spin * inertia;
            power += k[x].velocity.dot(r[x].velocity) * m + k[x].spin * r[x].spin * inertia;
            mass += m;
        }
        (energy / mass, power / mass)
    }

    /// When a cluster that is slow and gets slower will be at rest (s).
    pub(super) fn cluster_settles(
        &self,
        j: usize,
        group: &[usize],
        k: &[Kinematics<T>],
        r: &[Rates<T>],
    ) -> Option<T> {
        let (squared, power) = self.motion_of(j, group, k, r);
        let slow = squared.value() > 0.0 && squared.value() < SETTLING_SPEED * SETTLING_SPEED;
        (slow && power.value() < 0.0).then(|| -(squared / power))
    }

    /// When friction stops the cluster of body `j`, if its deceleration lasts.
    pub(super) fn cluster_change(
        &self,
        j: usize,
        group: &[usize],
        k: &[Kinematics<T>],
        w: &[Wrench<T>],
        r: &[Rates<T>],
    ) -> Option<(Change, T)> {
        let dry = |w: &Wrench<T>| w.friction_limit.value() > 0.0 || w.rolling_resistance.value() > 0.0;
        if self.cluster(j)?[0] != j || !w.iter().any(dry) {
            return None;
        }
        let (squared, power) = self.motion_of(j, group, k, r);
        if squared.value() <= REST_SPEED * REST_SPEED {
            let pushed = power.value() > 0.0 || squared.value() == 0.0;
            return (!pushed && self.held(j, group, k, w)).then(|| (Change::Stop, T::zero()));
        }
        (power.value() < 0.0).then(|| (Change::Stop, -(squared / power)))
    }

    /// Bonds of the group that are pulled harder than they hold break.
    pub(super) fn part(&mut self, group: &[usize]) {
        let weak = |b: &Bond<T>| b.weakness.value() > 0.0 && group.contains(&b.a);
        let mut broken = false;
        while self.bonds.iter().any(weak) {
            let Some(&j) = group.iter().find(|&&j| self.cluster(j).is_some()) else { break };
            let k: Few<Kinematics<T>> = group.iter().map(|&j| self.bodies[j].from).collect();
            let wrenches = self.wrenches(group, &k, self.bodies[j].since);
            let mut rates = self.free_rates(group, &k, &wrenches);
            let mut outside: Vec<Vec2> =
                rates.iter().zip(group).map(|(r, &j)| (r.velocity * self.laws.mass[j]).value()).collect();
            self.fuse(group, &k, &mut rates);
            for point in self.solved(group, &k, &mut rates) {
                point.add_to(&mut outside);
            }
            let load = |bond: &Bond<T>| {
                let normal = bond.normal.rotated(Vec2::from_angle(self.bodies[bond.a].from.yaw)).value();
                let far = |(x, j): (usize, &usize)| {
                    let inertial = (rates[x].velocity * self.laws.mass[*j]).value();
                    self.beyond(bond).contains(j).then(|| normal.dot(outside[x] - inertial))
                };
                group.iter().enumerate().filter_map(far).sum::<f64>() * bond.weakness.value()
            };
            let loads = self.bonds.iter().enumerate().filter(|(_, b)| weak(b)).map(|(n, b)| (n, load(b)));
            let worst = loads.max_by(|(_, x), (_, y)| x.total_cmp(y));
            let Some((worst, _)) = worst.filter(|(_, load)| *load > 1.0) else { break };
            self.bonds.remove(worst);
            self.recluster();
            broken = true;
        }
        if broken {
            self.split(group);
        }
    }

    /// The bodies on b's side of a bond.
    fn beyond(&self, bond: &Bond<T>) -> Vec<usize> {
        let mut side = vec![bond.b];
        let mut next = 0;
        while let Some(&j) = side.get(next) {
            next += 1;
            let others = self.bonds.iter().filter(|o| (o.a, o.b) != (bond.a, bond.b));
            for (near, far) in others.flat_map(|o| [(o.a, o.b), (o.b, o.a)]) {
                if near == j && !side.contains(&far) {
                    side.push(far);
                }
            }
        }
        side
    }
}

impl<T: Real> PressurePoint<T> {
    /// Adds its forces on the bodies of the group (N).
    fn add_to(&self, forces: &mut [Vec2]) {
        let force = (self.normal * self.force + self.normal.perp() * self.rub).value();
        for side in self.sides.iter().flatten() {
            forces[side.at] += force.scaled(side.sign);
        }
    }
}

/// State of body `j`, a member of the group.
pub(super) fn in_group<T: Real>(group: &[usize], k: &[Kinematics<T>], j: usize) -> Kinematics<T> {
    // Clusters never reach beyond their group.
    k[group.iter().position(|&i| i == j).unwrap_or(0)]
}

#[cfg(test)]
mod tests {
    use crate::num::{Vec2, vec2};
    use crate::world::tests::{
        body, conserves, crowd, derivatives_agree, model, momentum, seconds, shape, throws,
    };
    use crate::world::{Ending, Event, EventKind, Trace, trace};
    use proptest::prelude::*;

    const STICKS: (&str, &[f64]) = ("sticky_contact", &[1.0, 0.0]);

    /// Distance and difference of yaw of two bodies at a frame.
    fn between(t: &Trace, frame: usize, a: usize, b: usize) -> (f64, f64) {
        let at = |k: usize| t.states[frame][k].expect("present");
        ((at(a).position - at(b).position).norm(), at(a).yaw - at(b).yaw)
    }

    /// Two equal discs, one at rest, hit off centre: they turn about their common centre with
    /// spin = L/I, L = m/2 v b and I = 2 (m r^2/2 + m r^2).
    #[test]
    fn two_discs_that_hit_off_centre_turn_about_their_common_centre() {
        let (radius, speed, offset) = (0.2, 1.5, 0.17);
        let discs = vec![
            body(0, shape(0), vec2(-1.0, 0.0), vec2(speed, 0.0)),
            body(1, shape(0), vec2(0.0, offset), vec2(0.0, 0.0)),
        ];
        let m = model(discs, &[("restitution", &[0.7, 1.0]), ("contact_friction", &[0.2]), STICKS]);
        let t = trace(&m, &seconds(100));
        assert_eq!((t.ending, t.events.len()), (Ending::Completed, 1));
        let spin = 0.5 * speed * offset / (3.0 * radius * radius);
        for f in 60..t.times.len() {
            let [a, b] = [0, 1].map(|k| t.states[f][k].expect("present"));
            assert!((a.spin - spin).abs() < 1e-10 && (b.spin - spin).abs() < 1e-10, "{} {spin}", a.spin);
            let centre = (a.velocity + b.velocity).scaled(0.5);
            assert!((centre - vec2(0.5 * speed, 0.0)).norm() < 1e-12, "{centre:?}");
            let (distance, turned) = between(&t, f, 0, 1);
            assert!((distance - 2.0 * radius).abs() < 1e-9 && turned.abs() < 1e-12, "{distance} {turned}");
        }
        // It has turned by spin x time.
        let angle = |f: usize| {
            let d = t.states[f][1].expect("present").position - t.states[f][0].expect("present").position;
            d.y.atan2(d.x)
        };
        let turned = angle(60) - angle(40) - spin * 0.8;
        assert!(turned.abs() < 1e-9, "{turned}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn sticking_keeps_momentum_and_adds_no_energy(seed in throws(), e in 0.0..1.0f64, mu in 0.0..0.5f64) {
            let m = model(crowd(&seed), &[("restitution", &[e, 1.0]), ("contact_friction", &[mu]), STICKS]);
            // Between steps states are interpolated.
            conserves(&m, 1e-5)?;
        }

        #[test]
        fn a_share_of_sticking_keeps_momentum_and_adds_no_energy(seed in throws(), e in 0.0..1.0f64, p in 0.0..0.5f64) {
            let laws: &[(&str, &[f64])] = &[("restitution", &[e, 1.0]), ("contact_friction", &[0.2]), ("sticky_contact", &[p, 0.0])];
            conserves(&model(crowd(&seed), laws), 1e-3)?;
        }

        #[test]
        fn what_has_met_keeps_its_distance(seed in throws(), mu in 0.0..0.1f64) {
            let m = model(crowd(&seed), &[("sliding_friction", &[mu]), ("rolling_resistance", &[0.01]), STICKS]);
            let t = trace(&m, &seconds(60));
            prop_assert_eq!(t.ending, Ending::Completed);
            for event in t.events.iter().filter(|e| e.kind == EventKind::Collision) {
                let first = t.times.iter().position(|&time| time > event.time).unwrap_or(60);
                let [a, b] = [event.objects[0] as usize, event.objects[1] as usize];
                let (distance, turned) = between(&t, first, a, b);
                for f in first..=60 {
                    let now = between(&t, f, a, b);
                    prop_assert!((now.0 - distance).abs() < 1e-6, "{a} {b} {} {distance}", now.0);
                    prop_assert!((now.1 - turned).abs() < 1e-6, "{} {turned}", now.1);
                }
            }
        }
    }

    /// A chain of three under friction comes to rest as one, and a push wakes it as one.
    #[test]
    fn a_chain_stops_together_and_is_woken_together() {
        let throw = |id, kind, x, vx| body(id, shape(kind), vec2(x, 0.01 * id as f64), vec2(vx, 0.0));
        let chain = vec![
            throw(0, 0, 0.0, 0.8),
            throw(1, 2, 0.6, 0.0),
            throw(2, 1, 1.05, 0.0),
            throw(3, 0, -4.0, 3.0),
        ];
        let m = model(chain, &[("sliding_friction", &[0.05]), ("rolling_resistance", &[0.01]), STICKS]);
        let t = trace(&m, &seconds(150));
        assert_eq!(t.ending, Ending::Completed);
        let hits: Vec<f64> =
            t.events.iter().filter(|e| e.kind == EventKind::Collision).map(|e| e.time).collect();
        assert_eq!(hits.len(), 3, "{:?}", t.events);
        let stops = |from: f64, to: f64| {
            let stop = |e: &&Event| e.kind == EventKind::Stop && (from..to).contains(&e.time);
            t.events.iter().filter(stop).map(|e| e.time).collect::<Vec<_>>()
        };
        let first = stops(hits[1], hits[2]);
        assert!(first.len() == 3 && first.iter().all(|s| *s == first[0]), "{:?}", t.events);
        let last = stops(hits[2], 9.0);
        assert!(last.len() == 4 && last.iter().all(|s| *s == last[0]), "{:?}", t.events);
        assert!(t.energy[150] == 0.0);
    }

    #[test]
    fn a_pull_beyond_the_strength_parts_what_sticks() {
        // After the blow both turn about their common centre: the bond pulls with m spin^2 r.
        let (radius, speed, offset) = (0.2, 1.5, 0.17);
        let spin = 0.5 * speed * offset / (3.0 * radius * radius);
        let pull = spin * spin * radius;
        let parted = |strength: f64| {
            let discs = vec![
                body(0, shape(0), vec2(-1.0, 0.0), vec2(speed, 0.0)),
                body(1, shape(0), vec2(0.0, offset), vec2(0.0, 0.0)),
            ];
            let m = model(discs, &[("sticky_contact", &[1.0, 1.0 / strength])]);
            let t = trace(&m, &seconds(100));
            let (p, _) = momentum(&t, &m, 100);
            assert!((p - vec2(speed, 0.0)).norm() < 1e-10);
            between(&t, 100, 0, 1).0 > 2.0 * radius + 0.01
        };
        assert_eq!([0.9, 1.1].map(|share| parted(share * pull)), [true, false]);
    }

    #[test]
    fn derivatives_are_exact_where_bodies_stick() {
        for (kinds, presence) in
            [([0, 0, 2], 1.0), ([3, 2, 0], 1.0), ([1, 0, 1], 1.0), ([0, 2, 0], 0.2), ([0, 0, 0], 0.0)]
        {
            let at = [(0.0, 0.0, 1.2), (0.7, 0.12, 0.1), (1.5, -0.05, -0.4)];
            let thrown = |(i, (&kind, (x, y, vx))): (usize, (&u8, (f64, f64, f64)))| {
                let mut b = body(i as u32, shape(kind), vec2(x, y), Vec2 { x: vx, y: 0.05 });
                b.start.state.yaw = 0.3 * i as f64;
                b.start.state.spin = if b.shape.is_ball() { 0.0 } else { 0.4 };
                b.mass = 1.0 + 0.3 * i as f64;
                b
            };
            let bodies = kinds.iter().zip(at).enumerate().map(thrown).collect();
            let sticky = [presence, 0.0];
            let laws: [(&str, &[f64]); 4] = [
                ("restitution", &[0.6, 1.0]),
                ("sliding_friction", &[0.01]),
                ("damping", &[0.05, 0.02]),
                ("sticky_contact", &sticky),
            ];
            let (good, all, worst) = derivatives_agree(&model(bodies, &laws), &seconds(40));
            assert_eq!(good, all, "{kinds:?} {presence}: {worst}");
        }
    }
}
