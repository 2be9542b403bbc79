//! A socket in the data folder, through which a command on the same machine has the service that holds the folder copy or
//! check it. Who may use the folder may use the socket; it knows no tenants.
//!
//! The command writes a line: `backup` or `check`. The service answers with chunks of the backup, each after its length (4
//! bytes, little endian), then a length of 0, then the report as JSON, or `{"error": ...}`.

use crate::cli::error::Failure;
use crate::engine::{Engine, EngineError};
use crate::store::{BackupReport, CheckReport};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::io::{self, BufRead, BufReader, BufWriter, ErrorKind, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::UnixListener;

const SOCKET_FILE: &str = "data.sock";
const BACKUP: &str = "backup";
const CHECK: &str = "check";
/// Longest that a command may take to ask, or to take a chunk: a backup keeps old pages of the database.
const PATIENCE: Duration = Duration::from_secs(60);
/// How long no connection is taken after one that could not be.
const ACCEPT_PAUSE: Duration = Duration::from_secs(1);
/// Most bytes of a request.
const MAX_REQUEST: u64 = 16;
/// Bytes of a chunk.
const CHUNK: usize = 256 << 10;

/// What the service answers after the chunks.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum SocketAnswer<T> {
    Report(T),
    Error(String),
}

/// The socket's file, until it is dropped.
struct SocketFile(PathBuf);

impl Drop for SocketFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Answers commands until it is dropped. The caller holds the folder.
pub async fn serve_data_socket(folder: PathBuf, engine: Arc<Engine>) {
    let file = SocketFile(folder.join(SOCKET_FILE));
    // A killed service leaves its socket.
    let _ = std::fs::remove_file(&file.0);
    let bound = UnixListener::bind(&file.0).and_then(|listener| {
        std::fs::set_permissions(&file.0, std::fs::Permissions::from_mode(0o600))?;
        Ok(listener)
    });
    let listener = match bound {
        Ok(listener) => listener,
        Err(error) => {
            tracing::warn!(%error, "no socket in the data folder: backups need the service to be stopped");
            return;
        }
    };
    loop {
        let stream = match listener.accept().await {
            Ok((stream, _)) => stream,
            // Such as no free file: it may pass.
            Err(error) => {
                tracing::warn!(%error, "the socket in the data folder took no connection");
                tokio::time::sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        let engine = engine.clone();
        let answered = tokio::task::spawn_blocking(move || {
            let stream = stream.into_std()?;
            stream.set_nonblocking(false)?;
            answer(&stream, &engine)
        });
        // One at a time: each reads the whole folder.
        if let Ok(Err(error)) = answered.await {
            tracing::warn!(%error, "a backup or a check ended early");
        }
    }
}

fn answer(stream: &UnixStream, engine: &Engine) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut request = String::new();
    BufReader::new(stream.take(MAX_REQUEST)).read_line(&mut request)?;
    let mut to = BufWriter::with_capacity(CHUNK, Chunks(stream));
    match request.trim() {
        BACKUP => {
            let report = engine.backup(&mut to);
            to.flush()?;
            tracing::info!(?report, "a backup was made");
            conclude(stream, report)
        }
        CHECK => conclude(stream, engine.check()),
        other => conclude::<CheckReport>(
            stream,
            Err(EngineError::invalid("request", format!("is {other:?}; write {BACKUP} or {CHECK}"))),
        ),
    }
}

fn conclude<T: Serialize>(mut stream: &UnixStream, report: Result<T, EngineError>) -> io::Result<()> {
    stream.write_all(&0u32.to_le_bytes())?;
    let answer = match report {
        Ok(report) => SocketAnswer::Report(report),
        Err(error) => SocketAnswer::Error(error.to_string()),
    };
    serde_json::to_writer(stream, &answer).map_err(io::Error::from)
}

/// Writes each buffer with its length before it.
struct Chunks<'s>(&'s UnixStream);

impl Write for Chunks<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let part = &bytes[..bytes.len().min(CHUNK)];
        if !part.is_empty() {
            self.0.write_all(&(part.len() as u32).to_le_bytes())?;
            self.0.write_all(part)?;
        }
        Ok(part.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// Has the service that holds the folder write a backup. It blocks.
pub fn backup_from_service(folder: &Path, to: &mut impl Write) -> Result<BackupReport, Failure> {
    ask(folder, BACKUP, to)
}

/// Has the service that holds the folder check it. It blocks.
pub fn check_by_service(folder: &Path) -> Result<CheckReport, Failure> {
    ask(folder, CHECK, &mut io::sink())
}

fn ask<T: DeserializeOwned>(folder: &Path, request: &str, to: &mut impl Write) -> Result<T, Failure> {
    let file = folder.join(SOCKET_FILE);
    let none = |error: io::Error| match error.kind() {
        ErrorKind::NotFound | ErrorKind::ConnectionRefused => Failure::input(format!(
            "{} is used by another process that offers no backups; wait until it ends, or stop it",
            folder.display()
        )),
        _ => Failure::other(format!("{}: {error}", file.display())),
    };
    let mut stream = UnixStream::connect(&file).map_err(none)?;
    let early = |error: io::Error| Failure::other(format!("the service ended the {request} early: {error}"));
    stream.write_all(format!("{request}\n").as_bytes()).map_err(early)?;
    let mut chunk = vec![0; CHUNK];
    loop {
        let mut len = [0; 4];
        stream.read_exact(&mut len).map_err(early)?;
        let len = u32::from_le_bytes(len) as usize;
        let Some(part) = chunk.get_mut(..len) else {
            return Err(Failure::other("the service sent a chunk that is too long"));
        };
        if part.is_empty() {
            break;
        }
        stream.read_exact(part).map_err(early)?;
        to.write_all(part).map_err(|e| Failure::other(format!("the backup cannot be written: {e}")))?;
    }
    match serde_json::from_reader(stream).map_err(Failure::other)? {
        SocketAnswer::Report(report) => Ok(report),
        SocketAnswer::Error(error) => Err(Failure::other(error)),
    }
}
