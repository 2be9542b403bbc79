//! Features of objects: numbers of one layout, from which words are learned.
//!
//! A scene that `perception` made has 16 numbers for each object ([`crate::perception::FEATURE_LAYOUT`]), against the grey ground as
//! white card. They become [`APPEARANCE`]: chroma c = (red, blue), its length, its direction times `min(1, |c|/0.2)` (grey has no
//! direction), its squares, the median lightness, the other quantiles relative to it, the chroma of the highlights relative to c,
//! and for each form `P(form) ~ exp(-15 cost)` and the logarithm of the cost above the least. Squares are there because a
//! mirror is darker than a matt body of its colour, and the lightness of a colour is no linear function of its chroma.
//! A client's own vector is taken as it is.
//!
//! Motion, of the samples of a track smoothed over [`HALF_WINDOW`] frames: see [`MOTION`].

use super::error::ConceptError;
use crate::fit::Fit;
use crate::num::elementary::{atan2, exp, ln};
use crate::num::{Vec2, wrap_angle};
use crate::scene::{Scene, Track};
use serde::{Deserialize, Serialize};

/// Change it when the meaning of a feature changes: a lexicon of another version is refused.
pub const FEATURES_VERSION: u32 = 1;
/// Chroma below which the hue counts less: the deviation of chroma within a colour.
const GREY_CHROMA: f64 = 0.2;
/// Half the number of independent points of an outline: costs are squares of normalised distances.
const FORM_SHARPNESS: f64 = 15.0;
/// Frames on each side over which a velocity is averaged: with 5 mm of noise at 25 frames/s its deviation is about 0.02 m/s.
const HALF_WINDOW: usize = 3;

/// Names of the features made of perception's numbers.
pub const APPEARANCE: [&str; 28] = [
    "chroma_red",
    "chroma_blue",
    "chroma",
    "hue_cos",
    "hue_sin",
    "chroma_red^2",
    "chroma_blue^2",
    "chroma_red*chroma_blue",
    "lightness",
    "lightness_5",
    "lightness_25",
    "lightness_75",
    "lightness_95",
    "lightness_99",
    "highlight_red",
    "highlight_blue",
    "highlight_chroma_ratio",
    "lightness*chroma_red",
    "lightness*chroma_blue",
    "lightness_below_colour",
    "highlight_contrast",
    "chroma_of_colour",
    "form_sphere",
    "form_cylinder",
    "form_cube",
    "cost_sphere",
    "cost_cylinder",
    "cost_cube",
];
/// Names of the features of motion: largest, mean and last speed (m/s), path (m), net turn of the direction (rad), turn of the yaw
/// (rad), closest distance to another object (m), and with a fit the logarithm of the mass and the restitution.
pub const MOTION: [&str; 9] = [
    "top_speed",
    "mean_speed",
    "last_speed",
    "path",
    "turn",
    "yaw_turn",
    "closest",
    "log_mass",
    "contact_restitution",
];

/// Which numbers an object has.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FeatureLayout {
    /// Perception's own, or the name that the scene gives to its client's vectors; empty: not named.
    pub name: String,
    /// Numbers an object, as the scene holds them.
    pub length: usize,
    pub version: u32,
}

impl FeatureLayout {
    /// The layout of a scene; `None` where its objects have no features.
    pub fn of(scene: &Scene) -> Option<FeatureLayout> {
        let length = scene.objects.first()?.features.len();
        let name = scene.feature_layout.clone().unwrap_or_default();
        (length > 0).then_some(FeatureLayout { name, length, version: FEATURES_VERSION })
    }

    /// The layout of a scene, which must be the expected one where there is such; `video` names it in errors.
    pub fn of_video(
        video: &dyn Fn() -> String,
        scene: &Scene,
        expected: Option<&FeatureLayout>,
    ) -> Result<FeatureLayout, ConceptError> {
        let found = FeatureLayout::of(scene).ok_or_else(|| ConceptError::NoFeatures { video: video() })?;
        match expected.filter(|expected| **expected != found) {
            None => Ok(found),
            Some(expected) => {
                let text = |l: &FeatureLayout| format!("\"{}\" ({} numbers)", l.name, l.length);
                let (found, expected) = (text(&found), text(expected));
                Err(ConceptError::Layout { video: video(), found, expected })
            }
        }
    }

    pub fn is_perceived(&self) -> bool {
        self.name == crate::perception::FEATURE_LAYOUT
    }

    /// Number of the features that words are learned from.
    pub fn count(&self) -> usize {
        if self.is_perceived() { APPEARANCE.len() } else { self.length }
    }

    /// Names of the features that words are learned from.
    pub fn names(&self) -> Vec<String> {
        if self.is_perceived() {
            APPEARANCE.iter().map(|n| n.to_string()).collect()
        } else {
            (0..self.length).map(|k| format!("feature_{k}")).collect()
        }
    }
}

/// The appearance of each object, `[object][feature]`.
pub fn appearance(scene: &Scene) -> Vec<Vec<f64>> {
    let layout = FeatureLayout::of(scene);
    let is_perceived = layout.is_some_and(|l| l.is_perceived());
    let of = |object: &crate::scene::Object| {
        let raw: Vec<f64> = object.features.iter().map(|f| f64::from(*f)).collect();
        if is_perceived { expanded(&raw) } else { raw }
    };
    scene.objects.iter().map(of).collect()
}

