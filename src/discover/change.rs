//! A change that someone asks for: an effect put into the models of a set-up, or taken out, and what that is worth.

use super::contact_law::estimates_of;
use super::discovery::{nearest, readings, too_little};
use super::intervals::{by_object, plausible};
use super::jackknife::{LawParameters, of_videos};
use super::outcome::{
    FoundEffect, NINETY_FIVE, ParameterEstimate, ParameterValue, RankedEffect, may_be_none,
};
use super::proof::{deviance, lost};
use super::proposal::{FORMULA, ModelChange, Proposal, canonical, laws, named, propose};
use super::resample::resampled;
use super::revise::{
    Revision, fits_of_revision, pooled_noise, revise, revise_from, trajectories, without_effect,
};
use super::screen::with_nuisance;
use super::user_formula::fit_written;
use super::weak_form::{WeakFormRegression, fit_forces};
use crate::effects::effect;
use crate::effects::formula::{Formula, FormulaParameter};
use crate::fit::{Fit, FitError, FitOptions, SceneFit, StartPoint, estimate};
use crate::num::{Stop, elementary, progress_of_jobs, progress_within};
use crate::scene::Scene;
use crate::world::Model;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Evidence (nats) from which a change is better, or worse.
const CERTAIN: f64 = 10.0;
/// Errors on what was not fitted that differ by less than this share are the same.
const ALIKE: f64 = 0.02;

/// Whether a change is worth making.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChangeVerdict {
    /// The data speak for it, and it predicts what was not fitted at least as well.
    Better,
    /// The data do not tell: the simpler model is as good.
    NoDifference,
    Worse,
    /// Too little moves to tell.
    NotIdentifiable,
}

/// What one revision is worth against the one that it came from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ChangeEvidence {
    /// Against the model before, the price of the parameters paid (BIC, nats).
    pub log_evidence: f64,
    pub worth: ChangeVerdict,
}

/// Errors of a revision on frames that it was not fitted to, and on videos left out (m).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PredictionErrors {
    pub held_out_rmse: f64,
    pub left_out_rmse: f64,
}

/// A revision that was asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct ChangeResult {
    /// The models as they were, where nobody had fitted them as a revision before.
    pub before: Option<Revision>,
    pub after: Revision,
    /// The effect that was added, with its parameters.
    pub added: Option<FoundEffect>,
    pub weight: ChangeEvidence,
    /// Why these videos cannot tell what it is worth, and what to film instead.
    pub too_little: Option<String>,
}

/// What a change begins with.
pub enum Origin<'a> {
    /// Models that nobody has fitted: they become the first revision.
    Start(&'a [Model]),
    /// A revision: its fits, one a scene, and its errors.
    Revision(&'a [&'a SceneFit], PredictionErrors),
}

/// Makes a change that [`ModelChange::check`] allows. Deterministic, whatever the number of threads.
pub fn change(
    scenes: &[Scene],
    origin: &Origin,
    change: &ModelChange,
    options: &FitOptions,
    stop: Stop,
) -> Result<ChangeResult, FitError> {
    let coarse = resampled(scenes);
    let start;
    let origin = match origin {
        Origin::Start(models) => {
            start = coarse.models(scenes, models);
            &Origin::Start(&start)
        }
        revision @ Origin::Revision(..) => revision,
    };
    let mut made = change_in(&coarse.scenes, origin, change, options, stop)?;
    made.before.iter_mut().chain([&mut made.after]).for_each(|revision| coarse.restore(scenes, revision));
    Ok(made)
}

