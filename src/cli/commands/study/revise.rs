//! `revise`: adds an effect to the models of a set-up or removes one, compares before and after; lists the history.

use super::discover;
use super::why::not_better;
use crate::api::v1::add_effect_request::Addition;
use crate::api::v1::{
    AddEffectRequest, AddEffectResponse, FoundEffect, RemoveEffectRequest, RemoveEffectResponse,
    RevisedModels, Revision, StudyRequest, Worth, add_effect_response, remove_effect_response,
};
use crate::cli::connection::stream::{self, StreamEvent};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::revisions::{self, ID_DIGITS};
use crate::cli::{input, output};
use crate::effects::{EFFECTS, alike};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::PathBuf;

const HELP: &str = "\
A formula is a text, or the name of a file that holds it:

  # Drag that grows with the square of the speed.
  let k [1/m] = 0.1 from 0 to 5
  ax = -k * vx * speed
  ay = -k * vy * speed

On the left of = stands ax or ay (m/s^2), fx or fy (N), or torque (N m). On the right may stand numbers, pi, parameters,
the operators + - * / ^, the functions sin cos tan exp ln sqrt tanh abs sign min max, and the variables x y (m),
vx vy speed (m/s), yaw (rad), spin (rad/s), t (s), m (kg), r (m, radius of the circle around the shape).
New lines or ; separate the formulas. `let` declares a parameter that is fitted: its unit (SI symbols with * / ^),
start value (0) and bounds (1000 times the start value, or 1000) may be left out.

The --data-dir or the --server keeps the revisions. The latest one is revised; to go back, name an older one with --on.";

