//! How two objects meet: in a collision, or in a closest approach without one.
//!
//! Two outlines are near each other while the gap between them is smaller than the mean width of both objects: a third object of
//! that width has no room between them. Each time that two objects come near each other and do not touch, the moment of the
//! smallest gap is an approach. Between two frames the relative motion is taken as straight. An approach that is no longer than
//! the noise of the video explains is none.

use crate::num::elementary::acos;
use crate::scene::{Object, Scene};
use crate::world::{Event, EventKind, PlacedShape, State, Trace, gap};
use std::sync::OnceLock;

/// Names of the features of an encounter: relative speed (m/s), its part along the normal (m/s), the angle between both (0 head-on,
/// pi/2 glancing, and passing; rad), the speed of the slower object (m/s), and the smallest gap over the mean width of both objects (0 where
/// they touch). Velocities are those of the last frame before the event.
pub const ENCOUNTER_FEATURES: [&str; 5] =
    ["relative_speed", "normal_speed", "impact_angle", "slower_speed", "relative_gap"];

/// Gap from which on simulated outlines do not touch (m): the precision of a contact.
const CONTACT: f64 = 1e-6;

/// A collision or an approach of two objects with its [`ENCOUNTER_FEATURES`].
#[derive(Debug, Clone, PartialEq)]
pub struct Encounter {
    pub is_collision: bool,
    pub frame: usize,
    /// s.
    pub time: f64,
    /// Indices of the scene's objects, sorted.
    pub objects: Vec<usize>,
    pub features: [f64; ENCOUNTER_FEATURES.len()],
}

/// The encounters of one rollout. Few questions ask for them, so they are computed at the first that does.
#[derive(Debug, Clone, Default)]
pub struct Encounters {
    /// The shortest approach that is one (m).
    least: f64,
    found: OnceLock<Vec<Encounter>>,
}

impl Encounters {
    pub fn new(least: f64) -> Encounters {
        Encounters { least, found: OnceLock::new() }
    }

    /// All of them, by time; `trace` is the simulation of the rollout.
    pub fn of(&self, scene: &Scene, trace: &Trace) -> &[Encounter] {
        self.found.get_or_init(|| encounters(scene, trace, self.least))
    }
}

/// What was computed by now makes no difference.
impl PartialEq for Encounters {
    fn eq(&self, other: &Encounters) -> bool {
        self.least == other.least
    }
}

/// The collisions of two objects and their approaches, by time. `least`: the shortest approach that is one (m).
fn encounters(scene: &Scene, trace: &Trace, least: f64) -> Vec<Encounter> {
    let mut all: Vec<Encounter> =
        trace.events.iter().filter_map(|event| collision(scene, trace, event)).collect();
    for b in 0..scene.objects.len() {
        for a in 0..b {
            let Some(pair) = ObjectPair::of(scene, trace, [a, b]) else { continue };
            all.extend(pair.approaches(least));
        }
    }
    all.sort_by(|x, y| x.time.total_cmp(&y.time));
    all
}

fn collision(scene: &Scene, trace: &Trace, event: &Event) -> Option<Encounter> {
    let (EventKind::Collision, &[a, b], Some(normal)) = (event.kind, &event.objects[..], event.normal) else {
        return None;
    };
    let mut objects = vec![scene.object_index(a)?, scene.object_index(b)?];
    objects.sort_unstable();
    let before = trace.times.partition_point(|t| *t < event.time).checked_sub(1)?;
    let state = |id: u32| {
        let body = trace.ids.iter().position(|i| *i == id)?;
        trace.states.get(before)?.get(body).copied().flatten()
    };
    let states = [state(a)?, state(b)?];
    let relative = states[0].velocity - states[1].velocity;
    let along = relative.dot(normal).abs();
    let angle = acos((along / relative.norm().max(1e-9)).clamp(0.0, 1.0));
    let features = features(states, along, angle, 0.0);
    let (frame, time) = (scene.frame_at(event.time), event.time);
    Some(Encounter { is_collision: true, frame, time, objects, features })
}

fn features(
    [a, b]: [State; 2],
    along: f64,
    angle: f64,
    relative_gap: f64,
) -> [f64; ENCOUNTER_FEATURES.len()] {
    let slower = a.velocity.norm().min(b.velocity.norm());
    [(a.velocity - b.velocity).norm(), along, angle, slower, relative_gap]
}

/// Two objects of a scene in a simulation.
struct ObjectPair<'a> {
    scene: &'a Scene,
    trace: &'a Trace,
    /// Indices of the scene's objects, sorted.
    indices: [usize; 2],
    objects: [&'a Object; 2],
    bodies: [usize; 2],
    /// Mean width (m): the gap below which they are near each other.
    width: f64,
    /// Times of their collisions (s).
    collisions: Vec<f64>,
}

