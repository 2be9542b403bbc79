//! Where a thing that nobody saw may stand: behind the jumps of objects that met no other.

use super::smooth_track::ChangePoint;
use crate::effects::Region;
use crate::num::{Vec2, elementary, vec2};
use crate::world::Model;

/// Jumps agree with one wall within this distance (m) and cosine.
const SAME_WALL: f64 = 0.15;
const SAME_NORMAL: f64 = 0.9;
/// The same with one disc, whose side shows less of it.
const SAME_DISC: f64 = 0.3;
const SAME_RADIAL: f64 = 0.8;
/// Sine of the angle at which lines cross somewhere certain.
const CROSSING: f64 = 0.4;
/// Radii of unseen objects that are tried (m), and the bounds of one that two jumps tell.
const RADII: [f64; 3] = [0.1, 0.2, 0.4];
const RADIUS: std::ops::Range<f64> = 0.03..0.8;
/// Restitution to begin with.
const RESTITUTION: f64 = 0.7;

/// A wall or a disc to begin with: its parameters, and how many jumps agree with it.
#[derive(Debug, Clone)]
pub struct HiddenPlace {
    pub values: Vec<f64>,
    pub agree: usize,
}

/// The least radius of what is struck.
fn own_radius(models: &[Model]) -> f64 {
    let radius = models.iter().flat_map(|m| &m.bodies).map(|b| b.shape.bounding_radius());
    radius.fold(f64::INFINITY, f64::min)
}

/// One wall for each jump, from all jumps that agree with it; those with most agreement first.
pub fn walls(jumps: &[(usize, ChangePoint)], models: &[Model]) -> Vec<HiddenPlace> {
    let radius = own_radius(models);
    let normal = |j: &ChangePoint| j.change.unit();
    let mut found: Vec<HiddenPlace> = jumps
        .iter()
        .map(|(_, seed)| {
            let agree: Vec<&ChangePoint> = jumps
                .iter()
                .map(|(_, j)| j)
                .filter(|j| {
                    normal(j).dot(normal(seed)) > SAME_NORMAL
                        && (j.position - seed.position).dot(normal(seed)).abs() < SAME_WALL
                })
                .collect();
            let sum = agree.iter().fold(Vec2::zero(), |s, j| s + j.change);
            let n = sum.unit();
            let offset = agree.iter().map(|j| j.position.dot(n)).sum::<f64>() / agree.len() as f64 - radius;
            HiddenPlace {
                values: vec![1.0, offset, elementary::atan2(n.y, n.x), RESTITUTION],
                agree: agree.len(),
            }
        })
        .collect();
    found.sort_by_key(|f| std::cmp::Reverse(f.agree));
    found
        .dedup_by(|a, b| (a.values[1] - b.values[1]).abs() < 0.05 && (a.values[2] - b.values[2]).abs() < 0.1);
    found
}

/// Four walls around all tracks, where jumps away from two sides or more happen where the tracks end on that side; at most one.
/// Nothing is known of a side that no jump tells: it is out of reach.
pub fn rectangle(jumps: &[(usize, ChangePoint)], models: &[Model], region: &Region) -> Option<HiddenPlace> {
    let (own, size) = (own_radius(models), (region.high - region.low).norm());
    // Inward normals, and how far the tracks go against each.
    let sides = [
        (vec2(1.0, 0.0), region.low.x),
        (vec2(-1.0, 0.0), -region.high.x),
        (vec2(0.0, 1.0), region.low.y),
        (vec2(0.0, -1.0), -region.high.y),
    ];
    let told = sides.map(|(normal, end)| {
        let at_end = |j: &ChangePoint| {
            j.change.unit().dot(normal) > SAME_NORMAL && j.position.dot(normal) - end < SAME_WALL
        };
        jumps.iter().filter(|(_, j)| at_end(j)).count()
    });
    if told.iter().filter(|n| **n > 0).count() < 2 {
        return None;
    }
    let offsets: Vec<f64> = sides
        .iter()
        .zip(told)
        .map(|((normal, end), told)| {
            let offset = end - own - if told > 0 { 0.0 } else { size };
            offset * (normal.x + normal.y)
        })
        .collect();
    let values = [&[1.0], &offsets[..], &[RESTITUTION]].concat();
    Some(HiddenPlace { values, agree: told.iter().sum() })
}

