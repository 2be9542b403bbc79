//! The words of CSV files: units and shapes.

use crate::scene::object::Shape;
use std::f64::consts::PI;

/// Units by name, each with its size in SI units.
pub(super) const LENGTHS: [(&str, f64); 7] =
    [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6), ("µm", 1e-6), ("micron", 1e-6), ("km", 1e3)];
pub(super) const TIMES: [(&str, f64); 7] =
    [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6), ("ns", 1e-9), ("sec", 1.0), ("seconds", 1.0)];
pub(super) const ANGLES: [(&str, f64); 4] =
    [("rad", 1.0), ("deg", PI / 180.0), ("°", PI / 180.0), ("degrees", PI / 180.0)];
pub(super) const MASSES: [(&str, f64); 2] = [("kg", 1.0), ("g", 1e-3)];
/// Units that are refused: without this list they would be names of objects.
const FOREIGN: [&str; 11] = ["ft", "feet", "in", "inch", "inches", "yd", "lb", "lbs", "oz", "min", "rev"];
/// Names of the pixel as a unit of length; its size is the file's `scale`.
pub(super) const PIXELS: [&str; 3] = ["px", "pixel", "pixels"];
/// Largest radius or half side (m).
pub(super) const MAX_SIZE: f64 = 50.0;

/// Size of a unit in SI units.
pub(super) fn size_of(units: &[(&str, f64)], unit: &str) -> Option<f64> {
    units.iter().find(|(name, _)| *name == unit).map(|(_, size)| *size)
}

/// Whether a word is a unit, known or foreign.
pub(in crate::scene::files) fn is_unit(word: &str) -> bool {
    let known = [&LENGTHS[..], &TIMES, &ANGLES, &MASSES].into_iter().flatten();
    known.map(|(name, _)| *name).chain(PIXELS).chain(FOREIGN).any(|unit| unit == word)
}

/// The name of a shape, and the shape of a given radius or half side (m).
pub(super) type ShapeKind = (&'static str, fn(f64) -> Shape);

pub(super) const DISC: ShapeKind = ("disc", |radius| Shape::Disc { radius });
pub(super) const BALL: ShapeKind = ("ball", |radius| Shape::Ball { radius });
const CUBE: ShapeKind = ("cube", |half_side| Shape::Square { half_side });
/// The shapes, for messages.
pub(super) const SHAPES: &str = "disc, ball or cube";

pub(super) fn shape_kind(word: &str) -> Option<ShapeKind> {
    match word.to_ascii_lowercase().as_str() {
        "disc" | "disk" | "puck" | "coin" | "cylinder" => Some(DISC),
        "ball" | "sphere" => Some(BALL),
        "cube" | "square" | "box" | "block" => Some(CUBE),
        _ => None,
    }
}
