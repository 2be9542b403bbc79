//! The service `Operations`.

use super::updates::{CallUpdate, LongCall};
use super::{RpcResult, RpcStream, Services, calls, concepts, cut_page, held};
use crate::api::convert::operation;
use crate::api::server::byte_budget::HeldBytes;
use crate::api::status::{error, status};
use crate::api::v1;
use crate::api::v1::operation::Result as OperationResult;
use crate::api::v1::start_operation_request::Work;
use crate::engine::{Engine, EngineError, OperationStatus, OperationUpdate};
use futures_util::stream::{self, BoxStream, StreamExt};
use std::sync::Arc;
use std::time::Duration;
use tonic::{Request, Response, Status};

/// How often an unchanged operation is sent to those who wait.
const HEARTBEAT: Duration = Duration::from_secs(1);

#[tonic::async_trait]
impl v1::operations_server::Operations for Services {
    async fn start_operation(&self, request: Request<v1::StartOperationRequest>) -> RpcResult<v1::Operation> {
        let (owner, held) = (self.owner(&request), held(&request));
        let (new, work) = operation::start(request.into_inner()).map_err(status)?;
        let engine = owner.clone();
        // In a task of its own, so that a caller who leaves now does not leave a half of it.
        let start =
            async move { engine.start_operation(new, async |engine| open(engine, work, held).await).await };
        let started = tokio::spawn(start).await.map_err(failed)?;
        Ok(Response::new(whole(&owner, &started.map_err(status)?).await?))
    }

    async fn get_operation(&self, request: Request<v1::GetOperationRequest>) -> RpcResult<v1::Operation> {
        let owner = self.owner(&request);
        let id = operation::id(&request.into_inner().name).map_err(status)?;
        let found = owner.operation(&id).await.map_err(status)?;
        Ok(Response::new(whole(&owner, &found).await?))
    }

    async fn list_operations(
        &self,
        request: Request<v1::ListOperationsRequest>,
    ) -> RpcResult<v1::ListOperationsResponse> {
        let owner = self.owner(&request);
        let (filter, size, after) = operation::list(request.into_inner()).map_err(status)?;
        let mut rows = owner.operations(filter, &after, size + 1).await.map_err(status)?;
        let next_page_token = cut_page(&mut rows, size, |row| &row.record.id);
        let operations = rows.iter().map(operation::operation).collect();
        Ok(Response::new(v1::ListOperationsResponse { operations, next_page_token }))
    }

    type WaitOperationStream = RpcStream<v1::Operation>;

    async fn wait_operation(
        &self,
        request: Request<v1::WaitOperationRequest>,
    ) -> RpcResult<Self::WaitOperationStream> {
        let owner = self.owner(&request);
        let id = operation::id(&request.into_inner().name).map_err(status)?;
        let first = owner.operation(&id).await.map_err(status)?;
        let updates = stream::try_unfold(Some(first), move |state| {
            let (owner, id) = (owner.clone(), id.clone());
            async move {
                let Some(now) = state else { return Ok(None) };
                if owner.ends() && now.record.ended_ms.is_none() {
                    return Err(Status::unavailable(
                        "the service ends; the operation goes on in the next one: wait again",
                    ));
                }
                let reply = whole(&owner, &now).await?;
                let next = match now.is_done() {
                    true => None,
                    false => Some(owner.changed_operation(&id, HEARTBEAT).await.map_err(status)?),
                };
                Ok(Some((reply, next)))
            }
        });
        Ok(Response::new(updates.boxed()))
    }

    async fn cancel_operation(
        &self,
        request: Request<v1::CancelOperationRequest>,
    ) -> RpcResult<v1::Operation> {
        let owner = self.owner(&request);
        let id = operation::id(&request.into_inner().name).map_err(status)?;
        let found = owner.cancel_operation(&id).await.map_err(status)?;
        Ok(Response::new(whole(&owner, &found).await?))
    }

    async fn delete_operation(&self, request: Request<v1::DeleteOperationRequest>) -> RpcResult<()> {
        let owner = self.owner(&request);
        let id = operation::id(&request.into_inner().name).map_err(status)?;
        owner.delete_operation(&id).await.map_err(status)?;
        Ok(Response::new(()))
    }
}

/// Goes on with what the end of the last service cut short. When this returns, it is seen as running.
pub async fn resume_operations(engine: &Arc<Engine>) {
    let found = engine.cut_operations().await.unwrap_or_else(|error| {
        tracing::error!(%error, "operations of the last service do not go on");
        vec![]
    });
    for cut in found {
        tokio::spawn(cut.resume(async |owner, request| {
            let opened = match operation::kept_work(request) {
                Ok(work) => open(owner, work, HeldBytes::default()).await,
                Err(error) => Err(error),
            };
            opened.unwrap_or_else(|failed| {
                let outcome = operation::outcome(OperationResult::Error(error(failed)));
                stream::iter([OperationUpdate::Done(outcome)]).boxed()
            })
        }));
    }
}

/// An operation with its result, if it is done.
async fn whole(owner: &Engine, found: &OperationStatus) -> Result<v1::Operation, Status> {
    let bytes = match found.is_done() {
        true => owner.operation_result(&found.record.id).await.map_err(status)?,
        false => vec![],
    };
    operation::ended(found, &bytes).map_err(status)
}

/// The status of a task that panicked.
fn failed(error: tokio::task::JoinError) -> Status {
    status(EngineError::Internal { id: "operation".into(), message: error.to_string() })
}

/// Starts the work of an operation.
async fn open(
    owner: &Arc<Engine>,
    work: Work,
    held: HeldBytes,
) -> Result<BoxStream<'static, OperationUpdate>, EngineError> {
    Ok(match work {
        Work::FitModel(given) => updates(calls::fit(owner, given).await?, OperationResult::Fitted),
        Work::CompareModels(given) => {
            updates(calls::compare(owner, given).await?, OperationResult::Comparison)
        }
        Work::DiagnoseModel(given) => {
            updates(calls::diagnose(owner, given).await?, OperationResult::Diagnosis)
        }
        Work::DiscoverEffects(given) => {
            updates(calls::discover(owner, given).await?, OperationResult::Discovery)
        }
        Work::AddEffect(given) => updates(calls::add(owner, given).await?, OperationResult::Revised),
        Work::RemoveEffect(given) => updates(calls::remove(owner, given).await?, OperationResult::Revised),
        Work::WriteReport(given) => {
            updates(calls::write_report(owner, given).await?, OperationResult::Report)
        }
        Work::CreateVideo(given) => updates(calls::import(owner, given, held).await?, OperationResult::Video),
        Work::LearnConcepts(given) => updates(concepts::learn(owner, given).await?, OperationResult::Lexicon),
    })
}

fn updates<R: Send + 'static>(
    call: LongCall<R>,
    result: fn(R) -> OperationResult,
) -> BoxStream<'static, OperationUpdate> {
    let update = move |update: CallUpdate<R>| match update {
        CallUpdate::Progress(at) => OperationUpdate::Progress(at),
        CallUpdate::Done(Ok(found)) => OperationUpdate::Done(operation::outcome(result(found))),
        CallUpdate::Done(Err(failed)) => {
            OperationUpdate::Done(operation::outcome(OperationResult::Error(error(failed))))
        }
    };
    call.map(update).boxed()
}
