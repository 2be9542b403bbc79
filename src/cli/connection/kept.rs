//! The models that the service keeps, found by their names or the first digits of their ids.

use super::client::Connection;
use crate::api::v1::{FitModelRequest, Model, ModelChoice, StudyRequest, model_choice};
use crate::cli::error::Failure;
use crate::cli::input::ModelArgument;
use crate::cli::output::revisions::{change_of, short_id};
use crate::scene::Scene;

/// Most candidates in a message.
const CANDIDATES: usize = 8;

/// The id in a model's name.
pub fn id(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or_default()
}

/// One model for each revision, its first one where it is known; and the others.
pub fn heads(known: &[Model]) -> Vec<&Model> {
    let mut heads: Vec<&Model> = vec![];
    for model in known {
        let is_first = model.history.as_ref().is_some_and(|r| r.models.first() == Some(&model.name));
        let of_revision = |head: &&mut &Model| model.history.is_some() && head.history == model.history;
        match heads.iter_mut().find(of_revision) {
            Some(head) if is_first => *head = model,
            Some(_) => {}
            None => heads.push(model),
        }
    }
    heads
}

/// The model, or a model of the revision, that has this name or whose id starts so.
pub fn the_one<'m>(known: &'m [Model], text: &str) -> Result<&'m Model, Failure> {
    let fits = |m: &Model| m.name == text || (!text.is_empty() && id(&m.name).starts_with(text));
    let found: Vec<Model> = known.iter().filter(|m| fits(m)).cloned().collect();
    let listed = |models: &[&Model]| {
        let named = models.iter().take(CANDIDATES);
        let named: Vec<String> =
            named.map(|m| format!("{} ({}, {})", short_id(&m.name), m.preset, change_of(m))).collect();
        let more = models.len().saturating_sub(CANDIDATES);
        named.join(", ") + &if more > 0 { format!(" and {more} more") } else { String::new() }
    };
    match (heads(&found).as_slice(), heads(known).as_slice()) {
        ([one], _) => known
            .iter()
            .find(|m| m.name == one.name)
            .ok_or_else(|| Failure::input(format!("{text}: no such model; `vrdp show` lists all of them"))),
        ([], []) => Err(Failure::input(format!(
            "{text}: no such model, and none is kept here; `vrdp fit` and `vrdp discover` make some"
        ))),
        ([], all) => Err(Failure::input(format!("{text}: no such model; there are {}", listed(all)))),
        (several, _) => Err(Failure::input(format!(
            "{text}: several models have these first digits; give more of one: {}",
            listed(several)
        ))),
    }
}

impl Connection {
    /// All models of the service, video by video.
    pub async fn all_models(&self) -> Result<Vec<Model>, Failure> {
        let mut models = vec![];
        for video in self.video_names().await? {
            models.extend(self.models_of(&video).await?);
        }
        Ok(models)
    }

    /// The models of the videos that an argument names: one for each, of one revision.
    pub async fn kept_models(
        &self,
        videos: &[String],
        flag: &str,
        text: &str,
    ) -> Result<Vec<Model>, Failure> {
        let at = |e: Failure| e.at(flag);
        if !self.keeps_traces() {
            let message =
                format!("{text}: models are kept only with --data-dir or --server; name where yours are");
            return Err(at(Failure::input(message)));
        }
        let mut known = vec![];
        for video in videos {
            known.extend(self.models_of(video).await?);
        }
        let found = match the_one(&known, text) {
            Ok(one) => one.clone(),
            Err(here) => match the_one(&self.all_models().await?, text) {
                Ok(_) => {
                    let message = format!(
                        "{text}: is a model of other videos; name their scenes, or another model (`vrdp show` lists them)"
                    );
                    return Err(at(Failure::input(message)));
                }
                Err(_) => return Err(at(here)),
            },
        };
        let names = found.history.as_ref().map_or(vec![found.name.clone()], |r| r.models.clone());
        let of = |video: &String| {
            let own = format!("{video}/models/");
            let name = names.iter().find(|name| name.starts_with(&own));
            let model = name.and_then(|name| known.iter().find(|m| m.name == *name));
            let missing = || {
                let what = short_id(&found.name);
                Failure::input(format!("{what} has no model of {video}; name scenes that it was fitted to"))
            };
            model.cloned().ok_or_else(missing).map_err(at)
        };
        videos.iter().map(of).collect()
    }

    /// The kept model of one video.
    async fn kept_model(&self, video: &str, flag: &str, name: &str) -> Result<Model, Failure> {
        Ok(self.kept_models(&[video.to_string()], flag, name).await?.swap_remove(0))
    }

    /// The choice of a model for one video.
    pub async fn choice(
        &self,
        video: &str,
        given: Option<&ModelArgument>,
    ) -> Result<Option<ModelChoice>, Failure> {
        match given {
            Some(ModelArgument::Kept { flag, name }) => {
                let choice = model_choice::Choice::Model(self.kept_model(video, flag, name).await?.name);
                Ok(Some(ModelChoice { choice: Some(choice) }))
            }
            Some(ModelArgument::Start(choice)) => Ok(Some(choice.clone())),
            None => Ok(None),
        }
    }

