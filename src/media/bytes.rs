//! Checked reading of big- and little-endian numbers.

use super::error::MediaError;

/// A cursor over bytes; each read is checked, and a failed one names the part of the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cursor<'a> {
    rest: &'a [u8],
    part: &'static str,
}

impl<'a> Cursor<'a> {
    pub fn new(bytes: &'a [u8], part: &'static str) -> Self {
        Cursor { rest: bytes, part }
    }

    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }

    pub fn take(&mut self, count: usize) -> Result<&'a [u8], MediaError> {
        let (taken, rest) =
            self.rest.split_at_checked(count).ok_or_else(|| MediaError::truncated(self.part))?;
        self.rest = rest;
        Ok(taken)
    }

    pub fn skip(&mut self, count: usize) -> Result<(), MediaError> {
        self.take(count).map(|_| ())
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], MediaError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    pub fn u8(&mut self) -> Result<u8, MediaError> {
        Ok(self.array::<1>()?[0])
    }

    pub fn u16(&mut self) -> Result<u16, MediaError> {
        Ok(u16::from_be_bytes(self.array()?))
    }

    pub fn u32(&mut self) -> Result<u32, MediaError> {
        Ok(u32::from_be_bytes(self.array()?))
    }

    pub fn i32(&mut self) -> Result<i32, MediaError> {
        Ok(i32::from_be_bytes(self.array()?))
    }

    pub fn u64(&mut self) -> Result<u64, MediaError> {
        Ok(u64::from_be_bytes(self.array()?))
    }

    pub fn i64(&mut self) -> Result<i64, MediaError> {
        Ok(i64::from_be_bytes(self.array()?))
    }

    pub fn u32_le(&mut self) -> Result<u32, MediaError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub fn four(&mut self) -> Result<[u8; 4], MediaError> {
        self.array()
    }
}

/// A four-character code as text.
pub(super) fn code(four: [u8; 4]) -> String {
    four.iter().map(|&b| if b.is_ascii_graphic() { char::from(b) } else { '.' }).collect()
}
