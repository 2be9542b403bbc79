//! Measures the fit, the predictions and the counterfactuals on scenes whose truth is known:
//!
//! `cargo run --release --example figures -- [--preset NAME] DIR...`, each a folder of scenes or of such folders. The
//! default preset depends on the world of the scene.
//!
//! A scene is a folder with `observed.json` (what is fitted) and `truth.json` (read for scoring only). Position errors
//! are distances in the plane over the frames in which the true object is in view; noise is per coordinate.

use serde_json::Value as Json;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;
use vrdp::fit::{Fit, FitOptions, estimate, with_draws};
use vrdp::num::{Differential, Jet, Real, Vec2, never, vec2};
use vrdp::reason::{Prediction, PredictionRequest, predict};
use vrdp::scene::{Camera, Scene, parse};
use vrdp::world::{
    BODY_VALUES, EventKind, Intervention, MASS, Model, Preset, SimulationLimits, simulate, trace,
};

/// Image size in pixels if the truth has a camera, and the height of the object centres (m).
const IMAGE_SIZE: [f64; 2] = [480.0, 320.0];
const HEIGHT: f64 = 0.2;
/// Number of simulations in the ensemble.
const ROLLOUTS: usize = 32;
/// Largest number of compared frames of a counterfactual.
const KEYFRAMES: usize = 26;
/// Number of runs whose median gives the rollout time.
const RUNS: usize = 15;
/// Steps of central differences, in parameter units; the best agreement counts. Small steps are needed in crowded scenes,
/// where larger ones change the order of events.
const STEPS: [f64; 4] = [1e-5, 1e-6, 1e-7, 1e-8];
/// Largest relative difference of gradients that agree.
const AGREES: f64 = 1e-4;

fn main() -> Result<(), Box<dyn Error>> {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let mut preset = None;
    if let [flag, name, ..] = &words[..]
        && flag == "--preset"
    {
        preset = Some(Preset::named(name).ok_or_else(|| format!("unknown preset {name}"))?);
        words.drain(..2);
    }
    let folders: Vec<PathBuf> = words.into_iter().map(PathBuf::from).collect();
    if folders.is_empty() {
        return Err("give folders of scenes: figures [--preset NAME] DIR...".into());
    }
    for folder in folders {
        let mut scenes = vec![];
        find(&folder, &mut scenes)?;
        let mut figures = Figures::default();
        for scene in &scenes {
            figures.measure(scene, preset).map_err(|e| format!("{}: {e}", scene.display()))?;
        }
        println!("{} ({} scenes)", folder.display(), scenes.len());
        figures.print();
    }
    Ok(())
}

/// Finds the folders with an observation and its truth, in order of name.
fn find(folder: &Path, scenes: &mut Vec<PathBuf>) -> Result<(), Box<dyn Error>> {
    if folder.join("observed.json").is_file() && folder.join("truth.json").is_file() {
        scenes.push(folder.to_path_buf());
        return Ok(());
    }
    let mut inner: Vec<PathBuf> = std::fs::read_dir(folder)?.flatten().map(|e| e.path()).collect();
    inner.sort();
    inner.iter().filter(|p| p.is_dir()).try_for_each(|p| find(p, scenes))
}

/// Distances of one kind (m), one list for each scene.
#[derive(Default)]
struct Errors(Vec<Vec<f64>>);

#[derive(Default)]
struct Figures {
    observed: Errors,
    future: Errors,
    removed: Errors,
    mass: Errors,
    /// Future errors of one coordinate in units of the predicted standard deviation.
    deviations: Vec<f64>,
    /// Numbers of right, invented and missed collisions: after removal, heavier, lighter.
    collisions: [[usize; 3]; 3],
    chi_squares: Vec<f64>,
    /// Root mean square residual over the noise, and in metres.
    rmse_over_noise: Vec<f64>,
    rmse: Vec<f64>,
    /// Relative error of the ratio of the first two masses.
    mass_ratios: Vec<f64>,
    /// Parameters whose gradient agrees with central differences, and all.
    gradients: [usize; 2],
    fit_ms: Vec<f64>,
    /// Time of the posterior draws, which precede the first prediction.
    draws_ms: Vec<f64>,
    rollout_us: Vec<f64>,
}

