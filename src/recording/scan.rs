//! Walks a trace file record by record without trusting it: whole records are returned, damage is reported.
//!
//! Rules: no length is followed beyond [`MAX_RECORD`] or the end of the file, and no chunk is unpacked before its checksum
//! holds. Reading, checking and unpacking a file have a budget in proportion to its size ([`WORK_FACTOR`]), so that no file costs
//! more than a trace of its size can. After damage the scan continues at the next byte where a record certainly starts: a chunk or attachment whose
//! checksum holds, or the end of the data.

use super::RecordingError;
use super::messages::{self as m, v1};
use crc32fast::Hasher;
use mcap::records::{Channel, ChunkHeader, MessageHeader, Record, Statistics, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use prost::Message as _;
use ruzstd::decoding::FrameDecoder;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};

/// Longest record or decompressed chunk (bytes): a damaged length must not take all memory.
pub const MAX_RECORD: u64 = 64 << 20;
/// Largest window of a zstd frame (bytes): what `zstd --ultra -22` uses.
const MAX_WINDOW: u64 = 128 << 20;
/// Bytes that may be read, checked or unpacked for each byte of a file, and beside it: our traces need 10 or fewer.
const WORK_FACTOR: u64 = 16;
const WORK_BASE: u64 = 256 << 20;
/// What one record costs beside its bytes, in bytes that are read.
const RECORD_COST: u64 = 64;
/// Bytes that are read at a time.
const BLOCK: usize = 256 << 10;
/// Bytes before a record's body: opcode and length.
const HEAD: u64 = 9;
/// Bytes of a footer's body, and those of it that its checksum covers.
const FOOTER: u64 = 20;
const FOOTER_CHECKED: u64 = 16;

/// A file of any size, of which one block is in memory at a time.
pub struct FileWindow<R> {
    source: R,
    pub size: u64,
    start: u64,
    bytes: Vec<u8>,
    /// Bytes that were read, checked or unpacked, and the most that may be.
    work: u64,
    most_work: u64,
}

impl<R: Read + Seek> FileWindow<R> {
    pub fn new(mut source: R) -> Result<Self, RecordingError> {
        let size = source.seek(SeekFrom::End(0))?;
        let most_work = WORK_FACTOR.saturating_mul(size).saturating_add(WORK_BASE);
        Ok(FileWindow { source, size, start: 0, bytes: Vec::new(), work: 0, most_work })
    }

    /// From here on as much work is allowed as that many passes over the whole file need; `None`: any number.
    pub fn allow_passes(&mut self, passes: Option<u64>) {
        let one = WORK_FACTOR.saturating_mul(self.size).saturating_add(WORK_BASE);
        self.work = 0;
        self.most_work = passes.map_or(u64::MAX, |passes| one.saturating_mul(passes));
    }

    /// Counts work before it is done.
    fn work(&mut self, bytes: u64) -> Result<(), RecordingError> {
        self.work = self.work.saturating_add(bytes);
        match self.work > self.most_work {
            true => Err(RecordingError::TooMuchWork { size: self.size, most: self.most_work }),
            false => Ok(()),
        }
    }

    /// The bytes `at..at + len`, less where the file ends.
    pub fn get(&mut self, at: u64, len: usize) -> Result<&[u8], RecordingError> {
        let left = usize::try_from(self.size.saturating_sub(at)).unwrap_or(usize::MAX);
        let len = len.min(left);
        if at < self.start || at + len as u64 > self.start + self.bytes.len() as u64 {
            let wanted = len.max(BLOCK).min(left);
            self.work(wanted as u64)?;
            self.bytes.resize(wanted, 0);
            self.start = at;
            self.source.seek(SeekFrom::Start(at))?;
            self.source.read_exact(&mut self.bytes)?;
        }
        let from = (at - self.start) as usize;
        Ok(self.bytes.get(from..from + len).unwrap_or_default())
    }

