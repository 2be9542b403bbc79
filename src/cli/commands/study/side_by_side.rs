//! Two models of the same videos side by side, or one beside the positions of another simulator.

use super::errors;
use super::show::{ModelNumber, ShownModel, with_interval};
use crate::api::v1::{
    CompareModelsRequest, CompareModelsResponse, Comparison, FitMethod, GetModelRequest, GetVideoRequest,
    Model, ModelDifference, Revision, Separation, SimulateRequest, SimulateResponse, StudyRequest,
    compare_models_response::Event,
};
use crate::cli::connection::stream::{self, StreamEvent};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::input::{self, ModelArgument};
use crate::cli::output;
use crate::cli::output::progress::{self, TaskProgress};
use crate::cli::output::revisions::{self, change_of, short_id};
use crate::num::elementary;
use crate::scene::Scene;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// Most rows of the table of differences; JSON has all.
const FARTHEST: usize = 8;

/// One of the two.
struct ComparedModel {
    /// `0123abcd (table, + tilt)`.
    title: String,
    models: Vec<Model>,
    comparison: Comparison,
}

/// Compares two models on the scenes, or without scenes on the videos of a kept one.
pub async fn models(
    target: &Target,
    names: [&str; 2],
    scenes: Vec<Scene>,
    json_file: Option<&str>,
) -> Result<(), Failure> {
    let read = |name: &str| input::model("compare", Some(name)).map(|found| found.into_iter().next());
    let [a, b] = [read(names[0])?, read(names[1])?];
    let connection = Connection::open(target).await?;
    let kept = [&a, &b].into_iter().find(|m| matches!(m, Some(ModelArgument::Kept { .. })));
    let videos = match (scenes.is_empty(), kept) {
        (true, Some(kept)) => connection.kept_study(kept.as_ref()).await?.videos,
        (true, None) => {
            return Err(Failure::input(
                "neither is a kept model; name the scenes on which they are compared",
            ));
        }
        (false, _) => connection.study(&scenes, None).await?.videos,
    };
    let mut studies = vec![];
    for (name, given) in names.iter().zip([&a, &b]) {
        studies.push(fitted(&connection, &videos, given.as_ref()).await.map_err(|e| e.at(name))?);
    }
    let [against, study] = [studies.pop(), studies.pop()];
    let request = CompareModelsRequest { study, against };
    let open = async || connection.models().compare_models(request.clone()).await;
    let event = |m: CompareModelsResponse| match m.event? {
        Event::Progress(fraction) => Some(StreamEvent::Progress(fraction)),
        Event::Comparison(comparison) => Some(StreamEvent::Result(comparison)),
    };
    let mut comparison = stream::result("comparing", open, event).await?;
    let difference = *comparison.difference.take().unwrap_or_default();
    let other = difference.against.as_deref().cloned().unwrap_or_default();
    let sides = [of(&connection, comparison).await?, of(&connection, other).await?];
    let names = display_names(&connection, &videos).await?;
    let text = text(&sides, &difference, &names);
    output::result(json_file, &text, || to_json(&sides, &difference, &names))?;
    connection.close().await
}

/// The study of kept models; others are fitted first.
async fn fitted(
    connection: &Connection,
    videos: &[String],
    given: Option<&ModelArgument>,
) -> Result<StudyRequest, Failure> {
    let study = connection.study_of(videos.to_vec(), given).await?;
    if !study.models.is_empty() {
        return Ok(study);
    }
    let progress = TaskProgress::new(1);
    let request = connection.joint_request(videos.to_vec(), given)?;
    let show = |fraction: f64| progress.show("fitting", 0, fraction);
    let models = connection.fit_together(request, show).await?;
    Ok(StudyRequest { models: models.into_iter().map(|m| m.name).collect(), start: None, ..study })
}

async fn of(connection: &Connection, comparison: Comparison) -> Result<ComparedModel, Failure> {
    let mut models = vec![];
    for name in &comparison.models {
        let request = GetModelRequest { name: name.clone(), ..Default::default() };
        models.push(connection.models().get_model(request).await?.into_inner());
    }
    let first = models.first().cloned().unwrap_or_default();
    let title = format!("{} ({}, {})", short_id(&first.name), first.preset, change_of(&first));
    Ok(ComparedModel { title, models, comparison })
}

/// The users' names of videos, by the service's.
async fn display_names(
    connection: &Connection,
    videos: &[String],
) -> Result<BTreeMap<String, String>, Failure> {
    let mut names = BTreeMap::new();
    for video in videos {
        let found = connection
            .videos()
            .get_video(GetVideoRequest { name: video.clone(), ..Default::default() })
            .await?
            .into_inner();
        names.insert(video.clone(), found.display_name);
    }
    Ok(names)
}

