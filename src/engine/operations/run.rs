//! Starts operations, and shows, waits for, cancels and forgets them.

use super::record::{OperationFilter, OperationKind, OperationRecord, OperationState, surplus};
use super::running::{Registration, RunningOperation};
use crate::engine::error::EngineError;
use crate::engine::progress::JobProgress;
use crate::engine::state::Engine;
use crate::store::{TableKind, Tenant, now_ms};
use futures_util::stream::{BoxStream, StreamExt};
use std::sync::Arc;
use std::time::Duration;

/// Most running operations of one tenant: some discoveries of each of a dozen users.
const MAX_RUNNING: usize = 64;
/// Services that may end without a drain while an operation runs, before it is not started again: it may be what ends them.
const MOST_CRASHES: u32 = 3;
/// Largest request that is kept for the next service (bytes): those of all that may run take 64 MiB of memory at its start.
const KEPT_REQUEST: usize = 1 << 20;
/// How much longer than another call an operation may take: nobody waits for its connection.
const PATIENCE: u32 = 12;

/// What an operation is about.
pub struct NewOperation {
    pub kind: OperationKind,
    pub videos: Vec<String>,
    /// The caller's name for it; empty: none.
    pub request_id: String,
    pub request_digest: String,
    /// The bytes of its request, by which it is opened again after a restart.
    pub request: Vec<u8>,
}

/// An operation that the end of a service cut short.
pub struct CutOperation {
    /// The engine of its tenant.
    pub owner: Arc<Engine>,
    /// The bytes of its request.
    pub request: Vec<u8>,
    record: OperationRecord,
    registration: Registration,
}

/// What the work of an operation does next.
pub enum OperationUpdate {
    Progress(JobProgress),
    Done(OperationOutcome),
}

/// How the work ended. The engine keeps the bytes and does not read them.
pub struct OperationOutcome {
    pub succeeded: bool,
    /// The result or the error.
    pub result: Vec<u8>,
    /// Ids of the videos that the result is about.
    pub videos: Vec<String>,
}

/// How an operation stands.
#[derive(Debug, Clone, PartialEq)]
pub struct OperationStatus {
    pub record: OperationRecord,
    /// While it runs.
    pub progress: Option<JobProgress>,
}

impl CutOperation {
    /// Goes on with the work that `open` opens from the request.
    pub async fn resume(
        mut self,
        open: impl AsyncFnOnce(&Arc<Engine>, &[u8]) -> BoxStream<'static, OperationUpdate>,
    ) {
        // Should this service end without a drain, too, that is on record.
        self.record.crashes += 1;
        if let Err(error) = self.owner.store.change_operation(&self.record.id, &self.record).await {
            tracing::warn!(%error, operation = self.record.id, "a crash would not be counted");
        }
        tracing::info!(operation = self.record.id, "goes on after a restart");
        let work = open(&self.owner.patient(), &self.request).await;
        self.owner.run_operation(self.record, self.registration, work).await;
    }
}

impl OperationStatus {
    fn new(record: OperationRecord, running: Option<&Arc<RunningOperation>>) -> OperationStatus {
        match (record.state, running) {
            (OperationState::Running, Some(running)) => {
                let progress = Some(*running.progress.borrow());
                OperationStatus { record, progress }
            }
            (OperationState::Running, None) => {
                let record = OperationRecord { state: OperationState::Aborted, ..record };
                OperationStatus { record, progress: None }
            }
            _ => OperationStatus { record, progress: None },
        }
    }

    pub fn is_done(&self) -> bool {
        self.record.state != OperationState::Running
    }
}

impl Engine {
    /// Starts the work that `open` opens, with more time than other calls have. What `open` refuses makes no operation.
    pub async fn start_operation(
        self: &Arc<Self>,
        new: NewOperation,
        open: impl AsyncFnOnce(&Arc<Engine>) -> Result<BoxStream<'static, OperationUpdate>, EngineError>,
    ) -> Result<OperationStatus, EngineError> {
        let NewOperation { kind, videos, request_id, request_digest, request } = new;
        let mut turn = None;
        if !request_id.is_empty() {
            turn = Some(self.operations.starts.lock().await);
            if let Some(known) = self.operation_of_request(&request_id, &request_digest).await? {
                return Ok(known);
            }
        }
        if self.operations.with_prefix(&self.operation_key("")).len() >= MAX_RUNNING {
            return Err(EngineError::Overloaded { capacity: MAX_RUNNING });
        }
        self.forget_old_operations().await?;
        let work = open(&self.patient()).await?;
        let id = self.operations.new_id();
        let record = OperationRecord {
            id: id.clone(),
            kind,
            videos,
            request_id,
            request_digest,
            state: OperationState::Running,
            created_ms: now_ms(),
            ended_ms: None,
            result_bytes: 0,
            crashes: 0,
        };
        let registration = self.operations.register(self.operation_key(&id));
        let request = if request.len() > KEPT_REQUEST { vec![] } else { request };
        self.store.put_operation(&id, &record, request).await?;
        drop(turn);
        let status = OperationStatus::new(record.clone(), Some(&registration.running));
        tokio::spawn(self.clone().run_operation(record, registration, work));
        Ok(status)
    }

