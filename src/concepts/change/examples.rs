//! The factor of a change from pairs of videos: one with its fit, and one in which the same objects are seen with one changed.
//!
//! `p(f | pairs) ~ p(f) prod_i p_i(f)`, p_i the likelihood of pair i (see `likelihood`). With the mean m_i and the deviation s_i of each
//! pair alone, `sum_i (m_i - m)^2/s_i^2` around their common mean m is chi-square with one degree fewer than pairs; where it is above
//! that by three of its deviations, the pairs contradict each other. A counter-example is a pair without this change: it contradicts
//! where the factor of the others explains it better than no change does.

use super::grid::{ALL_FACTORS, FactorPosterior};
use super::likelihood::ChangedVideo;
use super::word::{beyond, change_word, undetermined};
use crate::concepts::error::ConceptError;
use crate::concepts::few_examples::check_new;
use crate::concepts::lexicon::Lexicon;
use crate::fit::Fit;
use crate::num::{Stop, progress_within};
use crate::reason::ChangedQuantity;
use crate::scene::Scene;

/// Deviations of chi-square, and of a difference of two pairs, that are chance.
const CHANCE: f64 = 3.0;
/// Log odds (nat) of the word's factor against no change, from which a counter-example is an example: twenty to one.
const LEAST_ODDS: f64 = 3.0;

/// Reduced chi-square above which a model does not follow a video, as chaos makes none of a right one.
const LOST: f64 = 100.0;

/// A video, and one in which an object is changed; all else is the same but the start states.
#[derive(Debug, Clone, Copy)]
pub struct ChangeExample<'a> {
    pub before: &'a Scene,
    /// With the scene's index in it.
    pub fit: (&'a Fit, usize),
    /// Index of the object in `before`.
    pub object: usize,
    /// It has objects of `before` only, with the same ids.
    pub after: &'a Scene,
}

/// What one pair says of the factor.
struct PairLikelihood {
    label: String,
    video: ChangedVideo,
    /// `(ln f, ln p)` of all points so far, by the first.
    known: Vec<(f64, f64)>,
    /// By this pair alone; `None` where it says nothing.
    alone: Option<FactorPosterior>,
}

/// The lexicon with a word for a change, from pairs of videos that show it and pairs that do not. Deterministic.
pub fn learn_change_from_examples(
    lexicon: &Lexicon,
    name: &str,
    quantity: ChangedQuantity,
    (yes, no): (&[ChangeExample], &[ChangeExample]),
    stop: Stop,
) -> Result<Lexicon, ConceptError> {
    lexicon.check()?;
    check_new(lexicon, name)?;
    let count = (yes.len() + no.len()).max(1) as f64;
    let mut all = vec![];
    for (index, example) in yes.iter().chain(no).enumerate() {
        let part = [index as f64 / count, (index + 1) as f64 / count];
        let mut pair = PairLikelihood::new(example, index, quantity)?;
        pair.look(index, &progress_within(stop, part))?;
        all.push(pair);
    }
    let (fitting, others) = all.split_at(yes.len());
    let mut pairs = disagreements(fitting);
    let ranges: Vec<[f64; 2]> = fitting.iter().filter_map(|p| Some(p.alone.as_ref()?.range())).collect();
    let end = |side: usize, of: fn(f64, f64) -> f64| ranges.iter().map(|r| r[side]).reduce(of);
    let range = end(0, f64::min).zip(end(1, f64::max)).ok_or_else(|| undetermined(name))?;
    let together = |points: &[f64], _: [f64; 2]| -> Result<Vec<f64>, ConceptError> {
        Ok(points.iter().map(|x| fitting.iter().map(|p| p.at(*x)).sum()).collect())
    };
    let found = FactorPosterior::on_grids(true, range.into(), together)?;
    let found = found.ok_or_else(|| undetermined(name))?;
    let (factor, mean) = (found.factor(), found.mean());
    let shows_it = |pair: &&PairLikelihood| pair.alone.is_some() && pair.odds(mean) > LEAST_ODDS;
    pairs.extend(others.iter().filter(shows_it).map(|pair| {
        format!(
            "{} (a counter-example) shows the examples' factor {factor:.3} rather than no change",
            pair.label
        )
    }));
    if !pairs.is_empty() {
        return Err(ConceptError::ContradictoryChanges { name: name.into(), pairs });
    }
    let odds = fitting.iter().map(|p| p.odds(mean)).sum::<f64>();
    if odds < LEAST_ODDS {
        let [low, high] = found.interval();
        let nearest = format!("their factor is {factor:.3} ({low:.3} to {high:.3}), which may be no change");
        return Err(ConceptError::NotSeparable { name: name.into(), nearest });
    }
    let mut learned = lexicon.clone();
    learned.words.push(change_word(name, quantity, &found, odds, [yes.len(), no.len()]));
    Ok(learned)
}