impl ComparedModel {
    /// Root mean square over the videos (m).
    fn pooled(&self, of: impl Fn(&crate::api::v1::VideoComparison) -> f64) -> f64 {
        let all = &self.comparison.videos;
        let squares: f64 = all.iter().map(|v| elementary::powi(of(v), 2)).sum();
        (squares / all.len().max(1) as f64).sqrt()
    }

    fn chi_square(&self) -> f64 {
        let all = &self.comparison.videos;
        let degrees: f64 = all.iter().map(|v| v.degrees_of_freedom as f64).sum();
        let chi: f64 = all.iter().map(|v| v.reduced_chi_square * v.degrees_of_freedom as f64).sum();
        chi / degrees.max(1.0)
    }

    /// The revision, if it is of exactly these videos: its errors are the ones that every other output has.
    fn revision(&self) -> Option<&Revision> {
        let history = self.models.first()?.history.as_ref()?;
        (history.models.len() == self.models.len()).then_some(history)
    }

    fn rmse(&self) -> f64 {
        self.revision().map_or_else(|| self.pooled(|v| v.rmse), |r| r.rmse)
    }

    fn held_out(&self) -> f64 {
        self.revision().map_or_else(|| self.pooled(|v| v.held_out_rmse), |r| r.held_out_rmse)
    }

    /// Of several videos (m).
    fn left_out(&self) -> Option<f64> {
        self.revision().filter(|r| r.models.len() > 1).map(|r| r.left_out_rmse)
    }

    /// Pooled error of each regime (m), in the order of the comparison.
    fn regimes(&self) -> Vec<(String, f64, u64)> {
        let mut all: Vec<(String, f64, u64)> = vec![];
        for r in self.comparison.videos.iter().flat_map(|v| &v.regimes) {
            let squares = r.rmse * r.rmse * r.frames as f64;
            match all.iter_mut().find(|known| known.0 == r.regime) {
                Some(known) => (known.1, known.2) = (known.1 + squares, known.2 + r.frames),
                None => all.push((r.regime.clone(), squares, r.frames)),
            }
        }
        all.into_iter().map(|(name, s, n)| (name, (s / n.max(1) as f64).sqrt(), n)).collect()
    }

    fn numbers(&self) -> Vec<ModelNumber> {
        ShownModel::of_models(self.models.iter().collect()).numbers()
    }

    fn to_json(&self, names: &BTreeMap<String, String>) -> Value {
        let name = |video: &String| names.get(video).unwrap_or(video).clone();
        let videos = self.comparison.videos.iter().map(|v| (name(&v.video), errors::to_json(v)));
        let number = |n: &ModelNumber| {
            let e = &n.estimate;
            json!({
                "name": n.name, "value": e.value, "sd": e.sd, "low95": e.low95, "high95": e.high95,
                "unit": e.unit, "identified": e.identified,
            })
        };
        json!({
            "models": self.comparison.models,
            "preset": self.models.first().map(|m| &m.preset),
            "change": self.models.first().map(change_of),
            "rmse_m": self.rmse(),
            "held_out_rmse_m": self.held_out(),
            "left_out_rmse_m": self.left_out(),
            "reduced_chi_square": self.chi_square(),
            "summary": self.comparison.summary,
            "scenes": videos.collect::<serde_json::Map<String, Value>>(),
            "numbers": self.numbers().iter().map(number).collect::<Vec<_>>(),
        })
    }
}

fn text(
    sides: &[ComparedModel; 2],
    difference: &ModelDifference,
    names: &BTreeMap<String, String>,
) -> String {
    let mm = |v: f64| format!("{:.2}", 1e3 * v);
    let [a, b] = sides;
    let mut text = format!("A: {}\nB: {}\n\n", a.title, b.title);
    let row = |name: &str, of: &dyn Fn(&ComparedModel) -> String| vec![name.to_string(), of(a), of(b)];
    let mut rows = vec![row("held out mm", &|s| mm(s.held_out()))];
    if sides.iter().any(|s| s.left_out().is_some()) {
        rows.push(row("other videos mm", &|s| s.left_out().map_or("-".into(), mm)));
    }
    rows.push(row("rmse mm", &|s| mm(s.rmse())));
    rows.push(row("chi-square", &|s| format!("{:.2}", s.chi_square())));
    text += &output::table(&["error", "A", "B"], &rows);
    text += revisions::HELD_OUT;
    text += &match difference.log_evidence {
        Some(e) => format!(
            "  log evidence {:.1} nats for {} (BIC; the price of its parameters is paid)\n",
            e.abs(),
            if e >= 0.0 { "A" } else { "B" }
        ),
        None => format!("  no log evidence between them: {}\n", difference.no_evidence_reason),
    };
    text += &format!("\n{}", regime_table(a, b));
    text += &format!("\n{}", number_table(a, b));
    text + &format!("\n{}", separation_table(&difference.separations, names))
}

