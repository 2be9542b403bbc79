//! Storage of which no page leads to one that is larger than the storage.
//!
//! redb makes room for a page before it reads it, and a page's number holds its size: one flipped bit asks for up to 4 GiB.
//! The page with such a number reads as zeros, which redb reports as damage. The numbers of the tables' first pages are in
//! pages of another form, and are not looked at.

use redb::{BackendError, StorageBackend};
use std::io;
use std::ops::Bound;

/// The first byte of a page that leads to others. The number of its keys (2 bytes) follows after one byte, and from byte 8 on,
/// for each child (one more than keys), a checksum of 16 bytes; then for each its number of 8 bytes.
const BRANCH: u8 = 2;
/// Bytes of the smallest page, as a power of two. The upper 5 bits of a number say how often a page is twice as large.
const PAGE_BITS: u64 = 12;
/// Pages up to this size are not looked at: 1 MiB can always be had.
const HARMLESS_BITS: u64 = 20;

#[derive(Debug)]
pub struct CheckedPages<B>(pub B);

impl<B: StorageBackend> CheckedPages<B> {
    fn leads_beyond(&self, page: &[u8]) -> io::Result<bool> {
        let [BRANCH, _, low, high, ..] = page else { return Ok(false) };
        let children = usize::from(u16::from_le_bytes([*low, *high])) + 1;
        // The page itself is damaged where they do not fit into it.
        let Some(numbers) = page.get(8 + 16 * children..8 + 24 * children) else { return Ok(true) };
        let numbers = numbers.as_chunks().0.iter().map(|number| u64::from_le_bytes(*number));
        let large = numbers.filter(|number| PAGE_BITS + (number >> 59) > HARMLESS_BITS);
        match large.map(end).max() {
            Some(end) => Ok(end > self.0.len()?),
            None => Ok(false),
        }
    }
}

/// Where the page with this number ends, at least: the region of 4 GiB is in bits 20 to 39, the place in it in the lower 20
/// bits, of which larger pages have fewer.
fn end(number: u64) -> u64 {
    let (order, region) = (number >> 59, (number >> 20) & 0xf_ffff);
    let index = number & (0xf_ffff >> order);
    (region << 32) + ((index + 1) << (order + PAGE_BITS))
}

impl<B: StorageBackend> StorageBackend for CheckedPages<B> {
    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        self.0.read(offset, out)?;
        if self.leads_beyond(out)? {
            out.fill(0);
        }
        Ok(())
    }

    fn len(&self) -> io::Result<u64> {
        self.0.len()
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        self.0.set_len(len)
    }

    fn sync_data(&self) -> io::Result<()> {
        self.0.sync_data()
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        self.0.write(offset, data)
    }

    fn close(&self) -> io::Result<()> {
        self.0.close()
    }

    fn try_lock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<bool, BackendError> {
        self.0.try_lock_range(start, end)
    }

    fn try_lock_shared_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<bool, BackendError> {
        self.0.try_lock_shared_range(start, end)
    }

    fn lock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<(), BackendError> {
        self.0.lock_range(start, end)
    }

    fn lock_shared_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<(), BackendError> {
        self.0.lock_shared_range(start, end)
    }

    fn unlock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<(), BackendError> {
        self.0.unlock_range(start, end)
    }

    fn query_lock_range(&self, start: Bound<u64>, end: Bound<u64>) -> Result<bool, BackendError> {
        self.0.query_lock_range(start, end)
    }
}
