//! Two models side by side, by comparison and on a page; models named by the first digits of their ids.

use crate::harness::*;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use vrdp::api::v1;

fn run(service: &Running, line: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vrdp"));
    command.args(line).args(["--quiet", "--server", &service.url]);
    tokio::task::block_in_place(|| command.output()).unwrap()
}

fn text(service: &Running, line: &[&str]) -> String {
    let done = run(service, line);
    assert!(done.status.success(), "{line:?}: {}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8(done.stdout).unwrap()
}

fn json(service: &Running, line: &[&str]) -> Value {
    serde_json::from_str(&text(service, &[line, &["--json", "-"]].concat())).unwrap()
}

/// What a refused command says.
fn refused(service: &Running, line: &[&str]) -> String {
    let done = run(service, line);
    assert_eq!(done.status.code(), Some(2), "{line:?}: {done:?}");
    String::from_utf8(done.stderr).unwrap()
}

fn data(path: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(path).display().to_string()
}

#[tokio::test(flavor = "multi_thread")]
async fn two_models_are_compared_and_shown_on_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let (scene, other) = (data("wind/video_1.csv"), data("csv/video_1.csv"));
    let changed = json(&service, &["revise", &scene, "--add", "uniform_force"]);
    let id = |r: &Value| r["id"].as_str().unwrap().to_string();
    let (before, after) = (id(&changed["before"]), id(&changed["after"]));

    // Of two revisions: their own errors and evidence, on the video that they were fitted to.
    let found = json(&service, &["compare", &after, &before]);
    for (side, revision) in [("a", "after"), ("b", "before")] {
        let close = |key: &str| {
            (found[side][key].as_f64().unwrap() / changed[revision][key].as_f64().unwrap() - 1.0).abs() < 1e-6
        };
        assert!(close("rmse_m") && close("reduced_chi_square"), "{side}: {found} {changed}");
        assert_eq!(found[side]["held_out_rmse_m"], changed[revision]["held_out_rmse_m"], "{side}");
        assert!(found[side]["numbers"].as_array().unwrap().iter().all(|n| n["low95"].is_number()));
    }
    let evidence = [&found["log_evidence"], &changed["after"]["log_evidence"]].map(|v| v.as_f64().unwrap());
    assert!((evidence[0] - evidence[1]).abs() < 1e-6 * evidence[1].abs(), "{evidence:?}");
    let apart = &found["separations"][0];
    assert!(apart["largest_m"].as_f64().unwrap() > 0.0 && apart["regime"].is_string(), "{apart}");
    assert_eq!(json(&service, &["compare", &before, &before])["separations"][0]["largest_m"], 0.0);
    let table = text(&service, &["compare", &after, &before, &scene]);
    for word in ["where they differ most", "nats for A", "uniform_force.F_x", "held out mm"] {
        assert!(table.contains(word), "{word}: {table}");
    }

    // A preset is fitted first; the contract of one model and scenes stays.
    let found = json(&service, &["compare", "table", &after, &scene]);
    assert_eq!(found["a"]["change"], "fit");
    assert!(found["log_evidence"].as_f64().unwrap() < 0.0, "{found}");
    let alone = json(&service, &["compare", &scene, "--with", &after]);
    let alone = alone["scenes"]["video_1"]["rmse_m"].as_f64().unwrap();
    assert!((alone / found["b"]["rmse_m"].as_f64().unwrap() - 1.0).abs() < 1e-9);

    // What was measured is as good a simulation as there can be.
    let tracks = json(&service, &["compare", &after, &scene, "--against", &scene]);
    for object in tracks["objects"].as_array().unwrap() {
        assert_eq!(object["b_rmse_m"], 0.0, "{object}");
        assert!(object["a_rmse_m"].as_f64().unwrap() > 0.0);
    }

    // A page of each: the history of a revision, and two models side by side.
    let page = text(&service, &["report", "--model", &after, "--out", "-"]);
    assert!(page.contains(&format!("Model {after}: start, + uniform force")), "{}", &page[..2000]);
    assert!(page.contains("residual-magnified-2") && page.contains("class=\"data\""));
    let page = text(&service, &["report", &scene, "--model", &after, "--against", "air_table", "--out", "-"]);
    assert!(page.contains(" beside air_table fit ("), "{}", &page[..2000]);

    // Ids: unknown, of other videos, as the start of a fit, ambiguous.
    let fitted = json(&service, &["fit", &scene, "--model", &after]);
    assert!(fitted["scenes"]["video_1"]["shared"]["uniform_force"]["F_x"]["sd"].is_number(), "{fitted}");
    let unknown = refused(&service, &["simulate", &scene, "--model", "0f0f0f0f0f"]);
    assert!(unknown.contains("no such model; there are") && unknown.contains(&after), "{unknown}");
    let elsewhere = refused(&service, &["ask", &other, "--question", "What will happen?", "--model", &after]);
    assert!(elsewhere.contains("is a model of other videos"), "{elsewhere}");
    let several = refused(&service, &["compare", "table", "billiards", &after, &scene]);
    assert!(several.contains("at most two"), "{several}");
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_comparison_or_page_names_the_field() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let [one, two] =
        [service.create(video("one", 12)).await, service.create(video("two", 14)).await].map(Result::unwrap);
    let study = |video: &String| Some(v1::StudyRequest { videos: vec![video.clone()], ..Default::default() });
    let request = v1::CompareModelsRequest { study: study(&one), against: study(&two) };
    assert_eq!(fields(&service.models().compare_models(request).await.unwrap_err()), ["against.videos"]);
    let wrong = [
        (v1::WriteReportRequest { against: study(&one), ..Default::default() }, "against"),
        (
            v1::WriteReportRequest { as_is: true, against: study(&two), ..Default::default() },
            "against.videos",
        ),
        (v1::WriteReportRequest { as_is: true, max_effects: Some(1), ..Default::default() }, "max_effects"),
    ];
    for (request, field) in wrong {
        let request = v1::WriteReportRequest { study: study(&one), ..request };
        assert_eq!(fields(&service.models().write_report(request).await.unwrap_err()), [field]);
    }
    service.stop().await;
}
