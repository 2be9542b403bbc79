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
use super::lessons::{
    FamilyWords, LessonItem, LessonVideo, PreparedVideo, RecordedLoss, RunItems, family_words, prepare, read,
};
use super::lexicon::{CalibrationBin, LearnedFamily, Lexicon, WordCalibration};
use super::soft::{SoftContext, SoftFamily, SoftRun};
use super::soft_value::SoftValue;
use super::tape::{ONE, Tape, Variable, ZERO};
use crate::num::elementary::{cos, ln};
use crate::num::standard_normal;
use crate::num::{NINETY_FIVE, Stop, progress_within};
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
    let folds = if options.folds >= 2 { options.folds.min(prepared.len()) } else { 0 };
    // The whole and each fold are trained alike.
    let share = |k: usize| k as f64 / (1 + folds) as f64;
    let within = |k: usize| progress_within(stop, [share(k), share(k + 1)]);
    let families = trainer.train(&mut prepared, &all, blank.clone(), &report, &within(0))?;
    let mut left_out = vec![];
    for fold in 0..folds {
        let used: Vec<usize> = all.iter().copied().filter(|v| v % folds != fold).collect();
        let families = trainer.train(&mut prepared, &used, blank.clone(), &|_, _| {}, &within(fold + 1))?;
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
#[derive(Clone, Default)]
struct VideoLoss {
    loss: f64,
    questions: f64,
    /// Derivatives by the logits: family by family, object by object.
    logits: Vec<f64>,
}

impl VideoLoss {
    fn of(run: &RecordedLoss) -> VideoLoss {
        VideoLoss {
            loss: run.tape.value(run.loss),
            questions: run.questions,
            logits: run.tape.gradient(run.loss, &run.logits),
        }
    }
}

/// E W of a family, words x features, and E u: the logits of its words are linear in the features.
struct LogitMap {
    words: usize,
    weights: Vec<f64>,
    offsets: Vec<f64>,
}

impl LogitMap {
    fn of(family: &LearnedFamily, length: usize) -> LogitMap {
        let (n, words) = (family.dimension, family.words.len());
        let (mut weights, mut offsets) = (vec![0.0; words * length], vec![0.0; words]);
        for w in 0..words {
            let row = &mut weights[w * length..(w + 1) * length];
            for (c, e) in family.vectors[w * n..(w + 1) * n].iter().enumerate() {
                offsets[w] += e * family.offset[c];
                let map = &family.map[c * length..(c + 1) * length];
                row.iter_mut().zip(map).for_each(|(slot, x)| *slot += e * x);
            }
        }
        LogitMap { words, weights, offsets }
    }

    fn logit(&self, word: usize, features: &[f64]) -> f64 {
        let row = &self.weights[word * features.len()..(word + 1) * features.len()];
        self.offsets[word] + row.iter().zip(features).map(|(w, f)| w * f).sum::<f64>()
    }
}

/// Logits of all words of a video over a temperature: family by family, object by object.
fn logits(maps: &[LogitMap], video: &PreparedVideo, temperature: f64) -> Vec<f64> {
    let of_family = |m: &LogitMap| -> Vec<f64> {
        let of = |f: &Vec<f64>| (0..m.words).map(|w| m.logit(w, f) / temperature).collect::<Vec<f64>>();
        video.features.iter().flat_map(of).collect()
    };
    maps.iter().flat_map(of_family).collect()
}

fn logit_maps(families: &[LearnedFamily], videos: &[PreparedVideo]) -> Vec<LogitMap> {
    let length = videos.iter().flat_map(|v| v.features.first()).map(Vec::len).next().unwrap_or(0);
    families.iter().map(|f| LogitMap::of(f, length)).collect()
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
            let is_first = has_simulated && (step as f64) < OBSERVED_SHARE * self.options.steps as f64;
            let items = if is_first { RunItems::Observed } else { RunItems::All };
            let mut batch = vec![];
            while batch.len() < BATCH.min(order.len()) {
                if at >= order.len() {
                    shuffle(&mut order, &mut random);
                    at = 0;
                }
                batch.push(order[at]);
                at += 1;
            }
            let losses = self.batch(videos, &batch, &families, items, stop)?;
            let questions: f64 = losses.iter().map(|l| l.questions).sum();
            let loss: f64 = losses.iter().map(|l| l.loss).sum();
            let mut gradient = adam.zeros();
            self.add_gradient(&families, videos, (&batch, &losses), &mut gradient);
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
        items: RunItems,
        stop: Stop,
    ) -> Result<Vec<VideoLoss>, ConceptError> {
        let maps = logit_maps(families, videos);
        // A video that is in the batch twice is run once.
        let mut distinct = batch.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        let (mut done, mut losses): (Vec<(usize, RecordedLoss)>, Vec<(usize, VideoLoss)>) = (vec![], vec![]);
        let mut open = distinct;
        while !open.is_empty() {
            let recorded: Vec<Option<RecordedLoss>> =
                open.iter().map(|v| videos[*v].recorded.take()).collect();
            let ready: &[PreparedVideo] = videos;
            let runs: Vec<Result<(RecordedLoss, VideoLoss), Halt>> = open
                .par_iter()
                .zip(recorded)
                .map(|(v, last)| {
                    let logits = logits(&maps, &ready[*v], 1.0);
                    let run = self.run(&ready[*v], families, &logits, (items, last))?;
                    let loss = VideoLoss::of(&run);
                    Ok((run, loss))
                })
                .collect();
            let mut needs = vec![];
            for (v, run) in open.iter().zip(runs) {
                match run {
                    Ok((run, loss)) => {
                        done.push((*v, run));
                        losses.push((*v, loss));
                    }
                    Err(Halt::NeedsSimulation(interventions, frames)) => {
                        needs.push((*v, interventions, frames));
                    }
                    Err(Halt::Undetermined(_)) => losses.push((*v, VideoLoss::default())),
                    Err(Halt::Error(error)) => return Err(error.into()),
                }
            }
            open = needs.iter().map(|n| n.0).collect();
            for (v, interventions, frames) in needs {
                videos[v].simulate(&interventions, frames, stop)?;
            }
        }
        done.sort_by_key(|d| d.0);
        keep(videos, done);
        let of = |v: &usize| losses.iter().find(|l| l.0 == *v).map(|l| l.1.clone()).unwrap_or_default();
        Ok(batch.iter().map(of).collect())
    }

    /// The items of a video for these logits: the last run again if it took the path that this one takes, else on a new tape.
    fn run(
        &self,
        video: &PreparedVideo,
        families: &[LearnedFamily],
        logits: &[f64],
        (items, last): (RunItems, Option<RecordedLoss>),
    ) -> Result<RecordedLoss, Halt> {
        if let Some(mut last) = last.filter(|l| l.items == items) {
            let inputs = last.logits.iter().copied().zip(logits.iter().copied());
            if last.tape.replay(inputs) {
                return Ok(last);
            }
        }
        let mut tape = Tape::default();
        let (soft, inputs) = self.soft_families(video, families, logits, &mut tape);
        let context = self.context(video, &soft);
        let (mut loss, mut questions, mut answers) = (ZERO, 0.0, vec![]);
        let left_out = |i: &LessonItem| items == RunItems::Observed && i.needs_simulation;
        for item in video.items.iter().filter(|i| !left_out(i)) {
            let found = match answer_probability(&context, item, &mut tape) {
                Err(Halt::NeedsSimulation(..)) if items == RunItems::Simulated => None,
                found => found?,
            };
            let Some((answer, presupposed)) = found else { continue };
            let (log_answer, log_presupposed) = (tape.ln(answer), tape.ln(presupposed));
            let given = tape.scale(log_presupposed, PRESUPPOSED_WEIGHT);
            let both = tape.add(log_answer, given);
            let weighted = tape.scale(both, -item.weight);
            loss = tape.add(loss, weighted);
            questions += item.weight;
            answers.push(answer);
        }
        tape.finish();
        Ok(RecordedLoss { tape, items, logits: inputs, loss, questions, answers })
    }

    /// Probabilities of words on the tape, and the logits that they come from.
    fn soft_families<'f>(
        &self,
        video: &PreparedVideo,
        families: &'f [LearnedFamily],
        logits: &[f64],
        tape: &mut Tape,
    ) -> (Vec<SoftFamily<'f>>, Vec<Variable>) {
        let inputs: Vec<Variable> = logits.iter().map(|l| tape.input(*l)).collect();
        let (mut soft, mut rest) = (vec![], &inputs[..]);
        for family in families {
            let mut probabilities = vec![];
            for _ in &video.features {
                let (row, others) = rest.split_at(family.words.len().min(rest.len()));
                probabilities.push(tape.softmax(row));
                rest = others;
            }
            soft.push(SoftFamily { family: family.family, words: &family.words, probabilities });
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

    /// Adds dL/dW = E^T G, dL/du = E^T h and dL/dE = G W^T + h u^T, with G = sum_o g_o f_o^T and h = sum_o g_o over all objects.
    fn add_gradient(
        &self,
        families: &[LearnedFamily],
        videos: &[PreparedVideo],
        (batch, losses): (&[usize], &[VideoLoss]),
        gradient: &mut [Vec<f64>],
    ) {
        let mut first: Vec<usize> = vec![0; batch.len()];
        for (k, family) in families.iter().enumerate() {
            let (words, n) = (family.words.len(), family.dimension);
            let length = family.map.len() / n.max(1);
            let (mut of_features, mut of_words) = (vec![0.0; words * length], vec![0.0; words]);
            for ((v, loss), first) in batch.iter().zip(losses).zip(&mut first) {
                for f in &videos[*v].features {
                    let own = loss.logits.get(*first..*first + words).unwrap_or_default();
                    for (w, g) in own.iter().enumerate().filter(|(_, g)| **g != 0.0) {
                        of_words[w] += g;
                        let row = &mut of_features[w * length..(w + 1) * length];
                        row.iter_mut().zip(f).for_each(|(slot, x)| *slot += g * x);
                    }
                    *first += words;
                }
            }
            for w in 0..words {
                let row = &of_features[w * length..(w + 1) * length];
                for c in 0..n {
                    let (e, map) = (family.vectors[w * n + c], &family.map[c * length..(c + 1) * length]);
                    gradient[3 * k + 1][c] += e * of_words[w];
                    let of_map = &mut gradient[3 * k][c * length..(c + 1) * length];
                    of_map.iter_mut().zip(row).for_each(|(slot, g)| *slot += e * g);
                    let along: f64 = row.iter().zip(map).map(|(g, x)| g * x).sum();
                    gradient[3 * k + 2][w * n + c] += along + of_words[w] * family.offset[c];
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
        let maps: Vec<Vec<LogitMap>> = left_out.iter().map(|(_, f)| logit_maps(f, videos)).collect();
        // Only one tape for each thread is held at once: a video is run with all temperatures, one after the other.
        let of_video = |(v, video): (usize, &PreparedVideo)| -> Vec<Vec<f64>> {
            let fold = left_out.iter().zip(&maps).find(|((fold, _), _)| v % folds == *fold);
            let Some(((_, learned), maps)) = fold else { return vec![vec![]; TEMPERATURES.len()] };
            let mut run: Option<RecordedLoss> = None;
            let mut at = |temperature: &f64| -> Vec<f64> {
                let logits = logits(maps, video, *temperature);
                run = self.run(video, learned, &logits, (RunItems::Simulated, run.take())).ok();
                run.as_ref().map_or(vec![], |r| r.answers.iter().map(|a| r.tape.value(*a)).collect())
            };
            TEMPERATURES.iter().map(&mut at).collect()
        };
        let each: Vec<Vec<Vec<f64>>> = videos.par_iter().enumerate().map(of_video).collect();
        let answers = |k: usize| -> Vec<f64> { each.iter().flat_map(|v| v[k].iter().copied()).collect() };
        let loss = |answers: &[f64]| -> f64 { answers.iter().map(|p| -ln(p.max(LEAST_PROBABILITY))).sum() };
        let scored: Vec<(f64, Vec<f64>)> =
            TEMPERATURES.iter().enumerate().map(|(k, t)| (*t, answers(k))).collect();
        let best = scored.iter().min_by(|a, b| loss(&a.1).total_cmp(&loss(&b.1)));
        if let Some((temperature, answers)) = best {
            let calibration = calibration(answers, loss(answers));
            for family in &mut families {
                (family.temperature, family.calibration) = (*temperature, Some(calibration.clone()));
            }
        }
        families
    }
}

/// Verdicts of about one probability, from a coin's to a certain one.
const BINS: [f64; 6] = [0.5, 0.6, 0.7, 0.8, 0.9, 0.97];

/// The 95 % interval of a share (Wilson, J. Am. Stat. Assoc. 22 (1927) 209).
fn share_interval(right: usize, count: usize) -> [f64; 2] {
    let (n, z) = (count as f64, NINETY_FIVE);
    let p = right as f64 / n;
    let scale = 1.0 + z * z / n;
    let centre = (p + z * z / (2.0 * n)) / scale;
    let half = z / scale * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    [(centre - half).max(0.0), (centre + half).min(1.0)]
}

/// Figures of left-out answers, from the probabilities of the right ones and their log loss.
fn calibration(answers: &[f64], log_loss: f64) -> WordCalibration {
    let n = answers.len().max(1) as f64;
    let is_right = |p: &f64| *p > 0.5;
    let bin = |k: usize| -> Option<CalibrationBin> {
        let to = BINS.get(k + 1).copied().unwrap_or(f64::INFINITY);
        let own = answers.iter().filter(|p| (BINS[k]..to).contains(&p.max(1.0 - **p)));
        let own: Vec<f64> = own.copied().collect();
        let count = Some(own.len()).filter(|n| *n > 0)?;
        let right = own.iter().filter(|p| is_right(p)).count();
        Some(CalibrationBin {
            answers: count,
            probability: own.iter().map(|p| p.max(1.0 - p)).sum::<f64>() / count as f64,
            accuracy: right as f64 / count as f64,
            interval: share_interval(right, count),
        })
    };
    WordCalibration {
        answers: answers.len(),
        log_loss: log_loss / n,
        accuracy: answers.iter().filter(|p| is_right(p)).count() as f64 / n,
        bins: (0..BINS.len()).filter_map(bin).collect(),
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

/// Keeps runs to be replayed, up to [`MOST_KEPT`] entries.
fn keep(videos: &mut [PreparedVideo], runs: Vec<(usize, RecordedLoss)>) {
    let mut kept: usize = videos.iter().filter_map(|v| v.recorded.as_ref()).map(|r| r.tape.length()).sum();
    for (v, run) in runs {
        kept += run.tape.length();
        if kept <= MOST_KEPT {
            videos[v].recorded = Some(run);
        }
    }
}

/// Most entries of all tapes that are kept: 20 bytes each.
const MOST_KEPT: usize = 8 << 20;

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
