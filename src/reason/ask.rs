//! Answers a question about a fitted scene by running its program on every rollout.
//!
//! 1. English becomes a program (`english`); its types are checked before anything is simulated (`program`).
//! 2. The program runs on the best rollout and on n rollouts with parameters drawn from the posterior (`predict`). What it needs is
//!    simulated once: the scene as it is, 58 frames beyond the video, and each set of interventions, up to the video's end.
//!    A question about the video alone simulates no frame after it.
//! 3. The probability of an answer is estimated from the k of n rollouts that give it as `(k + 1/2) / (n + 1)` (the mean under
//!    Jeffreys' prior): no finite number of simulations proves that something is certain. What is read from the scene alone has
//!    probability 1. With a lexicon, several draws of words share a rollout (`words`), and n is the number of rollouts still: k is
//!    n times the share of the draws. A rollout without the event in question is left out of the count. A choice is correct if its probability is at
//!    least 0.5; an open question has the most frequent answer, a quantity its mean and deviation (`summary`).

use super::ReasonError;
use super::context::{Halt, RolloutContext, active_effects};
use super::discovery::StoredDiscovery;
use super::events::{FUTURE_FRAMES, MAX_FUTURE_FRAMES, Scenario, simulated};
use super::language::{Op, QuestionProgram, read_back};
use super::operations::ops;
use super::predict::{Prediction, PredictionRequest};
use super::reader::{Conversation, ReadingContext, read_choice, read_question};
use super::run::{DerivationStep, run};
use super::summary::{Sampling, estimated_probability, summary};
use super::types::Type;
use super::value::ProgramValue;
use super::words::{
    DrawnWords, LexiconWord, WordDraw, WordFamily, WordOfObject, WordProbabilities, spellings,
};
use crate::fit::{Fit, ObjectEstimate};
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::{EventKind, Intervention, Model, UnseenPush};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Draws of words for each rollout of the physics: a word that is wrong with 1 % is then drawn with 32 rollouts, and running a program
/// costs far less than a rollout.
const WORD_DRAWS: usize = 16;
/// Fewest positions that tell how an object moves: two give a velocity without any check of it.
const FEWEST_SAMPLES: usize = 4;
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

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Of an open question.
    pub answer: Option<String>,
    pub choices: Vec<ChoiceAnswer>,
    /// Probability of the open answer; with choices, that of the least certain verdict on a choice.
    pub probability: f64,
    #[serde(rename = "trail")]
    pub derivation: Vec<DerivationStep>,
    pub program: Vec<String>,
    /// How the question was understood.
    #[serde(default)]
    pub reading: String,
    /// One or two sentences.
    pub explanation: String,
    /// How probable the words of the lexicon that the question names are of each object.
    #[serde(default)]
    pub words: Vec<WordOfObject>,
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

/// What is known of a scene beside its fit.
#[derive(Debug, Clone, Copy)]
pub struct KnownOfScene<'a> {
    pub scene: &'a Scene,
    /// The words of a lexicon.
    pub words: Option<&'a WordProbabilities>,
    /// A discovery that included it.
    pub discovery: Option<&'a StoredDiscovery>,
}

/// A question under way, with what is simulated so far.
struct Session<'a> {
    scene: &'a Scene,
    words: Option<&'a WordProbabilities>,
    discovery: Option<&'a StoredDiscovery>,
    vocabulary: Vec<String>,
    fit: &'a Fit,
    index: usize,
    options: AskOptions,
    stop: Stop<'a>,
    effects: Vec<String>,
    /// The fitted model and the drawn ones.
    models: Vec<Model>,
    /// Frames after the video that a question about the future looks at, and whether this one does.
    future: usize,
    is_ahead: bool,
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
    let known = KnownOfScene { scene, words: None, discovery: None };
    ask_knowing(known, (fit, index), question, &Conversation::default(), options, stop)
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
    let known = KnownOfScene { scene: worded.scene, words: Some(worded.words), discovery: None };
    ask_knowing(known, (fit, index), question, &Conversation::default(), options, stop)
}

