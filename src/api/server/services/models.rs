//! The service `Models`.

use super::updates::{updates, updates_then};
use super::{RpcResult, RpcStream, Services, cut_page, report};
use crate::api::convert::violations::{model_ids_of, page, video_id};
use crate::api::convert::{findings, model, study};
use crate::api::status::status;
use crate::api::v1;
use crate::engine::{StoredFit, Study, StudyKind};
use std::sync::Arc;
use tonic::{Request, Response};

#[tonic::async_trait]
impl v1::models_server::Models for Services {
    type FitModelStream = RpcStream<v1::FitModelResponse>;

    async fn fit_model(&self, request: Request<v1::FitModelRequest>) -> RpcResult<Self::FitModelStream> {
        let owner = self.owner(&request);
        use v1::fit_model_response::Event;
        let given = request.into_inner();
        let (video, others, start, options) = model::fit_request(given).map_err(status)?;
        let videos = owner.joint_videos(&video, others).await.map_err(status)?;
        let progress = |fraction| v1::FitModelResponse {
            event: Some(Event::Progress(v1::FitProgress { fraction })),
            others: vec![],
        };
        if videos.len() == 1 {
            let job = owner.fit(&video, &start, options).await.map_err(status)?;
            let done = |fit: &StoredFit| model::fitted(fit, &[]);
            return updates(job, progress, move |fit| Some(done(fit))).await;
        }
        let job = owner.fit_joint(videos, &start, options).await.map_err(status)?;
        let own = Arc::<str>::from(video);
        updates(job, progress, move |fits: &Vec<StoredFit>| {
            let fit = fits.iter().find(|f| *f.video == *own)?;
            let others: Vec<&StoredFit> = fits.iter().filter(|f| *f.video != *own).collect();
            Some(model::fitted(fit, &others))
        })
        .await
    }

    type CompareModelsStream = RpcStream<v1::CompareModelsResponse>;

    async fn compare_models(
        &self,
        request: Request<v1::CompareModelsRequest>,
    ) -> RpcResult<Self::CompareModelsStream> {
        let owner = self.owner(&request);
        use v1::compare_models_response::Event;
        let (videos, start) = study::request(request.into_inner().study).map_err(status)?;
        let job = owner.study(&videos, &start, StudyKind::Compare).await.map_err(status)?;
        let event = |event| v1::CompareModelsResponse { event: Some(event) };
        let done =
            move |found: &Study| findings::comparison(found, &videos).map(|c| event(Event::Comparison(c)));
        updates(job, move |f| event(Event::Progress(f)), done).await
    }

    type DiagnoseModelStream = RpcStream<v1::DiagnoseModelResponse>;

    async fn diagnose_model(
        &self,
        request: Request<v1::DiagnoseModelRequest>,
    ) -> RpcResult<Self::DiagnoseModelStream> {
        let owner = self.owner(&request);
        use v1::diagnose_model_response::Event;
        let (videos, start, kind) = study::diagnose(request.into_inner()).map_err(status)?;
        let job = owner.study(&videos, &start, kind).await.map_err(status)?;
        let event = |event| v1::DiagnoseModelResponse { event: Some(event) };
        let done =
            move |found: &Study| findings::diagnosis(found, &videos).map(|d| event(Event::Diagnosis(d)));
        updates(job, move |f| event(Event::Progress(f)), done).await
    }

    type DiscoverEffectsStream = RpcStream<v1::DiscoverEffectsResponse>;

    async fn discover_effects(
        &self,
        request: Request<v1::DiscoverEffectsRequest>,
    ) -> RpcResult<Self::DiscoverEffectsStream> {
        let owner = self.owner(&request);
        use v1::discover_effects_response::Event;
        let (videos, start, kind) = study::discovery(request.into_inner()).map_err(status)?;
        let job = owner.study(&videos, &start, kind).await.map_err(status)?;
        let event = |event| v1::DiscoverEffectsResponse { event: Some(event) };
        let done =
            move |found: &Study| findings::discovered(found, &videos).map(|d| event(Event::Discovery(d)));
        updates(job, move |f| event(Event::Progress(f)), done).await
    }

    type WriteReportStream = RpcStream<v1::WriteReportResponse>;

    async fn write_report(
        &self,
        request: Request<v1::WriteReportRequest>,
    ) -> RpcResult<Self::WriteReportStream> {
        let owner = self.owner(&request);
        use v1::write_report_response::Event;
        let asked = report::report_request(&owner, request.into_inner()).await.map_err(status)?;
        let report::ReportRequest { job, questions, prefix } = asked;
        let event = |event| v1::WriteReportResponse { event: Some(event) };
        let done = async move |found: Arc<Study>| {
            let page = report::written(&owner, &found, questions, prefix).await?;
            Ok(Some(event(Event::Report(page))))
        };
        updates_then(job, move |f| event(Event::Progress(f)), done).await
    }

    type AddEffectStream = RpcStream<v1::AddEffectResponse>;

    async fn add_effect(&self, request: Request<v1::AddEffectRequest>) -> RpcResult<Self::AddEffectStream> {
        let owner = self.owner(&request);
        use v1::add_effect_response::Event;
        let (videos, start, kind) = study::addition(request.into_inner()).map_err(status)?;
        let job = owner.study(&videos, &start, kind).await.map_err(status)?;
        let event = |event| v1::AddEffectResponse { event: Some(event) };
        let done = move |found: &Study| findings::revised(found).map(|r| event(Event::Revised(r)));
        updates(job, move |f| event(Event::Progress(f)), done).await
    }

    type RemoveEffectStream = RpcStream<v1::RemoveEffectResponse>;

    async fn remove_effect(
        &self,
        request: Request<v1::RemoveEffectRequest>,
    ) -> RpcResult<Self::RemoveEffectStream> {
        let owner = self.owner(&request);
        use v1::remove_effect_response::Event;
        let (videos, start, kind) = study::removal(request.into_inner()).map_err(status)?;
        let job = owner.study(&videos, &start, kind).await.map_err(status)?;
        let event = |event| v1::RemoveEffectResponse { event: Some(event) };
        let done = move |found: &Study| findings::revised(found).map(|r| event(Event::Revised(r)));
        updates(job, move |f| event(Event::Progress(f)), done).await
    }

    async fn get_model(&self, request: Request<v1::GetModelRequest>) -> RpcResult<v1::Model> {
        let owner = self.owner(&request);
        let (video, id) = model_ids_of(&request.into_inner().name).map_err(status)?;
        let fit = owner.model(&video, &id).await.map_err(status)?;
        Ok(Response::new(model::model(&fit)))
    }

    async fn list_models(
        &self,
        request: Request<v1::ListModelsRequest>,
    ) -> RpcResult<v1::ListModelsResponse> {
        let owner = self.owner(&request);
        let given = request.into_inner();
        let video = video_id("parent", &given.parent).map_err(status)?;
        let (size, after) = page(given.page_size, given.page_token).map_err(status)?;
        let mut rows = owner.models(&video, &after, size + 1).await.map_err(status)?;
        let next_page_token = cut_page(&mut rows, size, |fit| &fit.id);
        let models = rows.iter().map(model::model).collect();
        Ok(Response::new(v1::ListModelsResponse { models, next_page_token }))
    }

    async fn list_effects(&self, _: Request<v1::ListEffectsRequest>) -> RpcResult<v1::ListEffectsResponse> {
        Ok(Response::new(v1::ListEffectsResponse { effects: model::effects() }))
    }
}
