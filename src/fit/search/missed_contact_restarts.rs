//! Restarts from missed contacts: where a simulation leaves its tracks, a body may have met another that it passes closely in
//! the simulation. A missed contact has no gradient, so the search restarts from a point where the two touch.

use super::divergence::Divergence;
use crate::world::{BODY_VALUES, Event, PlacedShape, gap};

/// Frames around the divergence in which the contact may have been missed.
const AROUND: usize = 8;
/// A measured gap that may have been a contact, and how far the outlines overlap after the restart, in standard deviations of
/// a position.
const CLOSE: f64 = 5.0;
const OVERLAP: f64 = 2.0;

/// Points of the search at which the first body that leaves its track meets the body that it only passes at this one.
pub(in super::super) fn points(point: &[f64], divergences: &[Divergence]) -> Vec<Vec<f64>> {
    divergences.iter().filter_map(|divergence| touching_point(point, divergence)).collect()
}

fn touching_point(point: &[f64], divergence: &Divergence) -> Option<Vec<f64>> {
    let &Divergence { scene, ref rollout, frame, body } = divergence;
    let frames = frame.saturating_sub(AROUND)..frame + AROUND;
    let times = [frames.start, frames.end].map(|f| scene.scene.time_of(f));
    let bodies = &scene.model.bodies;
    let sigma = scene.noise.position;
    let met = |other: usize| {
        let pair = [bodies[body].id, bodies[other].id];
        let between = |e: &&Event| pair.iter().all(|id| e.objects.contains(id));
        let now = |e: &Event| times[0] <= e.time && e.time <= times[1];
        rollout.events.iter().filter(between).any(now)
    };
    // In the frame in which the two tracks are nearest: their gap, and the simulated gap with its direction.
    let nearest = |other: usize| {
        let at = |frame: usize| {
            let row = rollout.states.get(frame)?;
            let [a, b] = [body, other].map(|k| {
                let (simulated, measured) = (row.get(k)?.as_ref()?, scene.scene.tracks[k].at(frame)?);
                let outline =
                    |position| PlacedShape { position, yaw: simulated.yaw, shape: &bodies[k].shape };
                Some([measured.position, simulated.position].map(outline))
            });
            let ([measured_a, a], [measured_b, b]) = (a?, b?);
            Some((gap(&measured_a, &measured_b).0, gap(&a, &b)))
        };
        frames.clone().filter_map(at).min_by(|a, b| a.0.total_cmp(&b.0))
    };
    let others = (0..bodies.len()).filter(|other| *other != body && !met(*other));
    let nearest = others.filter_map(nearest).min_by(|a, b| a.0.total_cmp(&b.0));
    let (_, (gap, normal)) = nearest.filter(|near| near.0 < CLOSE * sigma)?;
    let coordinate = |value: usize| scene.parameter_at(body * BODY_VALUES.len() + value);
    let (x, y) = (coordinate(0)?, coordinate(1)?);
    let shift = normal.scaled(gap.max(0.0) + OVERLAP * sigma);
    let mut other = point.to_vec();
    other[x] += shift.x;
    other[y] += shift.y;
    Some(other)
}
