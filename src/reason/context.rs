//! What a program is run against: a scene, its fitted model, and one rollout of each simulated scenario.

use super::ReasonError;
use super::discovery::StoredDiscovery;
use super::encounters::Encounter;
use super::events::{FUTURE_FRAMES, RolloutEvents, Scenario, SceneEvent, SceneEventKind};
use super::predict::Prediction;
use super::value::SpanKind;
use super::words::{DrawnWords, WordFamily};
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
    /// What is known of what the model lacks.
    pub discovery: Option<&'a StoredDiscovery>,
    /// The words of a lexicon, as this draw has them; `None`: the scene's own.
    pub words: Option<DrawnWords<'a>>,
}

/// The names of the effects that are on.
pub fn active_effects(model: &Model) -> Vec<String> {
    model.effects.iter().filter(|e| e.on).map(|e| e.name.clone()).collect()
}

impl<'a> RolloutContext<'a> {
    /// Scenarios of a scene without a fitted model.
    pub fn of_scene(scene: &'a Scene, scenarios: &'a [Scenario]) -> RolloutContext<'a> {
        RolloutContext {
            scene,
            bodies: &[],
            effects: &[],
            scenarios,
            simulations: &[],
            models: &[],
            fit: None,
            future: FUTURE_FRAMES,
            rollout: 0,
            discovery: None,
            words: None,
        }
    }

    /// The object's word of the attribute that an operation filters by or asks for.
    pub(super) fn attribute(&self, token: &str, object: usize) -> Option<&'a str> {
        let known = self.scene.objects.get(object)?;
        let (family, own) = match WordFamily::of_operation(token) {
            WordFamily::Color => (WordFamily::Color, known.color.as_str()),
            WordFamily::Material => (WordFamily::Material, known.material.as_str()),
            WordFamily::Shape => (WordFamily::Shape, known.shape.word()),
        };
        Some(self.words.and_then(|w| w.of_family(family, object)).unwrap_or(own))
    }

    /// A collision or an approach in the rollouts of this number, with its features.
    pub(super) fn encounter(&self, event: &SceneEvent) -> Option<&'a Encounter> {
        let is_collision = event.kind == SceneEventKind::Collision;
        let same = |e: &&Encounter| {
            e.is_collision == is_collision && e.time == event.time && e.objects == event.objects
        };
        (0..self.scenarios.len()).flat_map(|scenario| self.encounters(scenario)).find(same)
    }

    /// The approaches under these interventions in a span.
    pub(super) fn approaches(
        &self,
        interventions: &[Intervention],
        span: SpanKind,
    ) -> Result<Vec<SceneEvent>, Halt> {
        let encounters = self.encounters(self.scenario(interventions, self.frames(span))?);
        let approaches = encounters.iter().filter(|e| !e.is_collision && self.is_in(span, e.frame));
        let event = |e: &Encounter| SceneEvent {
            kind: SceneEventKind::Approach,
            frame: e.frame,
            time: e.time,
            objects: e.objects.clone(),
        };
        Ok(approaches.map(event).collect())
    }

    /// Those of a scenario's rollout; none where no simulation stands behind it.
    fn encounters(&self, scenario: usize) -> &'a [Encounter] {
        let rollout = self.scenarios.get(scenario).and_then(|s| s.rollouts.get(self.rollout));
        let trace = self.simulation(scenario);
        rollout.zip(trace).map_or(&[], |(rollout, trace)| rollout.encounters.of(self.scene, trace))
    }

    fn is_in(&self, span: SpanKind, frame: usize) -> bool {
        let (end, until) = (self.scene.times.len(), self.frames(span));
        match span {
            SpanKind::Video => frame < end,
            SpanKind::Prediction => frame >= end && frame < until,
            SpanKind::Both => frame < until,
        }
    }

    /// Whether these interventions are simulated for this number of frames.
    pub fn is_simulated(&self, interventions: &[Intervention], frames: usize) -> bool {
        self.scenario(interventions, frames).is_ok()
    }

    fn scenario(&self, interventions: &[Intervention], frames: usize) -> Result<usize, Halt> {
        let fits = |s: &Scenario| s.interventions == interventions && s.frames >= frames;
        let found = self.scenarios.iter().position(fits);
        found.ok_or_else(|| Halt::NeedsSimulation(interventions.to_vec(), frames))
    }

    /// The rollout under these interventions, for this number of frames at least.
    pub fn rollout(&self, interventions: &[Intervention], frames: usize) -> Result<&'a RolloutEvents, Halt> {
        let scenario = self.scenario(interventions, frames)?;
        let rollouts = self.scenarios.get(scenario).map(|s| &s.rollouts);
        let missing = || Halt::NeedsSimulation(interventions.to_vec(), frames);
        rollouts.and_then(|r| r.get(self.rollout)).ok_or_else(missing)
    }

    /// Its states.
    pub(super) fn trace(&self, interventions: &[Intervention], frames: usize) -> Result<&'a Trace, Halt> {
        let scenario = self.scenario(interventions, frames)?;
        let missing = || Halt::NeedsSimulation(interventions.to_vec(), frames);
        self.simulation(scenario).ok_or_else(missing)
    }

    fn simulation(&self, scenario: usize) -> Option<&'a Trace> {
        let simulation = self.simulations.get(scenario)?;
        match self.rollout.checked_sub(1) {
            None => Some(&simulation.best),
            Some(k) => simulation.ensemble.get(k),
        }
    }

    /// The frames that a span ends with, from frame 0.
    pub fn frames(&self, span: SpanKind) -> usize {
        self.scene.times.len() + if span == SpanKind::Video { 0 } else { self.future }
    }

    /// The events under these interventions in a span.
    pub(super) fn events(
        &self,
        interventions: &[Intervention],
        span: SpanKind,
    ) -> Result<Vec<SceneEvent>, Halt> {
        let events = &self.rollout(interventions, self.frames(span))?.events;
        Ok(events.iter().filter(|e| self.is_in(span, e.frame)).cloned().collect())
    }
}
