//! Reads CLEVRER annotation files and our `observed.json`, which adds optional keys to them.

use crate::num::{elementary, vec2};
use crate::scene::camera::placement::{IMAGE_NOISE, IMAGE_NOISE_RANGE, Pixel};
use crate::scene::camera::projection::{CLEVRER_CAMERA, Camera};
use crate::scene::covariance::Covariance;
use crate::scene::files::assumptions::{StatedValues, assumptions};
use crate::scene::files::json_fields::{JsonFields, join, type_name};
use crate::scene::limits::{DEFAULT_FPS, DEFAULT_SIZE, MAX_FRAMES, MAX_OBJECTS};
use crate::scene::object::{Object, Shape};
use crate::scene::observation::{Sample, Scene, Table, Track, WorldKind};
use crate::scene::violations::{SceneError, readable};
use serde_json::{Map, Value};
use std::collections::BTreeSet;

/// Reads the text of an annotation file. Besides CLEVRER's keys it may have `fps`, `times` (s, one a frame), `world`, `setup`,
/// `camera_matrix`, `image_size`, `image_noise_px`, `table`, `noise_sigma`, an object's `size`, `mass` and `features`, and a sample's
/// `covariance` (xx, xy, yy in m^2). A sample with `image_center` (px) and no `location` is placed by the camera.
/// Unknown keys are ignored; everything that is wrong is reported at once.
pub fn parse(name: &str, text: &str) -> Result<Scene, SceneError> {
    Ok(read_annotation(name, text)?.0)
}

/// The same, with a line for each thing that is assumed because the file does not state it.
pub fn read_annotation(name: &str, text: &str) -> Result<(Scene, Vec<String>), SceneError> {
    let mut reader = AnnotationReader::default();
    // Some editors write a byte order mark first.
    let root: Map<String, Value> = match serde_json::from_str::<Value>(text.trim_start_matches('\u{feff}')) {
        Ok(Value::Object(root)) => root,
        Ok(other) => {
            reader.fields.violations.add("(file)", format!("is {}; give a JSON object", type_name(&other)));
            Map::new()
        }
        Err(error) => {
            reader.fields.violations.add("(file)", format!("is not JSON: {error}"));
            Map::new()
        }
    };
    let scene = if root.is_empty() { None } else { Some(reader.scene(name, &root)) };
    reader.fields.violations.finish()?;
    let scene = scene.ok_or_else(|| SceneError::single("(file)", "is empty; give an annotation"))?;
    let scene = scene.validate()?;
    let assumed = assumptions(&scene, &stated(&root));
    Ok((scene, assumed))
}

/// What an annotation states. Without any key of ours it is CLEVRER's own, whose sizes and frame rate are known.
fn stated(root: &Map<String, Value>) -> StatedValues {
    let has = |key: &str| root.get(key).is_some_and(|v| !v.is_null());
    let objects =
        root.get("object_property").and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default();
    let sized = objects.iter().filter(|o| o.get("size").is_some_and(|v| !v.is_null())).count();
    let is_clevrer = !has("world") || root.get("world").and_then(Value::as_str) == Some("clevrer");
    StatedValues {
        size: is_clevrer || sized == objects.len(),
        fps: is_clevrer || has("fps") || has("times"),
        world: has("world"),
        shrunk: None,
        how: [
            "`size` in `object_property`",
            "`\"fps\": 50`",
            "`\"world\": \"table\"`",
            "`mass` in `object_property`",
            "all lengths in m",
        ],
    }
}

/// A sample with an image point only, and its path in the file.
type UnplacedSample = (Pixel, String);

/// The trajectory of a file.
struct Trajectory {
    frames: usize,
    /// One for each object.
    tracks: Vec<Track>,
    /// Samples with an image point only; the camera gives their positions.
    unplaced: Vec<UnplacedSample>,
    /// Image points of samples that have a position too.
    shown: Vec<Pixel>,
}

#[derive(Default)]
struct AnnotationReader {
    fields: JsonFields,
    /// Ids in the trajectory without an object; each is reported once.
    unknown_ids: BTreeSet<u32>,
    /// Whether an object's own id was refused: an unknown id may mean that object.
    bad_ids: bool,
}

impl AnnotationReader {
    fn violation(&mut self, path: impl Into<String>, message: impl Into<String>) {
        self.fields.violations.add(path, message);
    }