fn change_in(
    scenes: &[Scene],
    origin: &Origin,
    change: &ModelChange,
    options: &FitOptions,
    stop: Stop,
) -> Result<ChangeResult, FitError> {
    let models: Vec<Model> = match origin {
        Origin::Start(models) => models.to_vec(),
        Origin::Revision(fits, _) => fits.iter().map(|f| f.model.clone()).collect(),
    };
    crate::fit::check(scenes, &models)?;
    let lens = WeakFormRegression::new(scenes).until(stop);
    let readings = match origin {
        Origin::Start(models) => readings(scenes, models).iter().map(|m| with_nuisance(m)).collect(),
        Origin::Revision(..) => vec![models],
    };
    // The base is read as the motion with the change has it: what a base lacks misleads about it.
    let mut read: Vec<(f64, Vec<Model>, Proposal)> = vec![];
    for models in readings {
        let proposal = propose(&lens, &models, change, &progress_within(stop, [0.0, 0.1]))?;
        read.push((fit_forces(&lens, &proposal.models).1.cost, models, proposal));
    }
    let near = nearest(read.iter().map(|r| r.0));
    let half =
        |half: [f64; 2], revisions: usize| progress_of_jobs(stop, half, revisions * fits_of_revision(scenes));
    // Where the lens cannot tell the readings apart, or sees none of them, trajectories do.
    let read = read.into_iter().enumerate().filter(|(k, _)| near.is_empty() || near.contains(k));
    let read: Vec<(Vec<Model>, Proposal)> =
        read.map(|(_, (_, models, proposal))| (models, proposal)).collect();
    let told = half([0.1, 0.55], read.len());
    let base =
        |(models, proposal): (Vec<Model>, Proposal)| -> Result<(Option<Revision>, Proposal), FitError> {
            let anew = matches!(origin, Origin::Start(_));
            let base = anew.then(|| revise(&lens, &models, None, options, &told)).transpose()?;
            Ok((base, proposal))
        };
    let bases: Vec<(Option<Revision>, Proposal)> = read.into_iter().map(base).collect::<Result<_, _>>()?;
    let off = |base: &Option<Revision>| base.as_ref().map_or(0.0, |base| deviance(&base.fit));
    let best = bases.into_iter().min_by(|a, b| off(&a.0).total_cmp(&off(&b.0)));
    let Some((before, proposal)) = best else { return Err(FitError::NoScene) };
    let name = proposal.added.as_deref();
    let mut after = revise(&lens, &proposal.models, name, options, &half([0.55, 1.0], 1))?;
    let (fits, unseen): (Vec<&SceneFit>, PredictionErrors) = match (&before, origin) {
        (Some(first), _) => (first.fit.scenes.iter().collect(), first.unseen()),
        (None, Origin::Revision(fits, unseen)) => (fits.to_vec(), *unseen),
        (None, Origin::Start(_)) => return Err(FitError::NoScene),
    };
    // With one law more the best is no farther: a search that went astray begins again where the models without it stand.
    let (chi, degrees) = chi_square(&fits);
    if name.is_some() && after.reduced_chi_square > chi / degrees.max(1.0) {
        let begun: Vec<Option<&Model>> = fits.iter().map(|f| Some(&f.model)).collect();
        // Not led by the lens, which knows less of the state (a ball's spin).
        let again = revise_from(&lens, &proposal.models, &begun, None, options, &|_| stop(1.0))?;
        if again.reduced_chi_square < after.reduced_chi_square {
            after = Revision { effect: after.effect, ..again };
        }
    }
    // Nor may the fit depend on the edits that led to the model.
    if let Some(start) = canonical(&lens, &after.fit.models(), &|_| stop(1.0))?
        && let (tried, _) = trajectories(&lens, &start, name, options, &|_| stop(1.0))?
        && deviance(&tried) < deviance(&after.fit)
    {
        let other = revise(&lens, &start, name, options, &|_| stop(1.0))?;
        if deviance(&other.fit) < deviance(&after.fit) {
            after = other;
        }
    }
    // A search that escaped a bad minimum is no merit of the law that it was made with.
    let again = match &proposal.added {
        Some(name) => {
            let models = without_effect(&after.fit, name);
            let near = FitOptions { start_point: StartPoint::NearOptimum, ..*options };
            Some(estimate(scenes, &models, &near, &|_| stop(1.0))?)
        }
        None => None,
    };
    let fair: Vec<&SceneFit> = again.iter().flat_map(|a| &a.scenes).collect();
    let better = again.is_some() && chi_square(&fair).0 < chi_square(&fits).0;
    let mut weight = weigh(if better { &fair } else { &fits }, unseen, &after);
    // A law that may well be none makes nothing better, whatever else the search found on its way.
    if weight.worth == ChangeVerdict::Better
        && proposal.added.as_ref().is_some_and(|name| does_nothing(&after.fit, name))
    {
        weight.worth = ChangeVerdict::NoDifference;
    }
    let too_little = too_little(&lens);
    if too_little.is_some() {
        weight.worth = ChangeVerdict::NotIdentifiable;
    }
    let added =
        proposal.added.map(|name| found(&lens, &after, &name, options, &|_| stop(1.0))).transpose()?;
    widen_laws(&lens, &mut after, added.as_ref(), options, &|_| stop(1.0))?;
    stop(1.0)?;
    Ok(ChangeResult { before, after, added, weight, too_little })
}

