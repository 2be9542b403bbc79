//! Effects and formulas added to models and removed: their evidence and errors, and the history.

use crate::discover::post;
use crate::harness::*;
use tonic::Status;
use vrdp::api::v1;
use vrdp::api::v1::add_effect_request::Addition;

fn study(videos: &[String], models: &[String]) -> v1::StudyRequest {
    v1::StudyRequest { videos: videos.to_vec(), start: None, models: models.to_vec() }
}

fn law(name: &str, text: &str) -> Addition {
    Addition::Formula(v1::Formula { name: name.into(), text: text.into(), parameters: vec![] })
}

async fn add(
    service: &Running,
    study: v1::StudyRequest,
    addition: Addition,
) -> Result<[v1::Revision; 2], Status> {
    use v1::add_effect_response::Event;
    let request = v1::AddEffectRequest { study: Some(study), addition: Some(addition) };
    let mut stream = service.models().add_effect(request).await?.into_inner();
    let mut progress = vec![];
    while let Some(message) = stream.message().await? {
        match message.event.unwrap() {
            Event::Progress(f) => progress.push(f),
            Event::Revised(r) => {
                assert!(progress.is_sorted(), "{progress:?}");
                return Ok([r.before.unwrap(), r.after.unwrap()]);
            }
        }
    }
    panic!("the stream ended without a result");
}

async fn remove(
    service: &Running,
    study: v1::StudyRequest,
    effect: &str,
) -> Result<[v1::Revision; 2], Status> {
    use v1::remove_effect_response::Event;
    let request = v1::RemoveEffectRequest { study: Some(study), effect: effect.into() };
    let mut stream = service.models().remove_effect(request).await?.into_inner();
    while let Some(message) = stream.message().await? {
        if let Event::Revised(r) = message.event.unwrap() {
            return Ok([r.before.unwrap(), r.after.unwrap()]);
        }
    }
    panic!("the stream ended without a result");
}

async fn history(service: &Running, video: &str) -> Vec<v1::Revision> {
    let request = v1::ListModelsRequest { parent: video.into(), ..Default::default() };
    let models = service.models().list_models(request).await.unwrap().into_inner().models;
    models.into_iter().filter_map(|m| m.history).collect()
}

async fn compare(service: &Running, study: v1::StudyRequest) -> v1::Comparison {
    use v1::compare_models_response::Event;
    let request = v1::CompareModelsRequest { study: Some(study), ..Default::default() };
    let mut stream = service.models().compare_models(request).await.unwrap().into_inner();
    let mut last = None;
    while let Some(message) = stream.message().await.unwrap() {
        last = message.event;
    }
    let Some(Event::Comparison(comparison)) = last else { panic!("{last:?}") };
    comparison
}

