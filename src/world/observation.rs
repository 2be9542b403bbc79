//! What the camera reports of a simulation: observed positions and yaws, at the times of its clock.

use crate::body::Observation;
use crate::effects::{Hook, Hooks, ObserveFn, Scalar};
use crate::num::{Vec2, vec2};
use crate::world::model::{BODY_VALUES, Model};
use crate::world::motion::kinematics::Kinematics;
use crate::world::simulate::{Rollout, SimulationLimits, simulate};
use crate::world::trace::Trace;

/// Largest number of Newton steps that invert an observation, and the step of their differences (m).
const MAX_NEWTON: usize = 16;
const STEP: f64 = 1e-5;
/// An observation is inverted up to this error (m).
const TOLERANCE: f64 = 1e-9;

/// Simulates as [`simulate`] does, and returns what the camera reports at the video's `times` (s): observed positions and yaws.
/// Without camera effects it equals the simulation.
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
    let observation = ObservationModel::new(model, flat);
    if !observation.is_identity() {
        for (i, k) in rollout.states.iter_mut().flat_map(|row| row.iter_mut().enumerate()) {
            let Some(k) = k else { continue };
            let observed = observation.observe(i, k.position, k.yaw);
            (k.position, k.yaw) = (observed.position, observed.yaw);
        }
    }
    rollout
}

/// How the camera of a model observes each body.
pub struct ObservationModel<T = f64> {
    /// By body; most have none.
    hooks: Vec<Vec<(ObserveFn<T>, Vec<T>)>>,
}

impl<T: Scalar> ObservationModel<T> {
    /// Under the numbers `flat` ([`Model::flatten`]).
    pub fn new(model: &Model, flat: &[T]) -> Self {
        let mut hooks = vec![vec![]; model.bodies.len()];
        for (active, entry, first) in model.active().filter(|(_, entry, _)| entry.uses(Hook::Observe)) {
            for (body, hooks) in model.bodies.iter().zip(&mut hooks) {
                hooks.push((T::hooks(entry).observe, active.values_for(first, flat, body, body)));
            }
        }
        ObservationModel { hooks }
    }

    /// Whether bodies are observed as they are.
    fn is_identity(&self) -> bool {
        self.hooks.iter().all(|hooks| hooks.is_empty())
    }

    /// What the camera reports of body `i` at this position (m) with this yaw (rad).
    fn observe(&self, i: usize, position: Vec2<T>, yaw: T) -> Observation<T> {
        let mut observation = Observation { position, yaw };
        self.hooks[i].iter().for_each(|(observe, p)| observe(p, &mut observation));
        observation
    }
}

impl ObservationModel {
    /// Position of body `i` (m) that the camera reports as `observed` (m), at this yaw (rad), by Newton's method.
    pub fn true_position(&self, i: usize, observed: Vec2, yaw: f64) -> Vec2 {
        let mut position = observed;
        if self.hooks[i].is_empty() {
            return position;
        }
        for _ in 0..MAX_NEWTON {
            let at = |d: Vec2| self.observe(i, position + d, yaw).position;
            let here = at(Vec2::zero());
            let [by_x, by_y] = [vec2(STEP, 0.0), vec2(0.0, STEP)].map(|d| (at(d) - here).scaled(1.0 / STEP));
            let (error, determinant) = (observed - here, by_x.cross(by_y));
            if determinant == 0.0 || error.norm() < TOLERANCE {
                break;
            }
            position += vec2(error.cross(by_y), by_x.cross(error)).scaled(1.0 / determinant);
        }
        position
    }

    /// How much larger the camera shows a small step of body `i` than it is, at this position (m) and yaw (rad).
    pub fn magnification(&self, i: usize, position: Vec2, yaw: f64) -> f64 {
        if self.hooks[i].is_empty() {
            return 1.0;
        }
        let at = |d: Vec2| self.observe(i, position + d, yaw).position;
        let here = at(Vec2::zero());
        let [by_x, by_y] = [vec2(STEP, 0.0), vec2(0.0, STEP)].map(|d| (at(d) - here).scaled(1.0 / STEP));
        by_x.cross(by_y).abs().sqrt()
    }

