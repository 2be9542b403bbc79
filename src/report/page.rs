//! The page of a report: the finding first, then its evidence. It needs no network and works without its script.

use super::chart::{Picture, number};
use super::document::document;
use super::numbers::{parameters, reported, unit};
use super::plots::{class, word};
use super::stills;
use super::top_view::{self, PlayerSide, name, player};
use super::views::{ReportViews, direction, label};
use super::words as lexicon_words;
use super::{AnsweredQuestion, ReportData};
use crate::discover::{FAST, FAST_FREE, FoundEffect, SLOW_FREE, Verdict};
use crate::effects::effect;
use crate::num::elementary;
use crate::reason::DerivationStep;
use crate::scene::Scene;
use crate::world::UnseenPush;
use maud::{Markup, html};

const PAGE_SCRIPT: &str = include_str!("page.js");

pub fn html(report: &ReportData, views: &ReportViews, pictures: &[Picture]) -> String {
    let [headline, _] = words(report);
    let main = html! {
        (head(report, views, pictures))
        (see(report, views, pictures))
        (fails(views, pictures))
        (ranked(report, pictures))
        (parameters(report))
        @if !report.answers.is_empty() { (answers(report)) }
        @if !report.words.is_empty() { (lexicon_words::words(report.scenes, report.words)) }
        @if !report.traces.is_empty() { (traces(report)) }
    };
    // A picture becomes a PNG by way of an image of its own text.
    document(&format!("{headline} – vrdp"), "; img-src data:", "", main, PAGE_SCRIPT)
}

/// Headline, and the verdict in one sentence.
fn words(report: &ReportData) -> [String; 2] {
    if let Some(kept) = report.kept {
        return [kept.headline.clone(), kept.sentence.clone()];
    }
    let found = report.discovery;
    let names: Vec<String> = found.effects.iter().map(|e| label(&e.effect)).collect();
    let names = names.join(" and ");
    match found.verdict {
        Verdict::EffectFound => [
            format!("Missing: {names}"),
            "The model lacked a physical effect, which was found and added.".into(),
        ],
        Verdict::Ambiguous => [
            "Something is missing, but these videos do not show what".into(),
            "Several laws explain the videos equally well. Record the experiment below to decide between them.".into(),
        ],
        Verdict::Adequate => [
            "Nothing is missing".into(),
            "The model explains the videos to within the noise of the tracks.".into(),
        ],
        Verdict::OutsideLibrary => [
            "Something is missing that no effect of the library explains".into(),
            match found.formula {
                Some(_) => "The formula below predicts the held-out frames.".into(),
                None => "The residuals have structure, but no tried formula predicts the held-out frames.".into(),
            },
        ],
        Verdict::NotIdentifiable => [
            "These videos do not suffice".into(),
            "They have too little motion or too few frames to judge the model. Record more.".into(),
        ],
    }
}

fn picture<'p>(pictures: &'p [Picture], name: &str) -> Option<&'p Picture> {
    pictures.iter().find(|p| p.name == name)
}

/// The pictures whose names start so, in order.
fn figures(pictures: &[Picture], start: &str) -> Markup {
    html! { @for p in pictures.iter().filter(|p| p.name.starts_with(start)) { (p.figure()) } }
}

/// Millimetres with three digits: a column of them is easy to compare.
fn mm(v: f64) -> String {
    let v = 1e3 * v;
    let digits = if v > 0.0 { (2 - elementary::log10(v).floor() as i32).clamp(0, 3) as usize } else { 0 };
    if v.is_finite() { format!("{v:.digits$} mm") } else { format!("{} mm", number(v)) }
}

