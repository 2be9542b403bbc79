//! How often faults of a measurement are named, and how often good tracks are accused of one: puts each kind of fault, at three
//! strengths, into the scenes of folders, and prints a table.
//!
//! `cargo run --release --example measurement_faults -- FOLDER...`

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vrdp::num::{Vec2, elementary, vec2};
use vrdp::scene::{FindingKind, Sample, Scene, parse, parse_csv};

/// A fault: its name, the finding that names it, its strengths, and how it is put into a scene.
type Fault = (&'static str, FindingKind, [f64; 3], fn(&mut Scene, f64, &mut ChaCha8Rng));

const FAULTS: [Fault; 18] = [
    ("whole pixels (step / noise)", FindingKind::Steps, [2.0, 4.0, 8.0], pixels),
    ("each n-th frame repeated", FindingKind::RepeatedFrames, [2.0, 3.0, 5.0], repeated),
    ("frames lost in one place", FindingKind::LostFrames, [1.0, 3.0, 8.0], lost),
    ("identities exchanged (share of the video)", FindingKind::SwappedIdentities, [0.3, 0.5, 0.7], exchanged),
    ("track on another object (share)", FindingKind::Leaps, [0.1, 0.3, 0.6], taken_over),
    ("(-1, -1) for not seen (share)", FindingKind::Leaps, [0.05, 0.1, 0.3], marked),
    ("mean of n frames", FindingKind::DependentNoise, [3.0, 5.0, 9.0], smoothed),
    ("exponential smoothing (gain)", FindingKind::DependentNoise, [0.7, 0.5, 0.3], exponential),
    ("Kalman filter (gain of the place)", FindingKind::DependentNoise, [0.8, 0.5, 0.2], kalman),
    ("Savitzky-Golay (frames)", FindingKind::DependentNoise, [5.0, 9.0, 15.0], savitzky_golay),
    ("gaps filled on lines (share)", FindingKind::Interpolated, [0.15, 0.3, 0.6], filled),
    ("frames lost in several places", FindingKind::LostFrames, [2.0, 4.0, 8.0], lost_in_places),
    ("sway at 1 Hz (in noise)", FindingKind::DriftingCamera, [4.0, 8.0, 16.0], swaying),
    ("drift (in noise)", FindingKind::DriftingCamera, [16.0, 32.0, 64.0], drifting),
    ("zoom at 1 Hz (percent)", FindingKind::DriftingCamera, [0.5, 1.0, 2.0], zooming),
    ("two frame rates (ratio)", FindingKind::RateChange, [0.5, 1.5, 2.0], two_rates),
    ("shake (in noise)", FindingKind::MovingCamera, [1.0, 2.0, 4.0], shaken),
    ("bump (in noise)", FindingKind::MovingCamera, [8.0, 16.0, 32.0], bumped),
];

fn main() {
    let scenes: Vec<Scene> = std::env::args().skip(1).flat_map(|folder| files(Path::new(&folder))).collect();
    let accused: Vec<String> =
        scenes.iter().flat_map(|s| s.findings.iter().map(|f| format!("{}: {f}", s.name))).collect();
    println!("{} scenes as they are: {} findings", scenes.len(), accused.len());
    accused.iter().for_each(|line| println!("  {line}"));
    println!(
        "{:44} {:>8} {:>10} {:>8} {:>8}   others",
        "fault", "strength", "applicable", "named", "exactly"
    );
    for (name, kind, strengths, put) in FAULTS {
        for strength in strengths {
            let (mut applicable, mut named, mut exactly, mut others) = (0, 0, 0, BTreeMap::new());
            for (k, scene) in scenes.iter().enumerate() {
                let mut with = Scene { outliers: vec![], findings: vec![], ..scene.clone() };
                put(&mut with, strength, &mut ChaCha8Rng::seed_from_u64(k as u64));
                if with.tracks == scene.tracks && with.times == scene.times {
                    continue;
                }
                applicable += 1;
                match with.validate() {
                    Ok(found) => {
                        named += usize::from(found.finding(kind).is_some());
                        exactly += usize::from(is_exact(&found, scene, kind));
                        let other = found.findings.iter().filter(|f| f.kind != kind);
                        other.for_each(|f| *others.entry(f.kind.name()).or_insert(0) += 1);
                    }
                    Err(_) => *others.entry("refused").or_insert(0) += 1,
                }
            }
            println!("{name:44} {strength:8} {applicable:10} {named:8} {exactly:8}   {others:?}");
        }
    }
}

/// Whether what was found is what was put in: all lost frames, and, of others, nothing but it.
fn is_exact(found: &Scene, scene: &Scene, kind: FindingKind) -> bool {
    let lost = (scene.times.len() - found.times.len()) as f64;
    let only = found.findings.iter().all(|f| f.kind == kind) && !found.findings.is_empty();
    only && (kind != FindingKind::LostFrames || found.finding(kind) == Some(lost))
}

fn files(folder: &Path) -> Vec<Scene> {
    let mut entries: Vec<PathBuf> =
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    entries.sort();
    let mut all = vec![];
    for path in entries {
        let name = path.to_string_lossy().into_owned();
        let text = || std::fs::read_to_string(&path).unwrap_or_default();
        match () {
            () if path.is_dir() => all.extend(files(&path)),
            () if name.ends_with("observed.json") => all.extend(parse(&name, &text()).ok()),
            () if name.ends_with(".csv") => all.extend(parse_csv(&name, &text()).ok()),
            () => {}
        }
    }
    all
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

/// Standard deviation of a coordinate (m), from second differences.
fn noise(scene: &Scene) -> f64 {
    let second = |w: &[Sample]| (w[0].position + w[2].position - w[1].position.scaled(2.0)).norm();
    let mut all: Vec<f64> = scene.tracks.iter().flat_map(|t| t.samples.windows(3).map(second)).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).map_or(1e-3, |median| median / (1.1774 * 6.0_f64.sqrt()))
}

fn each(scene: &mut Scene, mut change: impl FnMut(&mut Sample)) {
    scene.tracks.iter_mut().flat_map(|t| &mut t.samples).for_each(&mut change);
}

fn pixels(scene: &mut Scene, times: f64, _: &mut ChaCha8Rng) {
    let q = times * noise(scene);
    each(scene, |s| s.position = vec2((s.position.x / q).round() * q, (s.position.y / q).round() * q));
}

fn repeated(scene: &mut Scene, every: f64, _: &mut ChaCha8Rng) {
    for track in &mut scene.tracks {
        for k in 1..track.samples.len() {
            if track.samples[k].frame % every as usize == 1
                && track.samples[k - 1].frame + 1 == track.samples[k].frame
            {
                track.samples[k].position = track.samples[k - 1].position;
            }
        }
    }
}

/// Frames are taken out in the middle third, where an object moves by more than ten deviations while they are lost.
fn lost(scene: &mut Scene, frames: f64, _: &mut ChaCha8Rng) {
    let (all, frames, least) = (scene.times.len(), frames as usize, 10.0 * noise(scene));
    let moves = |at: usize| {
        scene.tracks.iter().any(|t| {
            let pair = t.at(at).zip(t.at(at + frames));
            pair.is_some_and(|(a, b)| (b.position - a.position).norm() > least) && t.at(at - 4).is_some()
        })
    };
    let Some(at) = (all / 3..2 * all / 3).find(|at| at + frames + 8 < all && moves(*at)) else { return };
    for track in &mut scene.tracks {
        track.samples.retain(|s| s.frame <= at || s.frame > at + frames);
        track.samples.iter_mut().filter(|s| s.frame > at).for_each(|s| s.frame -= frames);
    }
    scene.times.truncate(all - frames);
}

fn pair(scene: &Scene, share: f64) -> Option<(usize, usize, usize)> {
    let at = (share * scene.times.len() as f64) as usize;
    let seen = |k: &usize| (at - 3..at + 3).all(|f| scene.tracks[*k].at(f).is_some());
    let mut both = (0..scene.tracks.len()).filter(seen);
    let (a, b) = (both.next()?, both.next()?);
    let apart = (scene.tracks[a].at(at)?.position - scene.tracks[b].at(at)?.position).norm();
    let sizes = scene.objects[a].shape.bounding_radius() + scene.objects[b].shape.bounding_radius();
    (apart > 2.0 * sizes).then_some((a, b, at))
}

fn exchanged(scene: &mut Scene, share: f64, _: &mut ChaCha8Rng) {
    let Some((a, b, at)) = pair(scene, share) else { return };
    let mut cut = |k: usize| {
        let samples = &mut scene.tracks[k].samples;
        samples.split_off(samples.partition_point(|s| s.frame < at))
    };
    let (tail_a, tail_b) = (cut(a), cut(b));
    scene.tracks[a].samples.extend(tail_b);
    scene.tracks[b].samples.extend(tail_a);
}

fn taken_over(scene: &mut Scene, share: f64, _: &mut ChaCha8Rng) {
    let Some((a, b, at)) = pair(scene, 1.0 - share) else { return };
    let other = scene.tracks[b].clone();
    scene.tracks[a].samples.retain(|s| s.frame < at);
    scene.tracks[a].samples.extend(other.samples.iter().filter(|s| s.frame >= at));
}

fn marked(scene: &mut Scene, share: f64, random: &mut ChaCha8Rng) {
    let all = scene.times.len() as f64;
    let from = (all * (0.2 + 0.1 * normal(random).abs().min(3.0))) as usize;
    let frames = from..from + (share * all) as usize;
    let Some(track) = scene.tracks.iter_mut().find(|t| t.at(from).is_some()) else { return };
    let hidden = track.samples.iter_mut().filter(|s| frames.contains(&s.frame));
    hidden.for_each(|s| s.position = vec2(-1.0, -1.0));
}

fn smoothed(scene: &mut Scene, over: f64, _: &mut ChaCha8Rng) {
    let half = over as usize / 2;
    for track in &mut scene.tracks {
        let raw = track.samples.clone();
        for (k, s) in track.samples.iter_mut().enumerate() {
            let near = &raw[k.saturating_sub(half)..(k + half + 1).min(raw.len())];
            s.position =
                near.iter().fold(Vec2::zero(), |sum, s| sum + s.position).scaled(1.0 / near.len() as f64);
        }
    }
}

fn shaken(scene: &mut Scene, times: f64, random: &mut ChaCha8Rng) {
    if scene.tracks.len() < 2 {
        return;
    }
    let size = times * noise(scene);
    let shifts: Vec<Vec2> =
        scene.times.iter().map(|_| vec2(size * normal(random), size * normal(random))).collect();
    each(scene, |s| s.position += shifts[s.frame]);
}

fn bumped(scene: &mut Scene, times: f64, _: &mut ChaCha8Rng) {
    let at = scene.times.len() / 2;
    let seen = scene.tracks.iter().filter(|t| (at - 4..at + 4).all(|f| t.at(f).is_some())).count();
    if seen < 2 {
        return;
    }
    let shift = vec2(0.8, -0.6).scaled(times * noise(scene));
    each(scene, |s| s.position = if s.frame > at { s.position + shift } else { s.position });
}

fn filtered(scene: &mut Scene, filter: impl Fn(&[Vec2]) -> Vec<Vec2>) {
    for track in scene.tracks.iter_mut().filter(|t| t.samples.len() > 1) {
        let raw: Vec<Vec2> = track.samples.iter().map(|s| s.position).collect();
        track.samples.iter_mut().zip(filter(&raw)).for_each(|(s, p)| s.position = p);
    }
}

fn exponential(scene: &mut Scene, gain: f64, _: &mut ChaCha8Rng) {
    filtered(scene, |raw| {
        let mut at = raw[0];
        let next = |z: &Vec2| {
            at += (*z - at).scaled(gain);
            at
        };
        raw.iter().map(next).collect()
    });
}

/// The steady state of a Kalman filter for constant velocity is an alpha-beta filter (Kalata, IEEE Trans. AES 20 (1984) 174).
fn kalman(scene: &mut Scene, alpha: f64, _: &mut ChaCha8Rng) {
    let beta = 2.0 * (2.0 - alpha) - 4.0 * (1.0 - alpha).sqrt();
    filtered(scene, |raw| {
        let (mut at, mut velocity) = (raw[0], raw[1] - raw[0]);
        let next = |z: &Vec2| {
            let predicted = at + velocity;
            at = predicted + (*z - predicted).scaled(alpha);
            velocity += (*z - predicted).scaled(beta);
            at
        };
        raw.iter().map(next).collect()
    });
}

/// Parabolas over so many frames.
fn savitzky_golay(scene: &mut Scene, over: f64, _: &mut ChaCha8Rng) {
    let half = over as usize / 2;
    let power = |n: i32| -> f64 { (0..=2 * half).map(|k| elementary::powi(k as f64 - half as f64, n)).sum() };
    let (s0, s2, s4) = (power(0), power(2), power(4));
    let weight = |d: f64| (s4 - s2 * d * d) / (s0 * s4 - s2 * s2);
    filtered(scene, |raw| {
        let value = |k: usize| {
            let inside = k >= half && k + half < raw.len();
            let one = |d: usize| raw[k + d - half].scaled(weight(d as f64 - half as f64));
            if inside { (0..=2 * half).map(one).fold(Vec2::zero(), |sum, p| sum + p) } else { raw[k] }
        };
        (0..raw.len()).map(value).collect()
    });
}

/// Gaps of two to six frames, here and there, are filled on straight lines.
fn filled(scene: &mut Scene, share: f64, random: &mut ChaCha8Rng) {
    for track in &mut scene.tracks {
        let mut k = 1;
        while k + 8 < track.samples.len() {
            let gap = 2 + (normal(random).abs() * 2.0).min(4.0) as usize;
            let (a, b) = (track.samples[k], track.samples[k + gap + 1]);
            let moves = (b.position - a.position).norm() > 1e-9 && b.frame - a.frame == gap + 1;
            if moves && normal(random).abs() < 2.0 * share {
                for d in 1..=gap {
                    let part = d as f64 / (gap + 1) as f64;
                    track.samples[k + d].position = a.position + (b.position - a.position).scaled(part);
                }
            }
            k += gap + 1 + (normal(random).abs() * 3.0) as usize;
        }
    }
}

/// One or two frames are taken out in so many places, four to eight frames apart, where an object moves by ten deviations a frame.
fn lost_in_places(scene: &mut Scene, places: f64, random: &mut ChaCha8Rng) {
    let least = 10.0 * noise(scene);
    let (mut at, mut done) = (10 + (3.0 * normal(random).abs()) as usize, 0.0);
    while done < places && at + 10 < scene.times.len() {
        let frames = 1 + usize::from(normal(random) > 0.5);
        let step = |t: &vrdp::scene::Track| Some((t.at(at + 1)?.position - t.at(at)?.position).norm());
        if scene.tracks.iter().filter_map(step).any(|s| s > least) {
            for track in &mut scene.tracks {
                track.samples.retain(|s| s.frame <= at || s.frame > at + frames);
                track.samples.iter_mut().filter(|s| s.frame > at).for_each(|s| s.frame -= frames);
            }
            let all = scene.times.len();
            scene.times.truncate(all - frames);
            done += 1.0;
        }
        at += 4 + (3.0 * normal(random).abs()).min(4.0) as usize;
    }
}

/// How many objects are at rest.
fn at_rest(scene: &Scene) -> usize {
    let (size, least) = (6.0 * noise(scene), scene.times.len() / 2);
    let rests = |samples: &[Sample]| {
        let far = |s: &Sample| (s.position - samples[0].position).norm() > size;
        samples.len() > least.max(40) && !samples.iter().any(far)
    };
    scene.tracks.iter().filter(|t| !t.samples.is_empty() && rests(&t.samples)).count()
}

fn swaying(scene: &mut Scene, times: f64, _: &mut ChaCha8Rng) {
    if at_rest(scene) < 1 || scene.tracks.len() < 2 {
        return;
    }
    let (size, seconds) = (times * noise(scene), scene.times.clone());
    let way =
        |f: usize| vec2(0.9, 0.4).scaled(size * elementary::sin_cos(std::f64::consts::TAU * seconds[f]).0);
    each(scene, |s| s.position += way(s.frame));
}

fn drifting(scene: &mut Scene, times: f64, _: &mut ChaCha8Rng) {
    if at_rest(scene) < 2 {
        return;
    }
    let (size, all) = (times * noise(scene), scene.times.len() as f64);
    each(scene, |s| s.position += vec2(0.8, 0.6).scaled(size * s.frame as f64 / all));
}

fn zooming(scene: &mut Scene, percent: f64, _: &mut ChaCha8Rng) {
    if at_rest(scene) < 3 {
        return;
    }
    let seconds = scene.times.clone();
    let zoom = |f: usize| 1.0 + 0.01 * percent * elementary::sin_cos(std::f64::consts::TAU * seconds[f]).0;
    each(scene, |s| s.position = s.position.scaled(zoom(s.frame)));
}

/// The second half was recorded at another rate.
fn two_rates(scene: &mut Scene, ratio: f64, _: &mut ChaCha8Rng) {
    let (middle, least) = (scene.times.len() / 2, 5.0 * noise(scene));
    let moves = |t: &&vrdp::scene::Track| {
        let pair = t.at(middle - 1).zip(t.at(middle + 1));
        pair.is_some_and(|(a, b)| (b.position - a.position).norm() > least)
    };
    if scene.tracks.iter().filter(moves).count() < 2 {
        return;
    }
    for track in &mut scene.tracks {
        let (first, second): (Vec<Sample>, Vec<Sample>) =
            track.samples.iter().partition(|s| s.frame <= middle);
        track.samples = first;
        for frame in middle + 1..scene.times.len() {
            let at = middle as f64 + ratio * (frame - middle) as f64;
            let share = at - at.floor();
            let pair = second
                .iter()
                .find(|s| s.frame == at as usize)
                .zip(second.iter().find(|s| s.frame == at.ceil() as usize));
            // Half a frame is a mean of two: its noise is less, which is no matter here.
            if let Some((a, b)) = pair {
                let position = a.position.scaled(1.0 - share) + b.position.scaled(share);
                track.samples.push(Sample { frame, position, ..*a });
            }
        }
    }
}
