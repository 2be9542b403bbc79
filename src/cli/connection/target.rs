//! The options of all commands: which service is used, and how it is reached.

use std::path::PathBuf;

/// Options of all commands.
#[derive(clap::Args, Clone, Default)]
#[command(next_help_heading = "Options of all commands")]
pub struct Target {
    /// URL of a running service, such as http://127.0.0.1:50051 [default: a service inside this process]
    #[arg(long, global = true, value_name = "URL")]
    pub server: Option<String>,
    /// Folder of the store [default: a temporary folder; for `serve`: vrdp-data]
    #[arg(long, global = true, value_name = "DIR")]
    pub data_dir: Option<PathBuf>,
    /// Certificate of the authority that signed the service's certificate (PEM) [default: the authorities of this system]
    #[arg(long, global = true, value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Client certificate (PEM); needs --key.
    #[arg(long, global = true, value_name = "FILE")]
    pub cert: Option<PathBuf>,
    /// Private key of --cert (PEM).
    #[arg(long, global = true, value_name = "FILE")]
    pub key: Option<PathBuf>,
    /// File with the access token of a tenant.
    #[arg(long, global = true, value_name = "FILE")]
    pub token: Option<PathBuf>,
    /// Shows results only, no progress.
    #[arg(long, short, global = true)]
    pub quiet: bool,
}
