//! Laws that leave no small trace in a lens, or too few of them: each is tried whole, and trajectories alone judge it.

use super::account::FOLLOWED;
use super::alone::films_stick;
use super::contact::{ContactCandidate, HEAVIER, estimates_of, with_contact};
use super::film::contacts;
use super::force::Lens;
use super::outcome::{Discovery, Found, Ranked, Verdict, reported};
use super::proof;
use super::revise::{
    Revision, chi_squares, each_alone, pooled_noise, revise, sum, trajectories, without_effect,
};
use super::screen::region;
use crate::effects::{EffectEntry, Region, effect};
use crate::fit::{Begin, Estimate, FitError, FitOptions, SceneFit};
use crate::num::Stop;
use crate::world::{Model, Preset};

/// The law that is tried whole where trajectories are not followed, and how many times its chi-square must be less.
pub const STICKING: &str = "sticky_contact";
const STICKING_PROOF: f64 = 9.0;
/// The preset in which balls have spins of their own, the effect that it stands for, and the same for it.
const SPINNING: (&str, &str) = ("billiards", "ball_spin");
const SPINNING_PROOF: f64 = 2.0;

/// The revision with a law that few short films speak for, if it follows trajectories that are lost without, and still are
/// where it led.
pub fn mended(
    lens: &Lens,
    base: &Revision,
    law: &EffectEntry,
    added: usize,
    models: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<Revision>, FitError> {
    if !base.fit.scenes.iter().any(proof::lost) {
        return Ok(None);
    }
    let found = revise(lens, models, Some(law.spec.name), options, stop)?;
    if !proof::mends(&base.fit.scenes, &found.fit.scenes) || !proof::borne_out(base, &found, added) {
        return Ok(None);
    }
    let without = without_effect(&found.fit, law.spec.name);
    let without = each_alone(lens.scenes, &without, &FitOptions { begin: Begin::Near, ..*options }, stop)?;
    let without: Vec<SceneFit> = without.into_iter().flat_map(|f| f.scenes).collect();
    Ok((!proof::mends(&base.fit.scenes, &without)).then_some(found))
}

/// The object whose mass follows trajectories that are lost without: where it met others in heaps only, no short film
/// tells. All masses are tried at once, then the one that differs most from the others.
pub fn heavier(
    lens: &Lens,
    base: &Revision,
    models: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<(ContactCandidate, Revision)>, FitError> {
    let lost = base.fit.scenes.iter().filter(|s| proof::lost(s)).count();
    let Some(entry) = effect(HEAVIER).filter(|_| lost > 1) else { return Ok(None) };
    let region = region(lens.scenes);
    let all = with_contact(models, entry, &[0.0], None, &region);
    let (found, _) = trajectories(lens, &all, Some(HEAVIER), options, stop)?;
    if !proof::mends(&base.fit.scenes, &found.scenes) {
        return Ok(None);
    }
    // Only ratios of masses show: each against the median.
    let excess = entry.spec.params[0].name;
    let factor = |e: &Estimate| 1.0 + e.value;
    let mut masses = estimates_of(&found, entry, excess);
    masses.sort_by(|a, b| a.value.total_cmp(&b.value));
    let Some(median) = masses.get(masses.len() / 2).map(|e| factor(e)) else { return Ok(None) };
    let off = |e: &Estimate| (factor(e) / median).ln().abs();
    let farthest = masses.into_iter().max_by(|a, b| off(a).total_cmp(&off(b)));
    let id = |e: &Estimate| e.name.strip_suffix(']')?.rsplit_once('[')?.1.parse().ok();
    let Some((mass, object)) = farthest.and_then(|e| Some((e, id(e)?))) else { return Ok(None) };
    let models = with_contact(models, entry, &[factor(mass) / median - 1.0], Some(object), &region);
    let Some(mended) = mended(lens, base, entry, 1, &models, options, stop)? else { return Ok(None) };
    let [known] = estimates_of(&mended.fit, entry, excess)[..] else { return Ok(None) };
    let law = ContactCandidate {
        entry,
        values: vec![known.value],
        sd: vec![known.sd],
        object: Some(object),
        added: 1,
        score: 0.0,
        before: sum(&chi_squares(&base.fit)),
        after: sum(&chi_squares(&mended.fit)),
        remains: mended.reduced_chi_square,
        gained: lost,
    };
    Ok(Some((law, mended)))
}

/// The revision in which objects stick on contact, if that is what the trajectories need. Sticking leaves no small
/// trace that a score could follow, so it is tried whole.
pub fn sticking(
    lens: &Lens,
    models: &[Model],
    base: &Revision,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<Revision>, FitError> {
    let Some(entry) = effect(STICKING) else { return Ok(None) };
    let region = region(lens.scenes);
    let films = contacts(lens, models);
    if !films_stick(&films, &stuck(&films.models, entry, &region), stop)? {
        return Ok(None);
    }
    let models = stuck(models, entry, &region);
    let revision = revise(lens, &models, Some(STICKING), options, stop)?;
    let proven = revision.reduced_chi_square * STICKING_PROOF < base.reduced_chi_square
        && revision.held_out_rmse < base.held_out_rmse;
    Ok(proven.then_some(revision))
}

/// What is found where balls between cushions turn about axes of their own: a ball's spin is of its state, which the
/// lenses do not see (they would make forces of it), so that it is tried whole, and by trajectories alone.
pub fn spinning(
    lens: &Lens,
    models: &[Model],
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<Discovery>, FitError> {
    let (Some(preset), Some(entry)) = (Preset::named(SPINNING.0), effect(SPINNING.1)) else {
        return Ok(None);
    };
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
    let number = |effect: &str| {
        let name = format!("{effect}.mu");
        let known = revision.fit.posterior.estimates.iter().find(|e| e.name == name);
        known.map_or((0.0, 0.0), |e| (e.value, e.sd))
    };
    let (slide, roll) = (number("sliding_friction"), number("rolling_resistance"));
    let kind = entry.kind.to_string();
    let degrees: usize = revision.fit.scenes.iter().map(|s| s.degrees_of_freedom).sum();
    let gain = 0.5 * degrees as f64 * (base.reduced_chi_square / revision.reduced_chi_square).ln();
    Ok(Some(Discovery {
        verdict: Verdict::EffectFound,
        effects: vec![Found {
            kind: kind.clone(),
            effect: entry.spec.name.into(),
            parameters: reported(entry, &[slide.0, roll.0], &[slide.1, roll.1]),
        }],
        ranked: vec![Ranked {
            kind,
            effect: entry.spec.name.into(),
            log_evidence: gain,
            held_out_rmse: revision.held_out_rmse,
        }],
        ambiguous: vec![],
        experiment: None,
        formula: None,
        smallest: vec![],
        noise_sigma: pooled_noise(lens),
        reason: format!(
            "the balls spin: with spins of their own reduced chi-square falls from {:.1} to {:.1}",
            base.reduced_chi_square, revision.reduced_chi_square
        ),
        revisions: vec![base, revision],
    }))
}

/// The models in which objects stick for good, which is no parameter.
pub fn stuck(models: &[Model], entry: &EffectEntry, region: &Region) -> Vec<Model> {
    let mut models = with_contact(models, entry, &[1.0, 0.0], None, region);
    for active in models.iter_mut().flat_map(|m| &mut m.effects).filter(|e| e.name == entry.spec.name) {
        active.parameters.iter_mut().for_each(|p| p.prior.sd = 0.0);
    }
    models
}
