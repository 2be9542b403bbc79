//! Writes a scene as an `observed.json`: CLEVRER's annotation with our optional keys, as `parse` reads it.

use crate::scene::object::{Object, Shape};
use crate::scene::observation::Scene;
use serde_json::{Map, Value, json};

/// The scene as a JSON file. A box that is not a cube is written as a cube of its half width, as the format has no box.
pub fn observed_json(scene: &Scene) -> Value {
    let mut root = Map::new();
    root.insert("video_filename".into(), scene.name.clone().into());
    root.insert("world".into(), scene.world.name().into());
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
        // Without the key, `parse` takes CLEVRER's camera for a CLEVRER scene.
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
    if let Some(layout) = &scene.feature_layout {
        root.insert("feature_layout".into(), layout.clone().into());
    }
    root.insert(
        "object_property".into(),
        scene.objects.iter().chain(&scene.absent).map(object_property).collect(),
    );
    let frame = |(f, objects)| json!({ "frame_id": f, "objects": Value::Array(objects) });
    root.insert("motion_trajectory".into(), frames(scene).into_iter().enumerate().map(frame).collect());
    Value::Object(root)
}

fn object_property(object: &Object) -> Value {
    let (shape, size) = match object.shape {
        Shape::Disc { radius } => ("cylinder", radius),
        Shape::Ball { radius } => ("sphere", radius),
        Shape::Square { half_side } => ("cube", half_side),
        Shape::Rectangle { half_width, .. } => ("cube", half_width),
    };
    let mut entry = json!({"object_id": object.id, "color": object.color, "material": object.material, "shape": shape,
        "size": size});
    if let Some(mass) = object.mass {
        entry["mass"] = mass.into();
    }
    if !object.features.is_empty() {
        entry["features"] = json!(object.features);
    }
    entry
}

/// The entries of each frame, outliers included: they are found again on reading.
fn frames(scene: &Scene) -> Vec<Vec<Value>> {
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
    frames
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Covariance, parse};

    #[test]
    fn a_written_scene_reads_back_equal() {
        let text = include_str!("../../../tests/data/clevrer/scene_00022/observed.json");
        let mut scene = parse("scene", text).unwrap();
        scene.tracks[0].samples[3].covariance = Some(Covariance { xx: 1e-4, xy: -2e-5, yy: 3e-4 });
        scene.times[5] += 0.003;
        scene.setup = Some("bench".into());
        scene.objects[1].features = vec![0.1, -2.5e-7, 3.0];
        scene.feature_layout = Some("network-3".into());
        assert_eq!(parse("scene", &observed_json(&scene).to_string()).unwrap(), scene);
        scene.camera = None;
        scene.tracks[0].samples[5].position.x += 1.0;
        let scene = scene.validate().unwrap();
        assert_eq!(scene.outliers.len(), 1);
        assert_eq!(parse("scene", &observed_json(&scene).to_string()).unwrap(), scene);
    }
}
