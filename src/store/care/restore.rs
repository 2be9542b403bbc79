//! A data folder made of a backup.
//!
//! The database gets its name at the end. A folder whose restoring was interrupted has traces and no database, which
//! every start refuses.

use super::archive::{ArchiveReader, EntryHead, EntryKind};
use crate::store::blobs::{file_name, key_of_file};
use crate::store::disk::backend::DataFile;
use crate::store::disk::database::{begin, database};
use crate::store::error::{StoreError, failed, io_failed};
use crate::store::folder::{DATABASE_FILE, TRACES_FOLDER};
use crate::store::schema::migrations::{FIRST_WITH_HEADS, SCHEMA_VERSION, schema_of};
use crate::store::schema::tables::{HEADS, META, TIMES, row_tables};
use redb::{Database, TableHandle};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Bytes of rows in one transaction.
const BATCH: u64 = 16 << 20;

/// What was restored.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RestoreReport {
    pub rows: u64,
    pub trace_files: u64,
}

/// A row that waits for the next transaction.
struct Waiting {
    head: EntryHead,
    content: Vec<u8>,
}

/// Makes the folder, which must be empty or absent, of a backup. What cannot be finished is removed again.
pub fn restore(from: impl Read, folder: &Path) -> Result<RestoreReport, StoreError> {
    let unusable = |cause: String| StoreError::Unusable { path: folder.display().to_string(), cause };
    std::fs::create_dir_all(folder).map_err(|e| unusable(e.to_string()))?;
    if std::fs::read_dir(folder).map_err(|e| unusable(e.to_string()))?.next().is_some() {
        return Err(unusable("it is not empty, and a backup is restored into an empty folder".into()));
    }
    let done = restored(from, folder);
    if done.is_err() {
        let _ = std::fs::remove_dir_all(folder.join(TRACES_FOLDER));
        let _ = std::fs::remove_file(folder.join(unfinished()));
    }
    done
}

fn unfinished() -> String {
    format!("{DATABASE_FILE}.restoring")
}

fn restored(from: impl Read, folder: &Path) -> Result<RestoreReport, StoreError> {
    let mut archive = ArchiveReader::new(from)?;
    let traces = folder.join(TRACES_FOLDER);
    std::fs::create_dir(&traces).map_err(|e| io_failed(&e))?;
    let file = folder.join(unfinished());
    let db = DataFile::open(&file).and_then(database).map_err(failed)?;
    let (mut report, mut batch, mut bytes) = (RestoreReport::default(), vec![], 0);
    while let Some(head) = archive.head()? {
        match head.kind {
            EntryKind::File => {
                let name = file_name(&head.name);
                // A name leads nowhere else.
                if name.contains(['/', '\\']) || key_of_file(&name).as_ref() != Some(&head.name) {
                    let cause = format!("{:?} is no trace", head.name);
                    return Err(StoreError::Unusable { path: "of the backup".into(), cause });
                }
                let mut file = File::create_new(traces.join(name)).map_err(|e| io_failed(&e))?;
                archive.content(&head, &mut file)?;
                file.sync_all().map_err(|e| io_failed(&e))?;
                report.trace_files += 1;
            }
            _ => {
                let mut content = vec![];
                archive.content(&head, &mut content)?;
                bytes += head.len;
                batch.push(Waiting { head, content });
                report.rows += 1;
            }
        }
        if bytes > BATCH {
            store(&db, std::mem::take(&mut batch))?;
            bytes = 0;
        }
    }
    store(&db, batch)?;
    create_tables(&db)?;
    drop(db);
    std::fs::rename(&file, folder.join(DATABASE_FILE)).map_err(|e| io_failed(&e))?;
    for written in [&traces, folder] {
        File::open(written).and_then(|folder| folder.sync_all()).map_err(|e| io_failed(&e))?;
    }
    Ok(report)
}

/// Creates the tables of which the backup has no row.
fn create_tables(db: &Database) -> Result<(), StoreError> {
    let schema = schema_of(db)?;
    let write = begin(db)?;
    // Older schemas have no heads; their migration makes them.
    let has_heads = schema.is_some_and(|schema| schema >= FIRST_WITH_HEADS);
    for table in row_tables().filter(|table| has_heads || table.name() != HEADS.name()) {
        write.open_table(table).map_err(failed)?;
    }
    write.commit().map_err(failed)
}

fn store(db: &Database, batch: Vec<Waiting>) -> Result<(), StoreError> {
    let wrong = |cause: String| StoreError::Unusable { path: "of the backup".into(), cause };
    let write = begin(db)?;
    for Waiting { head, content } in batch {
        let unknown = || wrong(format!("{:?} is a row that this program does not know", head.name));
        let (table, key) = head.name.split_once('/').ok_or_else(unknown)?;
        if head.kind == EntryKind::Row {
            let table = row_tables().find(|known| known.name() == table).ok_or_else(unknown)?;
            write.open_table(table).map_err(failed)?.insert(key, content.as_slice()).map_err(failed)?;
            continue;
        }
        let known = [META, TIMES].into_iter().find(|known| known.name() == table).ok_or_else(unknown)?;
        let number = u64::from_le_bytes(content.try_into().map_err(|_| unknown())?);
        if table == META.name() && key == "schema" && number > SCHEMA_VERSION {
            return Err(StoreError::Newer {
                path: "of the backup".into(),
                found: number,
                known: SCHEMA_VERSION,
            });
        }
        write.open_table(known).map_err(failed)?.insert(key, number).map_err(failed)?;
    }
    write.commit().map_err(failed)
}
