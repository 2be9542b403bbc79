//! Scenes, calibration and linking, on synthetic cameras and videos.

use super::*;
use crate::num::{Stopped, never, vec2};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::sync::atomic::{AtomicUsize, Ordering};

#[test]
fn a_description_names_color_material_and_shape() {
    let check = |color: &str, material: &str, expected: &str| {
        let (color, material) = (color.into(), material.into());
        let object = Object {
            id: 3,
            color,
            material,
            shape: Shape::Square { half_side: 0.2 },
            mass: None,
            features: vec![],
        };
        assert_eq!(object.description(), expected);
    };
    check("red", "metal", "red metal cube");
    check("red", "", "red cube");
    check("", "", "cube 3");
}

#[test]
fn a_yaw_that_flips_or_is_missing_does_not_turn_evenly() {
    let check = |yaw: fn(usize) -> Option<f64>, expected: bool| {
        let sample = |frame| Sample { frame, position: vec2(0.0, 0.0), yaw: yaw(frame), covariance: None };
        let track = Track { samples: (0..40).map(sample).collect() };
        assert_eq!(track.turns_evenly(), expected);
    };
    // A steady turn that passes pi, a ball whose mark goes over the top, a frame without a yaw, none at all.
    check(|f| Some((0.2 * f as f64).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI), true);
    check(|f| Some(if f < 20 { 0.1 } else { 3.1 }), false);
    check(|f| (f != 7).then_some(0.1), false);
    check(|_| None, false);
}

fn noise(random: &mut ChaCha8Rng, sd: f64) -> f64 {
    let z: f64 = StandardNormal.sample(random);
    sd * z
}

/// Points on a grid at the heights `z`, projected by CLEVRER's camera.
fn grid(z: impl Fn(usize) -> f64, sigma: f64) -> Vec<PointPair> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let pair = |k: usize| {
        let at = vec2((k % 9) as f64 * 0.6 - 2.0, (k / 9) as f64 * 0.6 - 2.0);
        let [u, v] = CLEVRER_CAMERA.project(at, z(k)).unwrap();
        let image = [u + noise(&mut random, sigma), v + noise(&mut random, sigma)];
        PointPair { image, world: [at.x, at.y, z(k)] }
    };
    (0..63).map(pair).collect()
}

const SIZE: [f64; 2] = [480.0, 320.0];

/// Largest distance between where two cameras show points of a volume (px).
fn largest_distance(found: &Camera, z: f64) -> f64 {
    let at = |k: i32| vec2(f64::from(k % 5) - 2.0, f64::from(k / 5) - 2.0);
    let off = |k| {
        let ([a, b], [u, v]) = (found.project(at(k), z).unwrap(), CLEVRER_CAMERA.project(at(k), z).unwrap());
        (a - u).hypot(b - v)
    };
    (0..25).map(off).fold(0.0, f64::max)
}

#[test]
fn a_camera_is_found_from_points_of_a_plane_also_with_outliers() {
    let mut pairs = grid(|_| 0.2, 0.5);
    for k in (0..pairs.len()).step_by(4) {
        pairs[k].image = [(37 * k % 480) as f64, (91 * k % 320) as f64];
    }
    let found = calibrate(&pairs, SIZE, &never).unwrap();
    let wrong: Vec<usize> = (0..pairs.len()).step_by(4).collect();
    assert_eq!(found.outliers, wrong);
    assert!(found.planar && (0.3..0.7).contains(&found.reprojection_error), "{found:?}");
    assert!(largest_distance(&found.camera, 0.2) < 1.0, "{}", largest_distance(&found.camera, 0.2));
    assert!((found.intrinsics.focal[0] - 525.0).abs() < 4.0 * found.focal_sd, "{found:?}");
}

#[test]
fn a_volume_gives_the_whole_camera_and_four_corners_enough_of_it() {
    let found = calibrate(&grid(|k| (k * 7 % 5) as f64 * 0.3, 0.0), SIZE, &never).unwrap();
    assert!(!found.planar && largest_distance(&found.camera, 0.7) < 0.1, "{found:?}");
    let corners = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]];
    let pair = |[x, y]: [f64; 2]| PointPair {
        image: CLEVRER_CAMERA.project(vec2(x, y), 0.0).unwrap(),
        world: [x, y, 0.0],
    };
    let found = calibrate(&corners.map(pair), SIZE, &never).unwrap();
    assert!(
        largest_distance(&found.camera, 0.0) < 0.5 && largest_distance(&found.camera, 0.2) < 3.0,
        "{found:?}"
    );
    assert!(found.outliers.is_empty() && found.position[2] > 1.0);
    // Straight from above, the middle of the table in the middle of the image: half a turn.
    let seen = |[x, y]: [f64; 2]| PointPair {
        image: [240.0 + 100.0 * x, 160.0 - 50.0 * y],
        world: [x, 0.5 * y, 0.0],
    };
    let found = calibrate(&corners.map(seen), SIZE, &never).unwrap();
    assert!(found.reprojection_error < 0.1 && found.position[0].abs() < 0.01, "{found:?}");
}

