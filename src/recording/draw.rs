//! Pose, shape and colour of an object in Foxglove's schemas, for viewers.

use super::messages::foxglove as fox;
use crate::num::{Vec2, elementary};
use crate::scene::Shape;
use prost_types::Timestamp;

pub fn pose(position: Vec2, shape: &Shape, yaw: f64) -> fox::Pose {
    let position = fox::Vector3 { x: position.x, y: position.y, z: shape.centre_height() };
    let orientation =
        fox::Quaternion { x: 0.0, y: 0.0, z: elementary::sin(0.5 * yaw), w: elementary::cos(0.5 * yaw) };
    fox::Pose { position: Some(position), orientation: Some(orientation) }
}

/// The shape of an object in its own frame of reference, which the transforms move.
pub fn entity(
    frame: &str,
    shape: &Shape,
    color: fox::Color,
    timestamp: Option<Timestamp>,
) -> fox::SceneEntity {
    let (pose, color) = (Some(fox::Pose::default()), Some(color));
    let size = |x: f64, y: f64| Some(fox::Vector3 { x, y, z: 2.0 * shape.centre_height() });
    let mut entity = fox::SceneEntity {
        timestamp,
        frame_id: frame.into(),
        id: frame.into(),
        frame_locked: true,
        ..Default::default()
    };
    match *shape {
        Shape::Disc { radius } => entity.cylinders.push(fox::CylinderPrimitive {
            pose,
            size: size(2.0 * radius, 2.0 * radius),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color,
        }),
        Shape::Ball { radius } => {
            entity.spheres.push(fox::SpherePrimitive { pose, size: size(2.0 * radius, 2.0 * radius), color });
        }
        Shape::Square { half_side: a } => {
            entity.cubes.push(fox::CubePrimitive { pose, size: size(2.0 * a, 2.0 * a), color });
        }
        Shape::Rectangle { half_length: a, half_width: b } => {
            entity.cubes.push(fox::CubePrimitive { pose, size: size(2.0 * a, 2.0 * b), color });
        }
    }
    entity
}

/// CLEVRER's colour words as RGB; grey for any other.
pub fn color(word: &str) -> fox::Color {
    let [r, g, b] = match word {
        "red" => [0.68, 0.14, 0.14],
        "blue" => [0.16, 0.29, 0.84],
        "green" => [0.11, 0.41, 0.08],
        "brown" => [0.51, 0.29, 0.10],
        "purple" => [0.51, 0.15, 0.75],
        "cyan" => [0.16, 0.82, 0.82],
        "yellow" => [1.0, 0.93, 0.20],
        _ => [0.5, 0.5, 0.5],
    };
    fox::Color { r, g, b, a: 1.0 }
}
