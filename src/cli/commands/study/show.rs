//! `show`: the numbers of a fitted model with their uncertainty, its errors and its history; to read, to compute with, to cite.

use super::discover::NINETY_FIVE;
use super::revise;
use crate::api::v1::{Estimate, Model, Revision, SharedEstimate};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output;
use crate::cli::output::revisions::{self, short_id};
use crate::cli::version::version;
use crate::num::NUMERIC_FINGERPRINT;
use serde_json::{Value, json};

#[derive(clap::Args)]
pub struct ShowArgs {
    /// First digits of the id of a model or revision, or its whole name [default: lists all of them].
    #[arg(value_name = "ID")]
    id: Option<String>,
    /// Prints, in place of the tables, a text to cite.
    #[arg(long, value_enum, value_name = "FORMAT", requires = "id")]
    cite: Option<CitationFormat>,
    /// Writes the numbers as CSV too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE", requires = "id", conflicts_with = "cite")]
    csv: Option<String>,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum CitationFormat {
    /// Plain text.
    Text,
    /// Formulas for LaTeX.
    Latex,
    /// An entry for BibTeX.
    Bibtex,
}

pub async fn run(target: &Target, args: ShowArgs) -> Result<(), Failure> {
    for (flag, file) in [("--json", &args.json), ("--csv", &args.csv)] {
        file.as_ref().map(|file| output::writable(flag, file.as_ref())).transpose()?;
    }
    if target.server.is_none() && target.data_dir.is_none() {
        let message = "models are kept only with --data-dir or --server; name where yours are";
        return Err(Failure::input(message));
    }
    let connection = Connection::open(target).await?;
    let known = all_models(&connection).await?;
    let json_file = args.json.as_deref();
    match &args.id {
        None => {
            let value = || json!({ "models": heads(&known).map(summary).collect::<Vec<_>>() });
            output::result(json_file, &listing(&known), value)?;
        }
        Some(id) => {
            let shown = ShownModel::of(&known, id)?;
            if let Some(file) = args.csv.as_deref().filter(|file| *file != "-") {
                output::file(file.as_ref(), shown.csv()?.as_bytes())?;
            }
            let text = match (args.csv.as_deref(), args.cite) {
                (Some("-"), _) => shown.csv()?,
                (_, Some(format)) => shown.citation(format),
                _ => shown.text(&known),
            };
            output::result(json_file, &text, || shown.to_json(&known))?;
        }
    }
    connection.close().await
}

/// All models of the service, video by video.
async fn all_models(connection: &Connection) -> Result<Vec<Model>, Failure> {
    let mut models = vec![];
    for video in connection.video_names().await? {
        models.extend(connection.models_of(&video).await?);
    }
    Ok(models)
}

/// The id in a model's name.
fn id(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or_default()
}

/// One model for each revision, and the others.
fn heads(known: &[Model]) -> impl Iterator<Item = &Model> {
    let leads = |m: &&Model| m.history.as_ref().is_none_or(|r| r.models.first() == Some(&m.name));
    known.iter().filter(leads)
}

fn change(model: &Model) -> String {
    model.history.as_ref().map_or("fit".into(), revisions::change)
}

fn listing(known: &[Model]) -> String {
    let mm = |v: f64| format!("{:.2}", 1e3 * v);
    let row = |m: &Model| {
        let videos = m.history.as_ref().map_or(1, |r| r.models.len());
        let held_out = m.history.as_ref().map_or("-".into(), |r| mm(r.held_out_rmse));
        let rmse = m.history.as_ref().map_or(m.rmse, |r| r.rmse);
        vec![short_id(&m.name), m.preset.clone(), change(m), videos.to_string(), held_out, mm(rmse)]
    };
    let rows: Vec<Vec<String>> = heads(known).map(row).collect();
    match rows.is_empty() {
        true => "no model is kept here yet; `vrdp fit` and `vrdp discover` make some\n".into(),
        false => {
            let header = ["id", "preset", "change", "videos", "held out mm", "rmse mm"];
            format!("{}  its numbers: vrdp show ID\n", output::table(&header, &rows))
        }
    }
}

fn summary(model: &Model) -> Value {
    let of = |f: &dyn Fn(&Revision) -> f64| model.history.as_ref().map(f);
    json!({
        "id": id(&model.name),
        "name": model.name,
        "preset": model.preset,
        "change": change(model),
        "videos": model.history.as_ref().map_or(1, |r| r.models.len()),
        "rmse_m": of(&|r| r.rmse).unwrap_or(model.rmse),
        "held_out_rmse_m": of(&|r| r.held_out_rmse),
    })
}

/// A model with those of the other videos of its revision.
struct ShownModel<'m> {
    models: Vec<&'m Model>,
}

