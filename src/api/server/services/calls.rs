//! The long calls: each from its request to its job, and from what the job found to its result.

use super::updates::{LongCall, long_call, long_call_of};
use super::{comparison, report};
use crate::api::convert::ingest::detections::linking_message;
use crate::api::convert::ingest::new_video::{NewVideo, new_video};
use crate::api::convert::video::video_message;
use crate::api::convert::violations::check_request_id;
use crate::api::convert::{findings, model, study};
use crate::api::server::byte_budget::HeldBytes;
use crate::api::v1;
use crate::engine::{Engine, EngineError, JobKind, StoredFit, Study, StudyKind};
use crate::num::Stop;
use std::sync::{Arc, OnceLock};

/// Detections up to which an upload is short work: more than usual videos have.
const SHORT_DETECTIONS: usize = 2_000;

type Started<R> = Result<LongCall<R>, EngineError>;
type Owner = Arc<Engine>;

/// The model of the video, and those that were fitted together with it.
pub async fn fit(owner: &Owner, given: v1::FitModelRequest) -> Started<v1::FittedModels> {
    let (video, others, start, options) = model::fit_request(given)?;
    let videos = owner.joint_videos(&video, others).await?;
    if videos.len() == 1 {
        let job = owner.fit(&video, &start, options).await?;
        return long_call(job, async |fit: Arc<StoredFit>| Ok(model::fitted(&fit, &[]))).await;
    }
    let job = owner.fit_joint(videos, &start, options).await?;
    let result = async move |fits: Arc<Vec<StoredFit>>| {
        let fit = fits.iter().find(|f| f.video == video).ok_or_else(other_result)?;
        let others: Vec<&StoredFit> = fits.iter().filter(|f| f.video != video).collect();
        Ok(model::fitted(fit, &others))
    };
    long_call(job, result).await
}

pub async fn compare(owner: &Owner, given: v1::CompareModelsRequest) -> Started<v1::Comparison> {
    let (videos, start) = study::request(given.study)?;
    let other = comparison::other_side(&videos, given.against)?;
    let job = owner.study(&videos, &start, StudyKind::Compare).await?;
    let owner = owner.clone();
    let result = async move |s: Arc<Study>| {
        let alone = findings::comparison(&s, &videos).ok_or_else(other_result)?;
        match other {
            None => Ok(alone),
            Some(other) => comparison::with_difference(&owner, alone, &videos, &start, other).await,
        }
    };
    long_call(job, result).await
}

pub async fn diagnose(owner: &Owner, given: v1::DiagnoseModelRequest) -> Started<v1::Diagnosis> {
    let (videos, start, kind) = study::diagnose(given)?;
    let job = owner.study(&videos, &start, kind).await?;
    long_call(job, async move |s: Arc<Study>| findings::diagnosis(&s, &videos).ok_or_else(other_result)).await
}

pub async fn discover(owner: &Owner, given: v1::DiscoverEffectsRequest) -> Started<v1::Discovery> {
    let (videos, start, kind) = study::discovery(given)?;
    let job = owner.study(&videos, &start, kind).await?;
    long_call(job, async move |s: Arc<Study>| findings::discovered(&s, &videos).ok_or_else(other_result))
        .await
}

pub async fn add(owner: &Owner, given: v1::AddEffectRequest) -> Started<v1::RevisedModels> {
    let (videos, start, kind) = study::addition(given)?;
    let job = owner.study(&videos, &start, kind).await?;
    long_call(job, async |s: Arc<Study>| findings::revised(&s).ok_or_else(other_result)).await
}

pub async fn remove(owner: &Owner, given: v1::RemoveEffectRequest) -> Started<v1::RevisedModels> {
    let (videos, start, kind) = study::removal(given)?;
    let job = owner.study(&videos, &start, kind).await?;
    long_call(job, async |s: Arc<Study>| findings::revised(&s).ok_or_else(other_result)).await
}

pub async fn write_report(owner: &Owner, given: v1::WriteReportRequest) -> Started<v1::Report> {
    let maker = owner.clone();
    if given.as_is {
        let asked = report::as_is_request(given)?;
        return long_call_of(async move { report::written_as_is(&maker, asked).await }).await;
    }
    let report::ReportRequest { job, contents } = report::report_request(owner, given).await?;
    let owner = maker;
    long_call(job, async move |s: Arc<Study>| report::written(&owner, &s, contents).await).await
}

/// Stores a video, without samples in its result.
pub async fn import(owner: &Owner, given: v1::CreateVideoRequest, held: HeldBytes) -> Started<v1::Video> {
    let owner = owner.clone();
    long_call_of(async move {
        let mut video = create_video(&owner, given, held).await?;
        video.times.clear();
        video.objects.iter_mut().for_each(|object| object.samples.clear());
        Ok(video)
    })
    .await
}

/// Stores a video. The work holds the reservation of its bytes, as it goes on for a moment where its caller leaves.
pub async fn create_video(
    owner: &Owner,
    given: v1::CreateVideoRequest,
    held: HeldBytes,
) -> Result<v1::Video, EngineError> {
    check_request_id(&given.request_id)?;
    let request_id = given.request_id.clone();
    let made = Arc::new(OnceLock::new());
    let report_to = made.clone();
    let is_large = given.detections.len() > SHORT_DETECTIONS;
    let kind = if is_large { JobKind::Linking } else { JobKind::Conversion };
    let make = move |stop: Stop| {
        let _held = held;
        let NewVideo { scene, stills, report } = new_video(given, stop)?;
        // The closure runs once, so the cell is empty.
        let _ = report_to.set(report);
        Ok((scene, stills))
    };
    let (id, scene) = owner.create_video_as(kind, make).await?;
    tracing::info!(video = id, request_id, "video created");
    let linking = made.get().and_then(|made| made.linking.as_ref()).map(linking_message);
    let assumptions = made.get().map(|made| made.assumptions.clone()).unwrap_or_default();
    Ok(v1::Video { linking, assumptions, ..video_message(&id, &scene, true) })
}

fn other_result() -> EngineError {
    let message = "the job has another kind of result than the request".into();
    EngineError::Internal { id: "result".into(), message }
}
