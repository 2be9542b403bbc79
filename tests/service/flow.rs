//! From a video to answers and traces, twice, and after a restart.

use crate::harness::*;
use tonic::Code;
use tonic_health::pb::{HealthCheckRequest, health_client::HealthClient};
use vrdp::api::v1;

#[tokio::test(flavor = "multi_thread")]
async fn a_real_video_is_fitted_predicted_asked_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let scene = fixture("scene_00022");
    let video = service.create(scene.clone()).await.unwrap();
    assert_eq!(service.create(scene.clone()).await.unwrap(), video, "the same content is the same video");
    let got = service
        .videos()
        .get_video(v1::GetVideoRequest { name: video.clone(), ..Default::default() })
        .await
        .unwrap();
    let got = got.into_inner();
    let create_time = got.create_time;
    assert!(create_time.is_some());
    assert_eq!(got, v1::Video { name: video.clone(), create_time, ..scene });

    an_outlier_is_named_and_kept(&service).await;

    let (progress, model) = service.fit(&video).await.unwrap();
    assert!(!progress.is_empty() && progress.is_sorted(), "{progress:?}");
    assert!(model.name.starts_with(&format!("{video}/models/")) && model.preset == "clevrer");
    assert_eq!(service.fit(&video).await.unwrap().1, model);
    assert_eq!(service.engine.fits_run(), 1);

    let kind = v1::intervention::Kind::Remove(v1::intervention::Remove { object_id: 0 });
    let request = v1::SimulateRequest {
        video: video.clone(),
        interventions: vec![v1::Intervention { kind: Some(kind) }],
        rollouts: Some(4),
        ..Default::default()
    };
    let prediction = service.reasoning().simulate(request.clone()).await.unwrap().into_inner();
    assert_eq!(prediction.frames.len(), prediction.observed_frames as usize + 60);
    assert!(prediction.frames.iter().flat_map(|f| &f.objects).all(|o| o.object_id != 0));
    assert_eq!(prediction.model, model.name);

    let (question, answer) = questions_are_answered(&service, &video).await;

    let bytes = download(&service, &prediction.trace).await;
    assert_eq!(vrdp::recording::read(&bytes).unwrap().frames.len(), prediction.frames.len());
    let traces = listed(&service, &video).await;
    assert!(traces.contains(&prediction.trace) && answer.traces.iter().all(|t| traces.contains(t)));
    service.stop().await;

    let service = start(folder.path(), CAPACITY).await;
    let kept = service
        .models()
        .get_model(v1::GetModelRequest { name: model.name.clone(), ..Default::default() })
        .await
        .unwrap();
    assert_eq!(v1::Model { create_time: None, ..kept.into_inner() }, model);
    assert_eq!(service.fit(&video).await.unwrap().1, model);
    assert_eq!(service.engine.fits_run(), 0, "a fit that was acknowledged is never done again");
    assert_eq!(service.reasoning().simulate(request).await.unwrap().into_inner(), prediction);
    assert_eq!(service.reasoning().ask(question).await.unwrap().into_inner(), answer);
    assert_eq!(download(&service, &prediction.trace).await, bytes);
    assert_eq!(listed(&service, &video).await, traces);
    verified(&service).await;

    service.videos().delete_video(v1::DeleteVideoRequest { name: video.clone() }).await.unwrap();
    assert_eq!(service.fit(&video).await.unwrap_err().code(), Code::NotFound);
    let gone = v1::DownloadTraceRequest { name: prediction.trace };
    assert_eq!(service.traces().download_trace(gone).await.unwrap_err().code(), Code::NotFound);
    service.stop().await;
}

/// A sample far from its track is named in the reply and stays in the video.
async fn an_outlier_is_named_and_kept(service: &Running) {
    let mut with_outlier = fixture("scene_00022");
    if let Some(v1::sample::Place::Position(at)) = &mut with_outlier.objects[1].samples[30].place {
        at.x += 1.5;
    }
    let video_with_outlier = service.create(with_outlier.clone()).await.unwrap();
    let got = service
        .videos()
        .get_video(v1::GetVideoRequest { name: video_with_outlier, ..Default::default() })
        .await
        .unwrap()
        .into_inner();
    let named: Vec<(u32, u32)> = got.outliers.iter().map(|s| (s.object, s.frame)).collect();
    assert_eq!(named, [(with_outlier.objects[1].id, with_outlier.objects[1].samples[30].frame)]);
    assert_eq!(got.objects, with_outlier.objects, "what was posted is kept");
}

