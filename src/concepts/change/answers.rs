//! The factor of a change from questions about what would happen and their answers.
//!
//! `p(f | answers) ~ p(f) prod_q (eps + (1 - 2 eps) P(a_q | f))`: P(a|f) is the share of rollouts that give the answer if the change
//! multiplies by f, eps the share of wrong answers. The likelihood is a step function of f, so that f is the posterior's mean of ln f.

use super::grid::{ALL_FACTORS, FactorPosterior};
use super::word::{beyond, change_word, undetermined};
use crate::concepts::error::ConceptError;
use crate::concepts::few_examples::check_new;
use crate::concepts::lessons::{LessonAnswer, LessonVideo};
use crate::concepts::lexicon::{Lexicon, word_probabilities};
use crate::num::Stop;
use crate::num::elementary::{exp, ln};
use crate::reason::{
    AskOptions, ChangeWord, ChangedQuantity, WordProbabilities, WordedScene, ask_with_words, estimated_share,
};
use rayon::prelude::*;

/// Share of answers that are wrong whatever the factor: the fit's own errors.
const WRONG: f64 = 0.05;

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
    let found = FactorPosterior::on_grids(true, ALL_FACTORS, |points, part| {
        lessons.log_likelihood(points, &crate::num::progress_within(stop, part))
    })?;
    let found = found.ok_or_else(|| undetermined(name))?;
    if found.is_beyond_all() {
        return Err(beyond(format!("\"{name}\"")));
    }
    let mut learned = lexicon.clone();
    learned.words.push(change_word(name, options.quantity, &found, found.spread, [questions, 0]));
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
