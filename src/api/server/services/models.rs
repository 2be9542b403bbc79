//! The service `Models`.

use super::updates::replies;
use super::{RpcResult, RpcStream, Services, calls};
use crate::api::convert::violations::model_ids_of;
use crate::api::convert::{listing, model};
use crate::api::status::status;
use crate::api::v1;
use crate::engine::TimedRow;
use tonic::{Request, Response};

#[tonic::async_trait]
impl v1::models_server::Models for Services {
    type FitModelStream = RpcStream<v1::FitModelResponse>;

    async fn fit_model(&self, request: Request<v1::FitModelRequest>) -> RpcResult<Self::FitModelStream> {
        use v1::fit_model_response::Event;
        let call = calls::fit(&self.owner(&request), request.into_inner()).await;
        let progress = |status: v1::Progress| {
            let event = Some(Event::Progress(v1::FitProgress { fraction: status.fraction }));
            v1::FitModelResponse { event, status: Some(status), others: vec![] }
        };
        let done = |v1::FittedModels { model, others }| v1::FitModelResponse {
            event: model.map(Event::Model),
            others,
            status: None,
        };
        replies(call, progress, done)
    }

    type CompareModelsStream = RpcStream<v1::CompareModelsResponse>;

    async fn compare_models(
        &self,
        request: Request<v1::CompareModelsRequest>,
    ) -> RpcResult<Self::CompareModelsStream> {
        use v1::compare_models_response::Event;
        let call = calls::compare(&self.owner(&request), request.into_inner()).await;
        let progress = |status: v1::Progress| v1::CompareModelsResponse {
            event: Some(Event::Progress(status.fraction)),
            status: Some(status),
        };
        replies(call, progress, |found| v1::CompareModelsResponse {
            event: Some(Event::Comparison(found)),
            status: None,
        })
    }

    type DiagnoseModelStream = RpcStream<v1::DiagnoseModelResponse>;

    async fn diagnose_model(
        &self,
        request: Request<v1::DiagnoseModelRequest>,
    ) -> RpcResult<Self::DiagnoseModelStream> {
        use v1::diagnose_model_response::Event;
        let call = calls::diagnose(&self.owner(&request), request.into_inner()).await;
        let progress = |status: v1::Progress| v1::DiagnoseModelResponse {
            event: Some(Event::Progress(status.fraction)),
            status: Some(status),
        };
        replies(call, progress, |found| v1::DiagnoseModelResponse {
            event: Some(Event::Diagnosis(found)),
            status: None,
        })
    }

    type DiscoverEffectsStream = RpcStream<v1::DiscoverEffectsResponse>;

    async fn discover_effects(
        &self,
        request: Request<v1::DiscoverEffectsRequest>,
    ) -> RpcResult<Self::DiscoverEffectsStream> {
        use v1::discover_effects_response::Event;
        let call = calls::discover(&self.owner(&request), request.into_inner()).await;
        let progress = |status: v1::Progress| v1::DiscoverEffectsResponse {
            event: Some(Event::Progress(status.fraction)),
            status: Some(status),
        };
        replies(call, progress, |found| v1::DiscoverEffectsResponse {
            event: Some(Event::Discovery(found)),
            status: None,
        })
    }

    type WriteReportStream = RpcStream<v1::WriteReportResponse>;

    async fn write_report(
        &self,
        request: Request<v1::WriteReportRequest>,
    ) -> RpcResult<Self::WriteReportStream> {
        use v1::write_report_response::Event;
        let call = calls::write_report(&self.owner(&request), request.into_inner()).await;
        let progress = |status: v1::Progress| v1::WriteReportResponse {
            event: Some(Event::Progress(status.fraction)),
            status: Some(status),
        };
        replies(call, progress, |found| v1::WriteReportResponse {
            event: Some(Event::Report(found)),
            status: None,
        })
    }

    type AddEffectStream = RpcStream<v1::AddEffectResponse>;

    async fn add_effect(&self, request: Request<v1::AddEffectRequest>) -> RpcResult<Self::AddEffectStream> {
        use v1::add_effect_response::Event;
        let call = calls::add(&self.owner(&request), request.into_inner()).await;
        let progress = |status: v1::Progress| v1::AddEffectResponse {
            event: Some(Event::Progress(status.fraction)),
            status: Some(status),
        };
        replies(call, progress, |found| v1::AddEffectResponse {
            event: Some(Event::Revised(found)),
            status: None,
        })
    }

    type RemoveEffectStream = RpcStream<v1::RemoveEffectResponse>;

    async fn remove_effect(
        &self,
        request: Request<v1::RemoveEffectRequest>,
    ) -> RpcResult<Self::RemoveEffectStream> {
        use v1::remove_effect_response::Event;
        let call = calls::remove(&self.owner(&request), request.into_inner()).await;
        let progress = |status: v1::Progress| v1::RemoveEffectResponse {
            event: Some(Event::Progress(status.fraction)),
            status: Some(status),
        };
        replies(call, progress, |found| v1::RemoveEffectResponse {
            event: Some(Event::Revised(found)),
            status: None,
        })
    }

    async fn get_model(&self, request: Request<v1::GetModelRequest>) -> RpcResult<v1::Model> {
        let owner = self.owner(&request);
        let given = request.into_inner();
        let (video, id) = model_ids_of(&given.name).map_err(status)?;
        let mask = listing::mask(given.read_mask, "Model").map_err(status)?;
        let value = owner.model(&video, &id).await.map_err(status)?;
        let created_ms = owner.model_created_ms(&video, &id).await.map_err(status)?;
        let covariance = given.covariance.then(|| model::covariance(&value)).flatten();
        let row = TimedRow { key: id, value, created_ms };
        let found = v1::Model { covariance, ..listing::listed_model(&row) };
        Ok(Response::new(mask.apply(found)))
    }

    async fn list_models(
        &self,
        request: Request<v1::ListModelsRequest>,
    ) -> RpcResult<v1::ListModelsResponse> {
        let owner = self.owner(&request);
        let (video, asked) = listing::models(request.into_inner()).map_err(status)?;
        let listed = owner.list_models(&video, asked.filter, &asked.after, asked.size).await;
        let listed = listed.map_err(status)?;
        let models = listed.rows.iter().map(|row| asked.mask.apply(listing::listed_model(row))).collect();
        // Its key has the video before the id.
        let next = listed.next.as_ref().and_then(|key| key.split_once('/'));
        let next_page_token = next.map(|(_, id)| id.to_string()).unwrap_or_default();
        let unreadable_count = listed.unreadable as u32;
        Ok(Response::new(v1::ListModelsResponse { models, next_page_token, unreadable_count }))
    }

    async fn list_revisions(
        &self,
        request: Request<v1::ListRevisionsRequest>,
    ) -> RpcResult<v1::ListRevisionsResponse> {
        let owner = self.owner(&request);
        let asked = listing::revisions(request.into_inner()).map_err(status)?;
        let listed = owner.list_revisions(asked.filter, &asked.after, asked.size).await.map_err(status)?;
        let next_page_token = listing::token(&listed.next.unwrap_or_default());
        let revisions = listed.rows.iter().filter_map(listing::listed_revision);
        let revisions = revisions.map(|revision| asked.mask.apply(revision)).collect();
        let unreadable_count = listed.unreadable as u32;
        Ok(Response::new(v1::ListRevisionsResponse { revisions, next_page_token, unreadable_count }))
    }

    async fn list_effects(&self, _: Request<v1::ListEffectsRequest>) -> RpcResult<v1::ListEffectsResponse> {
        Ok(Response::new(v1::ListEffectsResponse { effects: model::effects() }))
    }
}
