//! Fits of several videos of one set-up: they share its physics, keep their own motion, and each gets its model.

use super::memo::Waiting;
use super::pool::Control;
use super::{Choice, Engine, EngineError, MAX_STUDY_VIDEOS, StoredFit, figures, trace};
use crate::fit::{FitError, FitOptions, fit};
use crate::num::Stop;
use crate::scene::{Scene, canonical_digest};
use crate::store::Kind;
use crate::world::Model;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Which videos a fit takes beside its own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Others {
    /// Ids; none: it is fitted alone.
    Named(Vec<String>),
    /// All that are stored and name the same set-up.
    Setup,
}

/// Refuses, under the name of the field, videos that cannot share their physics.
pub(super) fn one_set_up(field: &str, scenes: &[Scene], models: &[Model]) -> Result<(), EngineError> {
    match crate::fit::check(scenes, models) {
        Err(error @ (FitError::PresetsDiffer { .. } | FitError::DuplicateVideo { .. })) => {
            Err(EngineError::invalid(field, error.to_string()))
        }
        // What else is wrong is told by the fit.
        _ => Ok(()),
    }
}

impl Engine {
    /// Ids of the videos that are fitted together, `video` among them, each once and sorted: who asks for the same ones
    /// asks for the same fit.
    pub async fn together(&self, video: &str, others: Others) -> Result<Vec<String>, EngineError> {
        let scene = self.video(video).await?;
        let named = match others {
            Others::Named(named) => named,
            Others::Setup => {
                let Some(setup) = scene.setup.clone() else {
                    let message = "needs a video that names its set-up; name the other videos instead";
                    return Err(EngineError::invalid("whole_setup", message));
                };
                let of_setup = move |s: &Scene| s.setup.as_ref() == Some(&setup);
                let found = self.store.list(Kind::Videos, "", "", MAX_STUDY_VIDEOS + 1, of_setup).await?;
                found.into_iter().map(|(id, _)| id).collect()
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

    /// Fits the videos together, unless that was done before; the models are stored before they are given, in the
    /// order of the videos.
    pub async fn fit_together(
        self: &Arc<Self>,
        videos: Vec<String>,
        start: &Choice,
        options: FitOptions,
    ) -> Result<Waiting<Vec<StoredFit>>, EngineError> {
        let key = self.key("");
        let (mut scenes, mut models) = (vec![], vec![]);
        for video in &videos {
            let scene = self.video(video).await?;
            models.push(start.unfitted(&scene)?);
            scenes.push(Scene::clone(&scene));
        }
        let setups: BTreeSet<&String> = scenes.iter().filter_map(|s| s.setup.as_ref()).collect();
        if setups.len() > 1 {
            let message = format!("are of the set-ups {setups:?}; only videos of one share its physics");
            return Err(EngineError::invalid("others", message));
        }
        one_set_up("others", &scenes, &models)?;
        let id = canonical_digest("joint", &(&videos, &models, &options, env!("CARGO_PKG_VERSION")));
        let (engine, first) = (self.clone(), videos.first().cloned().unwrap_or_default());
        let work = {
            let id = id.clone();
            move |control| async move { engine.run_joint(id, videos, scenes, models, options, control).await }
        };
        Ok(self.joint_fits.join(format!("{key}{id}"), &first, self.deadline(), work).await)
    }

    async fn run_joint(
        &self,
        id: String,
        videos: Vec<String>,
        scenes: Vec<Scene>,
        models: Vec<Model>,
        options: FitOptions,
        control: Control,
    ) -> Result<Vec<StoredFit>, EngineError> {
        let of = |video: &String| canonical_digest("model", &(&id, video));
        let ids: Vec<String> = videos.iter().map(of).collect();
        let keys: Vec<String> = videos.iter().zip(&ids).map(|(video, id)| format!("{video}/{id}")).collect();
        let mut found = vec![];
        for key in &keys {
            found.extend(self.store.get::<StoredFit>(Kind::Fits, key).await?);
        }
        if found.len() == keys.len() {
            figures::result("joint_fit", "store");
            return Ok(found);
        }
        self.fitted_anew();
        figures::result("joint_fit", "made");
        let backlog = self.backlog.clone();
        let job = move |stop: Stop| {
            let joint = fit(&scenes, &models, &options, stop)?;
            let one =
                |(k, (video, id))| StoredFit { video, id, revision: 0, fit: joint.of_scene(k), step: None };
            let fits: Vec<StoredFit> = videos.into_iter().zip(ids).enumerate().map(one).collect();
            let begun = scenes.iter().zip(&models).zip(&fits);
            let files = begun.map(|((scene, model), stored)| trace::fit(scene, model, &options, stored));
            let files = files.collect::<Result<_, _>>()?;
            Ok((fits, backlog.admit(files, stop)?))
        };
        let ((fits, batch), _place) = self.pool.run(control, job).await?;
        self.publish(batch).await?;
        for (fit, key) in fits.iter().zip(&keys) {
            self.put_of_video(Kind::Fits, &fit.video, key, fit).await?;
        }
        Ok(fits)
    }
}
