//! Reads CLEVRER annotation files and our `observed.json`, which adds optional keys to them.

use super::camera::{IMAGE_NOISE, IMAGE_NOISE_RANGE};
use super::validate::{Report, degrees};
use super::{
    Camera, Covariance, DEFAULT_SIZE, MAX_FRAMES, MAX_OBJECTS, Object, Pixel, Sample, Scene, SceneError,
    Shape, Table, Track, WorldKind,
};
use crate::num::vec2;
use serde_json::{Map, Value};
use std::collections::BTreeSet;

/// Frame rate of CLEVRER's videos (1/s).
const FPS: f64 = 25.0;
/// Width and height of CLEVRER's videos (px).
const IMAGE_SIZE: [f64; 2] = [480.0, 320.0];
/// A sample that has an image point only, and where the file has it.
type Placeless = (Pixel, String);
/// CLEVRER's published camera.
pub const CLEVRER_CAMERA: Camera = Camera {
    matrix: [[-207.846, 525.0, -120.0, 1200.0], [123.936, 0.0, -534.663, 800.0], [-0.866025, 0.0, -0.5, 5.0]],
    image_size: IMAGE_SIZE,
};

/// Reads the text of an annotation file. Beside CLEVRER's keys it may have `fps`, `times` (s, one a frame), `world`, `setup`,
/// `camera_matrix`, `image_size`, `image_noise_px`, `table`, `noise_sigma`, an object's `size` and `mass`, and a sample's
/// `covariance` (xx, xy, yy in m^2); a sample with `image_center` (px) and no `location` is placed by the camera.
/// Unknown keys are ignored; everything that is wrong is reported at once.
pub fn parse(name: &str, text: &str) -> Result<Scene, SceneError> {
    let mut reader = Reader { report: Report::default(), strangers: BTreeSet::new(), bad_ids: false };
    // Some editors put a byte order mark in front.
    let root = match serde_json::from_str::<Value>(text.trim_start_matches('\u{feff}')) {
        Ok(Value::Object(root)) => root,
        Ok(other) => {
            reader.report.add("(file)", format!("is {}; an annotation is a JSON object", kind(&other)));
            Map::new()
        }
        Err(error) => {
            reader.report.add("(file)", format!("is no JSON: {error}"));
            Map::new()
        }
    };
    let scene = if root.is_empty() { None } else { Some(reader.scene(name, &root)) };
    reader.report.finish()?;
    let scene = scene.ok_or_else(|| one("(file)", "is empty; give an annotation"))?;
    scene.validate()
}

fn one(path: &str, message: &str) -> SceneError {
    SceneError { violations: vec![super::Violation { path: path.into(), message: message.into() }] }
}

struct Reader {
    report: Report,
    /// Ids in the trajectory that are no object's; each is reported once.
    strangers: BTreeSet<u32>,
    /// Whether an object's own id was refused: the trajectory may mean that object then.
    bad_ids: bool,
}

impl Reader {
    fn scene(&mut self, name: &str, root: &Map<String, Value>) -> Scene {
        let world = self.world(root);
        let fps = self.number(root, "fps", "").unwrap_or(FPS);
        let (ids, objects) = self.objects(root);
        let (frames, mut tracks, pixels, shown) = self.tracks(root, &ids);
        for (id, track) in ids.iter().zip(&tracks) {
            if let Some((frame, yaw)) = degrees(track) {
                let message = format!("is {yaw}, which is no yaw in radians; divide degrees by 57.2958");
                self.report.add(format!("frame {frame}, object {id}: orientation[2]"), message);
            }
        }
        let mut camera = self.camera(root);
        if let Some(astray) = camera.as_ref().and_then(|camera| camera.astray(&shown, &objects, &tracks)) {
            self.report.add(astray.path, astray.message);
        }
        if camera.is_none() && world == WorldKind::Clevrer && !root.contains_key("camera_matrix") {
            camera = Some(Camera { image_size: self.image_size(root), ..CLEVRER_CAMERA });
        }
        if !pixels.is_empty() {
            camera = self.place(root, camera, &pixels, &objects, &mut tracks).or(camera);
        }
        Scene {
            name: name.to_string(),
            setup: self.text(root, "setup", ""),
            world,
            fps,
            times: self.times(root, frames, if fps > 0.0 { fps } else { FPS }),
            camera,
            table: self.table(root),
            noise_sigma: self.number(root, "noise_sigma", ""),
            objects,
            tracks,
            outliers: vec![],
        }
    }

