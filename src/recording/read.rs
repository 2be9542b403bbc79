//! Reads a trace file back: its frames, its events, and what stands beside them.

use super::RecordingError;
use super::messages::{self as m, v1};
use mcap::Summary;
use prost::Message;
use std::collections::BTreeMap;

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
    let mut reading = Reading::default();
    for message in mcap::MessageStream::new(bytes)? {
        let message = message?;
        let topic = message.channel.topic.as_str();
        let index = reading.counts.entry(topic.to_string()).or_default();
        *index += 1;
        let wrong = |source| RecordingError::Message { topic: topic.to_string(), index: *index - 1, source };
        let data = message.data.as_ref();
        if topic == m::STATES.name {
            reading.frames.push(v1::TraceFrame::decode(data).map_err(wrong)?);
        } else if topic == m::EVENTS.name {
            reading.events.push(v1::TraceEvent::decode(data).map_err(wrong)?);
        } else if topic == m::PARAMETERS.name {
            reading.parameters.extend(v1::TraceParameters::decode(data).map_err(wrong)?.parameters);
        }
    }
    if let Some(summary) = Summary::read(bytes)? {
        for index in &summary.metadata_indexes {
            reading.metadata.extend(mcap::read::metadata(bytes, index)?.metadata);
        }
        for index in &summary.attachment_indexes {
            let attachment = mcap::read::attachment(bytes, index)?;
            reading.attachments.insert(attachment.name, attachment.data.into_owned());
        }
    }
    Ok(reading)
}
