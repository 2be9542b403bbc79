//! Bad input of every kind: each is refused with the exact field, and the service still answers.

use crate::harness::*;
use tonic::Code;
use tonic_types::StatusExt;
use vrdp::api::v1;

/// Breaks a good video; the fields that must be named.
type Break = fn(&mut v1::Video) -> Vec<String>;

fn place(video: &mut v1::Video, object: usize, sample: usize, x: f64, y: f64) {
    let position = v1::Vector { x, y };
    video.objects[object].samples[sample].place = Some(v1::sample::Place::Position(position));
}

fn one(field: &str) -> Vec<String> {
    vec![field.to_string()]
}

const BREAKS: &[(&str, Break)] = &[
    ("NaN", |v| {
        place(v, 0, 7, f64::NAN, 0.0);
        one("video.objects[0].samples[7].position.x")
    }),
    ("infinite", |v| {
        place(v, 0, 3, 0.0, f64::INFINITY);
        one("video.objects[0].samples[3].position.y")
    }),
    ("no position", |v| {
        v.objects[2].samples[0].place = None;
        one("video.objects[2].samples[0].position")
    }),
    ("empty", |v| {
        *v = v1::Video::default();
        vec!["video.times".into(), "video.objects".into()]
    }),
    ("one frame", |v| {
        v.objects.iter_mut().for_each(|o| o.samples.truncate(1));
        one("video.times")
    }),
    ("duplicate ids", |v| {
        v.objects[2].id = 0;
        one("video.objects[2].id")
    }),
    ("times that run backwards", |v| {
        v.times = (0..20).map(|f| if f == 9 { 0.1 } else { 0.04 * f as f64 }).collect();
        one("video.times[9]")
    }),
    ("frames that run backwards", |v| {
        v.objects[0].samples[5].frame = 3;
        one("video.objects[0].samples[5].frame")
    }),
    ("overlapping objects", |v| {
        // A first position alone that is off would be left out.
        v.objects[1].samples = v.objects[0].samples.clone();
        one("video.objects[1]")
    }),
    ("unknown shape", |v| {
        v.objects[1].shape = Some(v1::Shape { kind: None });
        one("video.objects[1].shape")
    }),
    ("a size of nothing", |v| {
        let disc = v1::shape::Disc { radius: 0.0 };
        v.objects[0].shape = Some(v1::Shape { kind: Some(v1::shape::Kind::Disc(disc)) });
        one("video.objects[0].shape.disc.radius")
    }),
    ("unknown world", |v| {
        v.world = 99;
        one("video.world")
    }),
    ("a camera that sees a line", |v| {
        let matrix = [[1.0, 2.0, 3.0, 4.0], [2.0, 4.0, 6.0, 8.0], [0.0, 0.0, 0.0, 1.0]].concat();
        v.camera = Some(v1::Camera { matrix, image_width: 9.0, image_height: 9.0, ..Default::default() });
        one("video.camera.matrix")
    }),
    ("half a camera", |v| {
        v.camera = Some(v1::Camera {
            matrix: vec![1.0; 6],
            image_width: 9.0,
            image_height: 9.0,
            ..Default::default()
        });
        one("video.camera.matrix")
    }),
    ("100,000 frames", |v| {
        v.objects[0].samples = (0..100_000).map(|f| sample(f, 0.001 * f as f64, 0.0)).collect();
        let beyond = (15_001..15_100).map(|k| format!("video.objects[0].samples[{k}].frame"));
        one("video.times").into_iter().chain(beyond).collect()
    }),
    ("everything in one place", |v| {
        let object = v.objects[0].clone();
        v.objects = (0..17).map(|id| v1::Object { id, ..object.clone() }).collect();
        let pairs = (0..17).flat_map(|j| (0..j).map(move |_| format!("video.objects[{j}]")));
        pairs.take(100).collect()
    }),
    ("1,000 objects", |v| {
        let object = v.objects[0].clone();
        let copy = |id| v1::Object {
            id,
            samples: vec![sample(0, 0.0, id as f64), sample(1, 0.0, id as f64)],
            ..object.clone()
        };
        v.objects = (0..1000).map(copy).collect();
        one("video.objects")
    }),
];