/// The scene with the most probable words of its objects.
pub fn with_best_words(scene: &Scene, words: &WordProbabilities) -> Scene {
    let mut scene = scene.clone();
    let draw = WordDraw::best(words, scene.objects.len());
    let drawn = DrawnWords { words, draw: &draw };
    for (k, object) in scene.objects.iter_mut().enumerate() {
        let word = |family, own: &str| drawn.of_family(family, k).unwrap_or(own).to_string();
        object.color = word(WordFamily::Color, &object.color);
        object.material = word(WordFamily::Material, &object.material);
    }
    scene
}

/// [`ask`], after the questions before it, with the caller's own words, with the words of a lexicon if there is one, and with what a
/// discovery has found.
pub fn ask_knowing(
    KnownOfScene { scene, words, discovery }: KnownOfScene,
    (fit, index): (&Fit, usize),
    question: &Question,
    conversation: &Conversation,
    options: &AskOptions,
    stop: Stop,
) -> Result<Answer, ReasonError> {
    if index >= fit.scenes.len() {
        return Err(ReasonError::NoSuchScene { index, scenes: fit.scenes.len() });
    }
    let worded = words.map(|words| with_best_words(scene, words));
    let scene = worded.as_ref().unwrap_or(scene);
    let lexicon = words.map_or(vec![], WordProbabilities::lexicon_words);
    let vocabulary = spellings(&lexicon);
    let Understood { mut program, choices, reading } =
        understand(Some(scene), question, conversation, &lexicon)?;
    let open_list = choices.is_empty() && program.calls(&["belong_to"]);
    let changed = open_list && program.calls(&["filter_counterfact"]);
    if open_list {
        program = list_program(&program, &vocabulary)?;
    }
    check(&program, &choices)?;
    let all = || std::iter::once(&program).chain(choices.iter().map(|(_, c)| c));
    check_words(words, all())?;
    let named = named_words(all());
    let options = AskOptions { rollouts: options.rollouts.min(fit.draws()), ..*options };
    let fitted = fit.scenes.get(index).map(|s| s.model.clone());
    let effects = fitted.as_ref().map_or(vec![], active_effects);
    let models = fitted.into_iter().chain(fit.draw(index, options.rollouts, options.seed)).collect();
    let (scenarios, simulations) = (vec![], vec![]);
    let (future, is_ahead) = (future_frames(scene, all()), all().any(looks_ahead));
    let mut session = Session {
        scene,
        words,
        discovery,
        vocabulary,
        fit,
        index,
        options,
        stop,
        effects,
        models,
        future,
        is_ahead,
        scenarios,
        simulations,
    };
    let mut answer =
        if choices.is_empty() { session.open(&program)? } else { session.choices(&program, &choices)? };
    if changed {
        answer.explanation += &session.difference(&program);
    } else if answer.answer.as_deref() == Some("no") {
        answer.explanation += &session.later(&program);
    }
    answer.words = words.map_or(vec![], |words| words.of_objects(scene, &named));
    answer.program = program.tokens;
    if answer.probability < CERTAIN {
        let met = session.colliding_objects();
        answer.explanation += &doubt(scene, fit.objects(index).iter().filter(|o| met.contains(&o.id)));
    }
    answer.explanation += &reach(scene, &session.simulations);
    if !session.simulations.is_empty() {
        answer.explanation += &hardly_seen(scene, session.is_ahead);
    }
    answer.explanation += &format!(" Read as: {}.", reading.trim_end_matches('?'));
    answer.reading = reading;
    answer.simulations = session.simulations;
    Ok(answer)
}

/// How a question is understood: its program, those of its choices, and the first in English.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParsedQuestion {
    pub program: Vec<String>,
    pub choices: Vec<Vec<String>>,
    pub reading: String,
}

