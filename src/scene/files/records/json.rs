//! JSON with positions: a list of records, one record a line, records in records, COCO's annotations, idtracker.ai's arrays.

use super::record_table::Field;
use super::{RecordTable, TableText};
use crate::scene::files::csv::names_positions;
use crate::scene::violations::SceneError;
use serde_json::{Map, Value};

/// Names of a frame rate, in lower case and without `_`.
const RATES: [&str; 4] = ["fps", "framerate", "framespersecond", "samplerate"];
/// Parts of the names of values that hold for all records inside.
const INHERITED: [&str; 9] = ["frame", "time", "id", "name", "label", "index", "stamp", "image", "track"];
/// Lists whose keys name no object.
const LISTS: [&str; 22] = [
    "frames",
    "objects",
    "tracks",
    "detections",
    "data",
    "annotations",
    "images",
    "categories",
    "videos",
    "positions",
    "points",
    "results",
    "records",
    "samples",
    "trajectory",
    "trajectories",
    "states",
    "observations",
    "measurements",
    "balls",
    "items",
    "keyframes",
];
/// Lists of whole frames: without a number of their own they are counted.
const FRAMES: [&str; 2] = ["frames", "states"];
/// Lists of positions.
const PATHS: [&str; 7] = ["path", "track", "trajectory", "positions", "centers", "centroids", "points_xy"];
/// Names of a list of four numbers that is a box: of either kind, of two corners, of a corner and a size.
const BOXES: [&str; 4] = ["bbox", "box", "bounding_box", "rect"];
const CORNERS: [&str; 5] = ["xyxy", "tlbr", "ltrb", "bbox_xyxy", "box_xyxy"];
const SIZES: [&str; 4] = ["xywh", "tlwh", "ltwh", "bbox_xywh"];
const NAMED_CORNERS: [&str; 4] = ["xmin [px]", "ymin [px]", "xmax [px]", "ymax [px]"];
const NAMED_SIZES: [&str; 4] = ["left [px]", "top [px]", "width [px]", "height [px]"];
/// Names of a position without a word for it.
const BARE: [&str; 5] = ["xy", "xyz", "p", "coords", "coordinates"];
/// The corners of a box until its kind is known.
const EDGES: [&str; 4] = ["box_0", "box_1", "box_2", "box_3"];

/// The table that JSON holds; `None`: it holds no positions, or is none.
pub(super) fn table(text: &str) -> Option<Result<TableText, SceneError>> {
    let mut found = JsonRecords::default();
    match serde_json::from_str::<Value>(text) {
        Ok(Value::Object(root))
            if root.contains_key("motion_trajectory") || root.contains_key("object_property") =>
        {
            return None;
        }
        Ok(root) => found.root(&root),
        Err(_) => {
            if let Err(error) = found.lines(text)? {
                return Some(Err(error));
            }
        }
    }
    let JsonRecords { mut table, mut taken } = found;
    name_edges(&mut table);
    if table.len() < 2 {
        return None;
    }
    if !names_positions(&table.names) {
        let names: Vec<&str> = table.names.iter().take(20).map(String::as_str).collect();
        let message = format!(
            "has {} records without positions, with {}; name the fields `frame` or `t`, `id`, `x` and `y`",
            table.len(),
            names.join(", ")
        );
        return Some(Err(SceneError::single("(file)", message)));
    }
    let others = table.retain(names_positions);
    if others > 0 {
        taken.push(format!("{others} records without positions are left out"));
    }
    without_counting_ids(&mut table);
    taken.insert(0, format!("{} records of JSON with {}", table.len(), table.names.join(", ")));
    Some(Ok(table.written(taken)))
}

#[derive(Default)]
struct JsonRecords {
    table: RecordTable,
    taken: Vec<String>,
}

