//! Collects everything that is wrong with a request, and converts what several requests have in common.

use super::names::{is_id, model_ids};
use crate::api::v1;
use crate::engine::{DEFAULT_ROLLOUTS, EngineError, MAX_ROLLOUTS, ModelSource, ModelSourceKind};
use crate::num::{Vec2, vec2};
use crate::scene::{Shape, Violation};

/// Size of a page where the request names none, and the largest size.
const DEFAULT_PAGE: usize = 50;
const MAX_PAGE: usize = 1000;
/// Violations that are kept; a reply holds fewer.
const MAX_VIOLATIONS: usize = 200;
/// Most interventions or choices of one request.
pub const MAX_LIST: usize = 100;
/// Longest English text (bytes).
const MAX_TEXT: usize = 2000;
/// Longest token of a program (bytes): the words of questions are shorter.
const MAX_TOKEN: usize = 100;

/// Longest request id (bytes).
const MAX_REQUEST_ID: usize = 128;

/// Refuses a name of a request that is too long.
pub fn check_request_id(id: &str) -> Result<(), EngineError> {
    let mut violations = Violations::default();
    violations.request_id(id);
    violations.finish(())
}

/// The violations of one request. A method that finds one returns a placeholder, so that the others are found too;
/// [`Violations::finish`] then refuses the request.
#[derive(Default)]
pub struct Violations(pub Vec<Violation>);

impl Violations {
    pub fn add(&mut self, path: impl Into<String>, message: impl Into<String>) {
        if self.0.len() < MAX_VIOLATIONS {
            self.0.push(Violation { path: path.into(), message: message.into() });
        }
    }

    pub fn finish<T>(self, value: T) -> Result<T, EngineError> {
        if self.0.is_empty() { Ok(value) } else { Err(EngineError::Invalid(self.0)) }
    }

    /// Refuses a name of a request that is too long; it is not repeated.
    pub fn request_id(&mut self, id: &str) {
        if id.len() > MAX_REQUEST_ID {
            self.add("request_id", format!("has {} bytes; at most {MAX_REQUEST_ID}", id.len()));
        }
    }

    pub fn range(&mut self, path: &str, value: f64, [low, high]: [f64; 2], unit: &str) -> f64 {
        if !(low..=high).contains(&value) {
            let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
            self.add(path, format!("is {value:?}; must be from {low:?} to {high:?}{unit}"));
        }
        value
    }

    pub fn vector(&mut self, path: &str, vector: Option<v1::Vector>, most: f64, unit: &str) -> Vec2 {
        match vector {
            Some(v) => vec2(
                self.range(&format!("{path}.x"), v.x, [-most, most], unit),
                self.range(&format!("{path}.y"), v.y, [-most, most], unit),
            ),
            None => {
                self.add(path, "is missing");
                vec2(0.0, 0.0)
            }
        }
    }

    pub fn shape(&mut self, path: &str, shape: Option<v1::Shape>) -> Shape {
        use v1::shape::Kind;
        match shape.and_then(|s| s.kind) {
            Some(Kind::Disc(v1::shape::Disc { radius })) => Shape::Disc { radius },
            Some(Kind::Ball(v1::shape::Ball { radius })) => Shape::Ball { radius },
            Some(Kind::Square(v1::shape::Square { half_side })) => Shape::Square { half_side },
            Some(Kind::Rectangle(v1::shape::Rectangle { half_length, half_width })) => {
                Shape::Rectangle { half_length, half_width }
            }
            None => {
                self.add(path, "is missing or unknown; give disc, ball, square or rectangle");
                Shape::Disc { radius: crate::scene::DEFAULT_SIZE }
            }
        }
    }

    pub fn id(&mut self, path: &str, name: &str, collection: &str) -> String {
        match name.strip_prefix(collection).and_then(|n| n.strip_prefix('/')).filter(|id| is_id(id)) {
            Some(id) => id.to_string(),
            None => {
                self.add(path, format!("is {name:?}; must be {collection}/{{id}}"));
                String::new()
            }
        }
    }

    /// The id in a name; none where the name is empty.
    pub fn optional_id(&mut self, path: &str, name: &str, collection: &str) -> Option<String> {
        (!name.is_empty()).then(|| self.id(path, name, collection))
    }

