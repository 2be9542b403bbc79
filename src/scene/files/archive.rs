//! Files in a zip archive: projects of Tracker, workbooks, arrays of NumPy.

/// Largest file (bytes), unpacked.
const MAX_UNPACKED: usize = 64 << 20;

pub(super) fn is_archive(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}

/// A file in an archive: its name, whether it is compressed, and where its local header stands.
pub(super) struct ArchiveEntry<'a> {
    pub name: &'a [u8],
    is_compressed: bool,
    packed: usize,
    header: usize,
}

fn number(bytes: &[u8], at: usize, size: usize) -> Option<usize> {
    let part = bytes.get(at..at.checked_add(size)?)?;
    Some(part.iter().rev().fold(0, |sum, byte| sum << 8 | usize::from(*byte)))
}

/// The files that the directory of a zip archive lists.
pub(super) fn entries(bytes: &[u8]) -> Vec<ArchiveEntry<'_>> {
    let mut found = vec![];
    let end = bytes.windows(4).rposition(|w| w == b"PK\x05\x06");
    let mut at = end.and_then(|end| number(bytes, end + 16, 4));
    while let Some(start) = at.filter(|at| bytes.get(*at..).is_some_and(|b| b.starts_with(b"PK\x01\x02"))) {
        let entry = || {
            let [name, extra, comment] = [28, 30, 32].map(|offset| number(bytes, start + offset, 2));
            let (name, extra, comment) = (name?, extra?, comment?);
            let method = number(bytes, start + 10, 2)?;
            let entry = ArchiveEntry {
                name: bytes.get(start + 46..start + 46 + name)?,
                is_compressed: method == 8,
                packed: number(bytes, start + 20, 4)?,
                header: number(bytes, start + 42, 4)?,
            };
            Some((entry, start + 46 + name + extra + comment))
        };
        let Some((entry, next)) = entry() else { break };
        found.push(entry);
        at = Some(next);
    }
    found
}

impl ArchiveEntry<'_> {
    /// The content of the file; `None`: the archive is damaged, or the file too large.
    pub fn content(&self, archive: &[u8]) -> Option<Vec<u8>> {
        let [name, extra] = [26, 28].map(|offset| number(archive, self.header + offset, 2));
        let start = self.header.checked_add(30 + name? + extra?)?;
        let packed = archive.get(start..start.checked_add(self.packed)?)?;
        match self.is_compressed {
            true => miniz_oxide::inflate::decompress_to_vec_with_limit(packed, MAX_UNPACKED).ok(),
            false => Some(packed.to_vec()),
        }
    }
}

/// The content of the first file with this name.
pub(super) fn content(archive: &[u8], name: &str) -> Option<Vec<u8>> {
    entries(archive).iter().find(|entry| entry.name == name.as_bytes())?.content(archive)
}
