//! Each fault of a measurement is found where it is, and good tracks show nothing.

use super::*;
use crate::num::{Vec2, vec2};
use crate::scene::{Object, Shape, Track, WorldKind};
use proptest::prelude::*;

const FPS: f64 = 50.0;
const NOISE: f64 = 3e-4;

/// A number of about unit deviation that differs by place; sums of two uniform ones are near enough to normal here.
fn random(seed: u64) -> f64 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5bd1_e995;
    let mut next = || {
        z ^= z << 13;
        z ^= z >> 7;
        z ^= z << 17;
        (z >> 11) as f64 / (1u64 << 53) as f64
    };
    let _ = next();
    (0..12).map(|_| next()).sum::<f64>() - 6.0
}

/// Discs that move by `ways`, measured with noise.
fn video(frames: usize, ways: &[&dyn Fn(f64) -> Vec2]) -> Scene {
    let sample = |k: usize, frame: usize| {
        let seed = (1000 * k + frame) as u64;
        let noise = vec2(random(2 * seed), random(2 * seed + 1)).scaled(NOISE);
        Sample { frame, position: ways[k](frame as f64 / FPS) + noise, yaw: None, covariance: None }
    };
    let object = |id: usize| Object {
        id: id as u32,
        color: String::new(),
        material: String::new(),
        shape: Shape::Disc { radius: 0.03 },
        mass: None,
        features: vec![],
    };
    Scene {
        name: "a".into(),
        setup: None,
        world: WorldKind::AirTable,
        fps: FPS,
        times: (0..frames).map(|f| f as f64 / FPS).collect(),
        camera: None,
        table: None,
        noise_sigma: None,
        objects: (0..ways.len()).map(object).collect(),
        tracks: (0..ways.len())
            .map(|k| Track { samples: (0..frames).map(|f| sample(k, f)).collect() })
            .collect(),
        outliers: vec![],
        findings: vec![],
        feature_layout: None,
        absent: vec![],
    }
}

fn two() -> Scene {
    video(120, &[&|t| vec2(-0.5 + 0.4 * t, 0.1), &|t| vec2(0.6, -0.4 + 0.2 * t - 0.01 * t * t)])
}

fn kinds(scene: Scene) -> Vec<FindingKind> {
    scene.validate().expect("it is one").findings.iter().map(|f| f.kind).collect()
}

#[test]
fn good_tracks_show_nothing() {
    assert_eq!(kinds(two()), []);
    // Nor do a collision, something hit at rest, and rest without any noise.
    let hit = |t: f64| if t < 1.0 { vec2(0.0, 0.0) } else { vec2(1.5 * (t - 1.0), 0.3 * (t - 1.0)) };
    assert_eq!(kinds(video(120, &[&hit, &|t| vec2(0.4 * t, 0.5)])), []);
    let mut still = video(120, &[&hit]);
    still.tracks[0].samples.iter_mut().for_each(|s| s.position = hit(s.frame as f64 / FPS));
    assert_eq!(kinds(still), []);
}

#[test]
fn whole_pixels_are_steps_and_rounded_decimals_are_none() {
    let rounded = |q: f64| {
        let mut scene = two();
        let round = |x: f64| (x / q).round() * q;
        for s in scene.tracks.iter_mut().flat_map(|t| &mut t.samples) {
            s.position = vec2(round(s.position.x), round(s.position.y));
        }
        scene.validate().unwrap().findings
    };
    let [steps] = &rounded(2e-3)[..] else { panic!("{:?}", rounded(2e-3)) };
    assert!(steps.kind == FindingKind::Steps && (steps.value - 2e-3).abs() < 1e-6, "{steps:?}");
    assert_eq!(rounded(1e-5), []);
}

