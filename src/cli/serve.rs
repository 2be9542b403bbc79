//! `serve`: runs the service until SIGTERM or ctrl-c.

use super::Target;
use super::connect::start;
use super::error::Failure;
use super::output::print;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Address of the gRPC service.
    #[arg(long, default_value = "127.0.0.1:50051")]
    listen: String,
    /// Configuration file.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

pub async fn run(target: &Target, args: Args) -> Result<(), Failure> {
    let data_dir = target.data_dir.clone().unwrap_or("vrdp-data".into());
    let service = start(&args.listen, &data_dir, args.config.as_deref()).await?;
    print(&format!("vrdp serves gRPC on {}\n", service.address))?;
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
