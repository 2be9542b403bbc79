//! What a program is run against: a scene, its fitted model, and one rollout of each simulated scenario.

use super::ReasonError;
use super::events::{RolloutEvents, Scenario, SceneEvent};
use super::program::Op;
use super::words::{DrawnWords, WordFamily};
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
    /// The words of a lexicon, as this draw has them; `None`: the scene's own.
    pub words: Option<DrawnWords<'a>>,
}

impl<'a> RolloutContext<'a> {
    /// The object's word of the attribute that an operation filters by or asks for.
    pub(super) fn attribute(&self, op: Op, object: usize) -> Option<&'a str> {
        let known = self.scene.objects.get(object)?;
        let (family, own) = match op {
            Op::FilterColor | Op::QueryColor => (WordFamily::Color, known.color.as_str()),
            Op::FilterMaterial | Op::QueryMaterial => (WordFamily::Material, known.material.as_str()),
            _ => (WordFamily::Shape, known.shape.word()),
        };
        Some(self.words.and_then(|w| w.of_family(family, object)).unwrap_or(own))
    }

    /// The features of a collision in the rollouts of this number.
    pub(super) fn impact(&self, event: &SceneEvent) -> Option<[f64; 4]> {
        let rollouts = self.scenarios.iter().filter_map(|s| s.rollouts.get(self.rollout));
        let mut impacts = rollouts.flat_map(|r| &r.impacts);
        impacts.find(|i| i.frame == event.frame && i.objects == event.objects).map(|i| i.features)
    }

    /// The rollout under these interventions.
    pub fn rollout(&self, interventions: &[Intervention]) -> Result<&RolloutEvents, Halt> {
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
