//! `serve`: runs the service until SIGTERM or ctrl-c.

use super::Target;
use super::connect::start;
use super::error::Failure;
use super::output::print;
use crate::config::{Config, Flags};
use crate::telemetry;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Address of the gRPC service [default: 127.0.0.1:50051]
    #[arg(long, value_name = "HOST:PORT")]
    listen: Option<String>,
    /// Address of the HTTP port with /metrics and /healthz; '': none [default: 127.0.0.1:8080]
    #[arg(long, value_name = "HOST:PORT")]
    http: Option<String>,
    /// Listen beyond loopback though nothing is encrypted.
    #[arg(long)]
    insecure: bool,
    /// Configuration file.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

pub async fn run(target: &Target, args: Args) -> Result<(), Failure> {
    let Args { listen, http, insecure, config } = args;
    let flags = Flags { listen, http, insecure: insecure.then_some(true), data_dir: target.data_dir.clone() };
    let config = Config::load(config.as_deref(), flags).map_err(|e| Failure::input(e.to_string()))?;
    telemetry::init(&config.log, config.log_json).map_err(Failure::input)?;
    tracing::info!(?config, "effective configuration");
    let service = start(&config).await?;
    let http = service.http.map(|address| format!("vrdp serves HTTP on {address}\n")).unwrap_or_default();
    print(&format!("vrdp serves gRPC on {}\n{http}", service.address))?;
    interrupted().await?;
    service.stop().await
}

async fn interrupted() -> Result<(), Failure> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate()).map_err(Failure::other)?;
    tokio::select! {
        _ = terminate.recv() => Ok(()),
        done = tokio::signal::ctrl_c() => done.map_err(Failure::other),
    }
}
