//! Positions that were filled in on straight lines between measured ones.
//!
//! A measured position lies beside the line through its neighbours by its noise. Where a fair part of a track's positions lies on that
//! line to within the rounding step, and the others are beside it by far more, the former were not measured.

use super::finding::{FindingKind, TrackFinding};
use super::leave_out;
use crate::num::quantile;
use crate::scene::observation::{Sample, Scene};
use std::collections::BTreeSet;

/// Share of the positions that is on the line: less is chance, and more is motion without noise.
const SHARE: std::ops::Range<f64> = 0.25..0.95;
/// On the line to so many steps: rounding moves the sum of three positions by two steps in each coordinate. The others are beside it by
/// so many times more.
const ON: f64 = 3.0;
const BESIDE: f64 = 10.0;

/// Moves such samples to the outliers, and says so.
pub fn leave_out_interpolated(scene: &mut Scene, step: f64) -> Vec<TrackFinding> {
    let mut found = vec![];
    for object in 0..scene.tracks.len() {
        let frames = interpolated(&scene.tracks[object].samples, step);
        if frames.is_empty() {
            continue;
        }
        let value = frames.len() as f64 / scene.tracks[object].samples.len() as f64;
        leave_out(scene, object, |s| frames.contains(&s.frame));
        let (objects, frames) = (vec![scene.objects[object].id], frames.into_iter().collect());
        found.push(TrackFinding { kind: FindingKind::Interpolated, objects, frames, value });
    }
    found
}

/// Frames whose positions are on the line between their neighbours, if these are no chance.
fn interpolated(samples: &[Sample], step: f64) -> BTreeSet<usize> {
    let beside = |w: &[Sample]| {
        let moves = w[0].position != w[1].position && w[1].position != w[2].position;
        let even = moves && w[0].frame + 1 == w[1].frame && w[1].frame + 1 == w[2].frame;
        let off = (w[0].position + w[2].position - w[1].position.scaled(2.0)).norm();
        even.then_some((w[1].frame, off))
    };
    let all: Vec<(usize, f64)> = samples.windows(3).filter_map(beside).collect();
    let spread = samples.iter().map(|s| s.position.norm()).fold(0.0, f64::max);
    let on = f64::max(ON * step, ROUND_OFF * spread);
    let frames: BTreeSet<usize> = all.iter().filter(|(_, off)| *off <= on).map(|(frame, _)| *frame).collect();
    let mut others: Vec<f64> = all.iter().map(|(_, off)| *off).filter(|off| *off > on).collect();
    let share = frames.len() as f64 / all.len().max(1) as f64;
    let clear = quantile(&mut others, 0.25).is_some_and(|off| off > BESIDE * on);
    if SHARE.contains(&share) && clear { frames } else { BTreeSet::new() }
}

/// Round-off of numbers of this size.
const ROUND_OFF: f64 = 1e-12;
