//! Laws that leave no small trace in a lens, or too few of them: each is tried whole, and trajectories alone judge it.

use super::contact::ContactCandidate;
use super::contact_law::{estimates_of, pooled, with_contact};
use super::hidden_geometry::{HiddenPlace, discs_between, rectangle, walls};
use super::intervals::FOLLOWED;
use super::jackknife::{LawParameters, numbers_of};
use super::negligible::{frame, is_slight, longest_contact};
use super::outcome::{Discovery, FoundEffect, RankedEffect, Verdict};
use super::proof::{self, alike_kinds};
use super::restitution_decay::decays;
use super::revise::{
    Revision, TRIED_BUDGET_FRACTION, chi_squares, pooled_noise, revise, revise_from, sum, trajectories,
    trajectories_from, without_effect,
};
use super::screen::region;
use super::unexplained_impacts::unexplained_impacts;
use super::weak_form::WeakFormRegression;
use super::window_fits::{films_stick, meet};
use super::windows::contacts;
use crate::effects::{
    EFFECTS, EffectEntry, Hook, ObstacleForm, ParamId, ParamSpec, Region, SearchStart, effect, effect_with,
};
use crate::fit::{Estimate, Fit, FitError, FitOptions, SceneFit, StartPoint, estimate, estimate_each};
use crate::num::{Stop, elementary, quantile};
use crate::scene::Scene;
use crate::world::{Model, PRESETS};
use rayon::prelude::*;
use std::f64::consts::LN_2;

/// How many times less the chi-square of a law that acts fully or not at all must be.
const STICKING_PROOF: f64 = 9.0;
/// Reduced chi-square of a scene from which fading restitution is asked for beside a law of force: a force that is not quite the
/// right one looks like it.
const MISSED: f64 = 1.15;
/// Share of the restitution that it takes at a usual speed, at least: less is what any engine's contacts do.
const FADES: f64 = 0.15;
/// A fall of the distance from which a law is worth a search of its own (twice a log likelihood).
const PROMISING: f64 = 10.0;
/// The same from which it need not foretell later frames.
const BEYOND_DOUBT: f64 = 160.0;
/// How many deviations the number of a law that is tried whole must be from none, and the iterations of one trial.
const WHOLE_CERTAIN: f64 = 5.0;
const TRIED_ITERATIONS: usize = 30;
/// Objects whose masses are tried, and walls and discs.
const HEAVIEST: usize = 2;
const PLACES: usize = 2;
/// How many times less the chi-square must be with spins of the balls' own.
const SPINNING_PROOF: f64 = 2.0;