#[tokio::test(flavor = "multi_thread")]
async fn broken_videos_are_refused_with_their_fields() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    for (what, spoil) in BREAKS {
        let mut spoiled = video("spoiled", 20);
        let expected = spoil(&mut spoiled);
        let status = service.create(spoiled).await.expect_err(what);
        let mut named = fields(&status);
        // If all are too many for a header, the first ones are sent.
        let cut = named.pop_if(|last| last == "...").is_some();
        let expected = if cut { &expected[..named.len()] } else { &expected[..] };
        assert!(named == expected && (!cut || named.len() > 20), "{what}: {named:?}");
    }
    let listed = service.videos().list_videos(v1::ListVideosRequest::default()).await.unwrap();
    assert_eq!(listed.into_inner().videos, vec![]);
    service.create(video("good", 20)).await.unwrap();
    service.stop().await;
}

fn program(tokens: &[&str]) -> Option<v1::ask_request::Question> {
    let tokens = tokens.iter().map(|t| t.to_string()).collect();
    Some(v1::ask_request::Question::Program(v1::Program { tokens }))
}

fn text(text: &str) -> Option<v1::ask_request::Question> {
    Some(v1::ask_request::Question::Text(text.into()))
}

fn remove(object_id: u32) -> v1::intervention::Kind {
    v1::intervention::Kind::Remove(v1::intervention::Remove { object_id })
}

/// Second edits that cannot be made, with the fields that a refusal names.
fn broken_edits() -> Vec<(Option<v1::intervention::Kind>, &'static str)> {
    let heavy = v1::intervention::ScaleMass { object_id: 0, factor: f64::NAN };
    let vector = |x, y| Some(v1::Vector { x, y });
    let fast = v1::intervention::SetVelocity { object_id: 1, velocity: vector(1e300, 0.0) };
    let far = v1::intervention::Place { object_id: 1, position: vector(0.0, 1e9), yaw: None };
    let onto = v1::intervention::Place { object_id: 1, position: vector(0.0, 2.1), yaw: None };
    let added = |radius, y| v1::intervention::Add {
        object_id: 9,
        shape: Some(v1::Shape { kind: Some(v1::shape::Kind::Disc(v1::shape::Disc { radius })) }),
        position: vector(0.0, y),
        ..Default::default()
    };
    // Object 1 comes by at x = 0.4 after half a second.
    let late = v1::intervention::Add { start_time: 0.5, position: vector(0.4, 1.0), ..added(0.2, 0.0) };
    let off = v1::intervention::SwitchEffect { effect: "magic".into(), on: false };
    vec![
        (Some(remove(77)), "interventions[1].remove.object_id"),
        (Some(v1::intervention::Kind::ScaleMass(heavy)), "interventions[1].scale_mass.factor"),
        (Some(v1::intervention::Kind::SwitchEffect(off)), "interventions[1].switch_effect.effect"),
        (None, "interventions[1]"),
        (Some(v1::intervention::Kind::SetVelocity(fast)), "interventions[1].set_velocity.velocity.x"),
        (Some(v1::intervention::Kind::Place(far)), "interventions[1].place.position.y"),
        (Some(v1::intervention::Kind::Place(onto)), "interventions[1].place.position"),
        (Some(v1::intervention::Kind::Add(added(1e300, 9.0))), "interventions[1].add.shape.disc.radius"),
        (Some(v1::intervention::Kind::Add(added(0.2, 1.1))), "interventions[1].add.position"),
        (Some(v1::intervention::Kind::Add(late)), "interventions[1].add.position"),
    ]
}