/// Reads a question and checks its types, and its objects where there is a scene. Nothing is simulated.
pub fn dry_run(
    scene: Option<&Scene>,
    question: &Question,
    conversation: &Conversation,
    lexicon: &[LexiconWord],
) -> Result<ParsedQuestion, ReasonError> {
    let Understood { mut program, choices, reading } = understand(scene, question, conversation, lexicon)?;
    if choices.is_empty() && program.calls(&["belong_to"]) {
        let vocabulary = spellings(lexicon);
        program = list_program(&program, &vocabulary)?;
    }
    check(&program, &choices)?;
    if let Some(scene) = scene {
        let context = RolloutContext::of_scene(scene, &[]);
        for program in std::iter::once(&program).chain(choices.iter().map(|(_, c)| c)) {
            resolve_objects(program, context)?;
        }
    }
    let choices = choices.into_iter().map(|(_, program)| program.tokens).collect();
    Ok(ParsedQuestion { program: program.tokens, choices, reading })
}

/// Runs each part of a program that describes an object.
fn resolve_objects(program: &QuestionProgram, context: RolloutContext) -> Result<(), ReasonError> {
    let starts = |op: &Op| op.calls("objects");
    let describes = |op: &Op| {
        matches!(op, Op::Push(..))
            || ["filter_color", "filter_material", "filter_shape", "unique", "objects"]
                .iter()
                .any(|t| op.calls(t))
    };
    for (first, _) in program.ops.iter().enumerate().filter(|(_, op)| starts(op)) {
        let ops: Vec<Op> = program.ops.iter().skip(first).take_while(|op| describes(op)).cloned().collect();
        let Some(last) = ops.iter().position(|op| op.calls("unique")) else { continue };
        let ops: Vec<Op> = ops.into_iter().take(last + 1).collect();
        let tokens = program.tokens.iter().skip(first).take(ops.len()).cloned().collect();
        if let Err(Halt::Error(error)) = run(&QuestionProgram { ops, tokens }, context, vec![]) {
            return Err(error);
        }
    }
    Ok(())
}

/// Without choices, the answer is the list of events: those that the program selects, or those of the video that it leaves out.
fn list_program(program: &QuestionProgram, vocabulary: &[String]) -> Result<QuestionProgram, ReasonError> {
    let keep = program.ops.iter().position(|op| op.calls("belong_to")).unwrap_or(program.ops.len());
    let mut tokens: Vec<String> = program.tokens.iter().take(keep).cloned().collect();
    if program.ops.iter().skip(keep).any(|op| op.calls("negate")) {
        if program.calls(&["unseen_events"]) {
            let expected = "a verdict on choices: give some, or ask without \"not\"";
            let found = "a list of all events that do not happen".to_string();
            return Err(ReasonError::ProgramResult { expected, found });
        }
        tokens.push("lost_events".to_string());
    }
    QuestionProgram::parse_with(&tokens, vocabulary)
}

fn check(program: &QuestionProgram, choices: &Choices) -> Result<(), ReasonError> {
    for (_, choice) in choices {
        let mut stack = vec![];
        choice.check(&mut stack)?;
        result(program, stack, Some(Type::Bool))?;
    }
    if choices.is_empty() { result(program, vec![], None) } else { Ok(()) }
}

/// Refuses a word of a family that the lexicon has not learned.
fn check_words<'a>(
    words: Option<&WordProbabilities>,
    programs: impl Iterator<Item = &'a QuestionProgram>,
) -> Result<(), ReasonError> {
    let Some(words) = words else { return Ok(()) };
    for op in programs.flat_map(|p| &p.ops) {
        let (family, word) = match op {
            Op::Push(Type::Color, ProgramValue::Word(word)) => (WordFamily::Color, word),
            Op::Push(Type::Material, ProgramValue::Word(word)) => (WordFamily::Material, word),
            Op::Push(Type::Shape, ProgramValue::Word(word)) => (WordFamily::Shape, word),
            _ => continue,
        };
        let Some(known) = words.family(family).map(|f| &f.words) else { continue };
        if !known.contains(word) {
            return Err(ReasonError::UnknownWord { word: word.clone(), known: known.clone() });
        }
    }
    Ok(())
}