impl Figures {
    fn measure(&mut self, folder: &Path, preset: Option<&Preset>) -> Result<(), Box<dyn Error>> {
        let read = |name: &str| std::fs::read_to_string(folder.join(name));
        let scene = parse(&folder.display().to_string(), &read("observed.json")?)?;
        let truth: Json = serde_json::from_str(&read("truth.json")?)?;
        let start = preset.unwrap_or_else(|| Preset::for_world(scene.world)).model(&scene);
        let (scenes, began) = (std::slice::from_ref(&scene), Instant::now());
        let fit = estimate(scenes, &[start], &FitOptions::default(), &never)?;
        self.fit_ms.push(1e3 * began.elapsed().as_secs_f64());
        let began = Instant::now();
        let fit = with_draws(scenes, fit, &never)?;
        self.draws_ms.push(1e3 * began.elapsed().as_secs_f64());
        let fitted = &fit.scenes[0];
        self.chi_squares.push(fitted.reduced_chi_square);
        self.rmse_over_noise.push(fitted.rmse / fitted.noise_sigma);
        self.rmse.push(fitted.rmse);
        self.rollout_us.push(rollout_us(&fitted.model, &scene.times));
        let [agree, all] = gradients(&fitted.model, &scene);
        self.gradients = [self.gradients[0] + agree, self.gradients[1] + all];
        if let ([a, b], true) = (&fit.objects(0)[..], truth["engine"] == "reality") {
            let [of_a, of_b] = [0, 1].map(|i| truth["objects"][i]["mass"].as_f64().unwrap_or(f64::NAN));
            self.mass_ratios.push((a.mass.value / b.mass.value * of_b / of_a - 1.0).abs());
        }
        if truth["trajectory"].is_array() {
            self.compare(&scene, &fit, &truth)?;
        }
        Ok(())
    }

    /// Prediction and counterfactuals against the true trajectories.
    fn compare(&mut self, scene: &Scene, fit: &Fit, truth: &Json) -> Result<(), Box<dyn Error>> {
        let camera = serde_json::from_value::<Vec<[f64; 4]>>(truth["camera_matrix"].clone()).ok();
        let camera = camera.and_then(|rows| {
            Some(Camera { matrix: [*rows.first()?, *rows.get(1)?, *rows.get(2)?], image_size: IMAGE_SIZE })
        });
        let in_view = |p: Vec2| camera.is_none_or(|c| c.sees(p, HEIGHT));
        let ids = ids(&truth["objects"], "object_id");
        let rows = list(&truth["trajectory"]);
        let observed = scene.times.len();
        let run = |interventions: Vec<Intervention>, frames| {
            let request = PredictionRequest { interventions, frames, rollouts: ROLLOUTS, seed: 0 };
            predict(scene, fit, 0, &request, &never)
        };
        let prediction = run(vec![], rows.len())?;
        let [mut seen, mut future, mut removed, mut mass] = [(); 4].map(|()| vec![]);
        for (frame, row) in rows.iter().enumerate() {
            for (id, at) in ids.iter().zip(positions(row)).filter(|(_, at)| in_view(*at)) {
                let Some((off, sd)) = off(&prediction, frame, *id, at) else { continue };
                if frame < observed {
                    seen.push(off.norm());
                } else {
                    future.push(off.norm());
                    self.deviations.extend([off.x, off.y].map(|e| e.abs() / sd));
                }
            }
        }
        for case in list(&truth["counterfactuals"]) {
            let id = |name: &str| case[name].as_u64().map(|id| id as u32);
            let (edit, kind) = match (id("remove"), id("object"), case["mass_factor"].as_f64()) {
                (Some(id), ..) => (Intervention::Remove { id }, 0),
                (_, Some(id), Some(factor)) => {
                    (Intervention::ScaleMass { id, factor }, if factor > 1.0 { 1 } else { 2 })
                }
                _ => continue,
            };
            let prediction = run(vec![edit], observed)?;
            self.count(kind, &pairs(&prediction, observed), &true_pairs(&case, observed));
            let ids = if case["object_order"].is_array() {
                list(&case["object_order"]).iter().filter_map(|v| Some(v.as_u64()? as u32)).collect()
            } else {
                ids.clone()
            };
            let every = case["frame_step"].as_u64().unwrap_or(1) as usize;
            for (key, row) in list(&case["trajectory"]).iter().enumerate().take(KEYFRAMES) {
                for (id, at) in ids.iter().zip(positions(row)).filter(|(_, at)| in_view(*at)) {
                    let found = off(&prediction, key * every, *id, at).map(|(off, _)| off.norm());
                    if kind == 0 { removed.extend(found) } else { mass.extend(found) }
                }
            }
        }
        for (errors, of_scene) in [
            (&mut self.observed, seen),
            (&mut self.future, future),
            (&mut self.removed, removed),
            (&mut self.mass, mass),
        ] {
            if !of_scene.is_empty() {
                errors.0.push(of_scene);
            }
        }
        Ok(())
    }

