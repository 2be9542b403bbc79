//! Frames that show the one before again: a camera that is read faster than it takes pictures, or a tracker that holds a position.
//!
//! Two neighbouring samples with equal coordinates are a repeat where their object's samples usually change by much more than the
//! step q of its coordinates: with changes of median size m in x and y, equality has about probability p = (q / (2.5 m))^2
//! each time. There must be more of them than that gives by chance, and the object must be found, after the run, where
//! uniform motion through it leads: what is at rest without any noise is no repeat.

use super::finding::{FindingKind, TrackFinding};
use super::leave_out;
use crate::num::{Vec2, quantile};
use crate::scene::observation::{Sample, Scene};
use std::collections::BTreeSet;

/// Samples before and after a run that tell how its object moves.
const NEIGHBOURS: usize = 6;
/// Longest run of equal positions that may be repeats (samples).
const LONGEST: usize = 12;
/// Changes must be so many steps.
const CLEAR: f64 = 10.0;
/// How far the position after a run may be from uniform motion, in usual changes.
const NEAR: f64 = 4.0;
/// More repeats than this, beyond chance, show that there are any.
const FEWEST: usize = 2;

/// Moves repeated samples to the outliers, and says so.
pub fn leave_out_repeats(scene: &mut Scene, step: f64) -> Vec<TrackFinding> {
    let mut held: Vec<BTreeSet<usize>> =
        (0..scene.tracks.len()).map(|k| repeats(scene, &scene.tracks[k].samples, step)).collect();
    let whole: BTreeSet<usize> = held.iter().flatten().copied().filter(|&f| stands(scene, f)).collect();
    for frames in &mut held {
        frames.retain(|f| !whole.contains(f));
    }
    let mut found = vec![];
    if whole.len() > FEWEST {
        let value = whole.len() as f64 / scene.times.len().max(1) as f64;
        let frames = whole.iter().copied().collect();
        found.push(TrackFinding { kind: FindingKind::RepeatedFrames, objects: vec![], frames, value });
        (0..scene.tracks.len()).for_each(|k| _ = leave_out(scene, k, |s| whole.contains(&s.frame)));
    }
    for (k, frames) in held.iter().enumerate() {
        let seen = scene.tracks[k].samples.len();
        if frames.len() > FEWEST {
            let value = frames.len() as f64 / seen.max(1) as f64;
            let (objects, frames_of) = (vec![scene.objects[k].id], frames.iter().copied().collect());
            found.push(TrackFinding {
                kind: FindingKind::RepeatedPositions,
                objects,
                frames: frames_of,
                value,
            });
            leave_out(scene, k, |s| frames.contains(&s.frame));
        }
    }
    found
}

/// Whether all objects that are seen in a frame and the one before stand where they stood.
fn stands(scene: &Scene, frame: usize) -> bool {
    let pairs = scene.tracks.iter().filter_map(|t| {
        let at = t.samples.binary_search_by_key(&frame, |s| s.frame).ok()?;
        let (before, here) = (t.samples.get(at.checked_sub(1)?)?, &t.samples[at]);
        (before.frame + 1 == frame).then(|| same(before, here))
    });
    pairs.fold(None, |all: Option<bool>, same| Some(all.unwrap_or(true) && same)).unwrap_or(false)
}

fn same(a: &Sample, b: &Sample) -> bool {
    a.position == b.position
}

/// Frames of a track that repeat the sample before. Nothing follows the last run: it repeats where others do.
fn repeats(scene: &Scene, samples: &[Sample], step: f64) -> BTreeSet<usize> {
    let (mut found, mut last) = (BTreeSet::new(), vec![]);
    let (mut at, mut chance) = (0, 0.0);
    while at < samples.len() {
        let run = samples[at..].iter().take_while(|s| same(s, &samples[at])).count();
        if let Some(change) = usual_change(samples, at, run) {
            chance += run as f64 * (step / (2.5 * change)) * (step / (2.5 * change));
            let again = || samples[at + 1..at + run].iter().map(|s| s.frame);
            let clear = run > 1 && run <= LONGEST && change > CLEAR * step;
            if clear && at + run == samples.len() {
                last = again().collect();
            } else if clear && goes_on(scene, samples, at, run, change) {
                found.extend(again());
            }
        }
        at += run;
    }
    let by_chance = chance + 5.0 * chance.sqrt();
    if found.len() as f64 > by_chance + FEWEST as f64 {
        found.extend(last);
        return found;
    }
    BTreeSet::new()
}

/// Median size of the changes of a coordinate near a run, of samples that differ (m).
fn usual_change(samples: &[Sample], at: usize, run: usize) -> Option<f64> {
    let near = &samples[at.saturating_sub(2 * NEIGHBOURS)..(at + run + 2 * NEIGHBOURS).min(samples.len())];
    let changes = near.windows(2).filter(|w| !same(&w[0], &w[1]));
    let mut sizes: Vec<f64> =
        changes.map(|w| (w[1].position - w[0].position).norm() / std::f64::consts::SQRT_2).collect();
    quantile(&mut sizes, 0.5).filter(|size| *size > 0.0)
}

/// Whether the object is found after a run where uniform motion through it leads.
fn goes_on(scene: &Scene, samples: &[Sample], at: usize, run: usize, change: f64) -> bool {
    let time = |s: &Sample| scene.time_of(s.frame);
    let velocity = |a: &Sample, b: &Sample| (b.position - a.position).scaled(1.0 / (time(b) - time(a)));
    let (Some(next), here) = (samples.get(at + run), &samples[at]) else { return false };
    let before = at.checked_sub(1).map(|_| &samples[at.saturating_sub(NEIGHBOURS)]);
    let after = samples.get((at + run + NEIGHBOURS).min(samples.len() - 1)).filter(|s| s.frame > next.frame);
    let speeds: Vec<Vec2> =
        [before.map(|b| velocity(b, here)), after.map(|a| velocity(next, a))].into_iter().flatten().collect();
    if speeds.is_empty() {
        return false;
    }
    let mean = speeds.iter().fold(Vec2::zero(), |sum, v| sum + *v).scaled(1.0 / speeds.len() as f64);
    let way = mean.scaled(time(next) - time(here));
    (next.position - here.position - way).norm() < f64::max(0.5 * way.norm(), NEAR * change)
}
