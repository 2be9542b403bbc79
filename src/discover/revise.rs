//! Models in trajectory space: a revision's fit, what it is worth on frames that it has not seen.

use super::checkpoints::Checkpoints;
use super::free::{FreeParameter, at_values};
use super::proof;
use super::weak_form::{LensFit, WeakFormRegression, fit_forces};
use crate::effects::ParamId;
use crate::fit::{self, Fit, FitError, FitOptions, Posterior, SceneFit, StartPoint, estimate, estimate_one};
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::{Model, SimulationLimits, simulate_observed};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Share of the frames that a model is fitted to when the others are to prove it.
const SHOWN: f64 = 0.75;
/// What the force lens says is believed this many times less firmly: the data count again in the fit.
const DOUBT: f64 = 5.0;
/// A scene that fits this well alone needs no second look (reduced chi-square).
const WELL: f64 = 1.5;
/// A second look at a scene is kept when it fits at most this much worse.
const KEPT: f64 = 1.05;
/// A scene that the common fit follows this many times worse than its own fit is lost.
const LOST: f64 = 2.0;
/// Effort of fits that only choose between models: the right one is followed soon, and the others are never.
pub const TRIED_BUDGET_FRACTION: f64 = 0.25;
/// What leaves more than this of the free motion (reduced chi-square) no search follows, however long.
const REFUTED: f64 = 4.0;
/// Most iterations of the fit of all scenes together, which begins where each of them ended.
const COMMON_ITERATIONS: usize = 30;
/// The same where each of them is lost.
const LOST_ITERATIONS: usize = 5;
/// Samples that a track needs before the held-out frames.
const FEWEST: usize = 5;
/// Samples that tell how an object begins as well as all of its track does.
const TELLING: usize = 10;

/// A model of all scenes with what it is worth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Revision {
    /// The effect that it adds to the one before; `None` for the first.
    pub effect: Option<String>,
    pub fit: Fit,
    /// Root mean square position residual on all frames (m).
    pub rmse: f64,
    /// The same on the last quarter of the frames, fitted without them (m).
    pub held_out_rmse: f64,
    /// The same in free motion, each video left out in turn (m).
    pub left_out_rmse: f64,
    /// Over all scenes.
    pub reduced_chi_square: f64,
    /// Scenes that the common numbers could not follow, with numbers of their own: chaos, or a law that is not right.
    #[serde(rename = "apart")]
    pub unpooled: Vec<String>,
}

/// About how many fits a revision takes: each scene alone, perhaps again, and all together; and the same without the last
/// frames.
pub fn fits_of_revision(scenes: &[Scene]) -> usize {
    4 * scenes.len() + 2
}

/// The models with beliefs about what acts between contacts as the lens has them.
pub fn believing(models: &[Model], free: &[FreeParameter], seen: &LensFit) -> Vec<Model> {
    let mut models = at_values(models, free, &seen.values);
    for model in &mut models {
        for active in &mut model.effects {
            let name = active.name.clone();
            let shares: Vec<bool> = active.parameters.iter().map(|p| active.shares(p)).collect();
            let free_ones = active.parameters.iter_mut().zip(shares).filter(|(p, _)| p.prior.sd > 0.0);
            for (p, shared) in free_ones {
                let own = |f: &&(&FreeParameter, &f64)| {
                    ParamId::parse(&f.0.name).is_some_and(|id| id.is_of(&name, &p.name))
                };
                let pairs: Vec<(&FreeParameter, &f64)> = free.iter().zip(&seen.sd).collect();
                let widest = pairs.iter().filter(own).map(|(_, sd)| **sd).fold(0.0, f64::max);
                if shared && widest > 0.0 {
                    p.prior.sd = p.prior.sd.min(DOUBT * widest);
                    p.means.clone_from(&p.values);
                }
            }
        }
    }
    models
}

/// Fits the models as a revision that adds `effect`. `free_motion` says whether the force lens leads.
pub fn revise(
    lens: &WeakFormRegression,
    models: &[Model],
    effect: Option<&str>,
    options: &FitOptions,
    stop: Stop,
) -> Result<Revision, FitError> {
    revise_from(lens, models, &vec![None; models.len()], effect, options, stop)
}