/// The words that programs name, each once.
fn named_words<'a>(programs: impl Iterator<Item = &'a QuestionProgram>) -> Vec<String> {
    let mut named: Vec<String> = vec![];
    for op in programs.flat_map(|p| &p.ops) {
        if let Op::Push(_, ProgramValue::Word(word)) = op
            && !named.contains(word)
        {
            named.push(word.clone());
        }
    }
    named
}

/// Whether a program looks beyond the video.
fn looks_ahead(program: &QuestionProgram) -> bool {
    const AHEAD: [&str; 5] = ["unseen_events", "whole_events", "prediction", "video_and_prediction", "later"];
    program.calls(&AHEAD[..2]) || program.tokens.iter().any(|t| AHEAD.contains(&t.as_str()))
}

/// Frames after the video that a question looks at: more where it names a later time or asks until when something moves.
fn future_frames<'a>(scene: &Scene, programs: impl Iterator<Item = &'a QuestionProgram>) -> usize {
    let mut future = FUTURE_FRAMES;
    let end = scene.times.last().copied().unwrap_or(0.0);
    for program in programs {
        if program.calls(&["stop_time", "stops", "first_to_stop"]) && looks_ahead(program) {
            future = future.max(MAX_FUTURE_FRAMES);
        }
        for pair in program.ops.windows(2) {
            let number = if let Op::Push(_, ProgramValue::Factor(n)) = pair[0] { n } else { 0.0 };
            let beyond = if pair[1].calls("later") { number } else { number - end };
            let is_time = pair[1].calls("later") || pair[1].calls("at_time");
            if is_time && beyond * scene.fps > FUTURE_FRAMES as f64 {
                future = future.max(MAX_FUTURE_FRAMES);
            }
        }
    }
    future
}

type Choices = Vec<(String, QuestionProgram)>;

/// A question as programs, and what it was read as.
struct Understood {
    program: QuestionProgram,
    choices: Choices,
    reading: String,
}

fn understand(
    scene: Option<&Scene>,
    question: &Question,
    conversation: &Conversation,
    lexicon: &[LexiconWord],
) -> Result<Understood, ReasonError> {
    let vocabulary = spellings(lexicon);
    let parse = |tokens: &[String]| QuestionProgram::parse_with(tokens, &vocabulary);
    match question {
        Question::English { question, choices } => {
            let about = ReadingContext { scene, lexicon };
            let read = read_question(question, about, conversation)?;
            let observed = read.is_explanatory();
            let choices = choices.iter().map(|c| {
                let read = read_choice(c, observed, about, conversation)?;
                Ok((c.clone(), parse(&read.program)?))
            });
            let choices = choices.collect::<Result<_, ReasonError>>()?;
            Ok(Understood { program: parse(&read.program)?, choices, reading: read.reading })
        }
        Question::Program { program, choices } => {
            let choices = choices.iter().map(|c| Ok((c.join(" "), parse(c)?)));
            let choices = choices.collect::<Result<_, ReasonError>>()?;
            let program = parse(program)?;
            let reading = read_back(&program);
            Ok(Understood { program, choices, reading })
        }
    }
}

