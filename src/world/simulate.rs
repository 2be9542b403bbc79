//! Simulation of a model: steps between known times, each cut at every impact, stop and start of rolling.

use crate::effects::Scalar;
use crate::num::Vec2;
use crate::world::model::{BodySpec, Model, StateCorrection};
use crate::world::motion::ground_friction::{Mode, ModeChange, REST_SPEED};
use crate::world::motion::kinematics::{IslandVec, Kinematics};
use crate::world::simulation::event_queue::NextEvent;
use crate::world::simulation::impact_propagation::{CONTACT_SPEED, IMPACT_SPEED};
use crate::world::simulation::state::{MAX_STEP, Simulation};
use crate::world::trace::{Ending, Event, State, Trace};
use crate::world::unknown_impulse::{ImpulseValues, UnknownImpulse};

/// Longest step where a force that changes with time may wake a body at rest (s).
const WAKING_STEP: f64 = 0.02;

/// A limit on the work of one simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulationLimits {
    /// Events (impacts, stops) in one simulation.
    pub events: usize,
}

impl Default for SimulationLimits {
    fn default() -> Self {
        SimulationLimits { events: 20_000 }
    }
}

/// States in the scalar that was simulated: `[frame][body]`, `None` before the body enters.
#[derive(Debug, Clone)]
pub struct Rollout<T> {
    pub states: Vec<Vec<Option<Kinematics<T>>>>,
    pub events: Vec<Event>,
    pub ending: Ending,
    /// Number of events processed, those inside lasting contacts included.
    pub steps: usize,
}

/// Simulates with the numbers `flat` (laid out as [`Model::flatten`]) and returns the states at `times` (s, increasing).
/// Deterministic; a run in [`Jet`](crate::num::Jet) has the events of the run in `f64`.
pub fn simulate<T: Scalar>(
    model: &Model,
    flat: &[T],
    times: &[f64],
    limits: &SimulationLimits,
) -> Rollout<T> {
    let sim = Simulation::new(model, flat, times);
    let mut run = Run { sim, budget: limits.events, ending: Ending::Completed };
    let cuts = cuts(model);
    let end = times.last().copied().unwrap_or(0.0);
    let mut now = cuts.first().copied().unwrap_or(0.0);
    for cut in cuts.into_iter().filter(|&c| c <= end) {
        run.advance(now, cut);
        now = cut;
        run.enter(cut);
        model.corrections.iter().filter(|c| c.time == cut).for_each(|c| run.correct(c));
        for (which, impulse) in model.impulses.iter().enumerate().filter(|(_, i)| i.time == cut) {
            run.push(impulse, ImpulseValues::of(flat, which, model.impulses.len()));
        }
    }
    run.advance(now, end);
    let (states, events) = run.sim.recorder.finish();
    Rollout { states, events, ending: run.ending, steps: limits.events - run.budget }
}

/// Simulates the model as it is. Deterministic: the same input gives the same bits.
pub fn trace(model: &Model, times: &[f64]) -> Trace {
    let rollout = simulate::<f64>(model, &model.flatten(), times, &SimulationLimits::default());
    let energy = |row: &Vec<Option<Kinematics<f64>>>| -> f64 {
        let each = row.iter().zip(&model.bodies);
        each.filter_map(|(k, b)| k.as_ref().map(|k| kinetic_energy(k, b))).sum()
    };
    let state = |k: Kinematics<f64>| State {
        position: k.position,
        yaw: k.yaw,
        velocity: k.velocity,
        spin: k.spin,
        roll: k.roll,
    };
    Trace {
        ids: model.bodies.iter().map(|b| b.id).collect(),
        times: times.to_vec(),
        energy: rollout.states.iter().map(energy).collect(),
        states: rollout.states.iter().map(|row| row.iter().map(|k| k.map(state)).collect()).collect(),
        events: rollout.events,
        ending: rollout.ending,
    }
}

/// Kinetic energy of one body (J).
fn kinetic_energy(k: &Kinematics<f64>, body: &BodySpec) -> f64 {
    let turn = body.shape.unit_inertia() * (k.spin * k.spin + k.roll.norm_squared());
    0.5 * body.mass * (k.velocity.norm_squared() + turn)
}

/// Times at which bodies enter, are corrected or pushed by something unseen (s), increasing. What is before all bodies is left out.
fn cuts(model: &Model) -> Vec<f64> {
    let starts = model.bodies.iter().map(|b| b.start.time);
    let first = starts.clone().fold(f64::INFINITY, f64::min);
    let pushes = model.impulses.iter().map(|i| i.time);
    let mut cuts: Vec<f64> = starts.chain(model.corrections.iter().map(|a| a.time)).chain(pushes).collect();
    cuts.retain(|time| *time >= first);
    cuts.sort_by(f64::total_cmp);
    cuts.dedup();
    cuts
}

