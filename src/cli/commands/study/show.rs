//! `show`: the numbers of a fitted model with their uncertainty, its errors and its history; to read, to compute with, to cite.

use super::revise;
use crate::api::v1::{
    Estimate, GetModelRequest, GetVideoRequest, Model, ParameterCovariance, Revision, SharedEstimate, Video,
};
use crate::cli::connection::{Connection, Target, heads, id, the_one};
use crate::cli::error::Failure;
use crate::cli::output;
use crate::cli::output::revisions::{self, change_of, short_id};
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
    /// Shows how the fitted numbers depend on each other; with --json their covariance too.
    #[arg(long, requires = "id", conflicts_with = "cite")]
    covariance: bool,
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
    let known = connection.all_models().await?;
    let json_file = args.json.as_deref();
    match &args.id {
        None => {
            let value = || json!({ "models": heads(&known).into_iter().map(summary).collect::<Vec<_>>() });
            output::result(json_file, &listing(&known), value)?;
        }
        Some(id) => {
            let mut shown = ShownModel::of(&known, id)?;
            shown.complete(&connection, args.covariance).await?;
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

fn listing(known: &[Model]) -> String {
    let mm = |v: f64| format!("{:.2}", 1e3 * v);
    let row = |m: &Model| {
        let videos = m.history.as_ref().map_or(1, |r| r.models.len());
        let held_out = m.history.as_ref().map_or("-".into(), |r| mm(r.held_out_rmse));
        let rmse = m.history.as_ref().map_or(m.rmse, |r| r.rmse);
        vec![short_id(&m.name), m.preset.clone(), change_of(m), videos.to_string(), held_out, mm(rmse)]
    };
    let rows: Vec<Vec<String>> = heads(known).into_iter().map(row).collect();
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
        "change": change_of(model),
        "videos": model.history.as_ref().map_or(1, |r| r.models.len()),
        "rmse_m": of(&|r| r.rmse).unwrap_or(model.rmse),
        "held_out_rmse_m": of(&|r| r.held_out_rmse),
    })
}

/// A model with those of the other videos of its revision.
pub struct ShownModel<'m> {
    models: Vec<&'m Model>,
    /// What each was fitted to, and the covariance of its numbers, where they were asked for.
    videos: Vec<Video>,
    covariances: Vec<Option<ParameterCovariance>>,
}

/// One number of a model.
pub struct ModelNumber {
    /// `linear_drag.c`, `object 3 mass`; of one of several videos: `object 3 mass (video 2)`.
    pub name: String,
    pub estimate: Estimate,
}

impl<'m> ShownModel<'m> {
    fn of(known: &'m [Model], digits: &str) -> Result<ShownModel<'m>, Failure> {
        let one = the_one(known, digits)?;
        let names = one.history.as_ref().map_or(vec![one.name.clone()], |r| r.models.clone());
        let named = names.iter().filter_map(|name| known.iter().find(|m| m.name == *name));
        Ok(ShownModel::of_models(named.collect()))
    }

    /// Asks for the videos and, if wanted, the covariances.
    async fn complete(&mut self, connection: &Connection, covariance: bool) -> Result<(), Failure> {
        for model in &self.models {
            let video = model.name.split("/models/").next().unwrap_or_default();
            let request = GetVideoRequest { name: video.into(), ..Default::default() };
            self.videos.push(connection.videos().get_video(request).await?.into_inner());
            if covariance {
                let request = GetModelRequest { name: model.name.clone(), covariance, ..Default::default() };
                self.covariances.push(connection.models().get_model(request).await?.into_inner().covariance);
            }
        }
        Ok(())
    }

    /// The models of a revision, one a video.
    pub fn of_models(models: Vec<&'m Model>) -> ShownModel<'m> {
        ShownModel { models, videos: vec![], covariances: vec![] }
    }

    fn history(&self) -> Option<&'m Revision> {
        self.models.first()?.history.as_ref()
    }

    /// What the videos share, then what their objects have; a video that differs in a shared number has it named.
    pub fn numbers(&self) -> Vec<ModelNumber> {
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
            for pair in &model.pairs {
                let ids: Vec<String> = pair.object_ids.iter().map(u32::to_string).collect();
                let name = format!("pair {} restitution{of_video}", ids.join("-"));
                all.extend(pair.restitution.clone().map(|estimate| ModelNumber { name, estimate }));
            }
        }
        all
    }

