//! Reads files of points with known coordinates in the image and in the world.

use crate::scene::camera::lens_pose::PointPair;
use crate::scene::camera::projection::CLEVRER_CAMERA;
use crate::scene::limits::DEFAULT_SIZE;
use crate::scene::violations::{SceneError, SceneViolations};
use serde_json::Value;

/// Pairs of a file, and the width and height of the image (px). There are three kinds of file:
/// - `{"image_size": [w, h], "pairs": [{"image": [u, v], "world": [x, y, z]}]}` (z is 0 where it is left out);
/// - `{"image_size", "table": {"x": [lo, hi], "y": [lo, hi]}, "corners": [[u, v] x 4]}`, with the corners in the order
///   (x lo, y lo), (x hi, y lo), (x hi, y hi), (x lo, y hi);
/// - a scene whose objects have `location` and `image_center`; without `image_size` that of CLEVRER's videos.
pub fn parse_pairs(text: &str) -> Result<(Vec<PointPair>, [f64; 2]), SceneError> {
    let mut r = SceneViolations::default();
    let root: Value = serde_json::from_str(text.trim_start_matches('\u{feff}')).unwrap_or_else(|error| {
        r.add("(file)", format!("is not JSON: {error}"));
        Value::Null
    });
    let scene = root.get("motion_trajectory").is_some();
    let size = match numbers(&root["image_size"])[..] {
        [w, h] => [w, h],
        _ => {
            if !scene && !root.is_null() {
                r.add("image_size", "is missing; give [width, height] in pixels");
            }
            CLEVRER_CAMERA.image_size
        }
    };
    let pairs = if let Some(list) = root["pairs"].as_array() {
        from_list(list, &mut r)
    } else if let Some(corners) = root["corners"].as_array() {
        from_corners(&root["table"], corners, &mut r)
    } else if scene {
        let pairs = from_scene(&root);
        if pairs.is_empty() {
            r.add(
                "motion_trajectory",
                "has no object with both location and image_center; give both for some objects",
            );
        }
        pairs
    } else {
        if !root.is_null() {
            r.add(
                "(file)",
                "has no points; give pairs, or table and corners, or a motion_trajectory with image_center",
            );
        }
        vec![]
    };
    r.finish()?;
    Ok((pairs, size))
}

fn from_list(list: &[Value], r: &mut SceneViolations) -> Vec<PointPair> {
    let mut pairs = vec![];
    for (i, one) in list.iter().enumerate() {
        match (&numbers(&one["image"])[..], &numbers(&one["world"])[..]) {
            ([u, v], [x, y, rest @ ..]) if rest.len() < 2 => {
                let z = rest.first().copied().unwrap_or(0.0);
                pairs.push(PointPair { image: [*u, *v], world: [*x, *y, z] });
            }
            ([_, _], _) => {
                r.add(format!("pairs[{i}].world"), "is not a point; give [x, y] or [x, y, z] in metres");
            }
            _ => r.add(format!("pairs[{i}].image"), "is not a point; give [u, v] in pixels"),
        }
    }
    pairs
}

fn from_corners(table: &Value, corners: &[Value], r: &mut SceneViolations) -> Vec<PointPair> {
    let mut pairs = vec![];
    let (x, y) = (numbers(&table["x"]), numbers(&table["y"]));
    let ([x0, x1], [y0, y1]) = (&x[..], &y[..]) else {
        r.add("table", "is not a table; give {\"x\": [low, high], \"y\": [low, high]} in metres");
        return pairs;
    };
    if corners.len() != 4 {
        r.add("corners", format!("has {} corners; give 4", corners.len()));
    }
    let world = [[*x0, *y0], [*x1, *y0], [*x1, *y1], [*x0, *y1]];
    for (i, (corner, [x, y])) in corners.iter().zip(world).enumerate() {
        match numbers(corner)[..] {
            [u, v] => pairs.push(PointPair { image: [u, v], world: [x, y, 0.0] }),
            _ => r.add(format!("corners[{i}]"), "is not a point; give [u, v] in pixels"),
        }
    }
    pairs
}

/// The numbers of a list.
fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().map(|list| list.iter().filter_map(Value::as_f64).collect()).unwrap_or_default()
}

/// Centres of the objects, at the height of their size.
fn from_scene(root: &Value) -> Vec<PointPair> {
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let objects = list(&root["object_property"]);
    let height = |id: &Value| {
        let own = objects.iter().find(|o| o["object_id"] == *id);
        own.and_then(|o| o["size"].as_f64()).unwrap_or(DEFAULT_SIZE)
    };
    let mut pairs = vec![];
    for object in list(&root["motion_trajectory"]).iter().flat_map(|frame| list(&frame["objects"])) {
        if object["inside_camera_view"] == Value::Bool(false) {
            continue;
        }
        if let ([u, v], [x, y, ..]) =
            (&numbers(&object["image_center"])[..], &numbers(&object["location"])[..])
        {
            pairs.push(PointPair { image: [*u, *v], world: [*x, *y, height(&object["object_id"])] });
        }
    }
    pairs
}
