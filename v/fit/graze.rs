//! Missed grazes: where a simulation leaves its tracks, a body may have met another that it passes closely there. What is
//! missed has no gradient: the search must begin anew where they touch.

use super::bounce::Left;
use crate::world::{BODY_VALUES, Event, Outline, gap};

/// Frames around that in which the simulation leaves a track in which it may have missed a contact.
const AROUND: usize = 8;
/// A gap that may have been none, and how far outlines overlap then, in deviations of a position.
const CLOSE: f64 = 5.0;
const OVERLAP: f64 = 2.0;

/// Points of the search at which the first body that leaves its track meets what it only passes at this one.
pub(super) fn others(point: &[f64], left: &[Left]) -> Vec<Vec<f64>> {
    let mut found = vec![];
    for &Left { part, ref rollout, frame, body } in left {
        let frames = frame.saturating_sub(AROUND)..frame + AROUND;
        let times = [frames.start, frames.end].map(|f| part.scene.time_of(f));
        let bodies = &part.model.bodies;
        let sigma = part.noise.position;
        let met = |other: usize| {
            let pair = [bodies[body].id, bodies[other].id];
            let between = |e: &&Event| pair.iter().all(|id| e.objects.contains(id));
            let now = |e: &Event| times[0] <= e.time && e.time <= times[1];
            rollout.events.iter().filter(between).any(now)
        };
        // Where the tracks of both are nearest: their gap, and where the simulation has the other from this one.
        let nearest = |other: usize| {
            let at = |frame: usize| {
                let row = rollout.states.get(frame)?;
                let [a, b] = [body, other].map(|k| {
                    let (simulated, measured) = (row.get(k)?.as_ref()?, part.scene.tracks[k].at(frame)?);
                    let place = |position| Outline { position, yaw: simulated.yaw, shape: &bodies[k].shape };
                    Some([measured.position, simulated.position].map(place))
                });
                let ([seen_a, a], [seen_b, b]) = (a?, b?);
                Some((gap(&seen_a, &seen_b).0, gap(&a, &b)))
            };
            frames.clone().filter_map(at).min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let others = (0..bodies.len()).filter(|other| *other != body && !met(*other));
        let nearest = others.filter_map(nearest).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, (gap, normal))) = nearest.filter(|near| near.0 < CLOSE * sigma) else { continue };
        let slot = |value: usize| part.slots.iter().find(|s| s.0 == body * BODY_VALUES.len() + value);
        if let (Some(&(_, x)), Some(&(_, y))) = (slot(0), slot(1)) {
            let nearer = normal.scaled(gap.max(0.0) + OVERLAP * sigma);
            let mut other = point.to_vec();
            other[x] += nearer.x;
            other[y] += nearer.y;
            found.push(other);
        }
    }
    found
}
