//! Models in trajectory space: a revision's fit, what it is worth on frames that it has not seen.

use super::force::{Free, Lens, Seen, fit_forces};
use super::screen::at_values;
use crate::fit::{Fit, FitError, FitOptions, fit};
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::{Model, trace};
use serde::{Deserialize, Serialize};

/// Share of the frames that a model is fitted to when the others are to prove it.
const SHOWN: f64 = 0.75;
/// What the force lens says is believed this many times less firmly: the data count again in the fit.
const DOUBT: f64 = 5.0;
/// Samples that a track needs before the held-out frames.
const FEWEST: usize = 5;

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
}

/// The models with beliefs about what acts between contacts as the lens has them.
pub fn believing(models: &[Model], free: &[Free], seen: &Seen) -> Vec<Model> {
    let mut models = at_values(models, free, &seen.values);
    for model in &mut models {
        for active in &mut model.effects {
            let name = active.name.clone();
            for p in active.parameters.iter_mut().filter(|p| p.prior.sd > 0.0) {
                let stem = format!("{name}.{}", p.name);
                let own = |f: &&(&Free, &f64)| {
                    f.0.name == stem || f.0.name.strip_prefix(&stem).is_some_and(|r| r.starts_with('['))
                };
                let shared = !matches!(p.scope, crate::effects::Scope::Object | crate::effects::Scope::Pair);
                let pairs: Vec<(&Free, &f64)> = free.iter().zip(&seen.sd).collect();
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
    lens: &Lens,
    models: &[Model],
    effect: Option<&str>,
    options: &FitOptions,
    stop: Stop,
) -> Result<Revision, FitError> {
    let (free, seen) = fit_forces(lens, models);
    let fit_all = fit(lens.scenes, &led(models, effect, &free, &seen), options, stop)?;
    let (mut chi_square, mut degrees, mut squares, mut count) = (0.0, 0.0, 0.0, 0.0);
    for (scene, fitted) in lens.scenes.iter().zip(&fit_all.scenes) {
        let n = 2.0 * scene.tracks.iter().map(|t| t.samples.len()).sum::<usize>() as f64;
        squares += fitted.rmse * fitted.rmse * n;
        count += n;
        degrees += fitted.degrees_of_freedom as f64;
        chi_square += fitted.reduced_chi_square * fitted.degrees_of_freedom as f64;
    }
    let mut left_out = 0.0;
    for fold in &lens.folds {
        left_out += lens.solve(models, &free, &seen.values, 4, fold).left_out;
    }
    let sigma = pooled_noise(lens);
    Ok(Revision {
        effect: effect.map(str::to_string),
        rmse: (squares / f64::max(count, 1.0)).sqrt(),
        held_out_rmse: held_out(lens.scenes, models, effect, options, stop)?,
        left_out_rmse: sigma * (left_out / lens.degrees_of_freedom().max(1) as f64).sqrt(),
        reduced_chi_square: chi_square / f64::max(degrees, 1.0),
        fit: fit_all,
    })
}

/// Root mean square of the scenes' noise (m).
pub fn pooled_noise(lens: &Lens) -> f64 {
    let squares: f64 = lens.noises.iter().map(|n| n.position * n.position).sum();
    (squares / lens.noises.len().max(1) as f64).sqrt()
}

/// Without an effect the model is fitted as it is: what it lacks would mislead the lens.
fn led(models: &[Model], effect: Option<&str>, free: &[Free], seen: &Seen) -> Vec<Model> {
    if effect.is_some() { believing(models, free, seen) } else { models.to_vec() }
}

/// Error on the last frames of a fit to the first ones (m).
fn held_out(
    scenes: &[Scene],
    models: &[Model],
    effect: Option<&str>,
    options: &FitOptions,
    stop: Stop,
) -> Result<f64, FitError> {
    let shown: Vec<Scene> = scenes.iter().map(first_frames).collect();
    let lens = Lens::new(&shown);
    let (free, seen) = fit_forces(&lens, models);
    let fitted = fit(&shown, &led(models, effect, &free, &seen), options, stop)?;
    let (mut squares, mut count) = (0.0, 0usize);
    for ((scene, part), fitted) in scenes.iter().zip(&shown).zip(&fitted.scenes) {
        let rollout = trace(&fitted.model, &scene.times);
        for (body, (track, seen)) in scene.tracks.iter().zip(&part.tracks).enumerate() {
            if seen.samples.len() < FEWEST {
                continue;
            }
            for s in track.samples.iter().filter(|s| s.frame >= part.times.len()) {
                if let Some(state) = rollout.states.get(s.frame).and_then(|row| row[body]) {
                    squares += (state.position - s.position).norm_squared();
                    count += 2;
                }
            }
        }
    }
    Ok((squares / count.max(1) as f64).sqrt())
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