/// How far the simulations run, which objects move as observed in every counterfactual, and whether a rollout ended early.
fn reach(scene: &Scene, simulations: &[Prediction]) -> String {
    let counterfactuals: Vec<&Prediction> =
        simulations.iter().filter(|s| !s.interventions.is_empty()).collect();
    let kept = scene.objects.iter().filter(|o| counterfactuals.iter().all(|s| s.unreached.contains(&o.id)));
    let kept: Vec<String> =
        kept.filter_map(|o| scene.object_index(o.id)).map(|i| ops::name(scene, i)).collect();
    let mut words = String::new();
    let end = scene.times.last().copied().unwrap_or(0.0);
    let duration = |what: &str, s: &Prediction| {
        let until = s.best.times.last().copied().unwrap_or(end);
        match until > end {
            true => format!(" {what} runs to {until:.1} s, {:.1} s beyond the video.", until - end),
            false if what == "The prediction" => {
                format!(" The question is about the video, to {until:.1} s.")
            }
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

/// Which objects the video shows too briefly to tell how they move, and, of the future, which it does not show.
fn hardly_seen(scene: &Scene, is_ahead: bool) -> String {
    let mut said = String::new();
    for (k, track) in scene.tracks.iter().enumerate().filter(|(_, t)| t.samples.len() < FEWEST_SAMPLES) {
        let (count, who) = (track.samples.len(), ops::name(scene, k));
        let frames = if count == 1 { "one frame".to_string() } else { format!("{count} frames") };
        said += &format!(" The video shows {who} in {frames} only, too few to tell how it moves.");
    }
    for object in scene.absent.iter().filter(|_| is_ahead) {
        said += &format!(" The video does not show {}: it may enter later.", ops::phrase(object));
    }
    said
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
        Some(format!("the {what} {}", ops::name(scene, scene.object_index(o.id)?)))
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
            let context = RolloutContext {
                scene: self.scene,
                bodies,
                effects: &self.effects,
                scenarios: &self.scenarios,
                simulations: &self.simulations,
                models: &self.models,
                fit: Some((self.fit, self.index)),
                future: self.future,
                rollout,
                discovery: self.discovery,
                words,
            };
            let mut derivation = vec![];
            let outcome = programs.iter().try_fold(vec![], |stack, program| {
                let (stack, steps) = run(program, context, stack)?;
                derivation.extend(steps);
                Ok(stack)
            });
            match outcome {
                Ok(mut stack) => return Ok((stack.pop(), derivation)),
                Err(Halt::Undetermined(why)) => return Ok((Some(ProgramValue::Undetermined(why)), vec![])),
                // Simulated already, with fewer rollouts than requested: this rollout does not count.
                Err(Halt::NeedsSimulation(needed, frames))
                    if self.scenarios.iter().any(|s| s.interventions == needed && s.frames >= frames) =>
                {
                    return Err(ReasonError::NoSingleEvent { found: "no such rollout".to_string() });
                }
                Err(Halt::NeedsSimulation(interventions, frames)) => self.simulate(&interventions, frames)?,
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

    /// Simulates a scenario for this number of frames; a shorter simulation of it is replaced.
    fn simulate(&mut self, interventions: &[Intervention], frames: usize) -> Result<(), ReasonError> {
        let ahead = self.is_ahead && interventions.is_empty();
        let frames = frames.max(self.scene.times.len() + if ahead { self.future } else { 0 });
        if let Some(shorter) = self.scenarios.iter().position(|s| s.interventions == interventions) {
            self.scenarios.remove(shorter);
            self.simulations.remove(shorter);
        }
        let AskOptions { rollouts, seed } = self.options;
        let request = PredictionRequest { interventions: interventions.to_vec(), frames, rollouts, seed };
        let (scenario, simulation) = simulated(self.scene, (self.fit, self.index), &request, self.stop)?;
        self.scenarios.push(scenario);
        self.simulations.push(simulation);
        Ok(())
    }

    /// The values over the ensemble (without one, that of the best rollout), and the derivation on the best rollout. With a lexicon,
    /// each rollout has [`WORD_DRAWS`] draws of words.
    fn over_rollouts(
        &mut self,
        programs: &[&QuestionProgram],
    ) -> Result<(Vec<ProgramValue>, Vec<DerivationStep>), ReasonError> {
        let (words, objects, rollouts) = (self.words, self.scene.objects.len(), self.options.rollouts);
        let likeliest = words.map(|words| WordDraw::best(words, objects));
        let best = self.evaluate(programs, 0, likeliest.as_ref());
        let mut values = vec![];
        let draws = if words.is_some() { WORD_DRAWS * rollouts.max(1) } else { rollouts };
        for k in 0..draws {
            let draw = words.map(|words| WordDraw::drawn(words, objects, self.options.seed, k));
            let rollout = if rollouts == 0 { 0 } else { 1 + k % rollouts };
            match self.evaluate(programs, rollout, draw.as_ref()) {
                Ok((value, _)) => values.extend(value),
                Err(error) if self.presupposes_otherwise(&error) => {}
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
            Err(error) if !values.is_empty() && (words.is_some() || self.presupposes_otherwise(&error)) => {
                Ok((values, vec![]))
            }
            Err(error) => Err(error),
        }
    }

    /// Whether a rollout or a draw does not count, as it is against what the question presupposes: the event in question, or, where
    /// words are drawn, the object.
    fn presupposes_otherwise(&self, error: &ReasonError) -> bool {
        match error {
            ReasonError::NoSingleEvent { .. } => true,
            ReasonError::NoSuchObject { .. } | ReasonError::AmbiguousObject { .. } => self.words.is_some(),
            _ => false,
        }
    }

    /// What the values of an answer are drawn from.
    fn sampling(&self) -> Sampling {
        let is_simulated = !self.simulations.is_empty();
        match self.words {
            None => is_simulated.into(),
            Some(_) => Sampling::Words { simulations: is_simulated.then_some(self.options.rollouts.max(1)) },
        }
    }

    fn choices(&mut self, program: &QuestionProgram, choices: &Choices) -> Result<Answer, ReasonError> {
        let mut answers = vec![];
        for (text, choice) in choices {
            let (values, derivation) = self.over_rollouts(&[choice, program])?;
            let yes = values.iter().filter(|v| **v == ProgramValue::Bool(true)).count();
            let probability = estimated_probability(yes, values.len(), self.sampling());
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
            probability: answers.iter().map(certainty).fold(1.0, f64::min),
            explanation: match &right[..] {
                [] => format!("No choice is correct by {rollouts} simulations."),
                _ => format!("Correct by {rollouts} simulations: {}.", right.join(", ")),
            },
            derivation: answers.first().map(|c| c.derivation.clone()).unwrap_or_default(),
            choices: answers,
            ..Answer::default()
        })
    }

    fn open(&mut self, program: &QuestionProgram) -> Result<Answer, ReasonError> {
        let (values, derivation) = self.over_rollouts(&[program])?;
        let (answer, probability) = summary(self.scene, &values, self.sampling());
        Ok(Answer {
            explanation: format!("Probability {:.0} % by {} rollouts.", 100.0 * probability, values.len()),
            answer: Some(answer),
            probability,
            derivation,
            ..Answer::default()
        })
    }

    /// For what does not happen in the video under a change, but does after it: a sentence that says so.
    fn later(&mut self, program: &QuestionProgram) -> String {
        if !program.calls(&["filter_counterfact"]) || !program.calls(&["exist"]) {
            return String::new();
        }
        let of = |token: &String| match token.as_str() {
            "filter_counterfact" => vec!["suppose".to_string(), "unseen_events".to_string()],
            _ => vec![token.clone()],
        };
        let tokens: Vec<String> = program.tokens.iter().flat_map(of).collect();
        if self.answer_to(&tokens).as_deref() != Some("yes") {
            return String::new();
        }
        let seconds = self.future as f64 / self.scene.fps;
        format!(
            " In the video it does not happen, but it does within {seconds:.1} s after it: the question does not determine which is \
             meant."
        )
    }

    /// What the change of a counterfactual makes of the events of the video, as a sentence.
    fn difference(&mut self, program: &QuestionProgram) -> String {
        let mut tokens = program.tokens.clone();
        tokens.push("difference_made".to_string());
        let made = self.answer_to(&tokens);
        made.map_or(String::new(), |made| format!(" The change makes this difference: {made}."))
    }

    /// The answer to another program; `None` where it has none.
    fn answer_to(&mut self, tokens: &[String]) -> Option<String> {
        let program = QuestionProgram::parse_with(tokens, &self.vocabulary).ok()?;
        program.check(&mut vec![]).ok()?;
        let (values, _) = self.over_rollouts(&[&program]).ok()?;
        Some(summary(self.scene, &values, self.sampling()).0)
    }
}
