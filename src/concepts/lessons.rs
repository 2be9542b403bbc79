//! Lessons: videos with questions and their answers, as training reads them.

use super::error::ConceptError;
use super::features::{FeatureLayout, appearance};
use super::observed::observed_scenario;
use super::tape::{Tape, Variable};
use crate::fit::Fit;
use crate::num::Stop;
use crate::reason::{
    Op, Prediction, PredictionRequest, ProgramValue, Question, QuestionProgram, ReasonError, Scenario,
    SpanKind, WordFamily, active_effects, choice_program, question_program, simulated,
};
use crate::scene::Scene;
use crate::world::{Intervention, Model};

/// A video with questions and their answers. Words of its objects are not read.
#[derive(Debug, Clone, Copy)]
pub struct LessonVideo<'a> {
    pub scene: &'a Scene,
    /// The physics, with the scene's index in it: its simulations give the events. Without, events come from the tracks, and
    /// questions that need simulations are left out.
    pub fit: Option<(&'a Fit, usize)>,
    pub lessons: &'a [Lesson],
}

#[derive(Debug, Clone, PartialEq)]
pub struct Lesson {
    pub question: Question,
    pub answer: LessonAnswer,
}

#[derive(Debug, Clone, PartialEq)]
pub enum LessonAnswer {
    /// A word, a number, "yes" or "no".
    Open(String),
    /// Whether each choice is correct.
    Choices(Vec<bool>),
}

/// A question, or one choice of it, with its answer.
#[derive(Debug, Clone)]
pub(super) struct LessonItem {
    /// The choice's program before the question's.
    pub programs: Vec<QuestionProgram>,
    pub target: ProgramValue,
    /// One for a question, shared by its choices.
    pub weight: f64,
    pub needs_simulation: bool,
}

/// A video as training reads it.
pub(super) struct PreparedVideo<'a> {
    pub scene: &'a Scene,
    pub fit: Option<(&'a Fit, usize)>,
    /// `[object][feature]`: raw when prepared, standardised for training.
    pub features: Vec<Vec<f64>>,
    pub items: Vec<LessonItem>,
    pub scenarios: Vec<Scenario>,
    /// The simulation of each scenario, in the same order; none without a fit.
    pub simulations: Vec<Prediction>,
    /// The fitted model, if there is one.
    pub models: Vec<Model>,
    pub effects: Vec<String>,
    /// Its last run on a tape, to be replayed with other words.
    pub recorded: Option<RecordedLoss>,
}

/// Which items of a video are run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RunItems {
    /// Those about observed events.
    Observed,
    All,
    /// All but those whose simulations are not there.
    Simulated,
}

/// The items of a video on a tape.
pub(super) struct RecordedLoss {
    pub tape: Tape,
    pub items: RunItems,
    /// Logits of the words: family by family, object by object.
    pub logits: Vec<Variable>,
    pub loss: Variable,
    /// Weight of the items on it.
    pub questions: f64,
    pub answers: Vec<RecordedAnswer>,
}

/// The probabilities of the answers of one item.
pub(super) struct RecordedAnswer {
    pub right: Variable,
    /// Of the other answers that have one.
    pub others: Vec<Variable>,
    /// That what the item presupposes holds.
    pub presupposed: Variable,
    pub weight: f64,
}

/// The words of each family that the lessons name or answer, sorted, with how often.
pub(super) type FamilyWords = Vec<(WordFamily, Vec<(String, usize)>)>;

/// Tokens of a question and of each choice.
pub(super) struct LessonTokens {
    question: Vec<String>,
    choices: Vec<Vec<String>>,
}

fn tokens(question: &Question) -> Result<LessonTokens, ReasonError> {
    Ok(match question {
        Question::Program { program, choices } => {
            LessonTokens { question: program.clone(), choices: choices.clone() }
        }
        Question::English { question, choices } => {
            let program = question_program(question)?;
            let observed = program.iter().any(|t| t == "filter_ancestor");
            let choices = choices.iter().map(|c| choice_program(c, observed)).collect::<Result<_, _>>()?;
            LessonTokens { question: program, choices }
        }
    })
}

