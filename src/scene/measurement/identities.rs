//! Identities that a tracker lost: a track that goes on on another object, two that are exchanged, values that stand for "not seen".
//!
//! A track is cut where it leaps: where it is faster than twice the speeds around it and the top speed of the video, by more than
//! the noise. Of its pieces, those are its object's that continue each other and hold most samples outside of other objects: a path of
//! greatest weight in the graph of pieces, an edge where motion between two pieces is ordinary. Two tracks that leap in the same frame, each to where the other was, have
//! exchanged their identities.

use super::finding::{FindingKind, TrackFinding};
use super::position_sd;
use crate::num::{Vec2, quantile};
use crate::scene::observation::{Outlier, Sample, Scene};
use std::ops::Range;

/// A leap is faster than its surroundings by this factor; motion between two pieces is ordinary below it.
const FASTER: f64 = 2.0;
/// Steps on each side that give the usual speed.
const STEPS: usize = 5;
/// Deviations of a position that a leap must exceed.
const CLEAR: f64 = 10.0;
/// Inscribed radii that it must exceed: a shorter one is no matter of identity.
const SIZES: f64 = 1.0;
/// Pieces beyond which a track is no track of one object.
const MOST_PIECES: usize = 200;
/// A motion that was not seen for so many frames is not followed any more.
const LONGEST_GAP: usize = 50;

/// Puts exchanged identities right, and moves samples that are not their object's to the outliers.
pub fn put_identities_right(scene: &mut Scene, step: f64) -> Vec<TrackFinding> {
    let mut found = exchanged(scene, step);
    let fastest = top_speed(scene);
    for k in 0..scene.tracks.len() {
        let limits = Limits::of(scene, k, fastest, step);
        let samples = &scene.tracks[k].samples;
        let pieces = pieces(scene, samples, &limits);
        if pieces.len() < 2 || pieces.len() > MOST_PIECES {
            continue;
        }
        let weights: Vec<usize> = pieces.iter().map(|piece| outside_others(scene, k, piece)).collect();
        let kept = heaviest_path(scene, samples, (&pieces, &weights), &limits);
        let gone: Vec<Range<usize>> =
            pieces.iter().enumerate().filter(|(p, _)| !kept.contains(p)).map(|(_, r)| r.clone()).collect();
        if gone.is_empty() {
            continue;
        }
        let frames = gone.iter().map(|r| samples[r.start].frame).collect();
        let count: usize = gone.iter().map(Range::len).sum();
        let objects = vec![scene.objects[k].id];
        found.push(TrackFinding { kind: FindingKind::Leaps, objects, frames, value: count as f64 });
        set_aside(scene, k, &gone);
    }
    found
}

/// What is no leap of one track.
struct Limits {
    /// m/s.
    top_speed: f64,
    /// m.
    distance: f64,
}

impl Limits {
    fn of(scene: &Scene, track: usize, top_speed: f64, step: f64) -> Limits {
        let noise = position_sd(&scene.tracks[track].samples, step);
        let size = SIZES * scene.objects[track].shape.inscribed_radius();
        Limits { top_speed, distance: f64::max(CLEAR * noise, size) }
    }

    /// Whether motion over a time (s) is faster than such speeds around it (m/s) explain.
    fn leaps(&self, way: f64, time: f64, around: f64) -> bool {
        way > FASTER * self.top_speed.max(around) * time + self.distance
    }
}

/// Speeds from sample to sample (m/s).
fn speeds(scene: &Scene, samples: &[Sample]) -> Vec<f64> {
    let speed = |w: &[Sample]| {
        (w[1].position - w[0].position).norm() / (scene.time_of(w[1].frame) - scene.time_of(w[0].frame))
    };
    samples.windows(2).map(speed).filter(|v| v.is_finite()).collect()
}

/// The largest speed that objects of the video keep up: the greatest upper decile of a track.
fn top_speed(scene: &Scene) -> f64 {
    let of = |samples: &[Sample]| quantile(&mut speeds(scene, samples), 0.9).unwrap_or(0.0);
    scene.tracks.iter().map(|t| of(&t.samples)).fold(0.0, f64::max)
}

/// Median speed of a few steps before (or, from a sample on, after) one (m/s).
fn usual(scene: &Scene, samples: &[Sample]) -> f64 {
    quantile(&mut speeds(scene, samples), 0.5).unwrap_or(0.0)
}

/// Whether the track leaps from sample `k` to the next.
fn leaps(scene: &Scene, samples: &[Sample], k: usize, limits: &Limits) -> bool {
    let (a, b) = (&samples[k], &samples[k + 1]);
    let way = (b.position - a.position).norm();
    let time = scene.time_of(b.frame) - scene.time_of(a.frame);
    let before = usual(scene, &samples[(k + 1).saturating_sub(STEPS + 1)..k + 1]);
    let after = usual(scene, &samples[k + 1..(k + 2 + STEPS).min(samples.len())]);
    limits.leaps(way, time, before.max(after))
}

/// The runs of samples between leaps.
fn pieces(scene: &Scene, samples: &[Sample], limits: &Limits) -> Vec<Range<usize>> {
    let mut all = vec![];
    let mut start = 0;
    for k in 0..samples.len().saturating_sub(1) {
        if leaps(scene, samples, k, limits) {
            all.push(start..k + 1);
            start = k + 1;
        }
    }
    all.push(start..samples.len());
    all
}

