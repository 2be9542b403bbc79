//! The service `Reasoning`.

use super::{RpcResult, RpcStream, Services};
use crate::api::convert::reasoning::{question, simulation};
use crate::api::status::{error, status};
use crate::api::v1;
use crate::engine::{Engine, EngineError};
use futures_util::StreamExt;
use std::sync::{Arc, LazyLock};
use tonic::{Request, Response, Streaming};

/// Questions of one stream that run at a time.
const QUESTIONS_AT_ONCE: usize = 4;

#[tonic::async_trait]
impl v1::reasoning_server::Reasoning for Services {
    type AskManyStream = RpcStream<v1::AskManyResponse>;

    async fn simulate(&self, request: Request<v1::SimulateRequest>) -> RpcResult<v1::SimulateResponse> {
        let owner = self.owner(&request);
        let (video, source, options) = simulation::simulate_request(request.into_inner()).map_err(status)?;
        let done = owner.simulate(&video, &source, options).await.map_err(status)?;
        Ok(Response::new(simulation::simulation(&video, &done)))
    }

    async fn ask(&self, request: Request<v1::AskRequest>) -> RpcResult<v1::AskResponse> {
        let owner = self.owner(&request);
        Ok(Response::new(answer(&owner, request.into_inner()).await.map_err(status)?))
    }

    async fn ask_many(&self, request: Request<Streaming<v1::AskRequest>>) -> RpcResult<Self::AskManyStream> {
        let owner = self.owner(&request);
        use v1::ask_many_response::Result as One;
        let engine = owner.clone();
        let answers = request.into_inner().enumerate().map(move |(index, given)| {
            let engine = engine.clone();
            async move {
                let result = match answer(&engine, given?).await {
                    Ok(response) => One::Response(response),
                    Err(failed) => One::Error(error(failed)),
                };
                Ok(v1::AskManyResponse { index: index as u64, result: Some(result) })
            }
        });
        Ok(Response::new(answers.buffered(QUESTIONS_AT_ONCE).boxed()))
    }

    async fn parse_question(
        &self,
        request: Request<v1::ParseQuestionRequest>,
    ) -> RpcResult<v1::ParseQuestionResponse> {
        let owner = self.owner(&request);
        let (video, asked) = question::parse_request(request.into_inner()).map_err(status)?;
        let found = owner.parse_question(video.as_deref(), &asked).await.map_err(status)?;
        Ok(Response::new(question::parsed(found)))
    }

    async fn list_operations(
        &self,
        _: Request<v1::ReasoningListOperationsRequest>,
    ) -> RpcResult<v1::ReasoningListOperationsResponse> {
        static LISTED: LazyLock<v1::ReasoningListOperationsResponse> = LazyLock::new(question::operations);
        Ok(Response::new(LISTED.clone()))
    }
}

async fn answer(engine: &Arc<Engine>, given: v1::AskRequest) -> Result<v1::AskResponse, EngineError> {
    let (video, source, asked, options) = question::ask_request(given)?;
    let done = engine.ask(&video, &source, asked, options).await?;
    Ok(question::answer(&video, &done))
}
