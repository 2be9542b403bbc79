//! Fits a model to what was observed: start values, damped Gauss-Newton in trajectory space, posterior.

mod anchor;
mod bounce;
mod graze;
mod grow;
mod linear;
mod noise;
mod paper;
mod posterior;
mod problem;
mod scatter;
mod solve;
mod start;
#[cfg(test)]
mod tests;
mod together;

pub use anchor::{Deviation, deviation};
pub use noise::{Noise, estimate as estimate_noise};
pub use posterior::{DRAWS, Estimate, ObjectEstimate, Posterior, SharedEstimate};
pub use together::together;

use crate::num::{Stop, Stopped};
use crate::scene::Scene;
use crate::world::{Ending, Model};
use grow::grow;
use problem::{Problem, Window};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use solve::{NEGLIGIBLE, Solution, minimise, minimise_from};
use std::slice;

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FitOptions {
    /// Most iterations, over all stages.
    pub max_iterations: usize,
    pub method: Method,
    /// Where the search begins.
    #[serde(default)]
    pub begin: Begin,
    /// Share of its work limit that the search may take: less where many models are tried of which most are wrong.
    #[serde(default = "all", skip_serializing_if = "is_all")]
    pub effort: f64,
    /// Whether it searches with derivatives of single precision, where many models are tried; deviations are of double precision
    /// always.
    #[serde(skip)]
    pub swift: bool,
}

fn all() -> f64 {
    1.0
}

fn is_all(effort: &f64) -> bool {
    *effort == all()
}

/// Where a search begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Begin {
    /// At lines through the first frames of the tracks.
    #[default]
    Tracks,
    /// At the start states that the models have.
    Models,
    /// The same, and yaws that nobody measured have been searched before.
    Turned,
    /// The same, and they are taken to be so near that windows need not grow.
    Near,
}

/// How the cost is minimised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Damped Gauss-Newton over the whole video, then over growing windows where that is not enough.
    #[default]
    GaussNewton,
    /// L-BFGS in the stages of the paper, for comparison; without its last stage, which starts the objects anew
    /// 20 frames before the video's end.
    Paper,
}

impl Default for FitOptions {
    fn default() -> Self {
        FitOptions {
            max_iterations: 200,
            method: Method::default(),
            begin: Begin::default(),
            effort: all(),
            swift: false,
        }
    }
}

/// Models of one or several videos with what is known of their parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// One a scene, in the order given.
    pub scenes: Vec<SceneFit>,
    pub posterior: Posterior,
    pub iterations: usize,
    pub outcome: Outcome,
    /// The cost of each iteration of the search that was chosen, over the frames that it saw; last the cost at its end.
    #[serde(default)]
    pub losses: Vec<f64>,
}

/// How one scene was fitted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneFit {
    pub name: String,
    /// The model at the best parameters.
    pub model: Model,
    /// Measurement noise of a position, estimated from the tracks without the model (m).
    pub noise_sigma: f64,
    /// The same of a yaw (rad); `None` where no yaw was measured.
    pub noise_yaw: Option<f64>,
    /// Root mean square of the position residuals, both coordinates pooled (m).
    pub rmse: f64,
    pub reduced_chi_square: f64,
    pub degrees_of_freedom: usize,
    /// Whether the misfit is explained by the noise.
    pub adequate: bool,
}

/// Why the fit stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    Converged,
    IterationLimit,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    #[error("no scene was given; give at least one")]
    NoScene,
    #[error("a formula of the model has no finite value where the objects of scene {scene} go; change it")]
    Undefined { scene: String },
    #[error("{scenes} scenes but {models} models were given; give one model a scene")]
    Count { scenes: usize, models: usize },
    #[error(
        "scene {scene}: {seen} positions were measured; at least {needed} are needed to fit a motion: film longer"
    )]
    TooLittleData { scene: String, seen: usize, needed: usize },
    #[error(
        "scene {scene}: the model has {model} bodies, the scene {objects} objects; use a model of this scene"
    )]
    Mismatch { scene: String, model: usize, objects: usize },
    #[error(
        "scenes {scene} and {other}: begin with the presets {presets:?}; videos that share their physics need one: fit them apart, or name one model for all"
    )]
    Worlds { scene: String, other: String, presets: [String; 2] },
    #[error("scenes {scene} and {other}: hold the same measurements; give each video once")]
    Twice { scene: String, other: String },
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

