//! Measures discovery on groups of videos whose hidden effect is known:
//!
//! `cargo run --release --example discovery_figures -- [--model PRESET] DIR...`, each a group of scene folders or a folder of
//! groups. The search starts from the preset of each scene's world, or from PRESET (`table`: billiards without spin).
//!
//! A scene is a folder with `observed.json` (the input of discovery) and `truth.json` (read for scoring only). It prints for
//! each group: the verdict and whether it is right, the time, how many parameters of the effect lie in their 95 % interval,
//! the error over the noise with the found effects, and the error after the video: without any added effect, with the found
//! effects, and with the true parameters of the effect. A `group.json` with `"outside": true` says that the library lacks the
//! effect.

use nalgebra::{DMatrix, DVector};
use serde_json::Value as Json;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;
use vrdp::discover::{
    DiscoverOptions, Discovery, FoundEffect, ParameterEstimate, ParameterValue, Revision, Verdict, discover,
};
use vrdp::effects::{Quantity, effect};
use vrdp::fit::{FitOptions, StartPoint, estimate};
use vrdp::num::{never, vec2};
use vrdp::scene::{Scene, parse};
use vrdp::world::{Model, Preset, trace};

/// Number of Newton steps that solve for an effect's parameters from its reported quantities, and the difference step.
const STEPS: usize = 30;
const STEP: f64 = 1e-6;

fn main() -> Result<(), Box<dyn Error>> {
    let mut given: Vec<String> = std::env::args().skip(1).collect();
    let model = given.iter().position(|arg| arg == "--model");
    let named = model.and_then(|at| given.drain(at..(at + 2).min(given.len())).nth(1));
    let preset = named.as_deref().and_then(Preset::named);
    if given.is_empty() || (model.is_some() && preset.is_none()) {
        return Err(
            "give folders of scenes, or of groups of them: discovery_figures [--model PRESET] DIR...".into(),
        );
    }
    let folders: Vec<PathBuf> = given.iter().map(PathBuf::from).collect();
    let [mut right, mut groups, mut inside, mut numbers] = [0; 4];
    for group in folders.iter().map(|f| groups_in(f)).collect::<Result<Vec<_>, _>>()?.concat() {
        let outcome = measure(&group, preset).map_err(|e| format!("{}: {e}", group.display()))?;
        println!("{:44} {}", group.file_name().unwrap_or_default().to_string_lossy(), outcome.line);
        right += usize::from(outcome.right);
        groups += 1;
        inside += outcome.inside;
        numbers += outcome.numbers;
    }
    println!("right {right} of {groups}; numbers within their interval {inside} of {numbers}");
    Ok(())
}

/// The printed line of a group, whether its verdict is right, and how many true values lie in their intervals, of how many.
struct GroupOutcome {
    line: String,
    right: bool,
    inside: usize,
    numbers: usize,
}