fn regime_table(a: &ComparedModel, b: &ComparedModel) -> String {
    let others = b.regimes();
    let row = |(name, rmse, frames): (String, f64, u64)| {
        let other = others.iter().find(|o| o.0 == name).map_or("-".into(), |o| format!("{:.2}", 1e3 * o.1));
        vec![name, format!("{:.2}", 1e3 * rmse), other, frames.to_string()]
    };
    let rows: Vec<Vec<String>> = a.regimes().into_iter().map(row).collect();
    output::table(&["rmse mm", "A", "B", "frames"], &rows)
}

fn number_table(a: &ComparedModel, b: &ComparedModel) -> String {
    let (ours, theirs) = (a.numbers(), b.numbers());
    let mut names: Vec<&str> = vec![];
    for n in ours.iter().chain(&theirs) {
        let is_fitted = ours.iter().chain(&theirs).any(|o| o.name == n.name && o.estimate.sd > 0.0);
        if is_fitted && !names.contains(&n.name.as_str()) {
            names.push(&n.name);
        }
    }
    let row = |name: &str| {
        let of = |all: &[ModelNumber]| all.iter().find(|n| n.name == name).map(|n| n.estimate.clone());
        let found = [of(&ours), of(&theirs)];
        let unit = found.iter().flatten().next().map_or(String::new(), |e| e.unit.clone());
        let cells = found.iter().flat_map(|e| e.as_ref().map_or(["-".into(), String::new()], with_interval));
        [name.to_string()].into_iter().chain(cells).chain([unit]).collect::<Vec<String>>()
    };
    let rows: Vec<Vec<String>> = names.into_iter().map(row).collect();
    let header = ["parameter", "A ± sd", "A 95 %", "B ± sd", "B 95 %", "unit"];
    output::table(&header, &rows)
        + "  ±: standard deviation; in square brackets: 95 % intervals; given: not fitted in this model\n"
}

fn separation_table(all: &[Separation], names: &BTreeMap<String, String>) -> String {
    let mut farthest: Vec<&Separation> = all.iter().collect();
    farthest.sort_by(|a, b| b.largest.total_cmp(&a.largest));
    let row = |s: &&Separation| {
        let video = names.get(&s.video).unwrap_or(&s.video).clone();
        let (largest, rms) = (format!("{:.2}", 1e3 * s.largest), format!("{:.2}", 1e3 * s.rms));
        vec![video, s.regime.clone(), s.object_id.to_string(), s.frame.to_string(), largest, rms]
    };
    let rows: Vec<Vec<String>> = farthest.iter().take(FARTHEST).map(row).collect();
    let header = ["where they differ most", "regime", "object", "frame", "apart mm", "rms mm"];
    output::table(&header, &rows)
        + "  apart: the largest distance of the two simulations; rms: per coordinate, in all frames of the regime\n"
}

fn to_json(
    sides: &[ComparedModel; 2],
    difference: &ModelDifference,
    names: &BTreeMap<String, String>,
) -> Value {
    let [a, b] = sides;
    let separation = |s: &Separation| {
        json!({
            "scene": names.get(&s.video).unwrap_or(&s.video), "regime": s.regime, "rms_m": s.rms,
            "largest_m": s.largest, "object_id": s.object_id, "frame": s.frame,
        })
    };
    let reason = Some(&difference.no_evidence_reason).filter(|r| !r.is_empty());
    json!({
        "a": a.to_json(names),
        "b": b.to_json(names),
        "log_evidence": difference.log_evidence,
        "no_evidence_reason": reason,
        "separations": difference.separations.iter().map(separation).collect::<Vec<_>>(),
    })
}

/// One object of a scene, in the model's simulation and in another simulator's.
struct TrackDifference {
    object: u32,
    /// Errors against what was measured, the model's first (m), over the frames that both have.
    rmse: [f64; 2],
    /// Largest distance of the two (m), and its frame.
    apart: f64,
    frame: u64,
}