fn head(report: &ReportData, views: &ReportViews, pictures: &[Picture]) -> Markup {
    let found = report.discovery;
    let [headline, verdict] = words(report);
    let ends = found.revisions.first().zip(found.revisions.last());
    let many = views.stages.len() > 1;
    let tile = |class: &str, title: &str, value: String, text: String| {
        html! {
            div class={ "tile " (class) } { span { (title) } strong { (value) } span class="text" { (text) } }
        }
    };
    let noises = |v: f64| format!("{:.1} times the noise", v / found.noise_sigma.max(f64::MIN_POSITIVE));
    let tiles = ends.map(|(first, last)| {
        html! {
            div class="tiles" {
                @if many { (tile("was", "Error before", mm(first.rmse), noises(first.rmse))) }
                (tile("is", if many { "Error after" } else { "Error" }, mm(last.rmse), noises(last.rmse)))
                (tile("noise", "Noise floor", mm(found.noise_sigma), "no model can be better".into()))
                (tile("", "Fit percentage", percent(views), "share of the motion that is explained; noise keeps it below 100 %".into()))
            }
        }
    });
    html! {
        header {
            p class="kind" { "vrdp report · " (count(report.scenes.len(), "video")) }
            h1 { (headline) }
            p class="verdict" { (verdict) }
            @if many {
                dl class="facts" {
                    @if let Some(place) = worst(report, views) { dt { "Where the first model failed" } dd { (place) } }
                    @if !found.effects.is_empty() { dt { @if report.kept.is_some() { "What was added" } @else { "What was missing" } } }
                    @for e in &found.effects { dd { (found_effect(e)) } }
                    dt { "How far the error fell" } dd { (tiles.unwrap_or_default()) }
                }
            } @else {
                @for e in &found.effects { p { (found_effect(e)) } }
                (tiles.unwrap_or_default())
            }
            @if !found.reason.is_empty() { p class="quiet" { (found.reason) } }
            @for kinds in &found.ambiguous { p { "These effects explain the videos equally well: " strong { (label(&kinds.join(", "))) } "." } }
            @if let Some(e) = &found.experiment {
                p { "To decide between them, record this: a " (e.shape) " of " (number(e.mass)) " kg from (" (number(e.position.x)) ", "
                    (number(e.position.y)) ") m at (" (number(e.velocity.x)) ", " (number(e.velocity.y)) ") m/s; after "
                    (number(e.time)) " s the predictions differ by " (number(e.sigmas)) " standard deviations." }
            }
            @if let Some(formula) = &found.formula { p { "The formula: " code { (formula) } } }
            div class="figures wide" { @if let Some(p) = picture(pictures, "ladder") { (p.figure()) } (revision_table(report)) }
        }
    }
}

/// A found effect: its description and its parameters.
fn found_effect(found: &FoundEffect) -> Markup {
    html! {
        strong { (label(&found.effect)) } @if let Some(entry) = effect(&found.effect) { ": " (entry.spec.doc) }
        ul { @for p in &found.parameters { li { (reported(p)) } } }
    }
}

fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

fn percent(views: &ReportViews) -> String {
    let shares: Vec<String> = views.stages.iter().map(|s| format!("{:.1} %", s.fit_percent)).collect();
    shares.join(" → ")
}

/// Where the first model fails most.
fn worst(report: &ReportData, views: &ReportViews) -> Option<Markup> {
    let [first, .., last] = &views.stages[..] else { return None };
    let (name, before, _) = first.regimes.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let after = last.regimes.iter().find(|r| r.0 == *name)?.1;
    let video = farthest(report, views)?;
    let (far, scene) = (views.farthest(video)?, report.scenes.get(video)?);
    let (object, time) = (scene.objects.get(far.object)?, scene.times.get(far.frame)?);
    let meaning = match name.as_str() {
        FAST_FREE => format!(" (no contact, {FAST} m/s or faster)"),
        SLOW_FREE => format!(" (no contact, slower than {FAST} m/s)"),
        _ => String::new(),
    };
    Some(html! {
        ul {
            li { "Largest error in: " strong { (name) } (meaning) ", " (mm(*before)) " before, " (mm(after)) " after" }
            @if let Some(way) = direction(&first.unexplained) {
                li { "The missing effect accelerates objects " strong { (way) } }
            }
            li { "Largest residual: " strong { (mm(far.size())) } ", the " (top_view::name(object)) " of " (scene.name) " at "
                (format!("{time:.2} s")) "; " a href="#see" { "show it" } }
        }
    })
}

