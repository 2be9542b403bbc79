//! Discovery on data of other physics engines: a hidden effect is found and added; without one nothing is found.

use crate::harness::*;
use std::path::Path;
use vrdp::api::v1;

/// Posts the scenes of a group (Bullet scenes of one set-up).
pub async fn post(service: &Running, group: &str) -> Vec<String> {
    let mut videos = vec![];
    for k in 0..4 {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/effects").join(group);
        let text = std::fs::read_to_string(folder.join(format!("scene_{k:02}/observed.json"))).unwrap();
        let scene = vrdp::scene::parse(&format!("{group} {k}"), &text).unwrap();
        videos.push(service.create(vrdp::api::video_message("", &scene, true)).await.unwrap());
    }
    videos
}

pub fn request(videos: &[String]) -> v1::DiscoverEffectsRequest {
    let study = v1::StudyRequest { videos: videos.to_vec(), ..Default::default() };
    v1::DiscoverEffectsRequest { study: Some(study), ..Default::default() }
}

async fn discover(service: &Running, videos: &[String]) -> v1::Discovery {
    use v1::discover_effects_response::Event;
    let mut client = service.models().max_decoding_message_size(64 << 20);
    let mut stream = client.discover_effects(request(videos)).await.unwrap().into_inner();
    while let Some(message) = stream.message().await.unwrap() {
        if let Some(Event::Discovery(found)) = message.event {
            return found;
        }
    }
    panic!("the stream ended without a result");
}

async fn report(service: &Running, videos: &[String]) -> v1::Report {
    use v1::write_report_response::Event;
    let question = "What will happen if the gray sphere is removed?";
    let request = v1::WriteReportRequest {
        study: request(videos).study,
        questions: vec![v1::AskRequest {
            question: Some(v1::ask_request::Question::Text(question.into())),
            ..Default::default()
        }],
        trace_prefix: "t/".into(),
        ..Default::default()
    };
    let mut stream = service.models().write_report(request).await.unwrap().into_inner();
    while let Some(message) = stream.message().await.unwrap() {
        if let Some(Event::Report(report)) = message.event {
            return report;
        }
    }
    panic!("the stream ended without a page");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_rotating_frame_is_found_and_the_error_falls_to_the_noise() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let videos = post(&service, "bullet_coriolis_medium").await;
    let found = discover(&service, &videos).await;
    assert_eq!(found.verdict(), v1::Verdict::EffectFound, "{}", found.reason);
    let kinds: Vec<&str> = found.effects.iter().map(|e| e.kind.as_str()).collect();
    assert_eq!(kinds, ["coriolis"]);
    let omega = &found.effects[0].parameters[0];
    assert_eq!((omega.name.as_str(), omega.unit.as_str()), ("Omega", "rad/s"));
    // The simulator's value, from group.json.
    assert!(omega.low[0] < 0.0827 && 0.0827 < omega.high[0], "{omega:?}");
    let [before, after] = &found.revisions[..] else { panic!("{:?}", found.revisions) };
    assert!(before.rmse > 3.0 * found.noise_sigma && after.rmse < 1.2 * found.noise_sigma);
    assert!(after.held_out_rmse < before.held_out_rmse);
    let frames = found.trajectories[0].frames.len();
    assert!(
        frames > 60 && found.trajectories[0].frames[frames - 1].objects.iter().any(|o| o.before != o.after)
    );

    let page = report(&service, &videos).await;
    for text in ["Missing: coriolis", "Error of each revision", "+ coriolis", "noise floor", "Derivation"] {
        assert!(page.html.contains(text), "{text}");
    }
    assert!(page.pictures.iter().any(|p| p.name == "ladder.svg" && p.svg.contains("+ coriolis")));
    assert!(page.pictures.iter().any(|p| p.name.contains("counterfactual")));
    for name in &page.traces {
        assert!(page.html.contains(&format!("t/{}.mcap", name.trim_start_matches("traces/"))), "{name}");
        assert!(!download(&service, name).await.is_empty());
    }
    assert!(page.traces.len() > videos.len(), "those of the answer are there too");
    let asked = page.traces.len() - videos.len();

    // A revision is a model like any other, and is stored beyond a restart.
    service.stop().await;
    let service = start(folder.path(), CAPACITY).await;
    let model = service
        .models()
        .get_model(v1::GetModelRequest { name: after.models[0].clone(), ..Default::default() })
        .await
        .unwrap();
    assert_eq!(model.into_inner().revision, 1);
    let choice = v1::ModelChoice { choice: Some(v1::model_choice::Choice::Model(after.models[0].clone())) };
    let simulate = v1::SimulateRequest {
        video: videos[0].clone(),
        model: Some(choice),
        rollouts: Some(2),
        ..Default::default()
    };
    service.reasoning().simulate(simulate).await.unwrap();
    assert_eq!(discover(&service, &videos).await, found);
    // Traces of each video's discovery, of the simulation and of the answer; none of the fits of the search.
    assert_eq!(verified(&service).await.len(), videos.len() + asked + 1);
}

