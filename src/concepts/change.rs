//! A word for a change: the factor of a mass, a velocity or a restitution, from questions about what would happen and their answers.
//!
//! `p(f | answers) ~ p(f) prod_q (eps + (1 - 2 eps) P(a_q | f))`: P(a|f) is the share of rollouts that give the answer if the change
//! multiplies by f, eps the share of wrong answers. The prior of ln f is normal around 0 with deviation ln 5, the factor of
//! Generalized CLEVRER. The likelihood is a step function of f, so that f is the posterior's mean of ln f on a grid, which is
//! laid once over all factors and once over what the first one leaves.

use super::error::ConceptError;
use super::few_examples::check_new;
use super::lessons::{LessonAnswer, LessonVideo};
use super::lexicon::{LearnedWord, Lexicon, Meaning, WordKind, word_probabilities};
use crate::num::Stop;
use crate::num::elementary::{exp, ln};
use crate::reason::{
    AskOptions, ChangeWord, ChangedQuantity, WordProbabilities, WordedScene, ask_with_words, estimated_share,
};
use rayon::prelude::*;

/// Factors of a grid, over ln f from -GRID_END to GRID_END: 1/20 to 20.
const GRID: usize = 41;
const GRID_END: f64 = 3.0;
/// Deviation of ln f before any answer: ln 5.
const PRIOR_SIGMA: f64 = 1.609;
/// Share of answers that are wrong whatever the factor: the fit's own errors.
const WRONG: f64 = 0.05;
/// Least difference of the log likelihood over the grid (nat) that says something of the factor.
const LEAST_DIFFERENCE: f64 = 1.0;

/// How the factor of a change is learned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChangeOptions {
    pub quantity: ChangedQuantity,
    /// Models drawn from the posterior for each factor; 0: the best one only.
    pub rollouts: usize,
    pub seed: u64,
}

/// The lexicon with a word for a change, from questions whose programs have `NAME apply`. Videos need fits. Deterministic.
pub fn learn_change(
    lexicon: &Lexicon,
    name: &str,
    videos: &[LessonVideo],
    options: &ChangeOptions,
    stop: Stop,
) -> Result<Lexicon, ConceptError> {
    lexicon.check()?;
    check_new(lexicon, name)?;
    let questions: usize = videos.iter().map(|v| v.lessons.len()).sum();
    if questions == 0 {
        return Err(ConceptError::NoQuestions);
    }
    let mut words = vec![];
    for video in videos {
        words.push(match lexicon.layout {
            Some(_) => word_probabilities(lexicon, video.scene, video.fit)?,
            // Without words of looks the scene's own are read.
            None => WordProbabilities::default(),
        });
    }
    let lessons = ChangeLessons { videos, words: &words, name, options };
    let first: Vec<f64> = (0..GRID).map(|k| GRID_END * (2.0 * k as f64 / (GRID - 1) as f64 - 1.0)).collect();
    let whole = lessons.log_likelihood(&first, &crate::num::progress_within(stop, [0.0, 0.5]))?;
    let spread = whole.iter().copied().fold(f64::NEG_INFINITY, f64::max)
        - whole.iter().copied().fold(f64::INFINITY, f64::min);
    if spread < LEAST_DIFFERENCE {
        let (least, most) = (exp(-GRID_END), exp(GRID_END));
        return Err(ConceptError::Undetermined { name: name.into(), least, most });
    }
    let coarse = GridPosterior::new(&first, &whole);
    let step = first[1] - first[0];
    let (low, high) = (coarse.below(0.01) - step, coarse.below(0.99) + step);
    let second: Vec<f64> = (0..GRID).map(|k| low + (high - low) * k as f64 / (GRID - 1) as f64).collect();
    let near = lessons.log_likelihood(&second, &crate::num::progress_within(stop, [0.5, 1.0]))?;
    let fine = GridPosterior::new(&second, &near);
    let mut learned = lexicon.clone();
    learned.words.push(LearnedWord {
        name: name.into(),
        kind: WordKind::Change,
        meaning: Meaning::Change {
            quantity: options.quantity,
            factor: exp(fine.mean()),
            interval: [exp(fine.below(0.025)), exp(fine.below(0.975))],
        },
        yes: questions,
        no: 0,
        evidence: spread,
    });
    Ok(learned)
}

struct ChangeLessons<'a> {
    videos: &'a [LessonVideo<'a>],
    words: &'a [WordProbabilities],
    name: &'a str,
    options: &'a ChangeOptions,
}

impl ChangeLessons<'_> {
    /// Log likelihood of the answers for each ln f.
    fn log_likelihood(&self, grid: &[f64], stop: Stop) -> Result<Vec<f64>, ConceptError> {
        let points: Vec<Result<f64, ConceptError>> =
            grid.par_iter().map(|x| self.at(exp(*x), stop)).collect();
        points.into_iter().collect()
    }

    fn at(&self, factor: f64, stop: Stop) -> Result<f64, ConceptError> {
        let options = AskOptions { rollouts: self.options.rollouts, seed: self.options.seed };
        let mut sum = 0.0;
        for (video, words) in self.videos.iter().zip(self.words) {
            let Some((fit, index)) = video.fit else { continue };
            let mut words = words.clone();
            words.changes.retain(|c| c.name != self.name);
            let quantity = self.options.quantity;
            words.changes.push(ChangeWord { name: self.name.into(), quantity, factor });
            let worded = WordedScene { scene: video.scene, words: &words };
            for lesson in video.lessons {
                stop(0.0)?;
                // A question that presupposes what does not happen says nothing.
                let Ok(answer) = ask_with_words(worded, fit, index, &lesson.question, &options, stop) else {
                    continue;
                };
                // The likelihood is the share of the rollouts: the prior of f is the only one.
                let share = |p: f64| match answer.simulations.is_empty() {
                    true => p,
                    false => estimated_share(p, options.rollouts.max(1)),
                };
                match &lesson.answer {
                    LessonAnswer::Choices(correct) => {
                        for (choice, correct) in answer.choices.iter().zip(correct) {
                            let yes = share(choice.probability);
                            let p = if *correct { yes } else { 1.0 - yes };
                            sum += ln(WRONG + (1.0 - 2.0 * WRONG) * p);
                        }
                    }
                    LessonAnswer::Open(text) => {
                        let is_given = answer.answer.as_deref() == Some(text);
                        let given = share(answer.probability);
                        let p = if is_given { given } else { 1.0 - given };
                        sum += ln(WRONG + (1.0 - 2.0 * WRONG) * p);
                    }
                }
            }
        }
        Ok(sum)
    }
}

/// A distribution of ln f on an even grid.
struct GridPosterior {
    points: Vec<f64>,
    weights: Vec<f64>,
}

impl GridPosterior {
    fn new(points: &[f64], log_likelihood: &[f64]) -> GridPosterior {
        let log =
            points.iter().zip(log_likelihood).map(|(x, l)| l - 0.5 * x * x / (PRIOR_SIGMA * PRIOR_SIGMA));
        let weights = super::lexicon::softmax(&log.collect::<Vec<_>>());
        GridPosterior { points: points.to_vec(), weights }
    }

    fn mean(&self) -> f64 {
        self.points.iter().zip(&self.weights).map(|(x, w)| x * w).sum()
    }

    /// The least point up to which this share of the weight lies.
    fn below(&self, share: f64) -> f64 {
        let mut sum = 0.0;
        for (x, w) in self.points.iter().zip(&self.weights) {
            sum += w;
            if sum >= share {
                return *x;
            }
        }
        self.points.last().copied().unwrap_or(0.0)
    }
}
