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

mod adam;
mod calibration;
mod information;
mod run;

use self::adam::{Adam, add_prior, unit_vectors};
use self::calibration::calibrate;
use self::information::inform;
use super::error::ConceptError;
use super::features::standard;
use super::lessons::{FamilyWords, LessonVideo, PreparedVideo, RunItems, family_words, prepare, read};
use super::lexicon::{LearnedFamily, Lexicon};
use crate::num::elementary::cos;
use crate::num::standard_normal;
use crate::num::{Stop, progress_within};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

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
    let mut families = trainer.train(&mut prepared, &all, blank.clone(), &report, &within(0))?;
    let mut left_out = vec![];
    for fold in 0..folds {
        let used: Vec<usize> = all.iter().copied().filter(|v| v % folds != fold).collect();
        let quiet = |_, _| {};
        left_out.push((fold, trainer.train(&mut prepared, &used, blank.clone(), &quiet, &within(fold + 1))?));
    }
    calibrate(&mut families, &prepared, &left_out, folds);
    lexicon.families = families;
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
            information: None,
            calibration: None,
        }
    };
    words.iter().map(&mut of).collect()
}

struct Trainer<'a> {
    options: &'a LearnOptions,
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
            let losses = run::batch(videos, &batch, &families, items, stop)?;
            let questions: f64 = losses.iter().map(|l| l.questions).sum();
            let loss: f64 = losses.iter().map(|l| l.loss).sum();
            let mut gradient = adam.zeros();
            run::add_gradient(&families, videos, (&batch, &losses), &mut gradient);
            // The mean over the questions of the batch; the prior counts once for all questions.
            let scale = 1.0 / questions.max(1e-9);
            gradient.iter_mut().flatten().for_each(|g| *g *= scale);
            add_prior(&families, PRECISION / total.max(1.0), &mut gradient);
            let done = step as f64 / self.options.steps as f64;
            adam.step(&mut families, &gradient, RATE * 0.5 * (1.0 + cos(std::f64::consts::PI * done)));
            progress(step + 1, loss * scale);
        }
        inform(&mut families, videos, used);
        Ok(families)
    }
}

fn shuffle(order: &mut [usize], random: &mut ChaCha8Rng) {
    for k in (1..order.len()).rev() {
        order.swap(k, (random.next_u64() % (k as u64 + 1)) as usize);
    }
}