#[tokio::test(flavor = "multi_thread")]
async fn the_error_falls_with_the_right_effect_and_rises_without_it() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let videos = post(&service, "bullet_coriolis_medium").await;
    let videos = &videos[..2];

    // The law as a formula, with an amplitude that the fit estimates.
    let text = "let w [rad/s] = 0 from -5 to 5; ax = 2*w*vy; ay = -2*w*vx";
    let [first, written] = add(&service, study(videos, &[]), law("turning", text)).await.unwrap();
    assert_eq!((first.revision, first.parents.len(), first.worth()), (0, 0, v1::Worth::Unspecified));
    assert_eq!((written.revision, &written.parents, written.effect.as_str()), (1, &first.models, "turning"));
    assert_eq!(written.worth(), v1::Worth::Better, "{written:?}");
    assert!(first.rmse > 2.0 * first.noise_sigma && written.rmse < 1.2 * written.noise_sigma);
    assert!(written.held_out_rmse < first.held_out_rmse && written.left_out_rmse < first.left_out_rmse);
    let added = written.added.as_ref().unwrap();
    let omega = &added.parameters[0];
    assert_eq!(added.formula, text);
    assert_eq!((omega.name.as_str(), omega.unit.as_str()), ("w", "rad/s"));
    // The simulator's value, from group.json.
    assert!(omega.low[0] < 0.0827 && 0.0827 < omega.high[0], "{omega:?}");

    // The effect of the library on the same first revision, which is read from the store.
    let library = Addition::Effect("coriolis".into());
    let [same, named] = add(&service, study(videos, &first.models), library.clone()).await.unwrap();
    assert_eq!(same, first);
    assert!((named.rmse / written.rmse - 1.0).abs() < 0.01, "{} {}", named.rmse, written.rmse);

    // An unneeded effect beside the right one improves nothing; removing the right one worsens the model.
    let needless = Addition::Effect("magnus".into());
    let [_, more] = add(&service, study(videos, &named.models), needless).await.unwrap();
    assert_ne!(more.worth(), v1::Worth::Better, "{more:?}");
    let [before, without] = remove(&service, study(videos, &named.models), "coriolis").await.unwrap();
    assert_eq!(
        (before, without.removed.as_str(), without.worth()),
        (named.clone(), "coriolis", v1::Worth::Worse)
    );
    assert_eq!((without.revision, &without.parents), (2, &named.models));

    // All revisions are stored; an older one can be changed, simulated and compared.
    service.stop().await;
    let service = start(folder.path(), CAPACITY).await;
    let kept = history(&service, &videos[1]).await;
    for revision in [&first, &written, &named, &more, &without] {
        assert!(kept.contains(revision), "{revision:?}");
    }
    assert_eq!(kept.len(), 5);
    let [_, again] = add(&service, study(videos, &first.models), library).await.unwrap();
    assert_eq!(again, named);
    // The same videos in another order are the same study, whose results are read from the store.
    let reversed = [videos[1].clone(), videos[0].clone()];
    let [same, found] = add(&service, study(&reversed, &[]), law("turning", text)).await.unwrap();
    assert_eq!((same, &found), (first.clone(), &written));
    let choice = v1::ModelChoice { choice: Some(v1::model_choice::Choice::Model(written.models[0].clone())) };
    let video = videos[0].clone();
    let simulate =
        v1::SimulateRequest { video, model: Some(choice), rollouts: Some(2), ..Default::default() };
    let simulated = service.reasoning().simulate(simulate).await.unwrap().into_inner();
    assert_eq!(simulated.model, written.models[0]);
    let c = compare(&service, study(&reversed, &written.models)).await;
    assert!(c.videos.iter().map(|v| &v.video).eq(&reversed), "each request has its own order: {c:?}");
    let chi_squares: Vec<f64> = c.videos.iter().map(|v| v.reduced_chi_square).collect();
    assert!(c.summary.starts_with("the noise explains the residuals"), "{}", c.summary);
    assert!(chi_squares.iter().all(|c| *c < 1.5), "{chi_squares:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn changes_that_cannot_be_made_are_refused_with_the_field() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(video("a", 20)).await.unwrap();
    let other = format!("videos/{}", "0".repeat(32));
    let here = || study(std::slice::from_ref(&video), &[]);
    let parameter = |name: &str, min: f64| v1::FormulaParameter {
        name: name.into(),
        min: Some(min),
        ..Default::default()
    };
    let declared = |text: &str, p: v1::FormulaParameter| {
        Addition::Formula(v1::Formula { name: "mine".into(), text: text.into(), parameters: vec![p] })
    };
    let known = Addition::Effect("tilt".into());
    let cases = [
        (here(), Addition::Effect("gravity".into()), "effect", "there is no effect \"gravity\""),
        (here(), Addition::Effect("restitution".into()), "effect", "restitution is already in the model"),
        (here(), law("mine", "ax = -k * vx"), "formula.text", "line 1, column 7: \"k\" is no name here"),
        (here(), law("mine", "ax = 1\nay = (2"), "formula.text", "line 2, column 8: expected ')'"),
        (
            here(),
            law("mine", "let k [banana] = 1; ax = k"),
            "formula.text",
            "line 1, column 8: \"banana\" is no unit",
        ),
        (here(), law("tilt", "ax = 1"), "formula.name", "\"tilt\" cannot name a law"),
        (here(), law("a b", "ax = 1"), "formula.name", "\"a b\" cannot name a law"),
        (
            here(),
            declared("ax = k", parameter("speed", 0.0)),
            "formula.parameters",
            "parameter speed: is a name",
        ),
        (here(), declared("ax = k", parameter("k", 2e9)), "formula.parameters", "parameter k: bounds"),
        (study(std::slice::from_ref(&video), &["x".into()]), known.clone(), "study.models[0]", "is \"x\""),
        (study(std::slice::from_ref(&video), &[format!("{other}/models/0")]), known, "study.models[0]", "is"),
    ];
    for (study, addition, field, message) in cases {
        let refused = add(&service, study, addition).await.unwrap_err();
        assert_eq!(fields(&refused), [field], "{refused:?}");
        assert!(refused.message().starts_with(&format!("{field}: {message}")), "{}", refused.message());
    }
    let chosen = v1::model_choice::Choice::Model(format!("{other}/models/0"));
    let elsewhere = v1::StudyRequest { start: Some(v1::ModelChoice { choice: Some(chosen) }), ..here() };
    let refused = add(&service, elsewhere, Addition::Effect("tilt".into())).await.unwrap_err();
    assert_eq!(fields(&refused), ["study.start.model"]);
    assert!(refused.message().contains(&format!("name one of {video}")), "{}", refused.message());
    let refused = remove(&service, here(), "tilt").await.unwrap_err();
    assert_eq!(fields(&refused), ["effect"]);
    assert!(refused.message().contains("is not in the model, whose effects are"), "{}", refused.message());
    let nothing = v1::AddEffectRequest { study: Some(here()), addition: None };
    assert_eq!(fields(&service.models().add_effect(nothing).await.unwrap_err()), ["addition"]);
    let twice = study(&[video.clone(), other.clone()], &[format!("{video}/models/0")]);
    let refused = add(&service, twice, Addition::Effect("tilt".into())).await.unwrap_err();
    assert_eq!(fields(&refused), ["study.models"]);
    let gone = study(std::slice::from_ref(&video), &[format!("{video}/models/0")]);
    let refused = add(&service, gone, Addition::Effect("tilt".into())).await.unwrap_err();
    assert_eq!(refused.code(), tonic::Code::NotFound);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_video_that_is_too_short_gets_advice_what_to_record() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(video("short", 2)).await.unwrap();
    let [_, after] = add(&service, study(&[video], &[]), Addition::Effect("tilt".into())).await.unwrap();
    assert_eq!(after.worth(), v1::Worth::NotIdentifiable);
    assert!(
        after.not_identifiable_reason.contains("record objects that move"),
        "{}",
        after.not_identifiable_reason
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_formula_of_the_user_is_ranked_with_the_library() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let videos = post(&service, "bullet_coriolis_medium").await;
    let own =
        |name: &str, text: &str| v1::Formula { name: name.into(), text: text.into(), parameters: vec![] };
    let candidates = vec![
        own("turning", "let w [rad/s] = 0; ax = 2*w*vy; ay = -2*w*vx"),
        own("wind", "let a [m/s^2] = 0; ax = a"),
    ];
    use v1::diagnose_model_response::Event;
    let asked = v1::DiagnoseModelRequest { study: Some(study(&videos[..2], &[])), candidates };
    let mut stream = service.models().diagnose_model(asked).await.unwrap().into_inner();
    let mut last = None;
    while let Some(message) = stream.message().await.unwrap() {
        last = message.event;
    }
    let Some(Event::Diagnosis(found)) = last else { panic!("{last:?}") };
    let place = |effect: &str| found.ranked.iter().position(|r| r.effect == effect).unwrap();
    let evidence = |effect: &str| found.ranked[place(effect)].log_evidence.unwrap();
    assert!((evidence("turning") - evidence("coriolis")).abs() < 1.0, "{:?}", found.ranked);
    assert!(place("turning") < place("wind") && found.ranked[place("wind")].kind == "formula");
}
