//! The fitted numbers of the last model as tables, with the digits and the intervals that every output has.

use super::ReportData;
use super::top_view::name;
use super::views::label;
use crate::discover::{FoundEffect, ParameterEstimate, ParameterValue};
use crate::fit::{Estimate, Fit};
use crate::num::{decimals, interval_digits, measured_digits};
use maud::{Markup, html};

/// What a revision changes, by the effect that it adds or removes.
pub fn step_words(added: Option<&str>, removed: Option<&str>) -> String {
    match (added, removed) {
        (Some(effect), _) => format!("+ {}", label(effect)),
        (None, Some(effect)) => format!("− {}", label(effect)),
        (None, None) => "start".into(),
    }
}

/// A unit with superscripts; empty for a pure number.
pub fn unit(unit: &str) -> String {
    if unit == "1" { String::new() } else { unit.replace("^2", "²").replace("^3", "³") }
}

/// A parameter of an added effect with its 95 % interval.
pub fn reported(p: &ParameterEstimate) -> Markup {
    let numbers = |v: &ParameterValue| match v {
        ParameterValue::Number(v) => vec![*v],
        ParameterValue::Vector(v) => v.to_vec(),
        ParameterValue::Word(_) => vec![],
    };
    let (values, low, high) = (numbers(&p.value), numbers(&p.low), numbers(&p.high));
    let reach: Vec<f64> = low.iter().zip(&high).map(|(low, high)| 0.5 * (high - low)).collect();
    let text = |of: &[f64]| {
        let one = |(v, reach): (&f64, &f64)| {
            if v.is_finite() { format!("{v:.*}", decimals(*reach)) } else { "–".into() }
        };
        let all: Vec<String> = of.iter().zip(&reach).map(one).collect();
        if all.len() == 1 { all.concat() } else { format!("({})", all.join(", ")) }
    };
    let whose = p.owner.map_or(String::new(), |o| format!("object {}: ", o.object));
    html! {
        (whose) (p.name) " = "
        @match &p.value {
            ParameterValue::Word(word) => strong { (word) },
            _ => {
                strong { (text(&values)) " " (unit(&p.unit)) }
                span class="quiet" { " 95 % interval " (text(&low)) " to " (text(&high)) }
            }
        }
    }
}

/// The cells of an estimate: value with standard deviation, interval and unit; `id` is its name for programs.
fn estimate(fit: &Fit, video: usize, id: &str, e: &Estimate) -> Markup {
    let [low, high] = fit.interval(video, e);
    let [value, sd] = measured_digits(e.value, e.sd);
    let [from, to] = interval_digits(low, high);
    let class = (!e.identified && e.sd > 0.0).then_some("open");
    html! {
        td class=[class] data-number=(id) data-value=(e.value) data-sd=(e.sd) data-low95=(low) data-high95=(high)
            data-unit=(e.unit) data-identified=(e.identified) {
            @if e.sd == 0.0 { (super::chart::number(e.value)) " (fixed)" } @else { (value) " ± " (sd) }
        }
        td class=[class] { @if e.sd > 0.0 { (from) " to " (to) } @if class.is_some() { " (not identified)" } }
        td class=[class] { (unit(&e.unit)) }
    }
}

/// Objects and effects of each video.
pub fn parameters(report: &ReportData) -> Markup {
    let Some(last) = report.discovery.revisions.last() else { return html! {} };
    let added = |name: &str| report.discovery.effects.iter().any(|e: &FoundEffect| e.effect == name);
    html! {
        section aria-labelledby="parameters" {
            h2 id="parameters" { "Parameters of the last model" }
            p { "±: standard deviation, which also holds how far the videos disagree about an added effect. The interval holds 95 %. \
                 The videos do not determine a value marked “not identified”: it comes mostly from the prior. \
                 Two objects a and b rebound with e = coefficient r_a r_b d_ab, at most 1: r are their factors, d the deviation of their pair." }
            @for (k, scene) in report.scenes.iter().enumerate() {
                details class="numbers" data-video=(scene.name) open[k == 0] {
                    summary { (scene.name) }
                    div class="scroll" { table {
                        thead { tr { th { "Object" } th { "number" } th { "value ± sd" } th { "95 % interval" } th { "unit" } } }
                        tbody { @for o in last.fit.objects(k) {
                            @let object = scene.objects.iter().find(|s| s.id == o.id).map_or(o.id.to_string(), name);
                            tr { th { (object) } td { "mass" }
                                (estimate(&last.fit, k, &format!("object {} mass", o.id), &o.mass)) }
                            tr { th { (object) } td { "restitution factor" }
                                (estimate(&last.fit, k, &format!("object {} restitution factor", o.id), &o.restitution)) }
                        }
                        @for pair in last.fit.posterior.pairs.iter().filter(|pair| pair.scene == k) {
                            @let [a, b] = pair.objects;
                            tr { th { (a) " and " (b) } td { "restitution e" }
                                (estimate(&last.fit, k, &format!("pair {a}-{b} restitution"), &pair.estimate)) }
                        } }
                    } }
                    div class="scroll" { table {
                        thead { tr { th { "Effect" } th { "parameter" } th { "of" } th { "value ± sd" } th { "95 % interval" } th { "unit" } } }
                        tbody { @for s in last.fit.shared(k) {
                            @for (of, value) in s.labels.iter().zip(&s.values).filter(|(_, v)| v.sd > 0.0) {
                                @let whose = if of.is_empty() { String::new() } else { format!("[{of}]") };
                                tr class=[added(&s.effect).then_some("added")] {
                                    th { (label(&s.effect)) } td { (label(&s.parameter)) } td { (of) }
                                    (estimate(&last.fit, k, &format!("{}.{}{whose}", s.effect, s.parameter), value)) }
                            }
                        } }
                    } }
                }
            }
        }
    }
}
