//! A service on a free port with a folder of its own, and small videos to send.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Status};
use tonic_types::StatusExt;
use vrdp::api::{self, Security, ServerLimits, v1};
use vrdp::engine::{Capacity, Engine, EngineError};
use vrdp::store::StoreError;

pub use v1::concepts_client::ConceptsClient;
pub use v1::models_client::ModelsClient;
pub use v1::operations_client::OperationsClient;
pub use v1::reasoning_client::ReasoningClient;
pub use v1::traces_client::TracesClient;
pub use v1::videos_client::VideosClient;

pub struct Running {
    pub engine: Arc<Engine>,
    pub channel: Channel,
    pub url: String,
    stop: CancellationToken,
    task: tokio::task::JoinHandle<Result<(), api::ServeError>>,
}

pub const CAPACITY: Capacity = Capacity { workers: 1, queue: 64, job_timeout: Duration::from_secs(600) };

/// Starts a service that is ready when this returns.
pub async fn start(folder: &Path, capacity: Capacity) -> Running {
    start_secured(folder, capacity, Security::default(), |url| Endpoint::from_shared(url).unwrap()).await
}

/// Starts a service; `client` makes the endpoint for its URL.
pub async fn start_secured(
    folder: &Path,
    capacity: Capacity,
    security: Security,
    client: impl FnOnce(String) -> Endpoint,
) -> Running {
    // A cancelled job of the service before may hold the folder a moment longer.
    let engine = loop {
        match Engine::open(folder, capacity) {
            Err(EngineError::Store(StoreError::Locked { .. })) => tokio::task::yield_now().await,
            opened => break opened.unwrap(),
        }
    };
    start_engine(engine, security, client).await
}

/// Starts a service with this engine.
pub async fn start_engine(
    engine: Engine,
    security: Security,
    client: impl FnOnce(String) -> Endpoint,
) -> Running {
    let engine = Arc::new(engine);
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let stop = CancellationToken::new();
    let ended = stop.clone().cancelled_owned();
    api::resume_operations(&engine).await;
    let task = tokio::spawn(api::serve(listener, engine.clone(), ServerLimits::default(), security, ended));
    let channel = client(url.clone()).connect().await.unwrap();
    Running { engine, channel, url, stop, task }
}

/// Simulates a video once.
pub async fn simulate(channel: &Channel, video: &str) -> Result<v1::SimulateResponse, Status> {
    let request = v1::SimulateRequest { video: video.into(), rollouts: Some(1), ..Default::default() };
    Ok(ReasoningClient::new(channel.clone()).simulate(request).await?.into_inner())
}

impl Running {
    /// Drains and stops the service; then its folder is free. Every stored trace must be reproduced bit for bit.
    pub async fn stop(self) {
        for record in self.engine.traces(Default::default(), "", REPLAYED).await.unwrap_or_default() {
            // Traces that a test damaged on purpose cannot be read.
            let Ok(bytes) = whole(&self.engine, &record.id).await else { continue };
            let found = vrdp::recording::verify(std::io::Cursor::new(bytes), &vrdp::num::never).unwrap();
            assert!(found.holds() && found.identical, "{}: {found:?}", record.id);
        }
        let Running { engine, channel, stop, task, .. } = self;
        drop(channel);
        stop.cancel();
        task.await.unwrap().unwrap();
        // The connections' tasks may hold the engine a moment longer.
        let mut engine = Some(engine);
        while let Some(held) = engine.take() {
            if let Err(still) = Arc::try_unwrap(held) {
                engine = Some(still);
                tokio::task::yield_now().await;
            }
        }
    }

    /// Keeps one worker busy until the sender is used or dropped.
    pub async fn occupy(&self) -> std::sync::mpsc::Sender<()> {
        let (release, wait) = std::sync::mpsc::channel::<()>();
        let (started, start) = tokio::sync::oneshot::channel();
        let engine = self.engine.clone();
        tokio::spawn(async move {
            let job = move || {
                let _ = started.send(());
                let _ = wait.recv();
                Err::<(), _>(EngineError::Cancelled)
            };
            engine.compute(job).await
        });
        start.await.unwrap();
        release
    }

    pub fn videos(&self) -> VideosClient<Channel> {
        VideosClient::new(self.channel.clone()).max_encoding_message_size(64 << 20)
    }
    pub fn models(&self) -> ModelsClient<Channel> {
        ModelsClient::new(self.channel.clone())
    }
    pub fn reasoning(&self) -> ReasoningClient<Channel> {
        ReasoningClient::new(self.channel.clone()).max_decoding_message_size(64 << 20)
    }
    pub fn traces(&self) -> TracesClient<Channel> {
        TracesClient::new(self.channel.clone())
    }

    pub fn concepts(&self) -> ConceptsClient<Channel> {
        ConceptsClient::new(self.channel.clone())
    }

