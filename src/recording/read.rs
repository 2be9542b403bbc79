//! Reads a trace file back: its frames, its events, and what stands beside them.

use super::RecordingError;
use super::messages::{self as m, v1};
use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use prost::Message;
use std::collections::BTreeMap;

/// Longest record or decompressed chunk (bytes): a damaged length must not take all memory.
const MAX_RECORD: usize = 64 << 20;

/// What a trace file holds, without the messages that are drawn only.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Reading {
    /// Messages on each topic.
    pub counts: BTreeMap<String, usize>,
    pub frames: Vec<v1::TraceFrame>,
    pub events: Vec<v1::TraceEvent>,
    pub parameters: Vec<v1::TraceParameter>,
    /// Build, ids, seed and interventions.
    pub metadata: BTreeMap<String, String>,
    /// `request.json` and `model.json`, by name.
    pub attachments: BTreeMap<String, Vec<u8>>,
}

/// Reads a whole trace file. Bytes that are none give an error, never a panic.
pub fn read(bytes: &[u8]) -> Result<Reading, RecordingError> {
    let options =
        LinearReaderOptions::default().with_record_length_limit(MAX_RECORD).with_validate_chunk_crcs(true);
    let mut reader = LinearReader::new_with_options(options);
    let mut reading = Reading::default();
    let mut topics = BTreeMap::new();
    let mut rest = bytes;
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                let (now, later) = rest.split_at(wanted.min(rest.len()));
                let space = reader.insert(now.len());
                space[..now.len()].copy_from_slice(now);
                reader.notify_read(now.len());
                rest = later;
            }
            LinearReadEvent::Record { opcode, data } => match mcap::parse_record(opcode, data)? {
                Record::Channel(channel) => {
                    topics.insert(channel.id, channel.topic);
                }
                Record::Message { header, data } => {
                    let topic = topics.get(&header.channel_id).map_or("", String::as_str);
                    reading.take(topic, &data)?;
                }
                Record::Metadata(metadata) => reading.metadata.extend(metadata.metadata),
                Record::Attachment { header, data, .. } => {
                    reading.attachments.insert(header.name, data.into_owned());
                }
                _ => {}
            },
        }
    }
    Ok(reading)
}

impl Reading {
    fn take(&mut self, topic: &str, data: &[u8]) -> Result<(), RecordingError> {
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
