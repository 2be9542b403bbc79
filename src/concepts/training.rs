//! Learns the words of families from questions and answers.
//!
//! With theta = (W, u, e) of each family (see `lexicon`), P(word|object) enters each question's soft program (see `soft`), and
//!
//! `L(theta) = - sum_q w_q (ln P(a_q) + lambda ln P(presupposed_q)) + (alpha/2) sum_f (|W|^2 + |e - e_0|^2)`
//!
//! is minimised: for words the cross entropy, for yes and no the binary one, for counts that of the Poisson binomial
//! distribution (DCL takes |difference| there; this one is a likelihood). A question presupposes that "the red cube" is one object,
//! which says something of words, too. As in the paper's stages, first only questions about observed events are used, and then all
//! questions with simulated events; the gradient goes through words only, never through the physics.
//!
//! Adam (Kingma and Ba, ICLR 2015) in `f64`. Videos of a batch run in parallel, but their gradients are added in the order of the
//! videos, so that the bytes of a lexicon do not depend on the number of threads.

use super::error::ConceptError;
use super::features::standard;
use super::lessons::{FamilyWords, LessonItem, LessonVideo, PreparedVideo, family_words, prepare, read};
use super::lexicon::{LearnedFamily, Lexicon, WordCalibration};
use super::soft::{SoftContext, SoftFamily, SoftRun};
use super::soft_value::SoftValue;
use super::tape::{ONE, Tape, Variable, ZERO};
use crate::num::Stop;
use crate::num::elementary::{cos, ln};
use crate::num::standard_normal;
use crate::reason::{FUTURE_FRAMES, Halt, ProgramValue, RolloutContext};
use crate::world::Intervention;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;

/// What a caller chooses about learning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnOptions {
    pub seed: u64,
    /// Steps of the optimiser, over both stages.
    pub steps: usize,
    /// Parts of the videos that are left out in turn to calibrate probabilities; below 2: none.
    pub folds: usize,
}

impl Default for LearnOptions {
    fn default() -> Self {
        LearnOptions { seed: 0, steps: 400, folds: 3 }
    }
}

/// How far learning is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnProgress {
    pub step: usize,
    pub steps: usize,
    /// Mean loss of a question over the last batch (nat).
    pub loss: f64,
}

/// Dimension of the space of each family; the paper's is 64, for 256 features.
const DIMENSION: usize = 16;
/// Videos of a batch.
const BATCH: usize = 16;
/// Largest step of a parameter: about a tenth of a standardised weight.
const RATE: f64 = 0.05;
const MOMENTS: [f64; 2] = [0.9, 0.99];
/// Weight of what a question presupposes: less than one, as its phrases share words.
const PRESUPPOSED_WEIGHT: f64 = 0.5;
/// Precision of the prior of the weights (alpha): a standardised feature changes a logit by about one.
const PRECISION: f64 = 1.0;
/// Largest deviation of the start.
const START_SIGMA: f64 = 0.02;
/// Share of the steps with questions of observed events only.
const OBSERVED_SHARE: f64 = 0.5;

/// Learns the words of families from the questions and answers of videos. Deterministic.
pub fn learn(
    videos: &[LessonVideo],
    options: &LearnOptions,
    progress: &(dyn Fn(LearnProgress) + Sync),
    stop: Stop,
) -> Result<Lexicon, ConceptError> {
    let tokens = read(videos)?;
    let words = family_words(videos, &tokens);
    if words.is_empty() {
        return Err(ConceptError::NoQuestions);
    }
    let (mut prepared, layout) = prepare(videos, &tokens, &words, stop)?;
    let objects: Vec<Vec<f64>> = prepared.iter().flat_map(|v| v.features.iter().cloned()).collect();
    let (mean, scale) = standard(&objects);
    let questions = videos.iter().map(|v| v.lessons.len()).sum();
    let mut lexicon =
        Lexicon { layout: Some(layout), mean, scale, videos: videos.len(), questions, ..Lexicon::default() };
    for features in prepared.iter_mut().flat_map(|v| &mut v.features) {
        *features = lexicon.standardised(features);
    }
    let report = |step, loss| progress(LearnProgress { step, steps: options.steps, loss });
    let all: Vec<usize> = (0..prepared.len()).collect();
    lexicon.families = start(&words, lexicon.mean.len(), options.seed);
    let blank = lexicon.families.clone();
    let trainer = Trainer { options };
    let families = trainer.train(&mut prepared, &all, blank.clone(), &report, stop)?;
    let mut left_out = vec![];
    let folds = options.folds.min(prepared.len());
    for fold in (0..folds).filter(|_| folds >= 2) {
        let used: Vec<usize> = all.iter().copied().filter(|v| v % folds != fold).collect();
        let families = trainer.train(&mut prepared, &used, blank.clone(), &|_, _| {}, stop)?;
        left_out.push((fold, families));
    }
    let calibrated = trainer.calibrated(&prepared, families, &left_out, folds);
    lexicon.families = calibrated;
    Ok(lexicon)
}

