//! Bodies and contacts: all that an effect may see and change.

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
    /// Turn rate about z (rad/s).
    pub spin: T,
    /// Turn rate about the horizontal axes (rad/s); of balls only.
    pub roll: Vec2<T>,
}

impl<T: Real> Body<T> {
    /// Moment of inertia about z (kg m^2).
    pub fn inertia(&self) -> T {
        self.mass * self.shape.unit_inertia()
    }
}

/// What acts on a body, in two parts. Smooth forces are given as they are; dry friction is
/// set-valued at rest, so an effect gives its *bound* and the world resolves sliding, rolling and rest.
#[derive(Debug, Clone, Copy)]
pub struct Wrench<T> {
    /// Force on the centre of mass (N).
    pub force: Vec2<T>,
    /// Torque about z (N m).
    pub torque: T,
    /// Most dry friction of the ground at the foot (N).
    pub grip: T,
    /// Lever (m) and angle (rad) by which the friction of a sliding foot is off the centre of mass and askew.
    pub lever: T,
    pub skew: T,
    /// Share by which a box stands more on one diagonal of its corners than on the other, -1..=1.
    pub rock: T,
    /// How much nearer to its middle than rim and corners a foot carries the weight, as a share of its size, -1..=0.
    pub foot: T,
    /// Most resistance to rolling, as a force at a ball's centre (N).
    pub rolling: T,
    /// Torque against the turn of a ball about the horizontal axes while its foot slides (N m).
    pub turning: T,
    /// Rate at which velocities and spins decay (1/s), whatever holds the body.
    pub damping: T,
    /// The same of spins, on top of that (1/s).
    pub spin_damping: T,
    /// Most friction torque about z on top of what `grip` does over the footprint (N m).
    pub pivot: T,
    /// Share by which the ground's dry friction is larger where the body is.
    pub excess: T,
}

impl<T: Real> Wrench<T> {
    #[inline(always)]
    pub fn zero() -> Self {
        let zero = T::zero();
        Wrench {
            force: Vec2::zero(),
            torque: zero,
            grip: zero,
            lever: zero,
            skew: zero,
            rock: zero,
            foot: zero,
            rolling: zero,
            turning: zero,
            damping: zero,
            spin_damping: zero,
            pivot: zero,
            excess: zero,
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
    /// Where they touch (m).
    pub point: Vec2<T>,
    /// Approach speed of the touching points along the normal (m/s), positive.
    pub approach: T,
}

/// The law of one contact. Effects shape it; the world turns it into impulses.
#[derive(Debug, Clone, Copy)]
pub struct ContactLaw<T> {
    /// Ratio of separation to approach speed, 0..=1.
    pub restitution: T,
    /// Coulomb coefficient between the surfaces.
    pub friction: T,
    /// Rate at which restitution falls with the approach speed (s/m).
    pub fading: T,
    /// One over the root of the surfaces' stiffness ((m/N)^0.5), and their damping (N s/m).
    pub softness: T,
    pub damping: T,
    /// Share of the blow that is given: below 1 the contact is with something that may not be there.
    pub presence: T,
    /// How far above a ball's centre a wall touches it, in radii.
    pub edge: T,
    /// Share of the slip that comes back reversed where friction holds; below 0: that is left.
    pub shear: T,
    /// Share of a ball's rolling that does not rub: 1 where contacts know the plane only.
    pub planar: T,
    /// Share of two bodies' relative motion that the blow takes; from 1 on they stick together.
    pub stick: T,
    /// One over the pull that parts bodies that stick (1/N); 0: nothing does.
    pub weakness: T,
}

impl<T: Real> ContactLaw<T> {
    /// Plastic and frictionless: what happens where no effect says otherwise.
    pub fn plain() -> Self {
        let zero = T::zero();
        ContactLaw {
            restitution: zero,
            friction: zero,
            fading: zero,
            softness: zero,
            damping: zero,
            presence: T::constant(1.0),
            edge: zero,
            shear: zero,
            planar: zero,
            stick: zero,
            weakness: zero,
        }
    }
}

/// Something static that the scene does not show.
#[derive(Debug, Clone, Copy)]
pub struct Obstacle<T> {
    /// How events call it.
    pub name: &'static str,
    pub outline: Outline<T>,
    /// 0 lets bodies through, 1 is solid.
    pub presence: T,
    /// Ratio of separation to approach speed, whatever hits it.
    pub restitution: T,
}

/// Outline of an [`Obstacle`].
#[derive(Debug, Clone, Copy)]
pub enum Outline<T> {
    /// All that lies behind the line `x.n = offset` (m), n the unit vector at `angle` (rad).
    HalfPlane { offset: T, angle: T },
    /// m.
    Disc { center: Vec2<T>, radius: T },
}

/// What a body is really like, as factors of what is believed.
#[derive(Debug, Clone, Copy)]
pub struct Matter<T> {
    pub mass: T,
    /// Of all lengths of its outline.
    pub size: T,
}

/// What the camera reports of a body.
#[derive(Debug, Clone, Copy)]
pub struct View<T> {
    /// m.
    pub position: Vec2<T>,
    /// rad.
    pub yaw: T,
}
