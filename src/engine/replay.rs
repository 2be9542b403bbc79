//! Plays a stored trace: its rows and events in time, in little memory, as fast as was asked for.

use super::{Engine, EngineError, shelf::Lease};
use crate::recording::messages::{self as m, v1};
use crate::recording::{MAX_TIME, Reader, RecordingError};
use prost::Message;
use std::fs::File;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio::time::{Instant, sleep_until};

/// Most replays at a time: each has a thread that waits for its reader.
pub const MAX_REPLAYS: usize = 32;
/// Items that are read ahead.
const AHEAD: usize = 64;

/// How a trace is played.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReplayOptions {
    /// Seconds of the trace in one second; 0: as fast as it is read.
    pub speed: f64,
    /// First and last time (s).
    pub from: f64,
    pub to: f64,
    /// Begins anew at its end, until the reader leaves.
    pub again: bool,
}

impl Default for ReplayOptions {
    fn default() -> Self {
        ReplayOptions { speed: 1.0, from: 0.0, to: MAX_TIME, again: false }
    }
}

pub enum Played {
    Frame(v1::TraceFrame),
    Event(v1::TraceEvent),
}

/// A trace that is being played.
pub struct Replay {
    items: mpsc::Receiver<Result<(u64, f64, Played), EngineError>>,
    options: ReplayOptions,
    round: u64,
    /// When this round began.
    began: Instant,
    _lease: Lease,
    _place: OwnedSemaphorePermit,
}

impl Engine {
    /// Begins to play a trace.
    pub async fn replay(self: &Arc<Self>, id: &str, options: ReplayOptions) -> Result<Replay, EngineError> {
        let full = |_| EngineError::Overloaded { capacity: MAX_REPLAYS };
        let place = self.replays.clone().try_acquire_owned().map_err(full)?;
        let (record, lease) = self.trace(id).await?;
        let file = self.store.open_blob(&record.id).await?;
        let (send, items) = mpsc::channel(AHEAD);
        let engine = self.clone();
        tokio::task::spawn_blocking(move || {
            if let Err(error) = read(file, options, &send) {
                // The reader may have left.
                let _ = send.blocking_send(Err(engine.damaged(&record.id, error.to_string())));
            }
        });
        Ok(Replay { items, options, round: 0, began: Instant::now(), _lease: lease, _place: place })
    }
}

type Items = mpsc::Sender<Result<(u64, f64, Played), EngineError>>;

/// Sends the items of one round after the other, until the end or until nobody listens.
fn read(file: File, options: ReplayOptions, to: &Items) -> Result<(), RecordingError> {
    let mut reader = Reader::open(file)?;
    for round in 0.. {
        let mut some = false;
        let topics = [&*m::STATES.name, &*m::AFTER.name, &*m::EVENTS.name];
        for (index, message) in reader.messages(&topics, [options.from, options.to]).enumerate() {
            let message = message?;
            let broken = |source| RecordingError::Message { topic: message.topic.to_string(), index, source };
            let item = match *message.topic == *m::EVENTS.name {
                true => Played::Event(v1::TraceEvent::decode(message.data.as_slice()).map_err(broken)?),
                false => Played::Frame(v1::TraceFrame::decode(message.data.as_slice()).map_err(broken)?),
            };
            if to.blocking_send(Ok((round, message.time, item))).is_err() {
                return Ok(());
            }
            some = true;
        }
        if !(options.again && some) {
            break;
        }
    }
    Ok(())
}

impl Replay {
    /// The next item when it is due, with its round (from 0) and its time (s); `None` at the end.
    pub async fn next(&mut self) -> Option<Result<(u64, f64, Played), EngineError>> {
        let item = self.items.recv().await?;
        if let Ok((round, time, _)) = &item
            && self.options.speed > 0.0
        {
            if *round != self.round {
                (self.round, self.began) = (*round, Instant::now());
            }
            let after = (time - self.options.from).max(0.0) / self.options.speed;
            sleep_until(self.began + Duration::try_from_secs_f64(after).unwrap_or(Duration::MAX)).await;
        }
        Some(item)
    }
}
