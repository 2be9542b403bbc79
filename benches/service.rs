//! Measures a question over gRPC: cached, compared with the smallest call; and fresh, with its stored trace.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Runtime;
use tokio_util::sync::CancellationToken;
use tonic::transport::Channel;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;
use vrdp::api::v1::models_client::ModelsClient;
use vrdp::api::v1::reasoning_client::ReasoningClient;
use vrdp::api::v1::videos_client::VideosClient;
use vrdp::api::{Security, ServerLimits, serve, v1, video_message};
use vrdp::engine::{Capacity, Engine};
use vrdp::scene::parse;

const SCENE: &str = include_str!("../tests/data/clevrer/scene_00000/observed.json");

/// A service with the fitted video, and the folder of its store.
async fn start() -> (Channel, String, tempfile::TempDir) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let capacity = Capacity { workers: 1, queue: 64, job_timeout: Duration::from_secs(60) };
    let engine = Arc::new(Engine::open(folder.path(), capacity).expect("an empty store opens"));
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.expect("a free port");
    let url = format!("http://{}", listener.local_addr().expect("it is bound"));
    tokio::spawn(serve(
        listener,
        engine,
        ServerLimits::default(),
        Security::default(),
        CancellationToken::new().cancelled_owned(),
    ));
    let channel = Channel::from_shared(url).expect("a URL").connect().await.expect("it serves");
    let scene = parse("scene_00000", SCENE).expect("the committed scene is valid");
    let request =
        v1::CreateVideoRequest { video: Some(video_message("", &scene, true)), ..Default::default() };
    let posted = VideosClient::new(channel.clone()).create_video(request).await.expect("it is valid");
    let parent = posted.into_inner().name;
    let request = v1::FitModelRequest { parent: parent.clone(), ..Default::default() };
    let fitting = ModelsClient::new(channel.clone()).fit_model(request).await.expect("it can be fitted");
    let mut fitting = fitting.into_inner();
    while fitting.message().await.expect("it can be fitted").is_some() {}
    (channel, parent, folder)
}

fn counterfactual(video: &str, seed: u64) -> v1::AskRequest {
    let english = |text: &str| v1::Choice { choice: Some(v1::choice::Choice::Text(text.into())) };
    let question = "What will happen if the cube is removed?".to_string();
    v1::AskRequest {
        video: video.to_string(),
        question: Some(v1::ask_request::Question::Text(question)),
        choices: vec![english("The brown sphere and the cyan cylinder collide")],
        seed,
        ..Default::default()
    }
}

fn benches(criterion: &mut Criterion) {
    let runtime = Runtime::new().expect("threads");
    let (channel, video, _folder) = runtime.block_on(start());
    let mut group = criterion.benchmark_group("unary");
    group.throughput(Throughput::Elements(1));
    let mut health = HealthClient::new(channel.clone());
    group.bench_function("health", |b| {
        b.iter(|| {
            let check = HealthCheckRequest { service: String::new() };
            runtime.block_on(health.check(black_box(check))).expect("it serves")
        });
    });
    let mut reasoning = ReasoningClient::new(channel);
    group.bench_function("question_cached", |b| {
        b.iter(|| runtime.block_on(reasoning.ask(black_box(counterfactual(&video, 0)))).expect("an answer"));
    });
    // A new seed makes a new question.
    let mut seed = 0;
    group.bench_function("counterfactual_fresh", |b| {
        b.iter(|| {
            seed += 1;
            runtime.block_on(reasoning.ask(black_box(counterfactual(&video, seed)))).expect("an answer")
        });
    });
    group.finish();
}

criterion_group!(service, benches);
criterion_main!(service);
