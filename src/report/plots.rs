//! Pictures of the residuals: against time, on the table, their autocorrelation, and against possible causes; pictures of
//! the revisions and of the candidates.

use super::ReportData;
use super::chart::{Axis, Chart, Picture, PictureData, Series, dots, line, number, px};
use super::top_view::{PlanView, name};
use super::views::{
    ModelStage, NINETY_NINE, PositionResidual, ReportViews, along, label, left, weighted_mean,
};
use crate::discover::UnexplainedAcceleration;
use crate::num::{elementary, quantile};
use crate::scene::Scene;
use maud::{Markup, html};

/// Number of candidates in the picture.
const CANDIDATES: usize = 8;
/// Number of groups, of equal size, whose means are drawn.
const GROUPS: usize = 8;
/// Bars: width of names, of a row, of the picture (px).
const NAMES: f64 = 150.0;
const ROW: f64 = 36.0;
const WIDTH: f64 = 400.0;
/// Length of a magnified residual at the 90 % quantile (px).
const RESIDUAL: f64 = 16.0;
/// Length of the arrow at the 90 % quantile of the accelerations (px).
const ARROW: f64 = 34.0;

/// The CSS class of a model.
pub fn class(stages: usize, stage: usize) -> &'static str {
    if stages > 1 && stage == 0 { "before" } else { "after" }
}

/// The name of a model.
pub fn word(views: &ReportViews, stage: usize) -> &str {
    views.names.get(stage).map_or("the model", String::as_str)
}

/// All pictures except those of the table from above.
pub fn all(report: &ReportData, views: &ReportViews) -> Vec<Picture> {
    let mut all = vec![ladder(report)];
    for (k, scene) in report.scenes.iter().enumerate() {
        all.push(against_time(k, scene, views));
    }
    for (k, stage) in views.stages.iter().enumerate() {
        all.push(map(k, report, views, stage));
    }
    for (k, stage) in views.stages.iter().enumerate() {
        all.push(magnified(k, report, views, stage));
    }
    for (k, stage) in views.stages.iter().enumerate() {
        all.push(quiver(k, report, views, stage));
    }
    all.push(autocorrelation(views));
    if let Some(first) = views.stages.first() {
        all.extend(causes(first));
    }
    if !report.discovery.ranked.is_empty() {
        all.push(candidates(report));
    }
    all
}

/// The errors of the revisions as bars, and the noise as a line.
fn ladder(report: &ReportData) -> Picture {
    let noise = report.discovery.noise_sigma;
    let revisions = &report.discovery.revisions;
    let most =
        revisions.iter().flat_map(|r| [r.rmse, r.held_out_rmse]).fold(noise, f64::max).max(f64::MIN_POSITIVE);
    let at = |v: f64| NAMES + (WIDTH - NAMES - 72.0) * v / most;
    let height = 22.0 + ROW * revisions.len() as f64 + 24.0;
    let bar = |y: f64, v: f64, class: &str| {
        html! {
            rect class={ "filled " (class) } x=(px(NAMES)) y=(px(y)) width=(px(at(v) - NAMES)) height="11" {}
            text class="small" x=(px(at(v).max(at(noise)) + 5.0)) y=(px(y + 9.5)) { (number(1e3 * v)) " mm" }
        }
    };
    let body = html! {
        @for (k, r) in revisions.iter().enumerate() {
            @let y = 14.0 + ROW * k as f64;
            @let class = class(revisions.len(), k);
            text class="bold" x="4" y=(px(y + 16.0)) { (words(report, k)) }
            (bar(y, r.rmse, class))
            (bar(y + 13.0, r.held_out_rmse, &format!("{class} pale")))
        }
        line class="floor" x1=(px(at(noise))) x2=(px(at(noise))) y1="8" y2=(px(height - 20.0)) {}
        text class="small" x=(px(at(noise))) y=(px(height - 6.0)) text-anchor="middle" {
            "noise floor " (number(1e3 * noise)) " mm"
        }
    };
    let row = |(k, r): (usize, &crate::discover::Revision)| Series {
        name: words(report, k),
        points: vec![(vec![1e3 * r.rmse, 1e3 * r.held_out_rmse], (at(r.rmse), 27.0 + ROW * k as f64))],
    };
    let data =
        PictureData::new(&["error (mm)", "held out (mm)"], revisions.iter().enumerate().map(row).collect());
    Picture {
        data,
        name: "ladder".into(),
        title: "Error of each revision of the model".into(),
        caption: "Root mean square error per coordinate. Strong: all frames. Pale: held out, the last quarter of each video, \
                  predicted by a fit of the rest."
            .into(),
        size: [WIDTH, height],
        body,
    }
}

