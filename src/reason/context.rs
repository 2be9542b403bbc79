//! What a program is run against: a scene, its fitted model, and one rollout of each simulated scenario.

use super::ReasonError;
use super::events::{RolloutEvents, Scenario, SceneEvent};
use crate::scene::Scene;
use crate::world::{BodySpec, Intervention};

/// Why a run ended early.
#[derive(Debug, Clone, PartialEq)]
pub enum Halt {
    /// It needs the rollouts under these interventions, which are not simulated yet.
    NeedsSimulation(Vec<Intervention>),
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
    pub rollout: usize,
}

impl RolloutContext<'_> {
    /// The rollout under these interventions.
    pub(super) fn rollout(&self, interventions: &[Intervention]) -> Result<&RolloutEvents, Halt> {
        let scenario = self.scenarios.iter().find(|s| s.interventions == interventions);
        scenario
            .and_then(|s| s.rollouts.get(self.rollout))
            .ok_or_else(|| Halt::NeedsSimulation(interventions.to_vec()))
    }

    /// The events under these interventions during the video, or after it.
    pub(super) fn events(
        &self,
        interventions: &[Intervention],
        after: bool,
    ) -> Result<Vec<SceneEvent>, Halt> {
        let end = self.scene.times.len();
        let events = self.rollout(interventions)?.events.iter();
        Ok(events.filter(|e| (e.frame >= end) == after).cloned().collect())
    }
}
