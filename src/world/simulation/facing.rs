//! How two bodies face each other at present: gap, approach speed, contact law, restitution.

use crate::body::ContactLaw;
use crate::effects::Scalar;
use crate::world::contact::contact_law::ContactGeometry;
use crate::world::contact::geometry::{OutlinePose, Proximity, manifold};
use crate::world::contact::impulse::{effective_mass, soft_response};
use crate::world::contact::time_of_impact::facing;
use crate::world::motion::kinematics::Kinematics;
use crate::world::simulation::state::Simulation;

/// Contacts slower than this do not rebound (m/s): the hop would be below 0.2 mm.
pub(in crate::world) const REBOUND_SPEED: f64 = 0.01;
/// Gap at which a point of a persistent contact takes part in impulses (m).
pub(in crate::world) const CLOSED: f64 = 1e-5;

/// A body or wall and its state.
type Located<'k, T> = (usize, &'k Kinematics<T>);

impl<T: Scalar> Simulation<'_, T> {
    /// Closest points of two bodies, less their margin, and the rate at which the gap opens (m/s).
    pub(in crate::world) fn facing_now(&self, a: usize, b: usize) -> (Proximity<T>, T) {
        let (ka, kb) = (self.kinematics(a), self.kinematics(b));
        let (near, rate) = facing(ka, self.shape(a), kb, self.shape(b));
        (self.adjusted(near, (a, ka), (b, kb)), rate)
    }

    /// The closest points with the margin of the two, and with the derivatives by the sizes of the outlines.
    pub(in crate::world) fn adjusted(
        &self,
        mut near: Proximity<T>,
        a: Located<T>,
        b: Located<T>,
    ) -> Proximity<T> {
        near.gap -= self.contact_laws.margin(a.0, b.0);
        let growth = |i: usize| match i.checked_sub(self.bodies.len()) {
            Some(wall) => self.walls[wall].growth,
            None => self.dynamics.growth.get(i).copied().unwrap_or_default(),
        };
        let (of_a, of_b) = (growth(a.0), growth(b.0));
        if of_a.is_constant() && of_b.is_constant() {
            return near;
        }
        near.grown((a.1.position, self.shape(a.0), of_a), (b.1.position, self.shape(b.0), of_b))
    }

    /// The points at which two bodies can touch.
    pub(in crate::world) fn points_now(&self, a: usize, b: usize) -> [Option<Proximity<T>>; 2] {
        let (sa, sb) = (self.shape(a), self.shape(b));
        let (ka, kb) = (self.kinematics(a), self.kinematics(b));
        let points = manifold(&OutlinePose::of(ka, sa), sa, &OutlinePose::of(kb, sb), sb);
        points.map(|near| near.map(|near| self.adjusted(near, (a, ka), (b, kb))))
    }

    /// Speed at which the gap closes (m/s).
    pub(in crate::world) fn approach_at(&self, a: usize, b: usize, near: &Proximity<T>) -> T {
        let velocity = |i: usize, point| self.kinematics(i).velocity_at(point);
        near.normal.dot(velocity(a, near.on_a) - velocity(b, near.on_b))
    }

    /// Rate of the gap itself (m/s): of the corner nearest to the face, where two boxes meet.
    pub(in crate::world) fn opening_rate(&self, a: usize, b: usize, near: &Proximity<T>) -> T {
        let velocity = |i: usize| self.kinematics(i).velocity_at(near.lowest);
        near.normal.dot(velocity(b) - velocity(a))
    }

    /// The law of this contact.
    pub(in crate::world) fn contact_law(
        &self,
        a: usize,
        b: usize,
        near: &Proximity<T>,
        approach: T,
    ) -> ContactLaw<T> {
        let body = |i: usize| self.dynamics.body(i, self.bodies[i].state());
        let other = (b < self.bodies.len()).then(|| body(b));
        let point = (near.on_a + near.on_b).scaled(0.5);
        let contact = ContactGeometry { normal: near.normal, point, approach };
        let mut law = self.contact_laws.law((a, b), (body(a), other), &contact);
        if let Some((presence, restitution)) = self.obstacle(a, b) {
            (law.presence, law.restitution) = (presence, restitution);
        }
        law
    }

    /// Effective mass of the contact along its normal (kg).
    pub(in crate::world) fn contact_mass(&self, a: usize, b: usize, near: &Proximity<T>) -> T {
        effective_mass(&self.collision_body(a), &self.collision_body(b), near)
    }

    /// Restitution with its dependence on speed and softness; 0 below [`REBOUND_SPEED`].
    pub(in crate::world) fn restitution(
        &self,
        law: &ContactLaw<T>,
        a: usize,
        b: usize,
        near: &Proximity<T>,
        approach: T,
    ) -> T {
        if approach.value() < REBOUND_SPEED {
            return T::zero();
        }
        let mut e = law.restitution;
        if law.restitution_decay.value() != 0.0 || !law.restitution_decay.is_constant() {
            e *= (-(law.restitution_decay * approach)).exp();
        }
        if law.softness.value() != 0.0 || !law.softness.is_constant() {
            e *= soft_response(law, self.contact_mass(a, b, near)).0;
        }
        e
    }
}
