// How well image points, an estimated camera and detections stand for metres: `cargo run --release --example
// camera_figures -- FOLDER [points|camera|detections|physics]...`, FOLDER holding scenes with `observed.json` (image
// points included) and `truth.json`.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde_json::Value;
use std::path::{Path, PathBuf};
use vrdp::num::{Vec2, never, vec2};
use vrdp::scene::{Camera, PointPair, Scene, calibrate, parse};

/// Deviation of the image points in the benchmark (px).
const SIGMA_PX: f64 = 0.5;
/// Height of the centres there (m).
const HEIGHT: f64 = 0.2;

struct World {
    scene: Scene,
    observed: Value,
    truth: Value,
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or("tests/data/clevrer".into()));
    let chosen: Vec<String> = arguments.collect();
    let wants = |name: &str| chosen.is_empty() || chosen.iter().any(|c| c == name);
    let worlds = worlds(&folder);
    println!("{} scenes", worlds.len());
    if wants("points") {
        points(&worlds);
    }
    if wants("camera") {
        camera(&worlds);
    }
    if wants("physics") {
        physics(&worlds);
    }
}

fn worlds(folder: &Path) -> Vec<World> {
    let mut folders: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    folders.sort();
    let json =
        |path: PathBuf| -> Value { serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap() };
    let world = |path: &PathBuf| {
        let observed = json(path.join("observed.json"));
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let scene = parse(&name, &observed.to_string()).unwrap();
        World { scene, observed, truth: json(path.join("truth.json")) }
    };
    folders.iter().filter(|p| p.join("truth.json").is_file()).map(world).collect()
}

impl World {
    fn camera(&self) -> Camera {
        self.scene.camera.unwrap()
    }

    fn true_state(&self, frame: usize, object: usize) -> Vec2 {
        let state = &self.truth["trajectory"][frame][object];
        vec2(state[0].as_f64().unwrap(), state[1].as_f64().unwrap())
    }

    /// Frame, object, image point and noisy position of all that was seen.
    fn seen(&self) -> Vec<(usize, usize, [f64; 2], Vec2)> {
        let mut seen = vec![];
        for frame in self.observed["motion_trajectory"].as_array().unwrap() {
            let f = frame["frame_id"].as_u64().unwrap() as usize;
            for object in frame["objects"].as_array().unwrap() {
                let point = &object["image_center"];
                let (Some(u), Some(v)) = (point[0].as_f64(), point[1].as_f64()) else { continue };
                if object["inside_camera_view"] == Value::Bool(true) {
                    let id = object["object_id"].as_u64().unwrap() as u32;
                    let index = self.scene.object_index(id).unwrap();
                    let at = &object["location"];
                    seen.push((f, index, [u, v], vec2(at[0].as_f64().unwrap(), at[1].as_f64().unwrap())));
                }
            }
        }
        seen
    }

    /// The scene as its image points tell it; without yaws unless they are kept.
    fn from_pixels(&self, yaw: bool) -> Scene {
        let mut observed = self.observed.clone();
        observed["image_noise_px"] = SIGMA_PX.into();
        for frame in observed["motion_trajectory"].as_array_mut().unwrap() {
            for object in frame["objects"].as_array_mut().unwrap() {
                let object = object.as_object_mut().unwrap();
                object.remove("location");
                if !yaw {
                    object.remove("orientation");
                }
            }
        }
        parse(&self.scene.name, &observed.to_string()).unwrap()
    }
}

/// Error of the tracks against the noise that each point's covariance states.
fn points(worlds: &[World]) {
    let (mut white, mut error, mut stated, mut count) = (0.0, 0.0, 0.0, 0);
    for world in worlds {
        for (frame, object, pixel, _) in world.seen() {
            let (found, c) = world.camera().locate(pixel, HEIGHT, SIGMA_PX).unwrap();
            let off = found - world.true_state(frame, object);
            let [xx, yx, yy] = c.factor().unwrap();
            let a = off.x / xx;
            let b = (off.y - yx * a) / yy;
            white += a * a + b * b;
            error += off.norm_squared();
            stated += 2.0 * c.mean();
            count += 2;
        }
    }
    let n = count as f64;
    println!(
        "points: {count} coordinates; error {:.4} m, propagated {:.4} m, ratio {:.3}; whitened {:.3}",
        (error / n).sqrt(),
        (stated / n).sqrt(),
        (error / stated).sqrt(),
        (white / n).sqrt()
    );
}

