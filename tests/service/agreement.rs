//! A fitted number has one value, one standard deviation and one 95 % interval in every output: messages, JSON, tables,
//! CSV, traces and reports.

use crate::harness::*;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use vrdp::api::v1;

/// Value, standard deviation, and the ends of the 95 % interval.
type Number = [f64; 4];
/// By names as `vrdp show` has them.
type Numbers = BTreeMap<String, Number>;

/// A command of the program against the service.
fn vrdp(service: &Running, line: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vrdp"));
    command.args(line).args(["--quiet", "--server", &service.url]);
    let done = tokio::task::block_in_place(|| command.output()).unwrap();
    assert!(done.status.success(), "{line:?}: {}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8(done.stdout).unwrap()
}

fn json(service: &Running, line: &[&str]) -> Value {
    serde_json::from_str(&vrdp(service, &[line, &["--json", "-"]].concat())).unwrap()
}

fn data(path: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(path).display().to_string()
}

fn estimate(e: &v1::Estimate) -> Number {
    [e.value, e.sd, e.low95, e.high95]
}

/// The numbers of the message.
fn of_message(model: &v1::Model) -> Numbers {
    let mut all = Numbers::new();
    for s in &model.shared {
        for (label, e) in s.labels.iter().zip(&s.values) {
            let whose = if label.is_empty() { String::new() } else { format!("[{label}]") };
            all.insert(format!("{}.{}{whose}", s.effect, s.parameter), estimate(e));
        }
    }
    for o in &model.objects {
        all.insert(format!("object {} mass", o.object_id), estimate(o.mass.as_ref().unwrap()));
        let factor = estimate(o.restitution.as_ref().unwrap());
        all.insert(format!("object {} restitution factor", o.object_id), factor);
    }
    for pair in &model.pairs {
        let ids: Vec<String> = pair.object_ids.iter().map(u32::to_string).collect();
        let restitution = estimate(pair.restitution.as_ref().unwrap());
        all.insert(format!("pair {} restitution", ids.join("-")), restitution);
    }
    all
}

fn of_json(p: &Value) -> Number {
    ["value", "sd", "low95", "high95"].map(|key| p[key].as_f64().unwrap_or_else(|| panic!("{key} of {p}")))
}

/// Whether a text is the number rounded to the text's last digit.
fn is_printed(text: &str, number: f64) -> bool {
    let digits = text.split_once('.').map_or(0, |(_, digits)| digits.len());
    format!("{number:.digits$}") == text
}

/// The numbers in a text, in order.
fn numbers_in(text: &str) -> Vec<&str> {
    let words = text.split(|c: char| !c.is_ascii_digit() && !['.', '-'].contains(&c));
    words.filter(|w| w.parse::<f64>().is_ok()).collect()
}

/// Value, deviation and interval as a text prints them.
fn assert_printed(what: &str, text: &str, number: Number) {
    let printed = numbers_in(text);
    assert!(printed.len() >= 4, "{what}: {text}");
    for (text, number) in printed.iter().zip(number) {
        assert!(is_printed(text, number), "{what}: {text} is not {number}");
    }
}

/// The parameters in a trace file, by names as the trace has them.
fn of_trace(service: &Running, file: &Path) -> Numbers {
    let file = file.to_str().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_vrdp"));
    command.args(["trace", "export", file, "--topic", "/parameters", "--out", "-"]);
    let done = tokio::task::block_in_place(|| command.output()).unwrap();
    assert!(done.status.success(), "{}: {}", service.url, String::from_utf8_lossy(&done.stderr));
    let mut rows = csv::Reader::from_reader(done.stdout.as_slice());
    let number = |row: &csv::StringRecord| [1, 2, 5, 6].map(|k: usize| row[k].parse().unwrap());
    rows.records().map(|row| row.unwrap()).map(|row| (row[0].to_string(), number(&row))).collect()
}

/// Every number of a model that was fitted must be in the trace, and equal.
fn assert_trace(service: &Running, file: &Path, expected: &Numbers) {
    let traced = of_trace(service, file);
    let mut compared = 0;
    for (name, number) in expected.iter().filter(|(_, n)| n[1] > 0.0) {
        let own = match name.strip_prefix("object ").and_then(|rest| rest.strip_suffix(" mass")) {
            Some(id) => format!("objects[{id}].mass"),
            None if name.ends_with("restitution factor") || name.starts_with("pair ") => continue,
            None => name.clone(),
        };
        assert_eq!(traced.get(&own), Some(number), "{own} of {}", file.display());
        compared += 1;
    }
    assert!(compared > 0, "{}: nothing is compared", file.display());
}

/// The tables, CSV and JSON of `show`; `of_video` is what names of a video's own numbers end with.
fn assert_show(service: &Running, id: &str, of_video: &str, expected: &Numbers) {
    let shown = json(service, &["show", id]);
    let named = |n: &Value| (n["name"].as_str().unwrap().to_string(), of_json(n));
    let numbers: Numbers = shown["numbers"].as_array().unwrap().iter().map(named).collect();
    let (text, csv) = (vrdp(service, &["show", id]), vrdp(service, &["show", id, "--csv", "-"]));
    for (name, number) in expected {
        let full = format!("{name}{of_video}");
        let full = if numbers.contains_key(&full) { &full } else { name };
        assert_eq!(numbers.get(full), Some(number), "{full} in {shown}");
        let row = format!("{full},{},{},{},{},", number[0], number[1], number[2], number[3]);
        assert!(csv.lines().any(|line| line.starts_with(&row)), "{row} in {csv}");
        let start = format!("  {full}  ");
        let line = text.lines().find(|l| l.starts_with(&start)).unwrap_or_else(|| panic!("{full}: {text}"));
        match number[1] > 0.0 {
            true => assert_printed(full, &line[start.len()..], *number),
            false => assert!(line.contains("given"), "{line}"),
        }
    }
    let cited = vrdp(service, &["show", id, "--cite", "text"]);
    assert!(cited.contains(" = ") || expected.values().all(|n| n[1] == 0.0), "{cited}");
}

/// The table of a video in a report: its numbers for programs, and what is printed.
fn assert_report(html: &str, video: &str, expected: &Numbers) {
    let start = format!("<details class=\"numbers\" data-video=\"{video}\"");
    let part = html.split(&start).nth(1).unwrap_or_else(|| panic!("no table of {video}"));
    let part = part.split("</details>").next().unwrap();
    let mut compared = 0;
    for cell in part.split("data-number=\"").skip(1) {
        let attribute = |key: &str| -> f64 {
            let rest = cell.split(&format!("data-{key}=\"")).nth(1).unwrap();
            rest.split('"').next().unwrap().parse().unwrap()
        };
        let name = cell.split('"').next().unwrap();
        let number = ["value", "sd", "low95", "high95"].map(attribute);
        assert_eq!(expected.get(name), Some(&number), "{name} in the report");
        let (printed, rest) = cell.split_once('>').unwrap().1.split_once("</td>").unwrap();
        let interval = rest.split_once('>').unwrap().1.split("</td>").next().unwrap();
        if number[1] > 0.0 {
            assert_printed(name, &format!("{printed} {interval}"), number);
        }
        compared += 1;
    }
    let fitted = expected.values().filter(|n| n[1] > 0.0).count();
    assert!(compared >= fitted, "{compared} of {fitted} numbers are in the report");
}

async fn report(service: &Running, models: &[String]) -> String {
    use v1::write_report_response::Event;
    let video = |name: &String| name.split("/models/").next().unwrap().to_string();
    let videos = models.iter().map(video).collect();
    let study = Some(v1::StudyRequest { videos, models: models.to_vec(), start: None });
    let request = v1::WriteReportRequest { study, as_is: true, ..Default::default() };
    let mut client = service.models().max_decoding_message_size(64 << 20);
    let mut stream = client.write_report(request).await.unwrap().into_inner();
    while let Some(message) = stream.message().await.unwrap() {
        if let Some(Event::Report(report)) = message.event {
            return report.html;
        }
    }
    panic!("the stream ended without a page");
}

/// Parameters of an added effect, as `revise` and `discover` print them, that are numbers of the model themselves.
fn assert_added(effect: &str, parameters: &Value, expected: &Numbers) {
    let mut compared = 0;
    for (name, p) in parameters.as_object().unwrap() {
        let Some(number) = expected.get(&format!("{effect}.{name}")) else { continue };
        let close =
            |(a, b): (f64, f64)| (a - b).abs() <= 1e-9 * number[1].max(f64::MIN_POSITIVE).max(a.abs());
        assert!(of_json(p).into_iter().zip(*number).all(close), "{effect}.{name}: {p} is not {number:?}");
        compared += 1;
    }
    assert!(compared > 0, "{effect}: {parameters} has no number of {:?}", expected.keys());
}

/// All outputs of a revision or fit, whose models are named; `paths` are the scenes by their names.
async fn assert_everywhere(service: &Running, names: &[String], paths: &BTreeMap<String, PathBuf>) {
    let page = report(service, names).await;
    let folder = tempfile::tempdir().unwrap();
    for (k, name) in names.iter().enumerate() {
        let get = v1::GetModelRequest { name: name.clone(), covariance: true, ..Default::default() };
        let model = service.models().get_model(get).await.unwrap().into_inner();
        let expected = of_message(&model);
        for [value, sd, low, high] in expected.values() {
            assert!(low <= value && value <= high && *sd >= 0.0, "{name}: {value} {sd} {low} {high}");
        }
        let covariance = model.covariance.as_ref().unwrap();
        let n = covariance.names.len();
        for (row, own) in covariance.names.iter().enumerate() {
            let own = match own.strip_prefix("objects[").and_then(|rest| rest.strip_suffix("].mass")) {
                Some(id) => format!("object {id} mass"),
                None => own.clone(),
            };
            // The joint fit of several videos also has numbers that another video alone needs.
            let Some(sd) = expected.get(&own).map(|number| number[1]) else {
                assert!(names.len() > 1, "{own} is no number of {name}");
                continue;
            };
            let variance = covariance.values[row * n + row];
            assert!((variance.sqrt() / sd - 1.0).abs() < 1e-9, "{own}: {variance} {sd}");
        }
        let listed = v1::ListModelsRequest {
            parent: name.split("/models/").next().unwrap().into(),
            ..Default::default()
        };
        let listed = service.models().list_models(listed).await.unwrap().into_inner().models;
        let listed = listed.iter().find(|m| m.name == *name).unwrap();
        assert_eq!(of_message(listed), expected);
        let of_video = if names.len() > 1 { format!(" (video {})", k + 1) } else { String::new() };
        let id = name.rsplit('/').next().unwrap();
        assert_show(service, &id[..12], &of_video, &expected);
        let request = v1::GetVideoRequest {
            name: listed.name.split("/models/").next().unwrap().into(),
            ..Default::default()
        };
        let video = service.videos().get_video(request).await.unwrap().into_inner().display_name;
        assert_report(&page, &video, &expected);
        let file = folder.path().join(format!("{k}.mcap"));
        let (path, file_name) = (paths[&video].to_str().unwrap(), file.to_str().unwrap());
        vrdp(service, &["simulate", path, "--model", &id[..12], "--trace", file_name]);
        assert_trace(service, &file, &expected);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn ten_models_have_the_same_numbers_in_every_output() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let fits = [
        "clevrer/scene_00000",
        "clevrer/scene_00006",
        "clevrer/scene_00011",
        "clevrer/scene_00022",
        "csv/video_1.csv",
        "bounce/scene_00019",
    ];
    let mut paths = BTreeMap::new();
    let mut models = 0;
    let named = |path: &str| Path::new(path).file_stem().unwrap().to_str().unwrap().to_string();
    for path in fits {
        let (name, path) = (named(path), data(path));
        paths.insert(name.clone(), PathBuf::from(&path));
        let fitted = json(&service, &["fit", &path]);
        let id = fitted["scenes"][&name]["model_id"].as_str().unwrap().to_string();
        let shown = json(&service, &["show", &id]);
        let full = shown["fitted_to"][0].as_str().unwrap().to_string();
        assert_eq!(shown["videos"][0]["name"].as_str(), Some(name.as_str()));
        let get = v1::GetModelRequest { name: full.clone(), ..Default::default() };
        let expected = of_message(&service.models().get_model(get).await.unwrap().into_inner());
        for object in fitted["scenes"][&name]["objects"].as_array().unwrap() {
            let number = expected[&format!("object {} mass", object["object_id"])];
            assert_eq!(of_json(&object["mass"]), number, "{object}");
        }
        assert_everywhere(&service, &[full], &paths).await;
        models += 1;
    }

    // A discovery, and changes by hand: of one video, and of two with a formula.
    let path = data("csv/video_3.csv");
    paths.insert("video_3".into(), PathBuf::from(&path));
    let found = json(&service, &["discover", &path]);
    let wind = data("wind/video_1.csv");
    let winds = BTreeMap::from([("video_1".to_string(), PathBuf::from(&wind))]);
    let windy = json(&service, &["revise", &wind, "--add", "uniform_force"]);
    let pair = [0, 1].map(|k| data(&format!("effects/bullet_coriolis_medium/scene_0{k}")));
    let pairs = BTreeMap::from([0, 1].map(|k| (format!("scene_0{k}"), PathBuf::from(&pair[k]))));
    let text = "let w [rad/s] = 0 from -5 to 5; ax = 2*w*vy; ay = -2*w*vx";
    let turning = json(&service, &["revise", &pair[0], &pair[1], "--add-formula", text, "--name", "turning"]);
    let revisions = json(&service, &["revise", &path, "--list"]);
    let listed = revisions["revisions"].as_array().unwrap();
    assert!(listed.len() >= 2 && found["effects"][0]["kind"] == "coriolis", "{found}");
    for revision in listed {
        let names: Vec<String> = serde_json::from_value(revision["models"].clone()).unwrap();
        assert_everywhere(&service, &names, &paths).await;
        models += 1;
        if let Some(effect) = revision["effect"].as_str() {
            let get = v1::GetModelRequest { name: names[0].clone(), ..Default::default() };
            let expected = of_message(&service.models().get_model(get).await.unwrap().into_inner());
            assert_added(effect, &revision["parameters"], &expected);
            assert_added(effect, &found["effects"][0]["parameters"], &expected);
        }
    }
    for (changed, paths) in [(&windy, &winds), (&turning, &pairs)] {
        for revision in [&changed["before"], &changed["after"]] {
            let names: Vec<String> = serde_json::from_value(revision["models"].clone()).unwrap();
            assert_everywhere(&service, &names, paths).await;
            models += 1;
        }
    }
    assert!(models >= 10, "{models} models");
    service.stop().await;
}