impl JsonRecords {
    /// One record a line; `None`: not even the first line is one.
    fn lines(&mut self, text: &str) -> Option<Result<(), SceneError>> {
        let lines: Vec<(usize, &str)> =
            text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()).collect();
        let last = lines.last()?.0;
        for (at, line) in &lines {
            match serde_json::from_str::<Value>(line.trim().trim_end_matches(',')) {
                Ok(value @ Value::Object(_)) => self.walk(&value, &[]),
                Err(_) if *at == last && self.table.len() > 1 => {
                    self.taken.push(format!("the last line ({}) is cut and left out", at + 1));
                }
                _ if self.table.len() == 0 => return None,
                Ok(_) => {
                    return Some(Err(SceneError::single(
                        format!("line {}", at + 1),
                        "is no record; give an object",
                    )));
                }
                Err(error) => {
                    let message = format!("is not JSON ({error}); correct or delete this line");
                    return Some(Err(SceneError::single(format!("line {}", at + 1), message)));
                }
            }
        }
        Some(Ok(()))
    }

    fn root(&mut self, root: &Value) {
        let Value::Object(map) = root else { return self.items("", root, &[]) };
        let is_rate = |name: &str| RATES.contains(&name.to_lowercase().replace('_', "").as_str());
        let rate = map.iter().find(|(name, _)| is_rate(name)).and_then(|(_, value)| value.as_f64());
        let rate = rate.filter(|rate| *rate > 0.0);
        self.table.notes.extend(rate.map(|rate| format!("# fps: {rate}")));
        if let Some(Value::Array(frames)) = map.get("trajectories")
            && frames.iter().any(|frame| frame.get(0).is_some_and(Value::is_array))
        {
            return self.frames_of_points(frames);
        }
        // What a file says of itself, such as the width of its images, is no field of its records.
        for (key, value) in map.iter().filter(|(_, value)| value.is_array() || value.is_object()) {
            self.items(key, value, &[]);
        }
    }

    /// Positions by frame and object, as idtracker.ai has them.
    fn frames_of_points(&mut self, frames: &[Value]) {
        for (frame, objects) in frames.iter().enumerate() {
            for (id, point) in objects.as_array().into_iter().flatten().enumerate() {
                let at = |k: usize| point.get(k).map(scalar).unwrap_or_default();
                let fields = [
                    ("frame", frame.to_string()),
                    ("id", (id + 1).to_string()),
                    ("x [px]", at(0)),
                    ("y [px]", at(1)),
                ];
                self.table.push(fields.map(|(name, value)| (name.to_string(), value)));
            }
        }
    }

    /// The records in a list or an object under a key.
    fn items(&mut self, key: &str, value: &Value, outer: &[Field]) {
        match value {
            Value::Array(list) => {
                let is_path = PATHS.contains(&key) && list.iter().all(|item| item.is_array());
                for (at, item) in list.iter().enumerate() {
                    let mut fields = outer.to_vec();
                    let lacks_frame = || {
                        let own = item
                            .as_object()
                            .into_iter()
                            .flat_map(Map::keys)
                            .chain(outer.iter().map(|(name, _)| name));
                        own.into_iter().all(|name| !is_clock(name))
                    };
                    if (FRAMES.contains(&key) || is_path) && lacks_frame() {
                        set(&mut fields, "frame", at.to_string());
                    }
                    match item {
                        Value::Object(_) => self.walk(item, &fields),
                        Value::Array(point) if is_path => {
                            let names = ["x", "y", "z"];
                            let own = names
                                .iter()
                                .zip(point)
                                .map(|(name, value)| (name.to_string(), scalar(value)));
                            self.table.push(fields.into_iter().chain(own));
                        }
                        _ => {}
                    }
                }
            }
            Value::Object(map)
                if map.values().any(|v| v.is_array() || v.is_object())
                    && map.values().all(|v| v.is_array() || v.is_object()) =>
            {
                for (name, inner) in map {
                    let mut fields = outer.to_vec();
                    if !LISTS.contains(&name.as_str()) {
                        set(&mut fields, if FRAMES.contains(&key) { "frame" } else { "id" }, name.clone());
                    }
                    match inner {
                        Value::Object(_) => self.walk(inner, &fields),
                        _ => self.items(
                            if LISTS.contains(&name.as_str()) { name } else { "path" },
                            inner,
                            &fields,
                        ),
                    }
                }
            }
            Value::Object(_) => self.walk(value, outer),
            _ => {}
        }
    }

    /// The record that an object is, or those inside it.
    fn walk(&mut self, value: &Value, outer: &[Field]) {
        let Some(map) = value.as_object() else { return };
        let mut fields = outer.to_vec();
        let mut inside: Vec<(&String, &Value)> = vec![];
        let mut vectors = vec![];
        for (key, value) in map {
            match value {
                Value::Array(list) if list.iter().all(|v| v.is_number() || v.is_null()) => {
                    vectors.push((key, list))
                }
                Value::Object(inner) if inner.values().all(|v| !v.is_array() && !v.is_object()) => {
                    for (name, value) in inner {
                        set(&mut fields, &format!("{key}_{name}"), scalar(value));
                    }
                }
                Value::Array(_) | Value::Object(_) => inside.push((key, value)),
                _ => set(&mut fields, key, scalar(value)),
            }
        }
        vectors.into_iter().for_each(|(key, list)| vector(&mut fields, key, list));
        inside.retain(|(_, value)| match value {
            Value::Array(list) => list.iter().any(|item| item.is_object()),
            _ => true,
        });
        if inside.is_empty() {
            return self.table.push(fields);
        }
        fields.retain(|(name, _)| {
            INHERITED.iter().any(|part| name.to_lowercase().contains(part)) || name == "t"
        });
        for (name, _) in &mut fields {
            if matches!(name.as_str(), "index" | "idx") {
                *name = "frame".into();
            }
        }
        for (key, value) in inside {
            self.items(key, value, &fields);
        }
    }
}