/// Word k of a family begins at unit vector k, and the map at small random numbers.
fn start(words: &FamilyWords, length: usize, seed: u64) -> Vec<LearnedFamily> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut small =
        |n: usize| (0..n).map(|_| START_SIGMA * standard_normal(&mut random)).collect::<Vec<f64>>();
    let mut of = |(family, words): &(_, Vec<(String, usize)>)| {
        let dimension = DIMENSION.max(words.len());
        LearnedFamily {
            family: *family,
            words: words.iter().map(|w| w.0.clone()).collect(),
            seen: words.iter().map(|w| w.1).collect(),
            dimension,
            map: small(dimension * length),
            offset: vec![0.0; dimension],
            vectors: unit_vectors(words.len(), dimension),
            temperature: 1.0,
            calibration: None,
        }
    };
    words.iter().map(&mut of).collect()
}

fn unit_vectors(words: usize, dimension: usize) -> Vec<f64> {
    let mut vectors = vec![0.0; words * dimension];
    (0..words).for_each(|w| vectors[w * dimension + w] = 1.0);
    vectors
}

struct Trainer<'a> {
    options: &'a LearnOptions,
}

/// Loss and gradient of one video.
#[derive(Default)]
struct VideoLoss {
    loss: f64,
    questions: f64,
    /// By family, object and word: derivative by the logit.
    logits: Vec<Vec<Vec<f64>>>,
}

