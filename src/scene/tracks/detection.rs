//! What a detector finds in single frames, and what is known for linking it.

use crate::scene::camera::projection::Camera;
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
