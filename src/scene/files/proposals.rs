//! Reads detections: CLEVRER's `derender_proposals` files, and the same with boxes or scores.

use crate::scene::limits::MAX_FRAMES;
use crate::scene::tracks::detection::{AttributeScores, Detection, checked_features};
use crate::scene::tracks::link::MAX_DETECTIONS;
use crate::scene::tracks::mask::{BoundingBox, bounds, decompress};
use crate::scene::violations::{SceneError, SceneViolations};
use serde_json::Value;

/// The detections of one video.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposals {
    pub detections: Vec<Detection>,
    pub frames: usize,
}

/// Reads `{"frames": [{"frame_index", "objects": [{"mask": {"size", "counts"} | "box": [left, top, width, height], "color",
/// "material", "shape", "score", "features"}]}]}`. An attribute is a word, or words with scores. Everything that is wrong is reported at
/// once, with frame and field. `image_size`: width and height of the camera's image (px).
pub fn parse_proposals(text: &str, image_size: [f64; 2]) -> Result<Proposals, SceneError> {
    let mut r = SceneViolations::default();
    let root: Value = serde_json::from_str(text.trim_start_matches('\u{feff}')).unwrap_or_else(|error| {
        r.add("(file)", format!("is not JSON: {error}"));
        Value::Null
    });
    if let Some([width, height]) = pair(&root["image_size"]).filter(|own| *own != image_size) {
        let [w, h] = image_size;
        r.add(
            "image_size",
            format!("is {width} x {height} px, but the camera's image has {w} x {h} px; give the camera of this video"),
        );
    }
    let mut detections = vec![];
    let (mut frames, mut length) = (0, None);
    let list = root["frames"].as_array().map(Vec::as_slice).unwrap_or_default();
    if list.is_empty() && !root.is_null() {
        r.add("frames", "is missing or empty; give a list of frames with their objects");
    }
    for (k, frame) in list.iter().enumerate() {
        let index = match frame.get("frame_index") {
            None => Some(k),
            Some(index) => index.as_u64().map(|i| i as usize).filter(|&i| i < MAX_FRAMES),
        };
        let Some(index) = index else {
            let message = format!("is {}; give a whole number below {MAX_FRAMES}", frame["frame_index"]);
            r.add(format!("frames[{k}].frame_index"), message);
            continue;
        };
        frames = frames.max(index + 1);
        let Some(objects) = frame["objects"].as_array() else {
            r.add(
                format!("frames[{k}].objects"),
                format!("frame {index}: is not a list; give the objects found"),
            );
            continue;
        };
        for (j, object) in objects.iter().enumerate() {
            let path = format!("frames[{k}].objects[{j}]");
            let mut wrong = |(field, message): (&str, String)| {
                r.add(format!("{path}.{field}"), format!("frame {index}: {message}"));
            };
            if detections.len() >= MAX_DETECTIONS {
                wrong(("", format!("is one more than {MAX_DETECTIONS} detections; split the video")));
                break;
            }
            match detection(object, index, image_size, &mut length) {
                Ok(found) => detections.push(found),
                Err(error) => wrong(error),
            }
        }
    }
    r.finish()?;
    Ok(Proposals { detections, frames })
}

fn pair(value: &Value) -> Option<[f64; 2]> {
    Some([value.get(0)?.as_f64()?, value.get(1)?.as_f64()?])
}

