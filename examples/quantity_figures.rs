//! Quantities of motion against the truth of generated scenes: how often they lie within two stated deviations.
//! `quantity_figures FOLDER [FITS]`: FOLDER has scenes with observed.json and truth.json; FITS keeps the fits between runs.

use rayon::prelude::*;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vrdp::fit::{Fit, FitOptions, estimate, with_draws};
use vrdp::num::{never, quantile};
use vrdp::reason::{
    Op, Prediction, PredictionRequest, ProgramValue, QuestionProgram, RolloutContext, Scenario,
    active_effects, simulated, step,
};
use vrdp::scene::{Scene, parse};
use vrdp::world::Preset;

type Anyhow = Box<dyn std::error::Error + Send + Sync>;

const ROLLOUTS: usize = 32;

/// Kind, deviations from the truth, and the stated deviation.
type Found = (&'static str, f64, f64);

fn main() -> Result<(), Anyhow> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let folder = args.first().ok_or("usage: quantity_figures FOLDER [FITS]")?;
    let mut scenes: Vec<PathBuf> = std::fs::read_dir(folder)?.filter_map(|e| Some(e.ok()?.path())).collect();
    scenes.retain(|p| p.join("truth.json").exists());
    scenes.sort();
    let fits = args.get(1).map(Path::new);
    let all: Vec<Result<Vec<Found>, Anyhow>> = scenes.par_iter().map(|p| one(p, fits)).collect();
    let mut kinds: BTreeMap<&str, Vec<(f64, f64)>> = BTreeMap::new();
    for found in all {
        found?.into_iter().for_each(|(kind, z, sd)| kinds.entry(kind).or_default().push((z, sd)));
    }
    for (kind, all) in kinds {
        let inside = all.iter().filter(|(z, _)| z.abs() <= 2.0).count();
        let mut z: Vec<f64> = all.iter().map(|a| a.0).collect();
        let mut sds: Vec<f64> = all.iter().map(|a| a.1).collect();
        let spread = [0.025, 0.16, 0.5, 0.84, 0.975].map(|q| quantile(&mut z, q).unwrap_or(0.0));
        println!(
            "{kind:24} {inside} of {} within two deviations: {:.1} %; deviations {spread:.1?}; median stated {:.5}",
            all.len(),
            100.0 * inside as f64 / all.len() as f64,
            quantile(&mut sds, 0.5).unwrap_or(0.0)
        );
    }
    Ok(())
}

fn fitted(scene: &Scene, folder: Option<&Path>) -> Result<Fit, Anyhow> {
    let file = folder.map(|f| f.join(format!("{}.cbor", scene.name)));
    let known = file.as_ref().and_then(|f| std::fs::read(f).ok());
    let fit = match known {
        Some(bytes) => ciborium::from_reader(&bytes[..])?,
        None => {
            let start = Preset::for_world(scene.world).model(scene);
            estimate(std::slice::from_ref(scene), &[start], &FitOptions::default(), &never)?
        }
    };
    if let Some(file) = file.filter(|f| !f.exists()) {
        let mut bytes = vec![];
        ciborium::into_writer(&fit, &mut bytes)?;
        std::fs::write(file, bytes)?;
    }
    Ok(with_draws(std::slice::from_ref(scene), fit, &never)?)
}

struct Asked<'a> {
    scene: &'a Scene,
    fit: &'a Fit,
    scenarios: [Scenario; 1],
    simulations: [Prediction; 1],
}

impl Asked<'_> {
    /// Mean and deviation of a program's number over the draws that have one.
    fn number(&self, program: &str) -> Option<(f64, f64)> {
        let tokens: Vec<String> = program.split(' ').map(str::to_string).collect();
        let ops: Vec<Op> = QuestionProgram::parse(&tokens).ok()?.ops;
        let model = &self.fit.scenes[0].model;
        let models: Vec<_> = std::iter::once(model.clone()).chain(self.fit.draw(0, ROLLOUTS, 0)).collect();
        let effects = active_effects(model);
        let context = RolloutContext {
            bodies: &model.bodies,
            effects: &effects,
            simulations: &self.simulations,
            models: &models,
            fit: Some((self.fit, 0)),
            ..RolloutContext::of_scene(self.scene, &self.scenarios)
        };
        let value = |rollout: usize| {
            let mut stack = vec![];
            for op in &ops {
                let value = step(op, RolloutContext { rollout, ..context }, &mut stack).ok()?;
                stack.push(value);
            }
            match stack.pop()? {
                ProgramValue::Quantity(x, _) | ProgramValue::Time(x) => Some(x),
                _ => None,
            }
        };
        let values: Vec<f64> = (1..=ROLLOUTS).filter_map(value).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
        (2.0 * n > ROLLOUTS as f64).then_some((mean, variance.sqrt()))
    }
}