/// One number of a model.
struct ModelNumber {
    /// `linear_drag.c`, `object 3 mass`; of one of several videos: `object 3 mass (video 2)`.
    name: String,
    estimate: Estimate,
}

impl<'m> ShownModel<'m> {
    fn of(known: &'m [Model], digits: &str) -> Result<ShownModel<'m>, Failure> {
        let fits = |m: &&Model| m.name == digits || (!digits.is_empty() && id(&m.name).starts_with(digits));
        let mut found: Vec<&Model> = known.iter().filter(fits).collect();
        found.dedup_by(|a, b| a.history.is_some() && a.history == b.history);
        match &found[..] {
            [one] => {
                let names = one.history.as_ref().map_or(vec![one.name.clone()], |r| r.models.clone());
                let named = names.iter().filter_map(|name| known.iter().find(|m| m.name == *name));
                Ok(ShownModel { models: named.collect() })
            }
            [] => Err(Failure::input(format!("{digits}: no such model; `vrdp show` lists all of them"))),
            _ => Err(Failure::input(format!("{digits}: several models have these first digits; give more"))),
        }
    }

    fn history(&self) -> Option<&'m Revision> {
        self.models.first()?.history.as_ref()
    }

    /// What the videos share, then what their objects have; a video that differs in a shared number has it named.
    fn numbers(&self) -> Vec<ModelNumber> {
        let mut all: Vec<ModelNumber> = vec![];
        let several = self.models.len() > 1;
        let of_video = |k: usize| if several { format!(" (video {})", k + 1) } else { String::new() };
        for (k, model) in self.models.iter().enumerate() {
            for (name, estimate) in model.shared.iter().flat_map(shared_numbers) {
                let is_known = all.iter().any(|n| n.name == name && n.estimate == estimate);
                let name = if k == 0 { name } else { name + &of_video(k) };
                if !is_known {
                    all.push(ModelNumber { name, estimate });
                }
            }
        }
        for (k, model) in self.models.iter().enumerate() {
            let of_video = of_video(k);
            for o in &model.objects {
                let numbers = [("mass", &o.mass), ("restitution factor", &o.restitution)];
                let known = numbers.into_iter().filter_map(|(what, e)| Some((what, e.clone()?)));
                all.extend(known.map(|(what, estimate)| ModelNumber {
                    name: format!("object {} {what}{of_video}", o.object_id),
                    estimate,
                }));
            }
        }
        all
    }

    fn text(&self, known: &[Model]) -> String {
        let Some(first) = self.models.first() else { return String::new() };
        let row = |n: &ModelNumber| {
            let e = &n.estimate;
            let (value, interval) = match e.sd == 0.0 {
                true => (format!("{} given", output::number(e.value)), String::new()),
                false => (output::measured(e.value, e.sd), output::interval(low(e), high(e))),
            };
            let from = if e.identified || e.sd == 0.0 { "" } else { "prior" };
            vec![n.name.clone(), value, interval, e.unit.clone(), from.into()]
        };
        let rows: Vec<Vec<String>> = self.numbers().iter().map(row).collect();
        let header = ["parameter", "value ± sd", "95 % interval", "unit", "from"];
        let mut text = format!("{}: {} (preset {})\n\n", short_id(&first.name), change(first), first.preset);
        text += &output::table(&header, &rows);
        text += "  prior: the videos do not determine it; given: not fitted\n";
        match self.history() {
            Some(last) => {
                let lineage = lineage(known, last);
                let name = |r: &Revision| format!("{}  {}", revisions::id(r), revisions::change(r));
                text += &format!("\n{}", revisions::table(&lineage, last.models.len() > 1, name));
                text += &format!("  noise {:.2} mm\n", 1e3 * last.noise_sigma);
            }
            None => text += &format!("\n{}\n", fit_errors(first)),
        }
        text += "\n  fitted to, and for --model of other commands:\n";
        text + &self.models.iter().map(|m| format!("    {}\n", m.name)).collect::<String>()
    }

