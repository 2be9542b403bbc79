//! Static bodies: walls of the model, and obstacles that an effect supposes.

use crate::body::{Obstacle, ObstacleShape};
use crate::effects::{Hook, Scalar};
use crate::num::{Vec2, elementary};
use crate::scene::Shape;
use crate::world::model::Model;
use crate::world::motion::kinematics::Kinematics;
use std::f64::consts::{FRAC_PI_2, PI};

/// Half the side of the square that represents a half plane (m): larger than any scene.
const HALF_PLANE: f64 = 100.0;

/// Something static that bodies collide with.
pub(in crate::world) struct StaticBody<T> {
    pub name: String,
    pub shape: Shape,
    pub state: Kinematics<T>,
    /// Relative growth of the outline. Its value is zero, it carries derivatives.
    pub growth: T,
    /// Presence and restitution of an obstacle for each body. Empty for a wall, which follows the contact laws.
    pub obstacle: Option<Vec<(T, T)>>,
}

impl<T: Scalar> StaticBody<T> {
    /// All of the model. An obstacle without presence and without derivatives is left out.
    pub fn all(model: &Model, flat: &[T]) -> Vec<Self> {
        let walls = model.walls.iter().map(|w| {
            let along = w.to - w.from;
            let state = Kinematics::at_rest((w.from + w.to).scaled(0.5), elementary::atan2(along.y, along.x));
            StaticBody {
                name: w.name.clone(),
                shape: Shape::Rectangle { half_length: 0.5 * along.norm(), half_width: 0.0 },
                state: Kinematics::constant(&state),
                growth: T::zero(),
                obstacle: None,
            }
        });
        let mut all: Vec<Self> = walls.collect();
        let Some(any) = model.bodies.first() else { return all };
        for (active, entry, first) in model.active().filter(|(_, e, _)| e.uses(Hook::Bodies)) {
            let for_body = |body| (T::hooks(entry).bodies)(&active.values_for(first, flat, body, body));
            let is_there = |o: &Obstacle<T>| o.presence.value() > 0.0 || !o.presence.is_constant();
            let each: Vec<(T, T)> =
                model.bodies.iter().filter_map(for_body).map(|o| (o.presence, o.restitution)).collect();
            all.extend(for_body(any).filter(is_there).into_iter().flat_map(|o| Self::of_obstacle(o, &each)));
        }
        all
    }

    fn of_obstacle(obstacle: Obstacle<T>, each: &[(T, T)]) -> Vec<Self> {
        let half_plane = |offset: T, angle: T| {
            let centre = Vec2::from_angle(angle) * (offset - HALF_PLANE);
            (Shape::Square { half_side: HALF_PLANE }, Kinematics::at_rest(centre, angle), T::zero())
        };
        let parts = match obstacle.outline {
            ObstacleShape::HalfPlane { offset, angle } => vec![half_plane(offset, angle)],
            ObstacleShape::Disc { center, radius } => {
                let shape = Shape::Disc { radius: radius.value() };
                let growth = (radius / radius.value()).infinitesimal();
                vec![(shape, Kinematics::at_rest(center, T::zero()), growth)]
            }
            // The normals point inwards.
            ObstacleShape::Inside { x, y } => {
                [(x[0], 0.0), (-x[1], PI), (y[0], FRAC_PI_2), (-y[1], -FRAC_PI_2)]
                    .map(|(offset, angle)| half_plane(offset, T::constant(angle)))
                    .to_vec()
            }
        };
        let body = |(shape, state, growth)| {
            let name = obstacle.name.to_string();
            StaticBody { name, shape, state, growth, obstacle: Some(each.to_vec()) }
        };
        parts.into_iter().map(body).collect()
    }
}