/// Perception's 16 numbers as [`APPEARANCE`].
fn expanded(raw: &[f64]) -> Vec<f64> {
    let &[
        red,
        blue,
        q5,
        q25,
        q50,
        q75,
        q95,
        q99,
        hot_red,
        hot_blue,
        deficit,
        contrast,
        share,
        sphere,
        cylinder,
        cube,
    ] = raw
    else {
        return vec![0.0; APPEARANCE.len()];
    };
    let chroma = (red * red + blue * blue).sqrt();
    let gate = (chroma / GREY_CHROMA).min(1.0) / chroma.max(1e-9);
    let hot = (hot_red * hot_red + hot_blue * hot_blue).sqrt();
    let costs = [sphere, cylinder, cube];
    let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
    let weights = costs.map(|c| exp(-FORM_SHARPNESS * (c - least)));
    let total: f64 = weights.iter().sum();
    let mut all = vec![
        red,
        blue,
        chroma,
        gate * red,
        gate * blue,
        red * red,
        blue * blue,
        red * blue,
        q50,
        q5 - q50,
        q25 - q50,
        q75 - q50,
        q95 - q50,
        q99 - q50,
        hot_red - red,
        hot_blue - blue,
        (hot / chroma.max(GREY_CHROMA)).min(2.0),
        q50 * red,
        q50 * blue,
        deficit,
        contrast,
        share,
    ];
    all.extend(weights.map(|w| w / total));
    all.extend(costs.map(|c| ln(0.1 + (c - least).max(0.0))));
    all
}

/// The motion of each object, `[object][feature]`.
pub fn motion(scene: &Scene, fit: Option<(&Fit, usize)>) -> Vec<Vec<f64>> {
    let estimates = fit.map_or(vec![], |(fit, index)| fit.objects(index));
    let of = |(k, object): (usize, &crate::scene::Object)| {
        let track = scene.tracks.get(k).cloned().unwrap_or_default();
        let velocities: Vec<Vec2> =
            (0..track.samples.len()).filter_map(|i| velocity(scene, &track, i)).collect();
        let speeds: Vec<f64> = velocities.iter().map(|v| v.norm()).collect();
        let top = speeds.iter().copied().fold(0.0, f64::max);
        let mean = speeds.iter().sum::<f64>() / speeds.len().max(1) as f64;
        let path = track.samples.iter().step_by(HALF_WINDOW).collect::<Vec<_>>();
        let path: f64 = path.windows(2).map(|w| (w[1].position - w[0].position).norm()).sum();
        let yaws: Vec<f64> = track.samples.iter().filter_map(|s| s.yaw).collect();
        let yaw_turn: f64 = yaws.windows(2).map(|w| wrap_angle(w[1] - w[0])).sum();
        let estimate = estimates.iter().find(|e| e.id == object.id);
        vec![
            top,
            mean,
            speeds.last().copied().unwrap_or(0.0),
            path,
            turn(&velocities),
            yaw_turn.abs(),
            closest(scene, k),
            estimate.map_or(0.0, |e| ln(e.mass.value.max(1e-6))),
            estimate.map_or(0.0, |e| e.restitution.value),
        ]
    };
    scene.objects.iter().enumerate().map(of).collect()
}

/// The mean velocity over the samples around sample `i` (m/s).
pub fn velocity(scene: &Scene, track: &Track, i: usize) -> Option<Vec2> {
    let last = track.samples.len().checked_sub(1)?;
    let (a, b) = (i.saturating_sub(HALF_WINDOW), (i + HALF_WINDOW).min(last));
    let (first, second) = (track.samples.get(a)?, track.samples.get(b)?);
    let duration = scene.time_of(second.frame) - scene.time_of(first.frame);
    (duration > 0.0).then(|| (second.position - first.position) * (1.0 / duration))
}

/// Net turn of the direction of motion (rad), while it moves at all.
fn turn(velocities: &[Vec2]) -> f64 {
    let moving: Vec<&Vec2> = velocities.iter().filter(|v| v.norm() > 0.1).collect();
    let angle = |v: &Vec2| atan2(v.y, v.x);
    moving.windows(2).map(|w| wrap_angle(angle(w[1]) - angle(w[0]))).sum::<f64>().abs()
}

/// Least distance between the centres of an object and another one (m); 10 m where there is none.
fn closest(scene: &Scene, object: usize) -> f64 {
    let Some(own) = scene.tracks.get(object) else { return 10.0 };
    let others = scene.tracks.iter().enumerate().filter(|(k, _)| *k != object);
    let distances = others.flat_map(|(_, other)| {
        own.samples.iter().filter_map(|s| Some((other.at(s.frame)?.position - s.position).norm()))
    });
    distances.fold(10.0, f64::min)
}

/// Speed of each object in each frame (m/s); `None` where it is not seen.
pub fn speeds(scene: &Scene) -> Vec<Vec<Option<f64>>> {
    let of = |track: &Track| {
        let mut speeds = vec![None; scene.times.len()];
        for (i, sample) in track.samples.iter().enumerate() {
            if let (Some(slot), Some(v)) = (speeds.get_mut(sample.frame), velocity(scene, track, i)) {
                *slot = Some(v.norm());
            }
        }
        speeds
    };
    scene.tracks.iter().map(of).collect()
}

/// Mean and standard deviation of each feature over many objects; a constant feature has the deviation 1.
pub fn standard(rows: &[Vec<f64>]) -> (Vec<f64>, Vec<f64>) {
    let length = rows.first().map_or(0, Vec::len);
    let n = rows.len().max(1) as f64;
    let mean: Vec<f64> = (0..length).map(|k| rows.iter().map(|r| r[k]).sum::<f64>() / n).collect();
    let deviation = |k: usize| {
        let variance = rows.iter().map(|r| (r[k] - mean[k]) * (r[k] - mean[k])).sum::<f64>() / n;
        if variance > 1e-12 { variance.sqrt() } else { 1.0 }
    };
    let scale = (0..length).map(deviation).collect();
    (mean, scale)
}
