//! The service as a command uses it: a remote one, or one started inside this process on a loopback port.

use super::data_folder::{self, DataFolder};
use super::local::{CutOperations, LocalService, start_with};
use super::remote::{ServiceChannel, remote};
use super::stream::{self, StreamEvent};
use super::target::Target;
use crate::api::v1::concepts_client::ConceptsClient;
use crate::api::v1::models_client::ModelsClient;
use crate::api::v1::operations_client::OperationsClient;
use crate::api::v1::reasoning_client::ReasoningClient;
use crate::api::v1::traces_client::TracesClient;
use crate::api::v1::videos_client::VideosClient;
use crate::api::v1::{
    CreateLexiconRequest, CreateVideoRequest, DownloadTraceRequest, FitMethod, FitModelRequest,
    FitModelResponse, ListModelsRequest, ListVideosRequest, Model, ModelChoice, Video, fit_model_response,
};
use crate::cli::error::Failure;
use crate::cli::input::{bytes, post_request};
use crate::config::{Config, Flags};
use crate::scene::Scene;
use std::net::SocketAddr;
use std::path::Path;
use tempfile::TempDir;

/// Largest message that the client accepts: a long simulation.
const MAX_MESSAGE: usize = 64 << 20;

/// Most rows in one reply to a listing.
const PAGE: i32 = 1000;

/// A client of the service, and the service itself if it runs inside this process.
pub struct Connection {
    channel: ServiceChannel,
    service: Option<LocalService>,
    /// The temporary store; deleted after the service has stopped.
    store: Option<TempDir>,
}

impl Connection {
    pub async fn open(target: &Target) -> Result<Connection, Failure> {
        if let Some(url) = &target.server {
            return Ok(Connection { channel: remote(url, target).await?, service: None, store: None });
        }
        let store = match &target.data_dir {
            Some(_) => None,
            None => Some(TempDir::new().map_err(Failure::other)?),
        };
        let data_dir =
            store.as_ref().map(TempDir::path).or(target.data_dir.as_deref()).map(Path::to_path_buf);
        let flags = Flags {
            listen: Some("127.0.0.1:0".into()),
            http: Some(String::new()),
            data_dir,
            workers: target.threads,
            ..Flags::default()
        };
        let mut config = Config::for_command(flags).map_err(|e| Failure::input(e.to_string()))?;
        if store.is_some() {
            // Nothing is deleted from a temporary folder.
            config.reserve_bytes = 0;
        }
        let service = match data_folder::open(&config).await? {
            DataFolder::Own(engine) => start_with(&config, *engine, CutOperations::Stay).await?,
            DataFolder::Served(url) => {
                let channel = remote(&url, &Target::default()).await?;
                return Ok(Connection { channel, service: None, store: None });
            }
        };
        let channel = remote(&format!("http://{}", service.address), &Target::default()).await?;
        Ok(Connection { channel, service: Some(service), store })
    }

    /// Address of the service inside this process.
    pub fn address(&self) -> Option<SocketAddr> {
        self.service.as_ref().map(|s| s.address)
    }

    /// Whether the traces remain after the command has ended.
    pub fn keeps_traces(&self) -> bool {
        self.store.is_none()
    }

    pub async fn close(self) -> Result<(), Failure> {
        drop(self.channel);
        match self.service {
            Some(service) => service.stop().await,
            None => Ok(()),
        }
    }

    /// Posts a scene, with the stills of its video; returns the name of its video.
    pub async fn post(&self, scene: &Scene) -> Result<String, Failure> {
        Ok(self.create(post_request(scene)).await?.name)
    }

    pub async fn create(&self, request: CreateVideoRequest) -> Result<Video, Failure> {
        Ok(self.videos().create_video(request).await?.into_inner())
    }

    pub fn videos(&self) -> VideosClient<ServiceChannel> {
        let client = VideosClient::new(self.channel.clone());
        client.max_encoding_message_size(MAX_MESSAGE).max_decoding_message_size(MAX_MESSAGE)
    }

    /// Fits a model to a posted video; `progress` receives fractions from 0 to 1.
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

    /// Runs the fit request: returns the model of its video, then those of `others`.
    pub async fn fit_together(
        &self,
        request: FitModelRequest,
        progress: impl Fn(f64),
    ) -> Result<Vec<Model>, Failure> {
        let open = async || self.models().fit_model(request.clone()).await;
        let event = |m: FitModelResponse| match m.event? {
            fit_model_response::Event::Progress(p) => Some(StreamEvent::Progress(p.fraction)),
            fit_model_response::Event::Model(model) => {
                Some(StreamEvent::Result([vec![model], m.others].concat()))
            }
        };
        stream::final_result(open, event, progress).await
    }

    pub fn models(&self) -> ModelsClient<ServiceChannel> {
        ModelsClient::new(self.channel.clone()).max_decoding_message_size(MAX_MESSAGE)
    }

    pub fn operations(&self) -> OperationsClient<ServiceChannel> {
        OperationsClient::new(self.channel.clone()).max_decoding_message_size(MAX_MESSAGE)
    }

    pub fn reasoning(&self) -> ReasoningClient<ServiceChannel> {
        ReasoningClient::new(self.channel.clone()).max_decoding_message_size(MAX_MESSAGE)
    }

    pub fn concepts(&self) -> ConceptsClient<ServiceChannel> {
        let client = ConceptsClient::new(self.channel.clone());
        client.max_encoding_message_size(MAX_MESSAGE).max_decoding_message_size(MAX_MESSAGE)
    }

    /// Stores the lexicon of a file; its name, or an empty one without a file.
    pub async fn lexicon(&self, file: Option<&Path>) -> Result<String, Failure> {
        let Some(file) = file else { return Ok(String::new()) };
        let content = bytes(file)?;
        let stored = self.concepts().create_lexicon(CreateLexiconRequest { content }).await;
        Ok(stored.map_err(|e| Failure::from(e).at(&file.display().to_string()))?.into_inner().name)
    }

    /// All models of a video.
    pub async fn models_of(&self, video: &str) -> Result<Vec<Model>, Failure> {
        let (mut models, mut page_token) = (vec![], String::new());
        loop {
            let request =
                ListModelsRequest { parent: video.into(), page_size: PAGE, page_token, ..Default::default() };
            let page = self.models().list_models(request).await?.into_inner();
            models.extend(page.models);
            page_token = page.next_page_token;
            if page_token.is_empty() {
                return Ok(models);
            }
        }
    }

    /// The names of all videos.
    pub async fn video_names(&self) -> Result<Vec<String>, Failure> {
        let (mut names, mut page_token) = (vec![], String::new());
        loop {
            let request = ListVideosRequest { page_size: PAGE, page_token, ..Default::default() };
            let page = self.videos().list_videos(request).await?.into_inner();
            names.extend(page.videos.into_iter().map(|video| video.name));
            page_token = page.next_page_token;
            if page_token.is_empty() {
                return Ok(names);
            }
        }
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
