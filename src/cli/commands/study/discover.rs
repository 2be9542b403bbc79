//! `discover`: finds the missing effects of a set-up, adds them, and shows the errors before and after.

use super::ranking::ranking;
use crate::api::v1::{
    DiscoverEffectsRequest, DiscoverEffectsResponse, Discovery, FoundParameter, ParameterOwner, PosePair,
    RankedEffect, Revision, SmallestEffect, TrajectoryPair, UnseenPush, Verdict,
    discover_effects_response::Event,
};
use crate::cli::commands::scene::fit::pushes_json;
use crate::cli::connection::stream::{self, StreamEvent};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::revisions;
use crate::cli::{input, output};
use crate::num::NINETY_FIVE;
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// What stands behind the numbers of an added effect.
pub const INTERVALS: &str = "  in square brackets: 95 % intervals\n";
/// Log evidence (nats) above which a candidate is strong.
const STRONG: f64 = 5.0;
/// Number of candidates in the table.
const CANDIDATES_IN_DISCOVERY: usize = 5;

#[derive(clap::Args)]
pub struct DiscoverArgs {
    /// Scenes of one set-up: scene files, scene folders, or folders of scene folders.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Preset, id of a kept model (`vrdp show`), or model file to start from [default: by the scenes' world].
    #[arg(long, value_name = "NAME|ID|FILE")]
    model: Option<String>,
    /// Largest number of effects to add [default: 2].
    #[arg(long, value_name = "N")]
    max_effects: Option<u32>,
    /// Number of simulated frames in the JSON, from frame 0 [default: observed + 60].
    #[arg(long, value_name = "N", requires = "json")]
    frames: Option<u32>,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub async fn run(target: &Target, args: DiscoverArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let scenes = input::scenes(&args.scenes)?.into_iter().collect::<Result<Vec<_>, _>>()?;
    let start = input::model("--model", args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let study = Some(connection.study(&scenes, start.as_ref()).await?);
    let request = DiscoverEffectsRequest { study, max_effects: args.max_effects, frames: args.frames };
    let found = search(&connection, request).await?;
    let names: Vec<String> = scenes.iter().map(|s| s.name.clone()).collect();
    let text = text(&found) + &next(target, &args.scenes, &found);
    output::result(args.json.as_deref(), &text, || to_json(&found, &names))?;
    connection.close().await
}

/// The command to try after a discovery: its numbers where they are kept, else how to keep them.
fn next(target: &Target, scenes: &[PathBuf], found: &Discovery) -> String {
    let [flag, place] = target.words();
    match found.revisions.last().map(revisions::id).filter(|id| !id.is_empty()) {
        Some(id) if target.keeps_results() => output::next("show", &[], &[&id, &flag, &place]),
        _ if found.verdict() == Verdict::NotIdentifiable => output::next("compare", scenes, &[]),
        _ => output::next("discover", scenes, &[&flag, &place]),
    }
}

/// Runs the search and shows its progress.
pub async fn search(connection: &Connection, request: DiscoverEffectsRequest) -> Result<Discovery, Failure> {
    let open = async || connection.models().discover_effects(request.clone()).await;
    let event = |m: DiscoverEffectsResponse| match m.event? {
        Event::Progress(fraction) => Some(StreamEvent::Progress(fraction)),
        Event::Discovery(discovery) => Some(StreamEvent::Result(discovery)),
    };
    stream::result("searching for effects", open, event).await
}

/// Bars of the error of each revision, and the noise.
pub fn curve(found: &Discovery) -> String {
    revisions::text(&found.revisions.iter().collect::<Vec<_>>(), found.noise_sigma)
}

/// The discovery as text.
pub fn text(found: &Discovery) -> String {
    let mut text = format!("{}: {}\n", verdict(found), found.reason);
    for effect in &found.effects {
        text += &match effect.parameters.iter().any(|p| p.owner.is_some()) {
            true => format!("\n  {}:\n{}", effect.kind, parameter_lines(&effect.parameters, &[])),
            false => {
                let parameters: Vec<String> = effect.parameters.iter().map(parameter).collect();
                format!("\n  {}: {}\n", effect.kind, parameters.join(", "))
            }
        };
    }
    if !found.effects.is_empty() {
        text += INTERVALS;
    }
    for kinds in &found.ambiguous {
        text += &format!("\n  these effects explain the videos equally well: {}\n", kinds.kinds.join(", "));
    }
    if let Some(e) = &found.experiment {
        let (x, v) = (e.position.unwrap_or_default(), e.velocity.unwrap_or_default());
        text += &format!(
            "  to decide between them, record this: a {} of {:.2} kg from ({:.2}, {:.2}) m at ({:.2}, {:.2}) m/s; after {:.1} s the predictions differ by {:.0} standard deviations\n",
            e.shape, e.mass, x.x, x.y, v.x, v.y, e.time, e.sigmas
        );
    }
    if !found.formula.is_empty() {
        text += &format!("\n  {}\n", found.formula);
    }
    if found.verdict() == Verdict::NotIdentifiable {
        return text;
    }
    let revisions: Vec<&Revision> = found.revisions.iter().collect();
    let table = revisions::table(&revisions, found.trajectories.len() > 1, revisions::change);
    text += &format!("\n{table}  noise {:.2} mm\n", 1e3 * found.noise_sigma);
    text + &ranking(&found.ranked, CANDIDATES_IN_DISCOVERY, found.trajectories.len())
        + rejection(found)
        + &smallest(found)
}

/// Why a strong candidate was not added to an adequate model.
fn rejection(found: &Discovery) -> &'static str {
    let strong = found
        .ranked
        .first()
        .is_some_and(|r| r.log_evidence.into_iter().chain(r.contact_log_evidence).any(|e| e > STRONG));
    match found.verdict() {
        Verdict::Adequate if strong => {
            "  Some candidates score well locally, but none improves the full-trajectory fit.\n"
        }
        _ => "",
    }
}

/// For an adequate model: the smallest effect of each kind that would have been detected.
fn smallest(found: &Discovery) -> String {
    if found.verdict() != Verdict::Adequate || found.smallest.is_empty() {
        return String::new();
    }
    let row = |s: &SmallestEffect| {
        let unit = if s.unit == "1" { "" } else { &s.unit };
        vec![
            s.kind.clone() + &if s.effect == s.kind { String::new() } else { format!(" ({})", s.effect) },
            format!("{} {} {unit}", s.parameter, output::number(s.value)).trim_end().to_string(),
        ]
    };
    let rows: Vec<Vec<String>> = found.smallest.iter().map(row).collect();
    format!("\n{}", output::table(&["would have been detected", "from"], &rows))
}

/// The parameters as text: one line, or one line for each object that has its own values. `names` pairs the service's
/// name of a video with the user's.
pub fn parameter_lines(all: &[FoundParameter], names: &[(&str, &str)]) -> String {
    let mut lines: Vec<(Option<&ParameterOwner>, Vec<String>)> = vec![];
    for p in all {
        let text = parameter(p);
        match lines.last_mut().filter(|(owner, _)| *owner == p.owner.as_ref()) {
            Some((_, line)) => line.push(text),
            None => lines.push((p.owner.as_ref(), vec![text])),
        }
    }
    let line = |(owner, texts): &(Option<&ParameterOwner>, Vec<String>)| {
        let whose = owner.map_or(String::new(), |o| {
            let video =
                names.iter().find(|(video, _)| *video == o.video).map(|(_, name)| format!(" of {name}"));
            format!("object {}{}: ", o.object_id, video.unwrap_or_default())
        });
        format!("  {whose}{}\n", texts.join(", "))
    };
    lines.iter().map(line).collect()
}

/// A parameter with its interval; in parentheses if the data do not determine it.
fn parameter(p: &FoundParameter) -> String {
    match p.value[..] {
        [] => format!("{} {}", p.name, p.word),
        [object] if p.name == "object_id" => format!("object {object:.0}"),
        _ => {
            let unit = if p.unit == "1" { "" } else { &p.unit };
            let ends = p.low.iter().zip(&p.high);
            let numbers =
                p.value.iter().zip(ends).map(|(v, (low, high))| output::with_interval(*v, *low, *high));
            let text = format!("{} {} {unit}", p.name, numbers.collect::<Vec<_>>().join(", "));
            let text = text.trim_end().to_string();
            if p.owner.as_ref().is_some_and(|o| !o.identified) { format!("({text})") } else { text }
        }
    }
}

fn verdict(found: &Discovery) -> &'static str {
    match found.verdict() {
        Verdict::EffectFound => "EFFECT_FOUND",
        Verdict::Ambiguous => "AMBIGUOUS",
        Verdict::Adequate => "ADEQUATE",
        Verdict::OutsideLibrary => "OUTSIDE_LIBRARY",
        Verdict::NotIdentifiable | Verdict::Unspecified => "NOT_IDENTIFIABLE",
    }
}

