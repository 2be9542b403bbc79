//! One scene of a fit: its measurements, its simulation and its whitened residuals.

use super::super::noise::{Noise, Whitener};
use super::search_parameter::{SearchParameter, Slot};
use crate::num::wrap_angle;
use crate::scene::{Sample, Scene};
use crate::world::{Ending, Model, Rollout, SimulationLimits, simulate_observed};
use std::sync::atomic::{AtomicU64, Ordering};

/// A video needs far fewer events; a trial point that wants more is not worth its time.
pub(super) const LIMITS: SimulationLimits = SimulationLimits { events: 3_000 };

/// Simulation steps of one search, for each video: some twenty times what a video of ten colliding objects takes. A short video
/// has its share by the frame.
const MAX_STEPS: u64 = 400_000;
const MAX_STEPS_BY_FRAME: u64 = 3_200;

/// Number of frames, from the first, whose measurements count.
pub(in super::super) type Horizon = usize;

/// One scene: its measurements, and where each parameter enters its model.
pub(in super::super) struct SceneProblem<'a> {
    pub scene: &'a Scene,
    pub model: Model,
    pub noise: Noise,
    /// The model's values, in the order of [`Model::flatten`].
    pub(super) base: Vec<f64>,
    /// Simulation steps done so far.
    steps: AtomicU64,
    pub slots: Vec<Slot>,
    /// Whether derivatives are of single precision.
    pub(super) single_precision: bool,
}

/// A simulation of one scene, and its whitened residuals in their fixed order.
#[derive(Debug, Clone)]
pub(in super::super) struct SimulatedScene {
    pub rollout: Rollout<f64>,
    pub residuals: Vec<f64>,
}

/// One sample of a body, and how its residuals are whitened.
pub(super) struct WhitenedSample<'a> {
    pub body: usize,
    pub sample: &'a Sample,
    pub whitener: Whitener,
    /// Value and standard deviation (rad), where it counts.
    pub yaw: Option<(f64, f64)>,
}

/// A residual: body, frame, and coordinate 0, 1 = position (x and y where their errors are independent), 2 = yaw.
pub(in super::super) type ResidualId = (usize, usize, usize);

impl<'a> SceneProblem<'a> {
    pub(super) fn new(scene: &'a Scene, model: Model, noise: Noise, slots: Vec<Slot>) -> Self {
        let base = model.flatten();
        SceneProblem {
            scene,
            model,
            noise,
            base,
            steps: AtomicU64::default(),
            slots,
            single_precision: false,
        }
    }

