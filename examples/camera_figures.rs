//! Measures how accurate image points, an estimated camera and detections are, compared with metres:
//! `cargo run --release --example camera_figures -- FOLDER [points|camera|detections|physics|seed=N]...`
//!
//! FOLDER holds scenes with `observed.json` (with image points) and `truth.json`. With a seed, positions, yaws and image
//! points are the true ones with new noise.

#![allow(clippy::disallowed_methods)] // Simulated scenes need not have the same bits everywhere.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vrdp::num::{Vec2, never, vec2};
use vrdp::scene::{
    AttributeScores, BoundingBox, Camera, Detection, LinkOptions, PointPair, Scene, Shape, calibrate, link,
    mask_bounds, parse,
};

/// Standard deviation of the image points in the benchmark (px).
const SIGMA_PX: f64 = 0.5;
/// Height of the object centres in the benchmark (m).
const HEIGHT: f64 = 0.2;
/// Number of simulations in the ensemble of a prediction.
const ROLLOUTS: usize = 32;

struct World {
    scene: Scene,
    observed: Value,
    truth: Value,
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or("tests/data/clevrer".into()));
    let (seeds, chosen): (Vec<String>, Vec<String>) = arguments.partition(|a| a.starts_with("seed="));
    let wants = |name: &str| chosen.is_empty() || chosen.iter().any(|c| c == name);
    let mut worlds = worlds(&folder);
    println!("{} scenes {}", worlds.len(), seeds.join(" "));
    if let Some(seed) = seeds.iter().find_map(|s| s["seed=".len()..].parse::<u64>().ok()) {
        worlds.iter_mut().enumerate().for_each(|(k, w)| w.measure_again(seed << 32 | k as u64));
    }
    if wants("points") {
        points(&worlds);
    }
    if wants("camera") {
        camera(&worlds);
    }
    if wants("detections") {
        link_all(&worlds, false);
        link_all(&worlds, true);
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

    /// Frame, object, image point and noisy position of all visible objects.
    fn visible(&self) -> Vec<(usize, usize, [f64; 2], Vec2)> {
        let mut visible = vec![];
        for frame in self.observed["motion_trajectory"].as_array().unwrap() {
            let f = frame["frame_id"].as_u64().unwrap() as usize;
            for object in frame["objects"].as_array().unwrap() {
                let point = &object["image_center"];
                let (Some(u), Some(v)) = (point[0].as_f64(), point[1].as_f64()) else { continue };
                if object["inside_camera_view"] == Value::Bool(true) {
                    let id = object["object_id"].as_u64().unwrap() as u32;
                    let index = self.scene.object_index(id).unwrap();
                    let at = &object["location"];
                    visible.push((f, index, [u, v], vec2(at[0].as_f64().unwrap(), at[1].as_f64().unwrap())));
                }
            }
        }
        visible
    }

    /// Replaces the measurements by the truth plus new noise of the benchmark.
    fn measure_again(&mut self, seed: u64) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = |sigma: f64| -> f64 {
            let z: f64 = StandardNormal.sample(&mut random);
            sigma * z
        };
        let camera = self.camera();
        let [metres, turn] = ["noise_sigma", "noise_yaw"].map(|key| self.truth[key].as_f64().unwrap());
        for frame in self.observed["motion_trajectory"].as_array_mut().unwrap() {
            let f = frame["frame_id"].as_u64().unwrap() as usize;
            for object in frame["objects"].as_array_mut().unwrap() {
                let id = object["object_id"].as_u64().unwrap() as u32;
                let state = &self.truth["trajectory"][f][self.scene.object_index(id).unwrap()];
                let [x, y, yaw] = [0, 1, 2].map(|k| state[k].as_f64().unwrap());
                object["location"][0] = (x + noise(metres)).into();
                object["location"][1] = (y + noise(metres)).into();
                object["orientation"][2] = (yaw + noise(turn)).into();
                if let Some([u, v]) = camera.project(vec2(x, y), HEIGHT) {
                    object["image_center"] = vec![u + noise(SIGMA_PX), v + noise(SIGMA_PX)].into();
                }
            }
        }
        self.scene = parse(&self.scene.name, &self.observed.to_string()).unwrap();
    }

    /// The scene from its image points only; with `yaw`, also from its yaws.
    fn of_pixels(&self, yaw: bool) -> Scene {
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

/// Error of the tracks compared with the noise that the covariance of each point states.
fn points(worlds: &[World]) {
    let (mut white, mut error, mut stated, mut metres, mut count) = (0.0, 0.0, 0.0, 0.0, 0);
    for world in worlds {
        for (frame, object, pixel, given) in world.visible() {
            metres += (given - world.true_state(frame, object)).norm_squared();
            let (found, c) = world.camera().locate(pixel, HEIGHT, [SIGMA_PX; 2]).unwrap();
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
        "points: {count} coordinates; error {:.4} m, propagated {:.4} m, ratio {:.3}; whitened {:.3}; the positions given in \
         metres {:.4} m, ratio {:.3}",
        (error / n).sqrt(),
        (stated / n).sqrt(),
        (error / stated).sqrt(),
        (white / n).sqrt(),
        (metres / n).sqrt(),
        (error / metres).sqrt()
    );
}

/// Estimates a camera from the point pairs of five scenes and tests it on the others.
fn camera(worlds: &[World]) {
    let count = 5.min(worlds.len() / 2);
    for first in [0, count, 2 * count] {
        let known = &worlds[first..first + count];
        let pair = |(_, _, image, at): (usize, usize, [f64; 2], Vec2)| PointPair {
            image,
            world: [at.x, at.y, HEIGHT],
        };
        let pairs: Vec<PointPair> = known.iter().flat_map(|w| w.visible().into_iter().map(pair)).collect();
        let found = calibrate(&pairs, worlds[0].camera().image_size, &vrdp::num::never).unwrap();
        let (mut reprojection, mut error, mut given, mut n) = (0.0, 0.0, 0.0, 0.0);
        for (i, world) in worlds.iter().enumerate() {
            if (first..first + count).contains(&i) {
                continue;
            }
            for (frame, object, pixel, _) in world.visible() {
                let truth = world.true_state(frame, object);
                let [u, v] = found.camera.project(truth, HEIGHT).unwrap();
                reprojection += (u - pixel[0]).powi(2) + (v - pixel[1]).powi(2);
                let off = |camera: &Camera| {
                    (camera.locate(pixel, HEIGHT, [0.0; 2]).unwrap().0 - truth).norm_squared()
                };
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

/// Errors of the fitted motion within and after the video, from metres and from image points; and how well the predicted
/// standard deviations cover the errors after it.
fn physics(worlds: &[World]) {
    use vrdp::fit::{FitOptions, fit};
    use vrdp::reason::{PredictionRequest, predict};
    use vrdp::world::Preset;
    for (name, scene) in [
        ("metres and yaws", &(|w: &World| w.scene.clone()) as &dyn Fn(&World) -> Scene),
        ("pixels and yaws", &|w| w.of_pixels(true)),
        ("pixels alone", &|w| w.of_pixels(false)),
    ] {
        let (mut inside, mut after, mut adequate, mut deviations) = (vec![], vec![], 0, vec![]);
        for world in worlds {
            let scene = scene(world);
            let model = Preset::for_world(scene.world).model(&scene);
            let fit = fit(std::slice::from_ref(&scene), &[model], &FitOptions::default(), &never).unwrap();
            adequate += usize::from(fit.scenes[0].adequate);
            let frames = world.truth["trajectory"].as_array().unwrap().len();
            let request = PredictionRequest { interventions: vec![], frames, rollouts: ROLLOUTS, seed: 0 };
            let found = predict(&scene, &fit, 0, &request, &never).unwrap();
            let (mut observed, mut future) = (vec![], vec![]);
            for (frame, row) in found.best.states.iter().enumerate() {
                for (object, state) in row.iter().enumerate() {
                    let truth = world.true_state(frame, object);
                    let Some(state) = state.filter(|_| world.camera().sees(truth, HEIGHT)) else { continue };
                    let off = state.position - truth;
                    if frame < scene.times.len() {
                        observed.push(off.norm_squared());
                        continue;
                    }
                    future.push(off.norm_squared());
                    let sd = found.sd[frame][object].unwrap();
                    deviations.extend([off.x, off.y].map(|e| e.abs() / sd));
                }
            }
            inside.push(observed);
            after.push(future);
        }
        let text = |all: &[Vec<f64>]| {
            let rms = |v: &[f64]| (v.iter().sum::<f64>() / v.len() as f64).sqrt();
            let median = |mut v: Vec<f64>| {
                v.sort_by(f64::total_cmp);
                v[v.len() / 2]
            };
            let pooled = all.concat();
            let scenes = all.iter().filter(|v| !v.is_empty()).map(|v| rms(v)).collect();
            format!("{:.4} / {:.4} / {:.4} m", rms(&pooled), median(pooled.clone()).sqrt(), median(scenes))
        };
        let within = |n: f64| {
            let count = deviations.iter().filter(|d| **d <= n).count();
            100.0 * count as f64 / deviations.len() as f64
        };
        println!(
            "physics from {name}: observed {}, future {}, {:.1} % within 1 sd and {:.1} % within 2, adequate {adequate}",
            text(&inside),
            text(&after),
            within(1.0),
            within(2.0)
        );
    }
}

/// Points of a body's surface in the image, at its true position and yaw.
fn surface(camera: &Camera, shape: &Shape, at: Vec2, yaw: f64) -> Vec<[f64; 2]> {
    let mut points = vec![];
    let mut add = |off: Vec2, z: f64| points.extend(camera.project(at + off, z));
    match *shape {
        Shape::Ball { radius } => {
            for (k, l) in (0..48).flat_map(|k| (0..25).map(move |l| (k, l))) {
                let (a, b) =
                    (k as f64 * std::f64::consts::TAU / 48.0, l as f64 * std::f64::consts::PI / 24.0);
                add(vec2(a.cos(), a.sin()).scaled(radius * b.sin()), radius * (1.0 + b.cos()));
            }
        }
        Shape::Disc { radius } => {
            for k in 0..96 {
                let a = k as f64 * std::f64::consts::TAU / 96.0;
                add(vec2(a.cos(), a.sin()).scaled(radius), 0.0);
                add(vec2(a.cos(), a.sin()).scaled(radius), 2.0 * radius);
            }
        }
        _ => {
            let r = shape.centre_height();
            for (x, y) in [(r, r), (r, -r), (-r, r), (-r, -r)] {
                add(vec2(x, y).rotated(Vec2::from_angle(yaw)), 0.0);
                add(vec2(x, y).rotated(Vec2::from_angle(yaw)), 2.0 * r);
            }
        }
    }
    points
}

/// First and last row of a convex body's image in each column.
fn columns(points: &[[f64; 2]], width: usize, height: usize) -> Vec<(usize, usize, usize)> {
    let mut hull: Vec<[f64; 2]> = vec![];
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    // Lower and upper chain (Andrew).
    for chain in [sorted.clone(), sorted.into_iter().rev().collect()] {
        let start = hull.len();
        for p in chain {
            while hull.len() >= start + 2 {
                let ([a, b], [c, d]) = (hull[hull.len() - 2], hull[hull.len() - 1]);
                if (c - a) * (p[1] - b) - (d - b) * (p[0] - a) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(p);
        }
    }
    let row = |column: usize| {
        let u = column as f64 + 0.5;
        let cuts = (0..hull.len()).filter_map(|k| {
            let (a, b) = (hull[k], hull[(k + 1) % hull.len()]);
            let share = (u - a[0]) / (b[0] - a[0]);
            (0.0..=1.0).contains(&share).then(|| a[1] + share * (b[1] - a[1]))
        });
        let (low, high) =
            cuts.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (f64::min(l, v), f64::max(h, v)));
        let (first, last) = ((low - 0.5).ceil().max(0.0), (high - 0.5).floor().min(height as f64 - 1.0));
        (first <= last).then_some((column, first as usize, last as usize))
    };
    (0..width).filter_map(row).collect()
}

/// The values of color, material and shape.
const LOOKS: [&[&str]; 3] = [
    &["gray", "red", "blue", "green", "brown", "cyan", "purple", "yellow"],
    &["metal", "rubber"],
    &["cube", "sphere", "cylinder"],
];

/// The bounding box of the pixels of an object; `None` if they are too few. `owner` has the object of each pixel.
fn bounds_of_mask(owner: &[usize], object: usize, [width, height]: [usize; 2]) -> Option<BoundingBox> {
    if owner.iter().filter(|&&p| p == object).count() < 20 {
        return None;
    }
    let mut counts = vec![0i64];
    let mut now = false;
    for &p in owner {
        if (p == object) != now {
            now = !now;
            counts.push(0);
        }
        *counts.last_mut().unwrap() += 1;
    }
    Some(mask_bounds([height as u64, width as u64], &counts).unwrap())
}

/// The bounding box of points in the image, each edge with a noise of 1 px.
fn noisy_bounds(
    points: &[[f64; 2]],
    [width, height]: [usize; 2],
    uniform: &mut impl FnMut(f64, f64) -> f64,
) -> BoundingBox {
    let least = |k: usize| points.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
    let most = |k: usize| points.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
    let mut edge = |v: f64, size: usize| {
        let z: f64 = StandardNormal.sample(&mut ChaCha8Rng::seed_from_u64(uniform(0.0, 1e15) as u64));
        (v + z).clamp(0.0, size as f64)
    };
    BoundingBox {
        left: edge(least(0), width),
        top: edge(least(1), height),
        right: edge(most(0), width),
        bottom: edge(most(1), height),
    }
}

/// A detection at a random place with a random appearance.
fn false_detection(
    frames: usize,
    [width, height]: [usize; 2],
    uniform: &mut impl FnMut(f64, f64) -> f64,
) -> Detection {
    let (u, v) = (uniform(0.0, width as f64 - 20.0), uniform(20.0, height as f64 - 20.0));
    let (w, h) = (uniform(15.0, 60.0), uniform(15.0, 60.0));
    let bounds =
        BoundingBox { left: u, top: v, right: (u + w).min(width as f64), bottom: (v + h).min(height as f64) };
    let mut look = |k: usize| {
        AttributeScores::from([(LOOKS[k][uniform(0.0, LOOKS[k].len() as f64) as usize].to_string(), 1.0)])
    };
    let (color, material, shape) = (look(0), look(1), look(2));
    let frame = uniform(0.0, frames as f64) as usize;
    Detection { frame, bounds, color, material, shape, score: 1.0, features: vec![] }
}

/// Simulated detections in random order, each with its object; `None`: a false detection.
fn detections(world: &World, masks: bool, random: &mut ChaCha8Rng) -> Vec<(Detection, Option<usize>)> {
    let camera = world.camera();
    let size @ [width, height] = camera.image_size.map(|v| v as usize);
    let mut uniform = |low: f64, high: f64| Uniform::new(low, high).unwrap().sample(&mut *random);
    let mut found: Vec<(Detection, Option<usize>)> = vec![];
    let mut frames: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    world.visible().iter().for_each(|s| frames.entry(s.0).or_default().push(s.1));
    for (frame, mut objects) in frames {
        let depth = |o: &usize| {
            let (at, m) = (world.true_state(frame, *o), camera.matrix[2]);
            m[0] * at.x + m[1] * at.y
        };
        objects.sort_by(|a, b| depth(b).total_cmp(&depth(a)));
        let image = |o: usize| {
            let yaw = world.truth["trajectory"][frame][o][2].as_f64().unwrap();
            surface(&camera, &world.scene.objects[o].shape, world.true_state(frame, o), yaw)
        };
        let mut owner = vec![usize::MAX; width * height];
        if masks {
            for &o in &objects {
                for (column, first, last) in columns(&image(o), width, height) {
                    owner[column * height + first..=column * height + last].fill(o);
                }
            }
        }
        for &o in &objects {
            if uniform(0.0, 1.0) < 0.1 {
                continue;
            }
            let bounds = match masks {
                true => bounds_of_mask(&owner, o, size),
                false => Some(noisy_bounds(&image(o), size, &mut uniform)),
            };
            let Some(bounds) = bounds else { continue };
            let object = &world.scene.objects[o];
            let words = [object.color.as_str(), object.material.as_str(), object.shape.word()];
            let mut look = |k: usize| {
                let words = if uniform(0.0, 1.0) < 0.1 {
                    LOOKS[k][uniform(0.0, LOOKS[k].len() as f64) as usize]
                } else {
                    words[k]
                };
                AttributeScores::from([(words.to_string(), 1.0)])
            };
            let (color, material, shape) = (look(0), look(1), look(2));
            found.push((
                Detection { frame, bounds, color, material, shape, score: 1.0, features: vec![] },
                Some(o),
            ));
        }
    }
    for _ in 0..found.len() / 20 {
        found.push((false_detection(world.scene.times.len(), size, &mut uniform), None));
    }
    for k in (1..found.len()).rev() {
        found.swap(k, uniform(0.0, k as f64 + 1.0) as usize);
    }
    found
}

/// Links detections to tracks, and scores identities, attributes and positions.
fn link_all(worlds: &[World], masks: bool) {
    let (mut clean, mut switches, mut right, mut all, mut strangers) = (0, 0, 0, 0, 0);
    let (mut white, mut error, mut stated, mut n) = (vec![], vec![], 0.0, 0.0);
    let (mut wrong_scenes, mut dropped, mut given) = (vec![], 0, 0);
    for (k, world) in worlds.iter().enumerate() {
        let mut random = ChaCha8Rng::seed_from_u64(k as u64);
        let found = detections(world, masks, &mut random);
        let list: Vec<Detection> = found.iter().map(|f| f.0.clone()).collect();
        let options = LinkOptions {
            frames: world.scene.times.len(),
            fps: world.scene.fps,
            camera: world.camera(),
            size: 0.2,
            sigma: 1.0,
        };
        let linked = link(&list, &options, &vrdp::num::never).unwrap();
        (dropped, given) = (dropped + linked.report.detections_dropped, given + list.len());
        let (mut here, mut wrong) = (0, 0);
        let mut owner = vec![vec![]; world.scene.objects.len()];
        for (track, members) in linked.members.iter().enumerate() {
            let truth: Vec<usize> = members.iter().filter_map(|&m| found[m].1).collect();
            here += truth.windows(2).filter(|w| w[0] != w[1]).count();
            strangers += usize::from(2 * truth.len() < members.len());
            truth.iter().for_each(|&o| owner[o].push(track));
            for (&m, sample) in members.iter().zip(&linked.tracks[track].samples) {
                if let Some(o) = found[m].1 {
                    let (off, c) =
                        (sample.position - world.true_state(sample.frame, o), sample.covariance.unwrap());
                    let [xx, yx, yy] = c.factor().unwrap();
                    let a = off.x / xx;
                    white.push((a * a + ((off.y - yx * a) / yy).powi(2)) / 2.0);
                    error.push(off.norm_squared() / 2.0);
                    (stated, n) = (stated + c.mean(), n + 1.0);
                }
            }
        }
        for (object, tracks) in world.scene.objects.iter().zip(&owner) {
            let Some(&first) = tracks.first() else { continue };
            here += tracks.windows(2).filter(|w| w[0] != w[1]).count();
            let f = &linked.objects[first];
            let same = f.color == object.color
                && f.material == object.material
                && f.shape.word() == object.shape.word();
            (right, all, wrong) = (right + usize::from(same), all + 1, wrong + usize::from(!same));
        }
        switches += here;
        clean += usize::from(here == 0);
        if here + wrong > 0 {
            wrong_scenes.push(format!("{} ({here} switches, {wrong} looks)", world.scene.name));
        }
    }
    white.sort_by(f64::total_cmp);
    error.sort_by(f64::total_cmp);
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    println!(
        "{}: {clean} of {} scenes without a switch ({switches} in all), looks right {right} of {all}, {strangers} false \
         tracks, {dropped} of {given} detections dropped; position error {:.4} m rms, {:.4} m median, stated {:.4} m rms; \
         whitened {:.2} rms, {:.2} median; {}",
        if masks { "masks" } else { "boxes" },
        worlds.len(),
        mean(&error).sqrt(),
        error[error.len() / 2].sqrt(),
        f64::sqrt(stated / n),
        mean(&white).sqrt(),
        // Half a squared distance of two unit normals has the median ln 2.
        (white[white.len() / 2] / std::f64::consts::LN_2).sqrt(),
        wrong_scenes.join(", ")
    );
}