    /// The model that a request means. A fitted model must be of `video`.
    pub fn source(
        &mut self,
        path: &'static str,
        choice: Option<v1::ModelChoice>,
        video: &str,
    ) -> ModelSource {
        use v1::model_choice::Choice as Given;
        let kind = match choice.and_then(|c| c.choice) {
            None => ModelSourceKind::Default,
            Some(Given::Preset(name)) => ModelSourceKind::Preset(name),
            Some(Given::ModelJson(text)) => ModelSourceKind::File(text),
            Some(Given::Model(name)) => match model_ids(&name) {
                Some((of, id)) if of == video => ModelSourceKind::Fitted(id.to_string()),
                of => {
                    let what = match (of, video) {
                        (Some(_), "") => {
                            "a model of one video only; of several, give a revision's `models`, one each \
                             (`vrdp revise --on ID`), or a preset"
                                .to_string()
                        }
                        (Some((of, _)), _) => format!(
                            "a model of another video, videos/{of}; name one of videos/{video} (ListModels and \
                             `vrdp revise SCENE --list --json -` have them), or a preset"
                        ),
                        (None, _) => "no model's name; it must be videos/{video}/models/{id}".to_string(),
                    };
                    self.add(format!("{path}.model"), format!("is {name:?}, {what}"));
                    ModelSourceKind::Default
                }
            },
        };
        ModelSource { path, kind }
    }

    pub fn page(&mut self, size: i32, token: String) -> (usize, String) {
        if size < 0 {
            self.add("page_size", format!("is {size}; must not be negative"));
        }
        if !token.is_empty() && !is_id(&token) {
            self.add(
                "page_token",
                "is not a token of this service; use next_page_token of the previous reply",
            );
        }
        let size = match size.max(0) as usize {
            0 => DEFAULT_PAGE,
            n => n.min(MAX_PAGE),
        };
        (size, token)
    }

    pub fn rollouts(&mut self, rollouts: Option<u32>) -> usize {
        let rollouts = rollouts.map_or(DEFAULT_ROLLOUTS, |n| n as usize);
        if rollouts > MAX_ROLLOUTS {
            self.add("rollouts", format!("is {rollouts}; must be at most {MAX_ROLLOUTS}"));
        }
        rollouts
    }

    pub fn tokens(&mut self, path: &str, tokens: &[String]) {
        for (i, token) in tokens.iter().enumerate().filter(|(_, t)| t.len() > MAX_TOKEN) {
            let message = format!("has {} bytes; at most {MAX_TOKEN} are allowed", token.len());
            self.add(format!("{path}.tokens[{i}]"), message);
        }
    }

    /// A word or two of a caller's own.
    pub fn word(&mut self, path: &str, word: String) -> String {
        self.filled(path, word, MAX_TOKEN)
    }

    pub fn text(&mut self, path: &str, text: String) -> String {
        self.filled(path, text, MAX_TEXT)
    }

    /// A text that is not empty and has at most so many bytes.
    fn filled(&mut self, path: &str, text: String, most: usize) -> String {
        if text.trim().is_empty() {
            self.add(path, "is empty");
        } else if text.len() > most {
            self.add(path, format!("has {} bytes; at most {most} are allowed", text.len()));
        }
        text
    }
}

/// Id of a video named in field `path`.
pub fn video_id(path: &str, name: &str) -> Result<String, EngineError> {
    let mut violations = Violations::default();
    let id = violations.id(path, name, "videos");
    violations.finish(id)
}

/// Id of a trace named in field `path`.
pub fn trace_id(path: &str, name: &str) -> Result<String, EngineError> {
    let mut violations = Violations::default();
    let id = violations.id(path, name, "traces");
    violations.finish(id)
}

/// Ids of a model's video and of the model.
pub fn model_ids_of(name: &str) -> Result<(String, String), EngineError> {
    match model_ids(name) {
        Some((video, model)) => Ok((video.to_string(), model.to_string())),
        None => {
            Err(EngineError::invalid("name", format!("is {name:?}; must be videos/{{id}}/models/{{id}}")))
        }
    }
}
