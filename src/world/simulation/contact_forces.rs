//! Accelerations of an island: free motion, clusters as rigid bodies, and the forces of persistent contacts.
//!
//! Lists named `island`, `k`, `w` and `rates` have one entry per body of the island: index, state, wrench, acceleration.

use crate::body::Wrench;
use crate::effects::Scalar;
use crate::num::{Real, Vec2};
use crate::scene::Shape;
use crate::world::contact::contact_solver::{ContactPoint, ContactSide, STABILISATION_RATE, solve_contacts};
use crate::world::contact::geometry::{Feature, OutlinePose, Proximity, manifold};
use crate::world::contact::impulse::CollisionBody;
use crate::world::contact::persistent_contact::{PersistentContact, WarmStart};
use crate::world::contact::time_of_impact::facing;
use crate::world::motion::ground_friction::Mode;
use crate::world::motion::kinematics::{IslandVec, Kinematics, Rates};
use crate::world::simulation::state::{Simulation, member_state};

impl<T: Scalar> Simulation<'_, T> {
    /// Accelerations with contact forces; `mark` notes which contacts still press.
    pub(in crate::world) fn rates(
        &mut self,
        island: &[usize],
        k: &[Kinematics<T>],
        w: &[Wrench<T>],
        mark: bool,
    ) -> IslandVec<Rates<T>> {
        let mut rates = self.free_rates(island, k, w);
        self.join_clusters(island, k, &mut rates);
        if !self.contacts.any_within(island) {
            return rates;
        }
        let points = self.solve(island, k, &mut rates);
        if mark {
            for c in 0..self.contacts.all().len() {
                let contact = &self.contacts.all()[c];
                if island.contains(&contact.a) {
                    let presses = contact.in_equilibrium
                        || points.iter().any(|p| p.contact == c && p.normal_force.value() > 0.0);
                    self.contacts.set_pressing(c, presses);
                }
            }
        }
        rates
    }

    /// Accelerations without contacts and bonds.
    pub(in crate::world) fn free_rates(
        &self,
        island: &[usize],
        k: &[Kinematics<T>],
        w: &[Wrench<T>],
    ) -> IslandVec<Rates<T>> {
        let free = |(x, &j): (usize, &usize)| self.dynamics.rates(j, &k[x], self.bodies[j].mode(), &w[x]);
        island.iter().enumerate().map(free).collect()
    }

    /// Solves for the contact forces of the island and adds their effect to `rates`. Starts from the last solution.
    pub(in crate::world) fn solve(
        &mut self,
        island: &[usize],
        k: &[Kinematics<T>],
        rates: &mut [Rates<T>],
    ) -> Vec<ContactPoint<T>> {
        let mut points = self.contact_points(island, k);
        solve_contacts(&mut points, rates);
        for p in &points {
            let (normal_force, tangential_force) = (p.normal_force.value(), p.tangential_force.value());
            let found = WarmStart { normal_force, tangential_force, slides: p.slides };
            self.contacts.set_warm_start(p.contact, p.end, found);
        }
        points
    }

    /// Replaces the accelerations of the bodies of a cluster by those of one rigid body.
    pub(in crate::world) fn join_clusters(
        &self,
        island: &[usize],
        k: &[Kinematics<T>],
        rates: &mut [Rates<T>],
    ) {
        for members in self.bonds.clusters_of(island) {
            let first = members[0];
            let Some(cluster) = self.rigid_cluster(island[first], |j| member_state(island, k, j)) else {
                continue;
            };
            if self.bodies[island[first]].mode() == Mode::Rest {
                continue;
            }
            let (mut force, mut torque) = (Vec2::zero(), T::zero());
            for &x in &members {
                let j = island[x];
                let pull = rates[x].velocity * self.dynamics.mass[j];
                force += pull;
                torque += (k[x].position - cluster.kinematics.position).cross(pull)
                    + rates[x].spin / self.dynamics.inverse_inertia[j];
            }
            let (push, turn) = (force * (T::constant(1.0) / cluster.mass), torque / cluster.inertia);
            let spin = k[first].spin;
            for &x in &members {
                let arm = k[x].position - cluster.kinematics.position;
                let velocity = push + arm.perp() * turn - arm * (spin * spin);
                rates[x] = Rates { velocity, spin: turn, roll: Vec2::zero() };
            }
        }
    }

    /// The points of the island's persistent contacts, with the forces of the last solution.
    pub(in crate::world) fn contact_points(
        &self,
        island: &[usize],
        k: &[Kinematics<T>],
    ) -> Vec<ContactPoint<T>> {
        let mut points = Vec::with_capacity(2 * self.contacts.all().len());
        let poses: IslandVec<OutlinePose<T>> =
            island.iter().zip(k).map(|(&j, k)| OutlinePose::of(k, self.shape(j))).collect();
        let position = |body: usize| island.iter().position(|&j| j == body);
        for (c, contact) in self.contacts.all().iter().enumerate() {
            let Some(x) = position(contact.a) else { continue };
            let y = position(contact.b);
            let kb = y.map_or_else(|| self.kinematics(contact.b), |y| &k[y]);
            let (sa, sb) = (self.shape(contact.a), self.shape(contact.b));
            let pose_b = y.map_or_else(|| OutlinePose::of(kb, sb), |y| poses[y]);
            let ends = manifold(&poses[x], sa, &pose_b, sb);
            for (end, near) in ends.into_iter().enumerate() {
                let Some(near) = near else { continue };
                let near = self.adjusted(near, (contact.a, &k[x]), (contact.b, kb));
                let point = (near.on_a + near.on_b).scaled(0.5);
                let side = |at, body, sign| self.contact_side((island, k), (at, body), sign, point);
                let sides = [Some(side(x, contact.a, -1.0)), y.map(|y| side(y, contact.b, 1.0))];
                points.extend(self.contact_point((c, contact, end), &near, (&k[x], kb), sides));
            }
        }
        points
    }

    /// One point of contact `c`; none where no force moves its bodies.
    fn contact_point(
        &self,
        (c, contact, end): (usize, &PersistentContact<T>, usize),
        near: &Proximity<T>,
        (ka, kb): (&Kinematics<T>, &Kinematics<T>),
        sides: [Option<ContactSide<T>>; 2],
    ) -> Option<ContactPoint<T>> {
        let (sa, sb) = (self.shape(contact.a), self.shape(contact.b));
        let (n, friction) = (near.normal, contact.friction);
        let slip = kb.velocity_at(near.on_b) - ka.velocity_at(near.on_a);
        let response = |d| sides.iter().flatten().fold(T::zero(), |sum, s| sum + s.response(d));
        let (response, tangential_response) = (response(n), response(n.perp()));
        let bias = curvature(near, (ka, sa), (kb, sb))
            + n.dot(slip) * (2.0 * STABILISATION_RATE)
            + near.gap * (STABILISATION_RATE * STABILISATION_RATE);
        let rise =
            -(surface_rise(ka, sa, n) + surface_rise(kb, sb, n)) * (T::constant(1.0) - contact.ignore_roll);
        let slip = n.perp().dot(slip);
        let speed = (slip * slip + rise * rise).sqrt_or_zero();
        // Friction opposes the whole slip; that of a rolling ball is mostly vertical.
        let (friction_bound, vertical_friction) = match speed.value() > 0.0 {
            true => (friction * slip.abs() / speed, -(friction * rise / speed)),
            false => (friction, T::zero()),
        };
        let WarmStart { normal_force, tangential_force, slides } = contact.warm_start[end];
        (response.value() > 0.0).then(|| ContactPoint {
            contact: c,
            end,
            sides,
            normal: n,
            response,
            bias,
            normal_force: T::constant(normal_force),
            tangential_response,
            slip,
            friction_bound,
            vertical_friction,
            tangential_force: T::constant(tangential_force),
            slides,
        })
    }

    /// Response of `body`, at position `at` of the island, to a force at `point`.
    fn contact_side(
        &self,
        (island, k): (&[usize], &[Kinematics<T>]),
        (at, body): (usize, usize),
        sign: f64,
        point: Vec2<T>,
    ) -> ContactSide<T> {
        let mode = self.bodies[body].mode();
        let moves = mode.is_moving();
        let arm = point - k[at].position;
        if let Some(cluster) = self.rigid_cluster(body, |j| member_state(island, k, j)).filter(|_| moves) {
            let center = cluster.kinematics.position;
            let position = |j: &usize| island.iter().position(|i| i == j);
            let members = self.bonds.cluster(body).into_iter().flatten().filter_map(position);
            let CollisionBody { inverse_mass: compliance, inverse_inertia, .. } = cluster.collision_body();
            return ContactSide {
                at,
                sign,
                arm,
                cluster_arm: point - center,
                compliance,
                inverse_inertia,
                carried: members.map(|x| (x, k[x].position - center)).collect(),
                ball: None,
                rolls: false,
            };
        }
        let inverse_inertia = if moves { self.dynamics.inverse_inertia[body] } else { T::zero() };
        let shape = &self.dynamics.shapes[body];
        ContactSide {
            at,
            sign,
            arm,
            cluster_arm: arm,
            compliance: self.dynamics.compliance(body, mode),
            inverse_inertia,
            carried: vec![],
            ball: shape.is_ball().then(|| shape.bounding_radius()),
            rolls: mode == Mode::Roll,
        }
    }

    /// Narrowest gap of the island's persistent contacts at these states (m).
    pub(in crate::world) fn narrowest_gap(&self, island: &[usize], k: &[Kinematics<T>]) -> f64 {
        let position = |body: usize| island.iter().position(|&j| j == body);
        let gap = |c: &PersistentContact<T>| {
            let ka = k[position(c.a)?].value();
            let kb = position(c.b).map_or_else(|| self.kinematics(c.b).value(), |y| k[y].value());
            let gap = facing(&ka, self.shape(c.a), &kb, self.shape(c.b)).0.gap;
            Some(gap - self.contact_laws.margin(c.a, c.b).value())
        };
        self.contacts.all().iter().filter_map(gap).fold(f64::INFINITY, f64::min)
    }
}