fn measure(group: &Path, preset: Option<&Preset>) -> Result<GroupOutcome, Box<dyn Error>> {
    let (mut scenes, mut truths): (Vec<Scene>, Vec<Json>) = (vec![], vec![]);
    for folder in inner(group)?.iter().filter(|f| is_scene(f)) {
        let read = |name: &str| std::fs::read_to_string(folder.join(name));
        scenes.push(parse(&folder.display().to_string(), &read("observed.json")?)?);
        truths.push(serde_json::from_str(&read("truth.json")?)?);
    }
    let models: Vec<Model> =
        scenes.iter().map(|s| preset.unwrap_or(Preset::for_world(s.world)).model(s)).collect();
    let began = Instant::now();
    let found = discover(&scenes, &models, &DiscoverOptions::default(), &never)?;
    let time = began.elapsed().as_secs_f64();
    let hidden = &truths[0]["hidden_effects"][0];
    let kind = hidden["kind"].as_str();
    let outside = std::fs::read_to_string(group.join("group.json"))
        .is_ok_and(|text| serde_json::from_str(&text).is_ok_and(|group: Json| group["outside"] == true));
    let right = match outside {
        true => found.verdict == Verdict::OutsideLibrary,
        false => is_right(&found, kind),
    };
    let law = found.effects.iter().find(|e| Some(e.kind.as_str()) == kind);
    let (mut inside, mut numbers) = (0, 0);
    let owner = hidden["params"]["object_id"].as_u64();
    // The truth has the value of one object only.
    let of_owner =
        |p: &&ParameterEstimate| p.owner.zip(owner).is_none_or(|(o, id)| u64::from(o.object) == id);
    for p in law.iter().flat_map(|law| &law.parameters).filter(of_owner) {
        let bounds = components(&p.low).into_iter().zip(components(&p.high));
        for (truth, (low, high)) in components_of(&hidden["params"][&p.name]).into_iter().zip(bounds) {
            inside += usize::from((low..=high).contains(&truth));
            numbers += 1;
        }
    }
    let names: Vec<&str> = found.effects.iter().map(|e| e.kind.as_str()).collect();
    let verdict = format!("{:?} {}", found.verdict, names.join("+"));
    let mut line = format!("{} {verdict:34} {time:5.1} s", if right { "right" } else { "WRONG" });
    if let Some(last) = found.revisions.last() {
        line += &format!("  numbers {inside}/{numbers}  error/noise {:.2}", last.rmse / found.noise_sigma);
        let error = |models: &[Model]| after(models, &scenes, &truths).map(|m| 1e3 * m);
        if let [Some(first), Some(ours)] = [&found.revisions[0], last].map(|r| error(&fitted(r))) {
            line += &format!("  after the video {first:.1} to {ours:.1} mm");
        }
        if let Some(law) = law.filter(|_| right)
            && let Some(truly) = error(&with_truth(&scenes, last, law, &hidden["params"])?)
        {
            line += &format!(", with the true numbers {truly:.1} mm");
        }
    }
    if let Some(formula) = &found.formula {
        line += &format!("  {formula}");
    }
    Ok(GroupOutcome { line, right, inside, numbers })
}

/// The models of a revision.
fn fitted(revision: &Revision) -> Vec<Model> {
    revision.fit.models()
}

fn is_right(found: &Discovery, kind: Option<&str>) -> bool {
    let Some(kind) = kind else { return found.verdict == Verdict::Adequate };
    // A billiards shot needs spin effects, except a rolling one.
    if let Some(shot) = kind.strip_prefix("billiards_") {
        let spins = matches!(&found.effects[..], [e] if e.kind == "ball_spin" || e.kind == "cushion");
        return spins || (shot == "rolling" && found.verdict == Verdict::Adequate);
    }
    match found.verdict {
        Verdict::EffectFound => found.effects.len() == 1 && found.effects[0].kind == kind,
        Verdict::Ambiguous => found.ambiguous.iter().flatten().any(|k| k == kind),
        _ => false,
    }
}

/// The models of the revision with the effect fixed at its true parameters and all else fitted again.
fn with_truth(
    scenes: &[Scene],
    last: &Revision,
    law: &FoundEffect,
    truth: &Json,
) -> Result<Vec<Model>, Box<dyn Error>> {
    let entry = effect(&law.effect).ok_or("the effect is not in the library")?;
    let mut models = fitted(last);
    let active = |m: &Model| m.effects.iter().find(|e| e.name == law.effect).cloned();
    let start = models.iter().find_map(active).ok_or("no model has the effect")?;
    let start: Vec<f64> = start
        .parameters
        .iter()
        .map(|p| p.values.iter().sum::<f64>() / p.values.len().max(1) as f64)
        .collect();
    let values = solved(entry.report, start, truth);
    for active in models.iter_mut().flat_map(|m| &mut m.effects).filter(|e| e.name == law.effect) {
        for (p, value) in active.parameters.iter_mut().zip(&values) {
            p.values.iter_mut().for_each(|v| *v = *value);
            p.means.clone_from(&p.values);
            p.prior.sd = 0.0;
        }
    }
    let options = FitOptions { start_point: StartPoint::NearOptimum, ..DiscoverOptions::default().fit };
    let fit = estimate(scenes, &models, &options, &never)?;
    Ok(fit.scenes.into_iter().map(|s| s.model).collect())
}