/// The video with the largest residual of the first model.
fn farthest(report: &ReportData, views: &ReportViews) -> Option<usize> {
    let far = |video: usize| views.farthest(video).map_or(0.0, |r| r.size());
    (0..report.scenes.len()).max_by(|&a, &b| far(a).total_cmp(&far(b)).then(b.cmp(&a)))
}

/// The errors of the revisions as a table.
fn revision_table(report: &ReportData) -> Markup {
    let several = report.scenes.len() > 1;
    html! {
        div class="scroll" { table {
            thead { tr { th { "Revision" } th { "error" } th { "held out" } @if several { th { "other videos" } } th { "chi-square" } } }
            tbody {
                @for (k, r) in report.discovery.revisions.iter().enumerate() {
                    tr { th { (super::plots::words(report, k)) } td { (mm(r.rmse)) } td { (mm(r.held_out_rmse)) }
                        @if several { td { (mm(r.left_out_rmse)) } } td { (number(r.reduced_chi_square)) } }
                }
                tr { th { "noise floor" } td { (mm(report.discovery.noise_sigma)) } td {} @if several { td {} } td { "1" } }
            }
        } }
        @if several { p class="quiet" { "Other videos: motion between contacts, each video predicted with the parameters of the others." } }
    }
}

fn see(report: &ReportData, views: &ReportViews, pictures: &[Picture]) -> Markup {
    let (several, first) = (report.scenes.len() > 1, farthest(report, views));
    html! {
        section aria-labelledby="see" {
            h2 id="see" { "Videos and simulations" }
            p { "Seen from above. Dots: measured. Lines: simulated, fitted to the whole video, so the start may differ too; \
                 dashed after the video. Filled bodies are simulated, dashed outlines measured: where they differ, the model is wrong." }
            @if several {
                p class="scripted" { label { "Video " select class="choose" {
                    @for (k, scene) in report.scenes.iter().enumerate() { option value=(k) selected[first == Some(k)] { (scene.name) } }
                } } }
            }
            @for (k, scene) in report.scenes.iter().enumerate() {
                div class="video" {
                    @if several { h3 { (scene.name) } }
                    (legend(scene))
                    @if !scene.findings.is_empty() {
                        p { "How the tracks look:" }
                        ul { @for finding in &scene.findings { li { (finding) } } }
                    }
                    @let pushes = last_pushes(report, k);
                    @if !pushes.is_empty() {
                        p { "What something unseen does; the model passes over it:" }
                        ul { @for push in &pushes { li { (push.sentence()) } } }
                    }
                    @let sides: Vec<PlayerSide> = views.stages.iter().enumerate().filter_map(|(n, stage)| Some(PlayerSide {
                        title: capital(word(views, n)), run: stage.runs.get(k)?,
                        class: class(views.stages.len(), n), measured: true,
                    })).collect();
                    @let time = picture(pictures, &format!("residual-time-{}", k + 1));
                    (player(&format!("video-{}", k + 1), scene, &sides, views.farthest(k), html! {
                        div class="figures wide" { @if let Some(p) = time { (p.figure()) } }
                    }))
                    (seen(report, views, pictures, k))
                }
            }
        }
    }
}

/// What something unseen does in a video, by the last models.
fn last_pushes(report: &ReportData, video: usize) -> Vec<UnseenPush> {
    let last = report.discovery.revisions.last().and_then(|r| r.fit.scenes.get(video));
    last.map_or(vec![], |s| s.model.unseen_pushes())
}

