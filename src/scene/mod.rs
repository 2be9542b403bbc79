//! What was observed_json of one video: objects, their tracks, the camera and the table.

mod calibrate;
mod camera;
mod clevrer;
mod csv;
mod digest;
mod link;
mod mask;
mod observed_json;
mod outliers;
mod pairs;
mod proposals;
mod silhouette;
#[cfg(test)]
mod tests;
mod tracker;
mod validate;

pub use calibrate::{CalibrateError, Calibration, MAX_PAIRS, PointPair, calibrate};
pub use camera::{
    Camera, CameraError, CameraPose, IMAGE_NOISE, IMAGE_NOISE_RANGE, Intrinsics, LocateError, Pixel, Rotation,
};
pub use clevrer::{CLEVRER_CAMERA, parse};
pub use csv::parse_csv;
pub use digest::canonical_digest;
pub use link::{
    AttributeScores, Detection, LinkError, LinkOptions, LinkReport, LinkedTracks, MAX_DETECTIONS, link,
};
pub use mask::{BoundingBox, MaskError, bounds as mask_bounds, decompress};
pub use observed_json::observed_json;
pub use outliers::Outlier;
pub use pairs::parse_pairs;
pub use proposals::{Proposals, parse_proposals};
pub use silhouette::outline;
pub use tracker::{is_tracker, parse_tracker};
pub use validate::{MASS_RANGE, MAX_NAME, MAX_POSITION, SIZE_RANGE};

use crate::num::{Vec2, wrapped};
use serde::{Deserialize, Serialize};

/// Most objects in one scene: contacts are found pair by pair and a posterior holds all of them.
pub const MAX_OBJECTS: usize = 128;
/// Most frames in one scene: ten minutes at 25 frames/s.
pub const MAX_FRAMES: usize = 15_000;
/// Radius or half side that is taken where a scene gives none (m): CLEVRER's objects.
pub const DEFAULT_SIZE: f64 = 0.2;

/// One video. Object `i` of `objects` has the track `tracks[i]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    pub name: String,
    /// The set-up (table and camera) it was filmed with; videos of one set-up share physics.
    pub setup: Option<String>,
    pub world: WorldKind,
    /// Nominal frame rate (1/s); times beyond the last frame continue at it.
    pub fps: f64,
    /// Time of each frame (s), strictly increasing.
    pub times: Vec<f64>,
    pub camera: Option<Camera>,
    pub table: Option<Table>,
    /// Standard deviation of a measured position that the user believes (m); used only where the tracks are too
    /// short to estimate it.
    pub noise_sigma: Option<f64>,
    pub objects: Vec<Object>,
    pub tracks: Vec<Track>,
    /// What was measured, but is no place of the object: it takes no part in anything.
    #[serde(rename = "strays", default, skip_serializing_if = "Vec::is_empty")]
    pub outliers: Vec<Outlier>,
}

/// What kind of place was filmed; it picks the default preset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WorldKind {
    Clevrer,
    Table,
    AirTable,
    Billiards,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Object {
    /// The scene's own id, unique in the scene.
    pub id: u32,
    pub color: String,
    pub material: String,
    pub shape: Shape,
    /// Known mass (kg); masses are relative where none is given.
    pub mass: Option<f64>,
}

/// Outline in the bird's-eye plane, and whether it rolls.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// A cylinder standing on its end; radius in m.
    Disc { radius: f64 },
    /// A sphere; radius in m.
    Ball { radius: f64 },
    /// A cube; half side in m.
    Square { half_side: f64 },
    /// A box; half length (along yaw) and half width in m.
    Rectangle { half_length: f64, half_width: f64 },
}

/// Measured positions of one object, by increasing frame; frames in which it was not seen, or went
/// astray, are absent.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Track {
    pub samples: Vec<Sample>,
}

/// Change of a turn from frame to frame (rad) beyond which a yaw is no turn about z.
const UNEVEN: f64 = 0.4;

impl Track {
    /// What was measured in a frame.
    pub fn at(&self, frame: usize) -> Option<&Sample> {
        self.samples.binary_search_by_key(&frame, |s| s.frame).ok().and_then(|k| self.samples.get(k))
    }

    /// Whether a yaw was measured throughout and turns evenly. The yaw of a ball that rolls does not: it flips each time
    /// that the ball's mark goes over the top.
    pub fn turns_evenly(&self) -> bool {
        let turn = |a: f64, b: f64| wrapped(b - a);
        let even = |w: &[Sample]| match (w[0].yaw, w[1].yaw, w[2].yaw) {
            (Some(a), Some(b), Some(c)) => turn(turn(a, b), turn(b, c)).abs() < UNEVEN,
            _ => false,
        };
        self.samples.len() > 2 && self.samples.windows(3).all(even)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Index into `Scene::times`.
    pub frame: usize,
    /// Bird's-eye position (m).
    pub position: Vec2,
    /// Orientation about z (rad), if it was measured.
    pub yaw: Option<f64>,
    /// How uncertain the position is; `None`: as uncertain as the video's positions are on average.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<Covariance>,
}

/// Covariance of the error of a position (m^2): what it says of directions and of one sample against another counts;
/// a fit scales all of a video by one factor, so that they agree with the scatter of its tracks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Covariance {
    pub xx: f64,
    pub xy: f64,
    pub yy: f64,
}