#[test]
fn repeated_frames_are_left_out_of_all_tracks() {
    let repeated = |every: usize, from: usize| {
        let mut scene = two();
        for track in &mut scene.tracks {
            for k in (from..track.samples.len()).step_by(every) {
                track.samples[k].position = track.samples[k - 1].position;
            }
        }
        scene.validate().unwrap()
    };
    for every in [2, 3, 5] {
        let scene = repeated(every, 1);
        let [found] = &scene.findings[..] else { panic!("{:?}", scene.findings) };
        assert_eq!(found.kind, FindingKind::RepeatedFrames);
        assert!((found.value - 1.0 / every as f64).abs() < 0.03, "{found}");
        assert!(scene.tracks.iter().all(|t| t.samples.iter().all(|s| s.frame % every != 1)));
    }
    // A tracker that holds a position while others go on.
    let mut scene = two();
    for k in (10..100).step_by(9) {
        scene.tracks[0].samples[k].position = scene.tracks[0].samples[k - 1].position;
    }
    assert_eq!(kinds(scene), [FindingKind::RepeatedPositions]);
}

proptest! {
    #[test]
    fn lost_frames_shift_the_times_after_them(at in 12..100usize, lost in 1..12usize) {
        let late = |t: f64| if t < (at as f64 + 0.5) / FPS { t } else { t + lost as f64 / FPS };
        let scene = video(120, &[&|t| vec2(-0.5 + 0.4 * late(t), 0.1), &|t| vec2(0.6, -0.4 + 0.2 * late(t))]);
        let scene = scene.validate().unwrap();
        prop_assert_eq!(scene.findings.len(), 1);
        let found = &scene.findings[0];
        prop_assert_eq!((found.kind, &found.frames[..], found.value), (FindingKind::LostFrames, &[at][..], lost as f64));
        prop_assert!((scene.times[119] - (119.0 + lost as f64) / FPS).abs() < 1e-9);
        // Once taken in, nothing is lost any more; what was found stays known.
        let again = scene.clone().validate().unwrap();
        prop_assert_eq!(again, scene);
    }

    #[test]
    fn a_track_that_goes_on_on_another_object_is_cut(at in 20..118usize) {
        let mut scene = two();
        let other = scene.tracks[1].clone();
        for (own, other) in scene.tracks[0].samples.iter_mut().zip(&other.samples).skip(at) {
            own.position = other.position + vec2(NOISE, 0.0);
        }
        let scene = scene.validate().unwrap();
        let mut kinds: Vec<FindingKind> = scene.findings.iter().map(|f| f.kind).collect();
        kinds.dedup();
        prop_assert_eq!(kinds, [FindingKind::Leaps]);
        // Where it is inside the other one it is not itself.
        prop_assert_eq!(scene.tracks[0].samples.len(), at);
    }

    #[test]
    fn exchanged_identities_are_put_right(at in 20..100usize) {
        let right = two();
        let mut scene = two();
        for k in at..120 {
            let [a, b] = [scene.tracks[0].samples[k].position, scene.tracks[1].samples[k].position];
            scene.tracks[0].samples[k].position = b;
            scene.tracks[1].samples[k].position = a;
        }
        let scene = scene.validate().unwrap();
        prop_assert_eq!(&scene.findings[0].frames[..], &[at][..]);
        prop_assert_eq!(scene.findings[0].kind, FindingKind::SwappedIdentities);
        prop_assert_eq!(scene.tracks, right.tracks);
    }
}

#[test]
fn values_that_stand_for_not_seen_are_left_out() {
    for marker in [vec2(-1.0, -1.0), vec2(0.0, 0.0), vec2(9.99, 9.99)] {
        let mut scene = two();
        for k in (30..50).chain(115..120) {
            scene.tracks[1].samples[k].position = marker;
        }
        let scene = scene.validate().unwrap();
        assert_eq!(scene.tracks[1].samples.len(), 95, "{marker:?} {:?}", scene.findings);
    }
}