    fn scene(&mut self, name: &str, root: &Map<String, Value>) -> Scene {
        let world = self.world(root);
        let fps = self.fields.number(root, "fps", "").unwrap_or(DEFAULT_FPS);
        let (ids, objects) = self.objects(root);
        let Trajectory { frames, mut tracks, unplaced, shown } = self.trajectory(root, &ids);
        for (id, track) in ids.iter().zip(&tracks) {
            if let Some((frame, yaw)) = track.yaw_in_degrees() {
                let message = format!(
                    "is {}, which looks like degrees; give radians (divide degrees by 57.2958)",
                    readable(yaw)
                );
                self.violation(format!("frame {frame}, object {id}: orientation[2]"), message);
            }
        }
        let mut camera = self.camera(root);
        if let Some(wrong) = camera.as_ref().and_then(|camera| camera.mismatch(&shown, &objects, &tracks)) {
            self.fields.violations.add(wrong.path, wrong.message);
        }
        if camera.is_none() && world == WorldKind::Clevrer && !root.contains_key("camera_matrix") {
            camera = Some(Camera { image_size: self.image_size(root), ..CLEVRER_CAMERA });
        }
        if !unplaced.is_empty() {
            camera = self.place(root, camera, &unplaced, &objects, &mut tracks).or(camera);
        }
        Scene {
            name: name.to_string(),
            setup: self.fields.text(root, "setup", ""),
            world,
            fps,
            times: self.times(root, frames, if fps > 0.0 { fps } else { DEFAULT_FPS }),
            camera,
            table: self.table(root),
            noise_sigma: self.fields.number(root, "noise_sigma", ""),
            objects,
            tracks,
            outliers: vec![],
            findings: vec![],
            feature_layout: self.fields.text(root, "feature_layout", ""),
            absent: vec![],
        }
    }

    fn times(&mut self, root: &Map<String, Value>, frames: usize, fps: f64) -> Vec<f64> {
        let value = root.get("times").filter(|v| !v.is_null());
        let given = value.and_then(|v| self.fields.numbers(Some(v), "times", &[frames]));
        given.unwrap_or_else(|| (0..frames).map(|f| f as f64 / fps).collect())
    }

    fn world(&mut self, root: &Map<String, Value>) -> WorldKind {
        let Some(word) = self.fields.text(root, "world", "") else { return WorldKind::Clevrer };
        WorldKind::named(&word).unwrap_or_else(|| {
            let known = "clevrer, table, air_table or billiards";
            self.violation("world", format!("is \"{word}\"; it must be {known}"));
            WorldKind::Clevrer
        })
    }

    fn objects(&mut self, root: &Map<String, Value>) -> (Vec<u32>, Vec<Object>) {
        let mut objects = vec![];
        for (i, entry) in
            self.fields.list(root, "object_property", "").iter().take(MAX_OBJECTS + 1).enumerate()
        {
            let path = format!("object_property[{i}]");
            let Some(entry) = self.fields.object(entry, &path) else { continue };
            let id = self.fields.required_id(entry, &path);
            let size = self.fields.number(entry, "size", &path).unwrap_or(DEFAULT_SIZE);
            let shape = self.fields.text(entry, "shape", &path);
            let shape = match shape.as_deref().map(str::to_ascii_lowercase).as_deref() {
                Some("cylinder" | "disc" | "disk" | "puck" | "coin") => Shape::Disc { radius: size },
                Some("sphere" | "ball") => Shape::Ball { radius: size },
                Some("cube" | "box" | "block" | "square") => Shape::Square { half_side: size },
                other => {
                    let found = other.map_or("missing".to_string(), |s| format!("\"{s}\""));
                    let message = format!("is {found}; it must be sphere, cylinder or cube");
                    self.violation(format!("{path}.shape"), message);
                    Shape::Disc { radius: size }
                }
            };
            let mut word = |key| self.fields.text(entry, key, &path).unwrap_or_default().to_lowercase();
            let (color, material) = (word("color"), word("material"));
            let mass = self.fields.number(entry, "mass", &path);
            let features = self.fields.features(entry, &path);
            match id {
                Some(id) if objects.iter().any(|o: &Object| o.id == id) => {
                    let message = format!("is {id}, the id of another object; give each object its own id");
                    self.violation(format!("{path}.object_id"), message);
                    self.bad_ids = true;
                }
                Some(id) => objects.push(Object { id, color, material, shape, mass, features }),
                None => self.bad_ids = true,
            }
        }
        (objects.iter().map(|o| o.id).collect(), objects)
    }

