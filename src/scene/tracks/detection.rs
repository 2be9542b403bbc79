//! What a detector finds in single frames, and what is known for linking it.

use crate::scene::camera::projection::Camera;
use crate::scene::limits::MAX_FEATURES;
use crate::scene::tracks::mask::BoundingBox;
use std::collections::BTreeMap;

/// Confidence of a detector in each word of an attribute.
pub type AttributeScores = BTreeMap<String, f64>;

/// A body found in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    pub frame: usize,
    /// Box around the visible part of the body (px).
    pub bounds: BoundingBox,
    pub color: AttributeScores,
    pub material: AttributeScores,
    pub shape: AttributeScores,
    /// Confidence of the detection: its weight in votes.
    pub score: f64,
    /// What the detector's network saw of it; empty, or as long as those of the other detections.
    pub features: Vec<f32>,
}

/// What is wrong with the features of a detection or an object; `length`: of those before.
pub fn checked_features(features: &[f32], length: &mut Option<usize>) -> Result<(), String> {
    if features.is_empty() {
        return Ok(());
    }
    if features.len() > MAX_FEATURES {
        return Err(format!("has {} numbers; give at most {MAX_FEATURES}", features.len()));
    }
    if let Some(k) = features.iter().position(|f| !f.is_finite()) {
        return Err(format!("number {k} is {}; give finite numbers", features[k]));
    }
    match *length.get_or_insert(features.len()) {
        expected if expected == features.len() => Ok(()),
        expected => Err(format!(
            "has {} numbers, but those before have {expected}; give equally many, or none",
            features.len()
        )),
    }
}

/// What is known besides the detections.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkOptions {
    /// Frames of the video.
    pub frames: usize,
    /// 1/s.
    pub fps: f64,
    pub camera: Camera,
    /// Radius or half side of every object (m).
    pub size: f64,
    /// Standard deviation of a box's edge (px).
    pub sigma: f64,
}
