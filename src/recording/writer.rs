//! Writes a trace file: collects messages, sorts them by time and topic, and encodes them as MCAP.

use super::RecordingError;
use super::messages::Topic;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions};
use prost::Message;
use prost_types::Timestamp;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::ops::Range;

/// Latest time in a trace (s): its nanoseconds are far below the largest `i64`.
pub const MAX_TIME: f64 = 1e9;
/// Bytes of a chunk before compression. Damage loses whole chunks and a seek reads a whole one, so small chunks are
/// better; but each costs its entries in the index.
const CHUNK_BYTES: u64 = 128 << 10;
/// Name of the metadata record.
pub const METADATA: &str = "vrdp";

pub struct TraceWriter {
    topics: Vec<Topic>,
    messages: Vec<QueuedMessage>,
    /// All messages, one after the other.
    bytes: Vec<u8>,
    /// Index of the topic of the last message.
    last: usize,
}

/// A message: its time (ns from the start of the video), the index of its topic, its range in `bytes`.
struct QueuedMessage {
    time: u64,
    topic: usize,
    range: Range<usize>,
}

impl TraceWriter {
    /// Messages of equal time are written in the order of `topics`.
    pub fn new(topics: Vec<Topic>) -> TraceWriter {
        TraceWriter { topics, messages: Vec::new(), bytes: Vec::new(), last: 0 }
    }

    /// Adds a message at `time` (s); a message on another topic than those of the writer is dropped.
    pub fn push(&mut self, topic: &Topic, time: f64, message: &impl Message) -> Result<(), RecordingError> {
        let time = nanoseconds(time)?;
        // Most messages have the topic of the previous one.
        let same = |t: &Topic| t.name == topic.name;
        if !self.topics.get(self.last).is_some_and(same) {
            self.last = self.topics.iter().position(same).unwrap_or(self.topics.len());
        }
        if self.last < self.topics.len() {
            let start = self.bytes.len();
            message.encode(&mut self.bytes)?;
            self.messages.push(QueuedMessage { time, topic: self.last, range: start..self.bytes.len() });
        }
        Ok(())
    }

    /// The bytes of the file; attachments are name, media type and content.
    pub fn finish(
        mut self,
        metadata: BTreeMap<String, String>,
        attachments: &[(&str, &str, Vec<u8>)],
    ) -> Result<Vec<u8>, RecordingError> {
        self.messages.sort_by_key(|message| (message.time, message.topic));
        let options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(CHUNK_BYTES))
            .library("vrdp");
        let mut file_bytes = Vec::with_capacity(self.bytes.len());
        let mut file = options.create(Cursor::new(&mut file_bytes))?;
        file.write_metadata(&Metadata { name: METADATA.into(), metadata })?;
        for (name, media_type, data) in attachments {
            file.attach(&Attachment {
                log_time: 0,
                create_time: 0,
                name: name.to_string(),
                media_type: media_type.to_string(),
                data: Cow::Borrowed(data),
            })?;
        }
        let mut channels = Vec::with_capacity(self.topics.len());
        for topic in &self.topics {
            let schema = file.add_schema(topic.schema, "protobuf", topic.descriptors)?;
            channels.push((file.add_channel(schema, &topic.name, "protobuf", &BTreeMap::new())?, 0));
        }
        for message in &self.messages {
            let Some((channel_id, sequence)) = channels.get_mut(message.topic) else { continue };
            let (log_time, publish_time) = (message.time, message.time);
            let header =
                MessageHeader { channel_id: *channel_id, sequence: *sequence, log_time, publish_time };
            *sequence += 1;
            file.write_to_known_channel(&header, &self.bytes[message.range.clone()])?;
        }
        file.finish()?;
        drop(file);
        Ok(file_bytes)
    }
}

fn nanoseconds(time: f64) -> Result<u64, RecordingError> {
    if !(0.0..=MAX_TIME).contains(&time) {
        return Err(RecordingError::Time { time });
    }
    Ok((time * 1e9).round() as u64)
}

pub fn timestamp(time: f64) -> Result<Option<Timestamp>, RecordingError> {
    let ns = nanoseconds(time)?;
    Ok(Some(Timestamp { seconds: (ns / 1_000_000_000) as i64, nanos: (ns % 1_000_000_000) as i32 }))
}