    fn count(&mut self, kind: usize, found: &[[u32; 2]], wanted: &[[u32; 2]]) {
        let [right, invented, missed] = &mut self.collisions[kind];
        let hits = found.iter().filter(|p| wanted.contains(p)).count();
        *right += hits;
        *invented += found.len() - hits;
        *missed += wanted.len() - hits;
    }

    fn print(&self) {
        let errors = [
            ("observed", &self.observed),
            ("future", &self.future),
            ("removal", &self.removed),
            ("mass", &self.mass),
        ];
        for (name, errors) in errors.iter().filter(|(_, e)| !e.0.is_empty()) {
            let all: Vec<f64> = errors.0.iter().flatten().copied().collect();
            let scenes: Vec<f64> = errors.0.iter().map(|e| rms(e)).collect();
            row(
                &format!("{name} error, m: pooled RMSE / median / median scene RMSE"),
                format!("{:.4} / {:.4} / {:.4}", rms(&all), median(&all), median(&scenes)),
            );
        }
        if !self.deviations.is_empty() {
            let within = |n: f64| self.deviations.iter().filter(|d| **d <= n).count() as f64;
            let share = |n: f64| 100.0 * within(n) / self.deviations.len() as f64;
            row(
                "future errors within 1 and 2 predicted sd",
                format!("{:.1} % / {:.1} %", share(1.0), share(2.0)),
            );
        }
        let names = ["removal", "heavier", "lighter"];
        for (name, [right, invented, missed]) in names.iter().zip(self.collisions) {
            let all = 2 * right + invented + missed;
            if all > 0 {
                row(
                    &format!("collisions after {name}: F1 (right, invented, missed)"),
                    format!("{:.3} ({right}, {invented}, {missed})", 2.0 * right as f64 / all as f64),
                );
            }
        }
        let good = self.chi_squares.iter().filter(|c| (0.8..=1.5).contains(*c)).count();
        row(
            "reduced chi-square: median / worst; in [0.8, 1.5]",
            format!("{}; {good} of {}", spread(&self.chi_squares), self.chi_squares.len()),
        );
        let close = self.rmse_over_noise.iter().filter(|r| **r <= 1.2).count();
        row(
            "RMSE over noise: median / worst; at most 1.2",
            format!("{}; {close} of {}", spread(&self.rmse_over_noise), self.rmse_over_noise.len()),
        );
        if !self.mass_ratios.is_empty() {
            let (n, mm) = (self.rmse.len(), self.rmse.iter().filter(|r| **r <= 1e-3).count());
            row("RMSE, m: median / worst; at most 1 mm", format!("{}; {mm} of {n}", spread(&self.rmse)));
            let ok = self.mass_ratios.iter().filter(|r| **r <= 0.05).count();
            row(
                "mass ratio, relative error: median / worst; at most 5 %",
                format!("{}; {ok} of {n}", spread(&self.mass_ratios)),
            );
        }
        let [agree, all] = self.gradients;
        row(
            "parameters whose gradient agrees to 1e-4",
            format!("{agree} of {all} ({:.1} %)", 100.0 * agree as f64 / all.max(1) as f64),
        );
        row("fit, ms: median / worst", spread(&self.fit_ms));
        row("draws for the first prediction, ms: median / worst", spread(&self.draws_ms));
        row("rollout, us: median / worst", spread(&self.rollout_us));
    }
}

fn row(name: &str, value: String) {
    println!("  {name:<62} {value}");
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    match n {
        0 => f64::NAN,
        _ => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
    }
}

fn spread(values: &[f64]) -> String {
    format!("{:.4} / {:.4}", median(values), values.iter().copied().fold(f64::NAN, f64::max))
}

fn list(value: &Json) -> Vec<Json> {
    value.as_array().cloned().unwrap_or_default()
}

fn ids(values: &Json, name: &str) -> Vec<u32> {
    list(values).iter().filter_map(|v| Some(v[name].as_u64()? as u32)).collect()
}

/// Positions in a row of a true trajectory: `[x, y, ...]` of each object.
fn positions(row: &Json) -> Vec<Vec2> {
    let number = |v: &Json| v.as_f64().unwrap_or(f64::NAN);
    list(row).iter().map(|o| vec2(number(&o[0]), number(&o[1]))).collect()
}