/// Vertical velocity of a ball's surface where it is touched in direction `n` (m/s).
fn surface_rise<T: Real>(k: &Kinematics<T>, shape: &Shape, n: Vec2<T>) -> T {
    if shape.is_ball() { k.roll.cross(n) * shape.bounding_radius() } else { T::zero() }
}

/// Second derivative of the gap that comes from the velocities alone (m/s^2): centripetal, Coriolis and centrifugal terms. The
/// contact point of a circle is its centre; that of a box is the touching corner or face.
fn curvature<T: Real>(
    near: &Proximity<T>,
    (a, sa): (&Kinematics<T>, &Shape),
    (b, sb): (&Kinematics<T>, &Shape),
) -> T {
    let point = |k: &Kinematics<T>, s: &Shape, on: Vec2<T>| if s.is_round() { k.position } else { on };
    let (pa, pb) = (point(a, sa, near.on_a), point(b, sb, near.on_b));
    let (va, vb) = (a.velocity_at(pa), b.velocity_at(pb));
    let n = near.normal;
    let centripetal = |k: &Kinematics<T>, p: Vec2<T>, n: Vec2<T>| -(n.dot(p - k.position) * k.spin * k.spin);
    let face = |host: &Kinematics<T>, guest: &Kinematics<T>, n: Vec2<T>, p: Vec2<T>, v: Vec2<T>| {
        let w = host.spin;
        centripetal(guest, p, n) + w * n.perp().dot(v - host.velocity) * 2.0
            - w * w * n.dot(p - host.position)
    };
    match near.feature {
        Feature::FaceOfA => face(a, b, n, pb, vb),
        Feature::FaceOfB => face(b, a, -n, pa, va),
        Feature::Points => {
            let across = n.perp().dot(vb - va);
            let span = (pb - pa).norm();
            let swing = if span.value() > 0.0 { across * across / span } else { T::zero() };
            swing + centripetal(b, pb, n) - centripetal(a, pa, n)
        }
    }
}