/// A camera estimated from the pairs of five scenes, on all others.
fn camera(worlds: &[World]) {
    let count = 5.min(worlds.len() / 2);
    for first in [0, count, 2 * count] {
        let known = &worlds[first..first + count];
        let pair = |(_, _, image, at): (usize, usize, [f64; 2], Vec2)| PointPair {
            image,
            world: [at.x, at.y, HEIGHT],
        };
        let pairs: Vec<PointPair> = known.iter().flat_map(|w| w.seen().into_iter().map(pair)).collect();
        let found = calibrate(&pairs, worlds[0].camera().image_size).unwrap();
        let (mut reprojection, mut error, mut given, mut n) = (0.0, 0.0, 0.0, 0.0);
        for (i, world) in worlds.iter().enumerate() {
            if (first..first + count).contains(&i) {
                continue;
            }
            for (frame, object, pixel, _) in world.seen() {
                let truth = world.true_state(frame, object);
                let [u, v] = found.camera.project(truth, HEIGHT).unwrap();
                reprojection += (u - pixel[0]).powi(2) + (v - pixel[1]).powi(2);
                let off =
                    |camera: &Camera| (camera.locate(pixel, HEIGHT, 0.0).unwrap().0 - truth).norm_squared();
                error += off(&found.camera);
                given += off(&world.camera());
                n += 2.0;
            }
        }
        println!(
            "camera from scenes {first}..{}: {} pairs, {} outliers, own error {:.3} px a coordinate, focal {:.1} +- {:.1} \
             px; on the others {:.3} px, bird's-eye {:.4} m against {:.4} m with the true camera, ratio {:.3}",
            first + count,
            pairs.len(),
            found.outliers.len(),
            found.reprojection_error,
            found.intrinsics.focal[0],
            found.focal_sd,
            f64::sqrt(reprojection / n),
            f64::sqrt(error / n),
            f64::sqrt(given / n),
            f64::sqrt(error / given)
        );
    }
}

/// Errors of the fitted motion, within and after the video: from metres, and from image points.
fn physics(worlds: &[World]) {
    use vrdp::fit::{FitOptions, fit};
    use vrdp::world::{Preset, trace};
    for (name, scene) in [
        ("metres and yaws", &(|w: &World| w.scene.clone()) as &dyn Fn(&World) -> Scene),
        ("pixels and yaws", &|w| w.from_pixels(true)),
        ("pixels alone", &|w| w.from_pixels(false)),
    ] {
        let (mut inside, mut after, mut adequate) = (vec![], vec![], 0);
        for world in worlds {
            let scene = scene(world);
            let model = Preset::for_world(scene.world).model(&scene);
            let fit = fit(std::slice::from_ref(&scene), &[model], &FitOptions::default(), &never).unwrap();
            adequate += usize::from(fit.scenes[0].adequate);
            let rows = world.truth["trajectory"].as_array().unwrap().len();
            let times: Vec<f64> = (0..rows).map(|f| scene.time_of(f)).collect();
            let found = trace(&fit.scenes[0].model, &times);
            let (mut observed, mut future) = (vec![], vec![]);
            for (frame, row) in found.states.iter().enumerate() {
                for (object, state) in row.iter().enumerate() {
                    let truth = world.true_state(frame, object);
                    let Some(state) = state.filter(|_| world.camera().sees(truth, HEIGHT)) else { continue };
                    let square = (state.position - truth).norm_squared();
                    if frame < scene.times.len() { observed.push(square) } else { future.push(square) }
                }
            }
            inside.push(observed);
            after.push(future);
        }
        let tell = |all: &[Vec<f64>]| {
            let rms = |v: &[f64]| (v.iter().sum::<f64>() / v.len() as f64).sqrt();
            let median = |mut v: Vec<f64>| {
                v.sort_by(f64::total_cmp);
                v[v.len() / 2]
            };
            let pooled = all.concat();
            let scenes = all.iter().filter(|v| !v.is_empty()).map(|v| rms(v)).collect();
            format!("{:.4} / {:.4} / {:.4} m", rms(&pooled), median(pooled.clone()).sqrt(), median(scenes))
        };
        println!(
            "physics from {name}: observed {}, future {}, adequate {adequate}",
            tell(&inside),
            tell(&after)
        );
    }
}

#[allow(dead_code)]
fn random(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}
