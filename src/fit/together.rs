//! Several videos of one set-up: the numbers that they share, drawn together from where each video by itself has them.
//!
//! From a mean of these no search finds back: a video of many contacts is lost when a shared number moves by more than a
//! trace and the start states stay. So each keeps numbers of its own, held to a common mean ever more firmly, and its states
//! follow (quadratic penalty and consensus: Nocedal and Wright, Numerical Optimization, ch. 17; Boyd et al., Foundations and
//! Trends in Machine Learning 3 (2011) ch. 7).

use super::{Begin, Fit, FitError, FitOptions, GOOD, estimate, estimate_each, estimate_one, misfit};
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::{Model, Parameter};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// The spread that numbers are allowed falls to this share of itself with each step; most steps, and iterations of each.
const CLOSER: f64 = 0.25;
const STEPS: usize = 9;
const ITERATIONS: usize = 12;
/// Where the videos leave their noise by this much (share of chi-square) they have no numbers in common: no long search finds any.
const PARTED: f64 = 10.0;
const PARTED_ITERATIONS: usize = 5;
/// They are near enough for a search of all at once where common numbers cost no more than this (share of chi-square).
const NEAR: f64 = 1.001;
/// They are as good as common within this share of the least deviation that a video leaves.
const COMMON: f64 = 1e-5;

