//! A data folder that another process holds: a command uses the service that holds it, or waits until it is free.

use super::local::{open_store, store_failure};
use crate::cli::error::Failure;
use crate::cli::output::{self, progress};
use crate::config::Config;
use crate::engine::{Engine, EngineError};
use crate::store::StoreError;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::time::sleep;

/// File in a data folder with the URL of the service that holds it.
const URL_FILE: &str = "service-url";
/// How often a command tries again.
const RETRY_EVERY: Duration = Duration::from_millis(300);

/// The URL of a service in its data folder, until the service stops.
pub struct Announcement(PathBuf);

impl Announcement {
    /// Writes the URL. If it cannot be written, other commands wait instead.
    pub fn new(config: &Config, mut address: SocketAddr) -> Announcement {
        if address.ip().is_unspecified() {
            address.set_ip(IpAddr::V4(Ipv4Addr::LOCALHOST));
        }
        let file = config.data_dir.join(URL_FILE);
        // Only a service without encryption and tokens can be used without further flags.
        let scheme = if config.tls_cert.is_some() || config.tokens.is_some() { "https" } else { "http" };
        let _ = std::fs::write(&file, format!("{scheme}://{address}\n"));
        Announcement(file)
    }
}

impl Drop for Announcement {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// A data folder for a command.
pub enum DataFolder {
    Own(Box<Engine>),
    /// URL of the service that holds it.
    Served(String),
}

/// Opens the folder, or finds the service that holds it; waits while another command does.
pub async fn open(config: &Config) -> Result<DataFolder, Failure> {
    let folder = &config.data_dir;
    let mut is_first = true;
    loop {
        match open_store(config) {
            Err(EngineError::Store(StoreError::Locked { .. })) => {}
            opened => {
                // A killed service leaves its file.
                let _ = std::fs::remove_file(folder.join(URL_FILE));
                return opened.map(|engine| DataFolder::Own(Box::new(engine))).map_err(store_failure);
            }
        }
        match announced(folder).await {
            Some(url) if url.starts_with("https:") => {
                return Err(Failure::input(format!(
                    "the data folder {} is held by the service at {url}; name it with --server, and --ca or --token where \
                     it asks for them, instead of --data-dir",
                    folder.display()
                )));
            }
            Some(url) => {
                say(&format!("using the service at {url}, which holds the data folder {}", folder.display()));
                return Ok(DataFolder::Served(url));
            }
            None if is_first => {
                say(&format!("waiting for another command, which uses the data folder {}", folder.display()));
                is_first = false;
            }
            None => {}
        }
        sleep(RETRY_EVERY).await;
    }
}

fn say(line: &str) {
    if !progress::is_quiet() {
        output::tell(line);
    }
}

/// The URL in the folder, if something listens there.
async fn announced(folder: &Path) -> Option<String> {
    let url = std::fs::read_to_string(folder.join(URL_FILE)).ok()?.trim().to_string();
    let address: SocketAddr = url.split_once("://")?.1.parse().ok()?;
    TcpStream::connect(address).await.ok()?;
    Some(url)
}
