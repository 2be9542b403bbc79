//! Reaches the service: a remote one, or one started inside this process on a loopback port.

use super::Target;
use super::error::Failure;
use super::study::{self, Said};
use super::wire::{Wire, remote};
use crate::api;
use crate::api::v1::models_client::ModelsClient;
use crate::api::v1::reasoning_client::ReasoningClient;
use crate::api::v1::traces_client::TracesClient;
use crate::api::v1::videos_client::VideosClient;
use crate::api::v1::{
    CreateVideoRequest, DownloadTraceRequest, FitMethod, FitModelRequest, FitModelResponse, Model,
    ModelChoice, Video, fit_model_response,
};
use crate::config::{Config, DEFAULT_HTTP, Flags};
use crate::engine::{Engine, EngineError};
use crate::scene::Scene;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// Largest message that a client takes: a long simulation, whole.
const MAX_MESSAGE: usize = 64 << 20;

/// A running service of this process.
pub struct Service {
    pub address: SocketAddr,
    pub http: Option<SocketAddr>,
    shutdown: CancellationToken,
    task: JoinHandle<Result<(), Failure>>,
}

impl Service {
    /// Lets it finish what it is doing and waits.
    pub async fn stop(self) -> Result<(), Failure> {
        self.shutdown.cancel();
        self.task.await.map_err(Failure::other)?
    }
}

/// Starts the service; it serves when this returns.
pub async fn start(config: &Config) -> Result<Service, Failure> {
    let listen = config.listen;
    let security = config.security().map_err(|e| Failure::input(e.to_string()))?;
    let listener = TcpListener::bind(listen)
        .await
        .map_err(|e| Failure::input(format!("--listen {listen}: {e}; give a free HOST:PORT")))?;
    let address = listener.local_addr().map_err(Failure::other)?;
    let http = match config.http {
        Some(address) => http_listener(address).await?,
        None => None,
    };
    let engine = Engine::open(&config.data_dir, config.capacity()).map_err(|error| match error {
        EngineError::Store(error) => Failure::input(error.to_string()),
        error => Failure::other(error),
    })?;
    let engine = Arc::new(engine.with_retention(config.retention()));
    let (shutdown, limits) = (CancellationToken::new(), config.limits());
    let stop = shutdown.clone().cancelled_owned();
    let house = tokio::spawn(shutdown.clone().run_until_cancelled_owned(engine.clone().enforce_retention()));
    let http_address = http.as_ref().and_then(|listener| listener.local_addr().ok());
    let pages = http.map(|listener| {
        let stop = shutdown.clone().cancelled_owned();
        tokio::spawn(api::serve_http(listener, engine.clone(), security.tokens.clone(), stop))
    });
    let task = tokio::spawn(async move {
        let served = api::serve(listener, engine, limits, security, stop).await.map_err(Failure::other);
        house.abort();
        if let Some(pages) = pages {
            pages.abort();
        }
        served
    });
    Ok(Service { address, http: http_address, shutdown, task })
}

/// The HTTP port. Where nobody chose it, another service may have it already: then there is none.
async fn http_listener(address: SocketAddr) -> Result<Option<TcpListener>, Failure> {
    match TcpListener::bind(address).await {
        Ok(listener) => Ok(Some(listener)),
        Err(error) if address == DEFAULT_HTTP => {
            tracing::warn!(%address, %error, "no HTTP port; choose another with --http");
            Ok(None)
        }
        Err(error) => {
            Err(Failure::input(format!("--http {address}: {error}; give a free HOST:PORT, or '' for none")))
        }
    }
}

/// The service as a command sees it.
pub struct Connection {
    channel: Wire,
    service: Option<Service>,
    /// Deleted last.
    _home: Option<TempDir>,
}

impl Connection {
    pub async fn open(target: &Target) -> Result<Connection, Failure> {
        if let Some(url) = &target.server {
            return Ok(Connection { channel: remote(url, target).await?, service: None, _home: None });
        }
        let home = match &target.data_dir {
            Some(_) => None,
            None => Some(TempDir::new().map_err(Failure::other)?),
        };
        let data_dir = home.as_ref().map(TempDir::path).or(target.data_dir.as_deref()).map(Path::to_path_buf);
        let flags = Flags {
            listen: Some("127.0.0.1:0".into()),
            http: Some(String::new()),
            data_dir,
            ..Flags::default()
        };
        let config = Config::load(None, flags).map_err(|e| Failure::input(e.to_string()))?;
        let service = start(&config).await?;
        let channel = remote(&format!("http://{}", service.address), &Target::default()).await?;
        Ok(Connection { channel, service: Some(service), _home: home })
    }

    /// Where the service listens, if it is ours.
    pub fn address(&self) -> Option<SocketAddr> {
        self.service.as_ref().map(|s| s.address)
    }

    /// Whether the service's traces are still there when the command has ended.
    pub fn keeps_traces(&self) -> bool {
        self._home.is_none()
    }

    pub async fn close(self) -> Result<(), Failure> {
        drop(self.channel);
        match self.service {
            Some(service) => service.stop().await,
            None => Ok(()),
        }
    }

    /// Posts a scene; gives the name of its video.
    pub async fn post(&self, scene: &Scene) -> Result<String, Failure> {
        let request =
            CreateVideoRequest { video: Some(api::video_message("", scene, true)), ..Default::default() };
        Ok(self.create(request).await?.name)
    }

    pub async fn create(&self, request: CreateVideoRequest) -> Result<Video, Failure> {
        Ok(self.videos().create_video(request).await?.into_inner())
    }

    pub fn videos(&self) -> VideosClient<Wire> {
        let client = VideosClient::new(self.channel.clone());
        client.max_encoding_message_size(MAX_MESSAGE).max_decoding_message_size(MAX_MESSAGE)
    }

    /// Fits a model to a video that was posted, and hears of its progress.
    pub async fn fit(
        &self,
        video: &str,
        start: Option<ModelChoice>,
        method: FitMethod,
        progress: impl Fn(f64),
    ) -> Result<Model, Failure> {
        let request =
            FitModelRequest { parent: video.into(), start, method: method.into(), ..Default::default() };
        let mut models = self.fit_together(request, progress).await?;
        Ok(models.swap_remove(0))
    }

    /// Fits as the request says: the model of its video, then those of the others.
    pub async fn fit_together(
        &self,
        request: FitModelRequest,
        progress: impl Fn(f64),
    ) -> Result<Vec<Model>, Failure> {
        let open = async || self.models().fit_model(request.clone()).await;
        let said = |m: FitModelResponse| match m.event? {
            fit_model_response::Event::Progress(p) => Some(Said::Progress(p.fraction)),
            fit_model_response::Event::Model(model) => Some(Said::Result([vec![model], m.others].concat())),
        };
        study::last(open, said, progress).await
    }

    pub fn models(&self) -> ModelsClient<Wire> {
        ModelsClient::new(self.channel.clone()).max_decoding_message_size(MAX_MESSAGE)
    }

    pub fn reasoning(&self) -> ReasoningClient<Wire> {
        ReasoningClient::new(self.channel.clone()).max_decoding_message_size(MAX_MESSAGE)
    }

    /// The MCAP file of a trace.
    pub async fn download(&self, trace: &str) -> Result<Vec<u8>, Failure> {
        let request = DownloadTraceRequest { name: trace.into() };
        let mut stream = TracesClient::new(self.channel.clone()).download_trace(request).await?.into_inner();
        let mut bytes = Vec::new();
        while let Some(chunk) = stream.message().await? {
            bytes.extend_from_slice(&chunk.data);
        }
        Ok(bytes)
    }
}
