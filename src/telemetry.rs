//! Logs: to standard error, as text for people or as JSON for machines.

use std::io::IsTerminal;
use tracing_subscriber::{EnvFilter, fmt};

/// Starts logging once; a second call changes nothing. An unreadable filter is refused.
pub fn init(filter: &str, json: bool) -> Result<(), String> {
    let filter = EnvFilter::try_new(filter).map_err(|e| format!("log filter {filter:?}: {e}"))?;
    let builder =
        fmt().with_env_filter(filter).with_ansi(std::io::stderr().is_terminal()).with_writer(std::io::stderr);
    // It fails only where a logger is set already, as in tests.
    let _ = if json { builder.json().try_init() } else { builder.try_init() };
    Ok(())
}