/// Gives each law of a revision the deviations that hold what the videos disagree about, whatever was changed last; those of the
/// law that was `added` are known.
fn widen_laws(
    lens: &WeakFormRegression,
    after: &mut Revision,
    added: Option<&FoundEffect>,
    options: &FitOptions,
    stop: Stop,
) -> Result<(), FitError> {
    let others = laws(lens.scenes, &after.fit.models()).unwrap_or_default().into_iter();
    let others = others.filter(|law| added.is_none_or(|added| added.effect != *law));
    let others: Vec<FoundEffect> =
        others.map(|law| found(lens, after, &law, options, stop)).collect::<Result<_, FitError>>()?;
    added.into_iter().chain(&others).for_each(|law| law.widen(&mut after.fit));
    Ok(())
}

/// Whether the 95 % interval of each amplitude of a law, as the fit has it, holds none; of a formula, of each of its numbers.
fn does_nothing(fit: &Fit, name: &str) -> bool {
    let formula = fit.scenes.iter().find_map(|s| s.model.effect(name)?.formula.as_ref());
    let written = formula.into_iter().flat_map(|f| &f.parameters).map(|p| p.name.as_str());
    let amplitudes = effect(name).into_iter().flat_map(|e| &e.spec.params[..e.amplitudes]).map(|p| p.name);
    let of: Vec<_> = amplitudes.chain(written).flat_map(|p| estimates_of(fit, name, p)).collect();
    !of.is_empty() && of.iter().all(|e| may_be_none(e.value, e.sd))
}

/// Users' laws as candidates beside those of the library; `unit` is what remains after the best of all.
pub fn rank_formulas(
    lens: &WeakFormRegression,
    models: &[Model],
    formulas: &[(String, Formula)],
    unit: f64,
) -> Vec<RankedEffect> {
    let base = fit_forces(lens, models);
    let degrees = lens.degrees_of_freedom().max(1) as f64;
    let one = |(name, formula): &(String, Formula)| {
        let (with, free, seen) = fit_written(lens, models, name, formula);
        let left_out = lens.left_out(&with, &free, &seen.values);
        // A law without a number of its own has a price too.
        let added = (free.len() - base.0.len().min(free.len())).max(1);
        let score = (base.1.cost - seen.cost) / unit - added as f64 * elementary::ln(degrees);
        let held_out_rmse = pooled_noise(lens) * (left_out / degrees).max(0.0).sqrt();
        RankedEffect::of_free_motion(FORMULA, name, 0.5 * score, held_out_rmse)
    };
    formulas.iter().map(one).collect()
}

/// Chi-square and degrees of freedom of scenes.
fn chi_square(fits: &[&SceneFit]) -> (f64, f64) {
    fits.iter().fold((0.0, 0.0), |(c, n), f| {
        let degrees = f.degrees_of_freedom as f64;
        (c + f.reduced_chi_square * degrees, n + degrees)
    })
}

/// Evidence of a revision against the fits that it came from, and whether it is better. A scene that both lose says nothing, if
/// there are others: by how much is a matter of chaos.
pub fn weigh(before: &[&SceneFit], unseen: PredictionErrors, after: &Revision) -> ChangeEvidence {
    let log_evidence = log_evidence(before, &after.fit.scenes.iter().collect::<Vec<_>>());
    let now = after.unseen();
    let grew = |old: f64, new: f64| new > old * (1.0 + ALIKE);
    // Of one video there is no other that could be left out.
    let several = after.fit.scenes.len() > 1;
    let fails = grew(unseen.held_out_rmse, now.held_out_rmse)
        || (several && grew(unseen.left_out_rmse, now.left_out_rmse));
    let worth = match () {
        () if log_evidence > CERTAIN && !fails => ChangeVerdict::Better,
        () if log_evidence < -CERTAIN => ChangeVerdict::Worse,
        () if log_evidence < 0.0 && fails => ChangeVerdict::Worse,
        () => ChangeVerdict::NoDifference,
    };
    ChangeEvidence { log_evidence, worth }
}

/// Log evidence ratio of fits to others of the same scenes, by BIC (nats).
pub fn log_evidence(before: &[&SceneFit], after: &[&SceneFit]) -> f64 {
    let pairs: Vec<(&SceneFit, &SceneFit)> = before.iter().copied().zip(after.iter().copied()).collect();
    let told: Vec<_> = pairs.iter().copied().filter(|(b, a)| !(lost(b) && lost(a))).collect();
    let (judged, judged_after): (Vec<_>, Vec<_>) =
        if told.is_empty() { pairs } else { told }.into_iter().unzip();
    let (chi_before, degrees) = chi_square(&judged);
    let (chi_after, degrees_after) = chi_square(&judged_after);
    let unit = (chi_before / degrees.max(1.0)).min(chi_after / degrees_after.max(1.0)).max(1.0);
    let count = |fits: &mut dyn Iterator<Item = &SceneFit>| parameters(fits.map(|f| &f.model)) as f64;
    let more = count(&mut after.iter().copied()) - count(&mut before.iter().copied());
    0.5 * ((chi_before - chi_after) / unit - more * elementary::ln(degrees.max(2.0)))
}