    fn times(&mut self, root: &Map<String, Value>, frames: usize, fps: f64) -> Vec<f64> {
        let value = root.get("times").filter(|v| !v.is_null());
        let given = value.and_then(|v| self.numbers(Some(v), "times", &[frames]));
        given.unwrap_or_else(|| (0..frames).map(|f| f as f64 / fps).collect())
    }

    fn world(&mut self, root: &Map<String, Value>) -> WorldKind {
        let Some(word) = self.text(root, "world", "") else { return WorldKind::Clevrer };
        match word.as_str() {
            "clevrer" => WorldKind::Clevrer,
            "table" => WorldKind::Table,
            "air_table" => WorldKind::AirTable,
            "billiards" => WorldKind::Billiards,
            _ => {
                let known = "clevrer, table, air_table or billiards";
                self.report.add("world", format!("is \"{word}\"; it must be {known}"));
                WorldKind::Clevrer
            }
        }
    }

    fn objects(&mut self, root: &Map<String, Value>) -> (Vec<u32>, Vec<Object>) {
        let mut objects = vec![];
        for (i, entry) in self.list(root, "object_property", "").iter().take(MAX_OBJECTS + 1).enumerate() {
            let path = format!("object_property[{i}]");
            let Some(entry) = self.object(entry, &path) else { continue };
            let id = self.required_id(entry, &path);
            let size = self.number(entry, "size", &path).unwrap_or(DEFAULT_SIZE);
            let shape = self.text(entry, "shape", &path);
            let shape = match shape.as_deref().map(str::to_ascii_lowercase).as_deref() {
                Some("cylinder" | "disc" | "disk" | "puck" | "coin") => Shape::Disc { radius: size },
                Some("sphere" | "ball") => Shape::Ball { radius: size },
                Some("cube" | "box" | "block" | "square") => Shape::Square { half_side: size },
                other => {
                    let found = other.map_or("missing".to_string(), |s| format!("\"{s}\""));
                    let message = format!("is {found}; it must be sphere, cylinder or cube");
                    self.report.add(format!("{path}.shape"), message);
                    Shape::Disc { radius: size }
                }
            };
            let mut word = |key| self.text(entry, key, &path).unwrap_or_default().to_lowercase();
            let (color, material) = (word("color"), word("material"));
            let mass = self.number(entry, "mass", &path);
            match id {
                Some(id) if objects.iter().any(|o: &Object| o.id == id) => {
                    let message = format!("is a duplicate: {id} is another object's; give each its own");
                    self.report.add(format!("{path}.object_id"), message);
                    self.bad_ids = true;
                }
                Some(id) => objects.push(Object { id, color, material, shape, mass }),
                None => self.bad_ids = true,
            }
        }
        (objects.iter().map(|o| o.id).collect(), objects)
    }

