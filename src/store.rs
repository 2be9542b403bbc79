//! The data folder: videos, fits, studies, operations and trace records in one redb file, trace files in a folder beside it.
//!
//! Guarantees:
//! * A value is durable when `put` returns; a killed process leaves whole values or none.
//! * A file is published whole or not at all; its record is written after it and deleted before it.
//! * What belongs to a video is stored only while the video exists, in one transaction with that check.
//! * Each row has a checksum. A damaged row is reported under its key, hides no other row, and lists count it.
//! * Each row has a head, which names its key a second time. Lists of videos read heads only.
//! * After an I/O error the database takes no more work until it is opened again, which the next call does.
//! * Deletions work on a full disk, in the space of the reserve.
//! * Each tenant sees its own rows only; the tenant is part of the key.
//!
//! Rows of older programs stay readable: stored names of fields never change, new fields have defaults. Ids of results
//! hold the program's version and its numeric fingerprint, so results of older programs are listed but not reused.

mod blobs;
mod care;
mod disk;
mod error;
mod folder;
mod operations;
mod read;
mod scan;
mod schema;
mod tenant;
mod write;

pub use care::backup::BackupReport;
pub use care::check::{CheckReport, FolderFault};
pub use care::restore::{RestoreReport, restore};
pub use disk::backend::WRITE_ERRORS;
pub use error::StoreError;
pub use folder::{StorageState, Store};
pub use read::{Listing, PageStart, TimedRow};
pub use schema::heads::VideoHead;
pub use schema::migrations::SCHEMA_VERSION;
pub use schema::tables::TableKind;
pub use schema::usage::{Quota, StoredBytes};
pub use tenant::Tenant;
pub use write::now_ms;

#[cfg(test)]
mod tests;
