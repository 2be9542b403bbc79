//! Values that stand for "not seen", such as (-1, -1) or (0, 0), in single frames here and there.
//!
//! No object is measured twice in exactly one place with other places in between. Samples with one position are no measurement
//! where they come in more than one run, and most of the runs lie far from where the object is before and after, which are
//! nearer to each other.

use super::finding::{FindingKind, TrackFinding};
use super::leave_out;
use crate::num::Vec2;
use crate::scene::observation::{Sample, Scene};
use std::collections::BTreeMap;

/// Runs that show a value that stands for something else.
const RUNS: usize = 2;
/// A run is far where its distance is so many times that between what is before and after it.
const FAR: f64 = 3.0;

/// Moves such samples to the outliers, and says so.
pub fn leave_out_markers(scene: &mut Scene) -> Vec<TrackFinding> {
    let mut found = vec![];
    for object in 0..scene.tracks.len() {
        let size = scene.objects[object].shape.inscribed_radius();
        let markers = markers(&scene.tracks[object].samples, size);
        if markers.is_empty() {
            continue;
        }
        let frames = leave_out(scene, object, |s| markers.contains(&s.position));
        let (objects, value) = (vec![scene.objects[object].id], frames.len() as f64);
        found.push(TrackFinding { kind: FindingKind::Leaps, objects, frames, value });
    }
    found
}

/// Positions that are no measurement.
fn markers(samples: &[Sample], size: f64) -> Vec<Vec2> {
    let key = |s: &Sample| [s.position.x.to_bits(), s.position.y.to_bits()];
    let mut runs: BTreeMap<[u64; 2], Vec<(usize, usize)>> = BTreeMap::new();
    let mut start = 0;
    for k in 1..=samples.len() {
        if k == samples.len() || key(&samples[k]) != key(&samples[start]) {
            runs.entry(key(&samples[start])).or_default().push((start, k));
            start = k;
        }
    }
    let is_far = |&(first, end): &(usize, usize)| {
        let (Some(before), Some(after)) =
            (first.checked_sub(1).and_then(|k| samples.get(k)), samples.get(end))
        else {
            return false;
        };
        let away = |s: &Sample| (s.position - samples[first].position).norm();
        let apart = (after.position - before.position).norm();
        away(before).min(away(after)) > size + FAR * apart
    };
    let stands = |runs: &Vec<(usize, usize)>| {
        let far = runs.iter().filter(|run| is_far(run)).count();
        far >= RUNS && 2 * far > runs.len()
    };
    runs.values().filter(|runs| stands(runs)).map(|runs| samples[runs[0].0].position).collect()
}