    fn is_magic(&mut self, at: u64) -> Result<bool, RecordingError> {
        Ok(self.get(at, mcap::MAGIC.len())? == mcap::MAGIC)
    }

    fn checksum(&mut self, from: u64, to: u64) -> Result<u32, RecordingError> {
        let mut hasher = Hasher::new();
        self.hash(&mut hasher, from, to)?;
        Ok(hasher.finalize())
    }

    fn hash(&mut self, hasher: &mut Hasher, from: u64, to: u64) -> Result<(), RecordingError> {
        self.work(to.saturating_sub(from))?;
        let mut at = from;
        while at < to {
            let block = self.get(at, BLOCK.min((to - at) as usize))?;
            if block.is_empty() {
                break;
            }
            hasher.update(block);
            at += block.len() as u64;
        }
        Ok(())
    }

    /// Length of the record at `at`, or the reason why there is none.
    fn length(&mut self, at: u64) -> Result<Result<u64, &'static str>, RecordingError> {
        let left = self.size.saturating_sub(at + HEAD);
        let Ok(&[opcode, ref length @ ..]) = <&[u8; HEAD as usize]>::try_from(self.get(at, HEAD as usize)?)
        else {
            return Ok(Err("the file ends within a record"));
        };
        let length = u64::from_le_bytes(*length);
        Ok(match (op::HEADER..=op::DATA_END).contains(&opcode) {
            false => Err("no record is here"),
            true if length > left => Err("the file ends within a record, or its length is wrong"),
            true if length > MAX_RECORD => Err("the record is too large"),
            true => Ok(length),
        })
    }

    /// The record at `at` (a chunk with all its messages) and the offset of the next one, or the reason why there is none.
    /// Checksums of chunks and attachments were checked.
    pub fn record(&mut self, at: u64) -> Result<Result<(WholeRecord, u64), String>, RecordingError> {
        let length = match self.length(at)? {
            Ok(length) => length,
            Err(why) => return Ok(Err(why.into())),
        };
        let bytes = self.get(at, (HEAD + length) as usize)?;
        let unpacked = unpacked_size(bytes);
        self.work(HEAD + length + RECORD_COST + unpacked)?;
        let bytes = self.get(at, (HEAD + length) as usize)?;
        let (opcode, body) = match bytes.split_at_checked(HEAD as usize) {
            Some((head, body)) => (head.first().copied().unwrap_or_default(), body),
            None => return Ok(Err("the file ends within a record".into())),
        };
        Ok(whole(opcode, body).map(|whole| (whole, at + HEAD + length)))
    }

    /// The first offset from `at` on where a record certainly starts, or the end of the file.
    fn next_certain(&mut self, mut at: u64) -> Result<u64, RecordingError> {
        while at + HEAD <= self.size {
            let first = self.get(at, 1)?.first().copied().unwrap_or_default();
            if matches!(first, op::CHUNK | op::ATTACHMENT | op::DATA_END | op::FOOTER)
                && let Ok(length) = self.length(at)?
            {
                let last = at + HEAD + length + mcap::MAGIC.len() as u64 == self.size;
                let is_certain = match first {
                    op::DATA_END => length == 4,
                    op::FOOTER => length == FOOTER && last,
                    _ => self.record(at)?.is_ok(),
                };
                if is_certain {
                    return Ok(at);
                }
            }
            at += 1;
        }
        Ok(self.size)
    }
}

/// Bytes that a chunk says to unpack to; those of another record are its own.
fn unpacked_size(record: &[u8]) -> u64 {
    let size = || {
        let body = record.strip_prefix(&[op::CHUNK])?.get(HEAD as usize - 1..)?;
        Some(u64::from_le_bytes(body.get(16..24)?.try_into().ok()?))
    };
    // More is refused without unpacking.
    size().filter(|size| *size <= MAX_RECORD).unwrap_or(0)
}

