//! Videos: stored once under the digest of their content, read, listed and deleted.

use super::error::EngineError;
use super::pool::{JobContext, JobKind};
use super::progress::Report;
use super::state::Engine;
use crate::media::{Still, Video};
use crate::num::Stop;
use crate::perception::{Perception, PerceptionError, PerceptionOptions, PerceptionReport, perceive};
use crate::scene::Scene;
use crate::store::TableKind;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;

impl Engine {
    /// Stores the scene that `make` returns, with stills of its video, and returns its id. The id is a digest of the scene alone,
    /// so storing the same scene again changes nothing but the stills, if it has any.
    pub async fn create_video<F>(&self, make: F) -> Result<(String, Arc<Scene>), EngineError>
    where
        F: FnOnce(Stop) -> Result<(Scene, Vec<Still>), EngineError> + Send + 'static,
    {
        self.create_video_as(JobKind::Conversion, make).await
    }

    /// The same as a job of that kind; its stop token says when its deadline has passed or its caller has left.
    pub async fn create_video_as<F>(
        &self,
        kind: JobKind,
        make: F,
    ) -> Result<(String, Arc<Scene>), EngineError>
    where
        F: FnOnce(Stop) -> Result<(Scene, Vec<Still>), EngineError> + Send + 'static,
    {
        let convert = move |stop: Stop| {
            let (scene, stills) = make(stop)?;
            Ok((scene.digest(), scene, stills))
        };
        let ((id, scene, stills), _slot) =
            self.pool.run((&self.tenant, kind), self.uncancelled(), convert).await?;
        self.put_video(&id, &scene, stills).await?;
        Ok((id, Arc::new(scene)))
    }

    async fn put_video(&self, id: &str, scene: &Scene, stills: Vec<Still>) -> Result<(), EngineError> {
        self.store.put_video(id, scene).await?;
        match stills.is_empty() {
            true => Ok(()),
            false => self.put_of_video(TableKind::Stills, id, &stills_key(id), &stills).await,
        }
    }

    /// Stills of a video, by frame; none of one that was not made from a video file.
    pub async fn stills(&self, id: &str) -> Result<Vec<Still>, EngineError> {
        Ok(self.store.get(TableKind::Stills, &stills_key(id)).await?.unwrap_or_default())
    }

    /// Finds the objects of a video file and stores their tracks and a few frames. `token` stops the work.
    pub async fn import_video(
        &self,
        bytes: Vec<u8>,
        (setup, options): (Option<String>, PerceptionOptions),
        token: CancellationToken,
        progress: Arc<dyn Fn(Report) + Send + Sync>,
    ) -> Result<(String, Arc<Scene>, PerceptionReport), EngineError> {
        let context = JobContext { token, deadline: self.deadline(), progress };
        let work = move |stop: Stop| {
            let video = Video::open(bytes).map_err(|e| EngineError::invalid("data", e.to_string()))?;
            let Perception { scene, report, stills } =
                perceive(&video, &options, stop).map_err(|e| match e {
                    PerceptionError::Stopped(stopped) => stopped.into(),
                    e => EngineError::invalid("data", e.to_string()),
                })?;
            let checked = Scene { setup, ..scene }.validate_until(stop)?;
            let scene = checked.map_err(|e| EngineError::Invalid(e.violations))?;
            Ok((scene.digest(), scene, report, stills))
        };
        let ((id, scene, report, stills), _slot) =
            self.pool.run((&self.tenant, JobKind::Perception), context, work).await?;
        self.put_video(&id, &scene, stills).await?;
        Ok((id, Arc::new(scene), report))
    }

    pub async fn video(&self, id: &str) -> Result<Arc<Scene>, EngineError> {
        let key = format!("{}{id}", self.result_prefix(&[id]));
        if let Some(scene) = self.scenes.get(&key) {
            return Ok(scene);
        }
        let found = self.store.get::<Scene>(TableKind::Videos, id).await?;
        let scene = Arc::new(found.ok_or_else(|| EngineError::no_video(id))?);
        self.scenes.insert(key, scene.clone());
        Ok(scene)
    }

    /// Deletes a video with its models and traces.
    pub async fn delete_video(&self, id: &str) -> Result<(), EngineError> {
        match self.store.delete_video(id).await {
            Ok(false) => Err(EngineError::no_video(id)),
            // It is gone, or may be.
            found => {
                self.forget_video(id);
                if found.is_err() {
                    self.retention.look_for_orphans();
                }
                found?;
                Ok(())
            }
        }
    }
}

/// The key of the stills of a video.
fn stills_key(id: &str) -> String {
    format!("{id}/stills")
}