fn to_json(found: &Discovery, names: &[String]) -> Value {
    let effect = |e: &crate::api::v1::FoundEffect| json!({ "kind": e.kind, "parameters": parameters(e) });
    let ranked = |r: &RankedEffect| json!({ "kind": r.kind, "effect": r.effect, "log_evidence": r.log_evidence, "contact_log_evidence": r.contact_log_evidence, "held_out_rmse_m": r.held_out_rmse });
    let revision = |r: &Revision| {
        let effect = if r.effect.is_empty() { Value::Null } else { json!(r.effect) };
        json!({
            "revision": r.revision,
            "effect": effect,
            "rmse_m": r.rmse,
            "held_out_rmse_m": r.held_out_rmse,
            "left_out_rmse_m": r.left_out_rmse,
            "reduced_chi_square": r.reduced_chi_square,
        })
    };
    let formula = if found.formula.is_empty() { Value::Null } else { json!(found.formula) };
    let smallest = |s: &SmallestEffect| json!({ "kind": s.kind, "parameter": s.parameter, "value": s.value, "unit": s.unit });
    let pushed = |(name, c): (&String, &TrajectoryPair)| {
        let own: Vec<UnseenPush> =
            found.unseen_pushes.iter().filter(|p| p.video == c.video).cloned().collect();
        (!own.is_empty()).then(|| (name.clone(), json!(pushes_json(&own))))
    };
    let pushes: Map<String, Value> = names.iter().zip(&found.trajectories).filter_map(pushed).collect();
    let scenes: Map<String, Value> =
        names.iter().zip(&found.trajectories).map(|(name, c)| (name.clone(), course(c))).collect();
    json!({
        "verdict": verdict(found),
        "reason": found.reason,
        "effects": found.effects.iter().map(effect).collect::<Vec<_>>(),
        "ranked": found.ranked.iter().map(ranked).collect::<Vec<_>>(),
        "ambiguous": found.ambiguous.iter().map(|a| a.kinds.clone()).collect::<Vec<_>>(),
        "formula": formula,
        "smallest": found.smallest.iter().map(smallest).collect::<Vec<_>>(),
        "noise_sigma_m": found.noise_sigma,
        "revisions": found.revisions.iter().map(revision).collect::<Vec<_>>(),
        "unseen_pushes": pushes,
        "scenes": scenes,
    })
}

