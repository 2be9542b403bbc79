//! Requests to domain values: names, pages, choices of models, interventions; all violations at once.

use super::v1;
use crate::engine::{
    Choice, ChoiceKind, DEFAULT_ROLLOUTS, EngineError, MAX_ROLLOUTS, MAX_SPEED, MAX_STUDY_VIDEOS, Others,
    SimulateOptions,
};
use crate::fit::{FitOptions, Method};
use crate::num::{Vec2, vec2};
use crate::reason::{AskOptions, Question};
use crate::scene::{MASS_RANGE, MAX_NAME, MAX_POSITION, SIZE_RANGE, Shape, Violation};
use crate::world::{BodySpec, Intervention, Start, State};

/// Results on a page where none or too many are asked for.
const DEFAULT_PAGE: usize = 50;
const MAX_PAGE: usize = 1000;
/// Violations that are kept; a reply holds fewer.
const MAX_VIOLATIONS: usize = 200;
/// Most iterations that a caller may ask a fit for.
const MAX_ITERATIONS: u32 = 10_000;
/// Most interventions and choices of one request.
const MAX_LIST: usize = 100;
/// Longest English text (bytes).
const MAX_TEXT: usize = 2000;
/// Longest token of a program (bytes): the words of questions are shorter.
const MAX_TOKEN: usize = 100;
/// Factors of a mass: from the lightest to the heaviest object that a scene may have.
const FACTOR_RANGE: [f64; 2] = [1e-9, 1e9];
/// Farthest yaw (rad): beyond it the resolution of angles suffers.
const MAX_ANGLE: f64 = 1e6;
/// Latest start of an added object (s): more than the longest video lasts at any rate of a camera.
const MAX_TIME: f64 = 1e7;

/// Collects what is wrong with a request.
#[derive(Default)]
pub struct Report(pub Vec<Violation>);

impl Report {
    pub fn add(&mut self, path: impl Into<String>, message: impl Into<String>) {
        if self.0.len() < MAX_VIOLATIONS {
            self.0.push(Violation { path: path.into(), message: message.into() });
        }
    }

    pub fn finish<T>(self, value: T) -> Result<T, EngineError> {
        if self.0.is_empty() { Ok(value) } else { Err(EngineError::Invalid(self.0)) }
    }

    fn range(&mut self, path: &str, value: f64, [low, high]: [f64; 2], unit: &str) -> f64 {
        if !(low..=high).contains(&value) {
            let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
            self.add(path, format!("is {value:?}; must be from {low:?} to {high:?}{unit}"));
        }
        value
    }

    fn vector(&mut self, path: &str, vector: Option<v1::Vector>, most: f64, unit: &str) -> Vec2 {
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

    pub fn choice(&mut self, path: &'static str, choice: Option<v1::ModelChoice>, video: &str) -> Choice {
        use v1::model_choice::Choice as Given;
        let kind = match choice.and_then(|c| c.choice) {
            None => ChoiceKind::Default,
            Some(Given::Preset(name)) => ChoiceKind::Preset(name),
            Some(Given::ModelJson(text)) => ChoiceKind::File(text),
            Some(Given::Model(name)) => match model_ids(&name) {
                Some((of, id)) if of == video => ChoiceKind::Fitted(id.to_string()),
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
                    ChoiceKind::Default
                }
            },
        };
        Choice { path, kind }
    }

    pub fn page(&mut self, size: i32, token: String) -> (usize, String) {
        if size < 0 {
            self.add("page_size", format!("is {size}; must not be negative"));
        }
        if !token.is_empty() && !is_id(&token) {
            self.add("page_token", "is none that this service gave");
        }
        let size = match size.max(0) as usize {
            0 => DEFAULT_PAGE,
            n => n.min(MAX_PAGE),
        };
        (size, token)
    }

    fn rollouts(&mut self, rollouts: Option<u32>) -> usize {
        let rollouts = rollouts.map_or(DEFAULT_ROLLOUTS, |n| n as usize);
        if rollouts > MAX_ROLLOUTS {
            self.add("rollouts", format!("is {rollouts}; must be at most {MAX_ROLLOUTS}"));
        }
        rollouts
    }

    fn tokens(&mut self, path: &str, tokens: &[String]) {
        for (i, token) in tokens.iter().enumerate().filter(|(_, t)| t.len() > MAX_TOKEN) {
            let message = format!("has {} bytes; at most {MAX_TOKEN} are allowed", token.len());
            self.add(format!("{path}.tokens[{i}]"), message);
        }
    }

    fn text(&mut self, path: &str, text: String) -> String {
        if text.trim().is_empty() {
            self.add(path, "is empty");
        } else if text.len() > MAX_TEXT {
            self.add(path, format!("has {} bytes; at most {MAX_TEXT} are allowed", text.len()));
        }
        text
    }
}

