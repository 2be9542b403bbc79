//! Joint fits of the videos of a set-up; a simulation that ends early reports it.

use crate::harness::*;
use vrdp::api::v1;

/// Gliding objects decelerate by `brake` (m/s^2).
fn of_setup(name: &str, setup: &str, frames: u32, brake: f64) -> v1::Video {
    let mut video = v1::Video { setup: setup.into(), ..video(name, frames) };
    for sample in video.objects.iter_mut().flat_map(|o| &mut o.samples) {
        let t = 0.04 * f64::from(sample.frame);
        if let Some(v1::sample::Place::Position(p)) = &mut sample.place
            && p.x > 0.0
        {
            p.x -= 0.5 * brake * t * t;
        }
    }
    video
}

async fn fit(
    service: &Running,
    request: v1::FitModelRequest,
) -> Result<(v1::Model, Vec<v1::Model>), tonic::Status> {
    let mut stream = service.models().fit_model(request).await?.into_inner();
    while let Some(message) = stream.message().await? {
        if let Some(v1::fit_model_response::Event::Model(model)) = message.event {
            return Ok((model, message.others));
        }
    }
    panic!("the stream ended without a model");
}

#[tokio::test(flavor = "multi_thread")]
async fn videos_of_a_set_up_are_fitted_together_and_share_its_physics() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut names = vec![];
    for (name, setup) in [("a", "table"), ("b", "table"), ("c", "lawn"), ("d", "")] {
        let (frames, brake) = (20 + names.len() as u32, 0.2 + 0.1 * names.len() as f64);
        names.push(service.create(of_setup(name, setup, frames, brake)).await.unwrap());
    }
    let [a, b, c, d] = [0, 1, 2, 3].map(|i| names[i].clone());
    let request = |parent: &String, others: &[&String]| v1::FitModelRequest {
        parent: parent.clone(),
        others: others.iter().map(|o| o.to_string()).collect(),
        ..Default::default()
    };
    let (model, others) = fit(&service, request(&a, &[&b])).await.unwrap();
    assert!(model.name.starts_with(&a) && others.len() == 1 && others[0].name.starts_with(&b));
    // Shared parameters are equal in both models; a single fit has other values.
    let shared = |m: &v1::Model| m.shared.iter().find(|s| s.effect == "sliding_friction").cloned().unwrap();
    assert_eq!(shared(&model), shared(&others[0]));
    let (alone, none) = fit(&service, request(&a, &[])).await.unwrap();
    assert!(none.is_empty() && alone.name != model.name);
    assert!(shared(&alone) != shared(&model), "{:?} {:?}", shared(&alone), shared(&model));
    // It is stored, and a request that names the same videos in another way finds it.
    assert_eq!(service.engine.fits_run(), 2);
    let other = fit(&service, request(&b, &[&a])).await.unwrap();
    assert_eq!((&other.0, &other.1[0]), (&others[0], &model));
    let whole = v1::FitModelRequest { whole_setup: true, ..request(&b, &[]) };
    assert_eq!(fit(&service, whole.clone()).await.unwrap(), other);
    assert_eq!(service.engine.fits_run(), 2);
    let get = v1::GetModelRequest { name: others[0].name.clone(), ..Default::default() };
    let got = service.models().get_model(get).await.unwrap().into_inner();
    assert!(got.create_time.is_some());
    assert_eq!(v1::Model { create_time: None, ..got }, others[0]);

    for (request, field) in [
        (request(&a, &[&c]), "others"),
        (request(&a, &[&"videos/x".to_string()]), "others[0]"),
        (v1::FitModelRequest { whole_setup: true, ..request(&a, &[&b]) }, "others"),
        (v1::FitModelRequest { parent: d, ..whole }, "whole_setup"),
    ] {
        assert_eq!(fields(&fit(&service, request).await.unwrap_err()), [field]);
    }
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_simulation_of_too_many_events_says_where_it_ends() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let ball = v1::shape::Kind::Ball(v1::shape::Ball { radius: 0.03 });
    let object = v1::Object {
        id: 0,
        color: "red".into(),
        shape: Some(v1::Shape { kind: Some(ball) }),
        mass: Some(0.2),
        samples: (0..20).map(|f| sample(f, 0.0, 0.0)).collect(),
        ..Default::default()
    };
    let table = v1::Table { x_min: -0.1, x_max: 0.1, y_min: -0.1, y_max: 0.1 };
    let given = v1::Video {
        world: v1::World::Billiards.into(),
        table: Some(table),
        objects: vec![object],
        ..Default::default()
    };
    let name = service.create(given).await.unwrap();
    let (_, model) = service.fit(&name).await.unwrap();
    let mut edited: serde_json::Value = serde_json::from_str(&model.model_json).unwrap();
    let effects = edited["effects"].as_array_mut().unwrap();
    effects.retain(|e| e["name"] == "cushion");
    for p in effects[0]["parameters"].as_array_mut().unwrap() {
        let value = if p["name"] == "restitution" { 1.0 } else { 0.0 };
        p["values"] = serde_json::json!([value]);
        p["means"] = serde_json::json!([value]);
        p["prior"] = serde_json::json!({ "mean": value, "sd": 0.0 });
    }
    let faster =
        v1::intervention::SetVelocity { object_id: 0, velocity: Some(v1::Vector { x: 9000.0, y: 0.0 }) };
    let kind = v1::intervention::Kind::SetVelocity(faster);
    let request = |frames| v1::SimulateRequest {
        video: name.clone(),
        model: Some(v1::ModelChoice {
            choice: Some(v1::model_choice::Choice::ModelJson(edited.to_string())),
        }),
        interventions: vec![v1::Intervention { kind: Some(kind.clone()) }],
        frames,
        rollouts: Some(1),
        ..Default::default()
    };
    let reply = service.reasoning().simulate(request(100)).await.unwrap().into_inner();
    let cut = reply.cut_short.unwrap();
    assert_eq!(cut.reason(), v1::cut_short::Reason::EventLimit);
    let there = reply.frames.iter().take_while(|f| !f.objects.is_empty()).count();
    assert_eq!(cut.frame, Some(there as u32));
    assert!(there < 100 && cut.message.contains("fewer frames"), "{cut:?}");
    let whole = service.reasoning().simulate(request(5)).await.unwrap().into_inner();
    assert_eq!(whole.cut_short, None);
    service.stop().await;
}
