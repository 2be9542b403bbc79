//! Plays a stored trace: its rows and events at their times, at the requested speed.
//!
//! One thread a replay reads the file chunk by chunk and at most [`AHEAD`] items ahead, so that memory does not depend
//! on the length of the trace; at most [`crate::engine::MAX_REPLAYS`] run at a time, of one tenant only a share of
//! them. A lease keeps the trace from being removed.

use super::retention::Lease;
use crate::engine::error::EngineError;
use crate::engine::pool::QueueSlot;
use crate::engine::state::Engine;
use crate::recording::messages::{self as m, v1};
use crate::recording::{MAX_TIME, RecordingError, TraceReader};
use prost::Message;
use std::fs::File;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};

/// Items that are read ahead.
const AHEAD: usize = 64;

/// How a trace is played.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReplayOptions {
    /// Seconds of the trace in one second; 0: without waiting.
    pub speed: f64,
    /// First and last time (s).
    pub from: f64,
    pub to: f64,
    /// Starts again at its end, until the caller leaves.
    pub repeat: bool,
}

impl Default for ReplayOptions {
    fn default() -> Self {
        ReplayOptions { speed: 1.0, from: 0.0, to: MAX_TIME, repeat: false }
    }
}

pub enum ReplayItem {
    Frame(v1::TraceFrame),
    Event(v1::TraceEvent),
}

/// A running replay.
pub struct Replay {
    items: mpsc::Receiver<Result<(u64, f64, ReplayItem), EngineError>>,
    options: ReplayOptions,
    round: u64,
    /// When this round started.
    start: Instant,
    _lease: Lease,
    _slot: QueueSlot,
}

impl Engine {
    /// Starts to play a trace.
    pub async fn replay(self: &Arc<Self>, id: &str, options: ReplayOptions) -> Result<Replay, EngineError> {
        let slot = self.replays.admit(&self.tenant)?;
        let (record, lease) = self.trace(id).await?;
        let file = self.store.open_blob(&record.id).await?;
        let (send, items) = mpsc::channel(AHEAD);
        let engine = self.clone();
        tokio::task::spawn_blocking(move || {
            if let Err(error) = read(file, options, &send) {
                // The receiver may be gone.
                let _ = send.blocking_send(Err(engine.damaged(&record, error.to_string())));
            }
        });
        Ok(Replay { items, options, round: 0, start: Instant::now(), _lease: lease, _slot: slot })
    }
}

type ItemSender = mpsc::Sender<Result<(u64, f64, ReplayItem), EngineError>>;

/// Sends the items of one round after the other, until the end or until the receiver is gone.
fn read(file: File, options: ReplayOptions, to: &ItemSender) -> Result<(), RecordingError> {
    let mut reader = TraceReader::open(file)?;
    for round in 0.. {
        let mut is_empty = true;
        let topics = [&*m::STATES.name, &*m::AFTER.name, &*m::EVENTS.name];
        for (index, message) in reader.messages(&topics, [options.from, options.to]).enumerate() {
            let message = message?;
            let broken = |source| RecordingError::Message { topic: message.topic.to_string(), index, source };
            let item = match *message.topic == *m::EVENTS.name {
                true => ReplayItem::Event(v1::TraceEvent::decode(message.data.as_slice()).map_err(broken)?),
                false => ReplayItem::Frame(v1::TraceFrame::decode(message.data.as_slice()).map_err(broken)?),
            };
            if to.blocking_send(Ok((round, message.time, item))).is_err() {
                return Ok(());
            }
            is_empty = false;
        }
        if is_empty || !options.repeat {
            break;
        }
    }
    Ok(())
}

impl Replay {
    /// The next item when it is due, with its round (from 0) and its time (s); `None` at the end.
    pub async fn next(&mut self) -> Option<Result<(u64, f64, ReplayItem), EngineError>> {
        let item = self.items.recv().await?;
        if let Ok((round, time, _)) = &item
            && self.options.speed > 0.0
        {
            if *round != self.round {
                (self.round, self.start) = (*round, Instant::now());
            }
            let after = (time - self.options.from).max(0.0) / self.options.speed;
            sleep_until(self.start + Duration::try_from_secs_f64(after).unwrap_or(Duration::MAX)).await;
        }
        Some(item)
    }
}
