//! The file of a backup: entries with checksums, and at its end a digest of all of it.
//!
//! `VRDPBAK1`, then entries: a letter, the length of the name (4 bytes), the length of the content (8 bytes), the name, the
//! content, and the checksum of name and content (4 bytes); numbers are little endian. The last entry is `E`; its content is
//! the BLAKE3 digest of everything before it.

use std::io::{self, Read, Write};

const MAGIC: &[u8; 8] = b"VRDPBAK1";
/// Longest name: a table and a key.
const MAX_ENTRY_NAME: u32 = 4096;
/// Bytes of a file that are read at a time.
const CHUNK: usize = 256 << 10;

/// What an entry is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EntryKind {
    /// A row of bytes; its name is `{table}/{key}`.
    Row,
    /// A row of a number.
    Number,
    /// The file of a trace; its name is the trace's key.
    File,
    /// The end.
    End,
}

const LETTERS: [(EntryKind, u8); 4] =
    [(EntryKind::Row, b'R'), (EntryKind::Number, b'N'), (EntryKind::File, b'F'), (EntryKind::End, b'E')];

#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    #[error("the file is no backup of vrdp; give one that `vrdp data backup` wrote")]
    NoBackup,
    #[error("the backup ends too early or is damaged at byte {at}; use another backup")]
    DamagedBackup { at: u64 },
    #[error("{0}")]
    Io(#[from] io::Error),
}

/// Writes entries one after the other.
pub struct ArchiveWriter<W> {
    to: W,
    hasher: blake3::Hasher,
}

impl<W: Write> ArchiveWriter<W> {
    pub fn new(to: W) -> io::Result<Self> {
        let mut writer = ArchiveWriter { to, hasher: blake3::Hasher::new() };
        writer.write(MAGIC)?;
        Ok(writer)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hasher.update(bytes);
        self.to.write_all(bytes)
    }

    /// Writes an entry.
    pub fn entry(&mut self, kind: EntryKind, name: &str, content: &[u8]) -> io::Result<()> {
        self.entry_from(kind, name, content.len() as u64, content)
    }

    /// Writes an entry whose content is read; a shorter content is an error.
    pub fn entry_from(
        &mut self,
        kind: EntryKind,
        name: &str,
        len: u64,
        mut content: impl Read,
    ) -> io::Result<()> {
        let letter = LETTERS.iter().find(|(k, _)| *k == kind).map_or(0, |(_, letter)| *letter);
        self.write(&[letter])?;
        self.write(&(name.len() as u32).to_le_bytes())?;
        self.write(&len.to_le_bytes())?;
        self.write(name.as_bytes())?;
        let mut sum = crc32fast::Hasher::new();
        sum.update(name.as_bytes());
        let mut chunk = vec![0; CHUNK.min(usize::try_from(len).unwrap_or(CHUNK))];
        let mut left = len;
        while left > 0 {
            let part = chunk.len().min(usize::try_from(left).unwrap_or(CHUNK));
            content.read_exact(&mut chunk[..part])?;
            sum.update(&chunk[..part]);
            self.write(&chunk[..part])?;
            left -= part as u64;
        }
        self.write(&sum.finalize().to_le_bytes())
    }

    /// Writes the end.
    pub fn finish(mut self) -> io::Result<()> {
        let digest = *self.hasher.finalize().as_bytes();
        self.entry(EntryKind::End, "", &digest)?;
        self.to.flush()
    }
}

/// Reads entries one after the other.
pub struct ArchiveReader<R> {
    from: R,
    hasher: blake3::Hasher,
    at: u64,
}

/// The start of an entry.
pub struct EntryHead {
    pub kind: EntryKind,
    pub name: String,
    pub len: u64,
}

impl<R: Read> ArchiveReader<R> {
    pub fn new(from: R) -> Result<Self, ArchiveError> {
        let mut reader = ArchiveReader { from, hasher: blake3::Hasher::new(), at: 0 };
        match reader.take::<8>() {
            Ok(found) if found == *MAGIC => Ok(reader),
            Ok(_) | Err(ArchiveError::DamagedBackup { .. }) => Err(ArchiveError::NoBackup),
            Err(error) => Err(error),
        }
    }

    fn damaged(&self) -> ArchiveError {
        ArchiveError::DamagedBackup { at: self.at }
    }

    fn read(&mut self, bytes: &mut [u8]) -> Result<(), ArchiveError> {
        match self.from.read_exact(bytes) {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Err(self.damaged()),
            Err(error) => return Err(error.into()),
        }
        self.at += bytes.len() as u64;
        self.hasher.update(bytes);
        Ok(())
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], ArchiveError> {
        let mut bytes = [0; N];
        self.read(&mut bytes)?;
        Ok(bytes)
    }

    /// The start of the next entry; `None` at the end, after a check of the whole file. The content must be read next.
    pub fn head(&mut self) -> Result<Option<EntryHead>, ArchiveError> {
        let digest = self.hasher.finalize();
        let letter = self.take::<1>()?[0];
        let Some((kind, _)) = LETTERS.into_iter().find(|(_, l)| *l == letter) else {
            return Err(self.damaged());
        };
        let name_len = u32::from_le_bytes(self.take()?);
        let len = u64::from_le_bytes(self.take()?);
        if name_len > MAX_ENTRY_NAME {
            return Err(self.damaged());
        }
        let mut name = vec![0; name_len as usize];
        self.read(&mut name)?;
        let name = String::from_utf8(name).map_err(|_| self.damaged())?;
        let head = EntryHead { kind, name, len };
        if kind != EntryKind::End {
            return Ok(Some(head));
        }
        let mut found = vec![];
        self.content(&head, &mut found)?;
        if found == digest.as_bytes() { Ok(None) } else { Err(self.damaged()) }
    }

    /// Copies the content of an entry; an error if its checksum is wrong.
    pub fn content(&mut self, head: &EntryHead, to: &mut impl Write) -> Result<(), ArchiveError> {
        let mut sum = crc32fast::Hasher::new();
        sum.update(head.name.as_bytes());
        let mut chunk = vec![0; CHUNK.min(usize::try_from(head.len).unwrap_or(CHUNK))];
        let mut left = head.len;
        while left > 0 {
            let part = chunk.len().min(usize::try_from(left).unwrap_or(CHUNK));
            self.read(&mut chunk[..part])?;
            sum.update(&chunk[..part]);
            to.write_all(&chunk[..part])?;
            left -= part as u64;
        }
        let found = u32::from_le_bytes(self.take()?);
        if found == sum.finalize() { Ok(()) } else { Err(self.damaged()) }
    }
}
