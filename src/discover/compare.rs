//! Residuals of a fit: per object, frame and regime, whether they are white, and what the model is worth on frames
//! that it has not seen.

use super::revise::held_out;
use super::smooth_track::{SmoothTrack, paths};
use crate::fit::{Fit, FitError, FitOptions, estimate_noise};
use crate::num::{Stop, elementary};
use crate::scene::Scene;
use crate::world::{Model, SimulationLimits, simulate_observed};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Regimes of bodies that touch nothing.
pub const FAST_FREE: &str = "fast free motion";
pub const SLOW_FREE: &str = "slow free motion";
/// Between slow and fast (m/s).
pub const FAST: f64 = 0.5;
/// Frames after a contact in which what happens next shows.
const AFTERMATH: usize = 12;
/// Speed of rest (m/s).
const REST: f64 = 0.04;
/// A regime with fewer residuals says nothing.
const FEWEST: usize = 10;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    pub scenes: Vec<SceneComparison>,
    /// One sentence for people: how good, and where it fails.
    pub summary: String,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneComparison {
    pub name: String,
    /// Root mean square position residual and measurement noise (m).
    pub rmse: f64,
    pub noise_sigma: f64,
    pub reduced_chi_square: f64,
    pub degrees_of_freedom: usize,
    /// On the last quarter of the frames, fitted without them (m).
    pub held_out_rmse: f64,
    pub objects: Vec<ObjectComparison>,
    pub regimes: Vec<Regime>,
    /// Root mean square residual of each frame (m): error against horizon. `NaN`-free: 0 where nothing was seen.
    pub by_frame: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ObjectComparison {
    pub id: u32,
    pub rmse: f64,
    /// Largest residual (m), and its frame.
    pub worst: f64,
    pub worst_frame: usize,
    pub reduced_chi_square: f64,
    /// Correlation of residuals of neighbouring frames: 0 is white, 1 is drift.
    pub autocorrelation: f64,
}

/// Residuals of one part of the motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Regime {
    pub regime: String,
    pub rmse: f64,
    pub reduced_chi_square: f64,
    /// Frames of objects, summed over objects.
    pub frames: usize,
}

/// One residual of a position.
#[derive(Clone, Copy)]
struct PositionResidual {
    object: usize,
    frame: usize,
    /// Simulated minus measured (m).
    x: f64,
    y: f64,
}

/// Compares the scenes with the fit's models. `options` are those of the fit that the last frames do not enter.
pub fn compare(
    scenes: &[Scene],
    fit: &Fit,
    options: &FitOptions,
    stop: Stop,
) -> Result<Comparison, FitError> {
    let models = fit.models();
    crate::fit::check(scenes, &models)?;
    let held_out = held_out(scenes, &models, None, options, stop)?;
    let compared: Vec<SceneComparison> = scenes
        .iter()
        .zip(&fit.scenes)
        .zip(held_out)
        .map(|((scene, fitted), held_out)| {
            let noise = estimate_noise(scene);
            let residuals = residuals(scene, &fitted.model);
            SceneComparison {
                name: scene.name.clone(),
                rmse: rms(residuals.iter()),
                noise_sigma: noise.position,
                reduced_chi_square: fitted.reduced_chi_square,
                degrees_of_freedom: fitted.degrees_of_freedom,
                held_out_rmse: held_out.rmse(),
                objects: objects(scene, &residuals, noise.position),
                regimes: regimes(scene, &paths(scene, &noise), &residuals, noise.position),
                by_frame: (0..scene.times.len())
                    .map(|f| rms(residuals.iter().filter(|r| r.frame == f)))
                    .collect(),
            }
        })
        .collect();
    Ok(Comparison { summary: summary(&compared), scenes: compared })
}

/// Residuals of a model by regime.
pub fn failures(scene: &Scene, model: &Model) -> Vec<Regime> {
    let noise = estimate_noise(scene);
    regimes(scene, &paths(scene, &noise), &residuals(scene, model), noise.position)
}