/// The same, the whole films begun where the models that have `begun` some of the scenes stand.
pub fn revise_from(
    lens: &WeakFormRegression,
    models: &[Model],
    begun: &[Option<&Model>],
    effect: Option<&str>,
    options: &FitOptions,
    stop: Stop,
) -> Result<Revision, FitError> {
    let (free, seen) = fit_forces(lens, models);
    let options = &worth(options, lens, &seen);
    // The first frames before the whole film: what follows them knows where to begin.
    let shown: Vec<Scene> = lens.scenes.iter().map(first_frames).collect();
    let first = fit_shown(&shown, models, effect, options, lens.checkpoints, stop)?;
    let parts = errors(lens.scenes, &shown, &first);
    let begun: Vec<Option<&Model>> =
        (0..models.len()).map(|k| begun[k].or_else(|| follows(&shown[k], &first.scenes[k]))).collect();
    let led = led(models, effect, &free, &seen);
    // What others are compared with is what a fit would give.
    let options = &FitOptions { single_precision: options.single_precision && effect.is_some(), ..*options };
    let (fit_all, unpooled) = fit_set_up(Some(models), lens, &led, &begun, options, stop)?;
    let (mut chi_square, mut degrees, mut squares, mut count) = (0.0, 0.0, 0.0, 0.0);
    for (scene, fitted) in lens.scenes.iter().zip(&fit_all.scenes) {
        let n = 2.0 * scene.tracks.iter().map(|t| t.samples.len()).sum::<usize>() as f64;
        squares += fitted.rmse * fitted.rmse * n;
        count += n;
        degrees += fitted.degrees_of_freedom as f64;
        chi_square += fitted.reduced_chi_square * fitted.degrees_of_freedom as f64;
    }
    let left_out = lens.left_out(models, &free, &seen.values);
    let sigma = pooled_noise(lens);
    Ok(Revision {
        effect: effect.map(str::to_string),
        rmse: (squares / f64::max(count, 1.0)).sqrt(),
        held_out_rmse: pooled_rmse(&parts),
        left_out_rmse: sigma * (left_out / lens.degrees_of_freedom().max(1) as f64).sqrt(),
        reduced_chi_square: chi_square / f64::max(degrees, 1.0),
        fit: fit_all,
        unpooled,
    })
}

/// The fit of a revision, and the names of scenes that the common numbers could not follow.
pub fn trajectories(
    lens: &WeakFormRegression,
    models: &[Model],
    effect: Option<&str>,
    options: &FitOptions,
    stop: Stop,
) -> Result<(Fit, Vec<String>), FitError> {
    trajectories_from(lens, models, &vec![None; models.len()], effect, options, stop)
}

/// The same, begun where the models that have `begun` some of the scenes stand.
pub fn trajectories_from(
    lens: &WeakFormRegression,
    models: &[Model],
    begun: &[Option<&Model>],
    effect: Option<&str>,
    options: &FitOptions,
    stop: Stop,
) -> Result<(Fit, Vec<String>), FitError> {
    let (free, seen) = fit_forces(lens, models);
    let options = &worth(options, lens, &seen);
    let led = led(models, effect, &free, &seen);
    let (mut found, apart) = fit_set_up(None, lens, &led, begun, options, stop)?;
    found.scenes.iter_mut().zip(models).for_each(|(fitted, asked)| fitted.model.copy_priors_from(asked));
    Ok((found, apart))
}

/// The share of the work budget for a model, by what it leaves of the free motion.
fn worth(options: &FitOptions, lens: &WeakFormRegression, seen: &LensFit) -> FitOptions {
    let refuted = seen.chi_square > REFUTED * lens.degrees_of_freedom() as f64;
    FitOptions {
        budget_fraction: if refuted {
            options.budget_fraction.min(TRIED_BUDGET_FRACTION)
        } else {
            options.budget_fraction
        },
        ..*options
    }
}