    /// The model from which a fit of one video starts: of one that was fitted its numbers.
    pub async fn start(
        &self,
        video: &str,
        given: Option<&ModelArgument>,
    ) -> Result<Option<ModelChoice>, Failure> {
        match given {
            Some(ModelArgument::Kept { flag, name }) => {
                let json = self.kept_model(video, flag, name).await?.model_json;
                Ok(Some(ModelChoice { choice: Some(model_choice::Choice::ModelJson(json)) }))
            }
            _ => self.choice(video, given).await,
        }
    }

    /// Posts scenes of one set-up, and names them and the models of a study of them in a request.
    pub async fn study(
        &self,
        scenes: &[Scene],
        given: Option<&ModelArgument>,
    ) -> Result<StudyRequest, Failure> {
        let mut videos = Vec::with_capacity(scenes.len());
        for scene in scenes {
            videos.push(self.post(scene).await.map_err(|e| e.at(&scene.name))?);
        }
        self.study_of(videos, given).await
    }

    /// A study of videos of the service.
    pub async fn study_of(
        &self,
        videos: Vec<String>,
        given: Option<&ModelArgument>,
    ) -> Result<StudyRequest, Failure> {
        let models = match given {
            Some(ModelArgument::Kept { flag, name }) => self.kept_models(&videos, flag, name).await?,
            _ => vec![],
        };
        let models = models.into_iter().map(|m| m.name).collect();
        let start = given.and_then(ModelArgument::of_start);
        Ok(StudyRequest { videos, start, models })
    }

    /// A study of the videos that a kept model was fitted to.
    pub async fn kept_study(&self, given: Option<&ModelArgument>) -> Result<StudyRequest, Failure> {
        let Some(ModelArgument::Kept { flag, name }) = given else {
            return Err(Failure::input("give scenes, or the id of a kept model"));
        };
        let known = self.all_models().await?;
        let found = the_one(&known, name).map_err(|e| e.at(flag))?;
        let models = found.history.as_ref().map_or(vec![found.name.clone()], |r| r.models.clone());
        let video = |name: &String| name.split("/models/").next().unwrap_or_default().to_string();
        Ok(StudyRequest { videos: models.iter().map(video).collect(), start: None, models })
    }

    /// A joint fit of videos; refuses models that were fitted, since each video would need its own.
    pub fn joint_request(
        &self,
        videos: Vec<String>,
        given: Option<&ModelArgument>,
    ) -> Result<FitModelRequest, Failure> {
        if let Some(ModelArgument::Kept { flag, name }) = given {
            let message =
                format!("{flag} {name}: a joint fit starts from a preset or a model file; leave --joint out");
            return Err(Failure::input(message));
        }
        let mut videos = videos.into_iter();
        Ok(FitModelRequest {
            parent: videos.next().unwrap_or_default(),
            others: videos.collect(),
            start: given.and_then(ModelArgument::of_start),
            ..Default::default()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::v1::Revision;

    #[test]
    fn an_id_is_completed_or_its_candidates_are_named() {
        let revision = |models: &[&str]| {
            let models: Vec<String> = models.iter().map(|m| m.to_string()).collect();
            let history = Revision { effect: "tilt".into(), models: models.clone(), ..Default::default() };
            let of = move |name: String| Model {
                name,
                preset: "table".into(),
                history: Some(history.clone()),
                ..Default::default()
            };
            models.into_iter().map(of).collect::<Vec<Model>>()
        };
        let fit = Model { name: "videos/a/models/0199".into(), ..Default::default() };
        let known = [revision(&["videos/a/models/0123", "videos/b/models/0145"]), vec![fit]].concat();
        let found = |text: &str| the_one(&known, text).map(|m| m.name.clone()).map_err(|e| e.to_string());
        assert_eq!(found("012"), Ok("videos/a/models/0123".into()));
        assert_eq!(found("0145"), Ok("videos/b/models/0145".into()));
        let reversed: Vec<Model> = known.iter().rev().cloned().collect();
        let listed = |known| heads(known).into_iter().map(|m| id(&m.name)).collect::<Vec<_>>();
        assert_eq!([listed(&known), listed(&reversed)], [["0123", "0199"], ["0199", "0123"]]);
        assert_eq!(found("videos/a/models/0199"), Ok("videos/a/models/0199".into()));
        let (several, none) = (found("01").unwrap_err(), found("9").unwrap_err());
        assert!(several.contains("give more of one: 0123 (table, + tilt), 0199"), "{several}");
        assert!(none.contains("no such model; there are 0123 (table, + tilt), 0199"), "{none}");
        assert!(the_one(&[], "01").unwrap_err().to_string().contains("none is kept"));
        assert!(found("").is_err());
    }
}