#[derive(clap::Args)]
#[command(after_help = HELP)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["add", "add_formula", "remove", "list"])))]
pub struct ReviseArgs {
    /// Scenes of one set-up: scene files, scene folders, or folders of scene folders.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Adds an effect of the catalogue (`vrdp effects`), or the best variant of a kind.
    #[arg(long, value_name = "KIND")]
    add: Option<String>,
    /// Adds a formula of your own: see below.
    #[arg(long, visible_alias = "formula", value_name = "TEXT|FILE")]
    add_formula: Option<String>,
    /// Name of the formula that --add-formula adds [default: the name of its file, or `formula`].
    #[arg(long, value_name = "NAME", requires = "add_formula")]
    name: Option<String>,
    /// Removes an effect.
    #[arg(long, value_name = "EFFECT")]
    remove: Option<String>,
    /// Shows all revisions of these scenes.
    #[arg(long)]
    list: bool,
    /// The revision to change: the first digits of its id [default: the latest].
    #[arg(long, value_name = "ID", conflicts_with_all = ["list", "model"])]
    on: Option<String>,
    /// Starts a new history from a preset or a model file; an id is a revision to change, as with --on.
    #[arg(long, value_name = "NAME|ID|FILE", conflicts_with = "list")]
    model: Option<String>,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub async fn run(target: &Target, args: ReviseArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let is_kept = target.server.is_some() || target.data_dir.is_some();
    if !is_kept && (args.list || args.on.is_some()) {
        let message = "revisions are kept only with --data-dir or --server; name where yours are";
        return Err(Failure::input(message));
    }
    if let Some(missing) =
        target.data_dir.as_ref().filter(|d| args.list && target.server.is_none() && !d.is_dir())
    {
        let message = format!(
            "--data-dir {}: no such folder; name the folder that holds the revisions",
            missing.display()
        );
        return Err(Failure::input(message));
    }
    let formula = args.add_formula.as_deref().map(|given| input::formula(given, args.name.as_deref()));
    let formula = formula.transpose()?;
    let scenes = input::scenes(&args.scenes)?.into_iter().collect::<Result<Vec<_>, _>>()?;
    let start = input::model("--model", args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let mut study = connection.study(&scenes, start.as_ref()).await?;
    let known = history(&connection, &study.videos).await?;
    if args.list {
        let value = || json!({ "revisions": known.iter().map(to_json).collect::<Vec<Value>>() });
        output::result(args.json.as_deref(), &listing(&known), value)?;
        return connection.close().await;
    }
    study.models = match (&args.on, &study.start) {
        (Some(digits), _) => revision_named(&known, digits)?.models.clone(),
        (None, Some(_)) => vec![],
        (None, None) if !study.models.is_empty() => study.models.clone(),
        (None, None) => {
            // A misspelt name says more than a history with several ends.
            let latest = latest(&known).map_err(|e| misspelt(args.add.as_deref()).unwrap_or(e))?;
            latest.map(|r| r.models.clone()).unwrap_or_default()
        }
    };
    let addition = args.add.map(Addition::Effect).or(formula.map(Addition::Formula));
    let found = match (addition, args.remove) {
        (Some(addition), _) => add(&connection, study.clone(), addition).await?,
        (None, effect) => remove(&connection, study.clone(), effect.unwrap_or_default()).await?,
    };
    let known = history(&connection, &study.videos).await?;
    let names = scenes.iter().map(|s| s.name.as_str());
    let names: Vec<(&str, &str)> = study.videos.iter().map(String::as_str).zip(names).collect();
    let of = |r: &Option<Revision>| r.as_ref().map(to_json);
    let why = found.before.as_ref().zip(found.after.as_ref()).and_then(|(b, a)| not_better(b, a));
    let value = || json!({ "before": of(&found.before), "after": of(&found.after), "why_not_better": why });
    let [flag, place] = target.words();
    let next = match &found.after {
        Some(after) if is_kept => output::next("show", &[], &[&revisions::id(after), &flag, &place]),
        _ => output::next("revise", &args.scenes, &["--list", &flag, &place]),
    };
    let text = text(&found, &known, &names, is_kept) + &next;
    output::result(args.json.as_deref(), &text, value)?;
    connection.close().await
}

/// Adds an effect and shows the progress.
pub async fn add(
    connection: &Connection,
    study: StudyRequest,
    addition: Addition,
) -> Result<RevisedModels, Failure> {
    use add_effect_response::Event;
    let request = AddEffectRequest { study: Some(study), addition: Some(addition) };
    let open = async || connection.models().add_effect(request.clone()).await;
    let event = |m: AddEffectResponse| match m.event? {
        Event::Progress(fraction) => Some(StreamEvent::Progress(fraction)),
        Event::Revised(revised) => Some(StreamEvent::Result(revised)),
    };
    stream::result("adding the effect", open, event).await
}

async fn remove(
    connection: &Connection,
    study: StudyRequest,
    effect: String,
) -> Result<RevisedModels, Failure> {
    use remove_effect_response::Event;
    let request = RemoveEffectRequest { study: Some(study), effect };
    let open = async || connection.models().remove_effect(request.clone()).await;
    let event = |m: RemoveEffectResponse| match m.event? {
        Event::Progress(fraction) => Some(StreamEvent::Progress(fraction)),
        Event::Revised(revised) => Some(StreamEvent::Result(revised)),
    };
    stream::result("removing the effect", open, event).await
}

/// The revisions of exactly these videos, parents before children.
async fn history(connection: &Connection, videos: &[String]) -> Result<Vec<Revision>, Failure> {
    let Some(parent) = videos.first() else { return Ok(vec![]) };
    let models = connection.models_of(parent).await?;
    let mut found: Vec<Revision> = models.into_iter().filter_map(|m| m.history).collect();
    // The order of the files does not matter.
    let wanted: BTreeSet<&str> = videos.iter().map(String::as_str).collect();
    let of = |r: &Revision| {
        let named = r.models.iter().filter_map(|m| m.split_once("/models/")).map(|m| m.0);
        named.collect::<BTreeSet<_>>() == wanted
    };
    found.retain(of);
    let rooted = |r: &&Revision| !found.iter().any(|p| p.models == r.parents);
    let mut ordered: Vec<Revision> = vec![];
    let mut next: Vec<&Revision> = found.iter().filter(rooted).rev().collect();
    while let Some(revision) = next.pop() {
        ordered.push(revision.clone());
        next.extend(found.iter().filter(|r| r.parents == revision.models).rev());
    }
    Ok(ordered)
}

fn revision_named<'r>(known: &'r [Revision], digits: &str) -> Result<&'r Revision, Failure> {
    let whole = |r: &Revision| r.models.first().and_then(|m| m.rsplit('/').next()).map(str::to_string);
    let fits = |r: &&Revision| whole(r).is_some_and(|w| !digits.is_empty() && w.starts_with(digits));
    match &known.iter().filter(fits).collect::<Vec<_>>()[..] {
        [one] => Ok(one),
        [] => Err(Failure::input(format!(
            "--on {digits}: these scenes have no such revision; --list shows them all"
        ))),
        _ => Err(Failure::input(format!(
            "--on {digits}: several revisions have these first digits; give more"
        ))),
    }
}

