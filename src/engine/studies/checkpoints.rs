//! Results of the steps of a running discovery on disk. A service that is killed loses what it computed since the last of them;
//! the next one goes on from there.

use crate::discover::Checkpoints;
use crate::engine::error::EngineError;
use crate::engine::state::Engine;
use crate::store::TableKind;
use ciborium::Value;
use std::collections::HashMap;
use std::time::Duration;
use tokio::sync::mpsc;

/// A discovery that ends within this time keeps nothing: to compute it again takes no longer.
const FIRST_KEPT: Duration = Duration::from_secs(2);
/// Most bytes that are kept of one discovery: the next attempt holds them in memory.
const MOST_KEPT: usize = 64 << 20;

/// The results of earlier attempts, and where new ones go.
pub struct KeptSteps {
    known: HashMap<String, Vec<u8>>,
    new: mpsc::UnboundedSender<KeptStep>,
}

/// Digest and result of a step.
type KeptStep = (String, Vec<u8>);

/// Writes the results of one discovery's steps, and removes them when it has ended.
pub struct CheckpointWriter {
    engine: Engine,
    video: String,
    /// What their keys begin with.
    prefix: String,
    new: mpsc::UnboundedReceiver<KeptStep>,
}

impl Checkpoints for KeptSteps {
    fn find(&self, digest: &str) -> Option<Vec<u8>> {
        self.known.get(digest).cloned()
    }

    fn keep(&self, digest: &str, result: Vec<u8>) {
        // Without a writer the discovery has nobody to go on for.
        let _ = self.new.send((digest.to_string(), result));
    }
}

impl Engine {
    /// The results that earlier attempts at this study of the video have kept, and the writer of new ones.
    pub(super) async fn kept_steps(
        &self,
        video: &str,
        study: &str,
    ) -> Result<(KeptSteps, CheckpointWriter), EngineError> {
        let prefix = format!("{video}/{study}/");
        let all = |_: &Value| true;
        let rows = self.store.list(TableKind::Checkpoints, &prefix, "", usize::MAX, all).await?;
        let step = |key: String| key.strip_prefix(&prefix).map_or(key.clone(), str::to_string);
        let known: HashMap<_, _> =
            rows.into_iter().filter_map(|(key, row)| Some((step(key), row.into_bytes().ok()?))).collect();
        if !known.is_empty() {
            tracing::info!(study, steps = known.len(), "a discovery goes on from what was kept of it");
        }
        let (sender, receiver) = mpsc::unbounded_channel();
        let writer =
            CheckpointWriter { engine: self.clone(), video: video.to_string(), prefix, new: receiver };
        Ok((KeptSteps { known, new: sender }, writer))
    }
}

impl CheckpointWriter {
    /// Writes until all is written that is kept, or one cannot be.
    pub async fn write(&mut self) {
        tokio::time::sleep(FIRST_KEPT).await;
        let mut room = MOST_KEPT;
        while let Some((step, result)) = self.new.recv().await {
            let Some(rest) = room.checked_sub(result.len()) else { return };
            room = rest;
            let key = format!("{}{step}", self.prefix);
            let stored = self
                .engine
                .put_of_video(TableKind::Checkpoints, &self.video, &key, &Value::Bytes(result))
                .await;
            if let Err(error) = stored {
                tracing::warn!(%error, "a discovery keeps no more of its steps");
                return;
            }
        }
    }
}

impl Drop for CheckpointWriter {
    /// Unless the service ends: the discovery has ended, or nobody wants it any more.
    fn drop(&mut self) {
        if self.engine.ends() {
            return;
        }
        let (engine, prefix) = (self.engine.clone(), std::mem::take(&mut self.prefix));
        tokio::spawn(async move {
            if let Err(error) = engine.store.forget_checkpoints(&prefix, None).await {
                tracing::warn!(%error, "what was kept of a discovery was not removed");
            }
        });
    }
}