/// A record whose checksum holds, if its kind has one.
pub enum WholeRecord {
    Chunk(Vec<Record<'static>>),
    Other(Record<'static>),
}

fn whole(opcode: u8, body: &[u8]) -> Result<WholeRecord, String> {
    if opcode == op::ATTACHMENT && !attachment_fits(body) {
        return Err("an attachment is shorter than its stated length".into());
    }
    let text = |e: mcap::McapError| e.to_string();
    let Record::Chunk { header, data } = mcap::parse_record(opcode, body).map_err(text)? else {
        return Ok(WholeRecord::Other(mcap::parse_record(opcode, body).map_err(text)?.into_owned()));
    };
    let span = format!("{} to {} s", seconds(header.message_start_time), seconds(header.message_end_time));
    if header.uncompressed_size > MAX_RECORD {
        return Err(format!("a chunk ({span}) is too large"));
    }
    let body = match header.compression.as_str() {
        "zstd" => match stored(&header, data.as_ref()) {
            Some(body) => Cow::Owned(body),
            None => return Err(format!("a chunk ({span}) is damaged: it is no valid zstd")),
        },
        "" | "lz4" => Cow::Borrowed(body),
        other => {
            let cure = "rewrite the file: mcap compress --compression lz4 IN -o OUT";
            return Err(format!("a chunk ({span}) is compressed with {other:?}, which is not known; {cure}"));
        }
    };
    unpacked(opcode, &body).map(WholeRecord::Chunk).map_err(|e| format!("a chunk ({span}) is damaged: {e}"))
}

/// The body of a zstd chunk as that of one without compression; `None` if its data are no zstd of the stated size.
fn stored(header: &ChunkHeader, data: &[u8]) -> Option<Vec<u8>> {
    let size = header.uncompressed_size;
    let mut records = vec![0; usize::try_from(size).ok()?];
    let mut decoder = FrameDecoder::new();
    decoder.set_max_window_size(MAX_WINDOW);
    let written = decoder.decode_all(data, &mut records).ok()?;
    let numbers = [header.message_start_time, header.message_end_time, size].map(u64::to_le_bytes).concat();
    let crc = header.uncompressed_crc.to_le_bytes();
    // The name of no compression has the length 0.
    let body = [&numbers[..], &crc, &0u32.to_le_bytes(), &size.to_le_bytes(), &records];
    (written as u64 == size).then(|| body.concat())
}

/// The records of a chunk, after its checksum was checked.
fn unpacked(opcode: u8, body: &[u8]) -> mcap::McapResult<Vec<Record<'static>>> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MAX_RECORD as usize);
    let mut reader = LinearReader::new_with_options(options);
    let head = [&[opcode][..], &(body.len() as u64).to_le_bytes()].concat();
    let (mut records, mut parts) = (vec![], [head.as_slice(), body]);
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                let Some(part) = parts.iter_mut().find(|part| !part.is_empty()) else {
                    reader.notify_read(0);
                    continue;
                };
                let (now, later) = part.split_at(wanted.min(part.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                *part = later;
            }
            LinearReadEvent::Record { opcode, data } => {
                records.push(mcap::parse_record(opcode, data)?.into_owned());
            }
        }
    }
    Ok(records)
}

/// Whether the parts of an attachment lie within it; the parser would read its checksum beyond it.
fn attachment_fits(body: &[u8]) -> bool {
    let number = |at: usize| body.get(at..at.checked_add(4)?)?.try_into().ok().map(u32::from_le_bytes);
    let ends = || {
        let media = 20usize.checked_add(number(16)? as usize)?;
        let data = media.checked_add(4)?.checked_add(number(media)? as usize)?;
        let length = u64::from_le_bytes(body.get(data..data.checked_add(8)?)?.try_into().ok()?);
        data.checked_add(12)?.checked_add(usize::try_from(length).ok()?)
    };
    ends().is_some_and(|end| end <= body.len())
}

pub fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 / 1e9
}