#[test]
fn smoothed_tracks_have_dependent_errors() {
    for half in [1usize, 3] {
        let mut scene = video(240, &[&|t| vec2(-0.5 + 0.4 * t, 0.1), &|t| vec2(0.6, -0.4 + 0.2 * t)]);
        for track in &mut scene.tracks {
            let raw = track.samples.clone();
            for (k, s) in track.samples.iter_mut().enumerate() {
                let near = &raw[k.saturating_sub(half)..(k + half + 1).min(raw.len())];
                let sum = near.iter().fold(Vec2::zero(), |sum, s| sum + s.position);
                s.position = sum.scaled(1.0 / near.len() as f64);
            }
        }
        assert_eq!(kinds(scene), [FindingKind::DependentNoise], "over {} frames", 2 * half + 1);
    }
}

#[test]
fn what_all_objects_share_is_the_camera() {
    let third = |t: f64| vec2(-0.2, 0.5 - 0.1 * t);
    let scene = || video(120, &[&|t| vec2(-0.5 + 0.4 * t, 0.1), &|_| vec2(0.6, -0.4), &third]);
    let moved = |shift: &dyn Fn(usize) -> Vec2| {
        let mut scene = scene();
        for s in scene.tracks.iter_mut().flat_map(|t| &mut t.samples) {
            s.position += shift(s.frame);
        }
        scene.validate().unwrap()
    };
    let off = |found: &Scene| {
        let (right, mut all) = (scene(), vec![]);
        for (track, own) in found.tracks.iter().zip(&right.tracks) {
            all.extend(track.samples.iter().zip(&own.samples).map(|(a, b)| (a.position - b.position).norm()));
        }
        quantile(&mut all, 0.5).unwrap()
    };
    // A bump of 5 mm after frame 60 is taken back.
    let bump = moved(&|f| if f > 60 { vec2(0.004, -0.003) } else { Vec2::zero() });
    let [found] = &bump.findings[..] else { panic!("{:?}", bump.findings) };
    assert_eq!((found.kind, &found.frames[..]), (FindingKind::MovingCamera, &[60][..]));
    assert!((found.value - 5e-3).abs() < 5e-4 && off(&bump) < 4e-4, "{found} {}", off(&bump));
    // A shake as large as 0.6 mm leaves less than half of it.
    let shake = moved(&|f| vec2(random(90_000 + f as u64), random(95_000 + f as u64)).scaled(6e-4));
    let [found] = &shake.findings[..] else { panic!("{:?}", shake.findings) };
    assert_eq!((found.kind, found.frames.len()), (FindingKind::MovingCamera, 0));
    assert!(off(&shake) < 4e-4, "{}", off(&shake));
}

#[test]
fn an_object_that_is_measured_worse_has_its_own_noise() {
    let mut scene = two();
    for s in &mut scene.tracks[1].samples {
        s.position +=
            vec2(random(7_000 + s.frame as u64), random(8_000 + s.frame as u64)).scaled(5.0 * NOISE);
    }
    let scene = scene.validate().unwrap();
    let [found] = &scene.findings[..] else { panic!("{:?}", scene.findings) };
    assert_eq!((found.kind, &found.objects[..]), (FindingKind::UnevenNoise, &[1][..]));
    assert!((4.0..6.5).contains(&found.value), "{found}");
    let sd = |k: usize| scene.tracks[k].samples[0].covariance.unwrap().xx.sqrt();
    assert!((sd(0) / NOISE - 1.0).abs() < 0.3 && (sd(1) / sd(0) - found.value).abs() < 1e-9);
}

#[test]
fn markers_in_single_frames_are_left_out_though_they_are_many() {
    let mut scene = two();
    let hidden = |frame: usize| (frame * 7919) % 10 == 3;
    for track in &mut scene.tracks {
        for s in track.samples.iter_mut().filter(|s| hidden(s.frame)) {
            s.position = vec2(-1.0, -1.0);
        }
    }
    let scene = scene.validate().unwrap();
    for track in &scene.tracks {
        assert!(
            track.samples.len() > 100 && track.samples.iter().all(|s| !hidden(s.frame)),
            "{:?}",
            scene.findings
        );
    }
}