impl Trainer<'_> {
    fn train(
        &self,
        videos: &mut [PreparedVideo],
        used: &[usize],
        mut families: Vec<LearnedFamily>,
        progress: &(dyn Fn(usize, f64) + Sync),
        stop: Stop,
    ) -> Result<Vec<LearnedFamily>, ConceptError> {
        let mut adam = Adam::new(&families);
        let mut random = ChaCha8Rng::seed_from_u64(self.options.seed.wrapping_add(1));
        let mut order: Vec<usize> = used.to_vec();
        let has_simulated = videos.iter().any(|v| v.items.iter().any(|i| i.needs_simulation));
        let total =
            used.iter().filter_map(|v| videos.get(*v)).flat_map(|v| &v.items).map(|i| i.weight).sum::<f64>();
        let mut at = order.len();
        for step in 0..self.options.steps {
            stop(step as f64 / self.options.steps as f64)?;
            let only_observed = has_simulated && (step as f64) < OBSERVED_SHARE * self.options.steps as f64;
            let mut batch = vec![];
            while batch.len() < BATCH.min(order.len()) {
                if at >= order.len() {
                    shuffle(&mut order, &mut random);
                    at = 0;
                }
                batch.push(order[at]);
                at += 1;
            }
            let losses = self.batch(videos, &batch, &families, only_observed, stop)?;
            let questions: f64 = losses.iter().map(|l| l.questions).sum();
            let loss: f64 = losses.iter().map(|l| l.loss).sum();
            let mut gradient = adam.zeros();
            for (v, loss) in batch.iter().zip(&losses) {
                self.add_gradient(&families, &videos[*v], loss, &mut gradient);
            }
            // The mean over the questions of the batch; the prior counts once for all questions.
            let scale = 1.0 / questions.max(1e-9);
            gradient.iter_mut().flatten().for_each(|g| *g *= scale);
            add_prior(&families, PRECISION / total.max(1.0), &mut gradient);
            let done = step as f64 / self.options.steps as f64;
            adam.step(&mut families, &gradient, RATE * 0.5 * (1.0 + cos(std::f64::consts::PI * done)));
            progress(step + 1, loss * scale);
        }
        Ok(families)
    }

    /// The losses of a batch, in its order; simulates first what its programs need.
    fn batch(
        &self,
        videos: &mut [PreparedVideo],
        batch: &[usize],
        families: &[LearnedFamily],
        only_observed: bool,
        stop: Stop,
    ) -> Result<Vec<VideoLoss>, ConceptError> {
        loop {
            let ready: &[PreparedVideo] = videos;
            let losses: Vec<Result<VideoLoss, Halt>> =
                batch.par_iter().map(|v| self.loss(&ready[*v], families, only_observed)).collect();
            let mut done = vec![];
            let mut needs = vec![];
            for (v, loss) in batch.iter().zip(losses) {
                match loss {
                    Ok(loss) => done.push(loss),
                    Err(Halt::NeedsSimulation(interventions, frames)) => {
                        needs.push((*v, interventions, frames));
                    }
                    Err(Halt::Undetermined(_)) => done.push(VideoLoss::default()),
                    Err(Halt::Error(error)) => return Err(error.into()),
                }
            }
            if needs.is_empty() {
                return Ok(done);
            }
            for (v, interventions, frames) in needs {
                videos[v].simulate(&interventions, frames, stop)?;
            }
        }
    }

    /// Loss of one video and its derivatives by the logits of its objects.
    fn loss(
        &self,
        video: &PreparedVideo,
        families: &[LearnedFamily],
        only_observed: bool,
    ) -> Result<VideoLoss, Halt> {
        let mut tape = Tape::default();
        let (soft, inputs) = self.soft_families(video, families, &mut tape);
        let context = self.context(video, &soft);
        let (mut loss, mut questions) = (ZERO, 0.0);
        for item in video.items.iter().filter(|i| !(only_observed && i.needs_simulation)) {
            let Some((answer, presupposed)) = answer_probability(&context, item, &mut tape)? else {
                continue;
            };
            let (log_answer, log_presupposed) = (tape.ln(answer), tape.ln(presupposed));
            let given = tape.scale(log_presupposed, PRESUPPOSED_WEIGHT);
            let both = tape.add(log_answer, given);
            let weighted = tape.scale(both, -item.weight);
            loss = tape.add(loss, weighted);
            questions += item.weight;
        }
        let flat: Vec<Variable> = inputs.iter().flatten().flatten().copied().collect();
        let mut derivatives = tape.gradient(loss, &flat).into_iter();
        let logits = inputs
            .iter()
            .map(|family| family.iter().map(|row| derivatives.by_ref().take(row.len()).collect()).collect())
            .collect();
        Ok(VideoLoss { loss: tape.value(loss), questions, logits })
    }

    /// Probabilities of words on the tape, and the logits that they come from: `[family][object][word]`.
    fn soft_families<'f>(
        &self,
        video: &PreparedVideo,
        families: &'f [LearnedFamily],
        tape: &mut Tape,
    ) -> (Vec<SoftFamily<'f>>, Vec<Vec<Vec<Variable>>>) {
        let (mut soft, mut inputs) = (vec![], vec![]);
        for family in families {
            let (mut rows, mut probabilities) = (vec![], vec![]);
            for features in &video.features {
                let logits = family.logits(features);
                let row: Vec<Variable> = logits.iter().map(|l| tape.input(l / family.temperature)).collect();
                probabilities.push(tape.softmax(&row));
                rows.push(row);
            }
            soft.push(SoftFamily { family: family.family, words: &family.words, probabilities });
            inputs.push(rows);
        }
        (soft, inputs)
    }

    fn context<'v>(&self, video: &'v PreparedVideo, soft: &'v [SoftFamily<'v>]) -> SoftContext<'v> {
        let bodies =
            video.fit.and_then(|(fit, index)| fit.scenes.get(index)).map_or(&[][..], |s| &s.model.bodies);
        let exact = RolloutContext {
            scene: video.scene,
            bodies,
            effects: &video.effects,
            scenarios: &video.scenarios,
            simulations: &video.simulations,
            models: &video.models,
            fit: video.fit,
            future: FUTURE_FRAMES,
            rollout: 0,
            discovery: None,
            words: None,
        };
        SoftContext { exact, families: soft }
    }

    /// Adds dL/dW = sum_o E^T g_o f_o^T, dL/du = sum_o E^T g_o, dL/dE = sum_o g_o z_o^T.
    fn add_gradient(
        &self,
        families: &[LearnedFamily],
        video: &PreparedVideo,
        loss: &VideoLoss,
        gradient: &mut [Vec<f64>],
    ) {
        for (k, (family, objects)) in families.iter().zip(&loss.logits).enumerate() {
            for (f, g) in video.features.iter().zip(objects) {
                let z = family.place(f);
                let n = family.dimension;
                let mut back = vec![0.0; n];
                for (w, gw) in g.iter().enumerate() {
                    for c in 0..n {
                        back[c] += gw * family.vectors[w * n + c];
                        gradient[3 * k + 2][w * n + c] += gw * z[c];
                    }
                }
                for c in 0..n {
                    gradient[3 * k + 1][c] += back[c];
                    let row = &mut gradient[3 * k][c * f.len()..(c + 1) * f.len()];
                    row.iter_mut().zip(f).for_each(|(slot, x)| *slot += back[c] * x);
                }
            }
        }
    }

    /// Sets each family's temperature to the one with the least log loss on videos that were left out.
    fn calibrated(
        &self,
        videos: &[PreparedVideo],
        mut families: Vec<LearnedFamily>,
        left_out: &[(usize, Vec<LearnedFamily>)],
        folds: usize,
    ) -> Vec<LearnedFamily> {
        if left_out.is_empty() {
            return families;
        }
        let score = |temperature: f64| -> (f64, usize, usize) {
            let per_video = videos.par_iter().enumerate().map(|(v, video)| {
                let Some((_, learned)) = left_out.iter().find(|(fold, _)| v % folds == *fold) else {
                    return (0.0, 0, 0);
                };
                let mut learned = learned.clone();
                learned.iter_mut().for_each(|f| f.temperature = temperature);
                self.held_out(video, &learned)
            });
            let all: Vec<(f64, usize, usize)> = per_video.collect();
            all.iter().fold((0.0, 0, 0), |s, x| (s.0 + x.0, s.1 + x.1, s.2 + x.2))
        };
        let scored = TEMPERATURES.map(|t| (t, score(t)));
        let best = scored.iter().min_by(|a, b| a.1.0.total_cmp(&b.1.0));
        if let Some((temperature, (loss, right, answers))) = best {
            let n = (*answers).max(1) as f64;
            let calibration =
                WordCalibration { answers: *answers, log_loss: loss / n, accuracy: *right as f64 / n };
            for family in &mut families {
                (family.temperature, family.calibration) = (*temperature, Some(calibration.clone()));
            }
        }
        families
    }

    /// Negative log probability of the answers of a video, how many are right, and how many there are.
    fn held_out(&self, video: &PreparedVideo, families: &[LearnedFamily]) -> (f64, usize, usize) {
        let mut tape = Tape::default();
        let (soft, _) = self.soft_families(video, families, &mut tape);
        let context = self.context(video, &soft);
        let (mut loss, mut right, mut answers) = (0.0, 0, 0);
        for item in &video.items {
            // What needs a simulation that training did not need is left out.
            let Ok(Some((answer, _))) = answer_probability(&context, item, &mut tape) else { continue };
            let p = tape.value(answer);
            loss -= ln(p.max(LEAST_PROBABILITY));
            right += usize::from(p > 0.5);
            answers += 1;
        }
        (loss, right, answers)
    }
}