/// The parameters by name; a list with object ids where each object has its own value.
pub fn parameters(e: &crate::api::v1::FoundEffect) -> Value {
    let mut all = Map::new();
    for p in &e.parameters {
        let mut value = quantity(p);
        match &p.owner {
            None => {
                all.insert(p.name.clone(), value);
            }
            Some(owner) => {
                value["object_id"] = json!(owner.object_id);
                value["video"] = if owner.video.is_empty() { Value::Null } else { json!(owner.video) };
                value["identified"] = json!(owner.identified);
                if let Value::Array(list) = all.entry(p.name.clone()).or_insert_with(|| json!([])) {
                    list.push(value);
                }
            }
        }
    }
    Value::Object(all)
}

fn quantity(p: &FoundParameter) -> Value {
    // One of an older version says it by its interval.
    let half = || p.low.iter().zip(&p.high).map(|(l, h)| (h - l) / (2.0 * NINETY_FIVE)).collect();
    let sd: Vec<f64> = if p.sd.is_empty() { half() } else { p.sd.clone() };
    match (&p.value[..], &sd[..]) {
        ([], _) => json!({ "value": p.word, "sd": 0.0, "unit": p.unit, "identified": true }),
        ([value], [sd]) => {
            json!({
                "value": value, "sd": sd, "low95": p.low.first(), "high95": p.high.first(),
                "unit": p.unit, "identified": sd < &value.abs(),
            })
        }
        (values, _) => {
            let identified: Vec<bool> = values.iter().zip(&sd).map(|(v, sd)| *sd < v.abs()).collect();
            json!({
                "value": values, "sd": sd, "low95": p.low, "high95": p.high,
                "unit": p.unit, "identified": identified,
            })
        }
    }
}

fn course(c: &TrajectoryPair) -> Value {
    let side = |pose: &dyn Fn(&PosePair) -> Vec<f64>| -> Vec<Vec<Value>> {
        let object = |o: &PosePair| match pose(o) {
            p if p.is_empty() => Value::Null,
            p => json!(p),
        };
        c.frames.iter().map(|f| f.objects.iter().map(object).collect()).collect()
    };
    json!({ "before": side(&|o| o.before.clone()), "after": side(&|o| o.after.clone()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_adequate_model_lists_what_would_have_been_detected() {
        let tilt = SmallestEffect {
            kind: "tilt".into(),
            parameter: "a".into(),
            value: 0.012,
            unit: "m/s^2".into(),
            ..Default::default()
        };
        let mut found = Discovery { smallest: vec![tilt], ..Default::default() };
        found.set_verdict(Verdict::Adequate);
        assert!(text(&found).contains("a 0.01200 m/s^2"), "{}", text(&found));
        found.set_verdict(Verdict::EffectFound);
        assert!(!text(&found).contains("would have been detected"));
    }
}