#[test]
fn interpolated_positions_are_left_out() {
    let mut scene = two();
    for track in &mut scene.tracks {
        let raw = track.samples.clone();
        for s in track.samples.iter_mut().filter(|s| s.frame < 116) {
            let (before, share) = (s.frame / 4 * 4, (s.frame % 4) as f64 / 4.0);
            s.position = raw[before].position.scaled(1.0 - share) + raw[before + 4].position.scaled(share);
        }
    }
    let scene = scene.validate().unwrap();
    assert!(scene.findings.iter().all(|f| f.kind == FindingKind::Interpolated), "{:?}", scene.findings);
    assert!(scene.tracks[0].samples.iter().filter(|s| s.frame < 115).all(|s| s.frame % 4 == 0));
}

#[test]
fn a_first_or_last_position_that_is_off_is_left_out() {
    for frame in [0, 119] {
        let mut scene = two();
        scene.tracks[1].samples[frame].position += vec2(0.0, 40.0 * NOISE);
        let scene = scene.validate().unwrap();
        let [found] = &scene.findings[..] else { panic!("{:?}", scene.findings) };
        assert_eq!(
            (found.kind, &found.objects[..], &found.frames[..]),
            (FindingKind::Leaps, &[1][..], &[frame][..])
        );
    }
}

#[test]
fn filtered_tracks_have_dependent_errors() {
    for gain in [0.3_f64, 0.5] {
        let mut scene = video(240, &[&|t| vec2(-0.5 + 0.4 * t, 0.1), &|t| vec2(0.6, -0.4 + 0.2 * t)]);
        for track in &mut scene.tracks {
            let (mut at, mut velocity) = (track.samples[0].position, Vec2::zero());
            let beta = 2.0 * (2.0 - gain) - 4.0 * (1.0 - gain).sqrt();
            for s in &mut track.samples {
                let off = s.position - at - velocity;
                at += velocity + off.scaled(gain);
                velocity += off.scaled(beta);
                s.position = at;
            }
        }
        assert_eq!(kinds(scene), [FindingKind::DependentNoise], "gain {gain}");
    }
}

#[test]
fn frames_lost_near_each_other_are_all_found() {
    let lost = [(40, 1), (45, 2), (50, 1)];
    let late = |t: f64| {
        let frame = (t * FPS).round() as usize;
        t + lost.iter().filter(|(at, _)| frame > *at).map(|(_, n)| *n as f64).sum::<f64>() / FPS
    };
    let scene = video(120, &[&|t| vec2(-0.5 + 0.4 * late(t), 0.1), &|t| vec2(0.6, -0.4 + 0.2 * late(t))]);
    let scene = scene.validate().unwrap();
    let [found] = &scene.findings[..] else { panic!("{:?}", scene.findings) };
    assert_eq!(
        (found.kind, &found.frames[..], found.value),
        (FindingKind::LostFrames, &[40, 45, 50][..], 4.0)
    );
}

#[test]
fn a_camera_that_sways_is_seen_in_what_is_at_rest() {
    let rest = |_: f64| vec2(0.6, -0.4);
    let moving = |t: f64| vec2(-0.5 + 0.4 * t, 0.1);
    let sway = |t: f64| vec2(8.0 * NOISE * (std::f64::consts::TAU * t).sin(), 0.0);
    let other = vec2(-0.7, 0.5);
    let scene = video(200, &[&|t| rest(t) + sway(t), &|t| moving(t) + sway(t), &|t| other + sway(t)])
        .validate()
        .unwrap();
    let [found] = &scene.findings[..] else { panic!("{:?}", scene.findings) };
    assert_eq!((found.kind, &found.objects[..]), (FindingKind::DriftingCamera, &[0, 2][..]));
    assert!((found.value / NOISE - 8.0 / 2.0_f64.sqrt()).abs() < 1.0, "{found}");
    // What oscillates alone is no camera.
    assert_eq!(kinds(video(200, &[&|t| rest(t) + sway(t), &moving])), []);
    // Two objects at rest show a drift; a uniform force, which moves all alike from rest on, is none.
    let both = |way: &dyn Fn(f64) -> Vec2| kinds(video(200, &[&|t| rest(t) + way(t), &|t| other + way(t)]));
    assert_eq!(both(&|t| vec2(2e-3 * t, 1e-3 * t)), [FindingKind::DriftingCamera]);
    assert_eq!(both(&|t| vec2(1e-3 * t * t, 0.0)), []);
}