    /// Whether body `i` is observed in the same way in `other`, which is of the same model.
    pub(in crate::world) fn same(&self, other: &Self, i: usize) -> bool {
        self.hooks[i].iter().zip(&other.hooks[i]).all(|(a, b)| a.1 == b.1)
    }
}

impl Trace {
    /// With positions and yaws as the camera of the model reports them, for comparison with observations.
    pub fn as_observed(mut self, model: &Model) -> Self {
        let observation = ObservationModel::new(model, &model.flatten());
        if observation.is_identity() {
            return self;
        }
        for (i, state) in self.states.iter_mut().flat_map(|row| row.iter_mut().enumerate()) {
            let Some(state) = state else { continue };
            let observed = observation.observe(i, state.position, state.yaw);
            (state.position, state.yaw) = (observed.position, observed.yaw);
        }
        self
    }
}

/// States at the true times of the frames. A body is present from its start on by the video's clock. If its true start is later,
/// its states before are extrapolated at constant velocity.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::trace;
    use proptest::prelude::*;

    /// A step away from the middle of a lens grows by 1 + k r^2 across the radius and by 1 + 3 k r^2 along it.
    #[test]
    fn a_lens_magnifies_more_along_the_radius_than_across() {
        let bodies = vec![body(0, Shape::Disc { radius: 0.2 }, vec2(0.0, 0.0), vec2(0.0, 0.0))];
        let model = model(bodies, &[("lens_distortion", &[0.1, 0.0, 0.0])]);
        let camera = ObservationModel::new(&model, &model.flatten());
        let expected = ((1.0 + 0.1 * 0.25) * (1.0 + 0.3 * 0.25f64)).sqrt();
        let found = camera.magnification(0, vec2(0.3, 0.4), 0.0);
        assert!((found - expected).abs() < 1e-4, "{found} {expected}");
    }

    #[test]
    fn an_observed_trace_equals_the_observed_simulation() {
        let bodies = vec![body(0, Shape::Disc { radius: 0.2 }, vec2(1.0, 0.4), vec2(0.5, -0.1))];
        let model = model(bodies, &[("wrong_scale", &[0.06]), ("off_centre_marker", &[0.03, 0.01])]);
        let seen = trace(&model, &seconds(2)).as_observed(&model).states;
        let observed =
            simulate_observed::<f64>(&model, &model.flatten(), &seconds(2), &SimulationLimits::default())
                .states;
        for (a, b) in seen.iter().flatten().zip(observed.iter().flatten()) {
            let places = [a.map(|a| (a.position, a.yaw)), b.map(|b| (b.position, b.yaw))];
            assert!(places[0].is_some() && places[0] == places[1], "{places:?}");
        }
    }

    proptest! {
        #[test]
        fn an_observation_is_inverted(
            x in -3.0..3.0f64, y in -3.0..3.0f64, yaw in -3.0..3.0f64, scale in -0.4..0.9f64, tilt in -0.08..0.08f64, arm in -0.1..0.1f64,
        ) {
            let laws: &[(&str, &[f64])] =
                &[("off_centre_marker", &[arm, 0.05]), ("tilted_camera", &[tilt, 0.02]), ("wrong_scale", &[scale])];
            let model = model(vec![body(0, Shape::Square { half_side: 0.2 }, vec2(0.0, 0.0), vec2(0.0, 0.0))], laws);
            let observation = ObservationModel::new(&model, &model.flatten());
            let place = vec2(x, y);
            let observed = observation.observe(0, place, yaw).position;
            prop_assert!((observed - place).norm() > 1e-3);
            prop_assert!((observation.true_position(0, observed, yaw) - place).norm() < 1e-6);
        }
    }
}