    /// The operations of all tenants that the end of the last service cut short. From now on they are seen as running.
    pub async fn cut_operations(self: &Arc<Self>) -> Result<Vec<CutOperation>, EngineError> {
        let running = |record: &OperationRecord| record.state == OperationState::Running;
        let everyone = self.store.of_everyone();
        let mut cut = vec![];
        for (key, record) in everyone.list(TableKind::Operations, "", "", usize::MAX, running).await? {
            let owner = self.of(&Tenant::of_key(&key));
            let request = owner.store.operation_result(&record.id).await?;
            let goes_on = |request: &Vec<u8>| !request.is_empty() && record.crashes < MOST_CRASHES;
            // Older programs kept no request.
            let Some(request) = request.filter(goes_on) else { continue };
            let registration = owner.operations.register(owner.operation_key(&record.id));
            cut.push(CutOperation { owner, request, record, registration });
        }
        Ok(cut)
    }

    async fn run_operation(
        self: Arc<Self>,
        mut record: OperationRecord,
        registration: Registration,
        mut work: BoxStream<'static, OperationUpdate>,
    ) {
        let running = &registration.running;
        let outcome = loop {
            tokio::select! {
                biased;
                () = running.token.cancelled() => break None,
                update = work.next() => match update {
                    Some(OperationUpdate::Progress(at)) => {
                        running.progress.send_replace(at);
                    }
                    Some(OperationUpdate::Done(outcome)) => break Some(outcome),
                    None => break None,
                },
            }
        };
        // Who cancels frees the CPU before the operation is seen to have ended.
        drop(work);
        if outcome.is_none() && self.operations.is_closed() {
            return self.keep_for_the_next_service(record).await;
        }
        let state = |outcome: &OperationOutcome| match outcome.succeeded {
            true => OperationState::Succeeded,
            false => OperationState::Failed,
        };
        record.state = outcome.as_ref().map_or(OperationState::Cancelled, state);
        let OperationOutcome { result, videos, .. } =
            outcome.unwrap_or(OperationOutcome { succeeded: false, result: vec![], videos: vec![] });
        record.ended_ms = Some(now_ms());
        record.result_bytes = result.len() as u64;
        let new = videos.into_iter().filter(|video| !record.videos.contains(video)).collect::<Vec<_>>();
        record.videos.extend(new);
        // Another call for a result that is there already finds it: only this operation is lost, and says so.
        if let Err(error) = self.store.end_operation(&record.id, &record, result).await {
            tracing::error!(%error, operation = record.id, "the end of an operation was not stored");
        }
        if let Err(error) = self.forget_old_operations().await {
            tracing::warn!(%error, "old operations were not removed");
        }
    }

    /// Drained, and so not to blame for the end of the service.
    async fn keep_for_the_next_service(&self, record: OperationRecord) {
        let record = OperationRecord { crashes: 0, ..record };
        if let Err(error) = self.store.change_operation(&record.id, &record).await {
            tracing::warn!(%error, operation = record.id, "it counts as running at a crash");
        }
    }

    /// The same engine with more time for each job.
    fn patient(&self) -> Arc<Engine> {
        let mut capacity = self.capacity();
        capacity.job_timeout = capacity.job_timeout.saturating_mul(PATIENCE);
        self.with_capacity(capacity)
    }

    /// Whether the service ends: what runs now goes on in the next one.
    pub fn ends(&self) -> bool {
        self.operations.is_closed()
    }

    /// How an operation stands.
    pub async fn operation(&self, id: &str) -> Result<OperationStatus, EngineError> {
        let key = self.operation_key(id);
        let running = self.operations.get(&key);
        let record: Option<OperationRecord> = self.store.get(TableKind::Operations, id).await?;
        let record = record.ok_or_else(|| no_operation(id))?;
        let status = OperationStatus::new(record, running.or_else(|| self.operations.get(&key)).as_ref());
        if status.record.is_expired(now_ms()) { Err(no_operation(id)) } else { Ok(status) }
    }

