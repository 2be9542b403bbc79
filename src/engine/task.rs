//! Work as data: a task holds all that it needs, and one function performs it on the pool.

use super::error::EngineError;
use super::pool::{JobContext, JobKind, QueueSlot};
use super::progress::Report;
use super::state::Engine;
use super::traces::backlog::Batch;
use super::traces::file::TraceFile;
use crate::num::Stop;

/// Where a task reports how far it is.
pub type ReportSink<'a> = &'a (dyn Fn(Report) + Send + Sync);

/// One piece of work. Its output depends on its fields alone.
pub trait Task: Send + 'static {
    type Output: Send + 'static;

    /// What it is; its class follows from that.
    fn kind(&self) -> JobKind;

    /// Does the work: its output, and the traces of it.
    fn perform(self, report: ReportSink, stop: Stop) -> Result<(Self::Output, Vec<TraceFile>), EngineError>;
}

/// A task that is done.
pub struct Performed<T> {
    pub output: T,
    /// Its traces, which are not stored yet.
    pub batch: Batch,
    /// To be kept until the output is stored.
    pub slot: QueueSlot,
}

impl Engine {
    /// Performs a task of this tenant on the pool.
    pub(super) async fn perform<W: Task>(
        &self,
        task: W,
        context: JobContext,
    ) -> Result<Performed<W::Output>, EngineError> {
        let (kind, backlog, report) = (task.kind(), self.backlog.clone(), context.progress.clone());
        let work = move |stop: Stop| {
            let (output, files) = task.perform(&*report, stop)?;
            Ok((output, backlog.admit(files, stop)?))
        };
        let ((output, batch), slot) = self.pool.run((&self.tenant, kind), context, work).await?;
        Ok(Performed { output, batch, slot })
    }
}
