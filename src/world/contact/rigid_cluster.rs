//! Several bodies that move as one rigid body.

use crate::num::{Real, Vec2};
use crate::world::contact::impulse::CollisionBody;
use crate::world::motion::kinematics::Kinematics;

/// Several bodies as one rigid body.
pub(in crate::world) struct RigidCluster<T> {
    /// kg.
    pub mass: T,
    /// About z and the common centre (kg m^2).
    pub inertia: T,
    /// Of the common centre.
    pub kinematics: Kinematics<T>,
}

impl<T: Real> RigidCluster<T> {
    /// The rigid body with the momentum and the angular momentum of its parts, each of which has a mass (kg), a moment of
    /// inertia about z (kg m^2) and a motion.
    pub fn of(parts: impl Iterator<Item = (T, T, Kinematics<T>)> + Clone) -> Self {
        let sum = |f: &dyn Fn((T, T, Kinematics<T>)) -> T| parts.clone().map(f).fold(T::zero(), |s, v| s + v);
        let mean = |f: &dyn Fn(Kinematics<T>) -> Vec2<T>, mass: T| {
            let total = parts.clone().fold(Vec2::zero(), |s, (m, _, k)| s + f(k) * m);
            total * (T::constant(1.0) / mass)
        };
        let mass = sum(&|(m, ..)| m);
        let (position, velocity) = (mean(&|k| k.position, mass), mean(&|k| k.velocity, mass));
        let inertia = sum(&|(m, inertia, k)| inertia + m * (k.position - position).norm_squared());
        let angular_momentum = sum(&|(m, inertia, k)| {
            inertia * k.spin + m * (k.position - position).cross(k.velocity - velocity)
        });
        let spin = angular_momentum / inertia;
        let kinematics = Kinematics { position, yaw: T::zero(), velocity, spin, roll: Vec2::zero() };
        RigidCluster { mass, inertia, kinematics }
    }

    /// A cluster of which only the motion matters.
    pub fn moving(kinematics: Kinematics<T>) -> Self {
        RigidCluster { mass: T::zero(), inertia: T::zero(), kinematics }
    }

    /// Gives a part the cluster's motion; it does not roll.
    pub fn carry(&self, part: &mut Kinematics<T>) {
        let Kinematics { position, velocity, spin, .. } = self.kinematics;
        part.velocity = velocity + (part.position - position).perp() * spin;
        part.spin = spin;
        part.roll = Vec2::zero();
    }

    pub fn collision_body(&self) -> CollisionBody<T> {
        let inverse = |v: T| T::constant(1.0) / v;
        CollisionBody {
            kinematics: self.kinematics,
            inverse_mass: inverse(self.mass),
            inverse_inertia: inverse(self.inertia),
            ball: None,
        }
    }
}

/// Removes `share` of the relative motion of two bodies; at 1 they move as one. Momentum and angular momentum are conserved.
pub(in crate::world) fn merge_velocities<T: Real>(
    a: &mut CollisionBody<T>,
    b: &mut CollisionBody<T>,
    share: T,
) {
    let inverse = |v: T| T::constant(1.0) / v;
    let part = |s: &CollisionBody<T>| (inverse(s.inverse_mass), inverse(s.inverse_inertia), s.kinematics);
    let cluster = RigidCluster::of([part(a), part(b)].into_iter());
    for k in [&mut a.kinematics, &mut b.kinematics] {
        let mut joined = *k;
        cluster.carry(&mut joined);
        k.velocity += (joined.velocity - k.velocity) * share;
        k.spin += (joined.spin - k.spin) * share;
        k.roll -= k.roll * share;
    }
}
