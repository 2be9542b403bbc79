//! Where a thing that nobody saw may stand: behind the jumps of objects that met no other.

use super::film::Contacts;
use super::path::Jump;
use crate::num::Vec2;

/// Jumps agree with one wall within this distance (m) and cosine.
const SAME_WALL: f64 = 0.15;
const SAME_NORMAL: f64 = 0.9;
/// Radii of unseen objects that are tried (m).
const RADII: [f64; 3] = [0.1, 0.2, 0.4];

/// One wall for each jump, from all jumps that agree with it; those with most agreement first.
pub fn walls(films: &Contacts) -> Vec<Vec<f64>> {
    let radius = films.models.iter().flat_map(|m| &m.bodies).map(|b| b.shape.bounding_radius());
    let radius = radius.fold(f64::INFINITY, f64::min);
    let normal = |j: &Jump| j.change.unit();
    let mut found: Vec<(usize, Vec<f64>)> = films
        .jumps
        .iter()
        .map(|(_, seed)| {
            let agree: Vec<&Jump> = films
                .jumps
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
            (agree.len(), vec![1.0, offset, n.y.atan2(n.x), 0.7])
        })
        .collect();
    found.sort_by_key(|f| std::cmp::Reverse(f.0));
    found.dedup_by(|a, b| (a.1[1] - b.1[1]).abs() < 0.05 && (a.1[2] - b.1[2]).abs() < 0.1);
    found.into_iter().take(3).map(|f| f.1).collect()
}

/// Discs behind the strongest jumps.
pub fn unseen_objects(films: &Contacts) -> Vec<Vec<f64>> {
    let radius = films.models.iter().flat_map(|m| &m.bodies).map(|b| b.shape.bounding_radius());
    let own = radius.fold(f64::INFINITY, f64::min);
    let mut jumps: Vec<&Jump> = films.jumps.iter().map(|(_, j)| j).collect();
    jumps.sort_by(|a, b| b.sigmas.total_cmp(&a.sigmas));
    let mut all = vec![];
    for jump in jumps.into_iter().take(2) {
        for radius in RADII {
            let center = jump.position - jump.change.unit().scaled(own + radius);
            all.push(vec![1.0, center.x, center.y, radius, 0.7]);
        }
    }
    all
}