/// The summary at the end of a file: its index.
#[derive(Debug, Default)]
pub struct Summary {
    pub channels: BTreeMap<u16, Channel>,
    pub schemas: BTreeMap<u16, String>,
    /// By time.
    pub chunks: Vec<mcap::records::ChunkIndex>,
    pub attachments: Vec<mcap::records::AttachmentIndex>,
    pub metadata: Vec<mcap::records::MetadataIndex>,
    pub statistics: Option<Statistics>,
}

impl Summary {
    /// The summary of a file, after its checksum was checked, or the reason why there is none.
    pub fn read<R: Read + Seek>(file: &mut FileWindow<R>) -> Result<Result<Summary, String>, RecordingError> {
        let magic = mcap::MAGIC.len() as u64;
        let Some(footer_at) = file.size.checked_sub(HEAD + FOOTER + magic).filter(|at| *at >= magic) else {
            return Ok(Err("the file is too short".into()));
        };
        if !file.is_magic(file.size - magic)? {
            return Ok(Err("the file does not end as a trace does".into()));
        }
        let footer = match file.record(footer_at)? {
            Ok((WholeRecord::Other(Record::Footer(footer)), _)) => footer,
            _ => return Ok(Err("the footer is damaged".into())),
        };
        let start = footer.summary_start;
        if !(magic..=footer_at).contains(&start) {
            return Ok(Err("the footer is damaged".into()));
        }
        if file.checksum(start, footer_at + HEAD + FOOTER_CHECKED)? != footer.summary_crc {
            return Ok(Err("the summary's checksum is wrong".into()));
        }
        let (mut summary, mut at) = (Summary::default(), start);
        while at < footer_at {
            let (record, next) = match file.record(at)? {
                Ok(found) => found,
                Err(why) => return Ok(Err(why)),
            };
            summary.take(record);
            at = next;
        }
        summary.chunks.sort_by_key(|c| (c.message_start_time, c.chunk_start_offset));
        Ok(Ok(summary))
    }

    fn take(&mut self, record: WholeRecord) {
        let WholeRecord::Other(record) = record else { return };
        match record {
            Record::Channel(channel) => {
                self.channels.insert(channel.id, channel);
            }
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::ChunkIndex(index) => self.chunks.push(index),
            Record::AttachmentIndex(index) => self.attachments.push(index),
            Record::MetadataIndex(index) => self.metadata.push(index),
            Record::Statistics(statistics) => self.statistics = Some(statistics),
            _ => {}
        }
    }
}

/// A range of a file that is damaged.
#[derive(Debug, Clone, PartialEq)]
pub struct Damage {
    /// Bytes `from..to`.
    pub from: u64,
    pub to: u64,
    pub what: String,
}

/// Which parts of a file are whole.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ScanReport {
    /// Of the file.
    pub bytes: u64,
    /// Chunks that are whole.
    pub chunks: usize,
    /// Messages in them, by topic.
    pub counts: BTreeMap<String, u64>,
    /// Messages as the summary states them, where it is whole.
    pub stated: Option<BTreeMap<String, u64>>,
    /// In the order of the file.
    pub damage: Vec<Damage>,
}

/// One part of a file; a scan returns them in their order.
pub enum ScannedItem<'a> {
    Message { topic: &'a str, header: &'a MessageHeader, data: &'a [u8] },
    Metadata(BTreeMap<String, String>),
    Attachment { name: String, data: Vec<u8> },
}

/// Walks a whole file and passes every whole part to `take`, also after damage.
pub fn scan<R: Read + Seek>(
    source: R,
    take: &mut dyn FnMut(ScannedItem),
) -> Result<ScanReport, RecordingError> {
    scan_window(&mut FileWindow::new(source)?, take)
}