/// Pairs of examples that disagree, if all of them together do.
fn disagreements(pairs: &[PairLikelihood]) -> Vec<String> {
    let known: Vec<(&str, f64, f64, f64)> = pairs
        .iter()
        .filter_map(|p| p.alone.as_ref().map(|f| (p.label.as_str(), f.mean(), f.sigma(), f.factor())))
        .collect();
    let weight: f64 = known.iter().map(|k| 1.0 / (k.2 * k.2)).sum();
    let mean = known.iter().map(|k| k.1 / (k.2 * k.2)).sum::<f64>() / weight;
    let chi_square: f64 = known.iter().map(|k| (k.1 - mean) * (k.1 - mean) / (k.2 * k.2)).sum();
    let degrees = known.len().saturating_sub(1) as f64;
    if chi_square <= degrees + CHANCE * (2.0 * degrees).sqrt() {
        return vec![];
    }
    let mut each = vec![];
    for (i, a) in known.iter().enumerate() {
        for b in &known[..i] {
            let off = (a.1 - b.1).abs() / (a.2 * a.2 + b.2 * b.2).sqrt();
            each.push((off, format!("{} (factor {:.3}) and {} (factor {:.3})", b.0, b.3, a.0, a.3)));
        }
    }
    let most = each.iter().map(|e| e.0).fold(0.0, f64::max);
    each.into_iter().filter(|e| e.0 >= CHANCE.min(most)).map(|e| e.1).collect()
}

impl PairLikelihood {
    fn new(
        example: &ChangeExample,
        index: usize,
        quantity: ChangedQuantity,
    ) -> Result<PairLikelihood, ConceptError> {
        let ChangeExample { before, fit, object, after } = example;
        let objects = before.objects.len();
        let missing = ConceptError::NoSuchObject { index, object: *object, objects };
        let id = before.objects.get(*object).map(|o| o.id).ok_or(missing)?;
        if let (Some(first), Some(second)) = (&before.setup, &after.setup)
            && first != second
        {
            let problem = format!("is of set-up {second:?}, but the first of {first:?}");
            return Err(ConceptError::OtherObjects { index, problem });
        }
        let foreign = after.objects.iter().find(|o| before.object_index(o.id).is_none());
        if let Some(foreign) = foreign.map(|o| o.id) {
            return Err(ConceptError::OtherObjects {
                index,
                problem: format!("has object {foreign}, which the first lacks"),
            });
        }
        if after.object_index(id).is_none() {
            return Err(ConceptError::OtherObjects {
                index,
                problem: format!("lacks object {id}, which is changed"),
            });
        }
        let chi_square = fit.0.scenes.get(fit.1).map_or(0.0, |s| s.reduced_chi_square);
        if chi_square > LOST {
            return Err(ConceptError::NotFollowed { index, which: "first", chi_square });
        }
        let label = format!("object {id} of {} in {}", before.name, after.name);
        let video = ChangedVideo::new(after, *fit, id, quantity);
        Ok(PairLikelihood { label, video, known: vec![], alone: None })
    }

    /// Finds the likelihood where it matters.
    fn look(&mut self, index: usize, stop: Stop) -> Result<(), ConceptError> {
        let (video, known) = (&mut self.video, &mut self.known);
        self.alone = FactorPosterior::on_grids(false, ALL_FACTORS, |points, part| {
            let log = video.log_likelihood(points, &progress_within(stop, part))?;
            *known = joined(known, points, &log);
            Ok::<_, ConceptError>(log)
        })?;
        let chi_square = self.video.chi_square();
        if chi_square > LOST {
            return Err(ConceptError::NotFollowed { index, which: "second", chi_square });
        }
        match &self.alone {
            Some(alone) if alone.is_beyond_all() => Err(beyond(self.label.clone())),
            _ => Ok(()),
        }
    }

    fn at(&self, x: f64) -> f64 {
        let after = self.known.partition_point(|k| k.0 < x);
        match (after.checked_sub(1).and_then(|k| self.known.get(k)), self.known.get(after)) {
            (Some((x0, y0)), Some((x1, y1))) if x1 > x0 => y0 + (y1 - y0) * (x - x0) / (x1 - x0),
            (_, Some((_, y))) | (Some((_, y)), None) => *y,
            (None, None) => 0.0,
        }
    }

    /// Log odds of a factor against no change (nat).
    fn odds(&self, x: f64) -> f64 {
        self.at(x) - self.at(0.0)
    }
}

/// The values of a finer grid in place of those of the one before, which stay outside. There they are too large, if anything: both are
/// relative to the largest, which a coarse grid misses.
fn joined(known: &[(f64, f64)], points: &[f64], log: &[f64]) -> Vec<(f64, f64)> {
    let fine = || points.iter().copied().zip(log.iter().copied());
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return known.to_vec() };
    let before = known.iter().copied().filter(|k| k.0 < *first);
    let beyond = known.iter().copied().filter(|k| k.0 > *last);
    before.chain(fine()).chain(beyond).collect()
}