/// Equal steps, none longer than `longest`, each as start and end (s).
fn steps(from: f64, to: f64, longest: f64) -> impl Iterator<Item = (f64, f64)> {
    let count = ((to - from) / longest - 1e-9).ceil().max(1.0) as usize;
    let at = move |k: usize| if k == count { to } else { from + (to - from) * k as f64 / count as f64 };
    (0..count).map(move |k| (at(k), at(k + 1)))
}

/// A simulation with its remaining budget of events.
struct Run<'m, T: Scalar> {
    sim: Simulation<'m, T>,
    budget: usize,
    ending: Ending,
}

impl<T: Scalar> Run<'_, T> {
    /// Bodies that start at `time` (s) enter. One that friction holds has no velocity, and no derivative by it.
    fn enter(&mut self, time: f64) {
        let sim = &mut self.sim;
        for (i, spec) in sim.model.bodies.iter().enumerate() {
            if !sim.bodies[i].is_absent() || spec.start.time > time {
                continue;
            }
            let (k, at) = (*sim.bodies[i].state(), T::constant(time));
            if k.is_still() && sim.dynamics.friction_holds(i, &sim.dynamics.wrench(i, &k, at)) {
                sim.bodies[i].come_to_rest();
            } else {
                sim.bodies[i].set_mode(if spec.start.rolling { Mode::Roll } else { Mode::Slide });
            }
            sim.bodies[i].set_time(at);
            sim.recorder.enter(i, time);
            let start = sim.bodies[i].segment_start(i);
            sim.recorder.record(&start, &k, at);
        }
    }

    /// Applies a correction. A body in contact with another is not moved, and a body at rest stays at rest.
    fn correct(&mut self, correction: &StateCorrection) {
        let sim = &mut self.sim;
        let Some(i) = sim.model.body_index(correction.id) else { return };
        let touches = sim.contacts.any_of(i) || sim.bonds.cluster(i).is_some();
        if touches || sim.bodies[i].is_absent() {
            return;
        }
        let mut state = *sim.bodies[i].state();
        state.position += Vec2::constant(correction.position);
        state.yaw += T::constant(correction.yaw);
        if sim.bodies[i].mode() != Mode::Rest {
            let velocity = Vec2::constant(correction.velocity);
            state.velocity += velocity;
            state.spin += T::constant(correction.spin);
            if sim.model.bodies[i].shape.is_ball() {
                state.roll += velocity.perp().scaled(1.0 / sim.dynamics.shapes[i].bounding_radius());
            }
        }
        sim.bodies[i].set_state(state);
    }

    /// Something unseen pushes a body: its velocity and rate of turn change at once. A ball then slides until it rolls.
    fn push(&mut self, impulse: &UnknownImpulse, by: ImpulseValues<T>) {
        let sim = &mut self.sim;
        let Some(i) = sim.model.body_index(impulse.id).filter(|i| !sim.bodies[*i].is_absent()) else {
            return;
        };
        let mut after = sim.collision_body(i).kinematics;
        after.velocity += by.velocity;
        after.spin += by.spin;
        // Where it acts later, the way and the turn of the time until then are those of before.
        after.position -= by.velocity * by.delay;
        after.yaw -= by.spin * by.delay;
        sim.set_motion(i, after, Some(Mode::Slide));
        let single = sim.bonds.cluster(i).is_none();
        let held = |sim: &Simulation<T>| {
            let k = *sim.bodies[i].state();
            k.is_still()
                && sim.dynamics.friction_holds(i, &sim.dynamics.wrench(i, &k, T::constant(impulse.time)))
        };
        if single && held(sim) {
            sim.bodies[i].come_to_rest();
        }
        if sim.contacts.any_of(i) {
            sim.find_islands();
            let island: IslandVec<usize> = sim.islands.of(i).into();
            sim.propagate_impulses(impulse.time, &island, IMPACT_SPEED);
        }
    }

    /// Moves everything from `now` to `end` (s).
    fn advance(&mut self, now: f64, end: f64) {
        if end <= now {
            return;
        }
        for (now, end) in steps(now, end, MAX_STEP) {
            let rests = self.sim.bodies.iter().any(|b| b.mode() == Mode::Rest);
            let time_scale = self.sim.dynamics.time_scale;
            let longest =
                if rests && time_scale.is_finite() { time_scale.min(WAKING_STEP) } else { time_scale };
            steps(now, end, longest).for_each(|(now, end)| self.step(now, end));
        }
    }

    fn step(&mut self, start: f64, end: f64) {
        self.sim.begin_step(start, end);
        if self.ending != Ending::Completed {
            return;
        }
        self.sim.find_islands();
        let all: IslandVec<usize> = (0..self.sim.bodies.len()).collect();
        self.sim.predict_all(&all);
        self.sim.schedule_all();
        while let Some((time, next)) = self.sim.queue.next(self.sim.step_end) {
            if self.budget == 0 {
                self.ending = Ending::EventLimit;
                return;
            }
            self.budget -= 1;
            if self.sim.is_undefined() {
                break;
            }
            match next {
                NextEvent::ModeChange(i) => self.change_mode(i),
                NextEvent::Impact(a, b) => self.sim.collide(time, a, b),
                NextEvent::DelayedImpulse(which) => self.sim.apply_delayed_impulse(which),
            }
        }
        if self.sim.is_undefined() {
            self.ending = Ending::FormulaUndefined;
            return;
        }
        for i in 0..self.sim.bodies.len() {
            self.arrive(i);
        }
    }

    /// Moves body `i` to the end of its segment.
    fn arrive(&mut self, i: usize) {
        let body = &mut self.sim.bodies[i];
        if !body.is_absent() {
            self.sim.recorder.record(&body.segment_start(i), body.end(), body.end_time());
        }
        body.arrive();
    }

    /// Friction stops a body, lets a ball roll, or ends its spin.
    fn change_mode(&mut self, i: usize) {
        let island: IslandVec<usize> = self.sim.islands.of(i).into();
        for &j in &island {
            self.arrive(j);
        }
        let sim = &mut self.sim;
        let time = sim.bodies[i].since();
        let k = *sim.bodies[i].state();
        let ball = sim.dynamics.shapes[i].is_ball() && sim.bonds.cluster(i).is_none();
        let radius = sim.dynamics.shapes[i].bounding_radius();
        match sim.bodies[i].take_change() {
            Some(ModeChange::Stop) => {
                let speed =
                    k.velocity.value().norm() + if ball { 0.0 } else { k.spin.value().abs() * radius };
                let states: IslandVec<Kinematics<T>> =
                    island.iter().map(|&j| *sim.bodies[j].state()).collect();
                let w = sim.wrenches(&island, &states, time);
                if speed <= 10.0 * REST_SPEED && sim.is_held(i, &island, &states, &w) {
                    sim.stop(i, time.value());
                }
            }
            Some(ModeChange::StartRolling)
                if sim.dynamics.slip(i, &k).value().norm() <= 10.0 * REST_SPEED =>
            {
                // The slip that remains (its derivatives, where a ball starts without slip) ends as friction would end it.
                let velocity = k.velocity - sim.dynamics.slip(i, &k).scaled(2.0 / 7.0);
                sim.bodies[i].set_mode(Mode::Roll);
                let roll = velocity.perp().scaled(1.0 / radius);
                sim.bodies[i].set_state(Kinematics { velocity, roll, ..k });
            }
            Some(ModeChange::StartRolling) | None => {}
            Some(ModeChange::StopSpinning) => {
                sim.bodies[i].set_state(Kinematics { spin: T::zero(), ..k });
            }
            // Another corner may have come into contact meanwhile.
            Some(ModeChange::Continue) => sim.propagate_impulses(time.value(), &island, CONTACT_SPEED),
        }
        sim.release(&island);
        sim.break_bonds(&island);
        sim.predict_all(&island);
        sim.reschedule(&island);
    }
}

