//! Reads a trace file through its index: any time span, with one chunk in memory at a time.

use super::RecordingError;
use super::scan::{FileWindow, Summary, WholeRecord, seconds};
use super::writer::METADATA;
use mcap::records::Record;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io::{Read, Seek};
use std::sync::Arc;

/// An open trace file. Checksums of all records that are read are checked.
pub struct TraceReader<R> {
    file: FileWindow<R>,
    summary: Summary,
}

/// One message of a trace.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    pub topic: Arc<str>,
    /// s.
    pub time: f64,
    pub data: Vec<u8>,
}

/// A topic, as the summary of the file describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct TopicInfo {
    pub name: String,
    pub schema: String,
    pub messages: u64,
}

impl<R: Read + Seek> TraceReader<R> {
    /// Reads the summary at the end of the file.
    pub fn open(source: R) -> Result<Self, RecordingError> {
        let mut file = FileWindow::new(source)?;
        if file.get(0, mcap::MAGIC.len())? != mcap::MAGIC {
            return Err(RecordingError::NoTrace);
        }
        match Summary::read(&mut file)? {
            Ok(summary) => {
                // A replay may read the file as often as it likes.
                file.allow_passes(None);
                Ok(TraceReader { file, summary })
            }
            Err(what) => {
                let to = file.size;
                Err(RecordingError::Damaged { from: 0, to, what })
            }
        }
    }

    /// From here on, as much work is allowed as that many passes over the file need.
    pub fn allow_passes(&mut self, passes: u64) {
        self.file.allow_passes(Some(passes));
    }

    pub fn size_bytes(&self) -> u64 {
        self.file.size
    }

    /// In the order in which they were written.
    pub fn topics(&self) -> Vec<TopicInfo> {
        let count = |id: &u16| {
            let statistics = self.summary.statistics.as_ref();
            statistics.and_then(|s| s.channel_message_counts.get(id).copied()).unwrap_or(0)
        };
        let one = |(id, c): (&u16, &mcap::records::Channel)| TopicInfo {
            name: c.topic.clone(),
            schema: self.summary.schemas.get(&c.schema_id).cloned().unwrap_or_default(),
            messages: count(id),
        };
        self.summary.channels.iter().map(one).collect()
    }

    /// First and last time (s).
    pub fn span(&self) -> [f64; 2] {
        let s = self.summary.statistics.as_ref();
        s.map_or([0.0; 2], |s| [seconds(s.message_start_time), seconds(s.message_end_time)])
    }

    pub fn chunks(&self) -> usize {
        self.summary.chunks.len()
    }

    /// Names and sizes (bytes).
    pub fn attachments(&self) -> Vec<(String, u64)> {
        self.summary.attachments.iter().map(|a| (a.name.clone(), a.data_size)).collect()
    }

    /// Build, kind, ids and numbers of the request.
    pub fn metadata(&mut self) -> Result<BTreeMap<String, String>, RecordingError> {
        let Some(at) = self.summary.metadata.iter().find(|m| m.name == METADATA).map(|m| m.offset) else {
            return Ok(BTreeMap::new());
        };
        match self.record(at)? {
            WholeRecord::Other(Record::Metadata(metadata)) => Ok(metadata.metadata),
            _ => Err(self.damaged(at, "there are no metadata at the offset in the index")),
        }
    }

    /// The content of an attachment; `None` where there is none.
    pub fn attachment(&mut self, name: &str) -> Result<Option<Vec<u8>>, RecordingError> {
        let Some(at) = self.summary.attachments.iter().find(|a| a.name == name).map(|a| a.offset) else {
            return Ok(None);
        };
        match self.record(at)? {
            WholeRecord::Other(Record::Attachment { data, .. }) => Ok(Some(data.into_owned())),
            _ => Err(self.damaged(at, "there is no attachment at the offset in the index")),
        }
    }

    /// The messages on `topics` (none: on all) with times in `from..=to` (s), by time.
    pub fn messages(&mut self, topics: &[&str], [from, to]: [f64; 2]) -> Messages<'_, R> {
        let wanted = |topic: &str| topics.is_empty() || topics.contains(&topic);
        let named = |(id, c): (&u16, &mcap::records::Channel)| {
            wanted(&c.topic).then(|| (*id, Arc::from(c.topic.as_str())))
        };
        let topics: BTreeMap<u16, Arc<str>> = self.summary.channels.iter().filter_map(named).collect();
        let [from, to] = [from, to].map(|s| (s * 1e9).round() as u64);
        let ids: BTreeSet<u16> = topics.keys().copied().collect();
        let chunks = self.summary.chunks.iter().filter(|c| {
            let on_topic = c.message_index_offsets.is_empty()
                || c.message_index_offsets.keys().any(|id| ids.contains(id));
            on_topic && c.message_start_time <= to && c.message_end_time >= from
        });
        // An index may name a chunk many times; its messages are read once.
        let mut known = BTreeSet::new();
        let chunks = chunks.map(|c| c.chunk_start_offset).filter(|at| known.insert(*at)).collect();
        Messages { reader: self, topics, from, to, chunks, ready: VecDeque::new() }
    }

    /// Whether the file has exactly these bytes.
    pub fn has_content(&mut self, bytes: &[u8]) -> Result<bool, RecordingError> {
        if self.file.size != bytes.len() as u64 {
            return Ok(false);
        }
        let mut at = 0;
        for block in bytes.chunks(64 << 10) {
            if self.file.get(at, block.len())? != block {
                return Ok(false);
            }
            at += block.len() as u64;
        }
        Ok(true)
    }

    fn record(&mut self, at: u64) -> Result<WholeRecord, RecordingError> {
        match self.file.record(at)? {
            Ok((record, _)) => Ok(record),
            Err(what) => Err(self.damaged(at, &what)),
        }
    }

    fn damaged(&self, from: u64, what: &str) -> RecordingError {
        RecordingError::Damaged { from, to: self.file.size, what: what.into() }
    }
}

/// Messages of a time span. One chunk is in memory at a time.
pub struct Messages<'r, R> {
    reader: &'r mut TraceReader<R>,
    topics: BTreeMap<u16, Arc<str>>,
    /// ns.
    from: u64,
    to: u64,
    /// Offsets of the chunks that are not read yet.
    chunks: VecDeque<u64>,
    ready: VecDeque<Message>,
}

impl<R: Read + Seek> Messages<'_, R> {
    fn load(&mut self, at: u64) -> Result<(), RecordingError> {
        let WholeRecord::Chunk(records) = self.reader.record(at)? else {
            return Err(self.reader.damaged(at, "there is no chunk at the offset in the index"));
        };
        for record in records {
            if let Record::Message { header, data } = record
                && (self.from..=self.to).contains(&header.log_time)
                && let Some(topic) = self.topics.get(&header.channel_id)
            {
                let (topic, time) = (topic.clone(), seconds(header.log_time));
                self.ready.push_back(Message { topic, time, data: data.into_owned() });
            }
        }
        Ok(())
    }
}

impl<R: Read + Seek> Iterator for Messages<'_, R> {
    type Item = Result<Message, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.ready.is_empty() {
            let at = self.chunks.pop_front()?;
            if let Err(error) = self.load(at) {
                self.chunks.clear();
                return Some(Err(error));
            }
        }
        self.ready.pop_front().map(Ok)
    }
}
