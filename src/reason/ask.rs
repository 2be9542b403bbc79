//! Answers a question about a fitted scene by running its program on every rollout.
//!
//! 1. English becomes a program (`english`); its types are checked before anything is simulated (`program`).
//! 2. The program runs on the best rollout and on n rollouts with parameters drawn from the posterior (`predict`). What it needs is
//!    simulated once: the scene as it is, 58 frames beyond the video, and each set of interventions, up to the video's end.
//! 3. The probability of an answer is the share of the rollouts that give it (a Monte Carlo estimate of the posterior predictive
//!    probability; its standard error is `sqrt(p (1 - p) / n)`). A rollout without the event in question is left out of the count.
//!    A choice is correct if its probability is at least 0.5; an open question has the most frequent answer.

use super::context::{Halt, RolloutContext};
use super::describe::{describe, describe_event};
use super::english::{choice_program, is_explanatory, question_program};
use super::events::{FUTURE_FRAMES, Scenario, SceneEvent, scenario};
use super::predict::{Prediction, PredictionRequest, predict};
use super::program::{Op, QuestionProgram, Type};
use super::run::{DerivationStep, run};
use super::value::ProgramValue;
use super::words::{DrawnWords, WordDraw, WordFamily, WordProbabilities};
use super::{ReasonError, ops};
use crate::fit::{Fit, ObjectEstimate};
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::{EventKind, Intervention, UnseenPush};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Draws of words for each rollout of the physics: a word that is wrong with 1 % is then drawn with 32 rollouts, and running a program
/// costs far less than a rollout.
const WORD_DRAWS: usize = 16;
/// An answer less probable than this says what the video does not determine.
const CERTAIN: f64 = 0.75;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Question {
    English { question: String, choices: Vec<String> },
    Program { program: Vec<String>, choices: Vec<Vec<String>> },
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AskOptions {
    /// Models drawn from the posterior.
    pub rollouts: usize,
    pub seed: u64,
}

impl Default for AskOptions {
    fn default() -> Self {
        AskOptions { rollouts: 32, seed: 0 }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Of an open question.
    pub answer: Option<String>,
    pub choices: Vec<ChoiceAnswer>,
    /// Probability of the open answer; with choices, that of the least certain verdict on a choice.
    pub probability: f64,
    #[serde(rename = "trail")]
    pub derivation: Vec<DerivationStep>,
    pub program: Vec<String>,
    /// One or two sentences.
    pub explanation: String,
    /// The simulations that the answer is based on.
    pub simulations: Vec<Prediction>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChoiceAnswer {
    pub choice: String,
    pub correct: bool,
    /// Share of the rollouts in which the choice is correct.
    pub probability: f64,
    #[serde(rename = "trail")]
    pub derivation: Vec<DerivationStep>,
}

/// A question under way, with what is simulated so far.
struct Session<'a> {
    scene: &'a Scene,
    words: Option<&'a WordProbabilities>,
    fit: &'a Fit,
    index: usize,
    options: AskOptions,
    stop: Stop<'a>,
    effects: Vec<String>,
    scenarios: Vec<Scenario>,
    simulations: Vec<Prediction>,
}

/// Answers a question about scene `index` of the fit. Deterministic.
pub fn ask(
    scene: &Scene,
    fit: &Fit,
    index: usize,
    question: &Question,
    options: &AskOptions,
    stop: Stop,
) -> Result<Answer, ReasonError> {
    answer(scene, None, (fit, index), question, options, stop)
}

/// A scene with the words of a lexicon for it.
#[derive(Debug, Clone, Copy)]
pub struct WordedScene<'a> {
    pub scene: &'a Scene,
    pub words: &'a WordProbabilities,
}

/// Answers a question whose words are those of a lexicon. The scene's own words are read only for families that it lacks.
/// Deterministic.
pub fn ask_with_words(
    worded: WordedScene,
    fit: &Fit,
    index: usize,
    question: &Question,
    options: &AskOptions,
    stop: Stop,
) -> Result<Answer, ReasonError> {
    let mut scene = worded.scene.clone();
    let draw = WordDraw::best(worded.words, scene.objects.len());
    let drawn = DrawnWords { words: worded.words, draw: &draw };
    for (k, object) in scene.objects.iter_mut().enumerate() {
        let word = |family, own: &str| drawn.of_family(family, k).unwrap_or(own).to_string();
        object.color = word(WordFamily::Color, &object.color);
        object.material = word(WordFamily::Material, &object.material);
    }
    answer(&scene, Some(worded.words), (fit, index), question, options, stop)
}

fn answer(
    scene: &Scene,
    words: Option<&WordProbabilities>,
    (fit, index): (&Fit, usize),
    question: &Question,
    options: &AskOptions,
    stop: Stop,
) -> Result<Answer, ReasonError> {
    if index >= fit.scenes.len() {
        return Err(ReasonError::NoSuchScene { index, scenes: fit.scenes.len() });
    }
    let (mut program, choices) = programs(question, words)?;
    let open_list = choices.is_empty() && program.ops.contains(&Op::BelongTo);
    if open_list && program.ops.contains(&Op::Negate) {
        let expected = "a verdict on choices: give some, or ask without \"not\"";
        let found = "a list of all events that do not happen".to_string();
        return Err(ReasonError::ProgramResult { expected, found });
    }
    if open_list {
        // Without choices, the answer is the list of events.
        let keep = program.ops.iter().position(|op| *op == Op::BelongTo).unwrap_or(program.ops.len());
        program.ops.truncate(keep);
        program.tokens.truncate(keep);
    }
    for (_, choice) in &choices {
        let mut stack = vec![];
        choice.check(&mut stack)?;
        result(&program, stack, Some(Type::Bool))?;
    }
    if choices.is_empty() {
        result(&program, vec![], None)?;
    }
    let options = AskOptions { rollouts: options.rollouts.min(fit.draws()), ..*options };
    let active = fit.scenes.get(index).into_iter().flat_map(|s| &s.model.effects).filter(|e| e.on);
    let effects = active.map(|e| e.name.clone()).collect();
    let (scenarios, simulations) = (vec![], vec![]);
    let mut session = Session { scene, words, fit, index, options, stop, effects, scenarios, simulations };
    let mut answer =
        if choices.is_empty() { session.open(&program)? } else { session.choices(&program, &choices)? };
    answer.program = program.tokens;
    if answer.probability < CERTAIN {
        let met = session.colliding_objects();
        answer.explanation += &doubt(scene, fit.objects(index).iter().filter(|o| met.contains(&o.id)));
    }
    answer.explanation += &reach(scene, &session.simulations);
    answer.simulations = session.simulations;
    Ok(answer)
}

type Choices = Vec<(String, QuestionProgram)>;

fn programs(
    question: &Question,
    words: Option<&WordProbabilities>,
) -> Result<(QuestionProgram, Choices), ReasonError> {
    let vocabulary = words.map_or(vec![], WordProbabilities::vocabulary);
    let parse = |tokens: &[String]| -> Result<QuestionProgram, ReasonError> {
        let program = QuestionProgram::parse_with(tokens, &vocabulary)?;
        words.map_or(Ok(()), |words| check_words(&program, words))?;
        Ok(program)
    };
    match question {
        Question::English { question, choices } => {
            let tokens = question_program(question)?;
            let observed = is_explanatory(&tokens);
            let choices = choices.iter().map(|c| Ok((c.clone(), parse(&choice_program(c, observed)?)?)));
            Ok((parse(&tokens)?, choices.collect::<Result<_, ReasonError>>()?))
        }
        Question::Program { program, choices } => {
            let choices = choices.iter().map(|c| Ok((c.join(" "), parse(c)?)));
            Ok((parse(program)?, choices.collect::<Result<_, ReasonError>>()?))
        }
    }
}

/// Refuses a word of a family that the lexicon has not learned.
fn check_words(program: &QuestionProgram, words: &WordProbabilities) -> Result<(), ReasonError> {
    for op in &program.ops {
        let (family, word) = match op {
            Op::Color(word) => (WordFamily::Color, word),
            Op::Material(word) => (WordFamily::Material, word),
            Op::Shape(word) => (WordFamily::Shape, word),
            _ => continue,
        };
        let known = words.family(family).map_or(&[][..], |f| &f.words);
        if words.family(family).is_some() && !known.iter().any(|w| w == word) {
            return Err(ReasonError::UnknownWord { word: word.to_string(), known: known.to_vec() });
        }
    }
    Ok(())
}

/// How far the simulations run, which objects move as observed in every counterfactual, and whether a rollout ended early.
fn reach(scene: &Scene, simulations: &[Prediction]) -> String {
    let counterfactuals: Vec<&Prediction> =
        simulations.iter().filter(|s| !s.interventions.is_empty()).collect();
    let kept = scene.objects.iter().filter(|o| counterfactuals.iter().all(|s| s.unreached.contains(&o.id)));
    let kept: Vec<String> = kept.map(ops::phrase).collect();
    let mut words = String::new();
    let end = scene.times.last().copied().unwrap_or(0.0);
    let duration = |what: &str, s: &Prediction| {
        let until = s.best.times.last().copied().unwrap_or(end);
        match until > end {
            true => format!(" {what} runs to {until:.1} s, {:.1} s beyond the video.", until - end),
            false => format!(" {what} runs to the end of the video, {until:.1} s."),
        }
    };
    words += &simulations
        .iter()
        .find(|s| s.interventions.is_empty())
        .map_or(String::new(), |s| duration("The prediction", s));
    words += &counterfactuals.first().map_or(String::new(), |s| duration("The counterfactual", s));
    if !counterfactuals.is_empty() && !kept.is_empty() {
        words += &format!(" The change does not affect {}, which moves as observed.", kept.join(" or "));
    }
    let pushed = simulations.first().map_or(vec![], |s| s.model.unseen_pushes());
    if !pushed.is_empty() {
        let all: Vec<String> = pushed.iter().map(UnseenPush::sentence).collect();
        words += &format!(" In every simulation {}, as in the video.", all.join("; "));
    }
    if let Some(cut) = simulations.iter().find_map(|s| s.cut_short) {
        words += &format!(" {} rollouts ended early ({}).", cut.rollouts, cut.why);
    }
    words
}

/// Why an answer is uncertain: what the video does not determine of the objects that the answer depends on.
pub(super) fn doubt<'a>(scene: &Scene, objects: impl Iterator<Item = &'a ObjectEstimate>) -> String {
    let open = objects.filter_map(|o| {
        let what = match (o.mass.identified, o.restitution.identified) {
            (true, true) => return None,
            (false, true) => "mass of",
            (true, false) => "restitution of",
            (false, false) => "mass and restitution of",
        };
        let object = scene.objects.get(scene.object_index(o.id)?)?;
        Some(format!("the {what} {}", ops::phrase(object)))
    });
    let open: Vec<String> = open.collect();
    match open.is_empty() {
        true => {
            " This is uncertain: the answer depends on differences within the noise of the video.".to_string()
        }
        false => format!(" This is uncertain: the video does not determine {}.", open.join(", ")),
    }
}

