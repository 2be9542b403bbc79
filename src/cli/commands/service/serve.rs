//! `serve`: runs the service until SIGTERM or ctrl-c.

use crate::cli::connection::Target;
use crate::cli::connection::{Announcement, start};
use crate::cli::error::Failure;
use crate::cli::output::print;
use crate::config::{Config, Flags, reload_security};
use crate::telemetry;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct ServeArgs {
    /// Address of the gRPC service [default: 127.0.0.1:50051]
    #[arg(long, value_name = "HOST:PORT")]
    listen: Option<String>,
    /// Address of the HTTP port with the dashboard, /metrics and /healthz; '': no HTTP [default: 127.0.0.1:8080]
    #[arg(long, value_name = "HOST:PORT")]
    http: Option<String>,
    /// Certificate chain of the service (PEM).
    #[arg(long, value_name = "FILE")]
    tls_cert: Option<PathBuf>,
    /// Private key of --tls-cert (PEM).
    #[arg(long, value_name = "FILE")]
    tls_key: Option<PathBuf>,
    /// Certificate of the authority that signs client certificates (PEM); clients then need one.
    #[arg(long, value_name = "FILE")]
    tls_client_ca: Option<PathBuf>,
    /// File with lines TOKEN = TENANT; clients then need a token and see only the data of their tenant.
    #[arg(long, value_name = "FILE")]
    tokens: Option<PathBuf>,
    /// Prints the effective configuration and exits.
    #[arg(long)]
    print_config: bool,
    /// Allows other machines to connect without encryption or authentication.
    #[arg(long)]
    insecure: bool,
    /// Configuration file.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

pub async fn run(target: &Target, args: ServeArgs) -> Result<(), Failure> {
    let ServeArgs { listen, http, tls_cert, tls_key, tls_client_ca, tokens, print_config, insecure, config } =
        args;
    let (insecure, data_dir, workers) = (insecure.then_some(true), target.data_dir.clone(), target.threads);
    let flags = Flags { listen, http, insecure, data_dir, tls_cert, tls_key, tls_client_ca, tokens, workers };
    let config = Config::load(config.as_deref(), flags).map_err(|e| Failure::input(e.to_string()))?;
    let collector = Some(config.otlp.as_str()).filter(|url| !url.is_empty());
    let _telemetry = telemetry::init(&config.log, config.log_json, collector).map_err(Failure::input)?;
    if print_config {
        return print(&toml::to_string(&config).map_err(Failure::other)?);
    }
    tracing::info!(?config, "effective configuration");
    for address in config.exposed() {
        tracing::warn!(%address, "--insecure: other machines reach this address, and not everything is encrypted and authenticated");
    }
    let service = start(&config).await?;
    let reloading = tokio::spawn(reload_security(config.clone(), service.security.clone()));
    let _announcement = Announcement::new(&config, service.address);
    let scheme = if config.tls_cert.is_some() { "https" } else { "http" };
    let http =
        service.http.map(|address| format!("vrdp serves HTTP on {scheme}://{address}\n")).unwrap_or_default();
    print(&format!("vrdp serves gRPC on {}\n{http}", service.address))?;
    interrupted().await?;
    let stopped = service.stop().await;
    // Until the end SIGHUP must not end the process.
    reloading.abort();
    stopped
}

/// Waits for SIGTERM or Ctrl-C.
pub async fn interrupted() -> Result<(), Failure> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate()).map_err(Failure::other)?;
    tokio::select! {
        _ = terminate.recv() => Ok(()),
        done = tokio::signal::ctrl_c() => done.map_err(Failure::other),
    }
}