/// How many samples of a piece are not inside another object.
fn outside_others(scene: &Scene, track: usize, piece: &Range<usize>) -> usize {
    let radius = |k: usize| scene.objects[k].shape.inscribed_radius();
    let inside = |s: &&Sample| {
        let others = (0..scene.tracks.len()).filter(|&other| other != track);
        others.into_iter().any(|other| {
            let near = 0.5 * (radius(track) + radius(other));
            scene.tracks[other].at(s.frame).is_some_and(|at| (at.position - s.position).norm() < near)
        })
    };
    piece.len() - scene.tracks[track].samples[piece.clone()].iter().filter(inside).count()
}

/// Indices of the pieces that continue each other and have the greatest weight together.
fn heaviest_path(
    scene: &Scene,
    samples: &[Sample],
    (pieces, weights): (&[Range<usize>], &[usize]),
    limits: &Limits,
) -> Vec<usize> {
    let mut best: Vec<(usize, Option<usize>)> = vec![];
    for (k, piece) in pieces.iter().enumerate() {
        let continues = |j: &usize| {
            let before = &pieces[*j];
            let (last, first) = (&samples[before.end - 1], &samples[piece.start]);
            let around = f64::max(
                usual(scene, &samples[before.end.saturating_sub(STEPS + 1).max(before.start)..before.end]),
                usual(scene, &samples[piece.start..(piece.start + STEPS + 1).min(piece.end)]),
            );
            let way = (first.position - last.position).norm();
            let time = scene.time_of(first.frame) - scene.time_of(last.frame);
            first.frame - last.frame <= LONGEST_GAP && !limits.leaps(way, time, around)
        };
        let before = (0..k).filter(continues).max_by_key(|j| (best[*j].0, usize::MAX - j));
        best.push((weights[k] + before.map_or(0, |j| best[j].0), before));
    }
    let end = (0..best.len()).max_by_key(|k| (best[*k].0, usize::MAX - k));
    let mut path: Vec<usize> = std::iter::successors(end, |k| best[*k].1).collect();
    path.reverse();
    path
}

fn set_aside(scene: &mut Scene, object: usize, gone: &[Range<usize>]) {
    let samples = std::mem::take(&mut scene.tracks[object].samples);
    let mut last: Option<Vec2> = None;
    for (k, sample) in samples.into_iter().enumerate() {
        if gone.iter().any(|r| r.contains(&k)) {
            let distance = last.map_or(0.0, |at| (sample.position - at).norm());
            scene.outliers.push(Outlier { object, sample, distance });
        } else {
            last = Some(sample.position);
            scene.tracks[object].samples.push(sample);
        }
    }
}

/// Exchanges the later samples of pairs of tracks that leap to each other's place between the same two frames.
fn exchanged(scene: &mut Scene, step: f64) -> Vec<TrackFinding> {
    let mut found = vec![];
    let fastest = top_speed(scene);
    let leaping = |scene: &Scene, k: usize| -> Vec<usize> {
        let (limits, samples) = (Limits::of(scene, k, fastest, step), &scene.tracks[k].samples);
        let cuts = (0..samples.len().saturating_sub(1)).filter(|&i| leaps(scene, samples, i, &limits));
        cuts.map(|i| samples[i].frame).collect()
    };
    for a in 0..scene.tracks.len() {
        for b in a + 1..scene.tracks.len() {
            let (of_a, of_b) = (leaping(scene, a), leaping(scene, b));
            for frame in of_a.into_iter().filter(|f| of_b.contains(f)) {
                if !leads_to_each_other(scene, [a, b], frame, fastest, step) {
                    continue;
                }
                let later = |scene: &mut Scene, k: usize| {
                    let samples = &mut scene.tracks[k].samples;
                    let at = samples.partition_point(|s| s.frame <= frame);
                    samples.split_off(at)
                };
                let (tail_a, tail_b) = (later(scene, a), later(scene, b));
                scene.tracks[a].samples.extend(tail_b);
                scene.tracks[b].samples.extend(tail_a);
                let objects = vec![scene.objects[a].id, scene.objects[b].id];
                let (kind, frames) = (FindingKind::SwappedIdentities, vec![frame + 1]);
                found.push(TrackFinding { kind, objects, frames, value: 0.0 });
            }
        }
    }
    found
}

/// Whether each of two tracks is, after a frame, where ordinary motion leads the other.
fn leads_to_each_other(scene: &Scene, [a, b]: [usize; 2], frame: usize, fastest: f64, step: f64) -> bool {
    let one = |from: usize, to: usize| -> Option<bool> {
        let limits = Limits::of(scene, from, fastest, step);
        let (before, behind) = (&scene.tracks[from].samples, &scene.tracks[to].samples);
        let at = before.partition_point(|s| s.frame <= frame);
        let next = behind.get(behind.partition_point(|s| s.frame <= frame))?;
        let last = before.get(at.checked_sub(1)?)?;
        let around = usual(scene, &before[at.saturating_sub(STEPS + 1)..at]);
        let time = scene.time_of(next.frame) - scene.time_of(last.frame);
        Some(!limits.leaps((next.position - last.position).norm(), time, around))
    };
    one(a, b) == Some(true) && one(b, a) == Some(true)
}