/// When the path of an object bends around a frame: change of its velocity (m/s), and the time (s) at which its true motions of
/// the frames before and after meet.
fn kink(truth: &Value, object: usize, frame: usize, fps: f64) -> Option<(f64, f64)> {
    let at = |f: usize| -> Option<[f64; 4]> {
        let row = &truth["trajectory"][f][object];
        let [x, y, vx, vy] = [0, 1, 3, 4].map(|c| row[c].as_f64());
        Some([x?, y?, vx?, vy?])
    };
    let (before, after) = (at(frame.checked_sub(2)?)?, at(frame + 1)?);
    let [from, to] = [frame as f64 - 2.0, frame as f64 + 1.0].map(|f| f / fps);
    let change = [after[2] - before[2], after[3] - before[3]];
    let square = change[0] * change[0] + change[1] * change[1];
    let off = |c: usize| after[c] - before[c] - after[c + 2] * to + before[c + 2] * from;
    let time = -(off(0) * change[0] + off(1) * change[1]) / square;
    (square.sqrt() > 0.1).then_some((square.sqrt(), time))
}

fn one(folder: &Path, fits: Option<&Path>) -> Result<Vec<Found>, Anyhow> {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let scene = parse(&name, &std::fs::read_to_string(folder.join("observed.json"))?)?;
    let truth: Value = serde_json::from_slice(&std::fs::read(folder.join("truth.json"))?)?;
    let fit = fitted(&scene, fits)?;
    let frames = scene.times.len();
    let request = PredictionRequest { interventions: vec![], frames, rollouts: ROLLOUTS, seed: 0 };
    let (scenario, simulation) = simulated(&scene, (&fit, 0), &request, &never)?;
    let asked = Asked { scene: &scene, fit: &fit, scenarios: [scenario], simulations: [simulation] };
    let mut found = vec![];
    let mut add = |kind, program: String, truth: f64| {
        if let Some((mean, sd)) = asked.number(&program) {
            if std::env::var("SHOW").is_ok() && (mean - truth).abs() > 2.0 * sd {
                println!("{name} {kind} {program}: {mean:.4} +- {sd:.4}, {truth:.4}");
            }
            found.push((kind, (mean - truth) / sd.max(1e-12), sd));
        }
    };
    let speed = |f: usize, k: usize| {
        let at = |c: usize| truth["trajectory"][f][k][c].as_f64();
        Some(vrdp::num::vec2(at(3)?, at(4)?).norm())
    };
    for (k, (object, track)) in scene.objects.iter().zip(&scene.tracks).enumerate() {
        let one = format!("{} object_number", object.id);
        for sample in track.samples.iter().step_by(40) {
            let Some(speed) = speed(sample.frame, k) else { continue };
            if speed > 0.02 {
                add("speed at a frame", format!("{one} {} speed", sample.frame), speed);
            }
        }
        let all: Vec<f64> = track.samples.iter().filter_map(|s| speed(s.frame, k)).collect();
        let top = all.iter().copied().fold(0.0, f64::max);
        if top > 0.02 {
            add("top speed", format!("{one} video top_speed"), top);
            let first = all.first().copied().unwrap_or(0.0);
            let kind = if top > 1.02 * first { "top speed after a hit" } else { "top speed at the start" };
            add(kind, format!("{one} video top_speed"), top);
        }
    }
    let dt = truth["dt"].as_f64().unwrap_or(0.004);
    for hit in truth["collisions"].as_array().into_iter().flatten() {
        let frame = hit["frame_id"].as_f64().unwrap_or(0.0);
        let ids: Vec<u64> =
            hit["object_ids"].as_array().into_iter().flatten().filter_map(Value::as_u64).collect();
        let [a, b] = ids[..] else { continue };
        if frame as usize >= frames {
            continue;
        }
        let program = format!(
            "events {a} object_number filter_collision {b} object_number filter_collision first filter_order get_time"
        );
        add("hit time, by frame", program.clone(), frame / scene.fps);
        if let Some(substep) = hit["substep"].as_f64() {
            add("hit time, as reported", program.clone(), (substep - 0.5) * dt);
        }
        let index = |id: u64| scene.objects.iter().position(|o| u64::from(o.id) == id);
        let kinks = [a, b].into_iter().filter_map(|id| kink(&truth, index(id)?, frame as usize, scene.fps));
        if let Some((_, time)) = kinks.max_by(|x, y| x.0.total_cmp(&y.0)) {
            add("hit time, of the impulse", program, time);
        }
    }
    Ok(found)
}