/// Models near the joint fit of all scenes: each is fitted by itself, and one that is lost once more with what the others say.
pub(super) fn begun(
    scenes: &[Scene],
    models: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Vec<Model>, FitError> {
    let near = FitOptions { begin: Begin::Near, ..*options };
    let mut alone = estimate_each(scenes, models, options, stop)?;
    let drawn = drawn_together(scenes, models, &alone, &near, stop)?;
    let lost = |fit: &Fit| fit.scenes[0].reduced_chi_square > GOOD;
    let followed = alone.iter().filter(|fit| !lost(fit)).count();
    if followed == 0 || followed == alone.len() {
        return Ok(drawn.models);
    }
    let again: Result<Vec<Option<Fit>>, FitError> = (scenes, models, &drawn.models, &alone)
        .into_par_iter()
        .map(|(scene, model, drawn, alone)| {
            let mut model = model.clone();
            model.take_shared(drawn);
            lost(alone).then(|| estimate_one(scene, &model, options, stop)).transpose()
        })
        .collect();
    for (known, tried) in alone.iter_mut().zip(again?) {
        if let Some(tried) = tried
            && tried.scenes[0].reduced_chi_square < known.scenes[0].reduced_chi_square
        {
            *known = tried;
        }
    }
    Ok(drawn_together(scenes, models, &alone, &near, stop)?.models)
}

/// Fits all scenes with common numbers, from where each stands in its fit `alone`; beliefs are those of `models`.
pub fn together(
    scenes: &[Scene],
    models: &[Model],
    alone: &[Fit],
    options: &FitOptions,
    stop: Stop,
) -> Result<Fit, FitError> {
    let near = FitOptions { begin: Begin::Near, ..*options };
    let drawn = drawn_together(scenes, models, alone, &near, stop)?;
    let most = if drawn.parted { near.max_iterations.min(PARTED_ITERATIONS) } else { near.max_iterations };
    estimate(scenes, &drawn.models, &FitOptions { max_iterations: most, ..near }, stop)
}

/// One number that scenes share.
#[derive(Default)]
struct Common {
    /// For each scene that tells of it: which, its value, and its deviation by that scene alone.
    told: Vec<(usize, f64, f64)>,
    mean: f64,
}

impl Common {
    /// The mean by precision.
    fn begin(&mut self) {
        let (sum, weights) = self.told.iter().fold((0.0, 0.0), |(sum, weights), &(_, value, sd)| {
            (sum + value / (sd * sd), weights + 1.0 / (sd * sd))
        });
        self.mean = sum / weights;
    }

    /// Moves the mean by a Newton step of the penalised cost with the scenes' values minimised out, not beyond these.
    fn follow(&mut self, spread: f64) {
        let (pull, stiffness) = self.told.iter().fold((0.0, 0.0), |(pull, stiffness), &(_, value, sd)| {
            let held = spread * spread;
            (pull + (value - self.mean) / held, stiffness + 1.0 / (held + sd * sd))
        });
        let values = self.told.iter().map(|t| t.1);
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        self.mean = (self.mean + pull / stiffness).clamp(low, high);
    }
}

/// Models that have the shared numbers in common.
struct Drawn {
    models: Vec<Model>,
    /// Whether not all scenes could be followed so far.
    parted: bool,
}

/// The models where all scenes have the same numbers, as near to their own motions as that can be.
fn drawn_together(
    scenes: &[Scene],
    models: &[Model],
    alone: &[Fit],
    near: &FitOptions,
    stop: Stop,
) -> Result<Drawn, FitError> {
    let few = FitOptions { max_iterations: near.max_iterations.min(ITERATIONS), ..*near };
    let mut common = told(alone);
    common.values_mut().for_each(Common::begin);
    let mut stand: Vec<Model> = alone.iter().map(|a| a.scenes[0].model.clone()).collect();
    let mut spreads = spreads(&stand, &common);
    let apart = |fits: &[Fit]| -> f64 { fits.iter().map(|f| f.scenes[0].reduced_chi_square).sum() };
    let mut parted = false;
    for step in 0..STEPS {
        let enough = || misfit(scenes, &as_one(models, &stand, &common), stop) < NEAR * apart(alone);
        if parted || spreads.values().all(|s| s.now <= s.enough) || enough() {
            break;
        }
        for (name, c) in common.iter_mut().filter(|_| step > 0) {
            if let Some(spread) = spreads.get(stem_of(name)) {
                c.follow(spread.now);
            }
        }
        spreads.values_mut().for_each(|s| s.now = (CLOSER * s.now).max(s.enough));
        let held = stand.iter().zip(models).map(|(model, asked)| {
            let mut model = model.clone();
            model.believe_as(asked);
            each_shared(&mut model, |stem, p, names| {
                let Some(spread) = spreads.get(stem) else { return };
                p.prior.sd = p.prior.sd.min(spread.now);
                let means = p.means.iter_mut().zip(names);
                means.for_each(|(mean, name)| *mean = common.get(name).map_or(*mean, |c| c.mean));
            });
            model
        });
        let held: Vec<Model> = held.collect();
        let fits = estimate_each(scenes, &held, &few, stop)?;
        parted = apart(&fits) > PARTED * apart(alone);
        stand = fits.into_iter().flat_map(|f| f.scenes).map(|s| s.model).collect();
        for (scene, model) in stand.iter_mut().enumerate() {
            each_shared(model, |_, p, names| {
                for (value, name) in p.values.iter().zip(names) {
                    let told = common.get_mut(name).into_iter().flat_map(|c| &mut c.told);
                    told.filter(|t| t.0 == scene).for_each(|t| t.1 = *value);
                }
            });
        }
    }
    Ok(Drawn { models: as_one(models, &stand, &common), parted })
}

/// The models where each scene stands, with the shared numbers at their means.
fn as_one(models: &[Model], stand: &[Model], common: &BTreeMap<String, Common>) -> Vec<Model> {
    let mut models = models.to_vec();
    for (model, own) in models.iter_mut().zip(stand) {
        model.stand_as(own);
        each_shared(model, |_, p, names| {
            let values = p.values.iter_mut().zip(names);
            values.for_each(|(value, name)| *value = common.get(name).map_or(*value, |c| c.mean));
        });
    }
    models
}

/// By their full names, the shared numbers that scenes tell of. A scene that is not followed counts less.
fn told(alone: &[Fit]) -> BTreeMap<String, Common> {
    let mut common: BTreeMap<String, Common> = BTreeMap::new();
    for (scene, fit) in alone.iter().enumerate() {
        let found = &fit.scenes[0];
        each_shared(&mut found.model.clone(), |_, p, names| {
            for (value, name) in p.values.iter().zip(names) {
                if let Some(e) = fit.posterior.told(name, p.prior.sd).filter(|e| e.sd > 0.0) {
                    let sd = e.sd * found.reduced_chi_square.max(1.0);
                    common.entry(name.clone()).or_default().told.push((scene, *value, sd));
                }
            }
        });
    }
    common
}

/// How far the values of one parameter may be from their means.
struct Spread {
    now: f64,
    /// From here on they are as good as the same.
    enough: f64,
}

/// The spread of each parameter's values, by its name.
fn spreads(stand: &[Model], common: &BTreeMap<String, Common>) -> BTreeMap<String, Spread> {
    let mut spreads: BTreeMap<String, Spread> = BTreeMap::new();
    for model in stand {
        each_shared(&mut model.clone(), |stem, p, names| {
            for (value, name) in p.values.iter().zip(names) {
                let Some(c) = common.get(name) else { continue };
                let least = c.told.iter().map(|t| t.2).fold(f64::INFINITY, f64::min);
                let new = || Spread { now: 0.0, enough: f64::INFINITY };
                let spread = spreads.entry(stem.to_string()).or_insert_with(new);
                spread.now = spread.now.max((value - c.mean).abs());
                spread.enough = spread.enough.min(COMMON * least);
            }
        });
    }
    spreads
}

/// Calls `f(name, parameter, full name of each value)` for each free parameter that scenes share.
fn each_shared(model: &mut Model, mut f: impl FnMut(&str, &mut Parameter, &[String])) {
    for active in model.effects.iter_mut().filter(|e| e.on) {
        let of = active.clone();
        for p in active.parameters.iter_mut().filter(|p| p.prior.sd > 0.0 && of.shares(p)) {
            let names: Vec<String> = p.labels.iter().map(|label| p.full_name(&of, label)).collect();
            f(&p.full_name(&of, ""), p, &names);
        }
    }
}

/// The parameter's name in the full name of one of its values.
fn stem_of(name: &str) -> &str {
    name.split_once('[').map_or(name, |(stem, _)| stem)
}