/// The revision with a law that short films speak for but do not prove, if it follows trajectories that are lost without, and
/// still are where it led. One of them will do where a film speaks clearly, or where all have their numbers in common since. Where
/// none is lost but half of them are off, the law must explain most of that, and all of it in half of them.
pub fn recovers(
    lens: &WeakFormRegression,
    base: &Revision,
    law: &ContactCandidate,
    models: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<Revision>, FitError> {
    let loses = proof::loses(&base.fit);
    if !loses && !proof::astray(&base.fit) {
        return Ok(None);
    }
    let (name, lost) = (law.entry.spec.name, &base.fit.scenes);
    let found = revise(lens, models, Some(name), options, stop)?;
    let one_will_do = law.strong() || gathers(base, &found);
    let mends = |found: &[SceneFit]| match loses {
        true => proof::mends(lost, found) || (one_will_do && proof::finds(lost, found)),
        false => proof::explains(lost, found),
    };
    if !mends(&found.fit.scenes) || !proof::is_supported(base, &found, law.added) {
        return Ok(None);
    }
    let without = without_effect(&found.fit, name);
    let without = estimate_each(
        lens.scenes,
        &without,
        &FitOptions { start_point: StartPoint::NearOptimum, ..*options },
        stop,
    )?;
    let without: Vec<SceneFit> = without.into_iter().flat_map(|f| f.scenes).collect();
    Ok((!mends(&without)).then_some(found))
}

/// One law tried whole, from these values of its parameters.
#[derive(Clone)]
struct LawTrial {
    entry: &'static EffectEntry,
    start: Vec<f64>,
    object: Option<u32>,
}

/// The law that trajectories need though no short film tells of it: restitution that falls with speed, where pairs that
/// rebound differently explain each film as well; friction between objects, contacts that take time, a scale, the mass of one, or
/// a thing that nobody saw, where others were near whenever it showed. Also gives the kinds that are as near.
pub fn asked(
    lens: &WeakFormRegression,
    base: &Revision,
    models: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<(ContactCandidate, Revision, Vec<String>)>, FitError> {
    let region = region(lens.scenes);
    let with = |t: &LawTrial| with_contact(models, t.entry, &t.start, t.object, &region);
    let most = options.max_iterations.min(TRIED_ITERATIONS);
    let few = FitOptions { max_iterations: most, budget_fraction: TRIED_BUDGET_FRACTION, ..*options };
    let (mut trials, mut near) = (vec![], vec![]);
    if let Some(starts) = fading(lens, base, models) {
        let with_law = starts.clone().map(|t| with(&t));
        if base.effect.is_some() && !proof::loses(&base.fit) {
            // A search of each video by itself would find nothing else.
            let of = |(start, models): (LawTrial, &Vec<Model>)| {
                Ok(from_there(lens, base, models, &few, stop)?.map(|fit| (start, fit)))
            };
            let tried: Result<Vec<_>, FitError> = starts.into_par_iter().zip(&with_law).map(of).collect();
            near.extend(tried?.into_iter().flatten());
        } else if promises(lens, base, starts[0].entry, &with_law, &few, stop)? {
            trials.extend(starts);
        }
    }
    // Beside a law of force chaos may lose one video; what is an object's own, or stands somewhere, shows in more. Without any,
    // half of them off their noise are too many, too.
    let lost = proof::losses(&base.fit) > usize::from(base.effect.is_some());
    if lost || (base.effect.is_none() && proof::astray(&base.fit)) {
        trials.extend(of_some_size(models, &region));
        trials.extend(softened(lens, models));
        trials.extend(heavier(lens, base, models, &few, stop)?);
        trials.extend(unseen(lens, models));
    }
    let tried: Result<Vec<(LawTrial, Fit)>, FitError> = trials
        .into_par_iter()
        .map(|t| {
            let begun = begun(&base.fit);
            let (fit, _) = trajectories_from(lens, &with(&t), &begun, Some(t.entry.spec.name), &few, stop)?;
            Ok((t, fit))
        })
        .collect();
    near.extend(tried?);
    let nearest = near.iter().min_by(|a, b| proof::deviance(&a.1).total_cmp(&proof::deviance(&b.1)));
    // Less of a fading restitution than contacts differ by anyway is none.
    let fades = |t: &LawTrial, fit: &Fit| {
        let faded =
            |usual: f64| numbers(fit, t).first().is_some_and(|n| 1.0 - elementary::exp(-n.0 * usual) > FADES);
        !decays(t.entry) || usual_speed(base).is_some_and(faded)
    };
    let mends = |(t, fit): &&(LawTrial, Fit)| proof::nearer(&base.fit, fit) && fades(t, fit);
    let Some((best, fit)) = nearest.filter(mends) else { return Ok(None) };
    let priced = |(t, fit): &(LawTrial, Fit)| (t.start.len(), t.entry.kind, proof::deviance(fit));
    let alike = alike_kinds(&near.iter().map(priced).collect::<Vec<_>>(), fit);
    let start = numbers(fit, best).into_iter().map(|n| n.0).collect();
    let (with_law, name) = (with(&LawTrial { start, ..best.clone() }), Some(best.entry.spec.name));
    let found = revise_from(lens, &with_law, &begun(fit), name, options, stop)?;
    let (values, sd): (Vec<f64>, Vec<f64>) = numbers(&found.fit, best).into_iter().unzip();
    let gained = proof::gained(&base.fit, &found.fit);
    // What an object is may show in the one video in which it meets others; what contacts share may show a little in each.
    let often = gained >= found.fit.scenes.len().min(2)
        || (best.object.is_some() && proof::finds(&base.fit.scenes, &found.fit.scenes))
        || (decays(best.entry) && shows_in_other_scenes(base, &found));
    let LawParameters { law, names } = numbers_of(best.entry);
    let added = names.iter().map(|name| estimates_of(&found.fit, law, name).len()).sum();
    // One late contact that goes another way makes all later frames worse.
    let beyond_doubt = proof::deviance(&found.fit) < proof::deviance(&base.fit) - BEYOND_DOUBT;
    // Whether a thing is there is no parameter.
    let certain = best.entry.uses(Hook::Bodies) || (sd[0] > 0.0 && values[0].abs() > WHOLE_CERTAIN * sd[0]);
    if !certain
        || is_slight(best.entry, &values, lens.scenes, models)
        || !fades(best, &found.fit)
        || (decays(best.entry) && !gathers(base, &found) && !proof::lessens(&base.fit, &found.fit))
        || proof::loses_most(&found.fit)
        || !often
        || (found.held_out_rmse > base.held_out_rmse && !beyond_doubt)
        || !proof::is_supported(base, &found, added)
    {
        return Ok(None);
    }
    // A search that escaped a bad minimum is no discovery.
    let without = without_effect(&found.fit, best.entry.spec.name);
    let from_there = FitOptions { start_point: StartPoint::NearOptimum, ..*options };
    let (without, _) = trajectories(lens, &without, None, &from_there, stop)?;
    if !proof::nearer(&without, &found.fit) {
        return Ok(None);
    }
    let law = ContactCandidate {
        entry: best.entry,
        values,
        sd,
        object: best.object,
        added,
        score: 0.0,
        before: sum(&chi_squares(&base.fit)),
        after: sum(&chi_squares(&found.fit)),
        remains: found.reduced_chi_square,
        gained,
    };
    Ok(Some((law, found, alike)))
}

/// Where a fit follows the scenes: what is tried next begins there.
fn begun(fit: &Fit) -> Vec<Option<&Model>> {
    fit.scenes.iter().map(|s| (!proof::lost(s)).then_some(&s.model)).collect()
}

/// Each parameter of a law as a fit with it has it, with its deviation; none of what is no parameter there.
fn numbers(fit: &Fit, trial: &LawTrial) -> Vec<(f64, f64)> {
    let of = |(p, &start): (&ParamSpec, &f64)| {
        pooled(&estimates_of(fit, trial.entry.spec.name, p.name)).unwrap_or((start, 0.0))
    };
    trial.entry.spec.params.iter().zip(&trial.start).map(of).collect()
}

/// Effects that the models lack and that a search starts in a certain way.
fn absent(
    models: &[Model],
    start: impl Fn(SearchStart) -> bool,
) -> impl Iterator<Item = &'static EffectEntry> {
    let lacking = move |e: &&'static EffectEntry| models.iter().all(|m| m.effect(e.spec.name).is_none());
    EFFECTS.iter().filter(move |e| e.profile.start.is_some_and(&start)).filter(lacking)
}

/// Restitution that fades, where objects meet: from none, and from half at a usual speed, as contacts change in between.
fn fading(lens: &WeakFormRegression, base: &Revision, models: &[Model]) -> Option<[LawTrial; 2]> {
    let missed = base.fit.scenes.iter().filter(|s| s.reduced_chi_square > MISSED).count();
    let some = base.effect.is_none() || missed > 1;
    let entry = absent(models, |s| s == SearchStart::RestitutionDecay).next().filter(|_| some)?;
    let met = lens.scenes.iter().zip(&base.fit.scenes).any(|(s, fitted)| meet(&fitted.model, &s.times));
    let usual = usual_speed(base).filter(|_| met)?;
    Some([0.0, LN_2 / usual].map(|start| LawTrial { entry, start: vec![start], object: None }))
}

/// Whether a law is no matter of one video: the others are nearer with it too, or have numbers in common that they had not.
fn shows_in_other_scenes(base: &Revision, found: &Revision) -> bool {
    let nearer = gathers(base, found) || proof::fall_without_best_scene(&base.fit, &found.fit) > PROMISING;
    nearer && found.held_out_rmse < base.held_out_rmse
}

/// Whether all scenes have numbers in common that they had not.
fn gathers(base: &Revision, found: &Revision) -> bool {
    !base.unpooled.is_empty() && found.unpooled.is_empty()
}

/// Whether a ball rolls, which shows whether rolling causes slip at contacts.
pub fn balls_roll(models: &[Model]) -> bool {
    models.iter().flat_map(|m| &m.bodies).any(|b| b.shape.is_ball() && b.start.rolling)
}

/// Laws that are tried with an amplitude of a usual size: from none, where contacts change at once, no search leads to them.
fn of_some_size(models: &[Model], region: &Region) -> Vec<LawTrial> {
    let choices = if balls_roll(models) { usize::MAX } else { 1 };
    let trials = |entry: &'static EffectEntry| -> Vec<LawTrial> {
        let Some(SearchStart::Amplitudes(amplitudes)) = entry.profile.start else { return vec![] };
        let seeds: Vec<Vec<f64>> = entry.seeds(region).into_iter().take(choices).collect();
        let start = |amplitude: f64, seed: &Vec<f64>| [&[amplitude], &seed[1..]].concat();
        let of = |seed| amplitudes.iter().map(move |&amplitude| start(amplitude, seed));
        seeds.iter().flat_map(of).map(|start| LawTrial { entry, start, object: None }).collect()
    };
    absent(models, |s| matches!(s, SearchStart::Amplitudes(_))).flat_map(trials).collect()
}