/// The error about an effect that does not exist.
fn misspelt(name: Option<&str>) -> Option<Failure> {
    let name = name.filter(|name| !EFFECTS.iter().any(|e| e.spec.name == *name || e.kind == *name))?;
    let meant = alike(name).join(", ");
    Some(Failure::input(format!(
        "there is no effect {name:?}; did you mean {meant}? `vrdp effects` lists all"
    )))
}

/// The revision without a child; `None` without a history; an error if there are several.
fn latest(known: &[Revision]) -> Result<Option<&Revision>, Failure> {
    let last = |r: &&Revision| !known.iter().any(|next| next.parents == r.models);
    match &known.iter().filter(last).collect::<Vec<_>>()[..] {
        [] => Ok(None),
        [one] => Ok(Some(one)),
        several => {
            let ends: Vec<String> =
                several.iter().map(|r| format!("{} ({})", revisions::id(r), revisions::change(r))).collect();
            Err(Failure::input(format!(
                "the history has several latest revisions; name one with --on: {}",
                ends.join(", ")
            )))
        }
    }
}

/// The change as text: verdict, parameters, and the errors from the first revision on. `names` pairs the service's
/// name of a video with the user's.
pub fn text(found: &RevisedModels, known: &[Revision], names: &[(&str, &str)], is_kept: bool) -> String {
    let Some(after) = &found.after else { return String::new() };
    let lineage = match revisions::lineage(&known.iter().collect::<Vec<_>>(), after) {
        single if single.len() < 2 => found.before.iter().chain([after]).collect(),
        lineage => lineage,
    };
    let mut text = format!("{}: {}\n", revisions::change(after), verdict(after));
    let why = found.before.as_ref().and_then(|before| not_better(before, after));
    text.extend(why.map(|why| format!("  not better, because {why}\n")));
    if let Some(added) = &after.added {
        text += &(discover::parameter_lines(&added.parameters, names) + discover::INTERVALS);
    }
    text += &format!("\n{}\n{}", table(&lineage), revisions::text(&lineage, after.noise_sigma));
    if is_kept {
        text += &format!(
            "\n  use these models with --model:\n{}",
            after.models.iter().map(|m| format!("    {m}\n")).collect::<String>()
        );
    }
    text
}

fn verdict(r: &Revision) -> String {
    let word = match r.worth() {
        // The log evidence is undefined here.
        Worth::NotIdentifiable => return format!("NOT_IDENTIFIABLE: {}", r.not_identifiable_reason),
        Worth::Better => "better",
        Worth::NoDifference => "no significant difference; the simpler model is as good",
        Worth::Worse => "worse",
        Worth::Unspecified => "first revision",
    };
    format!("{word} (log evidence {:.1})", r.log_evidence)
}

fn table(revisions: &[&Revision]) -> String {
    let name = |r: &Revision| {
        format!("{}{}  {}", "  ".repeat(r.revision as usize), revisions::id(r), revisions::change(r))
    };
    revisions::table(revisions, revisions.iter().any(|r| r.models.len() > 1), name)
}