/// Fewest measured positions of a scene.
const FEWEST_SAMPLES: usize = 3;
/// Reduced chi-square up to which a fit needs no other attempt, and up to which noise explains the misfit.
const GOOD: f64 = 1.25;
const ADEQUATE: f64 = 1.5;
/// Share of all work that the search over the whole video may do before windows grow: bodies that press each other where none
/// did would take it all.
const AT_ONCE: f64 = 0.5;
/// The same when draws are tried at last.
const AT_LAST: f64 = 1.5;
/// Most iterations from another yaw; how often all bodies are gone through, and the fall of the cost, a negative log
/// likelihood, that makes it worth to do so again.
const OTHER_ITERATIONS: usize = 40;
const YAW_ROUNDS: usize = 2;
const WORTH_A_ROUND: f64 = 5.0;
/// Reduced chi-square of a scene whose simulation does not come to its end.
const BROKEN_OFF: f64 = 1e9;

/// Fits the models (one a scene, in order) to the scenes, and draws from the posterior; parameters of scope `Setup`,
/// `Material`, `Shape` and `ShapePair` are shared by all scenes. Deterministic.
pub fn fit(scenes: &[Scene], start: &[Model], options: &FitOptions, stop: Stop) -> Result<Fit, FitError> {
    check(scenes, start)?;
    drawn(scenes, estimate(scenes, start, options, stop)?, stop)
}

/// A fit of these scenes with draws from its posterior, which predictions need and the rest does not; one that has some stays
/// as it is.
pub fn drawn(scenes: &[Scene], fit: Fit, stop: Stop) -> Result<Fit, FitError> {
    if fit.draws() > 0 {
        return Ok(fit);
    }
    let noises: Vec<Noise> = scenes.iter().map(noise::estimate).collect();
    let models = fit.models();
    let mut problem = Problem::new(scenes, models, &noises, stop);
    problem.release();
    let posterior = fit.posterior.drawn(&mut problem, longest(scenes));
    stop(1.0)?;
    Ok(Fit { posterior, ..fit })
}

/// [`estimate`] of one scene.
pub fn estimate_one(scene: &Scene, start: &Model, options: &FitOptions, stop: Stop) -> Result<Fit, FitError> {
    estimate(slice::from_ref(scene), slice::from_ref(start), options, stop)
}