fn residuals(scene: &Scene, model: &Model) -> Vec<PositionResidual> {
    let rollout =
        simulate_observed::<f64>(model, &model.flatten(), &scene.times, &SimulationLimits::default());
    let of = |(object, track): (usize, &crate::scene::Track)| {
        let at = |s: &crate::scene::Sample| {
            let state = rollout.states.get(s.frame)?.get(object).copied().flatten()?;
            let d = state.position - s.position;
            Some(PositionResidual { object, frame: s.frame, x: d.x, y: d.y })
        };
        track.samples.iter().filter_map(at).collect::<Vec<_>>()
    };
    scene.tracks.iter().enumerate().flat_map(of).collect()
}

fn rms<'r>(residuals: impl Iterator<Item = &'r PositionResidual>) -> f64 {
    let (sum, count) = residuals.fold((0.0, 0.0), |(s, n), r| (s + r.x * r.x + r.y * r.y, n + 2.0));
    (sum / f64::max(count, 1.0)).sqrt()
}

fn objects(scene: &Scene, residuals: &[PositionResidual], sigma: f64) -> Vec<ObjectComparison> {
    let one = |(index, object): (usize, &crate::scene::Object)| {
        let own: Vec<&PositionResidual> = residuals.iter().filter(|r| r.object == index).collect();
        let size = |r: &PositionResidual| elementary::hypot(r.x, r.y);
        let worst = own.iter().max_by(|a, b| size(a).total_cmp(&size(b)));
        let rmse = rms(own.iter().copied());
        let products: f64 = own.windows(2).map(|w| w[0].x * w[1].x + w[0].y * w[1].y).sum();
        let squares: f64 = own.iter().map(|r| r.x * r.x + r.y * r.y).sum();
        ObjectComparison {
            id: object.id,
            rmse,
            worst: worst.map_or(0.0, |r| size(r)),
            worst_frame: worst.map_or(0, |r| r.frame),
            reduced_chi_square: elementary::powi(rmse / sigma, 2),
            autocorrelation: if squares > 0.0 { products / squares } else { 0.0 },
        }
    };
    scene.objects.iter().enumerate().map(one).collect()
}

/// Where the simulations of two models of one scene are farthest apart, in one regime.
#[derive(Debug, Clone, PartialEq)]
pub struct Separation {
    pub regime: String,
    /// Root mean square distance of a coordinate (m) over the regime's frames of objects.
    pub rms: f64,
    pub frames: usize,
    /// The largest distance (m), its object and its frame.
    pub largest: f64,
    pub object: u32,
    pub frame: usize,
}

/// How far two models of a scene are apart, regime by regime, where the scene was measured; the largest first.
pub fn separations(scene: &Scene, models: [&Model; 2]) -> Vec<Separation> {
    let noise = estimate_noise(scene);
    let smooth = paths(scene, &noise);
    let [a, b] = models.map(|model| residuals(scene, model));
    let others: BTreeMap<(usize, usize), &PositionResidual> =
        b.iter().map(|r| ((r.object, r.frame), r)).collect();
    let between = |r: &PositionResidual| {
        let other = others.get(&(r.object, r.frame))?;
        Some(PositionResidual { x: r.x - other.x, y: r.y - other.y, ..*r })
    };
    let apart: Vec<PositionResidual> = a.iter().filter_map(between).collect();
    let size = |r: &PositionResidual| elementary::hypot(r.x, r.y);
    let one = |(regime, belongs): (String, Belongs)| {
        let own = || apart.iter().filter(|r| belongs(r.object, r.frame));
        let most = own().max_by(|a, b| size(a).total_cmp(&size(b)))?;
        Some(Separation {
            regime,
            rms: rms(own()),
            frames: own().count(),
            largest: size(most),
            object: scene.objects.get(most.object)?.id,
            frame: most.frame,
        })
    };
    let mut all: Vec<Separation> = motion_regimes(&smooth).into_iter().filter_map(one).collect();
    all.sort_by(|a, b| b.largest.total_cmp(&a.largest));
    all
}

