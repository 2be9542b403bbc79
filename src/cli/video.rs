//! A scene as the message that posts it.

use crate::api::v1;
use crate::scene::{Scene, Shape, WorldKind};

/// The video that a service is given.
pub fn video(scene: &Scene) -> v1::Video {
    let objects = scene.objects.iter().zip(&scene.tracks).map(|(object, track)| v1::Object {
        id: object.id,
        color: object.color.clone(),
        material: object.material.clone(),
        shape: Some(shape(&object.shape)),
        mass: object.mass,
        samples: track
            .samples
            .iter()
            .map(|s| v1::Sample {
                frame: s.frame as u32,
                place: Some(v1::sample::Place::Position(v1::Vector { x: s.position.x, y: s.position.y })),
                yaw: s.yaw,
            })
            .collect(),
    });
    let world = match scene.world {
        WorldKind::Clevrer => v1::World::Clevrer,
        WorldKind::Table => v1::World::Table,
        WorldKind::AirTable => v1::World::AirTable,
        WorldKind::Billiards => v1::World::Billiards,
    };
    v1::Video {
        name: String::new(),
        display_name: scene.name.clone(),
        setup: scene.setup.clone().unwrap_or_default(),
        world: world as i32,
        fps: scene.fps,
        times: scene.times.clone(),
        camera: scene.camera.map(|c| v1::Camera {
            matrix: c.matrix.iter().flatten().copied().collect(),
            image_width: c.image_size[0],
            image_height: c.image_size[1],
        }),
        table: scene.table.map(|t| v1::Table { x_min: t.x[0], x_max: t.x[1], y_min: t.y[0], y_max: t.y[1] }),
        noise_sigma: scene.noise_sigma,
        objects: objects.collect(),
    }
}

fn shape(shape: &Shape) -> v1::Shape {
    use v1::shape::{Ball, Disc, Kind, Rectangle, Square};
    let kind = match *shape {
        Shape::Disc { radius } => Kind::Disc(Disc { radius }),
        Shape::Ball { radius } => Kind::Ball(Ball { radius }),
        Shape::Square { half_side } => Kind::Square(Square { half_side }),
        Shape::Rectangle { half_length, half_width } => {
            Kind::Rectangle(Rectangle { half_length, half_width })
        }
    };
    v1::Shape { kind: Some(kind) }
}