/// The words before the filters of a program, and the family that it asks for.
fn words_of(program: &[String], found: &mut Vec<(WordFamily, String)>) -> Option<WordFamily> {
    for pair in program.windows(2) {
        if let Some(family) = WordFamily::ALL.into_iter().find(|f| f.filter() == pair[1]) {
            // A scene's own word has the name of its family before it.
            let word = pair[0].rsplit(':').next().unwrap_or(&pair[0]);
            found.push((family, word.to_string()));
        }
    }
    match program.last().map(String::as_str) {
        Some("query_color") => Some(WordFamily::Color),
        Some("query_material") => Some(WordFamily::Material),
        Some("query_shape") => Some(WordFamily::Shape),
        _ => None,
    }
}

/// The tokens of all lessons, by video.
pub(super) fn read(videos: &[LessonVideo]) -> Result<Vec<Vec<LessonTokens>>, ConceptError> {
    let one = |video: usize, (question, lesson): (usize, &Lesson)| {
        tokens(&lesson.question).map_err(|source| ConceptError::Question { video, question, source })
    };
    let of =
        |(v, video): (usize, &LessonVideo)| video.lessons.iter().enumerate().map(|l| one(v, l)).collect();
    videos.iter().enumerate().map(of).collect()
}

/// All words of the lessons, by family.
pub(super) fn family_words(videos: &[LessonVideo], tokens: &[Vec<LessonTokens>]) -> FamilyWords {
    let mut all: FamilyWords = WordFamily::ALL.map(|f| (f, vec![])).to_vec();
    for (video, tokens) in videos.iter().zip(tokens) {
        for (lesson, read) in video.lessons.iter().zip(tokens) {
            let mut found = vec![];
            let asked = words_of(&read.question, &mut found);
            read.choices.iter().for_each(|c| {
                words_of(c, &mut found);
            });
            if let (Some(family), LessonAnswer::Open(word)) = (asked, &lesson.answer) {
                found.push((family, word.clone()));
            }
            for (family, word) in found {
                let Some((_, words)) = all.iter_mut().find(|(f, _)| *f == family) else { continue };
                match words.iter_mut().find(|(w, _)| *w == word) {
                    Some((_, count)) => *count += 1,
                    None => words.push((word, 1)),
                }
            }
        }
    }
    all.iter_mut().for_each(|(_, words)| words.sort());
    all.retain(|(_, words)| !words.is_empty());
    all
}

/// The words that are not tokens of the vocabulary.
pub(super) fn vocabulary(words: &FamilyWords) -> Vec<String> {
    let all = words.iter().flat_map(|(_, w)| w.iter().map(|(word, _)| word.clone()));
    all.filter(|word| Op::of(word).is_none()).collect()
}

/// Prepares the lessons of all videos.
pub(super) fn prepare<'a>(
    videos: &[LessonVideo<'a>],
    tokens: &[Vec<LessonTokens>],
    words: &FamilyWords,
    stop: Stop,
) -> Result<(Vec<PreparedVideo<'a>>, FeatureLayout), ConceptError> {
    let known = vocabulary(words);
    let mut layout: Option<FeatureLayout> = None;
    let mut prepared = vec![];
    for (v, (video, tokens)) in videos.iter().zip(tokens).enumerate() {
        layout = Some(FeatureLayout::of_video(&|| format!("videos[{v}]"), video.scene, layout.as_ref())?);
        let mut items = vec![];
        for (q, (lesson, tokens)) in video.lessons.iter().zip(tokens).enumerate() {
            let at = |source| ConceptError::Question { video: v, question: q, source };
            items.extend(self::items(&lesson.answer, tokens, &known).map_err(|e| match e {
                ItemError::Reason(source) => at(source),
                ItemError::Answer { answer, expected } => {
                    ConceptError::Answer { video: v, question: q, answer, expected }
                }
            })?);
        }
        if video.fit.is_none() {
            items.retain(|i| !i.needs_simulation);
        }
        let mut ready = PreparedVideo {
            scene: video.scene,
            fit: video.fit,
            features: appearance(video.scene),
            items,
            scenarios: vec![],
            simulations: vec![],
            models: vec![],
            effects: vec![],
            recorded: None,
        };
        match video.fit {
            None => ready.scenarios.push(observed_scenario(video.scene)),
            Some((fit, index)) => {
                ready.models.extend(fit.scenes.get(index).map(|s| s.model.clone()));
                ready.effects = ready.models.first().map_or(vec![], active_effects);
                ready.simulate(&[], video.scene.times.len() + crate::reason::FUTURE_FRAMES, stop)?;
            }
        }
        prepared.push(ready);
    }
    let layout = layout.ok_or(ConceptError::NoQuestions)?;
    Ok((prepared, layout))
}

