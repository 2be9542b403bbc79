//! The size of objects that no table states: smaller than the default where their centres come closer than that allows.

use crate::scene::limits::{DEFAULT_SIZE, SIZE_RANGE};
use crate::scene::object::Shape;
use crate::scene::observation::{Scene, Track};
use crate::scene::tracks::outliers::reject_outliers;
use crate::scene::validate::MIN_DISTANCE_SHARE;

/// Shrinks all objects to half the least distance of two centres, if the default would put one inside another; returns the
/// new radius or half side (m).
pub(super) fn shrink_to_fit(scene: &mut Scene) -> Option<f64> {
    let (tracks, _) = reject_outliers(scene);
    let mut least = f64::INFINITY;
    for (k, a) in tracks.iter().enumerate() {
        for b in tracks.get(..k).unwrap_or_default() {
            least = least.min(least_distance(a, b));
        }
    }
    let size = 0.5 * least;
    if least >= 2.0 * MIN_DISTANCE_SHARE * DEFAULT_SIZE || size < SIZE_RANGE[0] {
        return None;
    }
    for object in &mut scene.objects {
        object.shape = match object.shape {
            Shape::Disc { .. } => Shape::Disc { radius: size },
            Shape::Ball { .. } => Shape::Ball { radius: size },
            Shape::Square { .. } => Shape::Square { half_side: size },
            other => other,
        };
    }
    Some(size)
}

/// The least distance of two centres in one frame (m).
fn least_distance(a: &Track, b: &Track) -> f64 {
    let distance = |s: &crate::scene::Sample| Some((b.at(s.frame)?.position - s.position).norm());
    a.samples.iter().filter_map(distance).fold(f64::INFINITY, f64::min)
}