    fn text(&self, known: &[Model]) -> String {
        let Some(first) = self.models.first() else { return String::new() };
        let row = |n: &ModelNumber| {
            let e = &n.estimate;
            let [value, interval] = with_interval(e);
            let from = if e.identified || e.sd == 0.0 { "" } else { "prior" };
            vec![n.name.clone(), value, interval, e.unit.clone(), from.into()]
        };
        let rows: Vec<Vec<String>> = self.numbers().iter().map(row).collect();
        let header = ["parameter", "value ± sd", "95 % interval", "unit", "from"];
        let mut text =
            format!("{}: {} (preset {})\n\n", short_id(&first.name), change_of(first), first.preset);
        text += &output::table(&header, &rows);
        text += "  ±: standard deviation; prior: the videos do not determine it; given: not fitted\n";
        text += &self.correlations();
        match self.history() {
            Some(last) => {
                let lineage = lineage(known, last);
                let name = |r: &Revision| format!("{}  {}", revisions::id(r), revisions::change(r));
                text += &format!("\n{}", revisions::table(&lineage, last.models.len() > 1, name));
                text += &format!("  noise {:.2} mm\n", 1e3 * last.noise_sigma);
            }
            None => text += &format!("\n{}\n", fit_errors(first)),
        }
        text += "\n  fitted to, and the full name of each model (--model takes it, or its first digits):\n";
        let videos = self.videos.iter().map(Some).chain(std::iter::repeat(None));
        let line = |(model, video): (&&Model, Option<&Video>)| {
            let what = video.map_or(String::new(), |v| {
                format!("{}, {} frames, {} objects: ", v.display_name, frames(v), v.objects.len())
            });
            format!("    {what}{}\n", model.name)
        };
        text + &self.models.iter().zip(videos).map(line).collect::<String>()
    }

    /// The correlations of the numbers of each model as a triangle.
    fn correlations(&self) -> String {
        let mut text = String::new();
        for (k, covariance) in self.covariances.iter().enumerate() {
            let of = if self.covariances.len() > 1 { format!(" (video {})", k + 1) } else { String::new() };
            let Some(covariance) = covariance else {
                text +=
                    &format!("\n  correlations{of}: not kept; fit the videos again (up to 256 numbers)\n");
                continue;
            };
            let numbers: Vec<String> = (1..=covariance.names.len()).map(|n| n.to_string()).collect();
            let title = format!("correlations{of}");
            let header: Vec<&str> =
                [title.as_str()].into_iter().chain(numbers.iter().map(String::as_str)).collect();
            let row = |(a, row): (usize, Vec<f64>)| {
                let cells = row[..=a].iter().map(|r| format!("{r:.2}"));
                let name = format!("{} {}", a + 1, readable(&covariance.names[a]));
                std::iter::once(name).chain(cells).collect::<Vec<String>>()
            };
            let rows: Vec<Vec<String>> =
                correlation_rows(covariance).into_iter().enumerate().map(row).collect();
            text += &format!("\n{}", output::table(&header, &rows));
        }
        text
    }

    /// What the models were fitted to.
    fn fitted_to(&self) -> Vec<Value> {
        let videos = self.videos.iter().map(Some).chain(std::iter::repeat(None));
        let one = |(model, video): (&&Model, Option<&Video>)| {
            json!({
                "model": model.name,
                "name": video.map(|v| &v.display_name),
                "frames": video.map(frames),
                "objects": video.map(|v| v.objects.len()),
            })
        };
        self.models.iter().zip(videos).map(one).collect()
    }

    /// Covariance and correlation of each model's numbers; none where they were not asked for.
    fn covariance_json(&self) -> Value {
        let one = |(model, covariance): (&&Model, &Option<ParameterCovariance>)| {
            let covariance = covariance.as_ref()?;
            let names: Vec<String> = covariance.names.iter().map(|name| readable(name)).collect();
            let rows: Vec<&[f64]> = covariance.values.chunks(names.len().max(1)).collect();
            Some(json!({
                "model": model.name, "names": names, "covariance": rows,
                "correlation": correlation_rows(covariance),
            }))
        };
        json!(self.models.iter().zip(&self.covariances).map(one).collect::<Vec<_>>())
    }