/// Temperatures that are tried, by factors of about 1.2.
const TEMPERATURES: [f64; 12] = [0.5, 0.6, 0.72, 0.86, 1.0, 1.2, 1.45, 1.75, 2.1, 2.5, 3.0, 4.0];
/// Least probability of a left-out answer that counts: one surprise must not outweigh a hundred others.
const LEAST_PROBABILITY: f64 = 1e-3;

/// P(answer) and P(presupposed) of an item; `None` where its program has no result for these events.
fn answer_probability(
    context: &SoftContext,
    item: &LessonItem,
    tape: &mut Tape,
) -> Result<Option<(Variable, Variable)>, Halt> {
    let exact = &context.exact;
    let can_simulate =
        |needed: &[Intervention], frames| exact.fit.is_some() && !exact.is_simulated(needed, frames);
    let mut run = SoftRun { context, tape, stack: vec![], presupposed: ONE };
    for program in &item.programs {
        match run.run(program) {
            Ok(()) => {}
            Err(Halt::NeedsSimulation(needed, frames)) if can_simulate(&needed, frames) => {
                return Err(Halt::NeedsSimulation(needed, frames));
            }
            // Events that were missed leave the question without a meaning.
            Err(_) => return Ok(None),
        }
    }
    let presupposed = run.presupposed;
    let Some(SoftValue::Choice(choices)) = run.stack.pop() else { return Ok(None) };
    let is_answer = |value: &ProgramValue| match (value, &item.target) {
        (ProgramValue::Word(a), ProgramValue::Text(b)) => a == b,
        (a, b) => a == b,
    };
    let answer = choices.iter().find(|(value, _)| is_answer(value)).map_or(ZERO, |c| c.1);
    Ok(Some((answer, presupposed)))
}

