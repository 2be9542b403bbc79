//! How well probabilities agree with what is: on videos that were left out of training.
//!
//! A program's answer is wrong not only where a word is: an event may be missed. With the share e of questions of which the answer is
//! another one than that of the program, an answer of probability P among n has `(1 - e) P + e (1 - P)/(n - 1)`. The temperature of the
//! words and e are those with the least log loss together: a temperature alone would take each missed event for a doubt about words.
//! (Wichmann and Hill, Percept. Psychophys. 63 (2001) 1293, on lapses of observers.)

use super::run::run;
use crate::concepts::lessons::{PreparedVideo, RecordedLoss, RunItems};
use crate::concepts::lexicon::{CalibrationBin, LearnedFamily, WordCalibration};
use crate::num::elementary::ln;
use crate::num::share_interval;
use rayon::prelude::*;

/// Temperatures that are tried, by factors of about 1.2.
const TEMPERATURES: [f64; 12] = [0.5, 0.6, 0.72, 0.86, 1.0, 1.2, 1.45, 1.75, 2.1, 2.5, 3.0, 4.0];
/// Prior deviation of the logarithm of the temperature around 1, which it is where the information of the lessons is right: a fifth.
const TEMPERATURE_SIGMA: f64 = 0.2;
/// Shares e that are tried, by factors of two; no number of right answers shows that it is zero.
const MISTAKEN: [f64; 6] = [0.005, 0.01, 0.02, 0.04, 0.08, 0.16];
/// By the probability of the most probable answer, up to a certain one.
const BINS: [f64; 7] = [0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97];

/// The answer to a question of a left-out video.
#[derive(Debug, Clone, Copy)]
struct LeftOutAnswer {
    /// Probability of the right answer, and of the most probable one.
    right: f64,
    largest: f64,
    /// How many have one; at least two.
    count: f64,
}

impl LeftOutAnswer {
    /// With this share of answers that are wrong whatever the words.
    fn mistaken(&self, share: f64) -> LeftOutAnswer {
        let of = |p: f64| (1.0 - share) * p + share * (1.0 - p) / (self.count - 1.0);
        LeftOutAnswer { right: of(self.right), largest: of(self.largest), ..*self }
    }

    fn is_right(&self) -> bool {
        self.right >= self.largest
    }
}

/// Sets each family's temperature, with the share of answers that are wrong whatever the words, to those with the least log loss on
/// videos that were left out.
pub fn calibrate(
    families: &mut [LearnedFamily],
    videos: &[PreparedVideo],
    left_out: &[(usize, Vec<LearnedFamily>)],
    folds: usize,
) {
    // Only one tape for each thread is held at once: a video is run with all temperatures, one after the other.
    let of_video = |(v, video): (usize, &PreparedVideo)| -> Vec<Vec<LeftOutAnswer>> {
        let fold = left_out.iter().find(|(fold, _)| v % folds == *fold);
        let Some((_, learned)) = fold else { return vec![vec![]; TEMPERATURES.len()] };
        let mut last: Option<RecordedLoss> = None;
        let mut at = |temperature: &f64| -> Vec<LeftOutAnswer> {
            let logits = moderated_logits(learned, video, *temperature);
            last = run(video, learned, &logits, (RunItems::Simulated, last.take())).ok();
            last.as_ref().map_or(vec![], answers)
        };
        TEMPERATURES.iter().map(&mut at).collect()
    };
    let each: Vec<Vec<Vec<LeftOutAnswer>>> = videos.par_iter().enumerate().map(of_video).collect();
    let all = |k: usize| -> Vec<LeftOutAnswer> { each.iter().flat_map(|v| v[k].iter().copied()).collect() };
    let scored = TEMPERATURES.iter().enumerate().flat_map(|(k, t)| {
        let answers = all(k);
        MISTAKEN.map(|share| {
            let answers: Vec<LeftOutAnswer> = answers.iter().map(|a| a.mistaken(share)).collect();
            (*t, share, answers)
        })
    });
    let cost = |(temperature, _, answers): &(f64, f64, Vec<LeftOutAnswer>)| {
        let off = ln(*temperature) / TEMPERATURE_SIGMA;
        log_loss(answers) + 0.5 * off * off
    };
    let best = scored.min_by(|a, b| cost(a).total_cmp(&cost(b)));
    if let Some((temperature, mistaken, answers)) = best.filter(|b| !b.2.is_empty()) {
        let calibration = WordCalibration { mistaken, ..calibration(&answers) };
        for family in families {
            (family.temperature, family.calibration) = (temperature, Some(calibration.clone()));
        }
    }
}

/// Logarithms of the probabilities of the words of a video: family by family, object by object.
fn moderated_logits(families: &[LearnedFamily], video: &PreparedVideo, temperature: f64) -> Vec<f64> {
    let of_family = |f: &LearnedFamily| {
        let at = |x: &Vec<f64>| f.probabilities_at(x, temperature);
        video.features.iter().flat_map(at).map(|p| ln(p.max(f64::MIN_POSITIVE))).collect::<Vec<_>>()
    };
    families.iter().flat_map(of_family).collect()
}

fn answers(run: &RecordedLoss) -> Vec<LeftOutAnswer> {
    let value = |v: &_| run.tape.value(*v);
    let of = |a: &crate::concepts::lessons::RecordedAnswer| {
        let right = value(&a.right);
        let largest = a.others.iter().map(value).fold(right, f64::max);
        LeftOutAnswer { right, largest, count: (1.0 + a.others.len() as f64).max(2.0) }
    };
    run.answers.iter().map(of).collect()
}

/// Sum of the negative log probabilities of the right answers (nat).
fn log_loss(answers: &[LeftOutAnswer]) -> f64 {
    answers.iter().map(|a| -ln(a.right)).sum()
}

/// Figures of left-out answers.
fn calibration(answers: &[LeftOutAnswer]) -> WordCalibration {
    let n = answers.len().max(1) as f64;
    let bin = |k: usize| -> Option<CalibrationBin> {
        let to = BINS.get(k + 1).copied().unwrap_or(f64::INFINITY);
        let own: Vec<&LeftOutAnswer> =
            answers.iter().filter(|a| (BINS[k]..to).contains(&a.largest)).collect();
        let count = Some(own.len()).filter(|n| *n > 0)?;
        let right = own.iter().filter(|a| a.is_right()).count();
        Some(CalibrationBin {
            answers: count,
            probability: own.iter().map(|a| a.largest).sum::<f64>() / count as f64,
            accuracy: right as f64 / count as f64,
            interval: share_interval(right, count),
        })
    };
    WordCalibration {
        answers: answers.len(),
        log_loss: log_loss(answers) / n,
        accuracy: answers.iter().filter(|a| a.is_right()).count() as f64 / n,
        mistaken: 0.0,
        bins: (0..BINS.len()).filter_map(bin).collect(),
    }
}