    fn csv(&self) -> Result<String, Failure> {
        let mut out = csv::Writer::from_writer(vec![]);
        let header = ["parameter", "value", "sd", "low95", "high95", "unit", "identified"];
        out.write_record(header).map_err(Failure::other)?;
        for n in self.numbers() {
            let e = &n.estimate;
            let [value, sd, low, high] = [e.value, e.sd, e.low95, e.high95].map(|v| v.to_string());
            let row = [n.name, value, sd, low, high, e.unit.clone(), e.identified.to_string()];
            out.write_record(row).map_err(Failure::other)?;
        }
        String::from_utf8(out.into_inner().map_err(Failure::other)?).map_err(Failure::other)
    }

    fn to_json(&self, known: &[Model]) -> Value {
        let number = |n: &ModelNumber| {
            let e = &n.estimate;
            json!({
                "name": n.name, "value": e.value, "sd": e.sd, "low95": e.low95, "high95": e.high95,
                "unit": e.unit, "identified": e.identified,
            })
        };
        let lineage = self.history().map(|last| lineage(known, last)).unwrap_or_default();
        json!({
            "model": self.models.first().map(|m| summary(m)),
            "fitted_to": self.models.iter().map(|m| &m.name).collect::<Vec<_>>(),
            "videos": self.fitted_to(),
            "numbers": self.numbers().iter().map(number).collect::<Vec<_>>(),
            "history": lineage.into_iter().map(revise::to_json).collect::<Vec<_>>(),
            "covariance": if self.covariances.is_empty() { Value::Null } else { self.covariance_json() },
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

/// Value with standard deviation, and the 95 % interval; of a given number the value alone.
pub fn with_interval(e: &Estimate) -> [String; 2] {
    match e.sd == 0.0 {
        true => [format!("{} given", output::number(e.value)), String::new()],
        false => [output::measured(e.value, e.sd), output::interval(e.low95, e.high95)],
    }
}

/// Frames of a video: up to its last sample.
fn frames(video: &Video) -> u32 {
    let last = video.objects.iter().filter_map(|o| o.samples.last()).map(|s| s.frame + 1).max();
    last.unwrap_or(0).max(video.times.len() as u32)
}

/// The name of a fitted number as tables have it: `object 3 mass`.
fn readable(name: &str) -> String {
    match name.strip_prefix("objects[").and_then(|rest| rest.split_once("].")) {
        Some((object, what)) => format!("object {object} {what}"),
        None => name.into(),
    }
}

fn correlation_rows(covariance: &ParameterCovariance) -> Vec<Vec<f64>> {
    let n = covariance.names.len();
    let at = |a: usize, b: usize| covariance.values.get(a * n + b).copied().unwrap_or(f64::NAN);
    let row = |a: usize| (0..n).map(|b| at(a, b) / (at(a, a) * at(b, b)).sqrt()).collect();
    (0..n).map(row).collect()
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
    use crate::num::NINETY_FIVE;

    fn model(video: &str, digits: &str, drag: f64) -> Model {
        let number = |value, sd, unit: &str, identified| {
            let (unit, low95, high95) = (unit.into(), value - NINETY_FIVE * sd, value + NINETY_FIVE * sd);
            Estimate { value, sd, unit, identified, low95, high95 }
        };
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
        assert_eq!(heads(&known).len(), 1);
        let listed = listing(&known);
        let rows = listed.lines().map(|l| l.split_whitespace().collect::<Vec<_>>().join(" "));
        assert!(rows.collect::<Vec<_>>().contains(&"01234567 table + linear_drag 2 6.00 5.00".to_string()));
    }

    #[test]
    fn the_covariance_is_shown_as_correlations() {
        let known = [model("a", "0123456789", 0.3), model("b", "9876543210", 0.3)];
        let mut shown = ShownModel::of(&known, "01").unwrap();
        let names = ["linear_drag.c", "objects[3].mass"].map(String::from).to_vec();
        shown.covariances =
            vec![Some(ParameterCovariance { names, values: vec![4.0, -3.0, -3.0, 9.0] }), None];
        let text = shown.text(&known);
        assert!(text.contains("2 object 3 mass") && text.contains("-0.50  1.00"), "{text}");
        assert!(text.contains("correlations (video 2): not kept"), "{text}");
        let all = shown.to_json(&known);
        assert_eq!(all["covariance"][0]["covariance"], json!([[4.0, -3.0], [-3.0, 9.0]]));
        assert_eq!(all["covariance"][0]["correlation"][0][1], json!(-0.5));
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