/// A drag along one axis, from another physics engine: the formula is a revision like any other.
#[tokio::test(flavor = "multi_thread")]
async fn a_law_that_no_library_has_is_added_as_a_formula() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut videos = vec![];
    for k in 1..=2 {
        let file = format!("tests/data/outside/video_{k}.csv");
        let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap();
        let scene = vrdp::scene::parse_csv(&format!("outside {k}"), &text).unwrap();
        videos.push(service.create(vrdp::api::video_message("", &scene, true)).await.unwrap());
    }
    let found = discover(&service, &videos).await;
    assert_eq!(found.verdict(), v1::Verdict::OutsideLibrary, "{}", found.reason);
    let [law] = &found.effects[..] else { panic!("{:?}", found.effects) };
    assert_eq!((law.kind.as_str(), found.ranked[0].kind.as_str()), ("formula", "formula"));
    // The simulator's value: the head of the file names the generator.
    let c1 = law.parameters.iter().find(|p| p.name == "c1").unwrap();
    assert!(c1.low[0] < -0.2793 && -0.2793 < c1.high[0], "{c1:?}");
    let [before, after] = &found.revisions[..] else { panic!("{:?}", found.revisions) };
    assert!(before.rmse > 3.0 * found.noise_sigma && after.rmse < 1.2 * found.noise_sigma);
    assert!(after.held_out_rmse < 0.5 * before.held_out_rmse);
    let name = after.models[0].clone();
    let model = service
        .models()
        .get_model(v1::GetModelRequest { name, ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    assert_eq!((model.revision, model.shared.iter().any(|p| p.parameter == "c1")), (1, true));
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_found_where_nothing_is_hidden() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let videos = post(&service, "bullet_none_medium").await;
    let found = discover(&service, &videos).await;
    assert_eq!(found.verdict(), v1::Verdict::Adequate, "{}", found.reason);
    assert!(found.effects.is_empty() && found.revisions.len() == 1);
    assert!(!found.smallest.is_empty(), "it says what it would have seen");

    use v1::compare_models_response::Event;
    let study = v1::StudyRequest { videos: videos[..1].to_vec(), ..Default::default() };
    let asked = v1::CompareModelsRequest { study: Some(study), ..Default::default() };
    let mut stream = service.models().compare_models(asked).await.unwrap().into_inner();
    let mut last = None;
    while let Some(message) = stream.message().await.unwrap() {
        last = message.event;
    }
    let Some(Event::Comparison(comparison)) = last else { panic!("{last:?}") };
    let video = &comparison.videos[0];
    assert_eq!(video.video, videos[0]);
    assert!(video.reduced_chi_square < 1.5 && !video.regimes.is_empty() && !comparison.summary.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn broken_studies_are_refused_with_the_field() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let again = service.create(video("the same", 20)).await.unwrap();
    let elsewhere = v1::Video { world: v1::World::Table.into(), ..video("elsewhere", 21) };
    let elsewhere = service.create(elsewhere).await.unwrap();
    let video = service.create(video("a", 20)).await.unwrap();
    let twice = vec![video.clone(), video.clone()];
    let many = v1::DiscoverEffectsRequest { max_effects: Some(0), ..request(std::slice::from_ref(&video)) };
    let cases = [
        (request(&[]), "study.videos"),
        (request(&[video.clone(), again]), "study.videos"),
        (request(&[video.clone(), elsewhere]), "study.videos"),
        (request(&twice), "study.videos"),
        (request(&["nonsense".into()]), "study.videos[0]"),
        (many, "max_effects"),
    ];
    for (request, field) in cases {
        let refused = service.models().discover_effects(request).await.unwrap_err();
        assert_eq!(fields(&refused), [field]);
    }
    let linked = v1::WriteReportRequest {
        study: request(std::slice::from_ref(&video)).study,
        trace_prefix: "javascript:alert(1)".into(),
        ..Default::default()
    };
    assert_eq!(fields(&service.models().write_report(linked).await.unwrap_err()), ["trace_prefix"]);
    let unknown = format!("videos/{}", "0".repeat(32));
    let refused = service.models().discover_effects(request(&[unknown])).await.unwrap_err();
    assert_eq!(refused.code(), tonic::Code::NotFound);
}
