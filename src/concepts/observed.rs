//! Events of a video without a fit: entrances and exits from the tracks, collisions from sudden changes of velocity near another object.

use super::features::velocity;
use crate::num::Vec2;
use crate::reason::{Encounters, MOVING_SPEED, RolloutEvents, Scenario, SceneEvent, SceneEventKind};
use crate::scene::{Scene, Track};

/// Frames between the velocities before and after a collision: twice the window of a velocity and one.
const SPAN: usize = 4;
/// Largest gap between the circles around two objects that touch (m), at 25 frames/s and a few m/s.
const GAP: f64 = 0.12;
/// Least change of a velocity in a collision (m/s): four deviations of a measured one.
const CHANGE: f64 = 0.08;

/// The observed events as the only rollout of the factual scenario.
pub fn observed_scenario(scene: &Scene) -> Scenario {
    let mut events = vec![];
    for (object, track) in scene.tracks.iter().enumerate() {
        let mut add = |kind, frame| {
            events.push(SceneEvent { kind, frame, time: scene.time_of(frame), objects: vec![object] })
        };
        if let Some(first) = track.samples.first().filter(|s| s.frame > 0) {
            add(SceneEventKind::In, first.frame);
        }
        if let Some(last) = track.samples.last().filter(|s| s.frame + 1 < scene.times.len()) {
            add(SceneEventKind::Out, last.frame + 1);
        }
        for other in 0..object {
            if let Some(frame) = collision(scene, other, object) {
                let objects = vec![other, object];
                let (kind, time) = (SceneEventKind::Collision, scene.time_of(frame));
                events.push(SceneEvent { kind, frame, time, objects });
            }
        }
    }
    events.sort_by_key(|e| e.frame);
    let moving = scene.tracks.iter().map(|t| moving(scene, t)).collect();
    let rollouts = vec![RolloutEvents { events, moving, encounters: Encounters::default() }];
    Scenario { interventions: vec![], frames: scene.times.len(), rollouts }
}

fn moving(scene: &Scene, track: &Track) -> Vec<Option<bool>> {
    let mut moving = vec![None; scene.times.len()];
    for (i, sample) in track.samples.iter().enumerate() {
        if let (Some(slot), Some(v)) = (moving.get_mut(sample.frame), velocity(scene, track, i)) {
            *slot = Some(v.norm() > 2.0 * MOVING_SPEED);
        }
    }
    moving
}

/// The frame of the closest approach of two objects that touch and change their velocities there.
fn collision(scene: &Scene, a: usize, b: usize) -> Option<usize> {
    let radius = |k: usize| scene.objects.get(k).map_or(0.0, |o| o.shape.bounding_radius());
    let (first, second) = (scene.tracks.get(a)?, scene.tracks.get(b)?);
    let reach = radius(a) + radius(b) + GAP;
    let near = |s: &crate::scene::Sample| {
        let distance = (second.at(s.frame)?.position - s.position).norm();
        (distance < reach).then_some((distance, s.frame))
    };
    let near: Vec<(f64, usize)> = first.samples.iter().filter_map(near).collect();
    let changes = |frame: &usize| change(scene, first, *frame).max(change(scene, second, *frame)) > CHANGE;
    let touching = near.iter().filter(|(_, frame)| changes(frame));
    touching.min_by(|x, y| x.0.total_cmp(&y.0)).map(|(_, frame)| *frame)
}

/// Change of an object's velocity across a frame (m/s); 0 near the ends of its track.
fn change(scene: &Scene, track: &Track, frame: usize) -> f64 {
    let at = track.samples.partition_point(|s| s.frame < frame);
    let mean = |i: Option<usize>| -> Option<Vec2> {
        velocity(scene, track, i.filter(|i| *i < track.samples.len())?)
    };
    match (mean(at.checked_sub(SPAN)), mean(Some(at + SPAN))) {
        (Some(before), Some(after)) => (after - before).norm(),
        _ => 0.0,
    }
}