/// Whether it has the form of an id.
pub fn is_id(id: &str) -> bool {
    (1..=64).contains(&id.len()) && id.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b))
}

pub fn model_ids(name: &str) -> Option<(&str, &str)> {
    let (video, model) = name.strip_prefix("videos/")?.split_once("/models/")?;
    (is_id(video) && is_id(model)).then_some((video, model))
}

/// Id of a video named in field `path`.
pub fn video_id(path: &str, name: &str) -> Result<String, EngineError> {
    let mut report = Report::default();
    let id = report.id(path, name, "videos");
    report.finish(id)
}

/// Id of a trace named in field `path`.
pub fn trace_id(path: &str, name: &str) -> Result<String, EngineError> {
    let mut report = Report::default();
    let id = report.id(path, name, "traces");
    report.finish(id)
}

/// Ids of a model's video and of the model.
pub fn model_name(name: &str) -> Result<(String, String), EngineError> {
    match model_ids(name) {
        Some((video, model)) => Ok((video.to_string(), model.to_string())),
        None => {
            Err(EngineError::invalid("name", format!("is {name:?}; must be videos/{{id}}/models/{{id}}")))
        }
    }
}

/// Size of a page and the id it begins after.
pub fn page(size: i32, token: String) -> Result<(usize, String), EngineError> {
    let mut report = Report::default();
    let page = report.page(size, token);
    report.finish(page)
}

/// Video, the others, start and options of a fit.
pub fn fit(given: v1::FitModelRequest) -> Result<(String, Others, Choice, FitOptions), EngineError> {
    let mut report = Report::default();
    let video = report.id("parent", &given.parent, "videos");
    let choice = report.choice("start", given.start, &video);
    if given.whole_setup && !given.others.is_empty() {
        report.add("others", "are named and whole_setup is set; choose one");
    }
    let named = given.others.iter().take(MAX_STUDY_VIDEOS + 1).enumerate();
    let named: Vec<String> =
        named.map(|(i, name)| report.id(&format!("others[{i}]"), name, "videos")).collect();
    let others = if given.whole_setup { Others::Setup } else { Others::Named(named) };
    let mut options = FitOptions::default();
    match given.max_iterations {
        0 => {}
        n if n <= MAX_ITERATIONS => options.max_iterations = n as usize,
        n => report.add("max_iterations", format!("is {n}; must be at most {MAX_ITERATIONS}")),
    }
    match v1::FitMethod::try_from(given.method) {
        Ok(v1::FitMethod::Unspecified | v1::FitMethod::GaussNewton) => {}
        Ok(v1::FitMethod::Paper) => options.method = Method::Paper,
        Err(_) => report.add("method", format!("is {}, which is no method", given.method)),
    }
    report.finish((video, others, choice, options))
}

pub fn simulate(request: v1::SimulateRequest) -> Result<(String, Choice, SimulateOptions), EngineError> {
    let mut report = Report::default();
    let video = report.id("video", &request.video, "videos");
    let choice = report.choice("model", request.model, &video);
    let rollouts = report.rollouts(request.rollouts);
    if request.interventions.len() > MAX_LIST {
        report.add("interventions", format!("are {}; at most {MAX_LIST}", request.interventions.len()));
    }
    let interventions = request
        .interventions
        .into_iter()
        .take(MAX_LIST)
        .enumerate()
        .filter_map(|(i, given)| intervention(&mut report, &format!("interventions[{i}]"), given))
        .collect();
    let frames = (request.frames > 0).then_some(request.frames as usize);
    report.finish((video, choice, SimulateOptions { interventions, frames, rollouts, seed: request.seed }))
}

/// Lengths of a shape by their fields.
fn lengths(shape: &Shape) -> Vec<(&'static str, f64)> {
    match *shape {
        Shape::Disc { radius } => vec![("disc.radius", radius)],
        Shape::Ball { radius } => vec![("ball.radius", radius)],
        Shape::Square { half_side } => vec![("square.half_side", half_side)],
        Shape::Rectangle { half_length, half_width } => {
            vec![("rectangle.half_length", half_length), ("rectangle.half_width", half_width)]
        }
    }
}

