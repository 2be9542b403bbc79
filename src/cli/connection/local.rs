//! Starts the service inside this process.

use super::data_socket::serve_data_socket;
use crate::api::{self, LiveSecurity, PortContext};
use crate::cli::error::Failure;
use crate::config::{Config, DEFAULT_HTTP};
use crate::engine::{ChatParser, Engine, EngineError};
use std::net::SocketAddr;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// The service running inside this process.
pub struct LocalService {
    /// What holds now; it may be replaced.
    pub security: LiveSecurity,
    pub address: SocketAddr,
    pub http: Option<SocketAddr>,
    shutdown: CancellationToken,
    task: JoinHandle<Result<(), Failure>>,
}

impl LocalService {
    /// Waits until the service has finished its running requests.
    pub async fn stop(self) -> Result<(), Failure> {
        self.shutdown.cancel();
        self.task.await.map_err(Failure::other)?
    }
}

/// Starts the service; when this returns, it accepts calls.
pub async fn start(config: &Config) -> Result<LocalService, Failure> {
    // Before the ports are bound: a data folder in use says more than a port in use.
    start_with(config, open_store(config).map_err(store_failure)?, CutOperations::GoOn).await
}

/// What becomes of operations that the end of the last service cut short.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum CutOperations {
    /// They go on: this is a service.
    GoOn,
    /// They stay for the next service: this is the service of one command.
    Stay,
}

/// The engine with the data folder of the settings.
pub fn open_store(config: &Config) -> Result<Engine, EngineError> {
    Engine::open(&config.data_dir, config.capacity())
}

/// The engine with the language model of the settings, if they name one.
fn with_parser(config: &Config, engine: Engine) -> Result<Engine, Failure> {
    match config.parser().map_err(|e| Failure::input(e.to_string()))? {
        Some(settings) => Ok(engine.with_parser(ChatParser::new(settings).map_err(Failure::other)?)),
        None => Ok(engine),
    }
}

pub fn store_failure(error: EngineError) -> Failure {
    match error {
        EngineError::Store(error) => Failure::input(error.to_string()),
        error => Failure::other(error),
    }
}

/// Starts the service with an open data folder.
pub async fn start_with(
    config: &Config,
    engine: Engine,
    operations: CutOperations,
) -> Result<LocalService, Failure> {
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
    let engine = engine.with_retention(config.retention()).with_quota(config.quota());
    let engine = Arc::new(with_parser(config, engine)?);
    let context = PortContext::new(security, config.port_limits());
    let (shutdown, limits) = (CancellationToken::new(), config.limits());
    let security = context.security.clone();
    let stop = shutdown.clone().cancelled_owned();
    let housekeeping =
        tokio::spawn(shutdown.clone().run_until_cancelled_owned(engine.clone().enforce_retention()));
    engine.keep_reserve(config.reserve_bytes);
    let socket = serve_data_socket(config.data_dir.clone(), engine.clone());
    let socket = tokio::spawn(shutdown.clone().run_until_cancelled_owned(socket));
    let http_address = http.as_ref().and_then(|listener| listener.local_addr().ok());
    let pages = http.map(|listener| {
        let stop = shutdown.clone().cancelled_owned();
        tokio::spawn(api::serve_http(listener, engine.clone(), context.clone(), stop))
    });
    let task = tokio::spawn(async move {
        if operations == CutOperations::GoOn {
            api::resume_operations(&engine).await;
        }
        let served = api::serve(listener, engine, limits, context, stop).await.map_err(Failure::other);
        housekeeping.abort();
        socket.abort();
        if let Some(pages) = pages {
            pages.abort();
        }
        served
    });
    Ok(LocalService { security, address, http: http_address, shutdown, task })
}

/// Binds the HTTP port. The default port may be in use by another service: then there is no HTTP port.
async fn http_listener(address: SocketAddr) -> Result<Option<TcpListener>, Failure> {
    match TcpListener::bind(address).await {
        Ok(listener) => Ok(Some(listener)),
        Err(error) if address == DEFAULT_HTTP => {
            tracing::warn!(%address, %error, "the HTTP port is in use, so there is none; choose another with --http");
            Ok(None)
        }
        Err(error) => {
            Err(Failure::input(format!("--http {address}: {error}; give a free HOST:PORT, or '' for none")))
        }
    }
}
