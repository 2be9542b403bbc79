//! What a job gets from its caller: when it must end early, and where its progress goes.

use crate::engine::error::EngineError;
use crate::engine::progress::Report;
use std::sync::Arc;
use std::time::Instant;
use tokio_util::sync::CancellationToken;

#[derive(Clone)]
pub struct JobContext {
    pub token: CancellationToken,
    pub deadline: Instant,
    pub progress: Arc<dyn Fn(Report) + Send + Sync>,
}

impl JobContext {
    /// An error if the job must end now.
    pub fn check(&self) -> Result<(), EngineError> {
        if self.token.is_cancelled() {
            Err(EngineError::Cancelled)
        } else if Instant::now() >= self.deadline {
            Err(EngineError::DeadlineExceeded)
        } else {
            Ok(())
        }
    }
}