/// Checks that the program leaves one value, of the wanted type.
fn result(program: &QuestionProgram, mut stack: Vec<Type>, wanted: Option<Type>) -> Result<(), ReasonError> {
    program.check(&mut stack)?;
    match stack[..] {
        [one] if wanted.is_none_or(|w| w == one) => Ok(()),
        _ => {
            let expected = if wanted.is_some() { "yes or no for each choice" } else { "one value" };
            let names: Vec<&str> = stack.iter().map(|t| t.name()).collect();
            let found = if names.is_empty() { "nothing".to_string() } else { names.join(", ") };
            Err(ReasonError::ProgramResult { expected, found })
        }
    }
}

impl Session<'_> {
    /// Runs programs on one stack and one rollout; simulates the scenarios that they need.
    fn evaluate(
        &mut self,
        programs: &[&QuestionProgram],
        rollout: usize,
        draw: Option<&WordDraw>,
    ) -> Result<(Option<ProgramValue>, Vec<DerivationStep>), ReasonError> {
        let words = self.words.zip(draw).map(|(words, draw)| DrawnWords { words, draw });
        loop {
            let bodies = self.fit.scenes.get(self.index).map_or(&[][..], |s| &s.model.bodies);
            let (scene, effects, scenarios) = (self.scene, &self.effects, &self.scenarios);
            let context = RolloutContext { scene, bodies, effects, scenarios, rollout, words };
            let mut derivation = vec![];
            let outcome = programs.iter().try_fold(vec![], |stack, program| {
                let (stack, steps) = run(program, context, stack)?;
                derivation.extend(steps);
                Ok(stack)
            });
            match outcome {
                Ok(mut stack) => return Ok((stack.pop(), derivation)),
                // Simulated already, with fewer rollouts than requested: this rollout does not count.
                Err(Halt::NeedsSimulation(needed))
                    if self.scenarios.iter().any(|s| s.interventions == needed) =>
                {
                    return Err(ReasonError::NoSingleEvent { found: "no such rollout".to_string() });
                }
                Err(Halt::NeedsSimulation(interventions)) => self.simulate(&interventions)?,
                Err(Halt::Error(error)) => return Err(error),
            }
        }
    }

    /// Objects that collide in some simulation.
    fn colliding_objects(&self) -> BTreeSet<u32> {
        let events = self.simulations.iter().flat_map(|s| &s.events);
        events
            .filter(|e| e.event.kind == EventKind::Collision)
            .flat_map(|e| e.event.objects.clone())
            .collect()
    }

    fn simulate(&mut self, interventions: &[Intervention]) -> Result<(), ReasonError> {
        let after = if interventions.is_empty() { FUTURE_FRAMES } else { 0 };
        let frames = self.scene.times.len() + after;
        let AskOptions { rollouts, seed } = self.options;
        let request = PredictionRequest { interventions: interventions.to_vec(), frames, rollouts, seed };
        let prediction = predict(self.scene, self.fit, self.index, &request, self.stop)?;
        self.scenarios.push(scenario(self.scene, &prediction));
        self.simulations.push(prediction);
        Ok(())
    }

    /// The values over the ensemble (without one, that of the best rollout), and the derivation on the best rollout.
    fn over_rollouts(
        &mut self,
        programs: &[&QuestionProgram],
    ) -> Result<(Vec<ProgramValue>, Vec<DerivationStep>), ReasonError> {
        if let Some(words) = self.words {
            return self.over_draws(programs, words);
        }
        let best = self.evaluate(programs, 0, None);
        let mut values = vec![];
        for rollout in 1..=self.options.rollouts {
            match self.evaluate(programs, rollout, None) {
                Ok((value, _)) => values.extend(value),
                // Without the event in question, this rollout does not count.
                Err(ReasonError::NoSingleEvent { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        match best {
            Ok((value, derivation)) => {
                if values.is_empty() {
                    values.extend(value);
                }
                Ok((values, derivation))
            }
            Err(ReasonError::NoSingleEvent { .. }) if !values.is_empty() => Ok((values, vec![])),
            Err(error) => Err(error),
        }
    }

    /// The same over draws of words: [`WORD_DRAWS`] for each rollout.
    fn over_draws(
        &mut self,
        programs: &[&QuestionProgram],
        words: &WordProbabilities,
    ) -> Result<(Vec<ProgramValue>, Vec<DerivationStep>), ReasonError> {
        let objects = self.scene.objects.len();
        let best = self.evaluate(programs, 0, Some(&WordDraw::best(words, objects)));
        let mut values = vec![];
        let rollouts = self.options.rollouts;
        for k in 0..WORD_DRAWS * rollouts.max(1) {
            let draw = WordDraw::drawn(words, objects, self.options.seed, k);
            match self.evaluate(programs, if rollouts == 0 { 0 } else { 1 + k % rollouts }, Some(&draw)) {
                Ok((value, _)) => values.extend(value),
                // A draw against what the question presupposes does not count.
                Err(
                    ReasonError::NoSingleEvent { .. }
                    | ReasonError::NoSuchObject { .. }
                    | ReasonError::AmbiguousObject { .. },
                ) => {}
                Err(error) => return Err(error),
            }
        }
        match best {
            Ok((value, derivation)) => {
                if values.is_empty() {
                    values.extend(value);
                }
                Ok((values, derivation))
            }
            Err(_) if !values.is_empty() => Ok((values, vec![])),
            Err(error) => Err(error),
        }
    }

    fn choices(&mut self, program: &QuestionProgram, choices: &Choices) -> Result<Answer, ReasonError> {
        let mut answers = vec![];
        for (text, choice) in choices {
            let (values, derivation) = self.over_rollouts(&[choice, program])?;
            let yes = values.iter().filter(|v| **v == ProgramValue::Bool(true)).count();
            let probability = yes as f64 / values.len().max(1) as f64;
            answers.push(ChoiceAnswer {
                choice: text.clone(),
                correct: probability >= 0.5,
                probability,
                derivation,
            });
        }
        let certainty = |c: &ChoiceAnswer| if c.correct { c.probability } else { 1.0 - c.probability };
        let right: Vec<String> = answers
            .iter()
            .filter(|c| c.correct)
            .map(|c| format!("\"{}\" ({:.0} %)", c.choice, 100.0 * c.probability))
            .collect();
        let rollouts = self.options.rollouts.max(1);
        Ok(Answer {
            answer: None,
            probability: answers.iter().map(certainty).fold(1.0, f64::min),
            explanation: match &right[..] {
                [] => format!("No choice is correct by {rollouts} simulations."),
                _ => format!("Correct by {rollouts} simulations: {}.", right.join(", ")),
            },
            derivation: answers.first().map(|c| c.derivation.clone()).unwrap_or_default(),
            choices: answers,
            program: vec![],
            simulations: vec![],
        })
    }

    fn open(&mut self, program: &QuestionProgram) -> Result<Answer, ReasonError> {
        let (values, derivation) = self.over_rollouts(&[program])?;
        let (answer, probability) = if matches!(values.first(), Some(ProgramValue::Events(_))) {
            self.likely_events(&values)
        } else {
            let mut tally: Vec<(String, usize)> = vec![];
            for value in &values {
                let text = describe(self.scene, value);
                match tally.iter_mut().find(|(t, _)| *t == text) {
                    Some((_, n)) => *n += 1,
                    None => tally.push((text, 1)),
                }
            }
            // Of equally frequent answers the first one, so that the result is deterministic.
            let most = tally.iter().rev().max_by_key(|(_, n)| *n).cloned().unwrap_or_default();
            (most.0, most.1 as f64 / values.len().max(1) as f64)
        };
        Ok(Answer {
            explanation: format!("{:.0} % of {} rollouts agree.", 100.0 * probability, values.len()),
            answer: Some(answer),
            choices: vec![],
            probability,
            derivation,
            program: vec![],
            simulations: vec![],
        })
    }

    /// The events of at least half of the rollouts, in words, and the share of the least likely of them.
    fn likely_events(&self, values: &[ProgramValue]) -> (String, f64) {
        let mut tally: Vec<(SceneEvent, usize)> = vec![];
        for value in values {
            let ProgramValue::Events(events) = value else { continue };
            for (k, event) in events.iter().enumerate() {
                if events.iter().take(k).any(|e| e.is_like(event)) {
                    continue;
                }
                match tally.iter_mut().find(|(e, _)| e.is_like(event)) {
                    Some((_, n)) => *n += 1,
                    None => tally.push((event.clone(), 1)),
                }
            }
        }
        let share = |n: usize| n as f64 / values.len().max(1) as f64;
        let likely: Vec<_> = tally.iter().filter(|(_, n)| share(*n) >= 0.5).collect();
        if likely.is_empty() {
            let most = tally.iter().map(|(_, n)| share(*n)).fold(0.0, f64::max);
            return ("nothing is likely to happen".to_string(), 1.0 - most);
        }
        // The share of a single event is the probability of the answer.
        let words = likely.iter().map(|(e, n)| match likely.len() {
            1 => describe_event(self.scene, e),
            _ => format!("{} ({:.0} %)", describe_event(self.scene, e), 100.0 * share(*n)),
        });
        let least = likely.iter().map(|(_, n)| share(*n)).fold(1.0, f64::min);
        (words.collect::<Vec<_>>().join("; "), least)
    }
}
