//! Studies of a set-up's videos: compare, diagnose, discover, change. Each is made once and kept; the revisions that it
//! makes become models of the videos, to be simulated, asked and revised like any other.

use super::check;
use super::joint::one_set_up;
use super::memo::Waiting;
use super::pool::Control;
use super::revision::{self, Step};
use super::{Choice, ChoiceKind, DEFAULT_FUTURE_FRAMES, Engine, EngineError, StoredFit, figures, trace};
use crate::discover::{
    Comparison, Diagnosis, DiscoverOptions, Discovery, ModelChange, compare, diagnose, discover,
};
use crate::effects::formula::Formula;
use crate::fit::{Fit, FitError, FitOptions, fit};
use crate::num::Stop;
use crate::scene::{Scene, Violation, canonical_digest};
use crate::store::Kind;
use crate::world::Model;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Most videos of one study: they are fitted together.
pub const MAX_STUDY_VIDEOS: usize = 32;
/// Most effects that a discovery may add.
pub const MAX_EFFECTS: usize = 8;

/// What is asked of the videos.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub enum Inquiry {
    Compare,
    /// With laws that users write, by name, as further candidates.
    Diagnose(Vec<(String, Formula)>),
    Change(ModelChange),
    Discover {
        max_effects: usize,
        /// Frames of the courses; `None`: those of each video and [`DEFAULT_FUTURE_FRAMES`] more.
        frames: Option<usize>,
    },
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Study {
    /// Ids, in an order that is not the request's: the same videos are the same study.
    pub videos: Vec<String>,
    pub findings: Findings,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Findings {
    Comparison(Comparison),
    Diagnosis(Diagnosis),
    Discovery(Box<Discovered>),
    /// The revision that was asked for, and the one that it came from.
    Changed(Box<[Step; 2]>),
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Discovered {
    pub discovery: Discovery,
    /// One a revision.
    pub steps: Vec<Step>,
    /// One a video.
    pub courses: Vec<Course>,
}

/// x, y (m) and yaw (rad); `None` where the object is absent.
pub type Pose = Option<[f64; 3]>;

/// One video simulated without and with the effects that were added: `[frame][object]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Course {
    pub before: Vec<Vec<Pose>>,
    pub after: Vec<Vec<Pose>>,
}

impl Engine {
    /// Studies the videos, unless that was done before; the result is stored before it is given.
    pub async fn study(
        self: &Arc<Self>,
        videos: &[String],
        start: &Choice,
        inquiry: Inquiry,
    ) -> Result<Waiting<Study>, EngineError> {
        let key = self.key("");
        check_request(videos, &inquiry)?;
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
            if let Inquiry::Discover { frames: Some(frames), .. } = inquiry {
                check::size(&scene, frames, 0)?;
            }
            parts.push((video.clone(), Scene::clone(&scene), model, parent));
        }
        // Whatever the order of the request: sums depend on it, and the names of what is made. `scene_2` is before `scene_10`.
        parts.sort_by_key(|(video, scene, ..)| (scene.name.len(), scene.name.clone(), video.clone()));
        let mut subject = Subject { videos: vec![], scenes: vec![], models: vec![], parents: vec![] };
        for (video, scene, model, parent) in parts {
            subject.videos.push(video);
            subject.scenes.push(scene);
            subject.models.push(model);
            subject.parents.extend(parent);
        }
        let Subject { videos, scenes, models, parents } = &subject;
        one_set_up("study.videos", scenes, models)?;
        if let Inquiry::Change(change) = &inquiry {
            change.check(models).map_err(|error| revision::refused(change, &error))?;
        }
        let names: Vec<&str> = parents.iter().map(|p| p.id.as_str()).collect();
        let id = canonical_digest("study", &(videos, &names, models, &inquiry, env!("CARGO_PKG_VERSION")));
        let first = videos.first().cloned().unwrap_or_default();
        let engine = self.clone();
        let work = {
            let id = id.clone();
            move |control| async move { engine.run_study(id, subject, inquiry, control).await }
        };
        Ok(self.studies.join(format!("{key}{id}"), &first, self.deadline(), work).await)
    }

    /// The fits that a study begins with, one a video; none where it begins anew.
    async fn parents(&self, videos: &[String], start: &Choice) -> Result<Vec<StoredFit>, EngineError> {
        let ids = match &start.kind {
            ChoiceKind::Fitted(id) => std::slice::from_ref(id),
            ChoiceKind::Together(ids) => ids,
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
        subject: Subject,
        inquiry: Inquiry,
        control: Control,
    ) -> Result<Study, EngineError> {
        let videos = subject.videos.clone();
        let Some(first) = videos.first().cloned() else {
            return Err(EngineError::invalid("study.videos", "is empty; give at least one"));
        };
        let key = format!("{first}/{id}");
        if let Some(found) = self.store.get(Kind::Studies, &key).await? {
            figures::result("study", "store");
            return Ok(found);
        }
        figures::result("study", "made");
        let backlog = self.backlog.clone();
        let job = move |stop: Stop| {
            let (findings, revisions) = findings(&subject, &inquiry, stop)?;
            let files = match &findings {
                Findings::Discovery(found) => trace::discovery(&subject.videos, &subject.scenes, found)?,
                _ => vec![],
            };
            Ok((findings, revisions, backlog.admit(files, stop)?))
        };
        let ((findings, revisions, batch), _place) = self.pool.run(control, job).await?;
        self.publish(batch).await?;
        for fit in revisions {
            let key = format!("{}/{}", fit.video, fit.id);
            self.put_of_video(Kind::Fits, &fit.video, &key, &fit).await?;
        }
        let study = Study { videos, findings };
        self.put_of_video(Kind::Studies, &first, &key, &study).await?;
        Ok(study)
    }
}

/// What a study is about, one of each a video; no parents where it begins anew.
pub(super) struct Subject {
    pub videos: Vec<String>,
    pub scenes: Vec<Scene>,
    pub models: Vec<Model>,
    pub parents: Vec<StoredFit>,
}

impl Subject {
    /// The fits that the study begins with as one, or a new one.
    fn fit(&self, options: &FitOptions, stop: Stop) -> Result<Fit, FitError> {
        let Some(first) = self.parents.first() else { return fit(&self.scenes, &self.models, options, stop) };
        let scenes = self.parents.iter().flat_map(|p| p.fit.scenes.iter().cloned()).collect();
        Ok(Fit { scenes, ..first.fit.clone() })
    }
}

fn check_request(videos: &[String], inquiry: &Inquiry) -> Result<(), EngineError> {
    let mut wrong = vec![];
    let mut add = |path: &str, message: String| wrong.push(Violation { path: path.into(), message });
    if videos.is_empty() || videos.len() > MAX_STUDY_VIDEOS {
        add("study.videos", format!("are {}; give 1 to {MAX_STUDY_VIDEOS}", videos.len()));
    }
    if videos.iter().collect::<BTreeSet<_>>().len() < videos.len() {
        add("study.videos", "name one video twice; name each once".into());
    }
    if let Inquiry::Discover { max_effects, .. } = inquiry
        && !(1..=MAX_EFFECTS).contains(max_effects)
    {
        add("max_effects", format!("is {max_effects}; must be 1 to {MAX_EFFECTS}"));
    }
    if wrong.is_empty() { Ok(()) } else { Err(EngineError::Invalid(wrong)) }
}

/// The work itself, and the fits of the revisions it made.
fn findings(
    subject: &Subject,
    inquiry: &Inquiry,
    stop: Stop,
) -> Result<(Findings, Vec<StoredFit>), FitError> {
    let options = FitOptions::default();
    let scenes = &subject.scenes;
    match inquiry {
        Inquiry::Compare => {
            let fit = subject.fit(&options, stop)?;
            Ok((Findings::Comparison(compare(scenes, &fit, &options, stop)?), vec![]))
        }
        Inquiry::Diagnose(formulas) => {
            let fit = subject.fit(&options, stop)?;
            let diagnosis = diagnose(scenes, &fit, formulas, &DiscoverOptions::default(), stop)?;
            Ok((Findings::Diagnosis(diagnosis), vec![]))
        }
        Inquiry::Change(change) => {
            let (steps, fits) = revision::changed(subject, change, stop)?;
            Ok((Findings::Changed(Box::new(steps)), fits))
        }
        Inquiry::Discover { max_effects, frames } => {
            let options = DiscoverOptions { max_effects: *max_effects, ..DiscoverOptions::default() };
            let discovery = discover(scenes, &subject.models, &options, stop)?;
            let (steps, fits) = revision::discovered(subject, &discovery);
            let ends = discovery.revisions.first().zip(discovery.revisions.last());
            let course = |(k, scene): (usize, &Scene)| {
                let (first, last) = ends?;
                let frames = frames.unwrap_or(scene.times.len() + DEFAULT_FUTURE_FRAMES);
                let of = |model: &Model| course(scene, model, frames);
                Some(Course { before: of(&first.fit.scenes[k].model), after: of(&last.fit.scenes[k].model) })
            };
            let courses = scenes.iter().enumerate().filter_map(course).collect();
            Ok((Findings::Discovery(Box::new(Discovered { discovery, steps, courses })), fits))
        }
    }
}

fn course(scene: &Scene, model: &Model, frames: usize) -> Vec<Vec<Pose>> {
    let times: Vec<f64> = (0..frames).map(|f| scene.time_of(f)).collect();
    let rows = crate::world::trace(model, &times).as_observed(model).states;
    let pose = |s: &Option<crate::world::State>| s.map(|s| [s.position.x, s.position.y, s.yaw]);
    rows.iter().map(|row| row.iter().map(pose).collect()).collect()
}