/// Root mean square of the scenes' noise (m).
pub fn pooled_noise(lens: &WeakFormRegression) -> f64 {
    let squares: f64 = lens.noises.iter().map(|n| n.position * n.position).sum();
    (squares / lens.noises.len().max(1) as f64).sqrt()
}

/// Without an effect the model is fitted as it is: what it lacks would mislead the lens.
fn led(models: &[Model], effect: Option<&str>, free: &[FreeParameter], seen: &LensFit) -> Vec<Model> {
    if effect.is_some() { believing(models, free, seen) } else { models.to_vec() }
}

/// Fits each scene alone, then all together from there: a scene that leads astray takes no other with it. A scene begins
/// where the model that has `begun` it stands, if there is one. A fit that predictions begin with ends with the beliefs that were
/// `asked`, as what led the search is no belief of the model, and is drawn from.
fn fit_set_up(
    asked: Option<&[Model]>,
    lens: &WeakFormRegression,
    models: &[Model],
    begun: &[Option<&Model>],
    options: &FitOptions,
    stop: Stop,
) -> Result<(Fit, Vec<String>), FitError> {
    let scenes = lens.scenes;
    let alone: Result<Vec<Fit>, FitError> = (scenes, models, begun)
        .into_par_iter()
        .map(|(scene, model, begun)| {
            let inputs = (scene, model, begun, options, options.single_precision);
            lens.step("alone", &inputs, || fit_on(scene, model, *begun, options, stop))
        })
        .collect();
    let mut alone = alone?;
    let right = alone.iter().flat_map(|a| &a.scenes).any(|s| s.reduced_chi_square < WELL);
    // A lens that blows misled may lead where no search comes back from: what is lost is searched for without it, too.
    if let Some(asked) = asked.filter(|asked| right && models != *asked) {
        let freely = |((scene, asked), alone): ((&Scene, &Model), &mut Fit)| -> Result<(), FitError> {
            if proof::loses(alone) {
                *alone = lower(alone.clone(), estimate_one(scene, asked, options, stop)?);
            }
            Ok(())
        };
        scenes.par_iter().zip(asked).zip(&mut alone).try_for_each(freely)?;
    }
    // Again with what the others say, where some of them are right: a scene whose contacts were misread sees them right.
    let led: Vec<Model> = pooled(models, &alone);
    let again: Result<Vec<Option<Fit>>, FitError> = (scenes, &led, &alone)
        .into_par_iter()
        .map(|(scene, model, alone)| match alone.scenes.first() {
            // The lost come last, with what the others agree on.
            Some(s) if !right || s.reduced_chi_square < WELL || proof::lost(s) => Ok(None),
            _ => {
                let inputs = (scene, model, options, options.single_precision);
                lens.step("again", &inputs, || estimate_one(scene, model, options, stop)).map(Some)
            }
        })
        .collect();
    let better = |(a, b): (Fit, Option<Fit>)| match b {
        Some(b) if b.scenes[0].reduced_chi_square <= KEPT * a.scenes[0].reduced_chi_square => b,
        _ => a,
    };
    let alone: Vec<Fit> = alone.into_iter().zip(again?).map(better).collect();
    let inputs = (scenes, models, &alone, begun, options, options.single_precision);
    let (mut joint, alone) =
        lens.step("common", &inputs, || common(scenes, models, alone.clone(), begun, options, stop))?;
    if let Some(asked) = asked {
        joint.scenes.iter_mut().zip(asked).for_each(|(fitted, asked)| fitted.model.copy_priors_from(asked));
        let found = joint.models();
        // What is lost has no say.
        let most = if proof::loses(&joint) { 0 } else { options.max_iterations.min(COMMON_ITERATIONS) };
        let near = FitOptions { start_point: StartPoint::NearOptimum, max_iterations: most, ..*options };
        let inputs = (scenes, &found, near, near.single_precision);
        let Fit { scenes, posterior, .. } =
            lens.step("drawn", &inputs, || fit::fit(scenes, &found, &near, stop))?;
        joint = Fit { scenes, posterior, ..joint };
    }
    // Where chaos keeps the common numbers from following a scene, its own fit stands for it.
    let mut apart = vec![];
    for (scene, alone) in joint.scenes.iter_mut().zip(alone) {
        if let [own] = &alone.scenes[..]
            && own.reduced_chi_square * LOST < scene.reduced_chi_square
        {
            scene.clone_from(own);
            apart.push(scene.name.clone());
        }
    }
    Ok((joint, apart))
}

