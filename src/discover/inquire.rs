//! The whole loop: is the base right, which law is missing, does the error fall when it is added.

use super::account::ranked;
use super::alone::Alone;
use super::change::rank_formulas;
use super::compare::{Comparison, compare};
use super::conclude::{DiscoverOptions, Reading, conclude};
use super::contact::{ContactCandidate, screen_contacts};
use super::film::contacts;
use super::force::{Lens, fit_forces};
use super::outcome::{Discovery, Ranked, Verdict};
use super::path::Jump;
use super::proof;
use super::revise::{pooled_noise, trajectories};
use super::screen::{region, sought, with_nuisance};
use super::search::{fewer, search, search_on};
use super::whole::{STICKING, spinning, stuck};
use crate::effects::formula::Formula;
use crate::effects::{Hook, effect};
use crate::fit::{Fit, FitError};
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::{Model, Preset};
use serde::{Deserialize, Serialize};

/// Residuals in free motion below which nothing can be said.
const FEWEST: usize = 60;
/// Two readings of the base closer than this in the lens are told apart by their contacts (chi-square).
const SAME: f64 = 20.0;

/// Searches what the models (one a scene, of one set-up) lack. Deterministic, whatever the number of threads.
pub fn discover(
    scenes: &[Scene],
    models: &[Model],
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Discovery, FitError> {
    crate::fit::check(scenes, models)?;
    let lens = Lens::new(scenes);
    if lens.degrees_of_freedom() < FEWEST {
        return Ok(not_identifiable(&lens));
    }
    if options.max_effects > 0
        && let Some(found) = spinning(&lens, models, &options.fit, stop)?
    {
        return Ok(found);
    }
    let mut seen: Vec<Reading> = vec![];
    for models in readings(scenes, models) {
        let models = with_nuisance(&models);
        let motion = search(&lens, &models, stop)?;
        seen.push(Reading { models, motion, contacts: vec![], films: 0.0 });
    }
    keep_best(&mut seen);
    let mut films = vec![];
    for reading in &mut seen {
        let motion = reading.motion.clone();
        reading.motion = search_on(&lens, &reading.models, motion, options.max_effects, stop)?;
        films.push(Alone::of(&contacts(&lens, &reading.motion.models), stop)?);
    }
    let known = |(r, films): (&Reading, &Alone)| (r.motion.priced() + films.cost(), films.at_noise());
    let known: Vec<(f64, bool)> = seen.iter().zip(&films).map(known).collect();
    // Where one reading follows all contacts to the noise, no law of contact makes another the better one.
    let settled = known.iter().filter(|k| k.1).map(|k| k.0).fold(f64::INFINITY, f64::min);
    for ((reading, films), (cost, _)) in seen.iter_mut().zip(&films).zip(known) {
        reading.films = f64::INFINITY;
        if cost < settled + SAME {
            let sought = sought(&reading.motion.models, scenes);
            let (screened, lost) = screen_contacts(films, &region(scenes), &sought, stop)?;
            reading.films =
                lost + screened.iter().find(|c| c.proven()).map_or(films_cost(&screened), |c| c.after);
            reading.contacts = screened;
        }
    }
    keep_best(&mut seen);
    match by_trajectories(&lens, seen, options, stop)? {
        Some(reading) => {
            let found = conclude(&lens, reading, options, stop)?;
            let found = reread(&lens, models, found, options, stop)?;
            unseen(&lens, models, found, options, stop)
        }
        None => Ok(not_identifiable(&lens)),
    }
}

/// Whether the last revision loses a video.
fn loses(found: &Discovery) -> bool {
    found.revisions.last().is_some_and(|r| proof::loses(&r.fit))
}

/// How far the last revision is from what was measured.
fn distance(found: &Discovery) -> f64 {
    found.revisions.last().map_or(f64::INFINITY, |r| proof::distance(&r.fit))
}

/// What is found, or what another reading of the base finds where trajectories with the same laws are nearer in that: a
/// hidden law may make the wrong reading look the better one.
fn reread(
    lens: &Lens,
    models: &[Model],
    found: Discovery,
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Discovery, FitError> {
    let mut best = found;
    for models in readings(lens.scenes, models) {
        let models = with_nuisance(&models);
        let Some(last) = best.revisions.last().filter(|_| loses(&best)) else { break };
        let (known, asked) = (&last.fit.scenes[0].model.preset, &models[0].preset);
        if known == asked {
            continue;
        }
        let mut with_laws = models.clone();
        for (model, fitted) in with_laws.iter_mut().zip(&last.fit.scenes) {
            let laws = best.effects.iter().filter_map(|e| fitted.model.effect(&e.effect));
            model.effects.extend(laws.cloned());
        }
        let law = best.effects.last().and_then(|e| effect(&e.effect));
        let mut tried = vec![(with_laws, law)];
        // What sticks may look like another law of contact.
        if law.is_some_and(|law| law.uses(Hook::Contact) && law.spec.name != STICKING) {
            let sticking = effect(STICKING);
            tried.extend(sticking.map(|law| (stuck(&models, law, &region(lens.scenes)), sticking)));
        }
        let mut nearer = false;
        for (models, law) in tried {
            if nearer {
                break;
            }
            let (fit, _) = trajectories(lens, &models, law.map(|l| l.spec.name), &options.fit, stop)?;
            nearer |= proof::nearer(&last.fit, &fit);
        }
        if !nearer {
            continue;
        }
        let motion = search(lens, &models, stop)?;
        let motion = search_on(lens, &models, motion, options.max_effects, stop)?;
        let films = Alone::of(&contacts(lens, &motion.models), stop)?;
        let sought = sought(&motion.models, lens.scenes);
        let (contacts, _) = screen_contacts(&films, &region(lens.scenes), &sought, stop)?;
        let other = conclude(lens, Reading { models, motion, contacts, films: 0.0 }, options, stop)?;
        if distance(&other) < distance(&best) {
            best = other;
        }
    }
    Ok(best)
}

/// What is found, or something that nobody saw where trajectories follow that better: what it strikes, or keeps at rest, may
/// look like a force or like another reading of the base.
fn unseen(
    lens: &Lens,
    models: &[Model],
    found: Discovery,
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Discovery, FitError> {
    let known = found.effects.iter().any(|e| effect(&e.effect).is_some_and(|e| e.uses(Hook::Bodies)));
    if options.max_effects == 0 || known || !loses(&found) {
        return Ok(found);
    }
    let of_bodies = |models: &[Model]| -> Vec<_> {
        sought(models, lens.scenes).into_iter().filter(|e| e.uses(Hook::Bodies)).collect()
    };
    let mut best = found;
    for models in readings(lens.scenes, models) {
        let models = with_nuisance(&models);
        let motion = search(lens, &models, stop)?;
        let motion = fewer(lens, &models, &motion, motion.found.len(), stop)?;
        let films = Alone::of(&contacts(lens, &models), stop)?;
        let (contacts, _) = screen_contacts(&films, &region(lens.scenes), &of_bodies(&models), stop)?;
        if !contacts.iter().any(ContactCandidate::proven) {
            continue;
        }
        let other = conclude(lens, Reading { models, motion, contacts, films: 0.0 }, options, stop)?;
        if distance(&other) < distance(&best) {
            best = other;
        }
    }
    Ok(best)
}

/// Where a fitted model fails, and which laws would explain it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    pub comparison: Comparison,
    /// Reduced chi-square of the free motion: 1 is noise.
    pub free_motion: f64,
    /// Best first.
    pub ranked: Vec<Ranked>,
    /// Sudden changes of velocity that no other object explains: index of the scene, and what happened.
    pub jumps: Vec<(usize, Jump)>,
}

/// Diagnoses the models of a fit; laws that users write are candidates too, by their names.
pub fn diagnose(
    scenes: &[Scene],
    fit: &Fit,
    formulas: &[(String, Formula)],
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Diagnosis, FitError> {
    let comparison = compare(scenes, fit, &options.fit, stop)?;
    let models: Vec<Model> = fit.scenes.iter().map(|s| s.model.clone()).collect();
    let lens = Lens::new(scenes);
    let begun = with_nuisance(&models);
    let motion = search(&lens, &begun, stop)?;
    let films = Alone::of(&contacts(&lens, &motion.models), stop)?;
    let (of_contacts, _) = screen_contacts(&films, &region(scenes), &sought(&models, scenes), stop)?;
    let mut ranked = ranked(&motion, &of_contacts, &[], pooled_noise(&lens));
    if !formulas.is_empty() {
        let least = motion.ranked.iter().map(|(_, c)| c.chi_square).fold(f64::INFINITY, f64::min);
        let unit = (least / motion.degrees_of_freedom).clamp(1.0, f64::MAX);
        ranked.extend(rank_formulas(&lens, &begun, &fit_forces(&lens, &begun), formulas, unit));
        ranked.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    }
    Ok(Diagnosis {
        comparison,
        free_motion: motion.base.chi_square / motion.degrees_of_freedom,
        ranked,
        jumps: films.films.jumps,
    })
}

/// Drops readings that are worse than the best by more than chance.
fn keep_best(seen: &mut Vec<Reading>) {
    let cost = |r: &Reading| r.motion.priced() + r.films;
    let least = seen.iter().map(cost).fold(f64::INFINITY, f64::min);
    seen.retain(|r| cost(r) < least + SAME);
}

fn films_cost(screened: &[ContactCandidate]) -> f64 {
    screened.first().map_or(0.0, |c| c.before)
}

/// The reading whose trajectories follow the scenes best; a scene that none follows decides little.
fn by_trajectories(
    lens: &Lens,
    mut seen: Vec<Reading>,
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Option<Reading>, FitError> {
    if seen.len() < 2 {
        return Ok(seen.pop());
    }
    let mut best: Option<(f64, Reading)> = None;
    for reading in seen {
        let effect = reading.motion.found.last().map(|c| c.entry.spec.name);
        let (fit, _) = trajectories(lens, &reading.motion.models, effect, &options.fit, stop)?;
        let misfit: f64 = fit.scenes.iter().map(|s| s.reduced_chi_square.ln_1p()).sum();
        if best.as_ref().is_none_or(|(least, _)| misfit < *least) {
            best = Some((misfit, reading));
        }
    }
    Ok(best.map(|(_, reading)| reading))
}

/// The models, and the other reading of the same scenes where the preset has one.
pub fn readings(scenes: &[Scene], models: &[Model]) -> Vec<Vec<Model>> {
    let mut all = vec![models.to_vec()];
    let balls = models.iter().flat_map(|m| &m.bodies).any(|b| b.shape.is_ball());
    let rival = |m: &Model| Preset::named(&m.preset).and_then(|p| p.rival).and_then(Preset::named);
    // A model that the user changed is not read anew.
    let untouched = |(s, m): (&Scene, &Model)| Preset::named(&m.preset).is_some_and(|p| p.model(s) == *m);
    if balls && scenes.iter().zip(models).all(untouched) {
        let other: Option<Vec<Model>> =
            scenes.iter().zip(models).map(|(s, m)| rival(m).map(|p| p.model(s))).collect();
        all.extend(other);
    }
    all
}

fn not_identifiable(lens: &Lens) -> Discovery {
    Discovery {
        verdict: Verdict::NotIdentifiable,
        effects: vec![],
        ranked: vec![],
        ambiguous: vec![],
        experiment: None,
        formula: None,
        smallest: vec![],
        noise_sigma: pooled_noise(lens),
        revisions: vec![],
        reason: format!(
            "only {} free-motion residuals, {FEWEST} are needed: film objects that move, for longer and apart",
            lens.degrees_of_freedom()
        ),
    }
}
