//! The services: each call is converted, handed to the engine, and converted back.

use super::status::{error, status};
use super::{camera, reply, report, request, study, trace, v1, video};
use crate::engine::{Engine, EngineError, Inquiry, StoredFit, Study, Tenant, Update, Waiting};
use crate::scene::calibrate;
use futures_util::stream::{self, BoxStream, StreamExt};
use std::future::Future;
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tonic::{Request, Response, Status, Streaming};

/// Questions of one stream that are worked on at a time.
const QUESTIONS_AT_ONCE: usize = 4;
/// How often the progress of a fit is told though it has not changed: a watcher sees that it is alive.
const HEARTBEAT: Duration = Duration::from_secs(1);

type Reply<T> = Result<Response<T>, Status>;
type Items<T> = BoxStream<'static, Result<T, Status>>;

/// All services over one engine.
#[derive(Clone)]
pub struct Services(pub Arc<Engine>);

impl Services {
    /// The engine as the caller's tenant sees it; `Guard` says who that is.
    fn owner<T>(&self, request: &Request<T>) -> Arc<Engine> {
        match request.extensions().get::<Tenant>() {
            Some(tenant) => self.0.of(tenant),
            None => self.0.clone(),
        }
    }
}

#[tonic::async_trait]
impl v1::videos_server::Videos for Services {
    async fn create_video(&self, request: Request<v1::CreateVideoRequest>) -> Reply<v1::Video> {
        let owner = self.owner(&request);
        let given = request.into_inner();
        let request_id = given.request_id.clone();
        let linking = Arc::new(OnceLock::new());
        let told = linking.clone();
        let make = move || {
            let (scene, report) = video::created(given)?;
            // Set once, as it runs once.
            let _ = told.set(report);
            Ok(scene)
        };
        let (id, scene) = owner.create_video(make).await.map_err(status)?;
        tracing::info!(video = id, request_id, "video created");
        let linking = linking.get().and_then(|r| r.as_ref()).map(camera::linking);
        Ok(Response::new(v1::Video { linking, ..video::video(&id, &scene, true) }))
    }

    async fn get_video(&self, request: Request<v1::GetVideoRequest>) -> Reply<v1::Video> {
        let owner = self.owner(&request);
        let id = request::video_id("name", &request.into_inner().name).map_err(status)?;
        let scene = owner.video(&id).await.map_err(status)?;
        Ok(Response::new(video::video(&id, &scene, true)))
    }

    async fn list_videos(&self, request: Request<v1::ListVideosRequest>) -> Reply<v1::ListVideosResponse> {
        let owner = self.owner(&request);
        let given = request.into_inner();
        let (size, after) = request::page(given.page_size, given.page_token).map_err(status)?;
        let mut rows = owner.videos(&after, size + 1).await.map_err(status)?;
        let next_page_token = cut(&mut rows, size, |(id, _)| id);
        let videos = rows.iter().map(|(id, scene)| video::video(id, scene, false)).collect();
        Ok(Response::new(v1::ListVideosResponse { videos, next_page_token }))
    }

    async fn delete_video(&self, request: Request<v1::DeleteVideoRequest>) -> Reply<()> {
        let owner = self.owner(&request);
        let id = request::video_id("name", &request.into_inner().name).map_err(status)?;
        owner.delete_video(&id).await.map_err(status)?;
        Ok(Response::new(()))
    }

    async fn calibrate_camera(
        &self,
        request: Request<v1::CalibrateCameraRequest>,
    ) -> Reply<v1::CalibrateCameraResponse> {
        let owner = self.owner(&request);
        let (pairs, size) = camera::pairs(request.into_inner());
        let work = move || calibrate(&pairs, size).map_err(camera::uncalibrated);
        let found = owner.compute(work).await.map_err(status)?;
        Ok(Response::new(camera::calibration(&found)))
    }
}

#[tonic::async_trait]
impl v1::models_server::Models for Services {
    type FitModelStream = Items<v1::FitModelResponse>;