/// What a revision changes.
pub fn words(report: &ReportData, revision: usize) -> String {
    report.steps.get(revision).cloned().unwrap_or_default()
}

fn against_time(video: usize, scene: &Scene, views: &ReportViews) -> Picture {
    let noise = views.noise.get(video).copied().unwrap_or(0.0);
    let residuals: Vec<&[PositionResidual]> =
        views.stages.iter().filter_map(|s| s.residuals.get(video)).map(Vec::as_slice).collect();
    let frames = scene.times.len();
    let seen: Vec<usize> = (0..frames)
        .map(|f| residuals.first().map_or(0, |r| r.iter().filter(|r| r.frame == f).count()))
        .collect();
    let rms = |of: &[PositionResidual]| -> Vec<Option<f64>> {
        let one = |f: usize| {
            let (sum, n) = of
                .iter()
                .filter(|r| r.frame == f)
                .fold((0.0, 0), |(s, n), r| (s + elementary::powi(r.size(), 2), n + 2));
            (n > 0).then(|| 1e3 * (sum / n as f64).sqrt())
        };
        (0..frames).map(one).collect()
    };
    let curves: Vec<Vec<Option<f64>>> = residuals.iter().map(|r| rms(r)).collect();
    let band: Vec<(f64, f64)> =
        seen.iter().map(|n| (1e3 * noise * edge(2 * n, -1.0), 1e3 * noise * edge(2 * n, 1.0))).collect();
    let values = curves.iter().flatten().flatten().copied().chain(band.iter().flat_map(|b| [b.0, b.1]));
    let chart = Chart {
        x: Axis {
            low: 0.0,
            high: scene.times.last().copied().unwrap_or(1.0).max(1e-3),
            label: "time (s)".into(),
            logarithmic: false,
        },
        y: Axis::decades("residual (mm)", values),
    };
    let at = |f: usize, v: f64| chart.at(scene.time_of(f), v);
    let upper = band.iter().enumerate().map(|(f, b)| Some(at(f, b.1)));
    let lower = band.iter().enumerate().rev().map(|(f, b)| Some(at(f, b.0)));
    let [left, top, right, bottom] = Chart::inside();
    let end = scene.times.last().copied().unwrap_or(1.0).max(1e-3);
    let own = |stage: usize, object: usize| {
        let of = residuals.get(stage).copied().unwrap_or_default();
        let mut places: Vec<Option<(f64, f64)>> = vec![None; frames];
        for r in of.iter().filter(|r| r.object == object) {
            if let Some(slot) = places.get_mut(r.frame) {
                *slot = Some(at(r.frame, 1e3 * r.size() / std::f64::consts::SQRT_2));
            }
        }
        line(places.into_iter())
    };
    let data = html! {
        path class="band" d={ (line(upper.chain(lower))) "Z" } {}
        @for t in views.contacts(video, scene) {
            @let (x, _) = chart.at(t, 1.0);
            line class="contact" x1=(px(x)) x2=(px(x)) y1=(px(top)) y2=(px(bottom)) {}
        }
        @for (k, curve) in curves.iter().enumerate() {
            @let class = class(curves.len(), k);
            @for object in 0..scene.objects.len() { path class={ (class) " faint" } d=(own(k, object)) {} }
            path class=(class) d=(line(curve.iter().enumerate().map(|(f, v)| v.map(|v| at(f, v))))) {}
        }
        line class="cursor moves" data-left=(px(left)) data-right=(px(right)) data-end=(end) x1=(px(left)) x2=(px(left))
            y1=(px(top)) y2=(px(bottom)) {}
        (legend(views))
    };
    let caption = "Root mean square per coordinate; thick: all objects, thin: single objects. Green band: 99 % interval of pure noise. Dotted: contacts.";
    let series = curves.iter().enumerate().map(|(k, curve)| {
        let points = curve.iter().enumerate().filter_map(|(f, v)| Some((scene.time_of(f), (*v)?)));
        chart.series(word(views, k), points)
    });
    let data_of = PictureData::new(&["time (s)", "residual (mm)"], series.collect());
    let name = format!("residual-time-{}", video + 1);
    Picture { data: data_of, ..chart.picture(&name, "Error against time", caption, data) }
}