    /// The bytes of an operation's result or error; none where it was cancelled or aborted.
    pub async fn operation_result(&self, id: &str) -> Result<Vec<u8>, EngineError> {
        Ok(self.store.operation_result(id).await?.unwrap_or_default())
    }

    /// How it stands when it has changed, or after `period`.
    pub async fn changed_operation(
        &self,
        id: &str,
        period: Duration,
    ) -> Result<OperationStatus, EngineError> {
        if let Some(running) = self.operations.get(&self.operation_key(id)) {
            let mut progress = running.progress.subscribe();
            tokio::select! {
                () = running.ended.cancelled() => {}
                _ = progress.changed() => {}
                () = tokio::time::sleep(period) => {}
            }
        }
        self.operation(id).await
    }

    /// Up to `limit` operations that the filter accepts, after the id `after`, the newest first.
    pub async fn operations(
        &self,
        filter: OperationFilter,
        after: &str,
        limit: usize,
    ) -> Result<Vec<OperationStatus>, EngineError> {
        let (prefix, now) = (self.operation_key(""), now_ms());
        // One that ends meanwhile was running before; one that starts meanwhile is running now.
        let (before, running) = (self.operations.with_prefix(&prefix), self.operations.clone());
        let status = Arc::new(move |record: OperationRecord| {
            let key = format!("{prefix}{}", record.id);
            OperationStatus::new(record, before.get(&key).cloned().or_else(|| running.get(&key)).as_ref())
        });
        let shown = status.clone();
        let keep = move |record: &OperationRecord| {
            let record = shown(record.clone()).record;
            !record.is_expired(now) && filter.accepts(&record)
        };
        let rows = self.store.list(TableKind::Operations, "", after, limit, keep).await?;
        Ok(rows.into_iter().map(|(_, record)| status(record)).collect())
    }

    /// Stops an operation, unless it has ended; how it then stands.
    pub async fn cancel_operation(&self, id: &str) -> Result<OperationStatus, EngineError> {
        if let Some(running) = self.operations.get(&self.operation_key(id)) {
            running.token.cancel();
            running.ended.cancelled().await;
        }
        self.operation(id).await
    }

    /// Stops and forgets an operation.
    pub async fn delete_operation(&self, id: &str) -> Result<(), EngineError> {
        self.cancel_operation(id).await?;
        Ok(self.store.delete_operations(&[id.to_string()]).await?)
    }

    /// Aborts the running operations of all tenants, because the service ends.
    pub async fn abort_operations(&self) {
        self.operations.close().await;
    }

    /// The operation that a request with this id has started.
    async fn operation_of_request(
        &self,
        request_id: &str,
        digest: &str,
    ) -> Result<Option<OperationStatus>, EngineError> {
        let (wanted, now) = (request_id.to_string(), now_ms());
        let same = move |record: &OperationRecord| record.request_id == wanted && !record.is_expired(now);
        let found = self.store.list(TableKind::Operations, "", "", 1, same).await?;
        let Some((id, record)) = found.into_iter().next() else { return Ok(None) };
        if record.request_digest != digest {
            let message = format!(
                "is {request_id:?}, which names operations/{id} of another request; choose a new one"
            );
            return Err(EngineError::invalid("request_id", message));
        }
        Ok(Some(self.operation(&id).await?))
    }

    /// Deletes the ended operations that are too old or too many.
    async fn forget_old_operations(&self) -> Result<(), EngineError> {
        let all = |_: &OperationRecord| true;
        let rows = self.store.list(TableKind::Operations, "", "", usize::MAX, all).await?;
        let running = self.operations.with_prefix(&self.operation_key(""));
        let status = |(id, record): (String, OperationRecord)| {
            OperationStatus::new(record, running.get(&self.operation_key(&id))).record
        };
        let records: Vec<OperationRecord> = rows.into_iter().map(status).collect();
        let surplus = surplus(&records, now_ms());
        if surplus.is_empty() { Ok(()) } else { Ok(self.store.delete_operations(&surplus).await?) }
    }

    /// The whole key of an operation of this tenant.
    fn operation_key(&self, id: &str) -> String {
        self.store.key(&format!("operations/{id}"))
    }
}

fn no_operation(id: &str) -> EngineError {
    EngineError::NotFound { name: format!("operations/{id}") }
}