/// Contacts that take a few frames: the first parameter makes them longer, the others are none.
fn softened(lens: &WeakFormRegression, models: &[Model]) -> Option<LawTrial> {
    let entry = absent(models, |s| matches!(s, SearchStart::ContactFrames(_))).next()?;
    let Some(SearchStart::ContactFrames(frames)) = entry.profile.start else { return None };
    let mut start = vec![0.0; entry.spec.params.len()];
    start[0] = 1.0;
    start[0] = frames * frame(lens.scenes) / longest_contact(entry, &start, models);
    start[0].is_finite().then_some(LawTrial { entry, start, object: None })
}

/// Whether a law brings the scenes nearer, begun from none or from much of it. Where no force acts it may take a search: what
/// stands in for the law has led to other contacts.
fn promises(
    lens: &WeakFormRegression,
    base: &Revision,
    law: &EffectEntry,
    [none, much]: &[Vec<Model>; 2],
    options: &FitOptions,
    stop: Stop,
) -> Result<bool, FitError> {
    if from_there(lens, base, none, options, stop)?.is_some() {
        return Ok(true);
    }
    if base.effect.is_some() {
        return Ok(false);
    }
    let (found, _) = trajectories_from(lens, much, &begun(&base.fit), Some(law.spec.name), options, stop)?;
    Ok(proof::deviance(&found) < proof::deviance(&base.fit) - PROMISING)
}