/// The same of each scene by itself; they share nothing.
pub fn estimate_each(
    scenes: &[Scene],
    start: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Vec<Fit>, FitError> {
    (scenes, start).into_par_iter().map(|(scene, start)| estimate_one(scene, start, options, stop)).collect()
}

/// Frames of the longest of the scenes.
fn longest(scenes: &[Scene]) -> Window {
    scenes.iter().map(|s| s.times.len()).max().unwrap_or(0)
}

/// Fits without draws from the posterior, and without the checks that are dear.
pub fn estimate(
    scenes: &[Scene],
    start: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Fit, FitError> {
    check_each(scenes, start)?;
    let noises: Vec<Noise> = scenes.iter().map(noise::estimate).collect();
    let mut models = start.to_vec();
    models.iter_mut().for_each(|m| m.anchors.clear());
    if options.begin == Begin::Tracks {
        for ((scene, model), noise) in scenes.iter().zip(&mut models).zip(&noises) {
            start::from_tracks(scene, model, noise);
        }
    }
    let mut problem = Problem::new(scenes, models, &noises, stop);
    problem.allow(options.effort);
    problem.hurry(options.swift && options.method == Method::GaussNewton);
    let frames = longest(scenes);
    let best = match options.method {
        Method::GaussNewton => {
            let found = match scenes.len() {
                1 => gauss_newton(&problem, frames, options, stop)?,
                _ => of_set_up(&problem, frames, scenes, start, options, stop)?,
            };
            let released = problem.release();
            problem.hurry(false);
            if options.swift || released.contains(&true) {
                let linear = found.linear.filter(|_| !options.swift);
                let found = Solution { linear, ..found };
                refined(&problem, found, &released, frames, options.max_iterations, stop)?
            } else {
                found
            }
        }
        Method::Paper => {
            problem.release();
            paper::minimise(&problem, frames, options.max_iterations, stop)?
        }
    };
    for part in &problem.parts {
        if part.rollout(&problem.free, &best.point, frames).ending == Ending::FormulaUndefined {
            return Err(FitError::Undefined { scene: part.scene.name.clone() });
        }
    }
    let posterior = Posterior::at(&problem, &best.point, frames);
    stop(1.0)?;
    let fits = (0..scenes.len()).map(|i| scene_fit(&problem, i, &best.point, frames)).collect();
    let Solution { iterations, outcome, losses, .. } = best;
    Ok(Fit { scenes: fits, posterior, iterations, outcome, losses })
}

/// The model as a fit from tracks begins with it: at lines through the first frames.
pub fn beginning(scene: &Scene, start: &Model) -> Model {
    let mut model = start.clone();
    start::from_tracks(scene, &mut model, &noise::estimate(scene));
    model
}

/// Fits several scenes at once, and from where each by itself leads where that is not enough.
fn of_set_up(
    problem: &Problem,
    frames: usize,
    scenes: &[Scene],
    start: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Solution, FitError> {
    let search =
        |point: &[f64]| minimise(problem, point, frames, problem.negligible(), options.max_iterations, stop);
    problem.allow(AT_ONCE * options.effort);
    let best = search(&problem.start())?;
    problem.allow(options.effort);
    if options.begin == Begin::Near || worst_chi_square(problem, &best.point, frames) <= GOOD {
        return Ok(best);
    }
    let begun = together::begun(scenes, start, options, stop)?;
    Ok(better(best, search(&problem.at(&begun))?))
}

fn gauss_newton(
    problem: &Problem,
    frames: usize,
    options: &FitOptions,
    stop: Stop,
) -> Result<Solution, FitError> {
    let budget = options.max_iterations;
    let enough = problem.negligible();
    let turned = matches!(options.begin, Begin::Turned | Begin::Near);
    problem.allow(AT_ONCE * options.effort);
    let mut best = match turned {
        true => minimise(problem, &problem.start(), frames, enough, budget, stop)?,
        false => of_any_yaw(problem, &problem.start(), frames, budget, stop)?,
    };
    problem.allow(options.effort);
    let good = |best: &Solution| worst_chi_square(problem, &best.point, frames) <= GOOD;
    if options.begin != Begin::Near && good(&best) {
        return Ok(best);
    }
    if options.begin != Begin::Near && !problem.is_exhausted() {
        let grown = grow(problem, problem.start(), frames, budget, stop)?;
        let turned = match start::unseen_yaws(problem)[..] {
            _ if turned => None,
            [] => None,
            _ => Some(of_any_yaw(problem, &grown.point, frames, budget, stop)?),
        };
        best = better(best, grown);
        best = turned.into_iter().fold(best, better);
    }
    'spins: for other in start::other_spins(problem, &best.point) {
        // On the whole video first: in a window that ends before its spin matters, a ball forgets it.
        for whole in [true, false] {
            if problem.is_exhausted() || good(&best) {
                break 'spins;
            }
            let tried = if whole {
                minimise(problem, &other, frames, enough, budget, stop)?
            } else {
                grow(problem, other.clone(), frames, budget, stop)?
            };
            best = better(best, tried);
        }
    }
    if options.begin != Begin::Near {
        problem.allow(AT_LAST * options.effort);
        best = scattered(problem, best, frames, budget, stop)?;
    }
    Ok(best)
}

/// The fit from points as likely by the frames that it follows, as long as they lead on and it is not good.
fn scattered(
    problem: &Problem,
    mut best: Solution,
    frames: usize,
    budget: usize,
    stop: Stop,
) -> Result<Solution, FitError> {
    while worst_chi_square(problem, &best.point, frames) > GOOD && !problem.is_exhausted() {
        let (before, followed) = (best.cost, grow::first_lost(problem, &best.point, frames));
        for other in scatter::others(problem, &best.point, followed.unwrap_or(frames), frames, stop)? {
            best = better(best, minimise(problem, &other, frames, problem.negligible(), budget, stop)?);
        }
        if before - best.cost < WORTH_A_ROUND {
            break;
        }
    }
    Ok(best)
}

/// The fit from `found` on, where the parameters that were `released` are free, too.
fn refined(
    problem: &Problem,
    found: Solution,
    released: &[bool],
    frames: usize,
    budget: usize,
    stop: Stop,
) -> Result<Solution, FitError> {
    let Solution { point, linear, .. } = found;
    let linear = linear.map(|known| problem.completed(known, released, &point, frames));
    let refined = minimise_from(problem, point, linear, frames, NEGLIGIBLE, budget, stop)?;
    let iterations = found.iterations + refined.iterations;
    let losses = [&found.losses[..], &refined.losses].concat();
    Ok(Solution { iterations, losses, ..refined })
}

/// The best fit from `start`, and from other yaws of bodies whose yaw was not measured, one body after the other. A wrong
/// side that is hit may fit well enough to be called good, so that all are compared.
fn of_any_yaw(
    problem: &Problem,
    start: &[f64],
    frames: usize,
    budget: usize,
    stop: Stop,
) -> Result<Solution, FitError> {
    let unseen = start::unseen_yaws(problem);
    if unseen.is_empty() {
        return minimise(problem, start, frames, problem.negligible(), budget, stop);
    }
    // None is worth being followed to its very end before it is the best.
    let few = budget.min(OTHER_ITERATIONS);
    let mut best = minimise(problem, start, frames, problem.negligible(), few, stop)?;
    for _ in 0..YAW_ROUNDS {
        let before = best.cost;
        for &(k, others) in &unseen {
            let from = best.point.clone();
            for other in 1..=others {
                if problem.is_exhausted() {
                    return Ok(best);
                }
                let mut point = from.clone();
                point[k] += other as f64 * start::YAW_STEP;
                best = better(best, minimise(problem, &point, frames, problem.negligible(), few, stop)?);
            }
        }
        if before - best.cost < WORTH_A_ROUND {
            break;
        }
    }
    if best.outcome == Outcome::IterationLimit {
        let further = minimise(problem, &best.point, frames, problem.negligible(), budget, stop)?;
        best = better(best, further);
    }
    Ok(best)
}

/// The one of lower cost, with the iterations of both.
fn better(known: Solution, tried: Solution) -> Solution {
    let iterations = known.iterations + tried.iterations;
    let best = if tried.cost < known.cost { tried } else { known };
    Solution { iterations, ..best }
}

/// Whether the scenes, each filmed once, can share the physics of the models.
pub fn check(scenes: &[Scene], models: &[Model]) -> Result<(), FitError> {
    check_each(scenes, models)?;
    let (first, preset) = (&scenes[0].name, &models[0].preset);
    if let Some(k) = models.iter().position(|m| m.preset != *preset) {
        let presets = [preset.clone(), models[k].preset.clone()];
        return Err(FitError::Worlds { scene: first.clone(), other: scenes[k].name.clone(), presets });
    }
    for (k, scene) in scenes.iter().enumerate() {
        let same = |s: &&Scene| s.times == scene.times && s.tracks == scene.tracks;
        if let Some(other) = scenes[k + 1..].iter().find(same) {
            return Err(FitError::Twice { scene: scene.name.clone(), other: other.name.clone() });
        }
    }
    Ok(())
}

/// Whether the models can be fitted to the scenes at all.
fn check_each(scenes: &[Scene], models: &[Model]) -> Result<(), FitError> {
    if scenes.is_empty() {
        return Err(FitError::NoScene);
    }
    if scenes.len() != models.len() {
        return Err(FitError::Count { scenes: scenes.len(), models: models.len() });
    }
    for (scene, model) in scenes.iter().zip(models) {
        let name = || scene.name.clone();
        if model.bodies.len() != scene.objects.len() || scene.tracks.len() != scene.objects.len() {
            let (model, objects) = (model.bodies.len(), scene.objects.len());
            return Err(FitError::Mismatch { scene: name(), model, objects });
        }
        let seen = scene.tracks.iter().map(|t| t.samples.len()).sum();
        if seen < FEWEST_SAMPLES {
            return Err(FitError::TooLittleData { scene: name(), seen, needed: FEWEST_SAMPLES });
        }
    }
    Ok(())
}

fn worst_chi_square(problem: &Problem, point: &[f64], frames: usize) -> f64 {
    chi_squares(problem, point, frames).fold(0.0, f64::max)
}

/// Reduced chi-square of each scene.
fn chi_squares(problem: &Problem, point: &[f64], frames: usize) -> impl Iterator<Item = f64> {
    (0..problem.parts.len()).map(move |i| scene_fit(problem, i, point, frames).reduced_chi_square)
}

/// Sum of the scenes' reduced chi-squares where their models stand.
fn misfit(scenes: &[Scene], models: &[Model], stop: Stop) -> f64 {
    let noises: Vec<Noise> = scenes.iter().map(noise::estimate).collect();
    let problem = Problem::new(scenes, models.to_vec(), &noises, stop);
    let (point, frames) = (problem.start(), longest(scenes));
    chi_squares(&problem, &point, frames).sum()
}

fn scene_fit(problem: &Problem, index: usize, point: &[f64], frames: usize) -> SceneFit {
    let part = &problem.parts[index];
    let rollout = part.rollout(&problem.free, point, frames);
    let (squares, positions) = part.position_error(&rollout, frames);
    let (mut chi_square, mut count) = (0.0, 0usize);
    part.each_residual(&rollout, frames, |_, r, _| {
        chi_square += r * r;
        count += 1;
    });
    let parameters = problem.free.iter().filter(|f| f.scene == Some(index) && f.sd > 1.0).count();
    let degrees_of_freedom = count.saturating_sub(parameters).max(1);
    // A simulation that does not come to its end follows nothing.
    let completed = rollout.ending == Ending::Completed;
    let reduced_chi_square = if completed { chi_square / degrees_of_freedom as f64 } else { BROKEN_OFF };
    SceneFit {
        name: part.scene.name.clone(),
        model: problem.model(index, point),
        noise_sigma: part.noise.position,
        noise_yaw: part.noise.yaw,
        rmse: (squares / positions.max(1) as f64).sqrt(),
        reduced_chi_square,
        degrees_of_freedom,
        adequate: reduced_chi_square <= ADEQUATE,
    }
}
