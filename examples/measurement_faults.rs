//! How often faults of a measurement are named, and how often good tracks are accused of one: puts each kind of fault, at three
//! strengths, into the scenes of folders, and prints a table.
//!
//! `cargo run --release --example measurement_faults -- FOLDER...`

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vrdp::num::{Vec2, vec2};
use vrdp::scene::{FindingKind, Sample, Scene, parse, parse_csv};

/// A fault: its name, the finding that names it, its strengths, and how it is put into a scene.
type Fault = (&'static str, FindingKind, [f64; 3], fn(&mut Scene, f64, &mut ChaCha8Rng));

const FAULTS: [Fault; 9] = [
    ("whole pixels (step / noise)", FindingKind::Steps, [2.0, 4.0, 8.0], pixels),
    ("each n-th frame repeated", FindingKind::RepeatedFrames, [2.0, 3.0, 5.0], repeated),
    ("frames lost in one place", FindingKind::LostFrames, [1.0, 3.0, 8.0], lost),
    ("identities exchanged (share of the video)", FindingKind::SwappedIdentities, [0.3, 0.5, 0.7], exchanged),
    ("track on another object (share)", FindingKind::Leaps, [0.1, 0.3, 0.6], taken_over),
    ("(-1, -1) for not seen (share)", FindingKind::Leaps, [0.05, 0.1, 0.3], marked),
    ("mean of n frames", FindingKind::DependentNoise, [3.0, 5.0, 9.0], smoothed),
    ("shake (in noise)", FindingKind::MovingCamera, [1.0, 2.0, 4.0], shaken),
    ("bump (in noise)", FindingKind::MovingCamera, [8.0, 16.0, 32.0], bumped),
];

fn main() {
    let scenes: Vec<Scene> = std::env::args().skip(1).flat_map(|folder| files(Path::new(&folder))).collect();
    let accused: Vec<String> =
        scenes.iter().flat_map(|s| s.findings.iter().map(|f| format!("{}: {f}", s.name))).collect();
    println!("{} scenes as they are: {} findings", scenes.len(), accused.len());
    accused.iter().for_each(|line| println!("  {line}"));
    println!("{:44} {:>8} {:>10} {:>8} {:>8}", "fault", "strength", "applicable", "named", "others");
    for (name, kind, strengths, put) in FAULTS {
        for strength in strengths {
            let (mut applicable, mut named, mut others) = (0, 0, BTreeMap::new());
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
                        let other = found.findings.iter().filter(|f| f.kind != kind);
                        other.for_each(|f| *others.entry(f.kind.name()).or_insert(0) += 1);
                    }
                    Err(_) => *others.entry("refused").or_insert(0) += 1,
                }
            }
            println!("{name:44} {strength:8} {applicable:10} {named:8}   {others:?}");
        }
    }
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