/// Edge of the 99 % interval of the root mean square of `n` normal numbers (Wilson-Hilferty); `side` is -1 or 1.
fn edge(n: usize, side: f64) -> f64 {
    let n = n.max(1) as f64;
    let cube = 1.0 - 2.0 / (9.0 * n) + side * NINETY_NINE * (2.0 / (9.0 * n)).sqrt();
    elementary::powi(cube.max(0.05), 3).sqrt()
}

fn legend(views: &ReportViews) -> Markup {
    let [left, top, right, _] = Chart::inside();
    let stages = views.stages.len();
    html! {
        @if stages > 1 {
            @for k in 0..stages {
                @let x = left + 8.0 + 0.5 * (right - left) * k as f64;
                line class=(class(stages, k)) x1=(px(x)) x2=(px(x + 18.0)) y1=(px(top - 5.0)) y2=(px(top - 5.0)) {}
                text class="small" x=(px(x + 23.0)) y=(px(top - 1.0)) { (word(views, k)) }
            }
        }
    }
}

fn map(k: usize, report: &ReportData, views: &ReportViews, stage: &ModelStage) -> Picture {
    const STEPS: [(f64, &str, &str); 4] = [
        (0.0, "hot1", "< 3"),
        (3.0, "hot2", "3 to 6"),
        (6.0, "hot3", "6 to 12"),
        (12.0, "hot4", "> 12 standard deviations"),
    ];
    let view = PlanView::around(report.scenes.iter(), &[]);
    let noise = report.discovery.noise_sigma.max(f64::MIN_POSITIVE);
    let of = |step: usize| {
        let (low, high) = (STEPS[step].0, STEPS.get(step + 1).map_or(f64::INFINITY, |s| s.0));
        let all = stage.residuals.iter().flatten();
        let own = all.filter(move |r| (low..high).contains(&(r.size() / noise)));
        dots(own.map(|r| view.at(r.at[0], r.at[1])))
    };
    let [w, h] = view.size;
    let body = html! {
        @for step in 0..STEPS.len() { path class={ "dots " (STEPS[step].1) } d=(of(step)) {} }
        @for (n, (_, class, text)) in STEPS.iter().enumerate() {
            @let x = 12.0 + 84.0 * n as f64;
            path class={ "dots " (class) } style="stroke-width:9" d={ "M" (px(x)) " " (px(h + 15.0)) "h0" } {}
            text class="small" x=(px(x + 9.0)) y=(px(h + 19.0)) { (text) }
        }
        (view.axes())
    };
    Picture {
        data: residual_data(report, &view, stage),
        name: format!("residual-map-{}", k + 1),
        title: format!("Residuals on the table, {}", word(views, k)),
        caption: "Each measured position of all videos; the colour is the distance to the simulation.".into(),
        size: [w, h + 26.0],
        body,
    }
}

/// The residuals of each object as numbers; the place is that of the measured position.
fn residual_data(report: &ReportData, view: &PlanView, stage: &ModelStage) -> PictureData {
    let columns = ["frame", "x (m)", "y (m)", "measured - simulated x (mm)", "measured - simulated y (mm)"];
    let of = |(scene, all): (&Scene, &Vec<PositionResidual>)| -> Vec<Series> {
        let one = |(k, object): (usize, &crate::scene::Object)| {
            let row = |r: &PositionResidual| {
                let values = vec![r.frame as f64, r.at[0], r.at[1], 1e3 * r.off[0], 1e3 * r.off[1]];
                (values, view.at(r.at[0], r.at[1]))
            };
            let points = all.iter().filter(|r| r.object == k).map(row).collect();
            Series { name: format!("{}: {}", scene.name, name(object)), points }
        };
        scene.objects.iter().enumerate().map(one).collect()
    };
    PictureData::new(&columns, report.scenes.iter().zip(&stage.residuals).flat_map(of).collect())
}