/// Frames of a video with what was seen in them, as a row that scrolls.
fn seen(report: &ReportData, views: &ReportViews, pictures: &[Picture], video: usize) -> Markup {
    let start = format!("still-{}-", video + 1);
    let count = pictures.iter().filter(|p| p.name.starts_with(&start)).count();
    let Some(scene) = report.scenes.get(video).filter(|_| count > 0) else { return html! {} };
    let factor = match stills::magnification(report, views, video) {
        1.0 => String::new(),
        factor => format!(", drawn {} times as long", number(factor)),
    };
    html! {
        div class="seen-frames" {
            h3 { "What was seen" }
            p { "Frames of the video. White: outlines at the measured positions. Coloured lines: the tracks so far." }
            @if let [_] = &views.stages[..] {
                p { "Red: from the measured to the simulated centre" (factor) ". Numbers: the object, and this distance on the ground and \
                     in the image." }
            } @else if !views.stages.is_empty() {
                p { "From the measured centre to the simulated one" (factor) ": orange " (word(views, 0)) ", blue "
                    (word(views, views.stages.len() - 1)) ". Numbers: the object, and the latter distance on the ground and in the image." }
            }
            div class="controls" {
                input type="range" class="frame" min="0" max=(count - 1) value=(stills::start(report, views, video)) step="1" aria-label={ "Frame of " (scene.name) };
            }
            div class="stills" tabindex="0" role="group" aria-label={ "Frames of " (scene.name) } { (figures(pictures, &start)) }
        }
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |c| c.to_uppercase().collect::<String>() + letters.as_str())
}

fn legend(scene: &Scene) -> Markup {
    html! {
        ul class="legend" {
            @for (k, object) in scene.objects.iter().enumerate() {
                li { span class="swatch" style={ "background:" (top_view::colour(&object.color, k)) } {} (name(object)) }
            }
        }
    }
}

fn fails(views: &ReportViews, pictures: &[Picture]) -> Markup {
    html! {
        section aria-labelledby="fails" {
            h2 id="fails" { "Where the model fails, and on what the error depends" }
            (regimes(views))
            p class="quiet" { "Free: no contact. Fast: " (FAST) " m/s or more." }
            div class="figures wide" {
                (figures(pictures, "residual-map")) (figures(pictures, "residual-magnified")) (figures(pictures, "residual-acceleration"))
                (figures(pictures, "autocorrelation")) (figures(pictures, "cause"))
            }
        }
    }
}

fn regimes(views: &ReportViews) -> Markup {
    let Some(first) = views.stages.first() else { return html! {} };
    let mut regimes: Vec<&(String, f64, usize)> = first.regimes.iter().collect();
    regimes.sort_by(|a, b| b.1.total_cmp(&a.1));
    html! {
        div class="scroll" { table {
            thead { tr { th { "Where" } @for k in 0..views.stages.len() { th { "error " (word(views, k)) } }
                th { "positions" } } }
            tbody {
                @for (name, before, frames) in regimes {
                    tr { th { (name) } td { (mm(*before)) }
                        @if views.stages.len() > 1 {
                            @let after = views.stages.last().and_then(|s| s.regimes.iter().find(|r| r.0 == *name));
                            td { (after.map_or("–".into(), |r| mm(r.1))) }
                        }
                        td { (frames) } }
                }
            }
        } }
    }
}

/// A number as text; empty if it was not measured.
fn shown(value: Option<f64>, text: fn(f64) -> String) -> String {
    value.map(text).unwrap_or_default()
}

