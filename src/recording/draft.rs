//! A trace file while it is written: messages collected, sorted by time, then put out as MCAP.

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

/// Latest time in a trace (s): nanoseconds keep their place in an `i64` with room to spare.
pub const MAX_TIME: f64 = 1e9;
/// Bytes of a chunk before it is compressed. Damage takes whole chunks, a seek reads one; each costs its index entries.
const CHUNK: u64 = 128 << 10;
/// Name of the metadata record.
pub const METADATA: &str = "vrdp";

pub struct Draft {
    topics: Vec<Topic>,
    messages: Vec<Placed>,
    /// All messages, one after the other.
    bytes: Vec<u8>,
    /// Index of the topic of the last message.
    last: usize,
}

/// A message: when (ns from the start of the video), on which topic, where in `bytes`.
struct Placed {
    time: u64,
    topic: usize,
    range: Range<usize>,
}

impl Draft {
    /// Messages of equal time will stand in the order of `topics`.
    pub fn new(topics: Vec<Topic>) -> Draft {
        Draft { topics, messages: Vec::new(), bytes: Vec::new(), last: 0 }
    }

    /// Adds a message at `time` (s); on a topic that the draft lacks it is left out.
    pub fn push(&mut self, topic: &Topic, time: f64, message: &impl Message) -> Result<(), RecordingError> {
        let time = nanoseconds(time)?;
        // Messages mostly come topic by topic.
        let same = |t: &Topic| t.name == topic.name;
        if !self.topics.get(self.last).is_some_and(same) {
            self.last = self.topics.iter().position(same).unwrap_or(self.topics.len());
        }
        if self.last < self.topics.len() {
            let start = self.bytes.len();
            message.encode(&mut self.bytes)?;
            self.messages.push(Placed { time, topic: self.last, range: start..self.bytes.len() });
        }
        Ok(())
    }

    /// The file; attachments are name, media type and content.
    pub fn finish(
        mut self,
        metadata: BTreeMap<String, String>,
        attachments: &[(&str, &str, Vec<u8>)],
    ) -> Result<Vec<u8>, RecordingError> {
        self.messages.sort_by_key(|message| (message.time, message.topic));
        let options =
            WriteOptions::new().compression(Some(Compression::Lz4)).chunk_size(Some(CHUNK)).library("vrdp");
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
