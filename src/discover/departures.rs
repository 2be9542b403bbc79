//! The one video of several whose shared numbers are not those of the others: its clock, its scale, its surface or a mass differs.
//!
//! Each video k is fitted alone: a number has the value v_k with deviation s_k there. A set-up realises the number m a little
//! differently in each video, with deviation tau = REALISED m, so that v_k has the variance s_k^2 + tau^2. The others have the mean m
//! by precision. Their chi-square about it tells how far the variances are too small; beside it stand DEGREES pseudo-observations
//! at one (the scaled inverse chi-square prior: Gelman et al., Bayesian Data Analysis, 2013, sec. 2.6). Both variances are enlarged by
//! that factor, and the difference in these deviations is a Student t number. Where all scatter alike none is large.

use super::proof;
use super::revise::Revision;
use super::weak_form::WeakFormRegression;
use crate::effects::{ParamId, Role, effect};
use crate::fit::{FitError, FitOptions, StartPoint, estimate_each};
use crate::num::Stop;
use std::collections::BTreeMap;

/// Fewest videos of which one can be distinguished from the others.
const FEWEST: usize = 3;
/// Deviations from the others: of a t number of six degrees (four videos) 1 in 400 is as far. Sets of videos of which all is
/// equal have less: their numbers scatter by the noise, and by less than REALISED.
const FAR: f64 = 5.0;
/// Relative deviation with which a set-up realises a number from video to video: Bullet's coefficients of friction scatter by
/// 0.6 %, of which the noise explains half.
const REALISED: f64 = 0.005;
/// Degrees of freedom with which that is known.
const DEGREES: f64 = 4.0;

/// The video that differs most from the others, in words; `None` where none does.
pub fn departure(
    lens: &WeakFormRegression,
    revision: &Revision,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<String>, FitError> {
    if lens.scenes.len() < FEWEST {
        return Ok(None);
    }
    let near = FitOptions { start_point: StartPoint::NearOptimum, ..*options };
    let alone = estimate_each(lens.scenes, &revision.fit.models(), &near, stop)?;
    let mut numbers: BTreeMap<&str, Vec<Number>> = BTreeMap::new();
    for (video, fit) in alone.iter().enumerate().filter(|(_, fit)| !proof::loses(fit)) {
        let identified = fit.posterior.estimates.iter().filter(|e| e.scene.is_none() && e.identified);
        for e in identified.filter(|e| is_size(&e.name)) {
            // What a video leaves beyond the noise is in no deviation of its fit.
            let misfit = fit.scenes.iter().map(|s| s.reduced_chi_square).fold(1.0, f64::max);
            let sd = e.sd * misfit.sqrt();
            numbers.entry(&e.name).or_default().push(Number { video, value: e.value, sd });
        }
    }
    let worst = numbers.iter().filter_map(|(name, all)| Some((name, farthest(all)?)));
    let worst = worst.max_by(|a, b| a.1.z.total_cmp(&b.1.z));
    Ok(worst.map(|(name, d)| {
        let unit = alone[d.video].posterior.estimates.iter().find(|e| e.name == **name).map(|e| &e.unit);
        let unit = unit.filter(|u| *u != "1").map_or(String::new(), |u| format!(" {u}"));
        format!(
            "; {} differs from the other videos: {name} is {:.4}{unit} there and {:.4}{unit} in the others; check its clock (frames \
             per second), scale, masses and surface, or leave it out",
            lens.scenes[d.video].name, d.own, d.others
        )
    }))
}

/// A number as one video has it.
struct Number {
    video: usize,
    value: f64,
    sd: f64,
}

/// One that is far from the others.
struct Departure {
    video: usize,
    own: f64,
    others: f64,
    z: f64,
}

/// Whether it is the size of a law that acts between contacts: what chaos runs through tells its own numbers with deviations that are
/// too small, and a share of a number that may have either sign says nothing.
fn is_size(name: &str) -> bool {
    let Some((id, entry)) = ParamId::parse(name).and_then(|id| Some((id, effect(id.effect)?))) else {
        return false;
    };
    let positive = entry.spec.params.iter().any(|p| p.name == id.parameter && p.min >= 0.0);
    positive && !entry.shows_at_contacts() && entry.profile.role != Role::Nuisance
}

/// The number that is farthest from the others, if it is far.
fn farthest(all: &[Number]) -> Option<Departure> {
    if all.len() < FEWEST {
        return None;
    }
    let one = |k: usize| -> Option<Departure> {
        let others: Vec<&Number> = all.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, n)| n).collect();
        let rough = others.iter().map(|n| n.value).sum::<f64>() / others.len() as f64;
        let variance =
            |n: &Number| (n.sd * n.sd + REALISED * REALISED * rough * rough).max(f64::MIN_POSITIVE);
        let total: f64 = others.iter().map(|n| 1.0 / variance(n)).sum();
        let mean = others.iter().map(|n| n.value / variance(n)).sum::<f64>() / total;
        let scatter: f64 = others.iter().map(|n| (n.value - mean) * (n.value - mean) / variance(n)).sum();
        let enlarged = ((DEGREES + scatter) / (DEGREES + others.len() as f64 - 1.0)).max(1.0);
        let z = (all[k].value - mean).abs() / (enlarged * (variance(&all[k]) + 1.0 / total)).sqrt();
        (z > FAR).then_some(Departure { video: all[k].video, own: all[k].value, others: mean, z })
    };
    (0..all.len()).filter_map(one).max_by(|a, b| a.z.total_cmp(&b.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_that_differs_is_named_and_a_scatter_is_not() {
        let of = |values: &[f64]| {
            let number = |(video, value): (usize, &f64)| Number { video, value: *value, sd: 1e-4 };
            farthest(&values.iter().enumerate().map(number).collect::<Vec<_>>()).map(|d| d.video)
        };
        assert_eq!(of(&[0.03, 0.0075, 0.0301]), Some(1));
        assert_eq!(of(&[0.03, 0.0301, 0.0302, 0.0299]), None);
        assert_eq!(of(&[0.01, 0.02, 0.03, 0.04]), None, "all differ");
        assert_eq!(of(&[0.03, 0.0315, 0.0301, 0.0299]), Some(1), "a scale that is 5 % off");
        assert_eq!(of(&[0.03, 0.0304, 0.0301, 0.0299]), None, "by no more than engines do");
        assert_eq!(of(&[0.03, 0.0325, 0.031, 0.0285]), None, "all differ by some per cent");
        assert_eq!(of(&[0.03, 0.0075]), None, "of two neither is the odd one");
    }
}
