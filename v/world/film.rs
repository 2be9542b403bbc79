//! What the camera reports of a simulation: its view and its clock.

use super::model::{BODY_VALUES, Model};
use super::motion::Kinematics;
use super::simulate::{Limits, Rollout, simulate};
use crate::body::View;
use crate::effects::{Hook, Hooks, Scalar};
use crate::num::{Real, Vec2};

/// Simulates as [`simulate`] does and gives what the camera reports at the film's `times` (s): positions and yaws are
/// the seen ones. Without effects of the camera it is the simulation.
pub fn film<T: Scalar>(model: &Model, flat: &[T], times: &[f64], limits: &Limits) -> Rollout<T> {
    let of = |hook| model.active().filter(move |(_, entry, _)| entry.uses(hook));
    let Some(any) = model.bodies.first() else { return simulate(model, flat, times, limits) };
    let clocks: Vec<_> = of(Hook::Clock)
        .map(|(active, entry, first)| (T::hooks(entry), active.values_for(first, flat, any, any)))
        .collect();
    let mut rollout = match clocks[..] {
        [] => simulate(model, flat, times, limits),
        _ => with_clock(model, flat, times, limits, &clocks),
    };
    for (active, entry, first) in of(Hook::Observe) {
        let observe = T::hooks(entry).observe;
        for (i, body) in model.bodies.iter().enumerate() {
            let p = active.values_for(first, flat, body, body);
            for k in rollout.states.iter_mut().filter_map(|row| row[i].as_mut()) {
                let mut view = View { position: k.position, yaw: k.yaw };
                observe(&p, &mut view);
                (k.position, k.yaw) = (view.position, view.yaw);
            }
        }
    }
    rollout
}

/// States at the true times of the frames. A body is in the film from its start on by the film's clock; what the true
/// clock has before that is its straight way there.
fn with_clock<T: Scalar>(
    model: &Model,
    flat: &[T],
    times: &[f64],
    limits: &Limits,
    clocks: &[(&Hooks<T>, Vec<T>)],
) -> Rollout<T> {
    let shift = |t: f64| clocks.iter().fold(T::zero(), |sum, (hooks, p)| sum + (hooks.clock)(p, t));
    let shifts: Vec<T> = times.iter().map(|&t| shift(t)).collect();
    let truth: Vec<f64> = times.iter().zip(&shifts).map(|(t, s)| t + s.value()).collect();
    let mut rollout = simulate(model, flat, &truth, limits);
    for ((row, &time), shift) in rollout.states.iter_mut().zip(times).zip(&shifts) {
        for (i, body) in model.bodies.iter().enumerate() {
            let start = body.start.time;
            let late = match row[i] {
                Some(_) => shift.infinitesimal(),
                None if time >= start => *shift + (time - start),
                None => continue,
            };
            let k = row[i].get_or_insert_with(|| Kinematics::starting(&flat[i * BODY_VALUES.len()..]));
            k.position += k.velocity * late;
            k.yaw += k.spin * late;
            if time < start {
                row[i] = None;
            }
        }
    }
    rollout
}

impl<T: Real> Kinematics<T> {
    /// From the body's part of [`Model::flatten`].
    pub(super) fn starting(p: &[T]) -> Self {
        let vector = |k: usize| Vec2 { x: p[k], y: p[k + 1] };
        Kinematics { position: vector(0), yaw: p[2], velocity: vector(3), spin: p[5], roll: vector(6) }
    }
}