#[test]
fn a_change_of_the_frame_rate_is_taken_in() {
    let late = |t: f64| if t < 60.5 / FPS { t } else { 60.0 / FPS + 2.0 * (t - 60.0 / FPS) };
    let ways: [&dyn Fn(f64) -> Vec2; 3] =
        [&|t| vec2(-0.5 + 0.4 * late(t), 0.1), &|t| vec2(0.6, -0.4 + 0.3 * late(t)), &|t| {
            vec2(-0.2 + 0.2 * late(t), 0.7 - 0.2 * late(t))
        }];
    let scene = video(120, &ways).validate().unwrap();
    let [found] = &scene.findings[..] else { panic!("{:?}", scene.findings) };
    assert_eq!((found.kind, found.frames.len()), (FindingKind::RateChange, 1));
    assert!((found.value - 2.0).abs() < 0.1 && found.frames[0].abs_diff(60) < 2, "{found}");
}

#[test]
fn gaps_filled_on_lines_are_left_out() {
    let mut scene = two();
    for from in [20, 41, 77] {
        let samples = &mut scene.tracks[0].samples;
        let (a, b) = (samples[from].position, samples[from + 4].position);
        for d in 1..4 {
            samples[from + d].position = a + (b - a).scaled(d as f64 / 4.0);
        }
    }
    let scene = scene.validate().unwrap();
    let [found] = &scene.findings[..] else { panic!("{:?}", scene.findings) };
    assert_eq!((found.kind, found.frames.len()), (FindingKind::Interpolated, 9));
}

#[test]
fn good_tracks_show_nothing_at_any_rate_and_size() {
    for (k, fps) in [3.0, 10.0, 50.0, 240.0, 1000.0, 10_000.0].into_iter().enumerate() {
        for (j, size) in [5e-4, 3e-2, 5.0].into_iter().enumerate() {
            let seconds = 120.0 / fps;
            let bounce = |u: f64| (u % 2.0 - 1.0).abs();
            let ways: [&dyn Fn(f64) -> Vec2; 3] = [
                &|_| vec2(20.0, 5.0).scaled(size),
                &|t| vec2(12.0 * bounce(3.3 * t / seconds), -8.0 + 3.0 * t / seconds).scaled(size),
                &|t| {
                    vec2(-10.0 + 9.0 * t / seconds, 9.0 * bounce(0.7 + 2.1 * t / seconds) + 3.0).scaled(size)
                },
            ];
            let mut scene = video(120, &[&|_| Vec2::zero(), &|_| Vec2::zero(), &|_| Vec2::zero()]);
            for (object, track) in scene.tracks.iter_mut().enumerate() {
                for s in &mut track.samples {
                    let seed = (100_000 * (1 + 3 * k + j) + 1000 * object + s.frame) as u64;
                    let noise = vec2(random(2 * seed), random(2 * seed + 1)).scaled(0.01 * size);
                    s.position = ways[object](s.frame as f64 / fps) + noise;
                }
            }
            scene.objects.iter_mut().for_each(|o| o.shape = Shape::Disc { radius: size });
            scene.times = (0..120).map(|f| f as f64 / fps).collect();
            scene.fps = fps;
            let findings = scene.validate().expect("it is one").findings;
            assert!(findings.is_empty(), "{fps} {size}: {findings:?}");
        }
    }
}