/// Each residual as a line from the measured position towards the simulated one, longer than it is.
fn magnified(k: usize, report: &ReportData, views: &ReportViews, stage: &ModelStage) -> Picture {
    let view = PlanView::around(report.scenes.iter(), &[]);
    let mut sizes: Vec<f64> = stage.residuals.iter().flatten().map(PositionResidual::size).collect();
    let typical = quantile(&mut sizes, 0.9).unwrap_or(1.0).max(1e-9);
    let (x_0, x_1) = (view.at(0.0, 0.0).0, view.at(typical, 0.0).0);
    let factor = elementary::powf(10f64, elementary::log10(RESIDUAL / (x_1 - x_0)).floor());
    let factor = [5.0, 2.0, 1.0].map(|m| m * factor).into_iter().find(|m| m * (x_1 - x_0) <= RESIDUAL);
    let factor = factor.unwrap_or(1.0).max(1.0);
    let drawn = |object: usize| {
        let own = stage.residuals.iter().flatten().filter(move |r| r.object == object);
        let ends = own.flat_map(|r| {
            let to = [r.at[0] - factor * r.off[0], r.at[1] - factor * r.off[1]];
            [Some(view.at(r.at[0], r.at[1])), Some(view.at(to[0], to[1])), None]
        });
        line(ends)
    };
    let objects = report.scenes.iter().map(|s| s.objects.len()).max().unwrap_or(0);
    let body = html! {
        @for object in 0..objects { path class={ (class(views.stages.len(), k)) " hair" } d=(drawn(object)) {} }
        (view.axes())
    };
    Picture {
        data: residual_data(report, &view, stage),
        name: format!("residual-magnified-{}", k + 1),
        title: format!("Residuals, {} times magnified, {}", number(factor), word(views, k)),
        caption: "Each line starts at a measured position and leads towards the simulated one.".into(),
        size: view.size,
        body,
    }
}

fn quiver(k: usize, report: &ReportData, views: &ReportViews, stage: &ModelStage) -> Picture {
    let view = PlanView::around(report.scenes.iter(), &[]);
    // Both models have the same scale.
    let first = views.stages.first().map_or(&[][..], |s| &s.unexplained);
    let mut sizes: Vec<f64> = first.iter().map(|u| u.acceleration.norm()).collect();
    let typical = quantile(&mut sizes, 0.9).unwrap_or(1.0).max(1e-9);
    let scale = ARROW / typical;
    let arrow = |u: &UnexplainedAcceleration| {
        let (x, y) = view.at(u.position.x, u.position.y);
        let size = u.acceleration.norm().max(1e-12);
        let shown = (scale * size).min(2.0 * ARROW) / size;
        let (dx, dy) = (u.acceleration.x * shown, -u.acceleration.y * shown);
        let tip = (x + dx, y + dy);
        let barb = |c: f64, s: f64| (tip.0 - 0.28 * (c * dx - s * dy), tip.1 - 0.28 * (s * dx + c * dy));
        line(
            [Some((x, y)), Some(tip), None, Some(barb(0.87, 0.5)), Some(tip), Some(barb(0.87, -0.5))]
                .into_iter(),
        )
    };
    let is_significant = |u: &&UnexplainedAcceleration| u.acceleration.norm() > NINETY_NINE * 1.18 * u.sd;
    let (strong, weak): (Vec<&UnexplainedAcceleration>, Vec<&UnexplainedAcceleration>) =
        stage.unexplained.iter().partition(is_significant);
    let w = view.size[0];
    let round = elementary::powf(10f64, elementary::log10(typical).floor());
    let body = html! {
        @for u in &weak { path class="mute" d=(arrow(u)) {} }
        @for u in &strong { path class=(class(views.stages.len(), k)) d=(arrow(u)) {} }
        line class="cursor" x1=(px(w - 10.0 - scale * round)) x2=(px(w - 10.0)) y1="22" y2="22" {}
        text class="small" x=(px(w - 10.0)) y="14" text-anchor="end" { (number(round)) " m/s²" }
        (view.axes())
    };
    let row = |u: &UnexplainedAcceleration| {
        let values = vec![u.time, u.position.x, u.position.y, u.acceleration.x, u.acceleration.y, u.sd];
        (values, view.at(u.position.x, u.position.y))
    };
    let points = stage.unexplained.iter().map(row).collect();
    let columns = ["time (s)", "x (m)", "y (m)", "missing x (m/s²)", "missing y (m/s²)", "sd (m/s²)"];
    Picture {
        data: PictureData::new(&columns, vec![Series { name: word(views, k).into(), points }]),
        name: format!("residual-acceleration-{}", k + 1),
        title: format!("Missing acceleration, {}", word(views, k)),
        caption: format!(
            "Measured minus model, each over about a second of free motion. Coloured: outside the 99 % interval of noise ({} of {}); \
             gray: inside.",
            strong.len(),
            stage.unexplained.len()
        ),
        size: view.size,
        body,
    }
}

