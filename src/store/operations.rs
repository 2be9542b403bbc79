//! Changes of operations: a record, and beside it the bytes of the request while it runs and of the result when it has ended, which
//! lists do not read.

use super::disk::database::begin;
use super::error::{StoreError, damaged, failed};
use super::folder::Store;
use super::schema::rows::{encode, sealed, unsealed};
use super::schema::tables::{OPERATION_RESULTS, TableKind};
use redb::{ReadableDatabase, ReadableTable};
use serde::Serialize;

impl Store {
    /// Stores how an operation ended, unless it was deleted meanwhile; durable when it returns.
    pub async fn end_operation<T: Serialize>(
        &self,
        id: &str,
        record: &T,
        result: Vec<u8>,
    ) -> Result<(), StoreError> {
        self.renew_operation(id, record, Some(result)).await
    }

    /// Stores the changed record, unless the operation was deleted meanwhile; durable when it returns.
    pub async fn change_operation<T: Serialize>(&self, id: &str, record: &T) -> Result<(), StoreError> {
        self.renew_operation(id, record, None).await
    }

    async fn renew_operation<T: Serialize>(
        &self,
        id: &str,
        record: &T,
        result: Option<Vec<u8>>,
    ) -> Result<(), StoreError> {
        let key = self.key(id);
        let result = result.map(|bytes| sealed(&key, bytes));
        let (record, reserve) = (encode(&key, record)?, self.reserve.clone());
        self.blocking(TableKind::Operations.head_key(&key), move |db| {
            reserve.admit()?;
            let write = begin(db)?;
            {
                let mut records = write.open_table(TableKind::Operations.table()).map_err(failed)?;
                if records.get(key.as_str()).map_err(failed)?.is_none() {
                    return Ok(());
                }
                records.insert(key.as_str(), record.as_slice()).map_err(failed)?;
                if let Some(result) = &result {
                    let mut results = write.open_table(OPERATION_RESULTS).map_err(failed)?;
                    results.insert(key.as_str(), result.as_slice()).map_err(failed)?;
                }
            }
            write.commit().map_err(failed)
        })
        .await
    }

    /// The bytes of an operation's request while it runs, and of its result when it has ended.
    pub async fn operation_result(&self, id: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let key = self.key(id);
        let record = TableKind::Operations.head_key(&key);
        self.blocking(record.clone(), move |db| {
            let read = db.begin_read().map_err(failed)?;
            let table = read.open_table(OPERATION_RESULTS).map_err(failed)?;
            let found = table.get(key.as_str()).map_err(failed)?;
            let bytes = |row: &[u8]| unsealed(&key, row).map(<[u8]>::to_vec).ok_or_else(|| damaged(&record));
            found.map(|row| bytes(row.value())).transpose()
        })
        .await
    }
}