#[test]
fn pairs_without_a_camera_are_refused() {
    let refused = |pairs: &[PointPair]| calibrate(pairs, SIZE, &never).unwrap_err();
    let plane = grid(|_| 0.2, 0.0);
    assert_eq!(calibrate(&plane, SIZE, &|_| Err(Stopped)), Err(CalibrateError::Stopped(Stopped)));
    // Wherever it stops, nothing comes of it.
    let polls = AtomicUsize::new(0);
    let counted = |_: f64| {
        polls.fetch_add(1, Ordering::Relaxed);
        Ok(())
    };
    calibrate(&plane, SIZE, &counted).unwrap();
    for after in (0..polls.into_inner()).step_by(7) {
        let left = AtomicUsize::new(after);
        let stop = |_: f64| {
            let one_less = |left: usize| left.checked_sub(1);
            let found = left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, one_less);
            found.map(|_| ()).map_err(|_| Stopped)
        };
        assert_eq!(calibrate(&plane, SIZE, &stop), Err(CalibrateError::Stopped(Stopped)), "{after}");
    }
    let swapped = |p: &PointPair| PointPair { world: [p.world[1], p.world[0], p.world[2]], ..*p };
    let mirrored = |pairs: Vec<PointPair>| refused(&pairs.iter().map(swapped).collect::<Vec<_>>());
    assert_eq!(mirrored(plane.clone()), CalibrateError::Mirrored);
    assert_eq!(mirrored(grid(|k| (k * 7 % 5) as f64 * 0.3, 0.0)), CalibrateError::Mirrored);
    assert_eq!(refused(&plane[..3]), CalibrateError::TooFew { given: 3 });
    let three = [plane[0], plane[1], plane[2], plane[10]];
    assert_eq!(refused(&three), CalibrateError::ThreeOnALine);
    assert_eq!(refused(&plane[..9]), CalibrateError::OnALine { field: "world" });
    let mut broken = plane.clone();
    broken[5].world[2] = f64::NAN;
    assert_eq!(refused(&broken), CalibrateError::NotFinite { index: 5, field: "world" });
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let scattered = |p: &PointPair| PointPair {
        image: [240.0 + noise(&mut random, 90.0), 160.0 + noise(&mut random, 60.0)],
        ..*p
    };
    let scattered: Vec<PointPair> = plane.iter().map(scattered).collect();
    assert!(matches!(refused(&scattered), CalibrateError::NoCamera { .. } | CalibrateError::Mirrored));
}

#[test]
fn degrees_mirrored_axes_and_other_units_are_named_with_frame_and_field() {
    type Entry = serde_json::Value;
    let real = include_str!("../../tests/data/clevrer/scene_00011/observed.json");
    let broken = |change: &dyn Fn(&mut Entry)| -> Vec<String> {
        let mut root: Entry = serde_json::from_str(real).unwrap();
        for frame in root["motion_trajectory"].as_array_mut().unwrap() {
            frame["objects"].as_array_mut().unwrap().iter_mut().for_each(change);
        }
        let read = parse("broken", &root.to_string());
        read.map_or_else(|e| e.violations.into_iter().map(|v| v.path).collect(), |_| vec![])
    };
    let times = |value: &mut Entry, by: f64| *value = (by * value.as_f64().unwrap()).into();
    assert_eq!(broken(&|_| {}), [""; 0]);
    for (axis, by) in [(0, -1.0), (1, -1.0), (0, 100.0)] {
        let found = broken(&|o| times(&mut o["location"][axis], by));
        assert!(found.len() == 1 && found[0].ends_with(": location"), "{found:?}");
    }
    let found = broken(&|o| o["orientation"][2] = 45.0.into());
    assert!(!found.is_empty() && found.iter().all(|path| path.ends_with("orientation[2]")), "{found:?}");
}

