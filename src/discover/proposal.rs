//! A change to models before they are fitted, and the start of a fit that depends on the model alone.

use super::contact::screen_contacts;
use super::contact_law::with_contact;
use super::free::at_values;
use super::screen::{
    ScreenBase, beginnings, region, rescreen_from_prior, screen, with_effect, with_nuisance,
};
use super::search::leaves_something;
use super::user_formula::fit_written;
use super::weak_form::{WeakFormRegression, fit_forces};
use super::whole_trajectory::stuck;
use super::window_fits::WindowFits;
use super::windows::contacts;
use crate::effects::formula::{Formula, FormulaError};
use crate::effects::{EFFECTS, EffectEntry, alike};
use crate::fit::FitError;
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::{ActiveEffect, Model, Preset};
use serde::Serialize;
use std::collections::BTreeSet;

/// Kind of the laws that users write.
pub const FORMULA: &str = "formula";
/// Longest name of a user's law (bytes).
const LONGEST_NAME: usize = 64;
/// What is to be done to a model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub enum ModelChange {
    /// Puts an effect of the library in, by its name, or by its kind: then the form of it that does best.
    Add(String),
    /// Puts a user's law in, under the user's name.
    Write(String, Formula),
    /// Takes an effect out.
    Remove(String),
}

/// Why a change cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ChangeError {
    #[error("there is no effect {name:?}; did you mean {}? ListEffects and `vrdp effects` list all", alike(.name).join(", "))]
    Unknown { name: String },
    #[error(
        "{name} is already in the model; start from a revision without it (`--on`), remove it first, or give a new law another `--name`"
    )]
    There { name: String },
    #[error("{name:?} is not in the model, whose effects are {present}")]
    Absent { name: String, present: String },
    #[error(
        "{name:?} cannot name a law: use letters, digits and _, at most {LONGEST_NAME} bytes, and no name of an effect"
    )]
    Name { name: String },
    #[error(transparent)]
    Formula(#[from] FormulaError),
}

/// Effects of the library that a name or a kind stands for.
pub fn named(name: &str) -> impl Iterator<Item = &'static EffectEntry> {
    let exact = EFFECTS.iter().any(|e| e.spec.name == name);
    EFFECTS.iter().filter(move |e| if exact { e.spec.name == name } else { e.kind == name })
}

impl ModelChange {
    /// Whether it can be made to these models.
    pub fn check(&self, models: &[Model]) -> Result<(), ChangeError> {
        let present = |name: &str| models.iter().any(|m| m.effect(name).is_some());
        match self {
            ModelChange::Add(name) => {
                if named(name).next().is_none() {
                    return Err(ChangeError::Unknown { name: name.clone() });
                }
                match named(name).all(|e| present(e.spec.name)) {
                    true => Err(ChangeError::There { name: name.clone() }),
                    false => Ok(()),
                }
            }
            ModelChange::Write(name, formula) => {
                check_name(name)?;
                if present(name) {
                    return Err(ChangeError::There { name: name.clone() });
                }
                Ok(formula.read().map(|_| ())?)
            }
            ModelChange::Remove(name) if !present(name) => {
                let names: BTreeSet<&str> =
                    models.iter().flat_map(|m| &m.effects).map(|e| e.name.as_str()).collect();
                let present = names.into_iter().collect::<Vec<_>>().join(", ");
                Err(ChangeError::Absent { name: name.clone(), present })
            }
            ModelChange::Remove(_) => Ok(()),
        }
    }
}

/// Whether a user's law may have this name.
pub fn check_name(name: &str) -> Result<(), ChangeError> {
    let word = name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    match word && name.len() <= LONGEST_NAME && named(name).next().is_none() {
        true => Ok(()),
        false => Err(ChangeError::Name { name: name.to_string() }),
    }
}

/// Models with the change made, before they are fitted.
pub struct Proposal {
    pub models: Vec<Model>,
    /// Name of the effect that is new.
    pub added: Option<String>,
}

/// Puts the change where the lens that sees it finds it.
pub fn propose(
    lens: &WeakFormRegression,
    models: &[Model],
    change: &ModelChange,
    stop: Stop,
) -> Result<Proposal, FitError> {
    let mut models = models.to_vec();
    match change {
        ModelChange::Remove(name) => {
            models.iter_mut().for_each(|m| m.effects.retain(|e| e.name != *name));
            Ok(Proposal { models, added: None })
        }
        ModelChange::Write(name, formula) => {
            let (models, free, seen) = fit_written(lens, &models, name, formula);
            Ok(Proposal { models: at_values(&models, &free, &seen.values), added: Some(name.clone()) })
        }
        ModelChange::Add(name) => {
            let (free, seen) = fit_forces(lens, &models);
            let base = ScreenBase::new(lens, &models, free, seen);
            let mut best: Option<(f64, Proposal)> = None;
            let absent = |e: &&EffectEntry| models.iter().all(|m| m.effect(e.spec.name).is_none());
            for entry in named(name).filter(absent) {
                let (gain, with) = with_library(lens, &base, entry, stop)?;
                if best.as_ref().is_none_or(|b| gain > b.0) {
                    best = Some((gain, Proposal { models: with, added: Some(entry.spec.name.into()) }));
                }
            }
            Ok(best.map_or(Proposal { models, added: None }, |b| b.1))
        }
    }
}

