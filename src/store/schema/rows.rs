//! Rows as bytes: CBOR with a checksum of key and value.

use crate::store::error::{StoreError, broken, damaged};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The bytes of a value under this key.
pub fn encode<T: Serialize>(key: &str, value: &T) -> Result<Vec<u8>, StoreError> {
    let mut bytes = Vec::new();
    ciborium::into_writer(value, &mut bytes).map_err(broken)?;
    Ok(sealed(key, bytes))
}

/// Bytes with the checksum of the key and of them.
pub fn sealed(key: &str, mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.extend(checksum(key, &bytes).to_le_bytes());
    bytes
}

/// The bytes, if their checksum holds. Rows of schema 1 have a checksum of the value alone.
pub fn unsealed<'r>(key: &str, row: &'r [u8]) -> Option<&'r [u8]> {
    let (bytes, sum) = row.split_last_chunk()?;
    let sum = u32::from_le_bytes(*sum);
    (sum == checksum(key, bytes) || sum == crc32fast::hash(bytes)).then_some(bytes)
}

fn checksum(key: &str, bytes: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(key.as_bytes());
    hasher.update(bytes);
    hasher.finalize()
}

/// A value whose checksum holds; rows of the first programs have none. Errors name the row `record`.
pub fn decode<T: DeserializeOwned>(record: &str, key: &str, row: &[u8]) -> Result<T, StoreError> {
    readable(key, row).ok_or_else(|| damaged(record))
}

/// The same, where nobody waits for the reason.
pub fn readable<T: DeserializeOwned>(key: &str, row: &[u8]) -> Option<T> {
    value(unsealed(key, row).unwrap_or(row))
}

/// The value of a row without its checksum.
pub fn value<T: DeserializeOwned>(mut rest: &[u8]) -> Option<T> {
    let value = ciborium::from_reader(&mut rest).ok()?;
    rest.is_empty().then_some(value)
}