/// The field that is wrong, and the message.
type FieldError = (&'static str, String);

fn detection(
    object: &Value,
    frame: usize,
    image: [f64; 2],
    length: &mut Option<usize>,
) -> Result<Detection, FieldError> {
    let bounds = match (object.get("mask"), object.get("box").or(object.get("bbox"))) {
        (Some(mask), _) => of_mask(mask, image)?,
        (None, Some(list)) => {
            let numbers: Option<Vec<f64>> =
                list.as_array().map(|list| list.iter().filter_map(Value::as_f64).collect());
            let Some([left, top, width, height]) = numbers.and_then(|n| <[f64; 4]>::try_from(n).ok()) else {
                return Err(("box", "is not a box; give left, top, width and height in pixels".into()));
            };
            let bounds = BoundingBox { left, top, right: left + width, bottom: top + height };
            bounds.check(image).map_err(|message| ("box", message))?;
            bounds
        }
        (None, None) => return Err(("mask", "is missing; give a mask or a box".into())),
    };
    let score = match object.get("score") {
        None | Some(Value::Null) => 1.0,
        Some(score) => score
            .as_f64()
            .filter(|s| *s > 0.0 && *s <= 1.0)
            .ok_or_else(|| ("score", format!("is {score}; give a number above 0 and up to 1")))?,
    };
    let (color, material, shape) =
        (words(object, "color")?, words(object, "material")?, words(object, "shape")?);
    let features = features(object)?;
    checked_features(&features, length).map_err(|message| ("features", message))?;
    Ok(Detection { frame, bounds, color, material, shape, score, features })
}

fn features(object: &Value) -> Result<Vec<f32>, FieldError> {
    let wrong = |other: &Value| ("features", format!("has {other}; give a list of numbers"));
    match object.get("features") {
        None | Some(Value::Null) => Ok(vec![]),
        Some(Value::Array(list)) => {
            list.iter().map(|v| v.as_f64().map(|f| f as f32).ok_or_else(|| wrong(v))).collect()
        }
        Some(other) => Err(wrong(other)),
    }
}

fn of_mask(mask: &Value, image: [f64; 2]) -> Result<BoundingBox, FieldError> {
    let size = |k: usize| mask["size"].get(k).and_then(Value::as_u64);
    let (Some(height), Some(width)) = (size(0), size(1)) else {
        return Err(("mask.size", format!("is {}; give [height, width] in pixels", mask["size"])));
    };
    if image != [width as f64, height as f64] {
        let message = format!(
            "is [{height}, {width}] (height, width), but the camera's image is {} x {} px (width x height); give the camera of \
             this video",
            image[0], image[1]
        );
        return Err(("mask.size", message));
    }
    let counts = match &mask["counts"] {
        Value::String(text) => decompress(text).map_err(|e| ("mask.counts", e.to_string()))?,
        Value::Array(list) => list.iter().map(|v| v.as_i64().unwrap_or(-1)).collect(),
        other => return Err(("mask.counts", format!("is {other}; give COCO's text or a list of runs"))),
    };
    bounds([height, width], &counts).map_err(|e| ("mask", e.to_string()))
}

fn words(object: &Value, field: &'static str) -> Result<AttributeScores, FieldError> {
    match object.get(field) {
        None | Some(Value::Null) => Ok(AttributeScores::new()),
        Some(Value::String(word)) => Ok(AttributeScores::from([(word.to_lowercase(), 1.0)])),
        Some(Value::Object(scores)) => scores
            .iter()
            .map(|(word, score)| {
                let score = score.as_f64().filter(|s| *s >= 0.0);
                let score = score
                    .ok_or_else(|| (field, format!("has no score of at least 0 for {word:?}; give one")));
                Ok((word.to_lowercase(), score?))
            })
            .collect(),
        Some(other) => Err((field, format!("is {other}; give a word, or words with scores"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn proposals_are_read_and_wrong_fields_are_named() {
        // A mask of 4 x 6 pixels, rows 1 and 2 of columns 2 and 3.
        let good = r#"{"frames": [{"frame_index": 7, "objects": [
            {"mask": {"size": [4, 6], "counts": [9, 2, 2, 2, 9]}, "color": "Red", "material": {"metal": 0.7, "rubber": 0.3},
             "shape": "cube", "score": 0.9, "features": [0.5, -2]}]}]}"#;
        let parse_proposals = |text: &str| parse_proposals(text, [6.0, 4.0]);
        let read = parse_proposals(good).unwrap();
        assert_eq!(read.frames, 8);
        assert_eq!(read.detections[0].bounds.edges(), [2.0, 1.0, 4.0, 3.0]);
        assert_eq!(read.detections[0].material["rubber"], 0.3);
        assert_eq!(read.detections[0].features, [0.5, -2.0]);
        let wrong = |from: &str, to: &str| {
            let error = parse_proposals(&good.replacen(from, to, 1)).unwrap_err();
            (error.violations[0].path.clone(), error.violations[0].message.clone())
        };
        for (from, to, field) in [
            ("[9, 2, 2, 2, 9]", "[9, 2, 2, 2, 8]", "mask"),
            ("[9, 2, 2, 2, 9]", "\"9~~\"", "mask.counts"),
            ("[4, 6]", "[4]", "mask.size"),
            ("[4, 6]", "[6, 4]", "mask.size"),
            (r#""mask": {"size": [4, 6], "counts": [9, 2, 2, 2, 9]}"#, r#""box": [3, 1, 6, 3]"#, "box"),
            ("0.9", "7", "score"),
            ("\"cube\"", "3", "shape"),
            ("[0.5, -2]", "[0.5, \"-2\"]", "features"),
            ("[0.5, -2]", "[1e60, 0]", "features"),
            ("[0.5, -2]", "0.5", "features"),
            (r#""mask": {"size": [4, 6], "counts": [9, 2, 2, 2, 9]}"#, r#""box": [500, 20, 30, 30]"#, "box"),
            (r#""mask": {"size": [4, 6], "counts": [9, 2, 2, 2, 9]}"#, r#""box": [50, 20, -3, 30]"#, "box"),
        ] {
            let (path, message) = wrong(from, to);
            assert_eq!(path, format!("frames[0].objects[0].{field}"));
            assert!(message.starts_with("frame 7: "), "{message}");
        }
        assert_eq!(wrong("7", "-7").0, "frames[0].frame_index");
        assert_eq!(parse_proposals("{}").unwrap_err().violations[0].path, "frames");
        assert_eq!(parse_proposals("{").unwrap_err().violations[0].path, "(file)");
    }
}