/// Numbers of the effects that a fit of all models together finds: a shared one counts once.
fn parameters<'m>(models: impl Iterator<Item = &'m Model>) -> usize {
    let mut names = BTreeSet::new();
    for (scene, model) in models.enumerate() {
        for active in model.effects.iter().filter(|e| e.on) {
            for p in active.parameters.iter().filter(|p| p.prior.sd > 0.0) {
                let shared = active.shares(p);
                let place = if shared { usize::MAX } else { scene };
                names.extend(p.labels.iter().map(|label| (place, p.full_name(active, label))));
            }
        }
    }
    names.len()
}

impl Revision {
    pub fn unseen(&self) -> PredictionErrors {
        PredictionErrors { held_out_rmse: self.held_out_rmse, left_out_rmse: self.left_out_rmse }
    }
}

/// The effect of a revision with its parameters as the fit has them; the intervals hold how far the videos disagree, too.
pub fn found(
    lens: &WeakFormRegression,
    revision: &Revision,
    name: &str,
    options: &FitOptions,
    stop: Stop,
) -> Result<FoundEffect, FitError> {
    let fit = &revision.fit;
    let entry = named(name).find(|e| e.spec.name == name);
    if let Some(entry) = entry.filter(|entry| entry.of_objects()) {
        return Ok(FoundEffect::of(entry, by_object(fit, entry)));
    }
    let formula = fit.scenes.iter().find_map(|s| s.model.effect(name)?.formula.as_ref());
    let own = formula.map_or(&[][..], |f| &f.parameters);
    let (names, defaults): (Vec<&str>, Vec<f64>) = match entry {
        Some(entry) => entry.spec.params.iter().map(|p| (p.name, p.default)).unzip(),
        None => own.iter().map(|p| (p.name.as_str(), p.default)).unzip(),
    };
    let numbers = LawParameters { law: name, names };
    let videos = of_videos(lens, revision, &numbers, options, stop)?;
    let told = |(k, default): (usize, &f64)| {
        // Where it differs by label the largest is told, and where it was not fitted its value.
        let of = estimates_of(fit, name, numbers.names[k]);
        let scatter = videos.as_ref().and_then(|v| v[k]).filter(|_| of.len() == 1).map_or(0.0, |s| s.scatter);
        let largest = of.into_iter().max_by(|a, b| a.value.abs().total_cmp(&b.value.abs()));
        let fixed = || (value(fit, name, numbers.names[k]).unwrap_or(*default), 0.0);
        largest.map_or_else(fixed, |e| (e.value, e.sd.max(scatter)))
    };
    let told: Vec<(f64, f64)> = defaults.iter().enumerate().map(told).collect();
    let sd = plausible(lens, fit, name, &numbers.names, &told);
    let values: Vec<f64> = told.iter().map(|t| t.0).collect();
    if let Some(entry) = entry {
        return Ok(FoundEffect::with_numbers(entry, &values, &sd));
    }
    let one = |((p, at), sd): ((&FormulaParameter, &f64), &f64)| {
        let number = |z: f64| ParameterValue::Number((at + z * NINETY_FIVE * sd).max(p.min).min(p.max));
        let (value, low, high) = (number(0.0), number(-1.0), number(1.0));
        let (name, unit) = (p.name.clone(), p.unit.clone());
        ParameterEstimate { name, unit, value, low, high, sd: vec![*sd], owner: None }
    };
    let parameters = own.iter().zip(&values).zip(&sd).map(one).collect();
    let text = formula.map(|f| f.text.clone());
    let uncertain = !own.is_empty() && values.iter().zip(&sd).all(|(value, sd)| may_be_none(*value, *sd));
    let deviations = own.iter().map(|p| p.name.clone()).zip(sd).collect();
    let (kind, effect) = (FORMULA.into(), name.into());
    Ok(FoundEffect { kind, effect, parameters, text, deviations, uncertain })
}

/// A number of a law as the first of a fit's scenes has it.
fn value(fit: &Fit, effect: &str, parameter: &str) -> Option<f64> {
    let active = fit.scenes.first()?.model.effect(effect)?;
    active.parameters.iter().find(|p| p.name == parameter)?.values.first().copied()
}

#[cfg(test)]
mod tests {
    use super::super::discover;
    use super::super::discovery::diagnose;
    use super::super::tests::{CUBE, DISC, film, heavier_than_believed, models};
    use super::*;
    use crate::discover::{DiscoverOptions, ParameterOwner, Verdict};
    use crate::fit::fit;
    use crate::num::never;