/// The smallest gap between two frames.
#[derive(Clone, Copy)]
struct ClosestMoment {
    /// m.
    gap: f64,
    /// s.
    time: f64,
    states: [State; 2],
}

/// Frames in which two objects are near each other.
struct NearSpan {
    from: f64,
    to: f64,
    /// The gap at its start (m).
    first: f64,
    closest: ClosestMoment,
}

impl<'a> ObjectPair<'a> {
    fn of(scene: &'a Scene, trace: &'a Trace, indices: [usize; 2]) -> Option<ObjectPair<'a>> {
        let objects = [scene.objects.get(indices[0])?, scene.objects.get(indices[1])?];
        let body = |o: &Object| trace.ids.iter().position(|id| *id == o.id);
        let bodies = [body(objects[0])?, body(objects[1])?];
        let width = objects.iter().map(|o| o.shape.inscribed_radius()).sum();
        let of_both = |e: &&Event| {
            e.kind == EventKind::Collision
                && e.objects.len() == 2
                && objects.iter().all(|o| e.objects.contains(&o.id))
        };
        let collisions = trace.events.iter().filter(of_both).map(|e| e.time).collect();
        Some(ObjectPair { scene, trace, indices, objects, bodies, width, collisions })
    }

    fn states(&self, frame: usize) -> Option<[State; 2]> {
        let row = self.trace.states.get(frame)?;
        Some([row.get(self.bodies[0]).copied().flatten()?, row.get(self.bodies[1]).copied().flatten()?])
    }

    fn gap(&self, [a, b]: [State; 2]) -> f64 {
        let placed =
            |s: State, o: &'a Object| PlacedShape { position: s.position, yaw: s.yaw, shape: &o.shape };
        gap(&placed(a, self.objects[0]), &placed(b, self.objects[1])).0
    }

    /// The smallest gap between a frame and the next one; `None` where it is not near, or an object is absent.
    fn closest(&self, frame: usize) -> Option<ClosestMoment> {
        let (start, end) = (self.states(frame)?, self.states(frame + 1)?);
        let apart = |s: [State; 2]| s[1].position - s[0].position;
        let (from, moved) = (apart(start), apart(end) - apart(start));
        let share = (-from.dot(moved) / moved.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let reach: f64 = self.objects.iter().map(|o| o.shape.bounding_radius()).sum();
        if (from + moved * share).norm() > reach + self.width {
            return None;
        }
        let between = |k: usize| State {
            position: start[k].position + (end[k].position - start[k].position) * share,
            yaw: start[k].yaw + (end[k].yaw - start[k].yaw) * share,
            ..start[k]
        };
        let states = [between(0), between(1)];
        let gap = self.gap(states);
        let (from, to) = (self.trace.times.get(frame)?, self.trace.times.get(frame + 1)?);
        let moment = ClosestMoment { gap, time: from + (to - from) * share, states };
        (gap < self.width).then_some(moment)
    }

    fn approaches(&self, least: f64) -> Vec<Encounter> {
        let (mut found, mut open) = (vec![], None::<NearSpan>);
        for frame in 0..self.trace.times.len() {
            let to = self.trace.times.get(frame + 1).copied().unwrap_or(f64::INFINITY);
            match (self.closest(frame), &mut open) {
                (Some(moment), Some(span)) => {
                    span.to = to;
                    if moment.gap < span.closest.gap {
                        span.closest = moment;
                    }
                }
                (Some(closest), None) => {
                    let from = self.trace.times.get(frame).copied().unwrap_or(0.0);
                    let first = self.states(frame).map_or(closest.gap, |s| self.gap(s));
                    open = Some(NearSpan { from, to, first, closest });
                }
                (None, _) => found.extend(open.take().and_then(|span| self.approach(&span, least))),
            }
        }
        found
    }

    /// The approach of a span without contact, if both objects can be seen.
    fn approach(&self, span: &NearSpan, least: f64) -> Option<Encounter> {
        let ClosestMoment { gap, time, states } = span.closest;
        let touches = self.collisions.iter().any(|t| (span.from..=span.to).contains(t)) || gap < CONTACT;
        let camera = self.scene.camera;
        let seen =
            |(s, o): (&State, &&Object)| camera.is_none_or(|c| c.sees(s.position, o.shape.centre_height()));
        if touches || span.first - gap <= least || !states.iter().zip(&self.objects).all(seen) {
            return None;
        }
        let (frame, objects) = (self.scene.frame_at(time), self.indices.to_vec());
        // Where a gap is smallest, it does not change: the relative motion is across.
        let across = std::f64::consts::FRAC_PI_2;
        let features = features(states, 0.0, across, gap / self.width);
        Some(Encounter { is_collision: false, frame, time, objects, features })
    }
}
