//! Positions that were filled in on straight lines between measured ones.
//!
//! A measured position lies beside the line through its neighbours by its noise. Where more of a track's positions lie on that line, to
//! within the rounding step d, than the normal distribution of the others allows, those were not measured: with a median distance m
//! of the others chance puts the share 1 - 2^(-(d/m)^2) of all there.

use super::finding::{FindingKind, TrackFinding};
use super::leave_out;
use crate::num::{elementary, quantile};
use crate::scene::observation::{Sample, Scene};
use std::collections::BTreeSet;

/// Share of the positions that is on the line, at most: more is motion without noise.
const LARGEST_SHARE: f64 = 0.95;
/// On the line to so many steps: rounding moves the sum of three positions by two steps in each coordinate.
const ON: f64 = 3.0;
/// The others are beside it by so many times more.
const BESIDE: f64 = 5.0;
/// More of them than this, and than five deviations beyond chance, show that there are any.
const FEWEST: f64 = 2.0;
/// Round-off of numbers of this size.
const ROUND_OFF: f64 = 1e-12;

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
    let usual = quantile(&mut others, 0.5).unwrap_or(0.0);
    if usual < BESIDE * on {
        return BTreeSet::new();
    }
    // Of a two-dimensional normal distribution with this median.
    let share = 1.0 - elementary::exp(-std::f64::consts::LN_2 * on * on / (usual * usual));
    let by_chance = share * all.len() as f64;
    let clear = frames.len() as f64 > FEWEST + by_chance + 5.0 * by_chance.sqrt();
    if clear && (frames.len() as f64) < LARGEST_SHARE * all.len() as f64 { frames } else { BTreeSet::new() }
}
