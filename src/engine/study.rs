//! Studies of a set-up's videos: compare, diagnose, discover. Each is made once and kept; the revisions that a
//! discovery makes become models of the videos, to be simulated and asked like any other.

use super::check;
use super::memo::Waiting;
use super::pool::Control;
use super::{Choice, DEFAULT_FUTURE_FRAMES, Engine, EngineError, StoredFit, trace};
use crate::discover::{Comparison, Diagnosis, DiscoverOptions, Discovery, compare, diagnose, discover};
use crate::fit::{FitOptions, fit};
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
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub enum Inquiry {
    Compare,
    Diagnose,
    Discover {
        max_effects: usize,
        /// Frames of the courses; `None`: those of each video and [`DEFAULT_FUTURE_FRAMES`] more.
        frames: Option<usize>,
    },
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Study {
    /// Ids, in the order of the request.
    pub videos: Vec<String>,
    pub findings: Findings,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Findings {
    Comparison(Comparison),
    Diagnosis(Diagnosis),
    Discovery(Box<Discovered>),
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Discovered {
    pub discovery: Discovery,
    /// Ids of the models of each revision, one a video.
    pub models: Vec<Vec<String>>,
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
        check_request(videos, inquiry)?;
        let (mut scenes, mut models) = (vec![], vec![]);
        for video in videos {
            let scene = self.video(video).await?;
            let model = start.unfitted(&scene)?;
            if let Inquiry::Discover { frames: Some(frames), .. } = inquiry {
                check::size(&scene, frames, 0)?;
            }
            scenes.push(Scene::clone(&scene));
            models.push(model);
        }
        let id = canonical_digest("study", &(videos, &models, inquiry, env!("CARGO_PKG_VERSION")));
        let (engine, videos) = (self.clone(), videos.to_vec());
        let work = {
            let id = id.clone();
            move |control| async move { engine.run_study(id, videos, scenes, models, inquiry, control).await }
        };
        Ok(self.studies.join(format!("{key}{id}"), self.deadline(), work).await)
    }

    async fn run_study(
        &self,
        id: String,
        videos: Vec<String>,
        scenes: Vec<Scene>,
        models: Vec<Model>,
        inquiry: Inquiry,
        control: Control,
    ) -> Result<Study, EngineError> {
        let Some(first) = videos.first().cloned() else {
            return Err(EngineError::invalid("study.videos", "is empty; give at least one"));
        };
        let key = format!("{first}/{id}");
        if let Some(found) = self.store.get(Kind::Studies, &key).await? {
            return Ok(found);
        }
        let job = {
            let (videos, backlog) = (videos.clone(), self.backlog.clone());
            move |stop: Stop| {
                let (findings, revisions) = findings(&id, &videos, &scenes, &models, inquiry, stop)?;
                let files = match &findings {
                    Findings::Discovery(found) => trace::discovery(&videos, &scenes, found)?,
                    _ => vec![],
                };
                Ok((findings, revisions, backlog.admit(files, stop)?))
            }
        };
        let (findings, revisions, batch) = self.pool.run(control, job).await?;
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

fn check_request(videos: &[String], inquiry: Inquiry) -> Result<(), EngineError> {
    let mut wrong = vec![];
    let mut add = |path: &str, message: String| wrong.push(Violation { path: path.into(), message });
    if videos.is_empty() || videos.len() > MAX_STUDY_VIDEOS {
        add("study.videos", format!("are {}; give 1 to {MAX_STUDY_VIDEOS}", videos.len()));
    }
    if videos.iter().collect::<BTreeSet<_>>().len() < videos.len() {
        add("study.videos", "name one video twice; name each once".into());
    }
    if let Inquiry::Discover { max_effects, .. } = inquiry
        && !(1..=MAX_EFFECTS).contains(&max_effects)
    {
        add("max_effects", format!("is {max_effects}; must be 1 to {MAX_EFFECTS}"));
    }
    if wrong.is_empty() { Ok(()) } else { Err(EngineError::Invalid(wrong)) }
}

/// The work itself, and the fits of the revisions it made.
fn findings(
    id: &str,
    videos: &[String],
    scenes: &[Scene],
    models: &[Model],
    inquiry: Inquiry,
    stop: Stop,
) -> Result<(Findings, Vec<StoredFit>), crate::fit::FitError> {
    let options = FitOptions::default();
    let base = || fit(scenes, models, &options, stop);
    match inquiry {
        Inquiry::Compare => Ok((Findings::Comparison(compare(scenes, &base()?, &options, stop)?), vec![])),
        Inquiry::Diagnose => {
            let diagnosis = diagnose(scenes, &base()?, &DiscoverOptions::default(), stop)?;
            Ok((Findings::Diagnosis(diagnosis), vec![]))
        }
        Inquiry::Discover { max_effects, frames } => {
            let options = DiscoverOptions { max_effects, ..DiscoverOptions::default() };
            let discovery = discover(scenes, models, &options, stop)?;
            let mut fits = vec![];
            let mut revision = |(number, revision): (usize, &crate::discover::Revision)| -> Vec<String> {
                let one = |(k, video): (usize, &String)| {
                    let id = canonical_digest("revision", &(id, video, number));
                    let fit = revision.fit.of_scene(k);
                    let (video, revision) = (video.clone(), number as u32);
                    fits.push(StoredFit { video, id: id.clone(), revision, fit });
                    id
                };
                videos.iter().enumerate().map(one).collect()
            };
            let models = discovery.revisions.iter().enumerate().map(&mut revision).collect();
            let ends = discovery.revisions.first().zip(discovery.revisions.last());
            let course = |(k, scene): (usize, &Scene)| {
                let (first, last) = ends?;
                let frames = frames.unwrap_or(scene.times.len() + DEFAULT_FUTURE_FRAMES);
                let of = |model: &Model| course(scene, model, frames);
                Some(Course { before: of(&first.fit.scenes[k].model), after: of(&last.fit.scenes[k].model) })
            };
            let courses = scenes.iter().enumerate().filter_map(course).collect();
            Ok((Findings::Discovery(Box::new(Discovered { discovery, models, courses })), fits))
        }
    }
}

fn course(scene: &Scene, model: &Model, frames: usize) -> Vec<Vec<Pose>> {
    let times: Vec<f64> = (0..frames).map(|f| scene.time_of(f)).collect();
    let rows = crate::world::trace(model, &times).states;
    let pose = |s: &Option<crate::world::State>| s.map(|s| [s.position.x, s.position.y, s.yaw]);
    rows.iter().map(|row| row.iter().map(pose).collect()).collect()
}
