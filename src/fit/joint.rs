//! Several videos of one set-up: the shared parameters, found by consensus of the fits of the single videos.
//!
//! Starting from the mean of the per-video estimates the joint fit diverges: through many contacts a simulation no longer follows
//! its tracks if a shared parameter moves a little and the start states do not. So each video s keeps own values t_s of
//! the shared parameters, with a penalty for their distance from a common mean m, and its own states follow:
//!
//! minimise over all x_s, t_s and m:  sum_s [C_s(x_s, t_s) + sum_k (t_sk - m_k)^2 / (2 p_k^2)]
//!
//! | symbol | is |
//! |---|---|
//! | C_s | cost of video s (see `fit/problem`), x_s its start states and masses |
//! | t_sk, m_k | value of shared parameter k in video s, and its mean; in the parameter's unit |
//! | p_k | standard deviation of the penalty: at first the largest distance from the mean |
//!
//! 1. Each video is fitted by itself; m is the mean of the informative estimates, weighted by 1 / sd^2.
//! 2. p is divided by four, and each video is fitted with the penalty (a prior of mean m and sd p).
//! 3. m takes a Newton step of the cost with the t_s minimised out: with sd_s the deviation of t_s by its video alone,
//!    m += sum_s (t_s - m) / p^2 over sum_s 1 / (p^2 + sd_s^2), not beyond the least and largest t_s.
//! 4. 2. and 3. repeat until the common values cost no more than 0.1 % of chi-square. From there all scenes are fitted at once.
//!
//! A video whose fit fails is fitted once more with the others' consensus as its start.
//!
//! Sources: quadratic penalty: Nocedal and Wright, Numerical Optimization (2006), chapter 17; consensus: Boyd et al., Foundations and
//! Trends in Machine Learning 3 (2011), chapter 7.

use super::error::FitError;
use super::estimation::{estimate_by, longest};
use super::noise::{self, Noise};
use super::options::{FitOptions, StartPoint};
use super::problem::{FitProblem, GOOD, Horizon, reduced_chi_squares, worst_chi_square};
use super::result::Fit;
use super::search::{Solution, better, minimise};
use super::single::{estimate_each, estimate_one};
use crate::effects::ParamId;
use crate::num::{Stop, Stopped};
use crate::scene::Scene;
use crate::world::{Model, Parameter};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Budget share of the search of all scenes at once.
const AT_ONCE_BUDGET: f64 = 0.5;
/// Factor of the penalty's standard deviation with each step; most steps, and iterations of each.
const TIGHTENING: f64 = 0.25;
const CONSENSUS_STEPS: usize = 9;
const STEP_ITERATIONS: usize = 12;
/// Chi-square that grows by this factor shows that the videos share no values: then no long search follows.
const DIVERGED: f64 = 10.0;
const DIVERGED_ITERATIONS: usize = 5;
/// Consensus is reached if common values cost no more than this factor of chi-square, or if the penalty's deviation falls to
/// this share of the least deviation that a video leaves.
const REACHED: f64 = 1.001;
const NEGLIGIBLE_PENALTY: f64 = 1e-5;

/// Searches several scenes at once and, if that is not enough, from the consensus of their single fits.
pub(super) fn search_joint(
    problem: &FitProblem,
    frames: Horizon,
    (scenes, start): (&[Scene], &[Model]),
    options: &FitOptions,
    stop: Stop,
) -> Result<Solution, FitError> {
    let best = search_at_once(problem, frames, options, stop)?;
    let is_near = options.start_point == StartPoint::NearOptimum;
    if is_near || worst_chi_square(problem, &best.point, frames) <= GOOD {
        return Ok(best);
    }
    let models = consensus_models(scenes, start, options, stop)?;
    let tried = from_point(problem, &problem.point_of(&models), frames, options, stop)?;
    Ok(better(best, tried))
}

/// The search from the problem's models, within its share of the budget.
fn search_at_once(
    problem: &FitProblem,
    frames: Horizon,
    options: &FitOptions,
    stop: Stop,
) -> Result<Solution, Stopped> {
    problem.set_budget(AT_ONCE_BUDGET * options.budget_fraction);
    let found = from_point(problem, &problem.start(), frames, options, stop)?;
    problem.set_budget(options.budget_fraction);
    Ok(found)
}

fn from_point(
    problem: &FitProblem,
    point: &[f64],
    frames: Horizon,
    options: &FitOptions,
    stop: Stop,
) -> Result<Solution, Stopped> {
    minimise(problem, point, frames, problem.negligible_fall(), options.max_iterations, stop)
}