/// The difference from the true position, and its predicted standard deviation; `None` if either is absent.
fn off(prediction: &Prediction, frame: usize, id: u32, truth: Vec2) -> Option<(Vec2, f64)> {
    let body = prediction.best.ids.iter().position(|other| *other == id)?;
    let state = (*prediction.best.states.get(frame)?.get(body)?)?;
    let off = state.position - truth;
    off.norm().is_finite().then_some((off, prediction.sd[frame][body]?))
}

/// Pairs that collide within the video, in at least half of the rollouts.
fn pairs(prediction: &Prediction, frames: usize) -> Vec<[u32; 2]> {
    let likely = prediction
        .events
        .iter()
        .filter(|e| e.event.kind == EventKind::Collision && e.frame < frames && e.probability >= 0.5);
    distinct(likely.map(|e| e.event.objects.clone()))
}

fn true_pairs(case: &Json, frames: usize) -> Vec<[u32; 2]> {
    let within = |c: &Json| c["frame_id"].as_u64().is_some_and(|f| (f as usize) < frames);
    let objects = |c: &Json| list(&c["object_ids"]).iter().filter_map(|v| Some(v.as_u64()? as u32)).collect();
    distinct(list(&case["collisions"]).iter().filter(|c| within(c)).map(objects))
}

fn distinct(collisions: impl Iterator<Item = Vec<u32>>) -> Vec<[u32; 2]> {
    let mut all: Vec<[u32; 2]> = collisions
        .filter_map(|o| match o[..] {
            [a, b] => Some([a.min(b), a.max(b)]),
            _ => None,
        })
        .collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// Median time of a simulation (us).
fn rollout_us(model: &Model, times: &[f64]) -> f64 {
    let run = |_| {
        let began = Instant::now();
        std::hint::black_box(trace(std::hint::black_box(model), times));
        1e6 * began.elapsed().as_secs_f64()
    };
    median(&(0..RUNS).map(run).collect::<Vec<f64>>())
}

/// For how many fitted parameters the derivatives of all positions agree with central differences; and the number of
/// fitted parameters.
fn gradients(model: &Model, scene: &Scene) -> [usize; 2] {
    let flat = model.flatten();
    let run = |values: &[f64]| -> Vec<f64> {
        let rollout = simulate(model, values, &scene.times, &SimulationLimits::default());
        let flattened = rollout.states.iter().flatten().flatten();
        flattened.flat_map(|k| [k.position.x, k.position.y]).collect()
    };
    let mut counted = [0, 0];
    for slot in free(model) {
        let jets: Vec<Jet> = flat
            .iter()
            .enumerate()
            .map(|(i, v)| if i == slot { Jet::variable(*v, 0) } else { Jet::constant(*v) })
            .collect();
        let rollout = simulate(model, &jets, &scene.times, &SimulationLimits::default());
        let exact = rollout.states.iter().flatten().flatten();
        let exact: Vec<f64> =
            exact.flat_map(|k| [k.position.x, k.position.y].map(|p| p.derivative(0))).collect();
        let agrees = STEPS.iter().any(|h| {
            let at = |sign: f64| {
                let mut moved = flat.clone();
                moved[slot] += sign * h;
                run(&moved)
            };
            let (above, below) = (at(1.0), at(-1.0));
            let central = above.iter().zip(&below).map(|(a, b)| (a - b) / (2.0 * h));
            let off = central.zip(&exact).map(|(c, e)| (c - e) * (c - e)).sum::<f64>().sqrt();
            let size = exact.iter().map(|e| e * e).sum::<f64>().sqrt();
            off <= AGREES * size.max(1e-9)
        });
        counted = [counted[0] + usize::from(agrees), counted[1] + 1];
    }
    counted
}

/// Indices in [`Model::flatten`] of fitted values that move bodies: positions and velocities of moving bodies, masses,
/// parameters of effects with a prior.
fn free(model: &Model) -> Vec<usize> {
    let width = BODY_VALUES.len();
    let bodies = model.bodies.iter().enumerate().flat_map(|(b, body)| {
        let moves = body.start.state.velocity.norm() > 0.0;
        let wanted = [true, true, !body.shape.is_round(), moves, moves, moves && !body.shape.is_ball()];
        let kept = wanted.into_iter().enumerate().filter(|(_, w)| *w).map(|(i, _)| i).chain([MASS]);
        kept.map(move |value| b * width + value)
    });
    let mut all: Vec<usize> = bodies.collect();
    let mut at = width * model.bodies.len();
    for effect in &model.effects {
        for parameter in &effect.parameters {
            if effect.on && parameter.prior.sd > 0.0 {
                all.extend(at..at + parameter.values.len());
            }
            at += parameter.values.len();
        }
    }
    all
}
