//! Reads every row and file of a folder, and says by key what is damaged.

use crate::scene::Scene;
use crate::store::blobs::open_file;
use crate::store::disk::database::caught;
use crate::store::error::{StoreError, broken, failed};
use crate::store::folder::Store;
use crate::store::scan::{ByteTable, Found, scan};
use crate::store::schema::heads::{PlainHead, RowHead, VideoHead};
use crate::store::schema::migrations::{SCHEMA_VERSION, schema_of};
use crate::store::schema::rows::{readable, unsealed};
use crate::store::schema::tables::{HEADS, OPERATION_RESULTS, TABLES, TableKind};
use redb::{Database, ReadTransaction, ReadableDatabase, TableError};
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::ops::{Bound, ControlFlow};
use std::path::Path;

/// What a check has read and found.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CheckReport {
    pub rows: u64,
    pub trace_files: u64,
    pub faults: Vec<FolderFault>,
}

/// One damaged record or file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FolderFault {
    /// `{table}/{key}`, or the table alone where damage hides the keys.
    pub record: String,
    pub problem: String,
}

/// What the check of a trace reads of its record.
#[derive(Deserialize)]
struct CheckedTrace {
    id: String,
    size_bytes: u64,
}

impl Store {
    /// Reads all rows and trace files of all tenants, as they are now. It blocks its thread until all is read.
    pub fn check(&self) -> Result<CheckReport, StoreError> {
        self.db.run(|db| {
            let mut check = Check { store: self, report: CheckReport::default() };
            check.all(db)?;
            Ok(check.report)
        })
    }
}

/// A check that runs.
struct Check<'s> {
    store: &'s Store,
    report: CheckReport,
}

impl Check<'_> {
    fn fault(&mut self, record: String, problem: &str) {
        self.report.faults.push(FolderFault { record, problem: problem.into() });
    }

    fn all(&mut self, db: &Database) -> Result<(), StoreError> {
        let read = db.begin_read().map_err(failed)?;
        let mut named = self.heads(&read)?;
        let is_older = schema_of(db)? != Some(SCHEMA_VERSION);
        for kind in TABLES {
            match caught(|| Ok(read.open_table(kind.table()))) {
                Ok(Ok(table)) => self.rows(kind, &table, named.as_mut())?,
                Ok(Err(TableError::TableDoesNotExist(_))) if is_older => {}
                _ => self.fault(kind.name().into(), "the table cannot be opened"),
            }
        }
        for record in named.into_iter().flatten() {
            self.fault(record, "its row is missing");
        }
        if let Ok(results) = caught(|| read.open_table(OPERATION_RESULTS).map_err(failed)) {
            self.each(&results, "operation_results", |check, key, row| {
                if unsealed(key, row).is_none() {
                    check.fault(format!("operation_results/{key}"), "its checksum is wrong");
                }
            })?;
        }
        Ok(())
    }

    /// Reads all heads, and returns the records that they name; `None`: a folder of an older schema has no heads.
    fn heads(&mut self, read: &ReadTransaction) -> Result<Option<BTreeSet<String>>, StoreError> {
        let heads = match read.open_table(HEADS) {
            Err(TableError::TableDoesNotExist(_)) => return Ok(None),
            heads => heads.map_err(failed)?,
        };
        let mut named = BTreeSet::new();
        self.each(&heads, "heads", |check, record, row| {
            let is_whole = match record.starts_with("videos/") {
                true => RowHead::<VideoHead>::read(record, row).is_some_and(|head| head.shown.is_some()),
                false => {
                    let head: Option<PlainHead> = RowHead::read(record, row);
                    head.is_some()
                }
            };
            if !is_whole {
                check.fault(format!("heads/{record}"), "it cannot be read; lists use the row itself");
            }
            named.insert(record.to_string());
        })?;
        Ok(Some(named))
    }

    fn rows(
        &mut self,
        kind: TableKind,
        table: &ByteTable,
        mut named: Option<&mut BTreeSet<String>>,
    ) -> Result<(), StoreError> {
        self.each(table, kind.name(), |check, key, row| {
            let record = kind.head_key(key);
            if named.as_mut().is_some_and(|named| !named.remove(&record)) {
                check.fault(format!("heads/{record}"), "it is missing; lists leave the row out");
            }
            let is_whole = match kind {
                TableKind::Videos => readable::<Scene>(key, row).is_some(),
                _ => readable::<IgnoredAny>(key, row).is_some(),
            };
            match is_whole {
                false => check.fault(record, "it cannot be read"),
                true if kind == TableKind::Traces => check.file(record, key, row),
                true => {}
            }
        })
    }

    /// Reads the file of a trace.
    fn file(&mut self, record: String, key: &str, row: &[u8]) {
        self.report.trace_files += 1;
        let Some(trace) = readable::<CheckedTrace>(key, row) else {
            return self.fault(record, "its record cannot be read");
        };
        match digest(&self.store.traces, key) {
            Err(error) => self.fault(record, &format!("its file cannot be read: {error}")),
            Ok((bytes, _)) if bytes != trace.size_bytes => {
                self.fault(record, &format!("its file has {bytes} bytes of {}", trace.size_bytes));
            }
            Ok((_, id)) if id != trace.id => self.fault(record, "the checksum of its file is wrong"),
            Ok(_) => {}
        }
    }

    fn each(
        &mut self,
        table: &ByteTable,
        name: &str,
        mut one: impl FnMut(&mut Self, &str, &[u8]),
    ) -> Result<(), StoreError> {
        let mut found = |found: Found| {
            if self.store.db.must_yield() {
                return Err(broken("the check was given up because the disk failed"));
            }
            match found {
                Found::Row(key, row) => {
                    self.report.rows += 1;
                    one(self, key, row);
                }
                Found::Gap(_) => self.fault(name.into(), "a damaged page hides rows of it"),
            }
            Ok(ControlFlow::Continue(()))
        };
        scan(table, (Bound::Unbounded, Bound::Unbounded), &mut found)
    }
}

/// Bytes and digest of the file of a trace.
fn digest(traces: &Path, key: &str) -> std::io::Result<(u64, String)> {
    let mut hasher = blake3::Hasher::new();
    let bytes = std::io::copy(&mut open_file(traces, key)?, &mut hasher)?;
    Ok((bytes, hasher.finalize().to_hex().to_string()))
}
