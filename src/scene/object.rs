//! An object of a scene: what it looks like, and the geometry of its outline.

use crate::num::elementary;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Object {
    /// The scene's own id, unique in the scene.
    pub id: u32,
    pub color: String,
    pub material: String,
    pub shape: Shape,
    /// Known mass (kg); masses are relative where none is given.
    pub mass: Option<f64>,
    /// What a detector's network saw of it, for learning concepts; of one length in a scene, or empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub features: Vec<f32>,
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

impl Object {
    /// "red metal cube"; an object without a colour is followed by its id, as in "cube 3".
    pub fn description(&self) -> String {
        let id = if self.color.is_empty() { self.id.to_string() } else { String::new() };
        let words = [&self.color, &self.material, self.shape.word(), &id];
        words.into_iter().filter(|w| !w.is_empty()).collect::<Vec<_>>().join(" ")
    }
}

impl Shape {
    /// Radius of the smallest circle around the outline (m).
    pub fn bounding_radius(&self) -> f64 {
        match *self {
            Shape::Disc { radius } | Shape::Ball { radius } => radius,
            Shape::Square { half_side } => half_side * std::f64::consts::SQRT_2,
            Shape::Rectangle { half_length, half_width } => elementary::hypot(half_length, half_width),
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

    /// The outline with all lengths multiplied by `factor`.
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

    /// Its word in CLEVRER's vocabulary.
    pub fn word(&self) -> &'static str {
        match self {
            Shape::Disc { .. } => "cylinder",
            Shape::Ball { .. } => "sphere",
            Shape::Square { .. } => "cube",
            Shape::Rectangle { .. } => "box",
        }
    }
}