    async fn fit_model(&self, request: Request<v1::FitModelRequest>) -> Reply<Self::FitModelStream> {
        let owner = self.owner(&request);
        use v1::fit_model_response::Event;
        let given = request.into_inner();
        let (video, others, start, options) = request::fit(given).map_err(status)?;
        let videos = owner.together(&video, others).await.map_err(status)?;
        let progress = |fraction| v1::FitModelResponse {
            event: Some(Event::Progress(v1::FitProgress { fraction })),
            others: vec![],
        };
        if videos.len() == 1 {
            let waiting = owner.fit(&video, &start, options).await.map_err(status)?;
            let done = |fit: &StoredFit| reply::fitted(fit, &[]);
            return updates(waiting, progress, move |fit| Some(done(fit))).await;
        }
        let waiting = owner.fit_together(videos, &start, options).await.map_err(status)?;
        let own = Arc::<str>::from(video);
        updates(waiting, progress, move |fits: &Vec<StoredFit>| {
            let fit = fits.iter().find(|f| *f.video == *own)?;
            let others: Vec<&StoredFit> = fits.iter().filter(|f| *f.video != *own).collect();
            Some(reply::fitted(fit, &others))
        })
        .await
    }

    type CompareModelsStream = Items<v1::CompareModelsResponse>;

    async fn compare_models(
        &self,
        request: Request<v1::CompareModelsRequest>,
    ) -> Reply<Self::CompareModelsStream> {
        let owner = self.owner(&request);
        use v1::compare_models_response::Event;
        let (videos, start) = study::request(request.into_inner().study).map_err(status)?;
        let waiting = owner.study(&videos, &start, Inquiry::Compare).await.map_err(status)?;
        let event = |event| v1::CompareModelsResponse { event: Some(event) };
        let done =
            move |found: &Study| study::comparison(found, &videos).map(|c| event(Event::Comparison(c)));
        updates(waiting, move |f| event(Event::Progress(f)), done).await
    }

    type DiagnoseModelStream = Items<v1::DiagnoseModelResponse>;

    async fn diagnose_model(
        &self,
        request: Request<v1::DiagnoseModelRequest>,
    ) -> Reply<Self::DiagnoseModelStream> {
        let owner = self.owner(&request);
        use v1::diagnose_model_response::Event;
        let (videos, start, inquiry) = study::diagnose(request.into_inner()).map_err(status)?;
        let waiting = owner.study(&videos, &start, inquiry).await.map_err(status)?;
        let event = |event| v1::DiagnoseModelResponse { event: Some(event) };
        let done = move |found: &Study| study::diagnosis(found, &videos).map(|d| event(Event::Diagnosis(d)));
        updates(waiting, move |f| event(Event::Progress(f)), done).await
    }

    type DiscoverEffectsStream = Items<v1::DiscoverEffectsResponse>;

    async fn discover_effects(
        &self,
        request: Request<v1::DiscoverEffectsRequest>,
    ) -> Reply<Self::DiscoverEffectsStream> {
        let owner = self.owner(&request);
        use v1::discover_effects_response::Event;
        let (videos, start, inquiry) = study::discovery(request.into_inner()).map_err(status)?;
        let waiting = owner.study(&videos, &start, inquiry).await.map_err(status)?;
        let event = |event| v1::DiscoverEffectsResponse { event: Some(event) };
        let done = move |found: &Study| study::discovered(found, &videos).map(|d| event(Event::Discovery(d)));
        updates(waiting, move |f| event(Event::Progress(f)), done).await
    }

    type WriteReportStream = Items<v1::WriteReportResponse>;

    async fn write_report(&self, request: Request<v1::WriteReportRequest>) -> Reply<Self::WriteReportStream> {
        let owner = self.owner(&request);
        use v1::write_report_response::Event;
        let asked = report::asked(&owner, request.into_inner()).await.map_err(status)?;
        let report::Asked { waiting, queries, prefix } = asked;
        let event = |event| v1::WriteReportResponse { event: Some(event) };
        let done = async move |found: Arc<Study>| {
            let page = report::written(&owner, &found, queries, prefix).await?;
            Ok(Some(event(Event::Report(page))))
        };
        updates_then(waiting, move |f| event(Event::Progress(f)), done).await
    }

    type AddEffectStream = Items<v1::AddEffectResponse>;