#[cfg(test)]
mod tests {
    use crate::num::vec2;
    use crate::scene::Shape;
    use crate::world::StateCorrection;
    use crate::world::tests::{body, model, seconds};
    use crate::world::trace;

    /// Coulomb friction slows a disc that does not spin by mu g.
    #[test]
    fn a_body_continues_from_its_correction_and_one_at_rest_stays_at_rest() {
        let (disc, mu) = (Shape::Disc { radius: 0.1 }, 0.01);
        let bodies = vec![
            body(1, disc, vec2(0.0, 0.0), vec2(1.0, 0.0)),
            body(2, disc, vec2(0.0, 2.0), vec2(0.0, 0.0)),
        ];
        let plain = model(bodies, &[("sliding_friction", &[mu])]);
        let correction = |id| StateCorrection {
            id,
            time: 1.0,
            position: vec2(0.1, 0.0),
            velocity: vec2(-0.5, 0.0),
            yaw: 0.2,
            spin: 0.0,
        };
        let mut corrected = plain.clone();
        corrected.corrections = vec![correction(1), correction(2), correction(9)];
        let (before, after) = (trace(&plain, &seconds(35)), trace(&corrected, &seconds(35)));
        for (a, b) in before.states[..=25].iter().flatten().zip(after.states[..=25].iter().flatten()) {
            let (a, b) = (a.expect("present"), b.expect("present"));
            assert!(
                (a.position - b.position).norm() + (a.velocity - b.velocity).norm() < 1e-12,
                "{a:?} {b:?}"
            );
        }
        let (state, rest) = (after.states[35][0].expect("present"), after.states[35][1].expect("present"));
        let (brake, later) = (9.81 * mu, 0.4);
        let x = 1.0 - 0.5 * brake + 0.1 + (1.0 - brake - 0.5) * later - 0.5 * brake * later * later;
        assert!((state.position.x - x).abs() < 1e-9 && (state.yaw - 0.2).abs() < 1e-9, "{state:?} {x}");
        assert_eq!((rest.position, rest.velocity), (vec2(0.1, 2.0), vec2(0.0, 0.0)));
    }
}
