//! Reads files of points whose place is known in the image and in the world.

use super::calibrate::PointPair;
use super::validate::Report;
use super::{DEFAULT_SIZE, SceneError};
use serde_json::Value;

/// Width and height of CLEVRER's videos (px), which its scene files leave out.
const IMAGE_SIZE: [f64; 2] = [480.0, 320.0];

/// Pairs of a file, and the width and height of the image (px). Three kinds of file are read:
/// `{"image_size": [w, h], "pairs": [{"image": [u, v], "world": [x, y, z]}]}` (z 0 where it is left out);
/// `{"image_size", "table": {"x": [lo, hi], "y": [lo, hi]}, "corners": [[u, v] x 4]}`, the corners in the order (x lo, y lo),
/// (x hi, y lo), (x hi, y hi), (x lo, y hi); and a scene whose objects have `location` and `image_center`.
pub fn parse_pairs(text: &str) -> Result<(Vec<PointPair>, [f64; 2]), SceneError> {
    let mut r = Report::default();
    let root: Value = serde_json::from_str(text.trim_start_matches('\u{feff}')).unwrap_or_else(|error| {
        r.add("(file)", format!("is no JSON: {error}"));
        Value::Null
    });
    let mut pairs = vec![];
    let scene = root.get("motion_trajectory").is_some();
    let size = match numbers(&root["image_size"])[..] {
        [w, h] => [w, h],
        _ => {
            if !scene && !root.is_null() {
                r.add("image_size", "is missing; give [width, height] in pixels");
            }
            IMAGE_SIZE
        }
    };
    if let Some(list) = root["pairs"].as_array() {
        for (i, one) in list.iter().enumerate() {
            match (&numbers(&one["image"])[..], &numbers(&one["world"])[..]) {
                ([u, v], [x, y, rest @ ..]) if rest.len() < 2 => {
                    let z = rest.first().copied().unwrap_or(0.0);
                    pairs.push(PointPair { image: [*u, *v], world: [*x, *y, z] });
                }
                ([_, _], _) => r.add(format!("pairs[{i}].world"), "is not [x, y] or [x, y, z] in metres"),
                _ => r.add(format!("pairs[{i}].image"), "is not [u, v] in pixels"),
            }
        }
    } else if let Some(corners) = root["corners"].as_array() {
        let (x, y) = (numbers(&root["table"]["x"]), numbers(&root["table"]["y"]));
        let ([x0, x1], [y0, y1]) = (&x[..], &y[..]) else {
            r.add("table", "is not {\"x\": [low, high], \"y\": [low, high]} in metres");
            r.finish()?;
            return Ok((vec![], size));
        };
        if corners.len() != 4 {
            r.add("corners", format!("has {} corners; give 4", corners.len()));
        }
        let world = [[*x0, *y0], [*x1, *y0], [*x1, *y1], [*x0, *y1]];
        for (i, (corner, [x, y])) in corners.iter().zip(world).enumerate() {
            match numbers(corner)[..] {
                [u, v] => pairs.push(PointPair { image: [u, v], world: [x, y, 0.0] }),
                _ => r.add(format!("corners[{i}]"), "is not [u, v] in pixels"),
            }
        }
    } else if scene {
        pairs = of_scene(&root);
        if pairs.is_empty() {
            r.add("motion_trajectory", "has no object with both location and image_center");
        }
    } else if !root.is_null() {
        r.add("(file)", "has neither pairs, nor corners, nor a motion_trajectory with image_center");
    }
    r.finish()?;
    Ok((pairs, size))
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().map(|list| list.iter().filter_map(Value::as_f64).collect()).unwrap_or_default()
}

/// Centres of the objects: at the height that their size says.
fn of_scene(root: &Value) -> Vec<PointPair> {
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