/// Fits all scenes from where each is `alone`, and gives the fits of each alone. One that its own fit has lost says nothing of the common
/// numbers, and would be searched without end: it is fitted with those of the others, and counts again where that helps.
fn common(
    scenes: &[Scene],
    models: &[Model],
    mut alone: Vec<Fit>,
    begun: &[Option<&Model>],
    options: &FitOptions,
    stop: Stop,
) -> Result<(Fit, Vec<Fit>), FitError> {
    let lost =
        |alone: &[Fit]| -> Vec<usize> { (0..scenes.len()).filter(|&k| proof::loses(&alone[k])).collect() };
    let most = options.max_iterations.min(COMMON_ITERATIONS);
    let as_near = FitOptions { start_point: StartPoint::NearOptimum, max_iterations: most, ..*options };
    let together = |all: &mut [Model], alone: &[Fit], lost: &[usize]| -> Result<Fit, FitError> {
        let rest: Vec<usize> = (0..scenes.len()).filter(|k| !lost.contains(k)).collect();
        let some: Vec<Scene> = rest.iter().map(|&k| scenes[k].clone()).collect();
        let models: Vec<Model> = rest.iter().map(|&k| all[k].clone()).collect();
        let alone: Vec<Fit> = rest.iter().map(|&k| alone[k].clone()).collect();
        let found = fit::fit_jointly(&some, &models, &alone, &as_near, stop)?;
        for (&k, fitted) in rest.iter().zip(&found.scenes) {
            all.iter_mut().for_each(|model| model.copy_shared_from(&fitted.model));
            all[k].clone_from(&fitted.model);
        }
        Ok(found)
    };
    let mut left = lost(&alone);
    if left.is_empty() {
        return Ok((fit::fit_jointly(scenes, models, &alone, &as_near, stop)?, alone));
    }
    let mut all = gathered(models, &alone);
    if left.len() == scenes.len() {
        // None of them follows this model, whatever its numbers.
        let most = most.min(LOST_ITERATIONS);
        return Ok((estimate(scenes, &all, &FitOptions { max_iterations: most, ..as_near }, stop)?, alone));
    }
    let mut found = together(&mut all, &alone, &left)?;
    // Each that is found again knows more of what the next one lacks: how a kind of pair rebounds.
    while !left.is_empty() {
        let retried: Result<Vec<Fit>, FitError> = left
            .par_iter()
            .map(|&k| {
                let mut model = all[k].clone();
                believe(&mut model, &found.posterior);
                fit_on(&scenes[k], &model, begun[k], options, stop)
            })
            .collect();
        for (&k, mut fitted) in left.iter().zip(retried?) {
            fitted.scenes[0].model.copy_priors_from(&all[k]);
            if fitted.scenes[0].reduced_chi_square < KEPT * alone[k].scenes[0].reduced_chi_square {
                all[k].clone_from(&fitted.scenes[0].model);
                alone[k] = fitted;
            }
        }
        let after = lost(&alone);
        if after.len() == left.len() {
            break;
        }
        left = after;
        found = together(&mut all, &alone, &left)?;
    }
    if left.is_empty() {
        return Ok((found, alone));
    }
    // A lost one has no say in what they share.
    for known in &found.scenes {
        left.iter().for_each(|&k| all[k].copy_shared_from(&known.model));
    }
    let as_they_are = FitOptions { max_iterations: 0, ..as_near };
    let Fit { scenes, posterior, .. } = estimate(scenes, &all, &as_they_are, stop)?;
    Ok((Fit { scenes, posterior, ..found }, alone))
}

/// The fit of lower chi-square; the first of two equal ones.
pub fn lower(known: Fit, tried: Fit) -> Fit {
    if sum(&chi_squares(&tried)) < sum(&chi_squares(&known)) { tried } else { known }
}

