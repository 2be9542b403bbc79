//! Joint fits of several videos of one set-up: they share its physics, keep their own motion, and each gets its model.

use super::cache::JobHandle;
use super::error::EngineError;
use super::limits::MAX_STUDY_VIDEOS;
use super::listings::VideoFilter;
use super::metric_names;
use super::model_source::ModelSource;
use super::pool::{JobContext, JobKind};
use super::progress::{Phase, Report};
use super::results::{StoredFit, result_digest};
use super::state::Engine;
use super::task::{Performed, ReportSink, Task};
use super::traces::file::{self, TraceFile};
use crate::fit::{FitError, FitOptions, fit};
use crate::num::Stop;
use crate::scene::{Scene, canonical_digest};
use crate::store::TableKind;
use crate::world::Model;
use std::collections::BTreeSet;
use std::sync::Arc;

/// The videos that are fitted together with a video.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum JointVideos {
    /// Their ids; none: the video is fitted alone.
    Named(Vec<String>),
    /// All stored videos that name the same set-up.
    Setup,
}

/// Fits videos together; all lists are by video, and `id` is the digest of the rest.
struct JointTask {
    id: String,
    videos: Vec<String>,
    scenes: Vec<Scene>,
    models: Vec<Model>,
    options: FitOptions,
}

impl JointTask {
    /// The id of each video's model.
    fn ids(&self) -> Vec<String> {
        self.videos.iter().map(|video| canonical_digest("model", &(&self.id, video))).collect()
    }
}

impl Task for JointTask {
    type Output = Vec<StoredFit>;

    fn kind(&self) -> JobKind {
        JobKind::JointFit
    }

    fn perform(
        self,
        report: ReportSink,
        stop: Stop,
    ) -> Result<(Vec<StoredFit>, Vec<TraceFile>), EngineError> {
        let ids = self.ids();
        let JointTask { videos, scenes, models, options, .. } = self;
        report(Report::Phase(Phase::Fitting));
        let joint = fit(&scenes, &models, &options, stop)?;
        report(Report::rmse(&joint.scenes));
        let one =
            |(k, (video, id))| StoredFit { video, id, revision: 0, fit: joint.of_scene(k), record: None };
        let fits: Vec<StoredFit> = videos.into_iter().zip(ids).enumerate().map(one).collect();
        let inputs = scenes.iter().zip(&models).zip(&fits);
        let files = inputs.map(|((scene, model), stored)| file::fit(scene, model, &options, stored));
        let files = files.collect::<Result<_, _>>()?;
        Ok((fits, files))
    }
}

/// Refuses, under the name of the field, videos that cannot share their physics.
pub(super) fn one_set_up(field: &str, scenes: &[Scene], models: &[Model]) -> Result<(), EngineError> {
    match crate::fit::check(scenes, models) {
        Err(error @ (FitError::PresetsDiffer { .. } | FitError::DuplicateVideo { .. })) => {
            Err(EngineError::invalid(field, error.to_string()))
        }
        // The fit reports all other errors.
        _ => Ok(()),
    }
}

impl Engine {
    /// Ids of the videos that are fitted together, `video` among them, each once and sorted: requests that name the same
    /// videos share one fit.
    pub async fn joint_videos(&self, video: &str, others: JointVideos) -> Result<Vec<String>, EngineError> {
        let scene = self.video(video).await?;
        let named = match others {
            JointVideos::Named(named) => named,
            JointVideos::Setup => {
                let Some(setup) = scene.setup.clone() else {
                    let message = "needs a video that names its set-up; name the other videos instead";
                    return Err(EngineError::invalid("whole_setup", message));
                };
                let filter = VideoFilter { setup: Some(setup), ..VideoFilter::default() };
                let found = self.list_videos(filter, "", MAX_STUDY_VIDEOS + 1).await?;
                found.rows.into_iter().map(|row| row.key).collect()
            }
        };
        let mut all: BTreeSet<String> = named.into_iter().collect();
        all.insert(video.to_string());
        if all.len() > MAX_STUDY_VIDEOS {
            let message =
                format!("make {} videos; at most {MAX_STUDY_VIDEOS} are fitted together", all.len());
            return Err(EngineError::invalid("others", message));
        }
        Ok(all.into_iter().collect())
    }

    /// Fits the videos together, unless a stored fit has the same inputs. The models are stored before they are
    /// returned, in the order of the videos.
    pub async fn fit_joint(
        self: &Arc<Self>,
        videos: Vec<String>,
        start: &ModelSource,
        options: FitOptions,
    ) -> Result<JobHandle<Vec<StoredFit>>, EngineError> {
        let key = self.result_prefix(&videos.iter().map(String::as_str).collect::<Vec<_>>());
        let (mut scenes, mut models) = (vec![], vec![]);
        for video in &videos {
            let scene = self.video(video).await?;
            models.push(start.unfitted(&scene)?);
            scenes.push(Scene::clone(&scene));
        }
        let setups: BTreeSet<&String> = scenes.iter().filter_map(|s| s.setup.as_ref()).collect();
        if setups.len() > 1 {
            let message =
                format!("are of the set-ups {setups:?}; only videos of one set-up share its physics");
            return Err(EngineError::invalid("others", message));
        }
        one_set_up("others", &scenes, &models)?;
        let id = result_digest("joint", &(&videos, &models, &options));
        let (engine, first) = (self.clone(), videos.first().cloned().unwrap_or_default());
        let task = JointTask { id: id.clone(), videos, scenes, models, options };
        let work = move |context| async move { engine.run_joint(task, context).await };
        Ok(self.joint_fits.join(format!("{key}{id}"), &first, self.deadline(), work).await)
    }

    async fn run_joint(&self, task: JointTask, context: JobContext) -> Result<Vec<StoredFit>, EngineError> {
        let of = |(video, id): (&String, String)| format!("{video}/{id}");
        let keys: Vec<String> = task.videos.iter().zip(task.ids()).map(of).collect();
        let mut found = vec![];
        for key in &keys {
            found.extend(self.store.get::<StoredFit>(TableKind::Fits, key).await?);
        }
        if found.len() == keys.len() {
            metric_names::count_result("joint_fit", "store");
            return Ok(found);
        }
        self.count_fit();
        metric_names::count_result("joint_fit", "made");
        let progress = context.progress.clone();
        let Performed { output: fits, batch, slot: _slot } = self.perform(task, context).await?;
        progress(Report::Phase(Phase::Storing));
        self.publish(batch).await?;
        for (fit, key) in fits.iter().zip(&keys) {
            self.put_of_video(TableKind::Fits, &fit.video, key, fit).await?;
        }
        Ok(fits)
    }
}