fn autocorrelation(views: &ReportViews) -> Picture {
    let curves: Vec<&[f64]> = views.stages.iter().map(|s| s.autocorrelation.as_slice()).collect();
    // Each position has two coordinates.
    let band = NINETY_NINE / (2.0 * views.count.max(1) as f64).sqrt();
    let values = curves.iter().flat_map(|c| c.iter().copied()).chain([-band, band]);
    let lags = curves.iter().map(|c| c.len()).max().unwrap_or(2).saturating_sub(1) as f64;
    let chart = Chart {
        x: Axis { low: 0.0, high: lags.max(1.0), label: "lag (frames)".into(), logarithmic: false },
        y: Axis::around("autocorrelation", values, true),
    };
    let ((left, high), (right, low)) = (chart.at(0.0, band), chart.at(lags.max(1.0), -band));
    let data = html! {
        rect class="band" x=(px(left)) y=(px(high)) width=(px(right - left)) height=(px((low - high).max(2.0))) {}
        @for (k, curve) in curves.iter().enumerate() {
            @let points: Vec<(f64, f64)> = curve.iter().enumerate().map(|(l, v)| chart.at(l as f64, *v)).collect();
            path class=(class(curves.len(), k)) d=(line(points.iter().map(|p| Some(*p)))) {}
            path class={ "dots " (class(curves.len(), k)) } d=(dots(points.into_iter())) {}
        }
        (legend(views))
    };
    let caption = "Correlation of a residual with the one some frames later. Noise lies within the green 99 % band; a missing effect \
                   does not.";
    let series = curves.iter().enumerate().map(|(k, curve)| {
        chart.series(word(views, k), curve.iter().enumerate().map(|(lag, v)| (lag as f64, *v)))
    });
    let data_of = PictureData::new(&["lag (frames)", "autocorrelation"], series.collect());
    Picture { data: data_of, ..chart.picture("autocorrelation", "Are the residuals noise?", caption, data) }
}