fn scan_window<R: Read + Seek>(
    file: &mut FileWindow<R>,
    take: &mut dyn FnMut(ScannedItem),
) -> Result<ScanReport, RecordingError> {
    let mut report = ScanReport { bytes: file.size, ..ScanReport::default() };
    let summary = Summary::read(file)?;
    let known = summary.as_ref().ok();
    let mut topics = report.topics(known);
    let mut data = DataChecksum::default();
    let mut at = mcap::MAGIC.len() as u64;
    if !file.is_magic(0)? {
        let certain = file.next_certain(0)?;
        if certain == file.size {
            return Err(RecordingError::NoTrace);
        }
        report.damaged(0, at, "the file does not start as a trace does");
    }
    let mut ended = false;
    // Offset of the last record whose length no checksum covers: if its length is wrong, the next record is elsewhere.
    let mut unchecked = None;
    while at < file.size && !ended {
        let (record, next) = match file.record(at)? {
            Ok(found) => found,
            Err(what) => {
                let from = unchecked.take().unwrap_or(at);
                let certain = file.next_certain(from + 1)?;
                report.damaged(at.min(certain), at.max(certain), what);
                at = certain;
                continue;
            }
        };
        unchecked = match &record {
            WholeRecord::Chunk(_) | WholeRecord::Other(Record::Attachment { .. }) => None,
            WholeRecord::Other(_) => Some(at),
        };
        match record {
            WholeRecord::Chunk(records) => {
                report.chunks += 1;
                records.into_iter().for_each(|record| report.pass(record, &mut topics, take));
            }
            WholeRecord::Other(Record::DataEnd(end)) => {
                // 0: the file has no such checksum.
                if end.data_section_crc != 0 && data.until(file, at)? != end.data_section_crc {
                    report.damaged(0, at, "the checksum of all data is wrong");
                }
            }
            WholeRecord::Other(Record::Footer(_)) => {
                ended = true;
                if next + mcap::MAGIC.len() as u64 != file.size || !file.is_magic(next)? {
                    report.damaged(next, file.size, "the file does not end as a trace does");
                }
            }
            WholeRecord::Other(record) => report.pass(record, &mut topics, take),
        }
        at = next;
    }
    topics.into_values().for_each(|topic| report.count(topic));
    if !ended {
        report.damaged(file.size, file.size, "the end of the file is missing");
    }
    if let Err(what) = summary {
        report.damaged(at.min(file.size), file.size, what);
    }
    Ok(report)
}

/// The messages of a channel so far. They are counted by channel, as comparing long topics for every message takes time.
struct CountedTopic {
    topic: String,
    messages: u64,
}

impl CountedTopic {
    fn new(topic: &str) -> CountedTopic {
        CountedTopic { topic: topic.to_string(), messages: 0 }
    }
}

/// The checksum of all bytes up to a place, from one place to the next.
#[derive(Default)]
struct DataChecksum {
    hasher: Hasher,
    until: u64,
}

impl DataChecksum {
    fn until<R: Read + Seek>(&mut self, file: &mut FileWindow<R>, at: u64) -> Result<u32, RecordingError> {
        if at < self.until {
            *self = DataChecksum::default();
        }
        file.hash(&mut self.hasher, self.until, at)?;
        self.until = at;
        Ok(self.hasher.clone().finalize())
    }
}

impl ScanReport {
    pub fn is_whole(&self) -> bool {
        self.damage.is_empty()
    }

    fn damaged(&mut self, from: u64, to: u64, what: impl Into<String>) {
        self.damage.push(Damage { from, to, what: what.into() });
    }

    /// The topics of a summary; the numbers of messages that it states are kept.
    fn topics(&mut self, known: Option<&Summary>) -> BTreeMap<u16, CountedTopic> {
        let mut topics: BTreeMap<u16, CountedTopic> = BTreeMap::new();
        for (id, channel) in known.into_iter().flat_map(|s| &s.channels) {
            topics.insert(*id, CountedTopic::new(&channel.topic));
        }
        self.stated = known.and_then(|s| s.statistics.as_ref()).map(|s| {
            let named = |(id, n): (&u16, &u64)| Some((topics.get(id)?.topic.clone(), *n));
            s.channel_message_counts.iter().filter_map(named).collect()
        });
        topics
    }

    fn count(&mut self, CountedTopic { topic, messages }: CountedTopic) {
        if messages > 0 {
            *self.counts.entry(topic).or_default() += messages;
        }
    }