    /// Number of frames, a track for each id, the samples that have an image point only, and those that have one too.
    /// Frame indices are the file's `frame_id`.
    fn tracks(
        &mut self,
        root: &Map<String, Value>,
        ids: &[u32],
    ) -> (usize, Vec<Track>, Vec<Placeless>, Vec<Pixel>) {
        let (mut pixels, mut shown) = (vec![], vec![]);
        let mut tracks = vec![Track::default(); ids.len()];
        let trajectory = self.list(root, "motion_trajectory", "");
        let says_seen = trajectory.iter().any(|frame| {
            let objects = frame.get("objects").and_then(Value::as_array);
            objects.is_some_and(|o| o.iter().any(|o| o.get("inside_camera_view").is_some()))
        });
        let mut frames = 0;
        for (k, entry) in trajectory.iter().enumerate() {
            let path = format!("motion_trajectory[{k}]");
            let Some(entry) = self.object(entry, &path) else { continue };
            let frame = match entry.get("frame_id") {
                None => frames,
                Some(id) => match id.as_u64().map(|f| f as usize) {
                    Some(frame) if frame >= MAX_FRAMES => {
                        let message = format!("is {frame}; at most {MAX_FRAMES} frames are allowed");
                        self.report.add(format!("{path}.frame_id"), message);
                        continue;
                    }
                    Some(frame) if frame < frames => {
                        let message = format!("is {frame} after {}; frames must increase", frames - 1);
                        self.report.add(format!("{path}.frame_id"), message);
                        continue;
                    }
                    Some(frame) => frame,
                    None => {
                        let message = format!("is {}; give a whole number from 0", kind(id));
                        self.report.add(format!("{path}.frame_id"), message);
                        continue;
                    }
                },
            };
            frames = frame + 1;
            for (j, seen) in self.list(entry, "objects", &path).iter().enumerate() {
                let path = format!("{path}.objects[{j}]");
                let Some(seen) = self.object(seen, &path) else { continue };
                let Some(id) = self.required_id(seen, &path) else { continue };
                let object = ids.iter().position(|known| *known == id);
                let Some((object, track)) = object.and_then(|i| Some((i, tracks.get_mut(i)?))) else {
                    if !self.bad_ids && self.strangers.insert(id) {
                        let message = format!("is {id}, which object_property lacks");
                        self.report.add(format!("{path}.object_id"), message);
                    }
                    continue;
                };
                if let Some(sample) = self.sample(seen, &path, frame, says_seen) {
                    let place = track.samples.len();
                    if !seen.contains_key("location") {
                        let Some(point) = self.pair(seen, "image_center", &path) else { continue };
                        let path = join(&path, "image_center");
                        pixels.push((Pixel { object, sample: place, point }, path));
                    } else if let Some(point) = self.pair(seen, "image_center", &path) {
                        shown.push(Pixel { object, sample: place, point });
                    }
                    track.samples.push(sample);
                }
            }
        }
        (frames, tracks, pixels, shown)
    }