fn ranked(report: &ReportData, pictures: &[Picture]) -> Markup {
    let found = report.discovery;
    if found.ranked.is_empty() && found.smallest.is_empty() {
        return html! {};
    }
    html! {
        section aria-labelledby="ranked" {
            h2 id="ranked" { "Candidates and their evidence" }
            @if !found.ranked.is_empty() {
                div class="figures wide" {
                    (figures(pictures, "candidates"))
                    div class="scroll" { table {
                        thead { tr { th { "Candidate" } th { "log evidence" } th { "log evidence at contacts" } th { "other videos, between contacts" } } }
                        tbody { @for r in found.ranked.iter().take(12) {
                            tr { th { (label(&r.effect)) } td { (shown(r.log_evidence, number)) } td { (shown(r.contact_log_evidence, number)) } td { (shown(r.held_out_rmse, mm)) } }
                        } }
                    } }
                }
            }
            @if !found.smallest.is_empty() {
                h3 { "The smallest effect of each kind that would have been detected" }
                div class="scroll" { table {
                    thead { tr { th { "Kind" } th { "Parameter" } th { "would have been detected from" } } }
                    tbody { @for s in &found.smallest {
                        tr { th { (label(&s.kind)) } td { (s.parameter) } td { (number(s.value)) " " (unit(&s.unit)) } }
                    } }
                } }
            }
        }
    }
}

fn answers(report: &ReportData) -> Markup {
    html! {
        section aria-labelledby="answers" {
            h2 id="answers" { "Questions" }
            @if report.answers.iter().any(|a| report.scenes.iter().all(|s| s.name != a.scene.name)) {
                p { "Some questions are about other videos, each with its own model." }
            }
            @for (k, answered) in report.answers.iter().enumerate() { (answer(k, answered)) }
        }
    }
}

fn answer(k: usize, answered: &AnsweredQuestion) -> Markup {
    let AnsweredQuestion { question, scene, answer, .. } = *answered;
    let factual = top_view::factual(answered);
    let frames = factual.states.len();
    let changed = answer.simulations.iter().filter(|s| !s.interventions.is_empty());
    let mut sides =
        vec![PlayerSide { title: "Without a change".into(), run: &factual, class: "", measured: true }];
    sides.extend(changed.enumerate().map(|(n, s)| PlayerSide {
        title: if n == 0 { "With the change".into() } else { format!("With the change ({})", n + 1) },
        run: &s.best,
        class: "",
        measured: false,
    }));
    html! {
        article {
            h3 { "“" (question) "”" }
            p class="quiet" { (scene.name) }
            @if let Some(text) = &answer.answer { p class="verdict" { (text) " (" (share(answer.probability)) ")" } (derivation(&answer.derivation)) }
            @for choice in &answer.choices {
                p { (choice.choice) ": " strong { (if choice.correct { "yes ✓" } else { "no ✗" }) }
                    span class="quiet" { " " (share(if choice.correct { choice.probability } else { 1.0 - choice.probability })) " sure" } }
                (derivation(&choice.derivation))
            }
            p { (answer.explanation) }
            @if frames > 0 { (legend(scene)) (player(&format!("answer-{}", k + 1), scene, &sides, None, html! {})) }
            div class="figures" { @for p in top_view::of_answer(k, answered) { (p.figure()) } }
        }
    }
}

/// The name of a trace, shortened.
fn short(name: &str) -> String {
    const DIGITS: usize = "traces/".len() + 12;
    name.chars().take(DIGITS).collect()
}

fn share(p: f64) -> String {
    format!("{:.0} %", 100.0 * p)
}

/// The steps of the program, without those whose result repeats the word.
fn derivation(steps: &[DerivationStep]) -> Markup {
    html! {
        details { summary { "Derivation" } ol { @for s in steps.iter().filter(|s| s.token != s.result) {
            li { code { (s.token) } " " (s.result) }
        } } }
    }
}

fn traces(report: &ReportData) -> Markup {
    html! {
        section aria-labelledby="traces" {
            h2 id="traces" { "Traces" }
            p { "The numbers of the simulations above, as MCAP files for Foxglove or Rerun." }
            ul class="traces" { @for t in report.traces {
                li { (t.about) ": " @match &t.href { Some(href) => { a href=(href) { (short(&t.name)) } }, None => { code { (t.name) } } } }
            } }
        }
    }
}