/// The models with an effect of the library where the lens that sees it finds it, and the fall of that lens's cost.
fn with_library(
    lens: &WeakFormRegression,
    base: &ScreenBase,
    entry: &'static EffectEntry,
    stop: Stop,
) -> Result<(f64, Vec<Model>), FitError> {
    let region = region(lens.scenes);
    let fitted = &base.fitted;
    let tried = beginnings(lens, fitted, entry, &region);
    if let Some(mut found) = tried.and_then(|tried| screen(lens, base, fitted, entry, &tried, &region)) {
        if leaves_something(found.chi_square, lens.degrees_of_freedom() as f64) {
            rescreen_from_prior(lens, base, &base.believed(lens), &region, &mut found);
        }
        return Ok((found.gain, found.models));
    }
    let begun = &fitted.models;
    let seed = || entry.seeds(&region).into_iter().next().unwrap_or_default();
    if entry.all_or_nothing().is_some() {
        return Ok((0.0, stuck(begun, entry, &region)));
    }
    if !entry.shows_at_contacts() {
        return Ok((0.0, with_effect(begun, entry, &seed(), &region)));
    }
    let (found, _) =
        screen_contacts(&WindowFits::of(&contacts(lens, begun), stop)?, &region, &[entry], stop)?;
    // Contacts tell ratios of masses: where they name the one object that is heavier, its factor alone is asked for.
    let best = found.into_iter().next().map(|c| (c.before - c.after, c.values, c.object));
    let (gain, values, object) = best.unwrap_or_else(|| (0.0, seed(), None));
    Ok((gain, with_contact(begun, entry, &values, object, &region)))
}

/// The models as if each law beside the preset's were added to the preset's own, in the order of the library, formulas last: values
/// at their prior means, masses as given, laws where the lens finds them. The same models give the same start, whatever the
/// edits that led to them. `None` where a model is of no preset.
pub fn canonical(
    lens: &WeakFormRegression,
    models: &[Model],
    stop: Stop,
) -> Result<Option<Vec<Model>>, FitError> {
    let Some(added) = laws(lens.scenes, models) else { return Ok(None) };
    let mut start = models.to_vec();
    for (model, scene) in start.iter_mut().zip(lens.scenes) {
        model.effects.retain(|e| !added.contains(&e.name));
        let free = model.effects.iter_mut().flat_map(|e| &mut e.parameters).filter(|p| p.prior.sd > 0.0);
        free.for_each(|p| p.values.clone_from(&p.means));
        for (body, object) in model.bodies.iter_mut().zip(&scene.objects) {
            body.mass = object.mass.unwrap_or(1.0);
        }
    }
    for name in added {
        let formula = models.iter().find_map(|m| m.effect(&name)?.formula.clone());
        let law = match formula {
            Some(formula) => ModelChange::Write(name, formula),
            None => ModelChange::Add(name),
        };
        start = propose(lens, &start, &law, stop)?.models;
    }
    for (own, asked) in start.iter_mut().zip(models) {
        own.effects.sort_by_key(|e| asked.effects.iter().position(|known| known.name == e.name));
        own.copy_priors_from(asked);
    }
    Ok(Some(start))
}

/// Names of the laws that models have beside those of their presets, in the order of the library, formulas last; `None` where a
/// model is of no preset.
pub fn laws(scenes: &[Scene], models: &[Model]) -> Option<Vec<String>> {
    let presets = scenes.iter().zip(models).map(|(s, m)| Some(Preset::named(&m.preset)?.model(s)));
    let presets = with_nuisance(&presets.collect::<Option<Vec<Model>>>()?);
    let is_added = |e: &&ActiveEffect| e.on && presets.iter().all(|preset| preset.effect(&e.name).is_none());
    let added = models.iter().flat_map(|m| &m.effects).filter(is_added);
    let added: BTreeSet<(usize, &str)> = added.map(|e| (place(&e.name), e.name.as_str())).collect();
    Some(added.into_iter().map(|(_, name)| name.to_string()).collect())
}

/// Place in the library.
fn place(name: &str) -> usize {
    EFFECTS.iter().position(|e| e.spec.name == name).unwrap_or(EFFECTS.len())
}

#[cfg(test)]
mod tests {
    use super::super::tests::{CUBE, DISC, film, models};
    use super::*;
    use crate::num::never;

    #[test]
    fn the_start_of_a_model_does_not_depend_on_the_order_of_its_laws() {
        let launch = |v: f64| vec![(DISC, 0.6, [-1.5, 0.0], [v, 0.2]), (CUBE, 0.8, [1.0, 1.5], [-0.5, 0.3])];
        let scenes = film(&[launch(1.0), launch(1.6)], Some(("linear_drag", &[("c", 0.3)])));
        let lens = WeakFormRegression::new(&scenes);
        let start = |laws: [&str; 2]| -> Vec<(String, Vec<f64>)> {
            let mut with = with_nuisance(&models(&scenes));
            for law in laws {
                let change = ModelChange::Add(law.into());
                with = propose(&lens, &with, &change, &never).expect("nobody stops it").models;
                // A fit between the edits leaves other values.
                with.iter_mut().flat_map(|m| &mut m.effects).flat_map(|e| &mut e.parameters).for_each(|p| {
                    p.values.iter_mut().filter(|_| p.prior.sd > 0.0).for_each(|v| *v *= 1.01);
                });
            }
            let start = canonical(&lens, &with, &never).expect("nobody stops it").expect("it is of a preset");
            let all = start.iter().flat_map(|m| &m.effects);
            let mut all: Vec<_> = all
                .flat_map(|e| {
                    e.parameters.iter().map(|p| (format!("{}.{}", e.name, p.name), p.values.clone()))
                })
                .collect();
            all.sort_by(|a, b| a.0.cmp(&b.0));
            all
        };
        let (one, other) = (start(["linear_drag", "tilt"]), start(["tilt", "linear_drag"]));
        assert_eq!(one, other);
        let drag = one.iter().find(|(name, _)| name == "linear_drag.c").expect("it was added");
        assert!((drag.1[0] - 0.3).abs() < 0.05, "{drag:?}");
    }
}