/// The parameters whose reported quantities equal the truth: Gauss-Newton steps from `values`.
fn solved(
    report: fn(&[f64]) -> Vec<(&'static str, Quantity)>,
    mut values: Vec<f64>,
    truth: &Json,
) -> Vec<f64> {
    let off = |values: &[f64]| -> DVector<f64> {
        let one = |(name, quantity): (&str, Quantity)| -> Vec<f64> {
            let values = match quantity {
                Quantity::Number(v) => vec![v],
                Quantity::Vector(v) => v.to_vec(),
                Quantity::Word(_) => vec![],
            };
            values.into_iter().zip(components_of(&truth[name])).map(|(value, truth)| value - truth).collect()
        };
        DVector::from_vec(report(values).into_iter().flat_map(one).collect())
    };
    for _ in 0..STEPS {
        let here = off(&values);
        // The effect may report no numbers.
        if here.is_empty() {
            break;
        }
        let mut slopes = DMatrix::zeros(here.len(), values.len());
        for k in 0..values.len() {
            let mut moved = values.clone();
            moved[k] += STEP;
            slopes.set_column(k, &((off(&moved) - &here) / STEP));
        }
        let Ok(step) = slopes.svd(true, true).solve(&here, STEP) else { break };
        values.iter_mut().zip(step.iter()).for_each(|(v, s)| *v -= s);
    }
    values
}

/// Root mean square distance from the truth on the frames after the videos (m); `None` if the truth ends with the videos.
fn after(models: &[Model], scenes: &[Scene], truths: &[Json]) -> Option<f64> {
    let (mut squares, mut count) = (0.0, 0);
    for ((model, scene), truth) in models.iter().zip(scenes).zip(truths) {
        let rows = truth["trajectory"].as_array().map_or(&[][..], Vec::as_slice);
        let observed = scene.times.len();
        let further =
            (observed..rows.len()).map(|f| scene.times[observed - 1] + (f + 1 - observed) as f64 / scene.fps);
        let times: Vec<f64> = scene.times.iter().copied().chain(further).collect();
        for (row, states) in rows.iter().zip(&trace(model, &times).states).skip(observed) {
            for (k, object) in truth["objects"].as_array().into_iter().flatten().enumerate() {
                let body = object["object_id"].as_u64().and_then(|id| scene.object_index(id as u32));
                let Some(state) = body.and_then(|b| states[b]) else { continue };
                let at = components_of(&row[k]);
                if let [x, y, ..] = at[..] {
                    squares += (state.position - vec2(x, y)).norm_squared();
                    count += 1;
                }
            }
        }
    }
    (count > 0).then(|| (squares / f64::from(count)).sqrt())
}

fn components(value: &ParameterValue) -> Vec<f64> {
    match value {
        ParameterValue::Number(v) => vec![*v],
        ParameterValue::Vector(v) => v.to_vec(),
        ParameterValue::Word(_) => vec![],
    }
}

fn components_of(value: &Json) -> Vec<f64> {
    match value.as_array() {
        Some(list) => list.iter().filter_map(Json::as_f64).collect(),
        None => value.as_f64().into_iter().collect(),
    }
}

fn is_scene(folder: &Path) -> bool {
    folder.join("observed.json").is_file() && folder.join("truth.json").is_file()
}

fn inner(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut inner: Vec<PathBuf> = std::fs::read_dir(folder)?.flatten().map(|e| e.path()).collect();
    inner.sort();
    Ok(inner)
}

/// Folders of scenes: this folder, or the folders in it.
fn groups_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let holds = |f: &Path| f.is_dir() && inner(f).is_ok_and(|inner| inner.iter().any(|s| is_scene(s)));
    match holds(folder) {
        true => Ok(vec![folder.to_path_buf()]),
        false => Ok(inner(folder)?.into_iter().filter(|f| holds(f)).collect()),
    }
}