/// Compares a model of each scene with the positions of another simulator.
pub async fn tracks(
    target: &Target,
    model: Option<&str>,
    scenes: &[Scene],
    file: Option<&Path>,
    json_file: Option<&str>,
) -> Result<(), Failure> {
    let file = file.unwrap_or(Path::new(""));
    let [scene] = scenes else {
        let message =
            format!("--against {}: is of one scene; name the one that it simulates", file.display());
        return Err(Failure::input(message));
    };
    let other = input::scene(file)?;
    let given = input::model("--with", model)?;
    let connection = Connection::open(target).await?;
    let video = connection.post(scene).await?;
    let kept = match connection.choice(&video, given.as_ref()).await? {
        Some(choice) if matches!(given, Some(ModelArgument::Kept { .. })) => Some(choice),
        start => {
            let progress = TaskProgress::new(1);
            let show = |fraction: f64| progress.show("fitting", 0, fraction);
            let fit = connection.fit(&video, start, FitMethod::Unspecified, show).await?;
            let choice = Some(crate::api::v1::model_choice::Choice::Model(fit.name));
            Some(crate::api::v1::ModelChoice { choice })
        }
    };
    let frames = scene.times.len() as u32;
    let request = SimulateRequest { video, model: kept, frames, rollouts: Some(0), ..Default::default() };
    let reply = progress::during("simulating", connection.reasoning().simulate(request)).await?.into_inner();
    let rows = track_differences(scene, &reply, &other);
    if rows.is_empty() {
        let message = format!(
            "--against {}: has no object and frame of {}; it needs the same ids and frames",
            file.display(),
            scene.name
        );
        return Err(Failure::input(message));
    }
    let title = format!("A: {}\nB: {}\n\n", reply.model, file.display());
    output::result(json_file, &(title + &track_table(&rows)), || {
        let one = |r: &TrackDifference| {
            json!({
                "object_id": r.object, "a_rmse_m": r.rmse[0], "b_rmse_m": r.rmse[1],
                "largest_m": r.apart, "frame": r.frame,
            })
        };
        json!({ "a": reply.model, "b": file.display().to_string(), "objects": rows.iter().map(one).collect::<Vec<_>>() })
    })?;
    connection.close().await
}

/// Objects in the frames that were measured and that both simulations have; the farthest apart first.
fn track_differences(scene: &Scene, reply: &SimulateResponse, other: &Scene) -> Vec<TrackDifference> {
    let mut rows = vec![];
    for (object, track) in scene.objects.iter().zip(&scene.tracks) {
        let theirs = other.objects.iter().position(|o| o.id == object.id).and_then(|k| other.tracks.get(k));
        let theirs: BTreeMap<usize, [f64; 2]> = theirs
            .into_iter()
            .flat_map(|t| &t.samples)
            .map(|s| (s.frame, [s.position.x, s.position.y]))
            .collect();
        let (mut squares, mut count, mut apart, mut at) = ([0.0; 2], 0.0, 0.0, 0);
        for s in &track.samples {
            let ours =
                reply.frames.get(s.frame).and_then(|f| f.objects.iter().find(|o| o.object_id == object.id));
            let Some((ours, theirs)) = ours.zip(theirs.get(&s.frame)) else { continue };
            let far = |x: f64, y: f64| elementary::hypot(x - s.position.x, y - s.position.y);
            squares[0] += elementary::powi(far(ours.x, ours.y), 2);
            squares[1] += elementary::powi(far(theirs[0], theirs[1]), 2);
            count += 2.0;
            let between = elementary::hypot(ours.x - theirs[0], ours.y - theirs[1]);
            if between >= apart {
                (apart, at) = (between, s.frame as u64);
            }
        }
        if count > 0.0 {
            let rmse = squares.map(|s: f64| (s / count).sqrt());
            rows.push(TrackDifference { object: object.id, rmse, apart, frame: at });
        }
    }
    rows.sort_by(|a, b| b.apart.total_cmp(&a.apart));
    rows
}

fn track_table(rows: &[TrackDifference]) -> String {
    let mm = |v: f64| format!("{:.2}", 1e3 * v);
    let row = |r: &TrackDifference| {
        let errors = r.rmse.map(mm);
        vec![r.object.to_string(), errors[0].clone(), errors[1].clone(), mm(r.apart), r.frame.to_string()]
    };
    let all: Vec<Vec<String>> = rows.iter().map(row).collect();
    let header = ["object", "A rmse mm", "B rmse mm", "apart mm", "at frame"];
    output::table(&header, &all)
        + "  rmse: against what was measured, per coordinate; apart: the largest distance of the two\n  \
           no log evidence between them: B has no numbers that were fitted\n"
}
