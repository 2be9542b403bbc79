//! Runs studies. Each is computed once and stored; the revisions that it makes become models of the videos, which can be
//! simulated, asked and revised like any other.

use super::checkpoints::KeptSteps;
use super::input::{StudyInput, StudyKind, check_request};
use super::revision;
use crate::discover::{Checkpoints, DiscoverOptions, compare, diagnose, discover_with};
use crate::engine::cache::JobHandle;
use crate::engine::error::EngineError;
use crate::engine::joint::one_set_up;
use crate::engine::limits;
use crate::engine::metric_names;
use crate::engine::model_source::{ModelSource, ModelSourceKind};
use crate::engine::pool::{JobContext, JobKind};
use crate::engine::predictions::DEFAULT_FUTURE_FRAMES;
use crate::engine::progress::{Phase, Report};
use crate::engine::results::{
    Discovered, Findings, OptionalPose, StoredFit, Study, TrajectoryPair, result_digest,
};
use crate::engine::state::Engine;
use crate::engine::task::{Performed, ReportSink, Task};
use crate::engine::traces::file::{self, TraceFile};
use crate::fit::{Fit, FitError, FitOptions, SceneFit};
use crate::num::Stop;
use crate::scene::Scene;
use crate::store::TableKind;
use crate::world::Model;
use std::pin::pin;
use std::sync::Arc;

/// Studies the videos of one set-up.
struct StudyTask {
    input: StudyInput,
    study: StudyKind,
    /// Of a discovery.
    kept: Option<KeptSteps>,
}

impl Task for StudyTask {
    /// With the fits of the revisions that were made.
    type Output = (Findings, Vec<StoredFit>);

    fn kind(&self) -> JobKind {
        match &self.study {
            StudyKind::Compare if self.input.videos.len() == 1 => JobKind::Comparison,
            StudyKind::Compare if !self.input.parents.is_empty() => JobKind::Comparison,
            // The videos are fitted together first.
            StudyKind::Compare => JobKind::JointFit,
            StudyKind::Diagnose(_) => JobKind::Diagnosis,
            StudyKind::Change(_) => JobKind::Revision,
            StudyKind::Discover { .. } => JobKind::Discovery,
        }
    }

    fn perform(self, report: ReportSink, stop: Stop) -> Result<(Self::Output, Vec<TraceFile>), EngineError> {
        let StudyTask { input, study, kept } = self;
        let made = findings(&input, &study, kept.as_ref(), report, stop)?;
        let files = match &made.0 {
            Findings::Discovery(found) => file::discovery(&input.videos, &input.scenes, found)?,
            _ => vec![],
        };
        Ok((made, files))
    }
}

impl Engine {
    /// Studies the videos, unless a stored study has the same inputs; the result is stored before it is returned.
    pub async fn study(
        self: &Arc<Self>,
        videos: &[String],
        start: &ModelSource,
        kind: StudyKind,
    ) -> Result<JobHandle<Study>, EngineError> {
        let key = self.result_prefix(&videos.iter().map(String::as_str).collect::<Vec<_>>());
        check_request(videos, &kind)?;
        let mut parents = self.parents(videos, start).await?.into_iter();
        let mut parts = vec![];
        for video in videos {
            let scene = self.video(video).await?;
            let parent = parents.next();
            let fitted = parent.as_ref().and_then(|p| p.fit.scenes.first()).map(|s| s.model.clone());
            let model = match fitted {
                Some(model) => model,
                None => start.unfitted(&scene)?,
            };
            if let StudyKind::Discover { frames: Some(frames), .. } = kind {
                limits::size(&scene, frames, 0)?;
            }
            parts.push((video.clone(), Scene::clone(&scene), model, parent));
        }
        // Sums and ids depend on the order of the videos, so they are sorted: `scene_2` before `scene_10`.
        parts.sort_by_key(|(video, scene, ..)| (scene.name.len(), scene.name.clone(), video.clone()));
        let mut input = StudyInput { videos: vec![], scenes: vec![], models: vec![], parents: vec![] };
        for (video, scene, model, parent) in parts {
            input.videos.push(video);
            input.scenes.push(scene);
            input.models.push(model);
            input.parents.extend(parent);
        }
        let StudyInput { videos, scenes, models, parents } = &input;
        one_set_up("study.videos", scenes, models)?;
        if let StudyKind::Change(change) = &kind {
            change.check(models).map_err(|error| revision::refused(change, &error))?;
        }
        let names: Vec<&str> = parents.iter().map(|p| p.id.as_str()).collect();
        let id = result_digest("study", &(videos, &names, models, &kind));
        let first = videos.first().cloned().unwrap_or_default();
        let engine = self.clone();
        let work = {
            let id = id.clone();
            let task = StudyTask { input, study: kind, kept: None };
            move |context| async move { engine.run_study(id, task, context).await }
        };
        Ok(self.studies.join(format!("{key}{id}"), &first, self.deadline(), work).await)
    }

    /// The fitted models that the request names, one a video; none where it names none.
    pub(in crate::engine) async fn parents(
        &self,
        videos: &[String],
        start: &ModelSource,
    ) -> Result<Vec<StoredFit>, EngineError> {
        let ids = match &start.kind {
            ModelSourceKind::Fitted(id) => std::slice::from_ref(id),
            ModelSourceKind::FittedEach(ids) => ids,
            _ => return Ok(vec![]),
        };
        if ids.len() != videos.len() {
            let message =
                format!("are {}; give one for each of the {} videos, in order", ids.len(), videos.len());
            return Err(EngineError::invalid(start.path, message));
        }
        let mut parents = vec![];
        for (video, id) in videos.iter().zip(ids) {
            parents.push(self.model(video, id).await?);
        }
        let effects = |p: &StoredFit| -> Vec<String> {
            p.fit.scenes.iter().flat_map(|s| &s.model.effects).map(|e| e.name.clone()).collect()
        };
        match parents.iter().all(|p| parents.first().is_some_and(|first| effects(first) == effects(p))) {
            true => Ok(parents),
            false => {
                Err(EngineError::invalid(start.path, "have different effects; name those of one revision"))
            }
        }
    }