/// Discs behind the strongest jumps.
pub fn discs_behind(jumps: &[(usize, ChangePoint)], models: &[Model]) -> Vec<HiddenPlace> {
    let own = own_radius(models);
    let mut jumps: Vec<&ChangePoint> = jumps.iter().map(|(_, j)| j).collect();
    jumps.sort_by(|a, b| b.sigmas.total_cmp(&a.sigmas));
    let mut all = vec![];
    for jump in jumps.into_iter().take(2) {
        for radius in RADII {
            let center = jump.position - jump.change.unit().scaled(own + radius);
            all.push(HiddenPlace { values: vec![1.0, center.x, center.y, radius, RESTITUTION], agree: 1 });
        }
    }
    all
}

/// Discs that two jumps tell, where their lines of impact cross; those with which most jumps agree first.
pub fn discs_between(jumps: &[(usize, ChangePoint)], models: &[Model]) -> Vec<HiddenPlace> {
    let own = own_radius(models);
    let mut found: Vec<HiddenPlace> = vec![];
    for (k, (_, a)) in jumps.iter().enumerate() {
        for (_, b) in &jumps[..k] {
            let (n, m) = (a.change.unit(), b.change.unit());
            let turned = n.cross(m);
            // Lines of impact that are nearly parallel cross anywhere.
            if turned.abs() < CROSSING {
                continue;
            }
            // Both places lie before the middle: a - s n = b - t m.
            let between = a.position - b.position;
            let (s, t) = (between.cross(m) / turned, between.cross(n) / turned);
            let radius = 0.5 * (s + t) - own;
            if (s - t).abs() > SAME_DISC || !RADIUS.contains(&radius) {
                continue;
            }
            let center = (a.position - n.scaled(s) + b.position - m.scaled(t)).scaled(0.5);
            let struck = |j: &ChangePoint| {
                let away = j.position - center;
                away.unit().dot(j.change.unit()) > SAME_RADIAL
                    && (away.norm() - own - radius).abs() < SAME_DISC
            };
            let agree = jumps.iter().filter(|(_, j)| struck(j)).count();
            found.push(HiddenPlace { values: vec![1.0, center.x, center.y, radius, RESTITUTION], agree });
        }
    }
    found.sort_by_key(|f| std::cmp::Reverse(f.agree));
    let mut kept: Vec<HiddenPlace> = vec![];
    for place in found {
        let near = |k: &HiddenPlace| {
            elementary::hypot(k.values[1] - place.values[1], k.values[2] - place.values[2]) < SAME_DISC
        };
        if !kept.iter().any(near) {
            kept.push(place);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::super::tests::{DISC, film, models};
    use super::*;

    #[test]
    fn jumps_where_the_tracks_end_are_a_rectangle_and_others_are_none() {
        let scenes = film(&[vec![(DISC, 1.0, [0.0, 0.0], [0.0, 0.0])]], None);
        let models = models(&scenes);
        let region = Region { low: vec2(-0.8, -0.3), high: vec2(0.8, 0.3), duration: 4.0, places: 8 };
        let jump = |x: f64, y: f64, change: Vec2| {
            (0, ChangePoint { frame: 9, position: vec2(x, y), change, sigmas: 50.0 })
        };
        let right = jump(0.78, 0.1, vec2(-2.0, 0.05));
        let top = jump(0.2, 0.29, vec2(0.0, -1.0));
        let inside = jump(-0.2, 0.1, vec2(2.0, 0.0));
        let found = rectangle(&[right, top], &models, &region).expect("two sides");
        assert!((found.values[2] - 1.0).abs() < 1e-9 && (found.values[4] - 0.5).abs() < 1e-9, "{found:?}");
        // Nobody reached the others.
        assert!(found.values[1] < -1.5 && found.values[3] < -1.5 && found.agree == 2, "{found:?}");
        assert!(rectangle(&[right, inside], &models, &region).is_none(), "one side");
    }
}
