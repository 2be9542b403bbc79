//! Rows of operations: a record, and beside it the bytes of the request while it runs and of the result when it has ended, which lists
//! do not read.

use super::{
    OPERATION_RESULTS, Store, StoreError, TableKind, begin, damaged, encode, failed, sealed, unsealed,
};
use redb::{ReadableDatabase, ReadableTable};
use serde::Serialize;

impl Store {
    /// Stores the record of a new operation with its request; durable when it returns.
    pub async fn put_operation<T: Serialize>(
        &self,
        id: &str,
        record: &T,
        request: Vec<u8>,
    ) -> Result<(), StoreError> {
        self.write_operation(id, record, Some(request), true).await
    }

    /// Stores the record anew, unless the operation was deleted meanwhile; durable when it returns.
    pub async fn change_operation<T: Serialize>(&self, id: &str, record: &T) -> Result<(), StoreError> {
        self.write_operation(id, record, None, false).await
    }

    /// Stores how an operation ended, unless it was deleted meanwhile; durable when it returns.
    pub async fn end_operation<T: Serialize>(
        &self,
        id: &str,
        record: &T,
        result: Vec<u8>,
    ) -> Result<(), StoreError> {
        self.write_operation(id, record, Some(result), false).await
    }

    async fn write_operation<T: Serialize>(
        &self,
        id: &str,
        record: &T,
        bytes: Option<Vec<u8>>,
        is_new: bool,
    ) -> Result<(), StoreError> {
        let (key, record, bytes) = (self.key(id), encode(record)?, bytes.map(sealed));
        self.blocking(move |db| {
            let write = begin(db)?;
            {
                let mut records = write.open_table(TableKind::Operations.table()).map_err(failed)?;
                if !is_new && records.get(key.as_str()).map_err(failed)?.is_none() {
                    return Ok(());
                }
                records.insert(key.as_str(), record.as_slice()).map_err(failed)?;
                if let Some(bytes) = &bytes {
                    let mut beside = write.open_table(OPERATION_RESULTS).map_err(failed)?;
                    beside.insert(key.as_str(), bytes.as_slice()).map_err(failed)?;
                }
            }
            write.commit().map_err(failed)
        })
        .await
    }

    /// The bytes of an operation's request while it runs, and of its result when it has ended.
    pub async fn operation_result(&self, id: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let key = self.key(id);
        self.blocking(move |db| {
            let read = db.begin_read().map_err(failed)?;
            let table = read.open_table(OPERATION_RESULTS).map_err(failed)?;
            let found = table.get(key.as_str()).map_err(failed)?;
            let bytes = |row: &[u8]| unsealed(row).map(<[u8]>::to_vec).ok_or_else(|| damaged(&key));
            found.map(|row| bytes(row.value())).transpose()
        })
        .await
    }

    /// Deletes operations with their results; those that do not exist are skipped.
    pub async fn delete_operations(&self, ids: &[String]) -> Result<(), StoreError> {
        let keys: Vec<String> = ids.iter().map(|id| self.key(id)).collect();
        self.blocking(move |db| {
            let write = begin(db)?;
            {
                let mut records = write.open_table(TableKind::Operations.table()).map_err(failed)?;
                let mut results = write.open_table(OPERATION_RESULTS).map_err(failed)?;
                for key in &keys {
                    records.remove(key.as_str()).map_err(failed)?;
                    results.remove(key.as_str()).map_err(failed)?;
                }
            }
            write.commit().map_err(failed)
        })
        .await
    }
}
