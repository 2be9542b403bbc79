//! Certificates and tokens of a running service: their files are read again when they change.

use super::Config;
use crate::api::LiveSecurity;
use std::time::Duration;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// How often the files are looked at: a revoked token is refused within a second.
const POLL: Duration = Duration::from_millis(500);

/// The digests of the files; `None` of one that cannot be read.
fn digests(config: &Config) -> Vec<Option<[u8; 32]>> {
    let files =
        [&config.tls_cert, &config.tls_key, &config.tls_client_ca, &config.tokens].into_iter().flatten();
    files.map(|file| Some(blake3::hash(&std::fs::read(file).ok()?).into())).collect()
}

/// Reads the files again when they change and at SIGHUP, until it is dropped. While they cannot be used, what held before holds on.
pub async fn reload_security(config: Config, security: LiveSecurity) {
    // Without the signal the files are still looked at.
    let mut hangup = signal(SignalKind::hangup()).ok();
    let mut known = digests(&config);
    loop {
        let is_asked = tokio::select! {
            () = tokio::time::sleep(POLL) => false,
            () = next(&mut hangup) => true,
        };
        let found = digests(&config);
        if found == known && !is_asked {
            continue;
        }
        known = found;
        match config.security() {
            Ok(read) => {
                security.replace(read);
                tracing::info!("certificates and tokens were read again");
            }
            Err(error) => {
                tracing::error!(%error, "the new certificates or tokens cannot be used; the old ones hold on");
            }
        }
    }
}

async fn next(signal: &mut Option<Signal>) {
    match signal {
        Some(signal) => {
            signal.recv().await;
        }
        None => std::future::pending().await,
    }
}