/// Whether something is in a regime: index of the object, frame.
type Belongs<'a> = Box<dyn Fn(usize, usize) -> bool + 'a>;

/// The regimes by how an object moves: each of its frames is in one or more of them.
fn motion_regimes(paths: &[SmoothTrack]) -> Vec<(String, Belongs<'_>)> {
    let near = move |i: usize, f: usize| paths[i].near.iter().any(|n| n.0 == f);
    let after = move |i: usize, f: usize| (1..=AFTERMATH).any(|k| f >= k && near(i, f - k)) && !near(i, f);
    let hit =
        move |i: usize, f: usize| paths[i].jumps.iter().any(|j| (j.frame..j.frame + AFTERMATH).contains(&f));
    let speed = move |i: usize, f: usize| paths[i].motion[f].map_or(0.0, |k| k.velocity.norm());
    let free = move |i: usize, f: usize| !near(i, f) && !after(i, f) && !hit(i, f) && speed(i, f) > REST;
    vec![
        (FAST_FREE.into(), Box::new(move |i, f| free(i, f) && speed(i, f) >= FAST)),
        (SLOW_FREE.into(), Box::new(move |i, f| free(i, f) && speed(i, f) < FAST)),
        ("near another object".into(), Box::new(near)),
        ("after a contact".into(), Box::new(after)),
        ("after an unexplained change of velocity".into(), Box::new(hit)),
        (
            "at rest".into(),
            Box::new(move |i, f| !near(i, f) && !after(i, f) && !hit(i, f) && speed(i, f) <= REST),
        ),
    ]
}

fn regimes(scene: &Scene, paths: &[SmoothTrack], residuals: &[PositionResidual], sigma: f64) -> Vec<Regime> {
    let mut all = motion_regimes(paths);
    let mut looks: Vec<(String, &str, &str)> = vec![];
    for o in &scene.objects {
        let name = format!("{} {}", o.material, o.shape.word()).trim().to_string();
        let look = (name, o.shape.word(), o.material.as_str());
        if !looks.contains(&look) {
            looks.push(look);
        }
    }
    for (name, shape, material) in looks {
        let is = move |i: usize, _| {
            let o: &crate::scene::Object = &scene.objects[i];
            o.shape.word() == shape && o.material == material
        };
        all.push((name, Box::new(is)));
    }
    let regime = |(name, belongs): (String, Belongs)| {
        let own: Vec<&PositionResidual> = residuals.iter().filter(|r| belongs(r.object, r.frame)).collect();
        let rmse = rms(own.iter().copied());
        let reduced_chi_square = elementary::powi(rmse / sigma, 2);
        // What holds everywhere says nothing of where the model fails.
        (FEWEST..residuals.len()).contains(&own.len()).then_some(Regime {
            regime: name,
            rmse,
            reduced_chi_square,
            frames: own.len(),
        })
    };
    all.into_iter().filter_map(regime).collect()
}

fn summary(scenes: &[SceneComparison]) -> String {
    let degrees: f64 = scenes.iter().map(|s| s.degrees_of_freedom as f64).sum();
    let chi: f64 = scenes.iter().map(|s| s.reduced_chi_square * s.degrees_of_freedom as f64).sum();
    let reduced = chi / f64::max(degrees, 1.0);
    if reduced < super::MISFIT {
        return format!("the noise explains the residuals: reduced chi-square {reduced:.2}");
    }
    let all = scenes.iter().flat_map(|s| s.regimes.iter().map(move |r| (s, r)));
    let worst = all
        .max_by(|a, b| excess(a.1).total_cmp(&excess(b.1)))
        .map(|(s, r)| format!(" most at {}: {}", s.name, r.regime));
    format!("reduced chi-square {reduced:.2}: the model fails{}", worst.unwrap_or_default())
}

fn excess(r: &Regime) -> f64 {
    (r.reduced_chi_square - 1.0) * r.frames as f64
}
