//! Fits of single videos, and the stored models.

use super::cache::JobHandle;
use super::error::EngineError;
use super::metric_names;
use super::model_source::{ModelSource, ModelSourceKind};
use super::pool::JobContext;
use super::progress::{Phase, Report};
use super::results::{StoredFit, result_digest};
use super::state::Engine;
use super::traces::file;
use crate::discover::fit_passing_over_pushes;
use crate::fit::{FitOptions, with_draws};
use crate::num::Stop;
use crate::scene::Scene;
use crate::store::TableKind;
use crate::world::Model;
use std::sync::Arc;

/// What one fit needs; `id` is the digest of the rest.
struct FitInput {
    video: String,
    id: String,
    scene: Arc<Scene>,
    model: Model,
    options: FitOptions,
}

impl Engine {
    /// Fits a model to a video, unless a stored fit has the same inputs; the fit is stored before it is returned.
    pub async fn fit(
        self: &Arc<Self>,
        video: &str,
        start: &ModelSource,
        options: FitOptions,
    ) -> Result<JobHandle<StoredFit>, EngineError> {
        let key = self.key("");
        let scene = self.video(video).await?;
        let model = start.unfitted(&scene)?;
        let id = result_digest("model", &(video, &model, &options));
        let input = FitInput { video: video.into(), id: id.clone(), scene, model, options };
        let engine = self.clone();
        let work = move |context| async move { engine.run_fit(input, context).await };
        Ok(self.fits.join(format!("{key}{id}"), video, self.deadline(), work).await)
    }

    async fn run_fit(&self, input: FitInput, context: JobContext) -> Result<StoredFit, EngineError> {
        let FitInput { video, id, scene, model, options } = input;
        let key = format!("{video}/{id}");
        if let Some(found) = self.store.get(TableKind::Fits, &key).await? {
            metric_names::count_result("fit", "store");
            return Ok(found);
        }
        self.count_fit();
        metric_names::count_result("fit", "made");
        let backlog = self.backlog.clone();
        let report = context.progress.clone();
        let job = move |stop: Stop| {
            report(Report::Phase(Phase::Fitting));
            let fit = fit_passing_over_pushes(&scene, &model, &options, stop)?;
            let stored = StoredFit { video, id, revision: 0, fit, record: None };
            let file = file::fit(&scene, &model, &options, &stored)?;
            report(Report::rmse(&stored.fit.scenes));
            Ok((stored, backlog.admit(vec![file], stop)?))
        };
        let progress = context.progress.clone();
        let ((stored, batch), _slot) = self.pool.run(context, job).await?;
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

    /// Up to `limit` models of a video after the one with the id `after`, by id.
    pub async fn models(
        &self,
        video: &str,
        after: &str,
        limit: usize,
    ) -> Result<Vec<StoredFit>, EngineError> {
        self.video(video).await?;
        let prefix = format!("{video}/");
        let after = format!("{prefix}{after}");
        let rows = self.store.list(TableKind::Fits, &prefix, &after, limit, |_: &StoredFit| true).await?;
        Ok(rows.into_iter().map(|(_, fit)| fit).collect())
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
        let key = self.key(&fitted.id);
        let (engine, scene) = (self.clone(), scene.clone());
        let work = move |context| async move {
            metric_names::count_result("draws", "made");
            let job = move |stop: Stop| {
                let stored = StoredFit::clone(&fitted);
                let fit = with_draws(std::slice::from_ref(scene.as_ref()), stored.fit, stop)?;
                Ok(StoredFit { fit, ..stored })
            };
            Ok(engine.pool.run(context, job).await?.0)
        };
        self.draws.join(key, video, self.deadline(), work).await.finish().await
    }
}
