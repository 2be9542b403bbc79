//! Noise that differs by object: a marker that is seen worse, an object that is blurred.
//!
//! Each track has its own deviation, from the median of its second differences. Where these differ beyond chance, each sample gets the
//! covariance of its track, as if the tracker had stated it; a fit estimates their common scale.

use super::finding::{FindingKind, TrackFinding};
use super::position_sds;
use crate::scene::covariance::Covariance;
use crate::scene::observation::Scene;

/// Fewest samples of a track that tell its noise.
const FEWEST: usize = 24;
/// A ratio of two deviations that matters.
const LEAST: f64 = 2.0;
/// Deviations of what chance gives; that of an estimate from n samples is about 1.2 / sqrt(n) of it.
const CERTAIN: f64 = 5.0;
const BY_CHANCE: f64 = 1.2;
/// Less (m) is round-off, or an object at rest without noise.
const SMALLEST: f64 = 1e-6;

/// States the noise of each track, if they differ.
pub fn state_uneven_noise(scene: &mut Scene, step: f64) -> Option<TrackFinding> {
    let stated = scene.tracks.iter().flat_map(|t| &t.samples).any(|s| s.covariance.is_some());
    let noises = position_sds(scene, step);
    let known: Vec<usize> = (0..noises.len())
        .filter(|&k| scene.tracks[k].samples.len() >= FEWEST && noises[k] > SMALLEST)
        .collect();
    if stated || known.len() < noises.len() {
        return None;
    }
    let low = *known.iter().min_by(|a, b| noises[**a].total_cmp(&noises[**b]))?;
    let high = *known.iter().max_by(|a, b| noises[**a].total_cmp(&noises[**b]))?;
    let chance = |k: usize| CERTAIN * BY_CHANCE / (scene.tracks[k].samples.len() as f64).sqrt();
    let ratio = noises[high] / noises[low];
    if ratio < LEAST.max((1.0 + chance(high)) * (1.0 + chance(low))) {
        return None;
    }
    for (track, noise) in scene.tracks.iter_mut().zip(&noises) {
        let variance = noise * noise;
        let own = Covariance { xx: variance, xy: 0.0, yy: variance };
        track.samples.iter_mut().for_each(|s| s.covariance = Some(own));
    }
    let objects = vec![scene.objects[high].id];
    Some(TrackFinding { kind: FindingKind::UnevenNoise, objects, frames: vec![], value: ratio })
}
