//! Fits of single videos, and the stored models.

use super::cache::JobHandle;
use super::error::EngineError;
use super::metric_names;
use super::model_source::{ModelSource, ModelSourceKind};
use super::pool::{JobContext, JobKind};
use super::progress::{Phase, Report};
use super::results::{StoredFit, result_digest};
use super::state::Engine;
use super::task::{Performed, ReportSink, Task};
use super::traces::file::{self, TraceFile};
use crate::discover::fit_passing_over_pushes;
use crate::fit::{FitOptions, with_draws};
use crate::num::Stop;
use crate::scene::Scene;
use crate::store::TableKind;
use crate::world::Model;
use std::sync::Arc;

/// Fits one video; `id` is the digest of the rest.
struct FitTask {
    video: String,
    id: String,
    scene: Arc<Scene>,
    model: Model,
    options: FitOptions,
}

impl Task for FitTask {
    type Output = StoredFit;

    fn kind(&self) -> JobKind {
        JobKind::Fit
    }

    fn perform(self, report: ReportSink, stop: Stop) -> Result<(StoredFit, Vec<TraceFile>), EngineError> {
        let FitTask { video, id, scene, model, options } = self;
        report(Report::Phase(Phase::Fitting));
        let fit = fit_passing_over_pushes(&scene, &model, &options, stop)?;
        let stored = StoredFit { video, id, revision: 0, fit, record: None };
        let file = file::fit(&scene, &model, &options, &stored)?;
        report(Report::rmse(&stored.fit.scenes));
        Ok((stored, vec![file]))
    }
}

/// Draws from the posterior of a fit.
struct DrawsTask {
    scene: Arc<Scene>,
    fitted: Arc<StoredFit>,
}

impl Task for DrawsTask {
    type Output = StoredFit;

    fn kind(&self) -> JobKind {
        JobKind::Draws
    }

    fn perform(self, _: ReportSink, stop: Stop) -> Result<(StoredFit, Vec<TraceFile>), EngineError> {
        let stored = StoredFit::clone(&self.fitted);
        let fit = with_draws(std::slice::from_ref(self.scene.as_ref()), stored.fit, stop)?;
        Ok((StoredFit { fit, ..stored }, vec![]))
    }
}

impl Engine {
    /// Fits a model to a video, unless a stored fit has the same inputs; the fit is stored before it is returned.
    pub async fn fit(
        self: &Arc<Self>,
        video: &str,
        start: &ModelSource,
        options: FitOptions,
    ) -> Result<JobHandle<StoredFit>, EngineError> {
        let key = self.result_prefix(&[video]);
        let scene = self.video(video).await?;
        let model = start.unfitted(&scene)?;
        let id = result_digest("model", &(video, &model, &options));
        let task = FitTask { video: video.into(), id: id.clone(), scene, model, options };
        let engine = self.clone();
        let work = move |context| async move { engine.run_fit(task, context).await };
        Ok(self.fits.join(format!("{key}{id}"), video, self.deadline(), work).await)
    }

    async fn run_fit(&self, task: FitTask, context: JobContext) -> Result<StoredFit, EngineError> {
        let key = format!("{}/{}", task.video, task.id);
        if let Some(found) = self.store.get(TableKind::Fits, &key).await? {
            metric_names::count_result("fit", "store");
            return Ok(found);
        }
        self.count_fit();
        metric_names::count_result("fit", "made");
        let progress = context.progress.clone();
        let Performed { output: stored, batch, slot: _slot } = self.perform(task, context).await?;
        progress(Report::Phase(Phase::Storing));
        self.publish(batch).await?;
        self.put_of_video(TableKind::Fits, &stored.video, &key, &stored).await?;
        Ok(stored)
    }

    /// A stored model.
    pub async fn model(&self, video: &str, id: &str) -> Result<StoredFit, EngineError> {
        let found = self.store.get(TableKind::Fits, &format!("{video}/{id}")).await?;
        found.ok_or_else(|| EngineError::NotFound { name: format!("videos/{video}/models/{id}") })
    }

    /// A fit with the draws from its posterior that predictions need.
    pub(super) async fn drawn(
        self: &Arc<Self>,
        video: &str,
        scene: &Arc<Scene>,
        source: &ModelSource,
    ) -> Result<Arc<StoredFit>, EngineError> {
        let fitted = match &source.kind {
            ModelSourceKind::Fitted(id) => Arc::new(self.model(video, id).await?),
            _ => self.fit(video, source, FitOptions::default()).await?.finish().await?,
        };
        if fitted.fit.draws() > 0 {
            return Ok(fitted);
        }
        let key = format!("{}{}", self.result_prefix(&[video]), fitted.id);
        let (engine, scene) = (self.clone(), scene.clone());
        let work = move |context| async move {
            metric_names::count_result("draws", "made");
            Ok(engine.perform(DrawsTask { scene, fitted }, context).await?.output)
        };
        self.draws.join(key, video, self.deadline(), work).await.finish().await
    }
}
