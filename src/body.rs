//! Bodies and contacts: all that an effect may read and change.

use crate::num::{Real, Vec2};
use crate::scene::Shape;

/// Standard gravity (m/s^2), as the paper takes it.
pub const GRAVITY: f64 = 9.81;

/// One body at one instant. The spin vector is `(roll.x, roll.y, spin)`.
#[derive(Debug, Clone, Copy)]
pub struct Body<T> {
    pub shape: Shape,
    /// kg.
    pub mass: T,
    /// m.
    pub position: Vec2<T>,
    /// rad.
    pub yaw: T,
    /// m/s.
    pub velocity: Vec2<T>,
    /// Angular velocity about z (rad/s).
    pub spin: T,
    /// Angular velocity about the horizontal axes (rad/s); of balls only.
    pub roll: Vec2<T>,
}

impl<T: Real> Body<T> {
    /// Moment of inertia about z (kg m^2).
    pub fn inertia(&self) -> T {
        self.mass * self.shape.unit_inertia()
    }
}

/// What acts on a body, in two parts. Smooth forces are given as they are. Dry friction is
/// set-valued at rest, so an effect gives its *bound*; the world resolves sliding, rolling and rest.
#[derive(Debug, Clone, Copy)]
pub struct Wrench<T> {
    /// Force on the centre of mass (N).
    pub force: Vec2<T>,
    /// Torque about z (N m).
    pub torque: T,
    /// Largest dry friction force of the ground on the contact patch (N).
    pub friction_limit: T,
    /// Arm (m) at which the friction of a sliding patch acts beside the centre of mass.
    pub friction_arm: T,
    /// Angle (rad) between the friction of a sliding patch and the direction opposite to the velocity.
    pub friction_skew: T,
    /// Share by which a box loads one diagonal of its corners more than the other, -1..=1.
    pub diagonal_load: T,
    /// How much nearer to the centre than rim and corners the patch carries the weight, as a share of its size, -1..=0.
    pub load_concentration: T,
    /// Largest rolling resistance, as a force at a ball's centre (N).
    pub rolling_resistance: T,
    /// Torque against the rotation of a ball about the horizontal axes while it slides on the ground (N m).
    pub rolling_torque: T,
    /// Rate at which velocities and spins decay (1/s), independent of friction.
    pub damping: T,
    /// Rate at which spins decay in addition (1/s).
    pub spin_damping: T,
    /// Largest friction torque about z in addition to that of `friction_limit` over the patch (N m).
    pub spin_friction_limit: T,
    /// Relative increase of the ground's dry friction where the body is.
    pub friction_excess: T,
}

impl<T: Real> Wrench<T> {
    #[inline(always)]
    pub fn zero() -> Self {
        let zero = T::zero();
        Wrench {
            force: Vec2::zero(),
            torque: zero,
            friction_limit: zero,
            friction_arm: zero,
            friction_skew: zero,
            diagonal_load: zero,
            load_concentration: zero,
            rolling_resistance: zero,
            rolling_torque: zero,
            damping: zero,
            spin_damping: zero,
            spin_friction_limit: zero,
            friction_excess: zero,
        }
    }
}

/// Two bodies, or a body and a wall (`b` is `None`), at the instant of touching.
#[derive(Debug, Clone, Copy)]
pub struct Contact<T> {
    pub a: Body<T>,
    pub b: Option<Body<T>>,
    /// Unit normal from a to b.
    pub normal: Vec2<T>,
    /// Contact point (m).
    pub point: Vec2<T>,
    /// Approach speed of the touching points along the normal (m/s), positive.
    pub approach: T,
}

/// The law of one contact. Effects set its parameters; the world turns it into impulses.
#[derive(Debug, Clone, Copy)]
pub struct ContactLaw<T> {
    /// Ratio of separation to approach speed, 0..=1.
    pub restitution: T,
    /// Coulomb coefficient between the surfaces.
    pub friction: T,
    /// Rate at which the restitution decays with the approach speed (s/m).
    pub restitution_decay: T,
    /// Inverse square root of the surfaces' stiffness ((m/N)^0.5).
    pub softness: T,
    /// Damping of the surfaces (N s/m).
    pub damping: T,
    /// Share of the impulse that is applied; below 1 the other side is a hypothetical obstacle.
    pub presence: T,
    /// Height above a ball's centre at which a wall touches it, in radii.
    pub contact_height: T,
    /// Share of the tangential slip that is reversed where friction holds; a negative value is the share that remains.
    pub tangential_restitution: T,
    /// Share of a ball's roll that contact friction ignores: 1 in engines whose contacts are purely planar.
    pub ignore_roll: T,
    /// Share of the relative motion of two bodies that the impulse removes; from 1 on they stick together.
    pub stick: T,
    /// Inverse of the pull that separates bodies that stick (1/N); 0: no pull does.
    pub inverse_strength: T,
}

impl<T: Real> ContactLaw<T> {
    /// Plastic and frictionless: the law where no effect sets another.
    pub fn plain() -> Self {
        let zero = T::zero();
        ContactLaw {
            restitution: zero,
            friction: zero,
            restitution_decay: zero,
            softness: zero,
            damping: zero,
            presence: T::constant(1.0),
            contact_height: zero,
            tangential_restitution: zero,
            ignore_roll: zero,
            stick: zero,
            inverse_strength: zero,
        }
    }
}

/// A static body that the scene does not show.
#[derive(Debug, Clone, Copy)]
pub struct Obstacle<T> {
    /// Its name in events.
    pub name: &'static str,
    pub outline: ObstacleShape<T>,
    /// 0 lets bodies through, 1 is solid.
    pub presence: T,
    /// Ratio of separation to approach speed for every body.
    pub restitution: T,
}

/// Outline of an [`Obstacle`].
#[derive(Debug, Clone, Copy)]
pub enum ObstacleShape<T> {
    /// All that lies behind the line `x.n = offset` (m), n the unit vector at `angle` (rad).
    HalfPlane { offset: T, angle: T },
    /// m.
    Disc { center: Vec2<T>, radius: T },
    /// All that lies outside a rectangle: its least and greatest coordinates (m).
    Inside { x: [T; 2], y: [T; 2] },
}

/// True mass and size of a body, as factors of the values that the model gives.
#[derive(Debug, Clone, Copy)]
pub struct BodyCorrection<T> {
    pub mass: T,
    /// Of all lengths of its outline.
    pub size: T,
}

/// What the camera reports of a body.
#[derive(Debug, Clone, Copy)]
pub struct Observation<T> {
    /// m.
    pub position: Vec2<T>,
    /// rad.
    pub yaw: T,
}