    /// The tracks of these objects; frame indices are the file's `frame_id`.
    fn trajectory(&mut self, root: &Map<String, Value>, ids: &[u32]) -> Trajectory {
        let tracks = vec![Track::default(); ids.len()];
        let mut found = Trajectory { frames: 0, tracks, unplaced: vec![], shown: vec![] };
        let trajectory = self.fields.list(root, "motion_trajectory", "");
        let says_visible = trajectory.iter().any(|frame| {
            let objects = frame.get("objects").and_then(Value::as_array);
            objects.is_some_and(|o| o.iter().any(|o| o.get("inside_camera_view").is_some()))
        });
        for (k, entry) in trajectory.iter().enumerate() {
            let path = format!("motion_trajectory[{k}]");
            let Some(entry) = self.fields.object(entry, &path) else { continue };
            let Some(frame) = self.frame(entry, &path, found.frames) else { continue };
            found.frames = frame + 1;
            for (j, seen) in self.fields.list(entry, "objects", &path).iter().enumerate() {
                let path = format!("{path}.objects[{j}]");
                let Some(seen) = self.fields.object(seen, &path) else { continue };
                self.add_sample(seen, &path, (frame, says_visible), ids, &mut found);
            }
        }
        found
    }

    /// The index of a frame, which is at least `least`.
    fn frame(&mut self, entry: &Map<String, Value>, path: &str, least: usize) -> Option<usize> {
        let Some(id) = entry.get("frame_id") else { return Some(least) };
        let message = match id.as_u64().map(|f| f as usize) {
            Some(frame) if frame >= MAX_FRAMES => {
                format!("is {frame}; at most {MAX_FRAMES} frames are allowed")
            }
            Some(frame) if frame < least => format!("is {frame} after {}; frames must increase", least - 1),
            Some(frame) => return Some(frame),
            None => format!("is {}; give a whole number from 0", type_name(id)),
        };
        self.violation(format!("{path}.frame_id"), message);
        None
    }

    /// Adds an object's entry in a frame to its track. `says_visible`: the file states visibility.
    fn add_sample(
        &mut self,
        seen: &Map<String, Value>,
        path: &str,
        (frame, says_visible): (usize, bool),
        ids: &[u32],
        to: &mut Trajectory,
    ) {
        let Some(id) = self.fields.required_id(seen, path) else { return };
        let object = ids.iter().position(|known| *known == id);
        let Some((object, track)) = object.and_then(|i| Some((i, to.tracks.get_mut(i)?))) else {
            if !self.bad_ids && self.unknown_ids.insert(id) {
                let message = format!("is {id}, which object_property lacks; add the object there");
                self.violation(format!("{path}.object_id"), message);
            }
            return;
        };
        let Some(sample) = self.sample(seen, path, frame, says_visible) else { return };
        let index = track.samples.len();
        let has_position = seen.contains_key("location");
        match self.fields.pair(seen, "image_center", path) {
            Some(point) if has_position => to.shown.push(Pixel { object, sample: index, point }),
            Some(point) => {
                to.unplaced.push((Pixel { object, sample: index, point }, join(path, "image_center")));
            }
            None if has_position => {}
            None => return,
        }
        track.samples.push(sample);
    }

