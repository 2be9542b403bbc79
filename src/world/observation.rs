//! What the camera reports of a simulation: its view and its clock.

use super::model::{BODY_VALUES, Model};
use super::motion::Kinematics;
use super::simulate::{Rollout, SimulationLimits, simulate};
use super::trace::Trace;
use crate::body::Observation;
use crate::effects::{Hook, Hooks, ObserveFn, Scalar};
use crate::num::{Real, Vec2, vec2};

/// Newton's steps by which a view is true_position, and the step of their differences (m).
const UNDOING: usize = 16;
const STEP: f64 = 1e-5;
/// A place that is seen so near to where it should be is found (m).
const NEAR: f64 = 1e-9;

/// Simulates as [`simulate`] does and gives what the camera reports at the film's `times` (s): positions and yaws are
/// the seen ones. Without effects of the camera it is the simulation.
pub fn simulate_observed<T: Scalar>(
    model: &Model,
    flat: &[T],
    times: &[f64],
    limits: &SimulationLimits,
) -> Rollout<T> {
    let of = |hook| model.active().filter(move |(_, entry, _)| entry.uses(hook));
    let Some(any) = model.bodies.first() else { return simulate(model, flat, times, limits) };
    let clocks: Vec<_> = of(Hook::Clock)
        .map(|(active, entry, first)| (T::hooks(entry), active.values_for(first, flat, any, any)))
        .collect();
    let mut rollout = match clocks[..] {
        [] => simulate(model, flat, times, limits),
        _ => with_clock(model, flat, times, limits, &clocks),
    };
    let views = ObservationModel::new(model, flat);
    if !views.are_true() {
        for (i, k) in rollout.states.iter_mut().flat_map(|row| row.iter_mut().enumerate()) {
            let Some(k) = k else { continue };
            let seen = views.seen(i, k.position, k.yaw);
            (k.position, k.yaw) = (seen.position, seen.yaw);
        }
    }
    rollout
}

/// How the camera of a model sees each body.
pub struct ObservationModel<T = f64> {
    /// By body; most have none.
    of: Vec<Vec<(ObserveFn<T>, Vec<T>)>>,
}

impl<T: Scalar> ObservationModel<T> {
    /// Under the numbers `flat` ([`Model::flatten`]).
    pub fn new(model: &Model, flat: &[T]) -> Self {
        let mut of = vec![vec![]; model.bodies.len()];
        for (active, entry, first) in model.active().filter(|(_, entry, _)| entry.uses(Hook::Observe)) {
            for (body, views) in model.bodies.iter().zip(&mut of) {
                views.push((T::hooks(entry).observe, active.values_for(first, flat, body, body)));
            }
        }
        ObservationModel { of }
    }

    /// Whether bodies are seen where they are.
    fn are_true(&self) -> bool {
        self.of.iter().all(|of| of.is_empty())
    }

    /// What the camera reports of body `i` at this place (m) with this yaw (rad).
    fn seen(&self, i: usize, position: Vec2<T>, yaw: T) -> Observation<T> {
        let mut view = Observation { position, yaw };
        self.of[i].iter().for_each(|(observe, p)| observe(p, &mut view));
        view
    }
}

impl ObservationModel {
    /// Where body `i` is when the camera reports it at `seen` (m) with this yaw (rad).
    pub fn true_position(&self, i: usize, seen: Vec2, yaw: f64) -> Vec2 {
        let mut place = seen;
        if self.of[i].is_empty() {
            return place;
        }
        for _ in 0..UNDOING {
            let at = |d: Vec2| self.seen(i, place + d, yaw).position;
            let here = at(Vec2::zero());
            let [along, across] =
                [vec2(STEP, 0.0), vec2(0.0, STEP)].map(|d| (at(d) - here).scaled(1.0 / STEP));
            let (off, turned) = (seen - here, along.cross(across));
            if turned == 0.0 || off.norm() < NEAR {
                break;
            }
            place += vec2(off.cross(across), along.cross(off)).scaled(1.0 / turned);
        }
        place
    }

    /// Whether body `i` is seen in `other` as here; both are of one model.
    pub(super) fn same(&self, other: &Self, i: usize) -> bool {
        self.of[i].iter().zip(&other.of[i]).all(|(a, b)| a.1 == b.1)
    }
}

impl Trace {
    /// With places and yaws as the camera of the model reports them, to be compared with what it did.
    pub fn as_observed(mut self, model: &Model) -> Self {
        let views = ObservationModel::new(model, &model.flatten());
        if views.are_true() {
            return self;
        }
        for (i, state) in self.states.iter_mut().flat_map(|row| row.iter_mut().enumerate()) {
            let Some(state) = state else { continue };
            let seen = views.seen(i, state.position, state.yaw);
            (state.position, state.yaw) = (seen.position, seen.yaw);
        }
        self
    }
}

/// States at the true times of the frames. A body is in the film from its start on by the film's clock; what the true
/// clock has before that is its straight way there.
fn with_clock<T: Scalar>(
    model: &Model,
    flat: &[T],
    times: &[f64],
    limits: &SimulationLimits,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::trace;
    use proptest::prelude::*;

    #[test]
    fn a_trace_as_seen_is_the_film() {
        let bodies = vec![body(0, Shape::Disc { radius: 0.2 }, vec2(1.0, 0.4), vec2(0.5, -0.1))];
        let model = model(bodies, &[("wrong_scale", &[0.06]), ("off_centre_marker", &[0.03, 0.01])]);
        let seen = trace(&model, &seconds(2)).as_observed(&model).states;
        let filmed =
            simulate_observed::<f64>(&model, &model.flatten(), &seconds(2), &SimulationLimits::default())
                .states;
        for (a, b) in seen.iter().flatten().zip(filmed.iter().flatten()) {
            let places = [a.map(|a| (a.position, a.yaw)), b.map(|b| (b.position, b.yaw))];
            assert!(places[0].is_some() && places[0] == places[1], "{places:?}");
        }
    }

    proptest! {
        #[test]
        fn a_view_is_undone(
            x in -3.0..3.0f64, y in -3.0..3.0f64, yaw in -3.0..3.0f64, scale in -0.4..0.9f64, tilt in -0.08..0.08f64, arm in -0.1..0.1f64,
        ) {
            let laws: &[(&str, &[f64])] =
                &[("off_centre_marker", &[arm, 0.05]), ("tilted_camera", &[tilt, 0.02]), ("wrong_scale", &[scale])];
            let model = model(vec![body(0, Shape::Square { half_side: 0.2 }, vec2(0.0, 0.0), vec2(0.0, 0.0))], laws);
            let views = ObservationModel::new(&model, &model.flatten());
            let place = vec2(x, y);
            let seen = views.seen(0, place, yaw).position;
            prop_assert!((seen - place).norm() > 1e-3);
            prop_assert!((views.true_position(0, seen, yaw) - place).norm() < 1e-6);
        }
    }
}