fn listing(known: &[Revision]) -> String {
    let all: Vec<&Revision> = known.iter().collect();
    match all.first() {
        Some(first) => {
            let lines = |r: &&Revision| {
                r.added.as_ref().filter(|a| !a.formula.is_empty()).map(|a| formula_lines(r, a))
            };
            let formulas: Vec<String> = all.iter().filter_map(lines).collect();
            format!("{}\n{}\n{}", table(&all), formulas.concat(), revisions::text(&all, first.noise_sigma))
        }
        None => "these scenes have no revisions yet; --add makes one\n".into(),
    }
}

/// The text of a formula, after the id of the revision that adds it.
fn formula_lines(r: &Revision, added: &FoundEffect) -> String {
    let text: Vec<&str> = added.formula.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    format!("  {}  {}\n", revisions::id(r), text.join(&format!("\n  {:ID_DIGITS$}  ", "")))
}

/// The JSON of a revision.
pub fn to_json(r: &Revision) -> Value {
    let word = |w: &str| if w.is_empty() { Value::Null } else { json!(w) };
    let worth = match r.worth() {
        Worth::Better => json!("BETTER"),
        Worth::NoDifference => json!("NO_DIFFERENCE"),
        Worth::Worse => json!("WORSE"),
        Worth::NotIdentifiable => json!("NOT_IDENTIFIABLE"),
        Worth::Unspecified => Value::Null,
    };
    json!({
        "revision": r.revision,
        "id": revisions::id(r),
        "effect": word(&r.effect),
        "formula": word(r.added.as_ref().map_or("", |a| &a.formula)),
        "removed": word(&r.removed),
        "parameters": r.added.as_ref().map(discover::parameters),
        "rmse_m": r.rmse,
        "held_out_rmse_m": r.held_out_rmse,
        "left_out_rmse_m": r.left_out_rmse,
        "reduced_chi_square": r.reduced_chi_square,
        "noise_sigma_m": r.noise_sigma,
        "log_evidence": r.log_evidence,
        "worth": worth,
        "not_identifiable": word(&r.not_identifiable_reason),
        "models": r.models,
        "parents": r.parents,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::v1::{FoundParameter, ParameterOwner};

    #[test]
    fn values_of_single_objects_are_named_and_undetermined_ones_are_in_parentheses() {
        let factor = |object_id: u32, video: &str, identified: bool| FoundParameter {
            name: "factor".into(),
            unit: "1".into(),
            value: vec![2.0],
            low: vec![0.5],
            high: vec![3.5],
            owner: Some(ParameterOwner { object_id, video: video.into(), identified }),
            ..Default::default()
        };
        let all = [factor(3, "", true), factor(5, "videos/b", false)];
        insta::assert_snapshot!(discover::parameter_lines(&all, &[("videos/a", "left"), ("videos/b", "right")]), @r"
          object 3: factor 2.0 [0.5 to 3.5]
          object 5 of right: (factor 2.0 [0.5 to 3.5])
        ");
        let added = crate::api::v1::FoundEffect { parameters: all.to_vec(), ..Default::default() };
        let listed = discover::parameters(&added);
        assert_eq!(listed["factor"][1]["object_id"], 5, "{listed}");
        assert_eq!(listed["factor"][1]["identified"], false, "{listed}");
        let written = crate::api::v1::FoundEffect { formula: "ax = -k*vx\nay = 0".into(), ..added };
        let written =
            Revision { added: Some(written), models: vec!["m/012345678".into()], ..Default::default() };
        assert!(listing(&[written]).contains("  01234567  ax = -k*vx\n            ay = 0\n"));
        let mut unknown =
            Revision { not_identifiable_reason: "record more frames".into(), ..Default::default() };
        unknown.set_worth(Worth::NotIdentifiable);
        assert_eq!(verdict(&unknown), "NOT_IDENTIFIABLE: record more frames");
    }
}