    fn sample(&mut self, seen: &Map<String, Value>, path: &str, frame: usize, says: bool) -> Option<Sample> {
        match seen.get("inside_camera_view") {
            Some(Value::Bool(true)) => {}
            None if !says => {}
            Some(Value::Bool(false)) | None | Some(Value::Null) => return None,
            Some(other) => {
                let message = format!("is {}; give true or false", kind(other));
                self.report.add(format!("{path}.inside_camera_view"), message);
                return None;
            }
        }
        // Without a location, the image point stands for it.
        let imaged = !seen.contains_key("location") && seen.contains_key("image_center");
        let location = match imaged {
            true => vec![0.0, 0.0],
            false => self.numbers(seen.get("location"), &format!("{path}.location"), &[2, 3])?,
        };
        let covariance = match seen.get("covariance").filter(|_| !imaged) {
            None | Some(Value::Null) => None,
            some => match self.numbers(some, &format!("{path}.covariance"), &[3])?[..] {
                [xx, xy, yy] => Some(Covariance { xx, xy, yy }),
                _ => None,
            },
        };
        let yaw = match seen.get("orientation") {
            None | Some(Value::Null) => None,
            some => match self.numbers(some, &format!("{path}.orientation"), &[3, 4])?[..] {
                [_, _, yaw] => Some(yaw),
                // Quaternion in Bullet's order.
                [x, y, z, w] => Some((2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z))),
                _ => None,
            },
        };
        let position = vec2(*location.first()?, *location.get(1)?);
        Some(Sample { frame, position, yaw, covariance })
    }

    /// Puts the samples that have an image point only in their places; the camera as it faces them.
    fn place(
        &mut self,
        root: &Map<String, Value>,
        camera: Option<Camera>,
        pixels: &[(Pixel, String)],
        objects: &[Object],
        tracks: &mut [Track],
    ) -> Option<Camera> {
        let sigma = self.number(root, "image_noise_px", "").unwrap_or(IMAGE_NOISE);
        if !IMAGE_NOISE_RANGE.contains(&sigma) {
            let (low, high) = (IMAGE_NOISE_RANGE.start(), IMAGE_NOISE_RANGE.end());
            self.report.add("image_noise_px", format!("is {sigma}; it must be from {low} to {high} px"));
            return None;
        }
        let Some(camera) = camera else {
            if !root.contains_key("camera_matrix") {
                let message = "is missing; image points need the camera's 3x4 projection matrix";
                self.report.add("camera_matrix", message);
            }
            return None;
        };
        let placed = camera.place(&pixels.iter().map(|p| p.0).collect::<Vec<_>>(), sigma, objects, tracks);
        let (camera, refused) = placed.map_err(|e| self.report.add("camera_matrix", e.to_string())).ok()?;
        for (k, error) in refused {
            let (pixel, path) = &pixels[k];
            let frame = tracks[pixel.object].samples[pixel.sample].frame;
            self.report.add(path, format!("frame {frame}: {error}"));
        }
        Some(camera)
    }

    fn camera(&mut self, root: &Map<String, Value>) -> Option<Camera> {
        let rows = match root.get("camera_matrix")? {
            Value::Null => return None,
            Value::Array(rows) if matches!(rows.len(), 3 | 4) => rows,
            other => {
                let message = format!("is {}; give 3 or 4 rows of 4 numbers", kind(other));
                self.report.add("camera_matrix", message);
                return None;
            }
        };
        let mut matrix = [[0.0; 4]; 3];
        for (i, (slot, row)) in matrix.iter_mut().zip(rows).enumerate() {
            let row = self.numbers(Some(row), &format!("camera_matrix[{i}]"), &[4])?;
            slot.iter_mut().zip(row).for_each(|(slot, v)| *slot = v);
        }
        Some(Camera { matrix, image_size: self.image_size(root) })
    }

    fn image_size(&mut self, root: &Map<String, Value>) -> [f64; 2] {
        self.pair(root, "image_size", "").unwrap_or(IMAGE_SIZE)
    }

    fn table(&mut self, root: &Map<String, Value>) -> Option<Table> {
        let value = root.get("table").filter(|v| !v.is_null())?;
        let table = self.object(value, "table")?;
        for axis in ["x", "y"].into_iter().filter(|axis| !table.contains_key(*axis)) {
            self.report.add(format!("table.{axis}"), "is missing; give [low, high]");
        }
        let (x, y) = (self.pair(table, "x", "table"), self.pair(table, "y", "table"));
        Some(Table { x: x?, y: y? })
    }

    fn pair(&mut self, from: &Map<String, Value>, key: &str, path: &str) -> Option<[f64; 2]> {
        let value = from.get(key).filter(|v| !v.is_null())?;
        match self.numbers(Some(value), &join(path, key), &[2])?[..] {
            [a, b] => Some([a, b]),
            _ => None,
        }
    }

    fn object<'a>(&mut self, value: &'a Value, path: &str) -> Option<&'a Map<String, Value>> {
        if value.as_object().is_none() {
            self.report.add(path, format!("is {}; give an object", kind(value)));
        }
        value.as_object()
    }

    fn list<'a>(&mut self, from: &'a Map<String, Value>, key: &str, path: &str) -> &'a [Value] {
        match from.get(key) {
            Some(Value::Array(list)) => list,
            other => {
                let found = other.map_or("missing", kind);
                self.report.add(join(path, key), format!("is {found}; give a list"));
                &[]
            }
        }
    }

    fn required_id(&mut self, from: &Map<String, Value>, path: &str) -> Option<u32> {
        let value = from.get("object_id");
        let id = value.and_then(Value::as_u64).and_then(|id| u32::try_from(id).ok());
        if id.is_none() {
            let found = value.map_or("missing", kind);
            self.report.add(
                join(path, "object_id"),
                format!("is {found}; give a whole number from 0 to {}", u32::MAX),
            );
        }
        id
    }

    fn number(&mut self, from: &Map<String, Value>, key: &str, path: &str) -> Option<f64> {
        let value = from.get(key).filter(|v| !v.is_null())?;
        if value.as_f64().is_none() {
            self.report.add(join(path, key), format!("is {}; give a number", kind(value)));
        }
        value.as_f64()
    }

    fn text(&mut self, from: &Map<String, Value>, key: &str, path: &str) -> Option<String> {
        let value = from.get(key).filter(|v| !v.is_null())?;
        if value.as_str().is_none() {
            self.report.add(join(path, key), format!("is {}; give a text", kind(value)));
        }
        value.as_str().map(str::to_string)
    }

    fn numbers(&mut self, value: Option<&Value>, path: &str, lengths: &[usize]) -> Option<Vec<f64>> {
        let wanted: Vec<String> = lengths.iter().map(usize::to_string).collect();
        let wanted = wanted.join(" or ");
        let Some(Value::Array(list)) = value else {
            let found = value.map_or("missing", kind);
            self.report.add(path, format!("is {found}; give {wanted} numbers"));
            return None;
        };
        if !lengths.contains(&list.len()) {
            self.report.add(path, format!("has {} entries; give {wanted} numbers", list.len()));
            return None;
        }
        let mut numbers = vec![];
        for (i, v) in list.iter().enumerate() {
            match v.as_f64() {
                Some(v) => numbers.push(v),
                None => self.report.add(format!("{path}[{i}]"), format!("is {}; give a number", kind(v))),
            }
        }
        (numbers.len() == list.len()).then_some(numbers)
    }
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_string() } else { format!("{path}.{key}") }
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(n) if n.is_f64() => "a fraction",
        Value::Number(n) if n.is_i64() && !n.is_u64() => "a negative number",
        Value::Number(_) => "a number",
        Value::String(_) => "a text",
        Value::Array(_) => "a list",
        Value::Object(_) => "an object",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const REAL: &str = r#"{"scene_index": 7, "video_filename": "video_00007.mp4",
        "object_property": [{"object_id": 0, "color": "gray", "material": "rubber", "shape": "cube"},
                            {"object_id": 1, "color": "Blue", "material": "metal", "shape": "sphere"}],
        "motion_trajectory": [
            {"frame_id": 0, "objects": [
                {"object_id": 0, "location": [1.0, 2.0, 0.2], "orientation": [0, 0, 0.479425539, 0.877582562],
                 "velocity": [0, 0, 0], "angular_velocity": [0, 0, 0], "inside_camera_view": true},
                {"object_id": 1, "location": [9.0, 9.0, 0.2], "orientation": [0, 0, 0, 1],
                 "velocity": "truth", "inside_camera_view": false}]},
            {"frame_id": 3, "objects": [
                {"object_id": 0, "location": [1.1, 2.0, 0.2], "inside_camera_view": true},
                {"object_id": 1, "location": [3.0, 3.0, 0.2], "orientation": null, "inside_camera_view": true}]}],
        "collision": [{"object_ids": [0, 1], "frame_id": 2, "location": [0, 0, 0]}]}"#;

    fn violations(text: &str) -> Vec<String> {
        parse("x", text).map_or_else(|e| e.violations.into_iter().map(|v| v.path).collect(), |_| vec![])
    }

    #[test]
    fn reads_a_real_annotation() {
        let scene = parse("annotation_00007", REAL).unwrap();
        assert_eq!(scene.times.len(), 4);
        assert!((scene.times[3] - 0.12).abs() < 1e-12);
        assert_eq!(scene.camera, Some(CLEVRER_CAMERA));
        assert_eq!(scene.objects[0].shape, Shape::Square { half_side: DEFAULT_SIZE });
        assert_eq!(scene.objects[1].color, "blue");
        let frames = |i: usize| scene.tracks[i].samples.iter().map(|s| s.frame).collect::<Vec<_>>();
        assert_eq!((frames(0), frames(1)), (vec![0, 3], vec![3]));
        assert!((scene.tracks[0].samples[0].yaw.unwrap() - 1.0).abs() < 1e-6);
        assert_eq!(scene.tracks[1].samples[0].yaw, None);
    }

    #[test]
    fn reads_the_committed_scenes_with_their_cameras() {
        for name in ["scene_00000", "scene_00006", "scene_00011", "scene_00022"] {
            let path = format!("{}/tests/data/clevrer/{name}/observed.json", env!("CARGO_MANIFEST_DIR"));
            let scene = parse(name, &std::fs::read_to_string(path).unwrap()).unwrap();
            assert_eq!((scene.times.len(), scene.world), (128, WorldKind::Clevrer));
            assert_eq!(scene.noise_sigma, Some(0.005));
            let camera = scene.camera.unwrap();
            for (object, track) in scene.objects.iter().zip(&scene.tracks) {
                for s in &track.samples {
                    let [u, v] = camera.project(s.position, object.shape.centre_height()).unwrap();
                    assert!(u > -30.0 && u < 510.0 && v > -30.0 && v < 350.0, "{name}: {u} {v}");
                }
            }
        }
    }

    #[test]
    fn reads_every_world_that_is_there() {
        let mut folders = vec![std::path::PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data")];
        let mut scenes = 0;
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
                let path = entry.path();
                if path.is_dir() {
                    folders.push(path);
                } else if path.file_name().is_some_and(|n| n == "observed.json") {
                    let read = parse("world", &std::fs::read_to_string(&path).unwrap());
                    assert!(read.is_ok(), "{}: {}", path.display(), read.unwrap_err());
                    scenes += 1;
                }
            }
        }
        println!("{scenes} scenes read");
    }

    #[test]
    fn wrong_types_are_named_with_their_paths() {
        let break_one = |from: &str, to: &str| violations(&REAL.replacen(from, to, 1));
        assert_eq!(break_one("\"cube\"", "\"torus\""), ["object_property[0].shape"]);
        assert_eq!(break_one("\"object_id\": 1", "\"object_id\": 0"), ["object_property[1].object_id"]);
        assert_eq!(break_one("\"object_id\": 1", "\"object_id\": 5e9"), ["object_property[1].object_id"]);
        let stranger = REAL.replace("{\"object_id\": 1, \"loc", "{\"object_id\": 7, \"loc");
        assert_eq!(violations(&stranger), ["motion_trajectory[0].objects[1].object_id"]);
        assert_eq!(violations(&format!("\u{feff}{REAL}")), [""; 0]);
        assert_eq!(
            break_one("[1.1, 2.0, 0.2]", "[1.1, null, 0.2]"),
            ["motion_trajectory[1].objects[0].location[1]"]
        );
        assert_eq!(break_one("\"frame_id\": 3", "\"frame_id\": 0"), ["motion_trajectory[1].frame_id"]);
        assert_eq!(break_one("\"scene_index\": 7", "\"fps\": \"fast\""), ["fps"]);
        assert_eq!(break_one("\"scene_index\": 7", "\"table\": {\"x\": [0, 1]}"), ["table.y"]);
        assert_eq!(break_one("\"scene_index\": 7", "\"world\": \"moon\""), ["world"]);
        assert_eq!(violations("[]"), ["(file)"]);
        assert_eq!(violations("{\"a\":"), ["(file)"]);
        assert_eq!(violations("{}"), ["(file)"]);
    }

    proptest! {
        #[test]
        fn never_panics_on_mutated_text(at in 0..REAL.len(), cut in 0..9usize, insert in "[\\]\\[{}\",:0-9eE.nulltrue -]{0,6}") {
            let end = (at + cut).min(REAL.len());
            let text = format!("{}{insert}{}", &REAL[..at], &REAL[end..]);
            let _ = parse("mutated", &text);
        }
    }
}