/// Models near the joint fit of all scenes. A scene whose own fit fails is fitted once more with the values of the others.
fn consensus_models(
    scenes: &[Scene],
    models: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Vec<Model>, FitError> {
    let near = FitOptions { start_point: StartPoint::NearOptimum, ..*options };
    let mut single = estimate_each(scenes, models, options, stop)?;
    let found = consensus(scenes, models, &single, &near, stop)?;
    let failed = |fit: &Fit| fit.scenes[0].reduced_chi_square > GOOD;
    let good = single.iter().filter(|fit| !failed(fit)).count();
    if good == 0 || good == single.len() {
        return Ok(found.models);
    }
    let again: Result<Vec<Option<Fit>>, FitError> = (scenes, models, &found.models, &single)
        .into_par_iter()
        .map(|(scene, model, found, single)| {
            let mut model = model.clone();
            model.copy_shared_from(found);
            failed(single).then(|| estimate_one(scene, &model, options, stop)).transpose()
        })
        .collect();
    for (known, tried) in single.iter_mut().zip(again?) {
        if let Some(tried) = tried
            && tried.scenes[0].reduced_chi_square < known.scenes[0].reduced_chi_square
        {
            *known = tried;
        }
    }
    Ok(consensus(scenes, models, &single, &near, stop)?.models)
}

/// Fits all scenes with common shared parameters, from the fit `single` of each; priors are those of `models`.
pub fn fit_jointly(
    scenes: &[Scene],
    models: &[Model],
    single: &[Fit],
    options: &FitOptions,
    stop: Stop,
) -> Result<Fit, FitError> {
    let near = FitOptions { start_point: StartPoint::NearOptimum, ..*options };
    let found = consensus(scenes, models, single, &near, stop)?;
    let most = near.max_iterations;
    let most = if found.diverged { most.min(DIVERGED_ITERATIONS) } else { most };
    let near = FitOptions { max_iterations: most, ..near };
    match scenes {
        [scene] => estimate_one(scene, &found.models[0], &near, stop),
        _ => estimate_by(scenes, &found.models, &near, stop, |problem, frames| {
            Ok(search_at_once(problem, frames, &near, stop)?)
        }),
    }
}

/// One shared parameter's value.
#[derive(Default)]
struct SharedValue {
    /// For each scene that informs it: which, its value, and the standard deviation by that scene alone.
    observed: Vec<(usize, f64, f64)>,
    mean: f64,
}

impl SharedValue {
    /// Sets the mean to that of the scenes, weighted by precision.
    fn average(&mut self) {
        let (sum, weights) = self.observed.iter().fold((0.0, 0.0), |(sum, weights), &(_, value, sd)| {
            (sum + value / (sd * sd), weights + 1.0 / (sd * sd))
        });
        self.mean = sum / weights;
    }

    /// Moves the mean by a Newton step of the penalised cost with the scenes' values minimised out, within their range.
    fn step(&mut self, penalty_sd: f64) {
        let (pull, stiffness) =
            self.observed.iter().fold((0.0, 0.0), |(pull, stiffness), &(_, value, sd)| {
                let variance = penalty_sd * penalty_sd;
                (pull + (value - self.mean) / variance, stiffness + 1.0 / (variance + sd * sd))
            });
        let values = self.observed.iter().map(|t| t.1);
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        self.mean = (self.mean + pull / stiffness).clamp(low, high);
    }
}

/// Shared values by the full names of the parameters.
type SharedValues = BTreeMap<String, SharedValue>;

/// Models with common shared parameters.
struct Consensus {
    models: Vec<Model>,
    /// Whether some scenes could not follow their tracks with common values.
    diverged: bool,
}

/// The models at which all scenes have the same shared values, each as near to its own motion as that can be.
fn consensus(
    scenes: &[Scene],
    models: &[Model],
    single: &[Fit],
    near: &FitOptions,
    stop: Stop,
) -> Result<Consensus, FitError> {
    let few = FitOptions { max_iterations: near.max_iterations.min(STEP_ITERATIONS), ..*near };
    let mut shared = shared_values(single);
    shared.values_mut().for_each(SharedValue::average);
    let mut current: Vec<Model> = single.iter().map(|fit| fit.scenes[0].model.clone()).collect();
    let mut penalties = penalties(&current, &shared);
    let chi_square = |fits: &[Fit]| -> f64 { fits.iter().map(|f| f.scenes[0].reduced_chi_square).sum() };
    let mut diverged = false;
    for step in 0..CONSENSUS_STEPS {
        let is_reached = || {
            let common = with_means(models, &current, &shared);
            total_chi_square(scenes, &common, stop) < REACHED * chi_square(single)
        };
        if diverged || penalties.values().all(|p| p.sd <= p.final_sd) || is_reached() {
            break;
        }
        for (name, value) in shared.iter_mut().filter(|_| step > 0) {
            if let Some(penalty) = penalties.get(&parameter_of(name)) {
                value.step(penalty.sd);
            }
        }
        penalties.values_mut().for_each(|p| p.sd = (TIGHTENING * p.sd).max(p.final_sd));
        let penalised = current.iter().zip(models);
        let penalised = penalised.map(|(model, prior)| with_penalties(model, prior, &shared, &penalties));
        let fits = estimate_each(scenes, &penalised.collect::<Vec<_>>(), &few, stop)?;
        diverged = chi_square(&fits) > DIVERGED * chi_square(single);
        current = fits.into_iter().flat_map(|f| f.scenes).map(|s| s.model).collect();
        update(&mut shared, &mut current);
    }
    Ok(Consensus { models: with_means(models, &current, &shared), diverged })
}

/// A scene's current model with the penalties as priors of its shared parameters, and the priors of `prior` else.
fn with_penalties(
    model: &Model,
    prior: &Model,
    shared: &SharedValues,
    penalties: &BTreeMap<String, Penalty>,
) -> Model {
    let mut model = model.clone();
    model.copy_priors_from(prior);
    each_shared(&mut model, |parameter, p, names| {
        let Some(penalty) = penalties.get(parameter) else { return };
        p.prior.sd = p.prior.sd.min(penalty.sd);
        let means = p.means.iter_mut().zip(names);
        means.for_each(|(mean, name)| *mean = shared.get(name).map_or(*mean, |value| value.mean));
    });
    model
}

/// Takes the scenes' current values of the shared parameters.
fn update(shared: &mut SharedValues, current: &mut [Model]) {
    for (scene, model) in current.iter_mut().enumerate() {
        each_shared(model, |_, p, names| {
            for (value, name) in p.values.iter().zip(names) {
                let observed = shared.get_mut(name).into_iter().flat_map(|s| &mut s.observed);
                observed.filter(|t| t.0 == scene).for_each(|t| t.1 = *value);
            }
        });
    }
}

/// The models at the states of `current`, with the shared values at their means.
fn with_means(models: &[Model], current: &[Model], shared: &SharedValues) -> Vec<Model> {
    let mut models = models.to_vec();
    for (model, own) in models.iter_mut().zip(current) {
        model.copy_state_from(own);
        each_shared(model, |_, p, names| {
            let values = p.values.iter_mut().zip(names);
            values.for_each(|(value, name)| *value = shared.get(name).map_or(*value, |s| s.mean));
        });
    }
    models
}

/// Sum of the scenes' reduced chi-squares at their models.
fn total_chi_square(scenes: &[Scene], models: &[Model], stop: Stop) -> f64 {
    let noises: Vec<Noise> = scenes.iter().map(noise::estimate).collect();
    let problem = FitProblem::new(scenes, models.to_vec(), &noises, stop);
    let (point, frames) = (problem.start(), longest(scenes));
    reduced_chi_squares(&problem, &point, frames).sum()
}

/// The shared values that scenes inform. A scene that does not follow its tracks counts less.
fn shared_values(single: &[Fit]) -> SharedValues {
    let mut shared = SharedValues::new();
    for (scene, fit) in single.iter().enumerate() {
        let found = &fit.scenes[0];
        each_shared(&mut found.model.clone(), |_, p, names| {
            for (value, name) in p.values.iter().zip(names) {
                if let Some(e) = fit.posterior.informative(name, p.prior.sd).filter(|e| e.sd > 0.0) {
                    let sd = e.sd * found.reduced_chi_square.max(1.0);
                    shared.entry(name.clone()).or_default().observed.push((scene, *value, sd));
                }
            }
        });
    }
    shared
}

/// Penalty for the distance of a parameter's values from their means.
struct Penalty {
    /// Standard deviation, in the parameter's unit.
    sd: f64,
    /// From here on the values are as good as the same.
    final_sd: f64,
}

/// The first penalty of each parameter, by its name.
fn penalties(current: &[Model], shared: &SharedValues) -> BTreeMap<String, Penalty> {
    let mut penalties: BTreeMap<String, Penalty> = BTreeMap::new();
    for model in current {
        each_shared(&mut model.clone(), |parameter, p, names| {
            for (value, name) in p.values.iter().zip(names) {
                let Some(s) = shared.get(name) else { continue };
                let least = s.observed.iter().map(|t| t.2).fold(f64::INFINITY, f64::min);
                let new = || Penalty { sd: 0.0, final_sd: f64::INFINITY };
                let penalty = penalties.entry(parameter.to_string()).or_insert_with(new);
                penalty.sd = penalty.sd.max((value - s.mean).abs());
                penalty.final_sd = penalty.final_sd.min(NEGLIGIBLE_PENALTY * least);
            }
        });
    }
    penalties
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
fn parameter_of(name: &str) -> String {
    ParamId::parse(name).map_or_else(|| name.to_string(), |id| id.stem().to_string())
}