fn shuffle(order: &mut [usize], random: &mut ChaCha8Rng) {
    for k in (1..order.len()).rev() {
        order.swap(k, (random.next_u64() % (k as u64 + 1)) as usize);
    }
}

/// The prior of the weights: normal around 0 for W, around the unit vectors for e.
fn add_prior(families: &[LearnedFamily], precision: f64, gradient: &mut [Vec<f64>]) {
    for (k, family) in families.iter().enumerate() {
        let centre = unit_vectors(family.words.len(), family.dimension);
        gradient[3 * k].iter_mut().zip(&family.map).for_each(|(g, w)| *g += precision * w);
        let vectors = family.vectors.iter().zip(&centre);
        gradient[3 * k + 2].iter_mut().zip(vectors).for_each(|(g, (e, c))| *g += precision * (e - c));
    }
}

/// First and second moments of the gradient of each block of parameters: W, u, e of each family.
struct Adam {
    moments: Vec<[Vec<f64>; 2]>,
    powers: [f64; 2],
}

impl Adam {
    fn new(families: &[LearnedFamily]) -> Adam {
        let sizes = families.iter().flat_map(|f| [f.map.len(), f.offset.len(), f.vectors.len()]);
        Adam { moments: sizes.map(|n| [vec![0.0; n], vec![0.0; n]]).collect(), powers: [1.0, 1.0] }
    }

    fn zeros(&self) -> Vec<Vec<f64>> {
        self.moments.iter().map(|m| vec![0.0; m[0].len()]).collect()
    }

    fn step(&mut self, families: &mut [LearnedFamily], gradient: &[Vec<f64>], rate: f64) {
        let [b1, b2] = MOMENTS;
        self.powers = [self.powers[0] * b1, self.powers[1] * b2];
        let blocks = families.iter_mut().flat_map(|f| [&mut f.map, &mut f.offset, &mut f.vectors]);
        for ((block, g), [first, second]) in blocks.zip(gradient).zip(&mut self.moments) {
            for (k, x) in block.iter_mut().enumerate() {
                first[k] = b1 * first[k] + (1.0 - b1) * g[k];
                second[k] = b2 * second[k] + (1.0 - b2) * g[k] * g[k];
                let (m, v) = (first[k] / (1.0 - self.powers[0]), second[k] / (1.0 - self.powers[1]));
                *x -= rate * m / (v.sqrt() + 1e-8);
            }
        }
    }
}