impl Covariance {
    /// The factor L with L L^T = covariance, lower triangular (m): its xx, yx and yy; `None` where there is none.
    pub fn factor(&self) -> Option<[f64; 3]> {
        let xx = self.xx.sqrt();
        let yx = self.xy / xx;
        let yy = (self.yy - yx * yx).sqrt();
        (xx > 0.0 && yy > 0.0 && xx.is_finite() && yy.is_finite()).then_some([xx, yx, yy])
    }

    /// Mean variance of a coordinate (m^2).
    pub fn mean(&self) -> f64 {
        0.5 * (self.xx + self.yy)
    }

    pub fn scaled(&self, factor: f64) -> Covariance {
        Covariance { xx: factor * self.xx, xy: factor * self.xy, yy: factor * self.yy }
    }
}

/// Playing field with cushions (m).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Table {
    pub x: [f64; 2],
    pub y: [f64; 2],
}

impl Scene {
    pub fn object_index(&self, id: u32) -> Option<usize> {
        self.objects.iter().position(|o| o.id == id)
    }

    /// Time of a frame (s), also of frames after the video.
    pub fn time_of(&self, frame: usize) -> f64 {
        match self.times.get(frame) {
            Some(t) => *t,
            None => {
                let last = self.times.len().saturating_sub(1);
                self.times.last().copied().unwrap_or(0.0) + (frame - last) as f64 / self.fps
            }
        }
    }

    /// The frame shown at a time (s): the last one that is not later, also after the video.
    pub fn frame_at(&self, time: f64) -> usize {
        match self.times.last() {
            Some(&end) if time > end => {
                self.times.len() - 1 + ((time - end) * self.fps + 1e-9).floor() as usize
            }
            _ => self.times.partition_point(|t| *t <= time + 1e-9).saturating_sub(1),
        }
    }
}

impl Object {
    /// "red metal cube"; an object without a colour has its id behind.
    pub fn description(&self) -> String {
        let id = if self.color.is_empty() { self.id.to_string() } else { String::new() };
        let words = [&self.color, &self.material, self.shape.word(), &id];
        words.into_iter().filter(|w| !w.is_empty()).collect::<Vec<_>>().join(" ")
    }
}

impl Shape {
    /// Radius of the circle around the outline (m).
    pub fn bounding_radius(&self) -> f64 {
        match *self {
            Shape::Disc { radius } | Shape::Ball { radius } => radius,
            Shape::Square { half_side } => half_side * std::f64::consts::SQRT_2,
            Shape::Rectangle { half_length, half_width } => half_length.hypot(half_width),
        }
    }

    /// Radius of the largest circle inside the outline (m).
    pub fn inscribed_radius(&self) -> f64 {
        match *self {
            Shape::Disc { radius } | Shape::Ball { radius } => radius,
            Shape::Square { half_side } => half_side,
            Shape::Rectangle { half_length, half_width } => half_length.min(half_width),
        }
    }

    /// The same outline, lengths times `factor`.
    pub fn scaled(&self, factor: f64) -> Shape {
        match *self {
            Shape::Disc { radius } => Shape::Disc { radius: radius * factor },
            Shape::Ball { radius } => Shape::Ball { radius: radius * factor },
            Shape::Square { half_side } => Shape::Square { half_side: half_side * factor },
            Shape::Rectangle { half_length, half_width } => {
                Shape::Rectangle { half_length: half_length * factor, half_width: half_width * factor }
            }
        }
    }

    /// Moment of inertia about z for mass one (m^2): solid cylinder, sphere, box.
    pub fn unit_inertia(&self) -> f64 {
        match *self {
            Shape::Disc { radius } => 0.5 * radius * radius,
            Shape::Ball { radius } => 0.4 * radius * radius,
            Shape::Square { half_side } => 2.0 / 3.0 * half_side * half_side,
            Shape::Rectangle { half_length, half_width } => {
                (half_length * half_length + half_width * half_width) / 3.0
            }
        }
    }

    /// Height of the centre above the ground, and of the projected point (m).
    pub fn centre_height(&self) -> f64 {
        match *self {
            Shape::Disc { radius } | Shape::Ball { radius } => radius,
            Shape::Square { half_side } => half_side,
            Shape::Rectangle { half_width, .. } => half_width,
        }
    }

    /// Half extents of a box along and across its yaw (m), or `None` for a circle.
    pub fn half_extents(&self) -> Option<[f64; 2]> {
        match *self {
            Shape::Disc { .. } | Shape::Ball { .. } => None,
            Shape::Square { half_side } => Some([half_side, half_side]),
            Shape::Rectangle { half_length, half_width } => Some([half_length, half_width]),
        }
    }

    pub fn is_round(&self) -> bool {
        self.half_extents().is_none()
    }

    pub fn is_ball(&self) -> bool {
        matches!(self, Shape::Ball { .. })
    }

    /// The word of CLEVRER's vocabulary for it.
    pub fn word(&self) -> &'static str {
        match self {
            Shape::Disc { .. } => "cylinder",
            Shape::Ball { .. } => "sphere",
            Shape::Square { .. } => "cube",
            Shape::Rectangle { .. } => "box",
        }
    }
}

/// One thing that is wrong with an input: where, and what.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Violation {
    /// Dotted path with indices, such as `objects[3].samples[7].x`.
    pub path: String,
    pub message: String,
}

/// An input that was refused, with everything that is wrong with it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", list(.violations))]
pub struct SceneError {
    pub violations: Vec<Violation>,
}

fn list(violations: &[Violation]) -> String {
    let lines: Vec<String> = violations.iter().map(|v| format!("{}: {}", v.path, v.message)).collect();
    lines.join("\n")
}
