//! The factor of a change from pairs of videos: one with its fit, and one in which the same objects are seen with one changed.
//!
//! `p(f | pairs) ~ p(f) prod_i p_i(f)`, p_i the likelihood of pair i (see `likelihood`). With the mean m_i and the deviation s_i of ln f of
//! each pair alone, `Q = sum_i (m_i - m)^2/s_i^2` around their common mean m is chi-square with n - 1 degrees of freedom for n pairs.
//! Where it is above that by three of its deviations, the pairs have factors of their own: `ln f_i ~ N(ln f, t^2)`, with
//! `t^2 = (Q - (n - 1))/(W - sum_i w_i^2/W)`, `w_i = 1/s_i^2`, `W = sum_i w_i` (DerSimonian and Laird, Controlled Clinical Trials 7 (1986)
//! 177), and `p_i(f) = N(m_i; ln f, s_i^2 + t^2)`. They contradict each other where more than one pair in twenty would then show the
//! opposite change. A counter-example is a pair without this change: it contradicts where the factor of the others explains it better
//! than no change does.

use super::grid::{ALL_FACTORS, FactorPosterior};
use super::likelihood::ChangedVideo;
use super::word::{beyond, change_word, undetermined};
use crate::concepts::error::{ConceptError, ExampleNumber};
use crate::concepts::few_examples::check_new;
use crate::concepts::lexicon::Lexicon;
use crate::fit::Fit;
use crate::num::{Stop, progress_within};
use crate::reason::ChangedQuantity;
use crate::scene::Scene;

/// Deviations of chi-square, and of a difference of two pairs, that are chance.
const CHANCE: f64 = 3.0;
/// Deviations of a normal distribution beyond which one draw in twenty lies, on one side.
const ONE_IN_TWENTY: f64 = 1.645;
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
        let number = ExampleNumber::of(index, yes.len());
        let mut pair = PairLikelihood::new(example, number, quantity)?;
        pair.look(number, &progress_within(stop, part))?;
        all.push(pair);
    }
    let (fitting, others) = all.split_at(yes.len());
    let scatter = PairScatter::of(fitting);
    let contradictory = |pairs| ConceptError::ContradictoryChanges { name: name.into(), pairs };
    if scatter.is_contradictory() {
        return Err(contradictory(disagreements(fitting)));
    }
    let ranges: Vec<[f64; 2]> = fitting.iter().filter_map(|p| Some(p.alone.as_ref()?.range())).collect();
    let end = |side: usize, of: fn(f64, f64) -> f64| ranges.iter().map(|r| r[side]).reduce(of);
    let range = end(0, f64::min).zip(end(1, f64::max)).ok_or_else(|| undetermined(name))?;
    let together = |points: &[f64], _: [f64; 2]| -> Result<Vec<f64>, ConceptError> {
        let exact = |x: f64| fitting.iter().map(|p| p.at(x)).sum();
        Ok(points.iter().map(|x| scatter.log_likelihood(*x).unwrap_or_else(|| exact(*x))).collect())
    };
    let found = FactorPosterior::on_grids(true, range.into(), together)?;
    let found = found.ok_or_else(|| undetermined(name))?;
    let (factor, mean) = (found.factor(), found.mean());
    let shows_it = |pair: &&PairLikelihood| pair.alone.is_some() && pair.odds(mean) > LEAST_ODDS;
    let contrary = |pair: &PairLikelihood| {
        format!(
            "{} (a counter-example) shows the examples' factor {factor:.3} rather than no change",
            pair.label
        )
    };
    let pairs: Vec<String> = others.iter().filter(shows_it).map(contrary).collect();
    if !pairs.is_empty() {
        return Err(contradictory(pairs));
    }
    let odds = fitting.iter().map(|p| p.odds(mean)).sum::<f64>();
    let [low, high] = found.interval();
    if odds < LEAST_ODDS || (low..=high).contains(&1.0) {
        let nearest = format!("their factor is {factor:.3} ({low:.3} to {high:.3}), which may be no change");
        return Err(ConceptError::NotSeparable { name: name.into(), nearest });
    }
    let mut learned = lexicon.clone();
    learned.words.push(change_word(name, quantity, &found, odds, [yes.len(), no.len()]));
    Ok(learned)
}

/// The factors of pairs, and how far these differ by more than their errors.
struct PairScatter {
    /// Mean and variance of ln f of each pair that says something.
    known: Vec<(f64, f64)>,
    /// t^2; 0: one factor explains all.
    between: f64,
}

impl PairScatter {
    fn of(pairs: &[PairLikelihood]) -> PairScatter {
        let of = |p: &PairLikelihood| p.alone.as_ref().map(|f| (f.mean(), f.sigma() * f.sigma()));
        PairScatter::new(pairs.iter().filter_map(of).collect())
    }

    fn new(known: Vec<(f64, f64)>) -> PairScatter {
        let scatter = PairScatter { known, between: 0.0 };
        let (mean, degrees) = (scatter.mean(), scatter.known.len().saturating_sub(1) as f64);
        let off: f64 = scatter.known.iter().map(|(m, v)| (m - mean) * (m - mean) / v).sum();
        if scatter.known.len() < 2 || off <= degrees + CHANCE * (2.0 * degrees).sqrt() {
            return scatter;
        }
        let weight: f64 = scatter.known.iter().map(|k| 1.0 / k.1).sum();
        let squares: f64 = scatter.known.iter().map(|k| 1.0 / (k.1 * k.1)).sum();
        PairScatter { between: (off - degrees) / (weight - squares / weight), ..scatter }
    }

