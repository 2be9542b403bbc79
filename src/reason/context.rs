//! What a program is run against: a scene, its fitted model, and one rollout of each simulated scenario.

use super::ReasonError;
use super::events::{RolloutEvents, Scenario, SceneEvent};
use super::predict::Prediction;
use super::value::SpanKind;
use crate::fit::Fit;
use crate::scene::Scene;
use crate::world::{BodySpec, Intervention, Model, Trace};

/// Why a run ended early.
#[derive(Debug, Clone, PartialEq)]
pub enum Halt {
    /// It needs the rollouts under these interventions for this number of frames, which are not simulated yet.
    NeedsSimulation(Vec<Intervention>, usize),
    /// What the video does not determine, and why.
    Undetermined(String),
    Error(ReasonError),
}

impl From<ReasonError> for Halt {
    fn from(error: ReasonError) -> Self {
        Halt::Error(error)
    }
}

/// A scene, its fitted model, and rollout number `rollout` of each scenario.
#[derive(Clone, Copy)]
pub struct RolloutContext<'a> {
    pub scene: &'a Scene,
    /// Of the fitted model.
    pub bodies: &'a [BodySpec],
    /// Effects that are on in the fitted model.
    pub effects: &'a [String],
    pub scenarios: &'a [Scenario],
    /// The simulation of each scenario, in the same order.
    pub simulations: &'a [Prediction],
    /// The fitted model, then those drawn from the posterior.
    pub models: &'a [Model],
    /// The fit and the index of its scene.
    pub fit: Option<(&'a Fit, usize)>,
    /// Frames after the video that a question about the future looks at.
    pub future: usize,
    pub rollout: usize,
}

impl<'a> RolloutContext<'a> {
    fn scenario(&self, interventions: &[Intervention], frames: usize) -> Result<usize, Halt> {
        let fits = |s: &Scenario| s.interventions == interventions && s.frames >= frames;
        let found = self.scenarios.iter().position(fits);
        found.ok_or_else(|| Halt::NeedsSimulation(interventions.to_vec(), frames))
    }

    /// The rollout under these interventions, for this number of frames at least.
    pub(super) fn rollout(
        &self,
        interventions: &[Intervention],
        frames: usize,
    ) -> Result<&'a RolloutEvents, Halt> {
        let scenario = self.scenario(interventions, frames)?;
        let rollouts = self.scenarios.get(scenario).map(|s| &s.rollouts);
        let missing = || Halt::NeedsSimulation(interventions.to_vec(), frames);
        rollouts.and_then(|r| r.get(self.rollout)).ok_or_else(missing)
    }

    /// Its states.
    pub(super) fn trace(&self, interventions: &[Intervention], frames: usize) -> Result<&'a Trace, Halt> {
        let scenario = self.scenario(interventions, frames)?;
        let missing = || Halt::NeedsSimulation(interventions.to_vec(), frames);
        let simulation = self.simulations.get(scenario).ok_or_else(missing)?;
        match self.rollout.checked_sub(1) {
            None => Ok(&simulation.best),
            Some(k) => simulation.ensemble.get(k).ok_or_else(missing),
        }
    }

    /// The frames that a span ends with, from frame 0.
    pub(super) fn frames(&self, span: SpanKind) -> usize {
        self.scene.times.len() + if span == SpanKind::Video { 0 } else { self.future }
    }

    /// The events under these interventions in a span.
    pub(super) fn events(
        &self,
        interventions: &[Intervention],
        span: SpanKind,
    ) -> Result<Vec<SceneEvent>, Halt> {
        let (end, until) = (self.scene.times.len(), self.frames(span));
        let fits = |e: &&SceneEvent| match span {
            SpanKind::Video => e.frame < end,
            SpanKind::Prediction => e.frame >= end && e.frame < until,
            SpanKind::Both => e.frame < until,
        };
        Ok(self.rollout(interventions, until)?.events.iter().filter(fits).cloned().collect())
    }
}
