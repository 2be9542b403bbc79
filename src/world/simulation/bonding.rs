//! Bonds that form at impacts and break under load.
//!
//! Bodies that stick together form a cluster, which is integrated as one rigid body: mass `M = sum m_i` (kg), moment of inertia
//! `I = sum (I_i + m_i r_i^2)` about the common centre (kg m^2), momentum and angular momentum as sums over its members. So no
//! constraint can drift. A ball in a cluster does not roll. An impact never breaks a bond; a load beyond its strength does.

use crate::effects::Scalar;
use crate::num::{Real, Vec2};
use crate::world::contact::bonds::Bond;
use crate::world::contact::contact_solver::ContactPoint;
use crate::world::contact::geometry::Proximity;
use crate::world::motion::ground_friction::Mode;
use crate::world::motion::kinematics::{IslandVec, Kinematics};
use crate::world::simulation::state::Simulation;

impl<T: Scalar> Simulation<'_, T> {
    /// Bodies `a` and `b` stick together from now on.
    pub(in crate::world) fn bond(&mut self, a: usize, b: usize, near: &Proximity<T>, inverse_strength: T) {
        let normal = near.normal.unrotated(Vec2::from_angle(self.bodies[a].state().yaw));
        self.bonds.add(Bond { a, b, normal, inverse_strength });
        if let Some(cluster) = self.rigid_cluster(a, |j| *self.bodies[j].state()) {
            self.set_motion(a, cluster.kinematics, Some(Mode::Slide));
        }
        let bonds = &self.bonds;
        self.contacts.retain(|c| !bonds.same_cluster(c.a, c.b));
        self.islands.join(a, b);
    }

    /// Breaks the bonds of an island whose load exceeds their strength, the most loaded first.
    ///
    /// The load of a bond (N) is the force that it carries along its normal: for the bodies on b's side, the sum of the forces
    /// from outside the cluster less mass times acceleration.
    pub(in crate::world) fn break_bonds(&mut self, island: &[usize]) {
        let can_break = |b: &Bond<T>| b.inverse_strength.value() > 0.0 && island.contains(&b.a);
        let mut broken = false;
        while self.bonds.iter().any(can_break) {
            let Some(&j) = island.iter().find(|&&j| self.bonds.cluster(j).is_some()) else { break };
            let k: IslandVec<Kinematics<T>> = island.iter().map(|&j| *self.bodies[j].state()).collect();
            let w = self.wrenches(island, &k, self.bodies[j].since());
            let mut rates = self.free_rates(island, &k, &w);
            let mass = |j: usize| self.dynamics.mass[j];
            let mut outside: Vec<Vec2> =
                rates.iter().zip(island).map(|(r, &j)| (r.velocity * mass(j)).value()).collect();
            self.join_clusters(island, &k, &mut rates);
            for point in self.solve(island, &k, &mut rates) {
                add_forces(&point, &mut outside);
            }
            let load = |bond: &Bond<T>| {
                let yaw = self.bodies[bond.a].state().yaw;
                let normal = bond.normal.rotated(Vec2::from_angle(yaw)).value();
                let far = |(x, j): (usize, &usize)| {
                    let inertial = (rates[x].velocity * self.dynamics.mass[*j]).value();
                    self.bonds.beyond(bond).contains(j).then(|| normal.dot(outside[x] - inertial))
                };
                island.iter().enumerate().filter_map(far).sum::<f64>() * bond.inverse_strength.value()
            };
            let loads =
                self.bonds.iter().enumerate().filter(|(_, b)| can_break(b)).map(|(n, b)| (n, load(b)));
            let worst = loads.max_by(|(_, x), (_, y)| x.total_cmp(y));
            let Some((worst, _)) = worst.filter(|(_, load)| *load > 1.0) else { break };
            self.bonds.remove(worst);
            broken = true;
        }
        if broken {
            self.split(island);
        }
    }
}

/// Adds the forces of a contact point on the bodies of the island (N).
fn add_forces<T: Real>(point: &ContactPoint<T>, forces: &mut [Vec2]) {
    let force = point.force().value();
    for side in point.sides.iter().flatten() {
        forces[side.at] += force.scaled(side.sign);
    }
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
        // It has rotated by spin x time.
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
        fn bodies_that_have_met_keep_their_distance(seed in throws(), mu in 0.0..0.1f64) {
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

    /// A chain of three under friction comes to rest as a whole, and an impact wakes it as a whole.
    #[test]
    fn a_chain_stops_and_wakes_as_a_whole() {
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
    fn a_pull_beyond_the_strength_breaks_the_bond() {
        // After the impact both rotate about their common centre: the bond carries m spin^2 r.
        let (radius, speed, offset) = (0.2, 1.5, 0.17);
        let spin = 0.5 * speed * offset / (3.0 * radius * radius);
        let pull = spin * spin * radius;
        let breaks = |strength: f64| {
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
        assert_eq!([0.9, 1.1].map(|share| breaks(share * pull)), [true, false]);
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
