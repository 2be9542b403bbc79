//! What can go wrong with the data folder: a disk that fails, a disk that is full, and data that are damaged.

use std::error::Error;
use std::io::{self, ErrorKind};

/// Failures of the disk and of the database; each says what to do. Only `Failed` and `Full` may pass by themselves.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StoreError {
    #[error("data folder {path} is in use by another process; stop it, or choose another --data-dir")]
    Locked { path: String },
    #[error(
        "data folder {path} has schema version {found}, this program knows {known}; use a newer program, or \
         another --data-dir"
    )]
    Newer { path: String, found: u64, known: u64 },
    #[error(
        "data folder {path} cannot be used: {cause}; make it writable, restore it from a copy if it is damaged, or choose another --data-dir"
    )]
    Unusable { path: String, cause: String },
    #[error(
        "data folder {path} has traces, but its database is missing or empty; restore a backup into an empty folder \
         with `vrdp data restore`, or choose another --data-dir"
    )]
    DatabaseGone { path: String },
    #[error("the video was deleted meanwhile")]
    VideoGone,
    #[error(
        "the file of trace {id} is missing in the data folder; request the simulation again to rebuild it"
    )]
    FileGone { id: String },
    #[error(
        "the record {key} of the data folder is damaged; post the video or send the request again, or restore the folder from a copy"
    )]
    Damaged { key: String },
    #[error(
        "{kind} of this tenant need {needed_bytes} bytes, and {limit_bytes} are allowed; delete some, or have the limit raised"
    )]
    Quota { kind: &'static str, needed_bytes: u64, limit_bytes: u64 },
    #[error(
        "the disk of the service's data folder is full; free some space, or delete videos, then try again"
    )]
    Full,
    #[error(
        "storage failed: {0}; check free space and permissions of the service's data folder, then try again"
    )]
    Failed(String),
}

impl StoreError {
    /// The same error, which names this record where it named none.
    pub(super) fn at(self, record: &str) -> StoreError {
        match self {
            StoreError::Damaged { key } if key.is_empty() => damaged(record),
            other => other,
        }
    }
}

/// The error of a record that cannot be read; it stands in the log.
pub(super) fn damaged(key: &str) -> StoreError {
    tracing::error!(key, "a record of the data folder is damaged");
    StoreError::Damaged { key: key.into() }
}

/// An error of the database. A damaged page names no record yet.
pub(super) fn failed(error: impl Into<redb::Error>) -> StoreError {
    match error.into() {
        redb::Error::Io(error) => io_failed(&error),
        redb::Error::Corrupted(_)
        | redb::Error::TableDoesNotExist(_)
        | redb::Error::TableTypeMismatch { .. }
        | redb::Error::TableIsMultimap(_)
        | redb::Error::TypeDefinitionChanged { .. }
        | redb::Error::TransactionPoisoned => StoreError::Damaged { key: String::new() },
        other => StoreError::Failed(other.to_string()),
    }
}

/// An error of a file.
pub(super) fn io_failed(error: &io::Error) -> StoreError {
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => StoreError::Full,
        _ => StoreError::Failed(error.to_string()),
    }
}

/// An error of a trace's file, without the path: callers do not learn where the folder is.
pub(super) fn blob_failed(error: &object_store::Error) -> StoreError {
    let mut cause: Option<&(dyn Error + 'static)> = Some(error);
    while let Some(inner) = cause {
        if let Some(io) = inner.downcast_ref::<io::Error>() {
            return io_failed(io);
        }
        cause = inner.source();
    }
    tracing::error!(%error, "a trace file failed");
    StoreError::Failed("a trace file cannot be read or written".into())
}

/// An error of something else, such as a task.
pub(super) fn broken(error: impl std::fmt::Display) -> StoreError {
    StoreError::Failed(error.to_string())
}