    fn sample(
        &mut self,
        seen: &Map<String, Value>,
        path: &str,
        frame: usize,
        says_visible: bool,
    ) -> Option<Sample> {
        match seen.get("inside_camera_view") {
            Some(Value::Bool(true)) => {}
            None if !says_visible => {}
            Some(Value::Bool(false)) | None | Some(Value::Null) => return None,
            Some(other) => {
                let message = format!("is {}; give true or false", type_name(other));
                self.violation(format!("{path}.inside_camera_view"), message);
                return None;
            }
        }
        // The camera turns the image point into a position later.
        let imaged = !seen.contains_key("location") && seen.contains_key("image_center");
        let location = match imaged {
            true => vec![0.0, 0.0],
            false => self.fields.numbers(seen.get("location"), &format!("{path}.location"), &[2, 3])?,
        };
        let covariance = match seen.get("covariance").filter(|_| !imaged) {
            None | Some(Value::Null) => None,
            some => match self.fields.numbers(some, &format!("{path}.covariance"), &[3])?[..] {
                [xx, xy, yy] => Some(Covariance { xx, xy, yy }),
                _ => None,
            },
        };
        let yaw = match seen.get("orientation") {
            None | Some(Value::Null) => None,
            some => match self.fields.numbers(some, &format!("{path}.orientation"), &[3, 4])?[..] {
                [_, _, yaw] => Some(yaw),
                // A quaternion in Bullet's order.
                [x, y, z, w] => Some(elementary::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))),
                _ => None,
            },
        };
        let position = vec2(*location.first()?, *location.get(1)?);
        Some(Sample { frame, position, yaw, covariance })
    }

    /// Gives samples with an image point only their positions; returns the camera with the sign of its matrix corrected.
    fn place(
        &mut self,
        root: &Map<String, Value>,
        camera: Option<Camera>,
        unplaced: &[UnplacedSample],
        objects: &[Object],
        tracks: &mut [Track],
    ) -> Option<Camera> {
        let sigma = self.fields.number(root, "image_noise_px", "").unwrap_or(IMAGE_NOISE);
        if !IMAGE_NOISE_RANGE.contains(&sigma) {
            let (low, high) = (IMAGE_NOISE_RANGE.start(), IMAGE_NOISE_RANGE.end());
            self.violation(
                "image_noise_px",
                format!("is {}; it must be from {low} to {high} px", readable(sigma)),
            );
            return None;
        }
        let Some(camera) = camera else {
            if !root.contains_key("camera_matrix") {
                let message = "is missing; give the 3x4 projection matrix, as samples have image points only";
                self.violation("camera_matrix", message);
            }
            return None;
        };
        let placed = camera.place(&unplaced.iter().map(|p| p.0).collect::<Vec<_>>(), sigma, objects, tracks);
        let (camera, refused) = placed.map_err(|e| self.violation("camera_matrix", e.to_string())).ok()?;
        for (k, error) in refused {
            let (pixel, path) = &unplaced[k];
            let frame = tracks[pixel.object].samples[pixel.sample].frame;
            self.violation(path, format!("frame {frame}: {error}"));
        }
        Some(camera)
    }

    fn camera(&mut self, root: &Map<String, Value>) -> Option<Camera> {
        let rows = match root.get("camera_matrix")? {
            Value::Null => return None,
            Value::Array(rows) if matches!(rows.len(), 3 | 4) => rows,
            other => {
                let message = format!("is {}; give 3 or 4 rows of 4 numbers", type_name(other));
                self.violation("camera_matrix", message);
                return None;
            }
        };
        let mut matrix = [[0.0; 4]; 3];
        for (i, (slot, row)) in matrix.iter_mut().zip(rows).enumerate() {
            let row = self.fields.numbers(Some(row), &format!("camera_matrix[{i}]"), &[4])?;
            slot.iter_mut().zip(row).for_each(|(slot, v)| *slot = v);
        }
        Some(Camera { matrix, image_size: self.image_size(root) })
    }

    fn image_size(&mut self, root: &Map<String, Value>) -> [f64; 2] {
        self.fields.pair(root, "image_size", "").unwrap_or(CLEVRER_CAMERA.image_size)
    }

    fn table(&mut self, root: &Map<String, Value>) -> Option<Table> {
        let value = root.get("table").filter(|v| !v.is_null())?;
        let table = self.fields.object(value, "table")?;
        for axis in ["x", "y"].into_iter().filter(|axis| !table.contains_key(*axis)) {
            self.violation(format!("table.{axis}"), "is missing; give [low, high]");
        }
        let (x, y) = (self.fields.pair(table, "x", "table"), self.fields.pair(table, "y", "table"));
        Some(Table { x: x?, y: y? })
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
    fn reads_every_scene_of_the_shared_data() {
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
        let unknown = REAL.replace("{\"object_id\": 1, \"loc", "{\"object_id\": 7, \"loc");
        assert_eq!(violations(&unknown), ["motion_trajectory[0].objects[1].object_id"]);
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
