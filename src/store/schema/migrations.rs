//! Schemas: a new database gets the present one; an older one is brought to it step by step.
//!
//! Each step is one transaction that ends with the new number, so that a process killed at any time leaves the schema
//! before or after it, and the next start goes on from there.

use super::heads::head_of_row;
use super::tables::{HEADS, META, OPERATION_RESULTS, TABLES, TIMES, TableKind, row_tables};
use crate::store::disk::database::begin;
use crate::store::error::{StoreError, failed};
use redb::{Database, ReadableDatabase, ReadableTable, TableError, WriteTransaction};

type Migration = fn(&WriteTransaction) -> Result<(), StoreError>;

/// `MIGRATIONS[k]` makes schema `k + 2` of schema `k + 1`.
const MIGRATIONS: [Migration; 2] = [heads_of_all_rows, table_of_checkpoints];

/// Layout of the tables; a store with a newer one is refused.
pub const SCHEMA_VERSION: u64 = MIGRATIONS.len() as u64 + 1;

/// The first schema in which rows have heads.
pub const FIRST_WITH_HEADS: u64 = 2;

/// The schema version of a database; `None`: it is new.
pub fn schema_of(db: &impl ReadableDatabase) -> Result<Option<u64>, StoreError> {
    let read = db.begin_read().map_err(failed)?;
    match read.open_table(META) {
        Ok(table) => Ok(table.get("schema").map_err(failed)?.map(|v| v.value())),
        Err(TableError::TableDoesNotExist(_)) => Ok(None),
        Err(error) => Err(failed(error)),
    }
}

/// Creates what a new database lacks, or brings an older one to the present schema. A current one is not written to.
pub fn migrate(db: &Database) -> Result<(), StoreError> {
    let Some(mut schema) = schema_of(db)? else { return create(db) };
    while let Some(step) = MIGRATIONS.get(schema.saturating_sub(1) as usize) {
        tracing::info!(from = schema, to = schema + 1, "the data folder is brought to a newer schema");
        let write = begin(db)?;
        step(&write)?;
        schema += 1;
        write.open_table(META).map_err(failed)?.insert("schema", schema).map_err(failed)?;
        write.commit().map_err(failed)?;
    }
    Ok(())
}

fn create(db: &Database) -> Result<(), StoreError> {
    let write = begin(db)?;
    write.open_table(META).map_err(failed)?.insert("schema", SCHEMA_VERSION).map_err(failed)?;
    for table in row_tables() {
        write.open_table(table).map_err(failed)?;
    }
    write.commit().map_err(failed)
}

/// Schema 2: each row has a head; the times of rows stand there.
fn heads_of_all_rows(write: &WriteTransaction) -> Result<(), StoreError> {
    {
        let mut heads = write.open_table(HEADS).map_err(failed)?;
        let times = write.open_table(TIMES).map_err(failed)?;
        write.open_table(OPERATION_RESULTS).map_err(failed)?;
        for kind in TABLES {
            let table = write.open_table(kind.table()).map_err(failed)?;
            for row in table.iter().map_err(failed)? {
                let (key, value) = row.map_err(failed)?;
                let head_key = kind.head_key(key.value());
                let created_ms = times.get(head_key.as_str()).map_err(failed)?.map(|ms| ms.value());
                let head = head_of_row(kind, key.value(), value.value(), created_ms);
                heads.insert(head_key.as_str(), head.as_slice()).map_err(failed)?;
            }
        }
    }
    write.delete_table(TIMES).map_err(failed)?;
    Ok(())
}

/// Schema 3: the steps of running discoveries have a table.
fn table_of_checkpoints(write: &WriteTransaction) -> Result<(), StoreError> {
    write.open_table(TableKind::Checkpoints.table()).map_err(failed)?;
    Ok(())
}