    fn added(scenes: &[Scene], name: &str) -> ChangeResult {
        let (base, options) = (models(scenes), DiscoverOptions::default().fit);
        change(scenes, &Origin::Start(&base), &ModelChange::Add(name.into()), &options, &never)
            .expect("it runs")
    }

    #[test]
    fn a_mass_is_told_with_its_object_and_is_none_below_zero() {
        let scenes = heavier_than_believed();
        let made = added(&scenes, "mass_change");
        assert_eq!(made.weight.worth, ChangeVerdict::Better, "{:?}", made.weight);
        let told = made.added.expect("it was added").parameters;
        let [factor] = &told[..] else { panic!("{told:?}") };
        assert_eq!(factor.owner, Some(ParameterOwner { object: 1, scene: None, identified: true }));
        let ParameterValue::Number(v) = factor.value else { panic!("{factor:?}") };
        assert!((v - 2.0).abs() < 0.15, "{factor:?}");
        // Of objects that never meet nothing is known; what is said of one is what a mass can be.
        let apart =
            film(&[vec![(DISC, 0.6, [-1.0, 0.0], [1.0, 0.0]), (DISC, 0.6, [0.0, 2.0], [1.0, 0.0])]], None);
        let told = added(&apart, "mass_change").added.expect("it was added").parameters;
        let [factor] = &told[..] else { panic!("{told:?}") };
        assert!(factor.owner.is_some_and(|o| !o.identified), "{factor:?}");
        let ParameterValue::Number(low) = factor.low else { panic!("{factor:?}") };
        assert!(low > 0.0, "{factor:?}");
    }

    #[test]
    fn a_law_whose_amplitude_may_be_none_is_no_better() {
        let launch = |v: f64| vec![(DISC, 0.6, [-1.5, 0.0], [v, 0.2]), (CUBE, 0.8, [1.0, 1.5], [-0.5, 0.3])];
        let drag = |law| {
            let made = added(&film(&[launch(1.0), launch(1.6)], law), "linear_drag");
            (does_nothing(&made.after.fit, "linear_drag"), made.weight.worth)
        };
        let (none, worth) = drag(None);
        assert!(none && worth != ChangeVerdict::Better, "{worth:?}");
        assert_eq!(drag(Some(("linear_drag", &[("c", 0.3)]))), (false, ChangeVerdict::Better));
    }

    /// The lens, which does not know how balls spin, leads astray from where these are followed.
    #[test]
    fn with_one_law_more_a_revision_is_no_farther() {
        let scene = |k: usize| {
            let path = format!("tests/data/billiards/rolling/scene_0{k}/observed.json");
            let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
            let text = std::fs::read_to_string(path).expect("it is there");
            crate::scene::parse(&k.to_string(), &text).expect("it is one")
        };
        let scenes = [0, 1, 2, 3].map(scene);
        let first = added(&scenes, "coriolis").before.expect("it was fitted");
        let fits: Vec<&SceneFit> = first.fit.scenes.iter().collect();
        let (origin, options) = (Origin::Revision(&fits, first.unseen()), DiscoverOptions::default().fit);
        let made = change(&scenes, &origin, &ModelChange::Add("coriolis".into()), &options, &never);
        let after = made.expect("it runs").after.reduced_chi_square;
        assert!(after < 1.01 * first.reduced_chi_square, "{} {after}", first.reduced_chi_square);
    }

    #[test]
    fn where_too_little_moves_all_say_so_and_what_to_film() {
        let two = vec![(DISC, 1.0, [0.0, 0.0], [1.0, 0.0]), (CUBE, 1.0, [0.0, 2.0], [0.5, 0.0])];
        let mut scenes = film(&[two], None);
        scenes[0].times.truncate(2);
        scenes[0].tracks.iter_mut().for_each(|t| t.samples.truncate(2));
        let (base, options) = (models(&scenes), DiscoverOptions::default());
        let found = discover(&scenes, &base, &options, &never).expect("it runs");
        assert_eq!(found.verdict, Verdict::NotIdentifiable);
        let made = added(&scenes, "tilt");
        assert_eq!(
            (made.weight.worth, made.too_little),
            (ChangeVerdict::NotIdentifiable, Some(found.reason.clone()))
        );
        let fitted = fit(&scenes, &base, &options.fit, &never).expect("it fits");
        let told = diagnose(&scenes, &fitted, &[], &options, &never).expect("it runs");
        assert_eq!((told.too_little, told.ranked), (Some(found.reason), vec![]));
    }
}
