//! A copy of the folder while it is used. It is of one moment, and no writer waits for it.

use super::archive::{ArchiveError, ArchiveWriter, EntryKind};
use crate::store::blobs::open_file;
use crate::store::error::{StoreError, broken, failed};
use crate::store::folder::Store;
use crate::store::scan::{Found, scan};
use crate::store::schema::tables::{HEADS, META, OPERATION_RESULTS, RowTable, TABLES, TIMES, TableKind};
use crate::store::write::is_recorded;
use redb::{Database, ReadTransaction, ReadableDatabase, ReadableTable, TableError, TableHandle};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::io::{self, ErrorKind, Write};
use std::ops::{Bound, ControlFlow};

/// What a backup has.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct BackupReport {
    pub rows: u64,
    pub trace_files: u64,
    /// Bytes of rows and files.
    pub bytes: u64,
    /// What could not be read: keys of records, or tables of which a part is hidden.
    pub unreadable: Vec<String>,
}

impl Store {
    /// Writes all rows and trace files of all tenants, as they are now. It blocks its thread until all is written.
    pub fn backup(&self, to: impl Write) -> Result<BackupReport, StoreError> {
        let mut copy = BackupCopy {
            store: self,
            to: ArchiveWriter::new(to).map_err(|e| unwritten(&e))?,
            report: BackupReport::default(),
            left_out: BTreeSet::new(),
        };
        self.db.run(|db| copy.all(db))?;
        copy.to.finish().map_err(|e| unwritten(&e))?;
        Ok(copy.report)
    }
}

/// The error of a backup that cannot be written; it is not one of the folder's disk.
fn unwritten(error: &io::Error) -> StoreError {
    StoreError::Unusable { path: "of the backup".into(), cause: error.to_string() }
}

/// A backup that is being written.
struct BackupCopy<'s, W> {
    store: &'s Store,
    to: ArchiveWriter<W>,
    report: BackupReport,
    /// Keys of the heads of traces that were deleted since it started.
    left_out: BTreeSet<String>,
}

impl<W: Write> BackupCopy<'_, W> {
    fn all(&mut self, db: &Database) -> Result<(), StoreError> {
        // One transaction: all tables are of one moment.
        let read = db.begin_read().map_err(failed)?;
        self.numbers(&read)?;
        for kind in TABLES {
            self.rows(db, &read, kind.table(), Some(kind))?;
        }
        for table in [OPERATION_RESULTS, HEADS] {
            self.rows(db, &read, table, None)?;
        }
        Ok(())
    }

    fn numbers(&mut self, read: &ReadTransaction) -> Result<(), StoreError> {
        for definition in [META, TIMES] {
            let table = match read.open_table(definition) {
                Err(TableError::TableDoesNotExist(_)) => continue,
                table => table.map_err(failed)?,
            };
            for row in table.iter().map_err(failed)? {
                let (key, value) = row.map_err(failed)?;
                let name = format!("{}/{}", definition.name(), key.value());
                let number = value.value().to_le_bytes();
                self.to.entry(EntryKind::Number, &name, &number).map_err(|e| unwritten(&e))?;
                self.report.rows += 1;
            }
        }
        Ok(())
    }

    fn rows(
        &mut self,
        db: &Database,
        read: &ReadTransaction,
        definition: RowTable,
        kind: Option<TableKind>,
    ) -> Result<(), StoreError> {
        let table = match read.open_table(definition) {
            Err(TableError::TableDoesNotExist(_)) => return Ok(()),
            table => table.map_err(failed)?,
        };
        let mut one = |found: Found| {
            if self.store.db.must_yield() {
                return Err(broken("the backup was given up because the disk failed"));
            }
            match found {
                Found::Row(key, row) => self.row(db, definition.name(), (key, row), kind)?,
                Found::Gap(_) => self.report.unreadable.push(format!("a part of {}", definition.name())),
            }
            Ok(ControlFlow::Continue(()))
        };
        scan(&table, (Bound::Unbounded, Bound::Unbounded), &mut one)
    }

    fn row(
        &mut self,
        db: &Database,
        table: &str,
        (key, row): (&str, &[u8]),
        kind: Option<TableKind>,
    ) -> Result<(), StoreError> {
        if let Some(kind @ TableKind::Traces) = kind
            && !self.file(db, key)?
        {
            self.left_out.insert(kind.head_key(key));
            return Ok(());
        }
        if table == HEADS.name() && self.left_out.contains(key) {
            return Ok(());
        }
        let name = format!("{table}/{key}");
        self.to.entry(EntryKind::Row, &name, row).map_err(|e| unwritten(&e))?;
        self.report.rows += 1;
        self.report.bytes += row.len() as u64;
        Ok(())
    }

    /// Writes the file of a trace; `false`: the trace was deleted since the backup started, and is left out.
    fn file(&mut self, db: &Database, key: &str) -> Result<bool, StoreError> {
        let file = open_file(&self.store.traces, key).and_then(|file| Ok((file.metadata()?.len(), file)));
        match file {
            Ok((len, file)) => {
                self.to.entry_from(EntryKind::File, key, len, file).map_err(|e| unwritten(&e))?;
                self.report.trace_files += 1;
                self.report.bytes += len;
                Ok(true)
            }
            Err(error) if error.kind() == ErrorKind::NotFound && !is_recorded(db, key)? => Ok(false),
            Err(_) => {
                self.report.unreadable.push(format!("the file of traces/{key}"));
                Ok(true)
            }
        }
    }
}

impl From<ArchiveError> for StoreError {
    fn from(error: ArchiveError) -> StoreError {
        StoreError::Unusable { path: "of the backup".into(), cause: error.to_string() }
    }
}
