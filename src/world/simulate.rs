//! Simulation. (Stub: free flight at constant velocity until the real stepper lands.)

use super::model::{BODY_VALUES, Model};
use super::trace::{Ending, Event, State, Trace};
use crate::effects::Scalar;
use crate::num::{Vec2, vec2};

/// A limit on the work of one simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Events (impacts, stops) in one simulation.
    pub events: usize,
}

/// States in the scalar that was simulated: `[frame][body]`, `None` before the body enters.
#[derive(Debug, Clone)]
pub struct Rollout<T> {
    pub states: Vec<Vec<Option<Kinematics<T>>>>,
    pub events: Vec<Event>,
    pub ending: Ending,
}

/// Position and motion of one body.
#[derive(Debug, Clone, Copy)]
pub struct Kinematics<T> {
    pub position: Vec2<T>,
    pub yaw: T,
    pub velocity: Vec2<T>,
    pub spin: T,
    pub roll: Vec2<T>,
}

/// Simulates with the numbers `flat` (laid out as [`Model::flatten`]) and gives the states at `times` (s, increasing).
pub fn simulate<T: Scalar>(model: &Model, flat: &[T], times: &[f64], _limits: &Limits) -> Rollout<T> {
    let states = times
        .iter()
        .map(|&t| {
            (0..model.bodies.len())
                .map(|i| {
                    let start = model.bodies[i].start.time;
                    let p = &flat[i * BODY_VALUES.len()..];
                    (t >= start - 1e-9).then(|| Kinematics {
                        position: vec2(p[0] + p[3] * (t - start), p[1] + p[4] * (t - start)),
                        yaw: p[2],
                        velocity: vec2(p[3], p[4]),
                        spin: p[5],
                        roll: vec2(p[6], p[7]),
                    })
                })
                .collect()
        })
        .collect();
    Rollout { states, events: vec![], ending: Ending::Completed }
}

/// Simulates the model as it is. Deterministic: the same input gives the same bits.
pub fn trace(model: &Model, times: &[f64]) -> Trace {
    let rollout = simulate::<f64>(model, &model.flatten(), times, &Limits { events: 100_000 });
    let states: Vec<Vec<Option<State>>> = rollout
        .states
        .iter()
        .map(|row| {
            row.iter()
                .map(|s| {
                    s.map(|s| State {
                        position: s.position,
                        yaw: s.yaw,
                        velocity: s.velocity,
                        spin: s.spin,
                        roll: s.roll,
                    })
                })
                .collect()
        })
        .collect();
    Trace {
        ids: model.bodies.iter().map(|b| b.id).collect(),
        times: times.to_vec(),
        energy: vec![0.0; states.len()],
        states,
        events: rollout.events,
        ending: rollout.ending,
    }
}
