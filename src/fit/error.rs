//! Why videos and models cannot be fitted, and the checks before a fit.

use crate::num::Stopped;
use crate::scene::Scene;
use crate::world::Model;

/// Fewest measured positions of a scene.
const FEWEST_SAMPLES: usize = 3;

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    #[error("no scene was given; give at least one")]
    NoScene,
    #[error("a formula of the model has no finite value where the objects of scene {scene} go; change it")]
    FormulaUndefined { scene: String },
    #[error("{scenes} scenes but {models} models were given; give one model a scene")]
    ModelCount { scenes: usize, models: usize },
    #[error(
        "scene {scene}: {seen} positions were measured; at least {needed} are needed to fit a motion: record a longer video"
    )]
    TooLittleData { scene: String, seen: usize, needed: usize },
    #[error(
        "scene {scene}: the model has {model} bodies, the scene {objects} objects; use a model of this scene"
    )]
    BodyCount { scene: String, model: usize, objects: usize },
    #[error(
        "scenes {scene} and {other}: their models start from the presets {presets:?}; videos that share their physics need \
         one preset: fit them separately, or name one model for all"
    )]
    PresetsDiffer { scene: String, other: String, presets: [String; 2] },
    #[error("scenes {scene} and {other}: hold the same measurements; give each video once")]
    DuplicateVideo { scene: String, other: String },
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

/// Whether the scenes can share the physics of the models: one preset, and each video given once.
pub fn check(scenes: &[Scene], models: &[Model]) -> Result<(), FitError> {
    check_each(scenes, models)?;
    let (first, preset) = (&scenes[0].name, &models[0].preset);
    if let Some(k) = models.iter().position(|m| m.preset != *preset) {
        let presets = [preset.clone(), models[k].preset.clone()];
        return Err(FitError::PresetsDiffer { scene: first.clone(), other: scenes[k].name.clone(), presets });
    }
    for (k, scene) in scenes.iter().enumerate() {
        let same = |s: &&Scene| s.times == scene.times && s.tracks == scene.tracks;
        if let Some(other) = scenes[k + 1..].iter().find(same) {
            return Err(FitError::DuplicateVideo { scene: scene.name.clone(), other: other.name.clone() });
        }
    }
    Ok(())
}

/// Whether each model can be fitted to its scene: as many bodies as objects, and enough positions.
pub(super) fn check_each(scenes: &[Scene], models: &[Model]) -> Result<(), FitError> {
    if scenes.is_empty() {
        return Err(FitError::NoScene);
    }
    if scenes.len() != models.len() {
        return Err(FitError::ModelCount { scenes: scenes.len(), models: models.len() });
    }
    for (scene, model) in scenes.iter().zip(models) {
        let name = || scene.name.clone();
        if model.bodies.len() != scene.objects.len() || scene.tracks.len() != scene.objects.len() {
            let (model, objects) = (model.bodies.len(), scene.objects.len());
            return Err(FitError::BodyCount { scene: name(), model, objects });
        }
        let seen = scene.tracks.iter().map(|t| t.samples.len()).sum();
        if seen < FEWEST_SAMPLES {
            return Err(FitError::TooLittleData { scene: name(), seen, needed: FEWEST_SAMPLES });
        }
    }
    Ok(())
}