    async fn run_study(
        &self,
        id: String,
        task: StudyTask,
        context: JobContext,
    ) -> Result<Study, EngineError> {
        let videos = task.input.videos.clone();
        let Some(first) = videos.first().cloned() else {
            return Err(EngineError::invalid("study.videos", "is empty; give at least one"));
        };
        let key = format!("{first}/{id}");
        if let Some(found) = self.store.get(TableKind::Studies, &key).await? {
            metric_names::count_result("study", "store");
            return Ok(found);
        }
        metric_names::count_result("study", "made");
        let progress = context.progress.clone();
        let Performed { output: (findings, revisions), batch, slot: _slot } = match task.study {
            StudyKind::Discover { .. } => self.discover_with_checkpoints(&first, &id, task, context).await?,
            _ => self.perform(task, context).await?,
        };
        progress(Report::Phase(Phase::Storing));
        self.publish(batch).await?;
        for fit in revisions {
            let key = format!("{}/{}", fit.video, fit.id);
            self.put_of_video(TableKind::Fits, &fit.video, &key, &fit).await?;
        }
        let study = Study { videos, findings };
        self.put_of_video(TableKind::Studies, &first, &key, &study).await?;
        if matches!(study.findings, Findings::Discovery(_)) {
            // Answers in memory say that there is no discovery.
            study.videos.iter().for_each(|video| self.forget_video(video));
        }
        Ok(study)
    }
}

impl Engine {
    /// Discovers from where an earlier attempt was cut short, and keeps what it computes.
    async fn discover_with_checkpoints(
        &self,
        video: &str,
        study: &str,
        task: StudyTask,
        context: JobContext,
    ) -> Result<Performed<(Findings, Vec<StoredFit>)>, EngineError> {
        let (kept, mut writer) = self.kept_steps(video, study).await?;
        let task = StudyTask { kept: Some(kept), ..task };
        let mut work = pin!(self.perform(task, context));
        tokio::select! {
            done = &mut work => done,
            () = writer.write() => work.await,
        }
    }
}

/// The findings, and the fits of the revisions that were made.
fn findings(
    input: &StudyInput,
    kind: &StudyKind,
    kept: Option<&KeptSteps>,
    report: ReportSink,
    stop: Stop,
) -> Result<(Findings, Vec<StoredFit>), FitError> {
    let options = FitOptions::default();
    let scenes = &input.scenes;
    let fit = |next| -> Result<Fit, FitError> {
        report(Report::Phase(Phase::Fitting));
        let fit = input.fit(&options, stop)?;
        report(Report::rmse(&fit.scenes));
        report(Report::Phase(next));
        Ok(fit)
    };
    match kind {
        StudyKind::Compare => {
            let fit = fit(Phase::Comparing)?;
            Ok((Findings::Comparison(compare(scenes, &fit, &options, stop)?), vec![]))
        }
        StudyKind::Diagnose(formulas) => {
            let fit = fit(Phase::Diagnosing)?;
            let diagnosis = diagnose(scenes, &fit, formulas, &DiscoverOptions::default(), stop)?;
            Ok((Findings::Diagnosis(diagnosis), vec![]))
        }
        StudyKind::Change(change) => {
            report(Report::Phase(Phase::Revising));
            let parents: Vec<SceneFit> = input.parents.iter().flat_map(|p| p.fit.scenes.clone()).collect();
            if !parents.is_empty() {
                report(Report::rmse(&parents));
            }
            let (records, fits) = revision::changed(input, change, stop)?;
            Ok((Findings::Changed(Box::new(records)), fits))
        }
        StudyKind::Discover { max_effects, frames } => {
            let options = DiscoverOptions { max_effects: *max_effects, ..DiscoverOptions::default() };
            report(Report::Phase(Phase::Discovering));
            let kept = kept.map(|kept| kept as &dyn Checkpoints);
            let discovery = discover_with(scenes, &input.models, &options, kept, stop)?;
            let (records, fits) = revision::discovered(input, &discovery);
            let ends = discovery.revisions.first().zip(discovery.revisions.last());
            let pair = |(k, scene): (usize, &Scene)| {
                let (first, last) = ends?;
                let frames = frames.unwrap_or(scene.times.len() + DEFAULT_FUTURE_FRAMES);
                let of = |model: &Model| observed_poses(scene, model, frames);
                Some(TrajectoryPair {
                    before: of(&first.fit.scenes[k].model),
                    after: of(&last.fit.scenes[k].model),
                })
            };
            let trajectories = scenes.iter().enumerate().filter_map(pair).collect();
            Ok((Findings::Discovery(Box::new(Discovered { discovery, records, trajectories })), fits))
        }
    }
}

fn observed_poses(scene: &Scene, model: &Model, frames: usize) -> Vec<Vec<OptionalPose>> {
    let times: Vec<f64> = (0..frames).map(|f| scene.time_of(f)).collect();
    let rows = crate::world::trace(model, &times).as_observed(model).states;
    let pose = |s: &Option<crate::world::State>| s.map(|s| [s.position.x, s.position.y, s.yaw]);
    rows.iter().map(|row| row.iter().map(pose).collect()).collect()
}