    fn pass(
        &mut self,
        record: Record,
        topics: &mut BTreeMap<u16, CountedTopic>,
        take: &mut dyn FnMut(ScannedItem),
    ) {
        match record {
            Record::Channel(channel) => match topics.get_mut(&channel.id) {
                Some(known) if known.topic == channel.topic => {}
                _ => {
                    let renamed = topics.insert(channel.id, CountedTopic::new(&channel.topic));
                    renamed.into_iter().for_each(|topic| self.count(topic));
                }
            },
            Record::Message { header, data } => {
                // A message without a channel has a topic without a name.
                let known = topics.entry(header.channel_id).or_insert_with(|| CountedTopic::new(""));
                known.messages += 1;
                take(ScannedItem::Message { topic: &known.topic, header: &header, data: &data });
            }
            Record::Metadata(metadata) => take(ScannedItem::Metadata(metadata.metadata)),
            Record::Attachment { header, data, .. } => {
                take(ScannedItem::Attachment { name: header.name, data: data.into_owned() });
            }
            _ => {}
        }
    }
}

/// The content of a trace file, without the messages for viewers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TraceContents {
    /// Messages on each topic.
    pub counts: BTreeMap<String, usize>,
    pub frames: Vec<v1::TraceFrame>,
    pub events: Vec<v1::TraceEvent>,
    pub parameters: Vec<v1::TraceParameter>,
    /// Build, ids, seed and interventions.
    pub metadata: BTreeMap<String, String>,
    /// By name.
    pub attachments: BTreeMap<String, Vec<u8>>,
}

/// Reads a whole trace file. Other files and damaged ones give an error, never a panic.
pub fn read(bytes: &[u8]) -> Result<TraceContents, RecordingError> {
    let mut contents = TraceContents::default();
    let mut wrong = None;
    let report = scan(std::io::Cursor::new(bytes), &mut |item| {
        if let Err(error) = contents.take(item) {
            wrong.get_or_insert(error);
        }
    })?;
    if let Some(Damage { from, to, what }) = report.damage.into_iter().next() {
        return Err(RecordingError::Damaged { from, to, what });
    }
    wrong.map_or(Ok(contents), Err)
}