/// The fit with a law from where the scenes are that are followed with common numbers, if these are nearer: if they are fewer
/// than two, there is nothing to bring nearer.
fn from_there(
    lens: &WeakFormRegression,
    base: &Revision,
    models: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<Fit>, FitError> {
    let common = |k: &usize| !base.unpooled.contains(&base.fit.scenes[*k].name);
    let kept: Vec<usize> = (0..models.len()).filter(common).collect();
    if kept.len() < 2 {
        return Ok(None);
    }
    let scenes: Vec<Scene> = kept.iter().map(|&k| lens.scenes[k].clone()).collect();
    let known: Vec<Model> = kept.iter().map(|&k| base.fit.scenes[k].model.clone()).collect();
    let mut near: Vec<Model> = kept.iter().map(|&k| models[k].clone()).collect();
    for (model, fitted) in near.iter_mut().zip(&known) {
        model.copy_shared_from(fitted);
        model.copy_state_from(fitted);
    }
    let options = FitOptions { start_point: StartPoint::NearOptimum, ..*options };
    let found = estimate(&scenes, &near, &options, stop)?;
    let known = estimate(&scenes, &known, &FitOptions { max_iterations: 0, ..options }, stop)?;
    if proof::deviance(&found) >= proof::deviance(&known) - PROMISING {
        return Ok(None);
    }
    let mut all = Fit { scenes: base.fit.scenes.clone(), ..found };
    kept.into_iter().zip(found.scenes).for_each(|(k, scene)| all.scenes[k] = scene);
    Ok(Some(all))
}

/// The median speed with which objects begin (m/s).
fn usual_speed(base: &Revision) -> Option<f64> {
    let begun = base.fit.scenes.iter().flat_map(|s| &s.model.bodies);
    let mut speeds: Vec<f64> = begun.map(|b| b.start.state.velocity.norm()).filter(|v| *v > 0.0).collect();
    quantile(&mut speeds, 0.5)
}

/// The masses that differ most from the others when all are free.
fn heavier(
    lens: &WeakFormRegression,
    base: &Revision,
    models: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Vec<LawTrial>, FitError> {
    let Some(entry) = absent(models, |s| s == SearchStart::RatioToMedian).next() else { return Ok(vec![]) };
    let all = with_contact(models, entry, &[0.0], None, &region(lens.scenes));
    let (found, _) = trajectories_from(lens, &all, &begun(&base.fit), Some(entry.spec.name), options, stop)?;
    let id = |e: &Estimate| ParamId::parse(&e.name)?.object();
    let masses = estimates_of(&found, entry.spec.name, entry.spec.params[0].name);
    let mut masses: Vec<(f64, u32)> =
        masses.into_iter().filter_map(|e| Some((1.0 + e.value, id(e)?))).collect();
    masses.sort_by(|a, b| a.0.total_cmp(&b.0));
    // Only ratios of masses show: each against the median.
    let Some(median) = masses.get(masses.len() / 2).map(|m| m.0) else { return Ok(vec![]) };
    let off = |mass: f64| elementary::ln(mass / median).abs();
    masses.sort_by(|a, b| off(b.0).total_cmp(&off(a.0)));
    let trial =
        |(mass, id): (f64, u32)| LawTrial { entry, start: vec![mass / median - 1.0], object: Some(id) };
    Ok(masses.into_iter().take(HEAVIEST).map(trial).collect())
}

/// Walls and discs that explain more than one blow that nothing in sight dealt.
fn unseen(lens: &WeakFormRegression, models: &[Model]) -> Vec<LawTrial> {
    let jumps = unexplained_impacts(lens, models);
    let trials = |form: ObstacleForm, places: Vec<HiddenPlace>| -> Vec<LawTrial> {
        let Some(entry) = absent(models, |s| s == SearchStart::BehindImpacts(form)).next() else {
            return vec![];
        };
        let told = places.into_iter().filter(|p| p.agree > 1).take(PLACES);
        told.map(|p| LawTrial { entry, start: p.values, object: None }).collect()
    };
    let mut all = trials(ObstacleForm::Wall, walls(&jumps, models));
    all.extend(trials(ObstacleForm::Disc, discs_between(&jumps, models)));
    let around = rectangle(&jumps, models, &region(lens.scenes));
    all.extend(trials(ObstacleForm::Rectangle, around.into_iter().collect()));
    all
}

/// The revision in which objects stick on contact, if short films are nearer to that. Sticking leaves no small trace that a
/// score could follow, so it is tried whole.
pub fn sticking(
    lens: &WeakFormRegression,
    models: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<Revision>, FitError> {
    let Some(entry) = effect_with(|e| e.all_or_nothing().is_some()) else { return Ok(None) };
    let region = region(lens.scenes);
    let films = contacts(lens, models);
    if !films_stick(&films, &stuck(&films.models, entry, &region), stop)? {
        return Ok(None);
    }
    revise(lens, &stuck(models, entry, &region), Some(entry.spec.name), options, stop).map(Some)
}

/// Whether that is what the trajectories need.
pub fn sticks(base: &Revision, stuck: &Revision) -> bool {
    stuck.reduced_chi_square * STICKING_PROOF < base.reduced_chi_square
        && stuck.held_out_rmse < base.held_out_rmse
}

/// What is found where balls between cushions turn about axes of their own: a ball's spin is of its state, which the
/// lenses do not see (they would make forces of it), so that it is tried whole, and by trajectories alone.
pub fn spinning(
    lens: &WeakFormRegression,
    models: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<Discovery>, FitError> {
    let Some((preset, spin)) = PRESETS.iter().find_map(|p| Some((p, p.finds.as_ref()?))) else {
        return Ok(None);
    };
    let Some(entry) = effect(spin.effect) else { return Ok(None) };
    let plain =
        |m: &Model| !m.walls.is_empty() && m.spin_sd == 0.0 && m.bodies.iter().all(|b| b.shape.is_ball());
    if !models.iter().all(plain) {
        return Ok(None);
    }
    let base = revise(lens, models, None, options, stop)?;
    if base.reduced_chi_square < FOLLOWED {
        return Ok(None);
    }
    let spun: Vec<Model> = lens.scenes.iter().map(|s| preset.model(s)).collect();
    let mut revision = revise(lens, &spun, None, options, stop)?;
    if revision.reduced_chi_square * SPINNING_PROOF > base.reduced_chi_square
        || revision.held_out_rmse > base.held_out_rmse
    {
        return Ok(None);
    }
    revision.effect = Some(entry.spec.name.into());
    // The same numbers by the names that the preset's effects have.
    let number = |(effect, parameter): &(&str, &str)| {
        let name = ParamId { effect, parameter, label: "" }.to_string();
        let known = revision.fit.posterior.estimates.iter().find(|e| e.name == name);
        known.map_or((0.0, 0.0), |e| (e.value, e.sd))
    };
    let (values, sd): (Vec<f64>, Vec<f64>) = spin.parameters.iter().map(number).unzip();
    let found = FoundEffect::with_numbers(entry, &values, &sd);
    Ok(Some(Discovery {
        verdict: Verdict::EffectFound,
        ranked: vec![RankedEffect::of_trajectories(&found.kind, &found.effect, &revision)],
        effects: vec![found],
        ambiguous: vec![],
        experiment: None,
        formula: None,
        smallest: vec![],
        noise_sigma: pooled_noise(lens),
        reason: format!(
            "the balls have spins of their own: with them, reduced chi-square falls from {:.1} to {:.1}",
            base.reduced_chi_square, revision.reduced_chi_square
        ),
        revisions: vec![base, revision],
    }))
}

/// The models in which objects stick for good, which is no parameter.
pub fn stuck(models: &[Model], entry: &EffectEntry, region: &Region) -> Vec<Model> {
    let mut models = with_contact(models, entry, entry.all_or_nothing().unwrap_or_default(), None, region);
    for active in models.iter_mut().flat_map(|m| &mut m.effects).filter(|e| e.name == entry.spec.name) {
        active.parameters.iter_mut().for_each(|p| p.prior.sd = 0.0);
    }
    models
}

#[cfg(test)]
mod tests {
    use super::super::screen::with_nuisance;
    use super::super::tests::{DISC, film, models};
    use super::super::verdict::DiscoverOptions;
    use super::*;
    use crate::num::never;

    /// Late contacts leave few frames to each video: its own noise hides what all of them say together.
    #[test]
    fn what_all_contacts_share_is_asked_for_where_no_video_is_missed() {
        // The second object lies where the first one, which brakes, is after 80 frames; in the first video it has gone.
        let time = 0.04 * 80.0;
        let meeting = |(speed, gone): (f64, f64)| {
            let way = speed * time - 0.147 * time * time;
            vec![(DISC, 0.6, [-0.4 - way, 0.0], [speed, 0.0]), (DISC, 0.6, [0.0, 0.03 + gone], [0.0, 0.0])]
        };
        let launches = [(1.4, 0.97), (1.4, 0.0), (1.9, 0.0), (2.6, 0.0)].map(meeting);
        let options = DiscoverOptions::default().fit;
        let asked = |inverse_v0: f64| {
            let scenes =
                film(&launches, Some(("speed_dependent_restitution", &[("inverse_v0", inverse_v0)])));
            let (lens, models) = (WeakFormRegression::new(&scenes), with_nuisance(&models(&scenes)));
            let base = revise(&lens, &models, None, &options, &never).expect("they can be fitted");
            let off: Vec<f64> = base.fit.scenes.iter().map(|s| s.reduced_chi_square).collect();
            assert!(off.iter().all(|off| *off < MISSED), "{off:?}");
            asked(&lens, &base, &models, &options, &never).expect("nobody stops it")
        };
        let (law, ..) = asked(0.13).expect("contacts fade");
        assert!((law.values[0] - 0.13).abs() < 4.0 * law.sd[0], "{:?} {:?}", law.values, law.sd);
        assert!(asked(0.0).is_none());
    }

    /// Contacts that take five frames leave the video nearly as they would at once, so that no short film is lost.
    #[test]
    fn contacts_that_take_time_are_asked_for_where_videos_are_off_the_noise() {
        let meeting = |speed: f64| {
            let struck = (DISC, 0.6, [0.0, 0.05], [0.0, 0.0]);
            vec![(DISC, 0.6, [-1.0, 0.0], [speed, 0.0]), struck, (DISC, 0.6, [1.2, 0.2], [-speed, 0.0])]
        };
        let launches = [0.9, 1.2, 1.5].map(meeting);
        let options = DiscoverOptions::default().fit;
        let asked = |softness: f64| {
            let scenes = film(&launches, Some(("soft_contact", &[("softness", softness)])));
            let (lens, models) = (WeakFormRegression::new(&scenes), with_nuisance(&models(&scenes)));
            let base = revise(&lens, &models, None, &options, &never).expect("they can be fitted");
            asked(&lens, &base, &models, &options, &never).expect("nobody stops it")
        };
        let (law, ..) = asked(0.12).expect("contacts take .2 s");
        assert_eq!(law.entry.spec.name, "soft_contact");
        assert!((law.values[0] - 0.12).abs() < 4.0 * law.sd[0], "{:?} {:?}", law.values, law.sd);
        assert!(asked(0.0).is_none());
    }
}