/// The models of a fit without one of their effects.
pub fn without_effect(fit: &Fit, name: &str) -> Vec<Model> {
    let mut models = fit.models();
    models.iter_mut().for_each(|m| m.effects.retain(|e| e.name != name));
    models
}

/// Chi-square of each scene.
pub fn chi_squares(fit: &Fit) -> Vec<f64> {
    fit.scenes.iter().map(|s| s.reduced_chi_square * s.degrees_of_freedom as f64).collect()
}

pub fn sum(all: &[f64]) -> f64 {
    all.iter().sum()
}

/// Makes a model believe its shared numbers as firmly as a fit of other scenes knows them.
fn believe(model: &mut Model, known: &Posterior) {
    for active in &mut model.effects {
        let of = active.clone();
        for p in active.parameters.iter_mut().filter(|p| of.shares(p)) {
            let own = p.prior.sd;
            let sd = |label: &String| {
                let name = p.full_name(&of, label);
                known.estimates.iter().find(|e| e.name == name).map_or(own, |e| e.sd.min(own))
            };
            p.prior.sd = p.labels.iter().map(sd).fold(0.0, f64::max);
            p.means.clone_from(&p.values);
        }
    }
}

/// Fits one scene, from where another model of it stands if there is one; anew where that loses it.
fn fit_on(
    scene: &Scene,
    model: &Model,
    begun: Option<&Model>,
    options: &FitOptions,
    stop: Stop,
) -> Result<Fit, FitError> {
    let anew = || estimate_one(scene, model, options, stop);
    let Some(begun) = begun else { return anew() };
    let mut model = model.clone();
    model.copy_state_from(begun);
    model.copy_shared_from(begun);
    let found =
        estimate_one(scene, &model, &FitOptions { start_point: StartPoint::YawSearched, ..*options }, stop)?;
    if proof::loses(&found) { Ok(lower(found, anew()?)) } else { Ok(found) }
}

/// The models where each scene's own fit has put them, with the shared numbers that these agree on.
pub fn gathered(models: &[Model], alone: &[Fit]) -> Vec<Model> {
    let mut near = pooled(models, alone);
    for ((model, asked), fitted) in near.iter_mut().zip(models).zip(alone) {
        model.copy_state_from(&fitted.scenes[0].model);
        model.copy_priors_from(asked);
    }
    near
}

/// Puts the shared numbers of one effect where fits of scenes with it agree; beliefs stay.
pub fn agree_on(models: &mut [Model], effect: &str, alone: &[Fit]) {
    let agreed = pooled(models, alone);
    for (model, agreed) in models.iter_mut().zip(&agreed) {
        let both = model.effects.iter_mut().zip(&agreed.effects).filter(|(e, _)| e.name == effect);
        for (p, q) in both.flat_map(|(e, a)| e.parameters.iter_mut().zip(&a.parameters)) {
            p.values.clone_from(&q.values);
        }
    }
}

/// The models with shared parameters as the scenes together see them, believed as firmly as they are known.
fn pooled(models: &[Model], alone: &[Fit]) -> Vec<Model> {
    let mut all = models.to_vec();
    for active in 0..models.first().map_or(0, |m| m.effects.len()) {
        for k in 0..models[0].effects[active].parameters.len() {
            pool(&mut all, alone, active, k);
        }
    }
    all
}