    async fn add_effect(&self, request: Request<v1::AddEffectRequest>) -> Reply<Self::AddEffectStream> {
        let owner = self.owner(&request);
        use v1::add_effect_response::Event;
        let (videos, start, inquiry) = study::addition(request.into_inner()).map_err(status)?;
        let waiting = owner.study(&videos, &start, inquiry).await.map_err(status)?;
        let event = |event| v1::AddEffectResponse { event: Some(event) };
        let done = move |found: &Study| study::revised(found).map(|r| event(Event::Revised(r)));
        updates(waiting, move |f| event(Event::Progress(f)), done).await
    }

    type RemoveEffectStream = Items<v1::RemoveEffectResponse>;

    async fn remove_effect(
        &self,
        request: Request<v1::RemoveEffectRequest>,
    ) -> Reply<Self::RemoveEffectStream> {
        let owner = self.owner(&request);
        use v1::remove_effect_response::Event;
        let (videos, start, inquiry) = study::removal(request.into_inner()).map_err(status)?;
        let waiting = owner.study(&videos, &start, inquiry).await.map_err(status)?;
        let event = |event| v1::RemoveEffectResponse { event: Some(event) };
        let done = move |found: &Study| study::revised(found).map(|r| event(Event::Revised(r)));
        updates(waiting, move |f| event(Event::Progress(f)), done).await
    }

    async fn get_model(&self, request: Request<v1::GetModelRequest>) -> Reply<v1::Model> {
        let owner = self.owner(&request);
        let (video, id) = request::model_name(&request.into_inner().name).map_err(status)?;
        let fit = owner.model(&video, &id).await.map_err(status)?;
        Ok(Response::new(reply::model(&fit)))
    }

    async fn list_models(&self, request: Request<v1::ListModelsRequest>) -> Reply<v1::ListModelsResponse> {
        let owner = self.owner(&request);
        let given = request.into_inner();
        let video = request::video_id("parent", &given.parent).map_err(status)?;
        let (size, after) = request::page(given.page_size, given.page_token).map_err(status)?;
        let mut rows = owner.models(&video, &after, size + 1).await.map_err(status)?;
        let next_page_token = cut(&mut rows, size, |fit| &fit.id);
        let models = rows.iter().map(reply::model).collect();
        Ok(Response::new(v1::ListModelsResponse { models, next_page_token }))
    }

    async fn list_effects(&self, _: Request<v1::ListEffectsRequest>) -> Reply<v1::ListEffectsResponse> {
        Ok(Response::new(v1::ListEffectsResponse { effects: reply::effects() }))
    }
}

#[tonic::async_trait]
impl v1::reasoning_server::Reasoning for Services {
    type AskManyStream = Items<v1::AskManyResponse>;

    async fn simulate(&self, request: Request<v1::SimulateRequest>) -> Reply<v1::SimulateResponse> {
        let owner = self.owner(&request);
        let (video, choice, options) = request::simulate(request.into_inner()).map_err(status)?;
        let done = owner.simulate(&video, &choice, options).await.map_err(status)?;
        Ok(Response::new(reply::simulation(&video, &done)))
    }

    async fn ask(&self, request: Request<v1::AskRequest>) -> Reply<v1::AskResponse> {
        let owner = self.owner(&request);
        Ok(Response::new(answer(&owner, request.into_inner()).await.map_err(status)?))
    }