impl PreparedVideo<'_> {
    /// Adds the best rollout under interventions, for this number of frames; a shorter one is replaced. Without a fit it does nothing.
    pub fn simulate(
        &mut self,
        interventions: &[Intervention],
        frames: usize,
        stop: Stop,
    ) -> Result<(), ReasonError> {
        let Some(fit) = self.fit else { return Ok(()) };
        let (scenario, simulation) = simulated(self.scene, fit, &best_rollout(interventions, frames), stop)?;
        if let Some(shorter) = self.scenarios.iter().position(|s| s.interventions == interventions) {
            self.scenarios.remove(shorter);
            self.simulations.remove(shorter);
        }
        self.scenarios.push(scenario);
        self.simulations.push(simulation);
        Ok(())
    }
}

/// The best rollout under interventions, for this number of frames.
pub(super) fn best_rollout(interventions: &[Intervention], frames: usize) -> PredictionRequest {
    PredictionRequest { interventions: interventions.to_vec(), frames, rollouts: 0, seed: 0 }
}

/// Whether a program needs simulations: for what the tracks of the video do not show.
fn needs_simulation(program: &QuestionProgram) -> bool {
    let is_ahead = |op: &Op| match op {
        Op::Push(_, ProgramValue::Span(span)) => *span != SpanKind::Video,
        _ => false,
    };
    program.calls(&["filter_counterfact", "suppose", "unseen_events", "whole_events"])
        || program.ops.iter().any(is_ahead)
}

enum ItemError {
    Reason(ReasonError),
    Answer { answer: String, expected: String },
}

impl From<ReasonError> for ItemError {
    fn from(error: ReasonError) -> Self {
        ItemError::Reason(error)
    }
}

fn items(
    answer: &LessonAnswer,
    LessonTokens { question, choices }: &LessonTokens,
    known: &[String],
) -> Result<Vec<LessonItem>, ItemError> {
    let program = QuestionProgram::parse_with(question, known)?;
    match answer {
        LessonAnswer::Choices(correct) if correct.len() == choices.len() && !choices.is_empty() => {
            let weight = 1.0 / choices.len() as f64;
            let item = |(choice, correct): (&Vec<String>, &bool)| {
                let choice = QuestionProgram::parse_with(choice, known)?;
                let mut stack = vec![];
                choice.check(&mut stack)?;
                program.check(&mut stack)?;
                let needs_simulation = needs_simulation(&program) || needs_simulation(&choice);
                let target = ProgramValue::Bool(*correct);
                Ok(LessonItem { programs: vec![choice, program.clone()], target, weight, needs_simulation })
            };
            choices.iter().zip(correct).map(item).collect()
        }
        LessonAnswer::Choices(correct) => Err(ItemError::Answer {
            answer: format!("for {} choices", correct.len()),
            expected: format!("one verdict for each of {} choices", choices.len()),
        }),
        LessonAnswer::Open(text) => {
            program.check(&mut vec![])?;
            let wrong =
                |expected: &str| ItemError::Answer { answer: text.clone(), expected: expected.into() };
            let asks =
                |tokens: &[&str]| program.ops.last().is_some_and(|op| tokens.iter().any(|t| op.calls(t)));
            let target = match text.as_str() {
                number if asks(&["count", "count_colors", "count_materials", "count_shapes"]) => {
                    ProgramValue::Number(number.parse().map_err(|_| wrong("a whole number"))?)
                }
                word if asks(&["query_color", "query_material", "query_shape"]) => {
                    ProgramValue::Text(word.to_string())
                }
                "yes" => ProgramValue::Bool(true),
                "no" => ProgramValue::Bool(false),
                _ => return Err(wrong("yes or no")),
            };
            let needs_simulation = needs_simulation(&program);
            Ok(vec![LessonItem { programs: vec![program], target, weight: 1.0, needs_simulation }])
        }
    }
}