    /// The same model and parameters with other measurements of the same objects.
    pub(super) fn with_scene<'b>(&self, scene: &'b Scene) -> SceneProblem<'b> {
        SceneProblem {
            scene,
            model: self.model.clone(),
            noise: self.noise,
            base: self.base.clone(),
            steps: AtomicU64::default(),
            slots: self.slots.clone(),
            single_precision: self.single_precision,
        }
    }

    /// The search parameter at an index of [`Model::flatten`], if that value is free.
    pub fn parameter_at(&self, slot: usize) -> Option<usize> {
        self.slots.iter().find(|s| s.0 == slot).map(|s| s.1)
    }

    /// The model's values at a point of the search, in the order of [`Model::flatten`].
    pub fn values(&self, parameters: &[SearchParameter], point: &[f64]) -> Vec<f64> {
        let mut values = self.base.clone();
        for &(slot, k) in &self.slots {
            values[slot] = parameters[k].in_model(point[k]);
        }
        values
    }

    /// Times of the frames before the horizon (s).
    pub(super) fn times(&self, horizon: Horizon) -> &[f64] {
        &self.scene.times[..horizon.min(self.scene.times.len())]
    }

    pub fn rollout(&self, parameters: &[SearchParameter], point: &[f64], horizon: Horizon) -> Rollout<f64> {
        let values = self.values(parameters, point);
        let rollout = simulate_observed(&self.model, &values, self.times(horizon), &LIMITS);
        self.count_steps(&rollout, 1);
        rollout
    }

    /// The simulation and its residuals; `None` if it does not come to its end.
    pub fn simulate_completely(
        &self,
        parameters: &[SearchParameter],
        point: &[f64],
        horizon: Horizon,
    ) -> Option<SimulatedScene> {
        let simulated = self.simulate(parameters, point, horizon);
        (simulated.rollout.ending == Ending::Completed).then_some(simulated)
    }

    /// The simulation and its residuals; a measurement that the simulation does not reach has residual 0.
    pub(super) fn simulate(
        &self,
        parameters: &[SearchParameter],
        point: &[f64],
        horizon: Horizon,
    ) -> SimulatedScene {
        let rollout = self.rollout(parameters, point, horizon);
        let mut residuals = vec![];
        self.each_residual(&rollout, horizon, |_, r, _| residuals.push(r));
        SimulatedScene { rollout, residuals }
    }

    /// Counts the steps of a simulation that costs as much as `factor` simulations without derivatives.
    pub(super) fn count_steps<T>(&self, rollout: &Rollout<T>, factor: u64) {
        // Concurrent additions commute: the count does not depend on their order.
        self.steps.fetch_add(factor * (1 + rollout.steps as u64), Ordering::Relaxed);
    }

    pub(super) fn steps(&self) -> u64 {
        self.steps.load(Ordering::Relaxed)
    }

    /// Simulation steps that a search may take for this scene.
    pub(super) fn max_steps(&self) -> u64 {
        MAX_STEPS.min(MAX_STEPS_BY_FRAME * self.scene.times.len() as u64)
    }

    /// Calls `f(id, whitened residual, row)` for each measurement before the horizon, in a fixed order.
    pub fn each_residual(
        &self,
        rollout: &Rollout<f64>,
        horizon: Horizon,
        mut f: impl FnMut(ResidualId, f64, usize),
    ) {
        self.each_sample(horizon, |m, row| {
            let (body, frame) = (m.body, m.sample.frame);
            let k = rollout.states.get(frame).and_then(|s| s[body].as_ref());
            let off = k.map(|k| k.position - m.sample.position).unwrap_or_default();
            let [x, y] = m.whitener.apply(off.x, off.y);
            f((body, frame, 0), x, row);
            f((body, frame, 1), y, row + 1);
            if let Some((yaw, sigma)) = m.yaw {
                f((body, frame, 2), k.map_or(0.0, |k| wrap_angle(k.yaw - yaw) / sigma), row + 2);
            }
        });
    }

    /// Sum of squared position residuals (m^2), and how many coordinates were measured.
    pub fn position_error(&self, rollout: &Rollout<f64>, horizon: Horizon) -> (f64, usize) {
        let (mut squares, mut count) = (0.0, 0);
        self.each_sample(horizon, |m, _| {
            let k = rollout.states.get(m.sample.frame).and_then(|s| s[m.body].as_ref());
            squares += k.map_or(0.0, |k| (k.position - m.sample.position).norm_squared());
            count += 2;
        });
        (squares, count)
    }

    /// Calls `f(sample, first row)`: a position has two rows, a yaw that counts has a third.
    pub(super) fn each_sample(&self, horizon: Horizon, mut f: impl FnMut(WhitenedSample, usize)) {
        let mut row = 0;
        let usual = self.noise.whitener(None);
        for (body, track) in self.scene.tracks.iter().enumerate() {
            let turns = !self.model.bodies[body].shape.is_ball();
            let id = self.model.bodies[body].id;
            let counts = |s: &&Sample| !self.model.passes_over(id, self.scene.time_of(s.frame));
            for sample in track.samples.iter().take_while(|s| s.frame < horizon).filter(counts) {
                let yaw = sample.yaw.zip(self.noise.yaw).filter(|_| turns);
                let whitener = sample.covariance.map_or(usual, |c| self.noise.whitener(Some(c)));
                f(WhitenedSample { body, sample, whitener, yaw }, row);
                row += 2 + usize::from(yaw.is_some());
            }
        }
    }
}