    async fn ask_many(&self, request: Request<Streaming<v1::AskRequest>>) -> Reply<Self::AskManyStream> {
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
}

/// What is refused at once is no stream: then clients may try again by themselves.
const AT_ONCE: Duration = Duration::from_millis(30);

/// Progress, then the result. The stream owns the place at the work: a caller who leaves gives it up.
async fn updates<T: Send + Sync + 'static, M: Send + 'static>(
    waiting: Waiting<T>,
    progress: impl Fn(f64) -> M + Copy + Send + 'static,
    done: impl Fn(&T) -> Option<M> + Send + 'static,
) -> Reply<Items<M>> {
    updates_then(waiting, progress, move |found: Arc<T>| std::future::ready(Ok(done(&found)))).await
}

/// The same where the result is made of what was found.
async fn updates_then<T, M, F>(
    waiting: Waiting<T>,
    progress: impl Fn(f64) -> M + Copy + Send + 'static,
    done: impl FnOnce(Arc<T>) -> F + Send + 'static,
) -> Reply<Items<M>>
where
    T: Send + Sync + 'static,
    M: Send + 'static,
    F: Future<Output = Result<Option<M>, EngineError>> + Send,
{
    if let Some(error) = waiting.refused(AT_ONCE).await {
        return Err(status(error));
    }
    let updates = stream::unfold(Some((waiting, done, false)), move |at| async move {
        let (mut waiting, done, told) = at?;
        let update = match waiting.ready() {
            Some(outcome) => Update::Done(outcome),
            None => waiting.news(HEARTBEAT).await,
        };
        Some(match update {
            Update::Progress(fraction) => (Ok(progress(fraction)), Some((waiting, done, true))),
            // However fast it was, progress comes before the result.
            Update::Done(Ok(_)) if !told => (Ok(progress(1.0)), Some((waiting, done, true))),
            Update::Done(Ok(found)) => {
                let other = || Status::internal("the work has another result than was asked for");
                (done(found).await.map_err(status).and_then(|made| made.ok_or_else(other)), None)
            }
            Update::Done(Err(error)) => (Err(status(error)), None),
        })
    });
    Ok(Response::new(updates.boxed()))
}

async fn answer(engine: &Arc<Engine>, given: v1::AskRequest) -> Result<v1::AskResponse, EngineError> {
    let (video, choice, question, options) = request::ask(given)?;
    let done = engine.ask(&video, &choice, question, options).await?;
    Ok(reply::answer(&video, &done))
}

#[tonic::async_trait]
impl v1::statistics_server::Statistics for Services {
    async fn get_statistics(
        &self,
        request: Request<v1::GetStatisticsRequest>,
    ) -> Reply<v1::ServiceStatistics> {
        Ok(Response::new(reply::statistics(&self.owner(&request))))
    }
}

#[tonic::async_trait]
impl v1::traces_server::Traces for Services {
    type DownloadTraceStream = Items<v1::DownloadTraceResponse>;

    async fn list_traces(&self, request: Request<v1::ListTracesRequest>) -> Reply<v1::ListTracesResponse> {
        let owner = self.owner(&request);
        let (filter, size, after) = trace::list(request.into_inner()).map_err(status)?;
        let mut rows = owner.traces(filter, &after, size + 1).await.map_err(status)?;
        let next_page_token = cut(&mut rows, size, |record| &record.id);
        let traces = rows.into_iter().map(trace::trace).collect();
        Ok(Response::new(v1::ListTracesResponse { traces, next_page_token }))
    }

    async fn download_trace(
        &self,
        request: Request<v1::DownloadTraceRequest>,
    ) -> Reply<Self::DownloadTraceStream> {
        let owner = self.owner(&request);
        let id = request::trace_id("name", &request.into_inner().name).map_err(status)?;
        let download = owner.download(&id).await.map_err(status)?;
        let chunks = stream::try_unfold(download, async |mut download| {
            let (offset, data) = download.next().await.map_err(status)?;
            let reply = v1::DownloadTraceResponse { offset, data: data.into() };
            Ok((!reply.data.is_empty()).then_some((reply, download)))
        });
        Ok(Response::new(chunks.boxed()))
    }

    type ReplayTraceStream = Items<v1::ReplayTraceResponse>;

    async fn replay_trace(&self, request: Request<v1::ReplayTraceRequest>) -> Reply<Self::ReplayTraceStream> {
        let owner = self.owner(&request);
        let (id, options) = trace::replay(request.into_inner()).map_err(status)?;
        let replay = owner.replay(&id, options).await.map_err(status)?;
        let items = stream::unfold(replay, |mut replay| async move {
            let item = replay.next().await?;
            let reply = item.map(|(round, time, item)| trace::played(round, time, item)).map_err(status);
            Some((reply, replay))
        });
        Ok(Response::new(items.boxed()))
    }
}

/// Cuts the rows to a page; the token of the next one, if there is more.
fn cut<T>(rows: &mut Vec<T>, size: usize, id: impl Fn(&T) -> &String) -> String {
    if rows.len() <= size {
        return String::new();
    }
    rows.truncate(size);
    rows.last().map(|row| id(row).clone()).unwrap_or_default()
}