fn intervention(r: &mut Report, path: &str, given: v1::Intervention) -> Option<Intervention> {
    use v1::intervention::Kind;
    let Some(kind) = given.kind else {
        r.add(path, "is empty or unknown; say what to do");
        return None;
    };
    Some(match kind {
        Kind::Remove(g) => Intervention::Remove { id: g.object_id },
        Kind::ScaleMass(g) => {
            let factor = r.range(&format!("{path}.scale_mass.factor"), g.factor, FACTOR_RANGE, "");
            Intervention::ScaleMass { id: g.object_id, factor }
        }
        Kind::SetVelocity(g) => {
            let velocity = r.vector(&format!("{path}.set_velocity.velocity"), g.velocity, MAX_SPEED, "m/s");
            Intervention::SetVelocity { id: g.object_id, velocity }
        }
        Kind::Place(g) => {
            let position = r.vector(&format!("{path}.place.position"), g.position, MAX_POSITION, "m");
            let turned = [-MAX_ANGLE, MAX_ANGLE];
            let yaw = g.yaw.map(|yaw| r.range(&format!("{path}.place.yaw"), yaw, turned, "rad"));
            Intervention::Place { id: g.object_id, position, yaw }
        }
        Kind::Add(g) => {
            let at = |field: &str| format!("{path}.add.{field}");
            let shape = r.shape(&at("shape"), g.shape);
            for (size, length) in lengths(&shape) {
                r.range(&at(&format!("shape.{size}")), length, SIZE_RANGE, "m");
            }
            let mass = r.range(&at("mass"), g.mass.unwrap_or(1.0), MASS_RANGE, "kg");
            if g.material.len() > MAX_NAME {
                r.add(at("material"), format!("has {} bytes; at most {MAX_NAME}", g.material.len()));
            }
            let velocity = Some(g.velocity.unwrap_or_default());
            let state = State {
                position: r.vector(&at("position"), g.position, MAX_POSITION, "m"),
                yaw: r.range(&at("yaw"), g.yaw, [-MAX_ANGLE, MAX_ANGLE], "rad"),
                velocity: r.vector(&at("velocity"), velocity, MAX_SPEED, "m/s"),
                ..State::default()
            };
            let time = r.range(&at("start_time"), g.start_time, [-MAX_TIME, MAX_TIME], "s");
            let start = Start { time, state, rolling: shape.is_ball() };
            Intervention::Add { body: BodySpec { id: g.object_id, material: g.material, shape, mass, start } }
        }
        Kind::ScaleRestitution(g) => {
            let range = [0.0, FACTOR_RANGE[1]];
            let factor = r.range(&format!("{path}.scale_restitution.factor"), g.factor, range, "");
            Intervention::ScaleRestitution { id: g.object_id, factor }
        }
        Kind::ScaleVelocity(g) => {
            let range = [-FACTOR_RANGE[1], FACTOR_RANGE[1]];
            let factor = r.range(&format!("{path}.scale_velocity.factor"), g.factor, range, "");
            Intervention::ScaleVelocity { id: g.object_id, factor }
        }
        Kind::Shift(g) => {
            let by = r.vector(&format!("{path}.shift.by"), g.by, MAX_POSITION, "m");
            Intervention::Shift { id: g.object_id, by }
        }
        Kind::SwitchEffect(g) => Intervention::SwitchEffect { name: g.effect, on: g.on },
    })
}

pub fn ask(request: v1::AskRequest) -> Result<(String, Choice, Question, AskOptions), EngineError> {
    use v1::ask_request::Question as Given;
    use v1::choice::Choice as One;
    let mut r = Report::default();
    let video = r.id("video", &request.video, "videos");
    let choice = r.choice("model", request.model, &video);
    let options = AskOptions { rollouts: r.rollouts(request.rollouts), seed: request.seed };
    if request.choices.len() > MAX_LIST {
        r.add("choices", format!("are {}; at most {MAX_LIST}", request.choices.len()));
    }
    let given = request.choices.into_iter().take(MAX_LIST).map(|c| c.choice).enumerate();
    let question = match request.question {
        Some(Given::Text(text)) => {
            let question = r.text("text", text);
            let mut choices = Vec::new();
            for (i, one) in given {
                match one {
                    Some(One::Text(text)) => choices.push(r.text(&format!("choices[{i}].text"), text)),
                    _ => r.add(format!("choices[{i}].text"), "is missing; the question is English"),
                }
            }
            Question::English { question, choices }
        }
        Some(Given::Program(program)) => {
            let mut choices = Vec::new();
            for (i, one) in given {
                match one {
                    Some(One::Program(program)) => choices.push(program.tokens),
                    _ => r.add(format!("choices[{i}].program"), "is missing; the question is a program"),
                }
            }
            r.tokens("program", &program.tokens);
            for (i, tokens) in choices.iter().enumerate() {
                r.tokens(&format!("choices[{i}].program"), tokens);
            }
            Question::Program { program: program.tokens, choices }
        }
        None => {
            r.add("question", "is missing; give text or program");
            Question::Program { program: vec![], choices: vec![] }
        }
    };
    r.finish((video, choice, question, options))
}
