//! What is assumed where a file of tracks does not state it, and implausible scales, in words for the user.

use crate::num::{Vec2, elementary};
use crate::scene::limits::{DEFAULT_FPS, DEFAULT_SIZE};
use crate::scene::observation::Scene;

/// Tracks that span more sizes of their objects are in a wrong unit, most likely.
const MOST_SIZES: f64 = 300.0;
/// So many sizes they span in the right unit, at most.
const USUAL_SIZES: f64 = 100.0;
/// Moving objects of an assumed size span more of it.
const FEWEST_SIZES: f64 = 2.0;

/// What a file states, and how its format would state it.
#[derive(Debug, Clone, Copy)]
pub(super) struct StatedValues {
    pub size: bool,
    pub fps: bool,
    pub world: bool,
    /// The size (m) that is assumed in place of the default, because centres come closer.
    pub shrunk: Option<f64>,
    /// How to state size, frame rate, world, mass and unit.
    pub how: [&'static str; 5],
}

/// One line for each assumption, with what to write instead.
pub(super) fn assumptions(scene: &Scene, stated: &StatedValues) -> Vec<String> {
    let [size, fps, world, mass, _] = stated.how;
    let mut lines = vec![];
    match stated.shrunk {
        Some(half) => lines.push(format!(
            "radius or half side of {half:.2e} m, half of the least distance of two centres ({size})"
        )),
        None if !stated.size => lines.push(format!("radius or half side of {DEFAULT_SIZE} m ({size})")),
        None => {}
    }
    if !stated.fps {
        lines.push(format!("{DEFAULT_FPS} frames per second ({fps})"));
    }
    if !stated.world {
        lines.push(format!("world {}, which selects the preset ({world})", scene.world.name()));
    }
    if scene.objects.iter().all(|o| o.mass.is_none()) {
        lines
            .push(format!("masses near 1 kg, as none is given: masses and forces (N) are relative ({mass})"));
    }
    lines.extend(doubtful_scale(scene, stated));
    lines
}

/// A doubt about the unit of lengths.
fn doubtful_scale(scene: &Scene, stated: &StatedValues) -> Option<String> {
    let span = span(scene);
    let largest = scene.objects.iter().map(|o| o.shape.inscribed_radius()).fold(0.0, f64::max);
    let ratio = span / largest;
    let [size, .., unit] = stated.how;
    if ratio > MOST_SIZES {
        let fits = |metre: f64| ratio * metre <= USUAL_SIZES;
        let meant = [("cm", 1e-2), ("mm", 1e-3)].into_iter().find(|(_, metre)| fits(*metre));
        let meant = meant.map_or("wrong", |(unit, _)| unit);
        Some(format!(
            "metres, although the tracks span {span:.0} m for objects of {largest} m: is the unit {meant}? ({unit})"
        ))
    } else if !stated.size && ratio < FEWEST_SIZES && scene.objects.len() > 1 {
        Some(format!(
            "metres, although all tracks lie within {span:.2} m, for objects of {largest} m: are size and unit right? ({size})"
        ))
    } else {
        None
    }
}

/// Diagonal of the rectangle that holds all positions (m).
fn span(scene: &Scene) -> f64 {
    let positions = || scene.tracks.iter().flat_map(|t| &t.samples).map(|s| s.position);
    let extent = |axis: fn(Vec2) -> f64| {
        let low = positions().map(axis).fold(f64::INFINITY, f64::min);
        (positions().map(axis).fold(f64::NEG_INFINITY, f64::max) - low).max(0.0)
    };
    elementary::hypot(extent(|p| p.x), extent(|p| p.y))
}
