//! What stands still: walls of the model, and obstacles that an effect supposes.

use super::model::Model;
use super::motion::Kinematics;
use crate::body::{Obstacle, ObstacleShape};
use crate::effects::{Hook, Scalar};
use crate::num::{Real, Vec2, vec2};
use crate::scene::Shape;

/// Half the side of the square that stands for a half plane (m): larger than any scene.
const HALF_PLANE: f64 = 100.0;

/// Something static that bodies run into.
pub(super) struct Static<T> {
    pub name: String,
    pub shape: Shape,
    pub place: Kinematics<T>,
    /// Relative growth of the outline: derivatives only.
    pub growth: T,
    /// Presence and restitution of an obstacle for each body; a wall takes part in the contact laws as bodies do.
    pub obstacle: Option<Vec<(T, T)>>,
}

impl<T: Scalar> Static<T> {
    /// All of the model; an obstacle that is absent, with its derivatives, is not there.
    pub fn all(model: &Model, flat: &[T]) -> Vec<Self> {
        let walls = model.walls.iter().map(|w| {
            let along = w.to - w.from;
            let place = still((w.from + w.to).scaled(0.5), along.y.atan2(along.x));
            Static {
                name: w.name.clone(),
                shape: Shape::Rectangle { half_length: 0.5 * along.norm(), half_width: 0.0 },
                place: Kinematics::constant(&place),
                growth: T::zero(),
                obstacle: None,
            }
        });
        let mut all: Vec<Self> = walls.collect();
        let Some(any) = model.bodies.first() else { return all };
        for (active, entry, first) in model.active().filter(|(_, e, _)| e.uses(Hook::Bodies)) {
            let met_by = |body| (T::hooks(entry).bodies)(&active.values_for(first, flat, body, body));
            let there = |o: &Obstacle<T>| o.presence.value() > 0.0 || !o.presence.is_constant();
            let each = model.bodies.iter().filter_map(met_by).map(|o| (o.presence, o.restitution)).collect();
            all.extend(met_by(any).filter(there).map(|o| Self::of(o, each)));
        }
        all
    }

    fn of(obstacle: Obstacle<T>, each: Vec<(T, T)>) -> Self {
        let (shape, place, growth) = match obstacle.outline {
            ObstacleShape::HalfPlane { offset, angle } => {
                let shape = Shape::Square { half_side: HALF_PLANE };
                (shape, still(Vec2::from_angle(angle) * (offset - HALF_PLANE), angle), T::zero())
            }
            ObstacleShape::Disc { center, radius } => {
                let shape = Shape::Disc { radius: radius.value() };
                (shape, still(center, T::zero()), (radius / radius.value()).infinitesimal())
            }
        };
        let name = obstacle.name.to_string();
        Static { name, shape, place, growth, obstacle: Some(each) }
    }
}

fn still<T: Real>(position: Vec2<T>, yaw: T) -> Kinematics<T> {
    let none = vec2(T::zero(), T::zero());
    Kinematics { position, yaw, velocity: none, spin: T::zero(), roll: none }
}