    fn mean(&self) -> f64 {
        let weight: f64 = self.known.iter().map(|k| 1.0 / (k.1 + self.between)).sum();
        self.known.iter().map(|k| k.0 / (k.1 + self.between)).sum::<f64>() / weight
    }

    /// Whether too many pairs would show the opposite change.
    fn is_contradictory(&self) -> bool {
        self.between > 0.0 && self.mean().abs() < ONE_IN_TWENTY * self.between.sqrt()
    }

    /// Of ln f, where each pair has a factor of its own.
    fn log_likelihood(&self, x: f64) -> Option<f64> {
        let of = |(m, v): &(f64, f64)| -0.5 * (x - m) * (x - m) / (v + self.between);
        (self.between > 0.0).then(|| self.known.iter().map(of).sum())
    }
}

/// The pairs of examples that disagree most.
fn disagreements(pairs: &[PairLikelihood]) -> Vec<String> {
    let known: Vec<(&str, f64, f64, f64)> = pairs
        .iter()
        .filter_map(|p| p.alone.as_ref().map(|f| (p.label.as_str(), f.mean(), f.sigma(), f.factor())))
        .collect();
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
        number: ExampleNumber,
        quantity: ChangedQuantity,
    ) -> Result<PairLikelihood, ConceptError> {
        let ChangeExample { before, fit, object, after } = example;
        let objects = before.objects.len();
        let missing = ConceptError::NoSuchObject { example: number, object: *object, objects };
        let id = before.objects.get(*object).map(|o| o.id).ok_or(missing)?;
        if let Some(problem) = difference(before, after, id) {
            return Err(ConceptError::OtherObjects { example: number, problem });
        }
        let chi_square = fit.0.scenes.get(fit.1).map_or(0.0, |s| s.reduced_chi_square);
        if chi_square > LOST {
            return Err(ConceptError::NotFollowed { example: number, which: "first", chi_square });
        }
        let label = format!("object {id} of {} in {}", before.name, after.name);
        let video = ChangedVideo::new(after, *fit, id, quantity);
        Ok(PairLikelihood { label, video, known: vec![], alone: None })
    }

    /// Finds the likelihood where it matters.
    fn look(&mut self, number: ExampleNumber, stop: Stop) -> Result<(), ConceptError> {
        let (video, known) = (&mut self.video, &mut self.known);
        self.alone = FactorPosterior::on_grids(false, ALL_FACTORS, |points, part| {
            let log = video.log_likelihood(points, &progress_within(stop, part))?;
            *known = joined(known, points, &log);
            Ok::<_, ConceptError>(log)
        })?;
        let chi_square = self.video.chi_square();
        if chi_square > LOST {
            return Err(ConceptError::NotFollowed { example: number, which: "second", chi_square });
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

/// Why `after` does not show the same as `before`, in which object `id` is to be changed.
fn difference(before: &Scene, after: &Scene, id: u32) -> Option<String> {
    if let (Some(first), Some(second)) = (&before.setup, &after.setup)
        && first != second
    {
        return Some(format!("is of set-up {second:?}, but the first of {first:?}"));
    }
    if before.world != after.world {
        let [first, second] = [before, after].map(|s| s.world.name());
        return Some(format!("is of the world {second}, but the first of {first}"));
    }
    if after.object_index(id).is_none() {
        return Some(format!("lacks object {id}, which is changed"));
    }
    after.objects.iter().find_map(|object| match before.object_index(object.id) {
        None => Some(format!("has object {}, which the first lacks", object.id)),
        Some(k) if before.objects[k].shape.word() != object.shape.word() => {
            let [first, second] = [&before.objects[k], object].map(|o| o.shape.word());
            Some(format!("has a {second} as object {}, but the first a {first}", object.id))
        }
        Some(_) => None,
    })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::elementary::ln;

    #[test]
    fn factors_that_differ_a_little_widen_the_interval_and_opposite_ones_contradict() {
        let scatter = |factors: &[f64]| PairScatter::new(factors.iter().map(|f| (ln(*f), 1e-5)).collect());
        assert_eq!(scatter(&[3.0]).between, 0.0);
        assert_eq!(scatter(&[3.0, 3.01]).log_likelihood(1.1), None, "by chance");
        let real = scatter(&[3.0, 2.9, 3.2]);
        assert!(!real.is_contradictory() && (real.mean() - ln(3.03)).abs() < 0.01, "{}", real.mean());
        let at = |x: f64| real.log_likelihood(x).expect("they differ");
        // Standard error of the mean of three: ln(3.2/2.9) = 0.098 between the outer ones.
        let sigma = (2.0 * (at(real.mean()) - at(real.mean() + 0.01)) / 1e-4).sqrt().recip();
        assert!((0.02..0.05).contains(&sigma), "{sigma}");
        assert!(scatter(&[3.0, 0.3]).is_contradictory() && scatter(&[3.0, 1.2]).is_contradictory());
    }
}