    fn csv(&self) -> Result<String, Failure> {
        let mut out = csv::Writer::from_writer(vec![]);
        let header = ["parameter", "value", "sd", "low95", "high95", "unit", "identified"];
        out.write_record(header).map_err(Failure::other)?;
        for n in self.numbers() {
            let e = &n.estimate;
            let [value, sd, low, high] = [e.value, e.sd, low(e), high(e)].map(|v| v.to_string());
            let row = [n.name, value, sd, low, high, e.unit.clone(), e.identified.to_string()];
            out.write_record(row).map_err(Failure::other)?;
        }
        String::from_utf8(out.into_inner().map_err(Failure::other)?).map_err(Failure::other)
    }

    fn to_json(&self, known: &[Model]) -> Value {
        let number = |n: &ModelNumber| {
            let e = &n.estimate;
            json!({
                "name": n.name, "value": e.value, "sd": e.sd, "low95": low(e), "high95": high(e),
                "unit": e.unit, "identified": e.identified,
            })
        };
        let lineage = self.history().map(|last| lineage(known, last)).unwrap_or_default();
        json!({
            "model": self.models.first().map(|m| summary(m)),
            "fitted_to": self.models.iter().map(|m| &m.name).collect::<Vec<_>>(),
            "numbers": self.numbers().iter().map(number).collect::<Vec<_>>(),
            "history": lineage.into_iter().map(revise::to_json).collect::<Vec<_>>(),
        })
    }

    /// The numbers that the videos determine, with what is needed to find them again.
    fn citation(&self, format: CitationFormat) -> String {
        let Some(first) = self.models.first() else { return String::new() };
        let is_latex = matches!(format, CitationFormat::Latex | CitationFormat::Bibtex);
        let number = |n: &ModelNumber| {
            let value = output::concise(n.estimate.value, n.estimate.sd);
            match is_latex {
                true => latex(&n.name, &value, &n.estimate.unit),
                false => format!("{} = {value} {}", n.name, plain_unit(&n.estimate.unit)).trim_end().into(),
            }
        };
        let all = self.numbers();
        let known = all.iter().filter(|n| n.estimate.identified && n.estimate.sd > 0.0);
        let numbers = known.map(number).collect::<Vec<String>>().join("; ");
        let errors = self.history().map_or_else(
            || fit_errors(first),
            |r| format!("rmse {:.2} mm, held out {:.2} mm", 1e3 * r.rmse, 1e3 * r.held_out_rmse),
        );
        let videos = if self.models.len() == 1 { "video" } else { "videos" };
        let program = format!("{}, numeric fingerprint {}", version(false).trim(), *NUMERIC_FINGERPRINT);
        let fitted = format!("fitted to {} {videos}; {}", self.models.len(), errors.trim());
        match format {
            CitationFormat::Bibtex => format!(
                "@misc{{vrdp-{id},\n  title = {{Fitted model {id}}},\n  howpublished = {{{program}}},\n  \
                 note = {{{numbers}; {fitted}}},\n}}\n",
                id = short_id(&first.name)
            ),
            _ => format!(
                "{numbers} (standard deviation of the last digits in parentheses; {program}, model {}, {fitted}).\n",
                short_id(&first.name)
            ),
        }
    }
}

fn shared_numbers(shared: &SharedEstimate) -> impl Iterator<Item = (String, Estimate)> {
    let name = |label: &str| match label {
        "" => format!("{}.{}", shared.effect, shared.parameter),
        label => format!("{}.{}[{label}]", shared.effect, shared.parameter),
    };
    let labels = shared.labels.iter().map(String::as_str).chain(std::iter::repeat(""));
    labels.zip(&shared.values).map(move |(label, e)| (name(label), e.clone())).collect::<Vec<_>>().into_iter()
}

fn low(e: &Estimate) -> f64 {
    e.value - NINETY_FIVE * e.sd
}

fn high(e: &Estimate) -> f64 {
    e.value + NINETY_FIVE * e.sd
}

fn fit_errors(model: &Model) -> String {
    format!("rmse {:.2} mm, noise {:.2} mm", 1e3 * model.rmse, 1e3 * model.noise_sigma)
}

/// The revisions from the first to this one.
fn lineage<'m>(known: &'m [Model], last: &'m Revision) -> Vec<&'m Revision> {
    let all: Vec<&Revision> = known.iter().filter_map(|m| m.history.as_ref()).collect();
    revisions::lineage(&all, last)
}

/// Units of plain numbers are not written.
fn plain_unit(unit: &str) -> &str {
    if unit == "1" { "" } else { unit }
}