#[tokio::test(flavor = "multi_thread")]
async fn broken_questions_and_edits_are_refused_with_their_fields() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let name = service.create(video("good", 20)).await.unwrap();
    let long = "x".repeat(1 << 20);
    let questions = [
        (program(&["objects", &long]), "program.tokens[1]", "INVALID"),
        (program(&["objects", "filter_colour", "red"]), "program.tokens[1]", "INVALID"),
        (program(&[]), "program.tokens", "INVALID"),
        (None, "question", "INVALID"),
        (text(""), "text", "INVALID"),
        (text("What will happen if the purple sphere is removed?"), "question", "NO_SUCH_OBJECT"),
        (text("What will happen if the cylinder is removed?"), "question", "AMBIGUOUS_OBJECT"),
        (text("Why do birds sing?"), "question", "NOT_UNDERSTOOD"),
    ];
    for (question, field, reason) in questions {
        let asked = format!("{question:?}");
        let request =
            v1::AskRequest { video: name.clone(), question, rollouts: Some(1), ..Default::default() };
        let status = service.reasoning().ask(request).await.expect_err(&asked);
        assert_eq!(fields(&status), [field], "{asked}: {status:?}");
        assert_eq!(status.get_details_error_info().unwrap().reason, reason, "{asked}");
    }
    let simulate = |request: v1::SimulateRequest| {
        let mut client = service.reasoning();
        async move { client.simulate(request).await.unwrap_err() }
    };
    let good = v1::SimulateRequest { video: name.clone(), rollouts: Some(1), ..Default::default() };
    for (kind, field) in broken_edits() {
        let first = v1::Intervention { kind: Some(remove(0)) };
        let interventions = vec![first, v1::Intervention { kind }];
        let status = simulate(v1::SimulateRequest { interventions, ..good.clone() }).await;
        assert_eq!(fields(&status), [field]);
    }
    let model = |choice| Some(v1::ModelChoice { choice: Some(choice) });
    use v1::model_choice::Choice;
    let cases = [
        (v1::SimulateRequest { frames: 1_000_000, ..good.clone() }, "frames"),
        (v1::SimulateRequest { rollouts: Some(9999), ..good.clone() }, "rollouts"),
        (v1::SimulateRequest { video: "nonsense".into(), ..good.clone() }, "video"),
        (v1::SimulateRequest { model: model(Choice::Preset("x".into())), ..good.clone() }, "model.preset"),
        (
            v1::SimulateRequest { model: model(Choice::ModelJson("{}".into())), ..good.clone() },
            "model.model_json",
        ),
        (v1::SimulateRequest { model: model(Choice::Model("x".into())), ..good.clone() }, "model.model"),
    ];
    for (request, field) in cases {
        assert_eq!(fields(&simulate(request).await), [field]);
    }
    let unknown = simulate(v1::SimulateRequest { video: "videos/abc".into(), ..good.clone() }).await;
    assert_eq!(unknown.code(), Code::NotFound);
    assert_eq!(unknown.get_details_resource_info().unwrap().resource_name, "videos/abc");
    service.reasoning().simulate(good).await.unwrap();
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_long_request_id_is_refused_by_every_call_that_takes_one() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(video("named", 20)).await.unwrap();
    let request_id = "x".repeat(129);
    let id = || request_id.clone();
    let named = |status: tonic::Status| {
        assert!(!status.message().contains("xxx"), "{status:?}");
        let found = fields(&status);
        assert!(found.contains(&"request_id".to_string()), "{found:?}");
    };
    let post = v1::CreateVideoRequest {
        video: Some(fixture("scene_00000")),
        request_id: id(),
        ..Default::default()
    };
    named(service.videos().create_video(post).await.unwrap_err());
    let simulate = v1::SimulateRequest { video: video.clone(), request_id: id(), ..Default::default() };
    named(service.reasoning().simulate(simulate).await.unwrap_err());
    let ask = v1::AskRequest { video: video.clone(), request_id: id(), ..Default::default() };
    named(service.reasoning().ask(ask).await.unwrap_err());
    let fit = v1::FitModelRequest { parent: video.clone(), request_id: id(), ..Default::default() };
    named(service.models().fit_model(fit).await.unwrap_err());
    let learn = v1::LearnConceptsRequest { request_id: id(), ..Default::default() };
    named(service.concepts().learn_concepts(learn).await.unwrap_err());
    let start = v1::StartOperationRequest { request_id: id(), ..Default::default() };
    named(service.operations().start_operation(start).await.unwrap_err());
    let options = v1::ImportVideoOptions { request_id: id(), ..Default::default() };
    let part = v1::ImportVideoRequest { part: Some(v1::import_video_request::Part::Options(options)) };
    named(service.videos().import_video(tokio_stream::once(part)).await.unwrap_err());
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_formula_without_a_value_is_refused_before_anything_is_fitted() {
    use v1::add_effect_request::Addition;
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(video("formula", 20)).await.unwrap();
    for text in ["ax = 9^9^9", "ay = vx / (2 - 2)"] {
        let formula = v1::Formula { text: text.into(), ..Default::default() };
        let study = Some(v1::StudyRequest { videos: vec![video.clone()], ..Default::default() });
        let add = v1::AddEffectRequest { study, addition: Some(Addition::Formula(formula)) };
        assert_eq!(fields(&service.models().add_effect(add).await.unwrap_err()), ["formula.text"], "{text}");
    }
    assert_eq!(service.engine.fits_run(), 0);
    service.stop().await;
}