/// Asks by program, in English with a choice, and as a stream in which one question fails.
async fn questions_are_answered(service: &Running, video: &str) -> (v1::AskRequest, v1::AskResponse) {
    let tokens: Vec<String> =
        ["events", "objects", "filter_collision", "events", "filter_start", "filter_after", "count"]
            .map(String::from)
            .into();
    let question = v1::AskRequest {
        video: video.into(),
        question: Some(v1::ask_request::Question::Program(v1::Program { tokens })),
        rollouts: Some(4),
        ..Default::default()
    };
    let answer = service.reasoning().ask(question.clone()).await.unwrap().into_inner();
    assert!(answer.answer.is_some() && !answer.explanation.is_empty() && !answer.derivation.is_empty());
    let choice = v1::choice::Choice::Text("The red object collides with the sphere".into());
    let english = v1::AskRequest {
        question: Some(v1::ask_request::Question::Text(
            "What will happen if the gray cube is removed?".into(),
        )),
        choices: vec![v1::Choice { choice: Some(choice) }],
        ..question.clone()
    };
    let judged = service.reasoning().ask(english).await.unwrap().into_inner();
    assert_eq!(judged.choices.len(), 1);
    assert!(!judged.traces.is_empty(), "a counterfactual stands on a simulation");

    let broken = v1::AskRequest { video: "videos/0".into(), ..question.clone() };
    let stream = tokio_stream::iter([question.clone(), broken, question.clone()]);
    let mut many = service.reasoning().ask_many(stream).await.unwrap().into_inner();
    for index in 0..3 {
        let reply = many.message().await.unwrap().unwrap();
        assert_eq!(reply.index, index);
        match reply.result.unwrap() {
            v1::ask_many_response::Result::Response(response) => assert_eq!(response, answer),
            v1::ask_many_response::Result::Error(error) => {
                assert_eq!((index, error.code), (1, Code::NotFound as i32));
            }
        }
    }
    assert!(many.message().await.unwrap().is_none());
    (question, answer)
}

/// Names of all traces of a video, page by page.
async fn listed(service: &Running, video: &str) -> Vec<String> {
    let mut names = Vec::new();
    let mut request = v1::ListTracesRequest { video: video.into(), page_size: 1, ..Default::default() };
    loop {
        let page = service.traces().list_traces(request.clone()).await.unwrap().into_inner();
        assert!(page.traces.len() <= 1);
        names.extend(page.traces.into_iter().map(|t| t.name));
        if page.next_page_token.is_empty() {
            return names;
        }
        request.page_token = page.next_page_token;
    }
}

#[tokio::test]
async fn health_and_effects_are_served() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut health = HealthClient::new(service.channel.clone());
    for name in ["", "vrdp.v1.Videos", "vrdp.v1.Models", "vrdp.v1.Reasoning", "vrdp.v1.Traces"] {
        let reply = health.check(HealthCheckRequest { service: name.into() }).await.unwrap();
        assert_eq!(reply.into_inner().status, 1, "{name}");
    }
    let effects = service.models().list_effects(v1::ListEffectsRequest {}).await.unwrap().into_inner();
    assert_eq!(effects.effects.len(), vrdp::effects::EFFECTS.len());
    drop(health);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn every_preset_and_its_model_file_fit_and_simulate_and_so_does_the_staged_method() {
    use v1::model_choice::Choice;
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let name = service.create(video("small", 20)).await.unwrap();
    let choice = |choice| Some(v1::ModelChoice { choice: Some(choice) });
    for preset in vrdp::world::PRESETS {
        let start = choice(Choice::Preset(preset.name.into()));
        let model = service.fit_with(fit_of(&name, start, v1::FitMethod::Unspecified)).await.unwrap().1;
        assert_eq!(model.preset, preset.name);
        let file = choice(Choice::ModelJson(model.model_json));
        let again = service.fit_with(fit_of(&name, file.clone(), v1::FitMethod::Unspecified)).await;
        assert_eq!(again.unwrap().1.preset, preset.name);
        let request =
            v1::SimulateRequest { video: name.clone(), model: file, rollouts: Some(2), ..Default::default() };
        let done = service.reasoning().simulate(request).await.unwrap().into_inner();
        assert_eq!(done.frames.len(), 80, "{}", preset.name);
    }
    let usual = service.fit(&name).await.unwrap().1;
    let staged = service.fit_with(fit_of(&name, None, v1::FitMethod::StagedLbfgs)).await.unwrap().1;
    assert!(staged.name != usual.name && staged.iterations != usual.iterations, "{staged:?}");
    let unknown = v1::FitModelRequest { method: 9, ..fit_of(&name, None, v1::FitMethod::StagedLbfgs) };
    assert_eq!(fields(&service.fit_with(unknown).await.unwrap_err()), ["method"]);
    service.stop().await;
}

fn fit_of(video: &str, start: Option<v1::ModelChoice>, method: v1::FitMethod) -> v1::FitModelRequest {
    v1::FitModelRequest { parent: video.into(), start, method: method.into(), ..Default::default() }
}