/// Whether a name is that of a time or a frame.
fn is_clock(name: &str) -> bool {
    let lower = name.to_lowercase();
    lower == "t" || ["frame", "time", "index", "idx", "stamp"].iter().any(|part| lower.contains(part))
}

/// Sets a field; an inner value replaces an outer one.
fn set(fields: &mut Vec<Field>, name: &str, value: String) {
    fields.retain(|(known, _)| known != name);
    fields.push((name.to_string(), value));
}

fn scalar(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Null => String::new(),
        other => other.to_string(),
    }
}

/// The numbers of a list as fields: a position or a box.
fn vector(fields: &mut Vec<Field>, key: &str, list: &[Value]) {
    let lower = key.to_lowercase();
    let names: Vec<String> = match list.len() {
        2 | 3 if BARE.contains(&lower.as_str()) => ["x", "y", "z"].map(String::from).to_vec(),
        2 | 3 => ["x", "y", "z"].map(|axis| format!("{key}_{axis}")).to_vec(),
        4 if CORNERS.contains(&lower.as_str()) => NAMED_CORNERS.map(String::from).to_vec(),
        4 if SIZES.contains(&lower.as_str()) || is_coco(&lower, fields) => {
            NAMED_SIZES.map(String::from).to_vec()
        }
        4 if BOXES.contains(&lower.as_str()) => EDGES.map(String::from).to_vec(),
        _ => return,
    };
    for (name, value) in names.iter().zip(list) {
        set(fields, name, scalar(value));
    }
}

/// Whether a record is an annotation of COCO, whose boxes have a corner and a size.
fn is_coco(key: &str, fields: &[Field]) -> bool {
    key == "bbox" && fields.iter().any(|(name, _)| name == "image_id" || name == "category_id")
}

/// Names the edges of boxes: two corners where the second ones are always right of and below the first ones.
fn name_edges(table: &mut RecordTable) {
    let places = EDGES.map(|edge| table.names.iter().position(|name| name == edge));
    let [Some(left), Some(top), Some(third), Some(fourth)] = places else { return };
    let numbers =
        |at: usize| -> Vec<f64> { table.column(at).filter_map(|value| value.parse().ok()).collect() };
    let is_below =
        |low: usize, high: usize| numbers(low).iter().zip(numbers(high)).all(|(low, high)| *low < high);
    let names = match is_below(left, third) && is_below(top, fourth) {
        true => NAMED_CORNERS,
        false => NAMED_SIZES,
    };
    for (at, name) in [left, top, third, fourth].into_iter().zip(names) {
        if let Some(known) = table.names.get_mut(at) {
            *known = name.to_string();
        }
    }
}

/// An `id` that differs in each record counts records, as COCO's annotations do; a `track_id` beside it is the object's.
fn without_counting_ids(table: &mut RecordTable) {
    let Some(at) = table.names.iter().position(|name| name == "id") else { return };
    let different: std::collections::BTreeSet<&str> = table.column(at).collect();
    let has_images = table.names.iter().any(|name| name == "image_id");
    if has_images
        && different.len() == table.len()
        && let Some(name) = table.names.get_mut(at)
    {
        *name = "number".into();
    }
}
