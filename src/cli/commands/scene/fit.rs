//! `fit`: fits a model to each scene, separately or jointly.

use crate::api::v1::{
    Estimate, FitMethod, FitModelRequest, Model, ObjectEstimate, PairEstimate, SharedEstimate, UnseenPush,
};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::progress::TaskProgress;
use crate::cli::{input, output};
use crate::num::median;
use crate::scene::Scene;
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use std::time::Instant;

#[derive(clap::Args)]
pub struct FitArgs {
    /// Scene files, scene folders, or folders of scene folders.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Preset, id of a kept model (`vrdp show`), or model file [default: by the scene's world].
    #[arg(long, value_name = "NAME|ID|FILE")]
    model: Option<String>,
    /// Method that minimises the misfit [default: gauss-newton].
    #[arg(long, value_enum, value_name = "NAME")]
    method: Option<MethodName>,
    /// Fits the scenes jointly: they are videos of one set-up and share its parameters.
    #[arg(long)]
    joint: bool,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum MethodName {
    /// Damped Gauss-Newton.
    GaussNewton,
    /// L-BFGS in stages, as in the paper; for comparison.
    Paper,
}

pub async fn run(target: &Target, args: FitArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let scenes = input::scenes(&args.scenes)?;
    let count = scenes.len();
    let start = input::model("--model", args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let progress = TaskProgress::new(if args.joint { 1 } else { count });
    let (done, failures) = match args.joint {
        true => (jointly(&connection, scenes, start.as_ref(), args.method, &progress).await?, vec![]),
        false => separately(&connection, scenes, start.as_ref(), args.method, &progress).await,
    };
    let is_adequate = done.iter().all(|(_, model, _)| model.adequate);
    let (mut fitted, mut ratios, mut tables) = (Map::new(), Vec::with_capacity(count), String::new());
    for (scene, model, seconds) in done {
        ratios.push(model.rmse / model.noise_sigma);
        tables += &format!("{}\n{}\n", scene.name, table(&model, |id| name(&scene, id)));
        fitted.insert(scene.name.clone(), to_json(&model, seconds));
    }
    drop(progress);
    if !ratios.is_empty() {
        let summary = summary(ratios);
        output::result(args.json.as_deref(), &tables, || json!({ "scenes": fitted }))?;
        match args.json.as_deref() {
            Some("-") => output::tell(&summary),
            _ => output::print(&format!("{summary}\n{}", next(target, &args.scenes, is_adequate)))?,
        }
    }
    connection.close().await?;
    Failure::combined(failures, count)
}

/// The command to try after a fit: a prediction, or the search for what the model lacks.
fn next(target: &Target, scenes: &[PathBuf], is_adequate: bool) -> String {
    let [flag, place] = target.words();
    match scenes {
        [_] if is_adequate => output::next("simulate", scenes, &[]),
        _ if is_adequate => output::next("compare", scenes, &[]),
        _ => output::next("discover", scenes, &[&flag, &place]),
    }
}

/// A scene, its model, and the seconds that the fit took.
type Fitted = (Scene, Model, f64);

impl MethodName {
    fn of(method: Option<MethodName>) -> FitMethod {
        match method {
            None => FitMethod::Unspecified,
            Some(MethodName::GaussNewton) => FitMethod::GaussNewton,
            Some(MethodName::Paper) => FitMethod::StagedLbfgs,
        }
    }
}

async fn separately(
    connection: &Connection,
    scenes: Vec<Result<Scene, Failure>>,
    start: Option<&input::ModelArgument>,
    method: Option<MethodName>,
    bar: &TaskProgress,
) -> (Vec<Fitted>, Vec<Failure>) {
    let (mut done, mut failures) = (vec![], vec![]);
    for (i, scene) in scenes.into_iter().enumerate() {
        let start_time = Instant::now();
        let fitted = async {
            let scene = scene?;
            let progress = |fraction: f64| bar.show(&format!("fitting {}", scene.name), i, fraction);
            progress(0.0);
            let model = async {
                let video = connection.post(&scene).await?;
                let start = connection.start(&video, start).await?;
                connection.fit(&video, start, MethodName::of(method), progress).await
            };
            let model = model.await.map_err(|e| e.at(&scene.name))?;
            Ok((scene, model, start_time.elapsed().as_secs_f64()))
        };
        match fitted.await {
            Ok(fitted) => done.push(fitted),
            Err(failure) => failures.push(failure),
        }
    }
    (done, failures)
}

/// Fits all scenes at once; fails if one of them fails.
async fn jointly(
    connection: &Connection,
    scenes: Vec<Result<Scene, Failure>>,
    start: Option<&input::ModelArgument>,
    method: Option<MethodName>,
    bar: &TaskProgress,
) -> Result<Vec<Fitted>, Failure> {
    let start_time = Instant::now();
    let mut posted = vec![];
    for scene in scenes {
        let scene = scene?;
        posted.push((connection.post(&scene).await.map_err(|e| e.at(&scene.name))?, scene));
    }
    let videos = posted.iter().map(|(video, _)| video.clone()).collect();
    let request = connection.joint_request(videos, start)?;
    let request = FitModelRequest { method: MethodName::of(method).into(), ..request };
    let progress = |fraction| bar.show("fitting all scenes", 0, fraction);
    progress(0.0);
    let models = connection.fit_together(request, progress).await?;
    let seconds = start_time.elapsed().as_secs_f64();
    let of = |(video, scene): (String, Scene)| {
        let own = format!("{video}/");
        let model = models.iter().find(|m| m.name.starts_with(&own)).cloned();
        let missing = || Failure::other("the reply of the service has no model; try again").at(&scene.name);
        let model = model.ok_or_else(missing)?;
        Ok((scene, model, seconds))
    };
    posted.into_iter().map(of).collect()
}

/// The name of an object: its id, color, material and shape.
pub fn name(scene: &Scene, id: u32) -> String {
    match scene.objects.iter().find(|o| o.id == id) {
        Some(o) if o.color.is_empty() => o.description(),
        Some(o) => format!("{id} {}", o.description()),
        None => id.to_string(),
    }
}

/// What the numbers of the table are.
const LEGEND: &str =
    "\n  ±: standard deviation; in parentheses: comes mostly from the prior; given: not fitted\n";
/// What e is.
pub const RESTITUTION: &str = "  e: separation over approach speed of two objects, e = coefficient r_a r_b d_ab, at most 1 (`vrdp effects restitution`)\n";

/// The fit as a table.
pub fn table(model: &Model, name: impl Fn(u32) -> String) -> String {
    let has_factors = has_factors(model);
    let row = |o: &ObjectEstimate| {
        let factor = has_factors.then(|| estimate(o.restitution.as_ref()));
        [name(o.object_id), estimate(o.mass.as_ref())].into_iter().chain(factor).collect()
    };
    let rows: Vec<Vec<String>> = model.objects.iter().map(row).collect();
    let header = &["object", "mass", "restitution factor r"][..if has_factors { 3 } else { 2 }];
    let shared: String = model.shared.iter().map(shared_line).collect();
    let pushes = pushes(&model.unseen_pushes, ": the model passes over it");
    format!(
        "{}{shared}{}{LEGEND}{}{pushes}  noise {:.2} mm, rmse {:.2} mm, reduced chi-square {:.2}{}\n",
        output::table(header, &rows),
        pairs(model, name),
        if model.pairs.is_empty() { "" } else { RESTITUTION },
        1e3 * model.noise_sigma,
        1e3 * model.rmse,
        model.reduced_chi_square,
        if model.adequate { "" } else { ": above what noise explains; try `vrdp discover`" },
    )
}

/// What something unseen does to objects, a line each.
pub fn pushes(all: &[UnseenPush], what: &str) -> String {
    all.iter().map(|p| format!("  {}{what}\n", p.sentence)).collect()
}

/// The same as JSON.
pub fn pushes_json(all: &[UnseenPush]) -> Vec<Value> {
    let one = |p: &UnseenPush| {
        let change = p.velocity_change.unwrap_or_default();
        json!({
            "object_id": p.object_id, "first_frame": p.first_frame, "last_frame": p.last_frame,
            "begin_s": p.begin_time, "end_s": p.end_time, "velocity_change": [change.x, change.y],
            "spin_change": p.spin_change, "sentence": p.sentence,
        })
    };
    all.iter().map(one).collect()
}

/// Whether each object has a restitution factor of its own.
fn has_factors(model: &Model) -> bool {
    let is_factor = |s: &&SharedEstimate| s.effect == "restitution" && s.parameter == "object";
    model.shared.iter().filter(is_factor).any(|s| s.values.iter().any(|e| e.sd > 0.0))
}

/// The restitution of each two objects that touch, as a table.
fn pairs(model: &Model, name: impl Fn(u32) -> String) -> String {
    let row = |pair: &PairEstimate| {
        let names: Vec<String> = pair.object_ids.iter().map(|id| name(*id)).collect();
        vec![names.join(" and "), estimate(pair.restitution.as_ref())]
    };
    let rows: Vec<Vec<String>> = model.pairs.iter().map(row).collect();
    if rows.is_empty() { String::new() } else { format!("\n{}", output::table(&["contact", "e"], &rows)) }
}

/// A shared parameter that differs from zero: `sliding_friction.mu: rubber 0.0370 ± 0.0010`, or of an object
/// `damping.linear: [2] 0.012 ± 0.010 1/s`; in parentheses where it comes mostly from the prior.
fn shared_line(shared: &SharedEstimate) -> String {
    let text = |(k, e): (usize, &Estimate)| {
        let is_id = |l: &str| l.starts_with(|c: char| c.is_ascii_digit());
        let label = match shared.labels.get(k).map_or("", String::as_str) {
            "" => String::new(),
            id if is_id(id) => format!("[{id}] "),
            word => format!("{word} "),
        };
        let unit = if e.unit == "1" { "" } else { &e.unit };
        let number = format!("{} {unit}", output::measured(e.value, e.sd)).trim_end().to_string();
        let number = if e.identified { number } else { format!("({number})") };
        (e.sd > 0.0 && e.value.abs() > e.sd).then(|| label + &number)
    };
    let texts: Vec<String> = shared.values.iter().enumerate().filter_map(text).collect();
    match texts.is_empty() {
        true => String::new(),
        false => format!("  {}.{}: {}\n", shared.effect, shared.parameter, texts.join(", ")),
    }
}

fn estimate(estimate: Option<&Estimate>) -> String {
    match estimate {
        Some(e) if e.sd == 0.0 => format!("{:.3} given", e.value),
        Some(e) if e.identified => output::measured(e.value, e.sd),
        Some(e) => format!("({})", output::measured(e.value, e.sd)),
        None => "-".into(),
    }
}

/// The JSON of an object.
#[derive(serde::Serialize)]
struct ObjectEstimates {
    object_id: u32,
    mass: Value,
    restitution: Value,
}

fn to_json(model: &Model, seconds: f64) -> Value {
    let objects: Vec<Value> = model
        .objects
        .iter()
        .map(|o| {
            let (mass, restitution) = (number(o.mass.as_ref()), number(o.restitution.as_ref()));
            json!(ObjectEstimates { object_id: o.object_id, mass, restitution })
        })
        .collect();
    let mut shared: Map<String, Value> = Map::new();
    for parameter in &model.shared {
        let effect = shared.entry(parameter.effect.clone()).or_insert_with(|| json!({}));
        effect[&parameter.parameter] = vector(parameter);
    }
    json!({
        "model_id": model.name.rsplit('/').next().unwrap_or_default(),
        "revision": model.revision,
        "rmse_m": model.rmse,
        "noise_sigma_m": model.noise_sigma,
        "reduced_chi_square": model.reduced_chi_square,
        "identified": model.identified,
        "seconds": seconds,
        "objects": objects,
        "pairs": model.pairs.iter().map(pair_json).collect::<Vec<_>>(),
        "shared": shared,
        "unseen_pushes": pushes_json(&model.unseen_pushes),
    })
}

fn pair_json(pair: &PairEstimate) -> Value {
    json!({ "object_ids": pair.object_ids, "restitution": number(pair.restitution.as_ref()) })
}

fn number(e: Option<&Estimate>) -> Value {
    e.map_or(Value::Null, |e| {
        json!({
            "value": e.value, "sd": e.sd, "low95": e.low95, "high95": e.high95,
            "unit": e.unit, "identified": e.identified,
        })
    })
}

/// One value as a number; several as lists, with labels.
fn vector(shared: &SharedEstimate) -> Value {
    let scalar = shared.labels.len() <= 1 && shared.labels.iter().all(String::is_empty);
    if scalar {
        return number(shared.values.first());
    }
    let list = |f: &dyn Fn(&Estimate) -> Value| shared.values.iter().map(f).collect::<Vec<_>>();
    json!({
        "labels": shared.labels,
        "value": list(&|e| json!(e.value)),
        "sd": list(&|e| json!(e.sd)),
        "low95": list(&|e| json!(e.low95)),
        "high95": list(&|e| json!(e.high95)),
        "unit": shared.values.first().map_or("", |e| e.unit.as_str()),
        "identified": list(&|e| json!(e.identified)),
    })
}

/// Median and worst ratio of rmse to noise.
fn summary(mut ratios: Vec<f64>) -> String {
    let median = median(&mut ratios).unwrap_or(f64::NAN);
    let worst = ratios.iter().copied().max_by(f64::total_cmp).unwrap_or(f64::NAN);
    let scenes = if ratios.len() == 1 { "scene" } else { "scenes" };
    format!("{} {scenes}: rmse over noise {median:.3} (median), {worst:.3} (worst)", ratios.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_summary_has_median_and_worst() {
        assert_eq!(
            summary(vec![3.0, 1.0, 1.5, 1.1]),
            "4 scenes: rmse over noise 1.300 (median), 3.000 (worst)"
        );
        assert_eq!(summary(vec![1.2]), "1 scene: rmse over noise 1.200 (median), 1.200 (worst)");
    }
}