/// `$\mathtt{linear\_drag.c} = 0.300(13)\,\mathrm{kg/s^{2}}$`.
fn latex(name: &str, value: &str, unit: &str) -> String {
    let unit: Vec<&str> = plain_unit(unit).split('^').collect();
    let (head, powers) = unit.split_first().map_or(("", &[][..]), |(head, powers)| (*head, powers));
    let power = |p: &&str| {
        let end = p.find(|c: char| !c.is_ascii_digit() && c != '-').unwrap_or(p.len());
        format!("^{{{}}}{}", &p[..end], &p[end..])
    };
    let unit = head.to_string() + &powers.iter().map(power).collect::<String>();
    let unit = if unit.is_empty() { unit } else { format!("\\,\\mathrm{{{}}}", unit.replace(' ', "\\,")) };
    format!("$\\mathtt{{{}}} = {value}{unit}$", name.replace('_', "\\_").replace(' ', "\\ "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(video: &str, digits: &str, drag: f64) -> Model {
        let number =
            |value, sd, unit: &str, identified| Estimate { value, sd, unit: unit.into(), identified };
        let shared = SharedEstimate {
            effect: "linear_drag".into(),
            parameter: "c".into(),
            labels: vec![String::new()],
            values: vec![number(drag, 0.0131, "kg/s^2", true)],
        };
        let object = crate::api::v1::ObjectEstimate {
            object_id: 3,
            mass: Some(number(1.0, 0.0, "kg", true)),
            restitution: Some(number(0.8, 0.2, "1", false)),
        };
        let names = ["videos/a/models/0123456789", "videos/b/models/9876543210"];
        let history = Revision {
            effect: "linear_drag".into(),
            models: names.map(String::from).to_vec(),
            rmse: 0.005,
            held_out_rmse: 0.006,
            ..Default::default()
        };
        Model {
            name: format!("videos/{video}/models/{digits}"),
            preset: "table".into(),
            shared: vec![shared],
            objects: vec![object],
            history: Some(history),
            ..Default::default()
        }
    }

    #[test]
    fn a_revision_is_found_by_any_of_its_models_and_shows_shared_numbers_once() {
        let known = [model("a", "0123456789", 0.3), model("b", "9876543210", 0.3)];
        for digits in ["01", "98765", "videos/b/models/9876543210"] {
            let shown = ShownModel::of(&known, digits).unwrap();
            let names: Vec<String> = shown.numbers().into_iter().map(|n| n.name).collect();
            let objects = ["mass (video 1)", "restitution factor (video 1)", "mass (video 2)"];
            assert_eq!(names[0], "linear_drag.c");
            assert_eq!(names[1..4], objects.map(|o| format!("object 3 {o}")));
        }
        assert!(ShownModel::of(&known, "5").is_err() && ShownModel::of(&known, "").is_err());
        let apart = [model("a", "0123456789", 0.3), model("b", "9876543210", 0.4)];
        let names = ShownModel::of(&apart, "0").unwrap().numbers().into_iter().map(|n| n.name);
        assert!(names.collect::<Vec<_>>().contains(&"linear_drag.c (video 2)".to_string()));
        assert_eq!(heads(&known).count(), 1);
        let listed = listing(&known);
        let rows = listed.lines().map(|l| l.split_whitespace().collect::<Vec<_>>().join(" "));
        assert!(rows.collect::<Vec<_>>().contains(&"01234567 table + linear_drag 2 6.00 5.00".to_string()));
    }

    #[test]
    fn numbers_can_be_cited_and_computed_with() {
        let known = [model("a", "0123456789", 0.3), model("b", "9876543210", 0.3)];
        let shown = ShownModel::of(&known, "01").unwrap();
        let text = shown.text(&known);
        assert!(
            text.contains("linear_drag.c") && text.contains("0.300 ± 0.013  [0.274 to 0.326]  kg/s^2"),
            "{text}"
        );
        assert!(text.contains("1.0000 given") && text.contains("prior"), "{text}");
        let csv = shown.csv().unwrap();
        assert!(csv.contains("linear_drag.c,0.3,0.0131,"), "{csv}");
        let cited = |format| shown.citation(format);
        assert!(cited(CitationFormat::Text).starts_with("linear_drag.c = 0.300(13) kg/s^2 (standard"));
        let formula = r"$\mathtt{linear\_drag.c} = 0.300(13)\,\mathrm{kg/s^{2}}$";
        assert!(cited(CitationFormat::Latex).starts_with(formula), "{}", cited(CitationFormat::Latex));
        assert!(cited(CitationFormat::Bibtex).starts_with("@misc{vrdp-01234567,\n"));
        assert_eq!(shown.to_json(&known)["numbers"][0]["high95"], json!(0.3 + NINETY_FIVE * 0.0131));
    }
}