    pub fn operations(&self) -> OperationsClient<Channel> {
        OperationsClient::new(self.channel.clone())
    }

    pub async fn create(&self, video: v1::Video) -> Result<String, Status> {
        let request = v1::CreateVideoRequest { video: Some(video), ..Default::default() };
        Ok(self.videos().create_video(request).await?.into_inner().name)
    }

    /// The reported progress, and the model.
    pub async fn fit(&self, video: &str) -> Result<(Vec<f64>, v1::Model), Status> {
        self.fit_with(v1::FitModelRequest { parent: video.into(), ..Default::default() }).await
    }

    pub async fn fit_with(&self, request: v1::FitModelRequest) -> Result<(Vec<f64>, v1::Model), Status> {
        use v1::fit_model_response::Event;
        let mut stream = self.models().fit_model(request).await?.into_inner();
        let mut progress = Vec::new();
        while let Some(message) = stream.message().await? {
            match message.event.unwrap() {
                Event::Progress(p) => progress.push(p.fraction),
                Event::Model(model) => return Ok((progress, model)),
            }
        }
        panic!("the stream ended without a model");
    }
}

/// Two discs that glide side by side over `frames` frames, and a cube at rest.
pub fn video(name: &str, frames: u32) -> v1::Video {
    use v1::shape::{Disc, Kind, Square};
    let object = |id: u32, color: &str, kind: Kind, speed: f64| v1::Object {
        id,
        color: color.into(),
        material: "rubber".into(),
        shape: Some(v1::Shape { kind: Some(kind) }),
        mass: None,
        features: vec![],
        samples: (0..frames).map(|f| sample(f, 0.04 * speed * f as f64, id as f64)).collect(),
    };
    let disc = || Kind::Disc(Disc { radius: 0.2 });
    v1::Video {
        display_name: name.into(),
        world: v1::World::Clevrer.into(),
        objects: vec![
            object(0, "red", disc(), 1.0),
            object(1, "blue", disc(), 0.8),
            object(2, "green", Kind::Square(Square { half_side: 0.2 }), 0.0),
        ],
        ..Default::default()
    }
}

pub fn sample(frame: u32, x: f64, y: f64) -> v1::Sample {
    let position = v1::Vector { x, y };
    v1::Sample {
        frame,
        place: Some(v1::sample::Place::Position(position)),
        yaw: Some(0.0),
        ..Default::default()
    }
}

/// A real scene of the fixtures, as a message.
pub fn fixture(name: &str) -> v1::Video {
    let path = format!("{}/tests/data/clevrer/{name}/observed.json", env!("CARGO_MANIFEST_DIR"));
    let scene = vrdp::scene::parse(name, &std::fs::read_to_string(path).unwrap()).unwrap();
    api::video_message("", &scene, true)
}

/// The fields that a refusal names.
pub fn fields(status: &Status) -> Vec<String> {
    assert_eq!(status.code(), Code::InvalidArgument, "{status:?}");
    assert!(status.get_details_error_info().is_some(), "every refusal carries ErrorInfo");
    let details = status.get_details_bad_request().unwrap();
    details.field_violations.into_iter().map(|v| v.field).collect()
}

/// Simulates every stored trace again from its file alone and checks that all bits are equal; returns their names.
pub async fn verified(service: &Running) -> Vec<String> {
    let request = v1::ListTracesRequest { page_size: 1000, ..Default::default() };
    let traces = service.traces().list_traces(request).await.unwrap().into_inner().traces;
    for trace in &traces {
        let bytes = download(service, &trace.name).await;
        assert_eq!(bytes.len() as u64, trace.size_bytes);
        let found = vrdp::recording::verify(std::io::Cursor::new(bytes), &vrdp::num::never).unwrap();
        assert!(found.holds() && found.identical, "{}: {found:?}", trace.name);
    }
    traces.into_iter().map(|t| t.name).collect()
}

/// Most traces of one service that are simulated again when it ends.
const REPLAYED: usize = 50;

async fn whole(engine: &Arc<Engine>, id: &str) -> Result<Vec<u8>, EngineError> {
    let mut download = engine.download(id).await?;
    let mut bytes = Vec::new();
    loop {
        match download.next().await?.1 {
            chunk if chunk.is_empty() => return Ok(bytes),
            chunk => bytes.extend_from_slice(&chunk),
        }
    }
}

/// The file of a trace.
pub async fn download(service: &Running, name: &str) -> Vec<u8> {
    let request = v1::DownloadTraceRequest { name: name.into() };
    let mut stream = service.traces().download_trace(request).await.unwrap().into_inner();
    let mut bytes = Vec::new();
    while let Some(chunk) = stream.message().await.unwrap() {
        assert_eq!(chunk.offset, bytes.len() as u64);
        bytes.extend(chunk.data);
    }
    bytes
}