/// The missing acceleration against speed, time and position.
fn causes(first: &ModelStage) -> Vec<Picture> {
    type Cause = (&'static str, &'static str, fn(&UnexplainedAcceleration) -> f64);
    const CAUSES: [Cause; 4] = [
        ("speed", "speed (m/s)", |u| u.velocity.norm()),
        ("time", "time (s)", |u| u.time),
        ("x", "x (m)", |u| u.position.x),
        ("y", "y (m)", |u| u.position.y),
    ];
    let all = &first.unexplained;
    type Part = (&'static str, &'static str, fn(&UnexplainedAcceleration) -> f64);
    const PARTS: [Part; 2] =
        [("before", "along the motion", along), ("after", "to the left (negative: right)", left)];
    let one = |(name, label, cause): &Cause| {
        let values = all.iter().flat_map(|u| [along(u), left(u)]);
        let chart = Chart {
            x: Axis::around(label, all.iter().map(cause), *name == "speed"),
            y: Axis::around("missing (m/s²)", values, true),
        };
        let mut sorted: Vec<&UnexplainedAcceleration> = all.iter().collect();
        sorted.sort_by(|a, b| cause(a).total_cmp(&cause(b)));
        let group = sorted.len().div_ceil(GROUPS).max(1);
        let means = |part: fn(&UnexplainedAcceleration) -> f64| -> Vec<(f64, f64)> {
            let mean = |of: &[&UnexplainedAcceleration]| {
                let place: f64 = of.iter().map(|u| cause(u)).sum::<f64>() / of.len() as f64;
                chart.at(place, weighted_mean(of.iter().copied(), part).0)
            };
            sorted.chunks(group).map(mean).collect()
        };
        let [low, top, high, _] = Chart::inside();
        let (_, zero) = chart.at(chart.x.low, 0.0);
        let data = html! {
            line class="axis" x1=(px(low)) x2=(px(high)) y1=(px(zero)) y2=(px(zero)) {}
            @for (n, (class, name, part)) in PARTS.into_iter().enumerate() {
                path class={ "dots pale " (class) } d=(dots(all.iter().map(|u| chart.at(cause(u), part(u))))) {}
                path class=(class) d=(line(means(part).into_iter().map(Some))) {}
                @let x = low + 8.0 + 0.5 * (high - low) * n as f64;
                line class=(class) x1=(px(x)) x2=(px(x + 18.0)) y1=(px(top - 5.0)) y2=(px(top - 5.0)) {}
                text class="small" x=(px(x + 23.0)) y=(px(top - 1.0)) { (name) }
            }
        };
        let caption = format!(
            "For the first model. Zero everywhere: nothing is missing. A steady rise or fall: the missing effect depends on {}.",
            if name.len() == 1 { "the position" } else { name }
        );
        let series = PARTS
            .map(|(_, part_name, part)| chart.series(part_name, all.iter().map(|u| (cause(u), part(u)))));
        let data_of = PictureData::new(&[label, "missing (m/s²)"], series.into());
        let title = format!("Missing acceleration against {name}");
        Picture { data: data_of, ..chart.picture(&format!("cause-{name}"), &title, &caption, data) }
    };
    CAUSES.iter().map(one).collect()
}

fn candidates(report: &ReportData) -> Picture {
    // Only evidence of the same data can be compared: that of the motion between contacts.
    let measured = report.discovery.ranked.iter().filter_map(|r| Some((r, r.log_evidence?)));
    let shown: Vec<_> = measured.take(CANDIDATES).collect();
    let most = shown.iter().map(|r| r.1).fold(1.0, f64::max);
    let height = 10.0 + 24.0 * shown.len() as f64 + 4.0;
    let body = html! {
        @for (k, (r, evidence)) in shown.iter().enumerate() {
            @let y = 8.0 + 24.0 * k as f64;
            @let width = (WIDTH - NAMES - 62.0) * (evidence / most).clamp(0.0, 1.0);
            @let chosen = report.discovery.effects.iter().any(|e| e.effect == r.effect);
            text class=[chosen.then_some("bold")] x="4" y=(px(y + 12.0)) { (label(&r.effect)) }
            rect class={ "filled after" @if !chosen { " pale" } } x=(px(NAMES)) y=(px(y)) width=(px(width)) height="15" {}
            text class="small" x=(px(NAMES + width + 5.0)) y=(px(y + 12.0)) { (number(*evidence)) }
        }
    };
    let bar = |(k, (r, evidence)): (usize, &(&crate::discover::RankedEffect, f64))| {
        let at = (NAMES + (WIDTH - NAMES - 62.0) * (evidence / most).clamp(0.0, 1.0), 15.0 + 24.0 * k as f64);
        Series { name: label(&r.effect), points: vec![(vec![*evidence], at)] }
    };
    let data = PictureData::new(&["log evidence (nats)"], shown.iter().enumerate().map(bar).collect());
    Picture {
        data,
        name: "candidates".into(),
        title: "Which effect explains the videos best".into(),
        caption: "Log evidence (nats) of the motion between contacts: gain over the model without the candidate, less the cost of its \
                  parameters. Above 5 is strong; between two candidates only the difference matters. Bold: added to the model."
            .into(),
        size: [WIDTH, height],
        body,
    }
}
