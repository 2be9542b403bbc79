//! The input of a study: its kind, and for each video the scene, the start model and the fitted model.

use crate::discover::ModelChange;
use crate::effects::formula::Formula;
use crate::engine::error::EngineError;
use crate::engine::limits::MAX_STUDY_VIDEOS;
use crate::engine::results::StoredFit;
use crate::fit::{Fit, FitError, FitOptions, fit};
use crate::num::Stop;
use crate::scene::{Scene, Violation};
use crate::world::Model;
use serde::Serialize;
use std::collections::BTreeSet;

/// Most effects that a discovery may add.
pub const MAX_EFFECTS: usize = 8;

/// What a study does with its videos.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub enum StudyKind {
    Compare,
    /// With formulas of the request as further candidates, by name.
    Diagnose(Vec<(String, Formula)>),
    Change(ModelChange),
    Discover {
        max_effects: usize,
        /// Frames of the trajectories; `None`: those of each video and [`crate::engine::DEFAULT_FUTURE_FRAMES`] more.
        frames: Option<usize>,
    },
}

/// What a study works on, each list by video; no parents where no fitted models were named.
pub struct StudyInput {
    pub videos: Vec<String>,
    pub scenes: Vec<Scene>,
    pub models: Vec<Model>,
    pub parents: Vec<StoredFit>,
}

impl StudyInput {
    /// The fits of the parents as one fit, or a new fit.
    pub fn fit(&self, options: &FitOptions, stop: Stop) -> Result<Fit, FitError> {
        let Some(first) = self.parents.first() else { return fit(&self.scenes, &self.models, options, stop) };
        let scenes = self.parents.iter().flat_map(|p| p.fit.scenes.iter().cloned()).collect();
        Ok(Fit { scenes, ..first.fit.clone() })
    }
}

/// Refuses wrong numbers of videos and effects.
pub fn check_request(videos: &[String], kind: &StudyKind) -> Result<(), EngineError> {
    let mut wrong = vec![];
    let mut add = |path: &str, message: String| wrong.push(Violation { path: path.into(), message });
    if videos.is_empty() || videos.len() > MAX_STUDY_VIDEOS {
        add("study.videos", format!("are {}; give 1 to {MAX_STUDY_VIDEOS}", videos.len()));
    }
    if videos.iter().collect::<BTreeSet<_>>().len() < videos.len() {
        add("study.videos", "name one video twice; name each once".into());
    }
    if let StudyKind::Discover { max_effects, .. } = kind
        && !(1..=MAX_EFFECTS).contains(max_effects)
    {
        add("max_effects", format!("is {max_effects}; must be 1 to {MAX_EFFECTS}"));
    }
    if wrong.is_empty() { Ok(()) } else { Err(EngineError::Invalid(wrong)) }
}