/// Detections of three objects, one of them hidden for eight frames, and two false ones.
fn detections() -> Vec<Detection> {
    let looks = [("red", "metal", "sphere"), ("blue", "rubber", "cube"), ("red", "rubber", "cylinder")];
    let shapes = [Shape::Ball { radius: 0.2 }, Shape::Square { half_side: 0.2 }, Shape::Disc { radius: 0.2 }];
    let mut all = vec![];
    for frame in 0..40usize {
        let t = frame as f64 * 0.04;
        let places = [vec2(-1.0 + 1.5 * t, 0.0), vec2(1.0 - 0.8 * t, -1.5 + t), vec2(0.3, 1.5 - 1.2 * t)];
        for (k, at) in places.into_iter().enumerate() {
            if k == 2 && (15..23).contains(&frame) {
                continue;
            }
            let ([left, top, right, bottom], _) = outline(&CLEVRER_CAMERA, &shapes[k], at, 0.2).unwrap();
            let (color, material, mut shape) = looks[k];
            if frame % 7 == 0 {
                shape = "sphere";
            }
            let one = |word: &str| AttributeScores::from([(word.to_string(), 1.0)]);
            let bounds = BoundingBox { left, top, right, bottom };
            let (color, material, shape) = (one(color), one(material), one(shape));
            let features = vec![k as f32, frame as f32];
            all.push(Detection { frame, bounds, color, material, shape, score: 0.9, features });
        }
    }
    for frame in [9, 31] {
        let bounds = BoundingBox { left: 20.0, top: 200.0, right: 60.0, bottom: 250.0 };
        let none = AttributeScores::new();
        let (color, material, shape) = (none.clone(), none.clone(), none);
        all.push(Detection { frame, bounds, color, material, shape, score: 0.3, features: vec![] });
    }
    all
}

#[test]
fn detections_become_tracks_in_whatever_order_they_come() {
    let options = LinkOptions { frames: 40, fps: 25.0, camera: CLEVRER_CAMERA, size: 0.2, sigma: 0.5 };
    let given = detections();
    let found = link(&given, &options, &never).unwrap();
    let expected = LinkReport {
        frames: 40,
        detections: 114,
        objects: 3,
        gaps_bridged: 1,
        frames_bridged: 8,
        detections_dropped: 2,
    };
    assert_eq!(found.report, expected);
    let mut words: Vec<String> = found.objects.iter().map(Object::description).collect();
    words.sort();
    assert_eq!(words, ["blue rubber cube", "red metal sphere", "red rubber cylinder"]);
    let ball = found.objects.iter().position(|o| o.shape.is_ball()).unwrap();
    assert_eq!(found.objects[ball].features, [0.0, 19.5]);
    for s in &found.tracks[ball].samples {
        assert!((s.position - vec2(-1.0 + 0.06 * s.frame as f64, 0.0)).norm() < 1e-3, "{s:?}");
    }
    let mut reversed = given.clone();
    reversed.reverse();
    let other = link(&reversed, &options, &never).unwrap();
    assert_eq!((other.objects, other.tracks), (found.objects, found.tracks));
    assert_eq!(link(&given[..2], &options, &never), Err(LinkError::NoObject { given: 2 }));
    let singular = LinkOptions { camera: Camera { matrix: [[1.0; 4]; 3], ..CLEVRER_CAMERA }, ..options };
    assert_eq!(link(&given, &singular, &never), Err(LinkError::Camera(CameraError::Singular)));
    assert_eq!(link(&given, &options, &|_| Err(Stopped)), Err(LinkError::Stopped(Stopped)));
}

#[test]
fn files_may_give_image_points_and_wrong_ones_are_named_with_their_frame() {
    let text = |matrix: &str, point: &str| {
        format!(
            r#"{{"object_property": [{{"object_id": 4, "color": "red", "material": "metal", "shape": "cube", "size": 0.2}}],
            "camera_matrix": {matrix}, "image_noise_px": 0.5, "motion_trajectory": [
            {{"frame_id": 0, "objects": [{{"object_id": 4, "image_center": [240, 160]}}]}},
            {{"frame_id": 6, "objects": [{{"object_id": 4, "image_center": {point}}}]}}]}}"#
        )
    };
    let matrix = format!("{:?}", CLEVRER_CAMERA.matrix);
    let scene = parse("pixels", &text(&matrix, "[250, 170]")).unwrap();
    let sample = scene.tracks[0].samples[1];
    let (position, covariance) = CLEVRER_CAMERA.locate([250.0, 170.0], 0.2, [0.5; 2]).unwrap();
    assert_eq!((sample.position, sample.covariance), (position, Some(covariance)));
    let refused = |matrix: &str, point: &str| {
        let found = parse("pixels", &text(matrix, point)).unwrap_err().violations;
        (found[0].path.clone(), found[0].message.clone())
    };
    let (path, message) = refused(&matrix, "[240, -145]");
    assert_eq!(path, "motion_trajectory[1].objects[0].image_center");
    assert!(message.starts_with("frame 6: ") && message.contains("horizon"), "{message}");
    assert_eq!(refused("[[1,1,1,1],[1,1,1,1],[1,1,1,1]]", "[250, 170]").0, "camera_matrix");
    let mirrored = format!(
        "{:?}",
        [CLEVRER_CAMERA.matrix[0].map(|v| -v), CLEVRER_CAMERA.matrix[1], CLEVRER_CAMERA.matrix[2]]
    );
    let (path, message) = refused(&mirrored, "[250, 170]");
    assert!(path == "camera_matrix" && message.contains("mirrored"), "{message}");
}