/// Gives all models the mean of what the scenes say of one shared parameter, by precision; a scene that does not
/// fit counts less.
fn pool(near: &mut [Model], alone: &[Fit], active: usize, k: usize) {
    let shared = |m: &Model| {
        let effect = m.effects.get(active)?;
        effect.parameters.get(k).filter(|p| effect.shares(p)).cloned()
    };
    let mut sums: BTreeMap<String, (f64, f64)> = BTreeMap::new();
    for fitted in alone {
        let scene = &fitted.scenes[0];
        let Some(p) = shared(&scene.model) else { continue };
        for label in &p.labels {
            let name = p.full_name(&scene.model.effects[active], label);
            if let Some(e) = fitted.posterior.informative(&name, p.prior.sd) {
                let sd = e.sd.max(1e-9) * scene.reduced_chi_square.max(1.0);
                let sum = sums.entry(label.clone()).or_default();
                *sum = (sum.0 + e.value / (sd * sd), sum.1 + 1.0 / (sd * sd));
            }
        }
    }
    for model in near {
        let Some(p) = model.effects.get_mut(active).and_then(|e| e.parameters.get_mut(k)) else { continue };
        let mut least = 0.0;
        for (label, value) in p.labels.iter().zip(&mut p.values) {
            if let Some((weighted, weight)) = sums.get(label) {
                *value = weighted / weight;
                least = f64::max(least, 1.0 / weight.sqrt());
            }
        }
        if !sums.is_empty() {
            p.means.clone_from(&p.values);
            p.prior.sd = p.prior.sd.min(DOUBT * least);
        }
    }
}

/// Squared error on frames that a fit has not seen.
#[derive(Debug, Clone, Copy, Default)]
pub struct HeldOut {
    squares: f64,
    count: usize,
}

impl HeldOut {
    /// m.
    pub fn rmse(self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }
}

/// Of all scenes (m).
pub fn pooled_rmse(parts: &[HeldOut]) -> f64 {
    let sum = |a: HeldOut, b: &HeldOut| HeldOut { squares: a.squares + b.squares, count: a.count + b.count };
    parts.iter().fold(HeldOut::default(), sum).rmse()
}

/// Error of each scene on the last frames of a fit to the first ones.
pub fn held_out(
    scenes: &[Scene],
    models: &[Model],
    effect: Option<&str>,
    options: &FitOptions,
    stop: Stop,
) -> Result<Vec<HeldOut>, FitError> {
    let shown: Vec<Scene> = scenes.iter().map(first_frames).collect();
    let fitted = fit_shown(&shown, models, effect, options, None, stop)?;
    Ok(errors(scenes, &shown, &fitted))
}

fn fit_shown(
    shown: &[Scene],
    models: &[Model],
    effect: Option<&str>,
    options: &FitOptions,
    checkpoints: Option<&dyn Checkpoints>,
    stop: Stop,
) -> Result<Fit, FitError> {
    let lens = WeakFormRegression::new(shown).until(stop).kept_in(checkpoints);
    Ok(trajectories(&lens, models, effect, options, stop)?.0)
}

/// The model of the first frames, where it follows them and they tell where all objects begin.
fn follows<'f>(shown: &Scene, fitted: &'f SceneFit) -> Option<&'f Model> {
    let told = shown.tracks.iter().all(|t| t.samples.len() >= TELLING);
    (told && !proof::lost(fitted)).then_some(&fitted.model)
}

/// Error of each scene on the frames that were not shown.
fn errors(scenes: &[Scene], shown: &[Scene], fitted: &Fit) -> Vec<HeldOut> {
    let one = |((scene, part), fitted): ((&Scene, &Scene), &SceneFit)| {
        let model = &fitted.model;
        let rollout =
            simulate_observed::<f64>(model, &model.flatten(), &scene.times, &SimulationLimits::default());
        let mut sum = HeldOut::default();
        for (body, (track, seen)) in scene.tracks.iter().zip(&part.tracks).enumerate() {
            if seen.samples.len() < FEWEST {
                continue;
            }
            for s in track.samples.iter().filter(|s| s.frame >= part.times.len()) {
                if let Some(state) = rollout.states.get(s.frame).and_then(|row| row[body]) {
                    sum.squares += (state.position - s.position).norm_squared();
                    sum.count += 2;
                }
            }
        }
        sum
    };
    scenes.iter().zip(shown).zip(&fitted.scenes).map(one).collect()
}

fn first_frames(scene: &Scene) -> Scene {
    let mut part = scene.clone();
    let end = (SHOWN * scene.times.len() as f64).ceil() as usize;
    part.times.truncate(end);
    for track in &mut part.tracks {
        track.samples.retain(|s| s.frame < end);
    }
    part
}