impl TraceContents {
    fn take(&mut self, item: ScannedItem) -> Result<(), RecordingError> {
        let (topic, data) = match item {
            ScannedItem::Message { topic, data, .. } => (topic, data),
            ScannedItem::Metadata(metadata) => {
                self.metadata.extend(metadata);
                return Ok(());
            }
            ScannedItem::Attachment { name, data } => {
                self.attachments.insert(name, data);
                return Ok(());
            }
        };
        let count = self.counts.entry(topic.to_string()).or_default();
        let index = *count;
        *count += 1;
        let wrong = |source| RecordingError::Message { topic: topic.to_string(), index, source };
        if topic == m::STATES.name {
            self.frames.push(v1::TraceFrame::decode(data).map_err(wrong)?);
        } else if topic == m::EVENTS.name {
            self.events.push(v1::TraceEvent::decode(data).map_err(wrong)?);
        } else if topic == m::PARAMETERS.name {
            self.parameters.extend(v1::TraceParameters::decode(data).map_err(wrong)?.parameters);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ruzstd::encoding::{CompressionLevel, compress_to_vec};

    #[test]
    fn a_chunk_of_zstd_is_unpacked_and_other_compressions_are_named() {
        let message = [&[op::MESSAGE][..], &30u64.to_le_bytes(), &[0; 22], &[7; 8]].concat();
        let records = message.repeat(50);
        let body = |name: &str, packed: &[u8]| {
            let (size, crc) = (records.len() as u64, crc32fast::hash(&records));
            let name = [&(name.len() as u32).to_le_bytes(), name.as_bytes()].concat();
            let packed = [&(packed.len() as u64).to_le_bytes(), packed].concat();
            [&[0; 16][..], &size.to_le_bytes(), &crc.to_le_bytes(), &name, &packed].concat()
        };
        let packed = compress_to_vec(records.as_slice(), CompressionLevel::Fastest);
        // A frame that is skipped stands in front of another one.
        let skipped = [&0x184d_2a50u32.to_le_bytes()[..], &3u32.to_le_bytes(), &[1, 2, 3], &packed].concat();
        for (name, packed) in [("", &records), ("zstd", &packed), ("zstd", &skipped)] {
            let Ok(WholeRecord::Chunk(found)) = whole(op::CHUNK, &body(name, packed)) else {
                panic!("{name}")
            };
            assert_eq!(found.len(), 50, "{name}");
        }
        for cut in 0..packed.len() {
            assert!(whole(op::CHUNK, &body("zstd", &packed[..cut])).is_err(), "{cut}");
        }
        let refused = whole(op::CHUNK, &body("brotli", &packed)).err().unwrap();
        assert!(refused.contains("brotli") && refused.contains("mcap compress"), "{refused}");
    }

    /// The work that a scan of these bytes does, in bytes, and whether it came to an end.
    fn work_of(bytes: &[u8]) -> (u64, bool) {
        let mut file = FileWindow::new(std::io::Cursor::new(bytes)).unwrap();
        let ended = match scan_window(&mut file, &mut |_| {}) {
            Ok(_) => true,
            Err(RecordingError::TooMuchWork { .. }) => false,
            Err(error) => panic!("{error}"),
        };
        (file.work, ended)
    }

    fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
        [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
    }

    #[test]
    fn many_ends_of_the_data_are_checked_in_one_pass() {
        let ends =
            |count: usize| [mcap::MAGIC, &record(op::DATA_END, &7u32.to_le_bytes()).repeat(count)].concat();
        for count in [1_000, 70_000] {
            let bytes = ends(count);
            let (work, ended) = work_of(&bytes);
            // Each byte is read and checked once, and each record has its price.
            assert!(ended && work < 10 * bytes.len() as u64, "{work} for {} bytes", bytes.len());
        }
    }

    #[test]
    fn no_file_costs_more_than_its_size_allows() {
        // Chunks inside chunks: at every few bytes one begins that reaches to the end.
        let mut nested = mcap::MAGIC.to_vec();
        let size = 900_000u64;
        while (nested.len() as u64) < size {
            let left = size - nested.len() as u64;
            nested.extend(
                [&[op::CHUNK][..], &left.to_le_bytes(), &[0; 16], &MAX_RECORD.to_le_bytes()].concat(),
            );
        }
        nested.resize(size as usize + 40, 0);
        // Small chunks that say to unpack to 64 MiB each.
        let bomb = [&[0; 16][..], &MAX_RECORD.to_le_bytes(), &[0; 4], &4u32.to_le_bytes(), b"zstd", &[0; 8]]
            .concat();
        let bombs = [mcap::MAGIC, &record(op::CHUNK, &bomb).repeat(20_000)].concat();
        for bytes in [nested, bombs] {
            let (work, ended) = work_of(&bytes);
            let most = WORK_FACTOR * bytes.len() as u64 + WORK_BASE;
            assert!(!ended && work <= most + MAX_RECORD + bytes.len() as u64, "{work} for {}", bytes.len());
        }
    }

    #[test]
    fn a_long_topic_is_not_compared_for_every_message() {
        let topic = "t".repeat(100_000);
        let text = |s: &str| [&(s.len() as u32).to_le_bytes(), s.as_bytes()].concat();
        let channel = [&[1, 0, 0, 0][..], &text(&topic), &text(""), &[0; 4]].concat();
        let message = record(op::MESSAGE, &[&[1, 0][..], &[0; 20]].concat());
        let bytes = [mcap::MAGIC, &record(op::CHANNEL, &channel), &message.repeat(100)].concat();
        let report = scan(std::io::Cursor::new(bytes.as_slice()), &mut |_| {}).unwrap();
        assert_eq!(report.counts.get(&topic), Some(&100));
    }
}
