//! Writes a scene as an `observed.json`: CLEVRER's annotation with our keys, as `parse` reads it.

use super::{Scene, Shape, WorldKind};
use serde_json::{Map, Value, json};

/// The scene file. A box that is no cube is written as a cube of its half width: the file knows no other.
pub fn observed_json(scene: &Scene) -> Value {
    let mut root = Map::new();
    let world = match scene.world {
        WorldKind::Clevrer => "clevrer",
        WorldKind::Table => "table",
        WorldKind::AirTable => "air_table",
        WorldKind::Billiards => "billiards",
    };
    root.insert("video_filename".into(), scene.name.clone().into());
    root.insert("world".into(), world.into());
    root.insert("fps".into(), scene.fps.into());
    let regular = |(f, t): (usize, &f64)| (t - f as f64 / scene.fps).abs() < 1e-9;
    if !scene.times.iter().enumerate().all(regular) {
        root.insert("times".into(), json!(scene.times));
    }
    if let Some(setup) = &scene.setup {
        root.insert("setup".into(), setup.clone().into());
    }
    match &scene.camera {
        Some(camera) => {
            root.insert("camera_matrix".into(), json!(camera.matrix));
            root.insert("image_size".into(), json!(camera.image_size));
        }
        // Without the key, a CLEVRER scene has CLEVRER's camera.
        None => {
            root.insert("camera_matrix".into(), Value::Null);
        }
    }
    if let Some(table) = &scene.table {
        root.insert("table".into(), json!({ "x": table.x, "y": table.y }));
    }
    if let Some(sigma) = scene.noise_sigma {
        root.insert("noise_sigma".into(), sigma.into());
    }
    let object = |o: &super::Object| {
        let (shape, size) = match o.shape {
            Shape::Disc { radius } => ("cylinder", radius),
            Shape::Ball { radius } => ("sphere", radius),
            Shape::Square { half_side } => ("cube", half_side),
            Shape::Rectangle { half_width, .. } => ("cube", half_width),
        };
        let mut entry = json!({"object_id": o.id, "color": o.color, "material": o.material, "shape": shape, "size": size});
        if let Some(mass) = o.mass {
            entry["mass"] = mass.into();
        }
        entry
    };
    root.insert("object_property".into(), scene.objects.iter().map(object).collect());
    let mut frames: Vec<Vec<Value>> = vec![vec![]; scene.times.len()];
    for (index, object) in scene.objects.iter().enumerate() {
        let height = object.shape.centre_height();
        for sample in scene.all_samples(index) {
            let mut seen = json!({"object_id": object.id, "location": [sample.position.x, sample.position.y, height],
                "inside_camera_view": true});
            if let Some(yaw) = sample.yaw {
                seen["orientation"] = json!([0.0, 0.0, yaw]);
            }
            if let Some(c) = sample.covariance {
                seen["covariance"] = json!([c.xx, c.xy, c.yy]);
            }
            if let Some(frame) = frames.get_mut(sample.frame) {
                frame.push(seen);
            }
        }
    }
    let frame = |(f, objects)| json!({ "frame_id": f, "objects": Value::Array(objects) });
    root.insert("motion_trajectory".into(), frames.into_iter().enumerate().map(frame).collect());
    Value::Object(root)
}

#[cfg(test)]
mod tests {
    use super::super::{Covariance, parse};
    use super::*;

    #[test]
    fn what_is_written_is_read_as_it_was() {
        let text = include_str!("../../tests/data/clevrer/scene_00022/observed.json");
        let mut scene = parse("scene", text).unwrap();
        scene.tracks[0].samples[3].covariance = Some(Covariance { xx: 1e-4, xy: -2e-5, yy: 3e-4 });
        scene.times[5] += 0.003;
        scene.setup = Some("bench".into());
        assert_eq!(parse("scene", &observed_json(&scene).to_string()).unwrap(), scene);
        scene.camera = None;
        scene.tracks[0].samples[5].position.x += 1.0;
        let scene = scene.validate().unwrap();
        assert_eq!(scene.outliers.len(), 1);
        assert_eq!(parse("scene", &observed_json(&scene).to_string()).unwrap(), scene);
    }
}
