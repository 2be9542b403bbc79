//! The whole loop: is the base right, which law is missing, does the error fall when it is added.

use super::change::rank_formulas;
use super::checkpoints::Checkpoints;
use super::compare::{Comparison, compare};
use super::contact::{ContactCandidate, screen_contacts};
use super::contact_law::with_contact;
use super::followed::unfollowed;
use super::formula_test;
use super::intervals::ranked;
use super::outcome::{Discovery, RankedEffect, Verdict};
use super::proof;
use super::resample::resampled;
use super::revise::{Revision, TRIED_BUDGET_FRACTION, pooled_noise, trajectories};
use super::screen::{candidates, region, with_nuisance};
use super::search::{FreeMotion, fewer, search, search_on};
use super::smooth_track::ChangePoint;
use super::unseen_pushes::{explains_pushed, name_pushes, with_unseen_pushes};
use super::verdict::{BaseModel, DiscoverOptions, conclude, law_of};
use super::weak_form::WeakFormRegression;
use super::whole_trajectory::{spinning, stuck};
use super::window_fits::WindowFits;
use super::windows::contacts;
use crate::effects::formula::Formula;
use crate::effects::{Hook, effect, effect_with};
use crate::fit::{Fit, FitError, FitOptions};
use crate::num::{Stop, elementary, progress_within};
use crate::scene::{FindingKind, Scene};
use crate::world::{Model, Preset};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Residuals in free motion below which nothing can be said.
const FEWEST: usize = 60;
/// Two readings of the base closer than this in the lens are told apart by their contacts (chi-square).
const SAME: f64 = 20.0;
/// Smoothing rounds off contacts, which then look like another law.
const SMOOTHED: &str = "errors of neighbouring frames are not independent: the positions were smoothed, filtered or \
                        interpolated, which rounds off contacts and looks like another law; give raw positions";
/// Part of the whole that passes over nothing, and most rounds that then pass over what something unseen did: a law that one of them
/// finds may show what the next has to pass over.
const WITHOUT_PUSHES: [f64; 2] = [0.0, 0.6];
const PUSH_ROUNDS: usize = 2;
/// Parts of the whole, as progress tells them: about what they take.
const SPINNING: [f64; 2] = [0.0, 0.05];
const SEARCH: [f64; 2] = [0.05, 0.4];
const FILMS: [f64; 2] = [0.4, 0.5];
const CONTACTS: [f64; 2] = [0.5, 0.55];
const READING: [f64; 2] = [0.55, 0.6];
const TRAJECTORIES: [f64; 2] = [0.6, 0.9];
const DOUBTS: [f64; 2] = [0.9, 1.0];

/// Searches what the models (one a scene, of one set-up) lack. Deterministic, whatever the number of threads.
pub fn discover(
    scenes: &[Scene],
    models: &[Model],
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Discovery, FitError> {
    discover_with(scenes, models, options, None, stop)
}

/// The same, with its steps kept: after a stop, the same call goes on from there and gives the same result.
pub fn discover_with(
    scenes: &[Scene],
    models: &[Model],
    options: &DiscoverOptions,
    checkpoints: Option<&dyn Checkpoints>,
    stop: Stop,
) -> Result<Discovery, FitError> {
    crate::fit::check(scenes, models)?;
    let coarse = resampled(scenes);
    let models = coarse.models(scenes, models);
    let first: Stop = &progress_within(stop, WITHOUT_PUSHES);
    let mut found = discover_in(&coarse.scenes, &models, options, checkpoints, first)?;
    let mut rest = WITHOUT_PUSHES[1];
    for _ in 0..PUSH_ROUNDS {
        let next = 0.5 * (1.0 + rest);
        let stop: Stop = &progress_within(stop, [rest, next]);
        let Some(pushed) = with_unseen_pushes(&coarse.scenes, &models, &found, &options.fit, stop)? else {
            break;
        };
        let other = discover_in(&coarse.scenes, &pushed, options, checkpoints, stop)?;
        if !explains_pushed(&coarse.scenes, &found, &other) {
            break;
        }
        (found, rest) = (other, next);
    }
    let left = match found.revisions.last() {
        Some(last) => unfollowed(&coarse, last, &options.fit, stop)?,
        None => String::new(),
    };
    found.revisions.iter_mut().for_each(|revision| coarse.restore(scenes, revision));
    name_pushes(scenes, &mut found);
    found.reason += &left;
    stop(1.0)?;
    Ok(found)
}

fn discover_in(
    scenes: &[Scene],
    models: &[Model],
    options: &DiscoverOptions,
    checkpoints: Option<&dyn Checkpoints>,
    stop: Stop,
) -> Result<Discovery, FitError> {
    let lens = WeakFormRegression::new(scenes).until(stop).kept_in(checkpoints);
    if let Some(reason) = too_little(&lens) {
        return Ok(not_identifiable(&lens, reason));
    }
    let options = &DiscoverOptions { fit: FitOptions { single_precision: true, ..options.fit }, ..*options };
    if options.max_effects > 0
        && let Some(found) = spinning(&lens, models, &options.fit, &progress_within(stop, SPINNING))?
    {
        return Ok(found);
    }
    let mut known: Vec<BaseSearch> = vec![];
    for models in readings(scenes, models) {
        let models = with_nuisance(&models);
        let first = lens
            .step("search", &(scenes, &models), || search(&lens, &models, &progress_within(stop, SEARCH)))?;
        known.push(BaseSearch { models, first, further: None, screened: None });
    }
    if let Some(found) = decisive_formula(&lens, &known, options, &progress_within(stop, TRAJECTORIES))? {
        return Ok(found);
    }
    let mut looked: Vec<(usize, f64, bool)> = vec![];
    for reading in nearest(known.iter().map(|k| k.first.priced())) {
        let (motion, films) = known[reading].look(&lens, options, &progress_within(stop, FILMS))?;
        looked.push((reading, motion.priced() + films.cost(), films.at_noise()));
    }
    // Where one reading follows all contacts to the noise, no law of contact makes another the better one.
    let settled = looked.iter().filter(|k| k.2).map(|k| k.1).fold(f64::INFINITY, f64::min);
    looked.retain(|k| k.1 < settled + SAME);
    let seen: Result<Vec<BaseModel>, FitError> = looked
        .iter()
        .map(|k| known[k.0].screened(&lens, options, &progress_within(stop, CONTACTS)))
        .collect();
    let seen = seen?;
    let near = nearest(seen.iter().map(|r| r.motion.priced() + r.films));
    let seen = seen.into_iter().enumerate().filter(|(k, _)| near.contains(k)).map(|(_, r)| r).collect();
    match by_trajectories(&lens, seen, options, &progress_within(stop, READING))? {
        Some(reading) => {
            let found = conclude(&lens, reading, options, &progress_within(stop, TRAJECTORIES))?;
            let last = &progress_within(stop, DOUBTS);
            let found = reread(&lens, &mut known, found, options, last)?;
            unseen(&lens, &mut known, found, options, last)
        }
        None => Ok(not_identifiable(&lens, film_instead(&lens))),
    }
}

/// What is found where a law that the library lacks is plain from the free motion in one of the readings: neither contacts nor
/// trajectories with a second law of the library would change that.
fn decisive_formula(
    lens: &WeakFormRegression,
    known: &[BaseSearch],
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Option<Discovery>, FitError> {
    let plain =
        known.iter().filter_map(|k| Some((formula_test::formula_is_decisive(lens, &k.models, &k.first)?, k)));
    let Some((_, reading)) = plain.min_by(|a, b| a.0.total_cmp(&b.0)) else { return Ok(None) };
    let (models, motion) = (reading.models.clone(), reading.first.clone());
    let options = DiscoverOptions { max_effects: motion.found.len(), ..*options };
    let reading = BaseModel { models, motion, contacts: vec![], films: 0.0 };
    conclude(lens, reading, &options, stop).map(Some)
}

/// One reading of the base, with what was seen of it so far.
struct BaseSearch {
    models: Vec<Model>,
    /// With the first law of force.
    first: FreeMotion,
    /// With all laws of force, and the short films of contacts beside these.
    further: Option<(FreeMotion, WindowFits)>,
    /// With the laws of contact.
    screened: Option<BaseModel>,
}

impl BaseSearch {
    fn look(
        &mut self,
        lens: &WeakFormRegression,
        options: &DiscoverOptions,
        stop: Stop,
    ) -> Result<&(FreeMotion, WindowFits), FitError> {
        let further = match self.further.take() {
            Some(further) => further,
            None => {
                let inputs = (lens.scenes, &self.models, options.max_effects);
                lens.step("further", &inputs, || -> Result<_, FitError> {
                    let motion =
                        search_on(lens, &self.models, self.first.clone(), options.max_effects, stop)?;
                    let films = WindowFits::of(&contacts(lens, &motion.models), stop)?;
                    Ok((motion, films))
                })?
            }
        };
        Ok(self.further.insert(further))
    }

    fn screened(
        &mut self,
        lens: &WeakFormRegression,
        options: &DiscoverOptions,
        stop: Stop,
    ) -> Result<BaseModel, FitError> {
        if let Some(known) = &self.screened {
            return Ok(known.clone());
        }
        let models = self.models.clone();
        let (motion, films) = self.look(lens, options, stop)?;
        let candidates = candidates(&motion.models, lens.scenes);
        let inputs = (lens.scenes, &motion.models, options.max_effects);
        let (contacts, lost) = lens
            .step("contacts", &inputs, || screen_contacts(films, &region(lens.scenes), &candidates, stop))?;
        let films = lost + contacts.iter().find(|c| c.proven()).map_or(films_cost(&contacts), |c| c.after);
        let reading = BaseModel { models, motion: motion.clone(), contacts, films };
        Ok(self.screened.insert(reading).clone())
    }
}

/// Whether the last revision loses a video.
fn loses(found: &Discovery) -> bool {
    found.revisions.last().is_some_and(|r| proof::loses(&r.fit))
}

/// How far the last revision is from what was measured.
fn deviance(found: &Discovery) -> f64 {
    found.revisions.last().map_or(f64::INFINITY, |r| proof::deviance(&r.fit))
}

/// What is found, or what another reading of the base finds where trajectories with the same laws are nearer in that: a
/// hidden law may make the wrong reading look the better one.
fn reread(
    lens: &WeakFormRegression,
    known: &mut [BaseSearch],
    found: Discovery,
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Discovery, FitError> {
    let mut best = found;
    for reading in known {
        let astray = |r: &&Revision| proof::loses(&r.fit) && proof::astray(&r.fit);
        let Some(last) = best.revisions.last().filter(astray) else { break };
        if last.fit.scenes[0].model.preset == reading.models[0].preset {
            continue;
        }
        let mut with_laws = reading.models.clone();
        for (model, fitted) in with_laws.iter_mut().zip(&last.fit.scenes) {
            let laws = best.effects.iter().filter_map(|e| fitted.model.effect(&e.effect));
            model.effects.extend(laws.cloned());
        }
        let law = best.effects.last().and_then(|e| effect(&e.effect));
        let mut tried = vec![(with_laws, law)];
        // What sticks may look like another law of contact.
        if law.is_some_and(|law| law.uses(Hook::Contact) && law.all_or_nothing().is_none()) {
            let sticking = effect_with(|e| e.all_or_nothing().is_some());
            tried.extend(sticking.map(|law| (stuck(&reading.models, law, &region(lens.scenes)), sticking)));
        }
        let mut nearer = false;
        for (models, law) in tried {
            if nearer {
                break;
            }
            let tried = FitOptions { budget_fraction: TRIED_BUDGET_FRACTION, ..options.fit };
            nearer |= match trajectories(lens, &models, law.map(|l| l.spec.name), &tried, stop) {
                Ok((fit, _)) => proof::follows_better(&last.fit, &fit),
                // A law that was written may have no value in this reading.
                Err(FitError::FormulaUndefined { .. }) => false,
                Err(other) => return Err(other),
            };
        }
        if !nearer {
            continue;
        }
        let other = conclude(lens, reading.screened(lens, options, stop)?, options, stop)?;
        if other.revisions.last().is_some_and(|r| proof::follows_better(&last.fit, &r.fit)) {
            best = other;
        }
    }
    Ok(best)
}

/// What is found, or something that nobody saw where trajectories follow that better: what it strikes, or keeps at rest, may
/// look like a force or like another reading of the base.
fn unseen(
    lens: &WeakFormRegression,
    known: &mut [BaseSearch],
    found: Discovery,
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Discovery, FitError> {
    if options.max_effects == 0 || found.names_unseen_bodies() || !loses(&found) {
        return Ok(found);
    }
    let of_bodies = |models: &[Model]| -> Vec<_> {
        candidates(models, lens.scenes).into_iter().filter(|e| e.uses(Hook::Bodies)).collect()
    };
    let mut best = found;
    for reading in known {
        let models = reading.models.clone();
        let motion = fewer(lens, &models, &reading.first, reading.first.found.len(), stop)?;
        let films = match &reading.further {
            Some((further, films)) if further.found.is_empty() => films,
            _ => &WindowFits::of(&contacts(lens, &motion.models), stop)?,
        };
        let (contacts, _) = screen_contacts(films, &region(lens.scenes), &of_bodies(&models), stop)?;
        if !contacts.iter().any(ContactCandidate::proven) {
            continue;
        }
        let other = conclude(lens, BaseModel { models, motion, contacts, films: 0.0 }, options, stop)?;
        if deviance(&other) < deviance(&best) {
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
    pub ranked: Vec<RankedEffect>,
    /// Sudden changes of velocity that no other object explains: index of the scene, and what happened.
    pub jumps: Vec<(usize, ChangePoint)>,
    /// Why these videos cannot tell what is missing, and what to film instead; nothing is ranked then.
    #[serde(default)]
    pub too_little: Option<String>,
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
    let models = fit.models();
    let coarse = resampled(scenes);
    let lens = WeakFormRegression::new(&coarse.scenes).until(stop);
    let begun = with_nuisance(&models);
    let motion = search(&lens, &begun, stop)?;
    let films = WindowFits::of(&contacts(&lens, &motion.models), stop)?;
    let (of_contacts, _) =
        screen_contacts(&films, &region(lens.scenes), &candidates(&models, lens.scenes), stop)?;
    let formulas = match formulas {
        [] => vec![],
        _ => rank_formulas(&lens, &begun, formulas, motion.unit()),
    };
    let mut ranked = ranked(&motion, formulas, &of_contacts, &[], pooled_noise(&lens));
    let too_little = too_little(&lens);
    if too_little.is_some() {
        ranked.clear();
    }
    let as_given = |(scene, jump): (usize, ChangePoint)| {
        (scene, ChangePoint { frame: coarse.frame(scene, jump.frame), ..jump })
    };
    let jumps = films.films.jumps.into_iter().map(as_given);
    stop(1.0)?;
    Ok(Diagnosis {
        comparison,
        free_motion: motion.base.chi_square / motion.degrees_of_freedom,
        ranked,
        jumps: jumps.collect(),
        too_little,
    })
}

/// Why too little moves, or too little of it was measured, to tell any law, and what to do instead; `None` where there is enough.
pub fn too_little(lens: &WeakFormRegression) -> Option<String> {
    let smoothed = lens.scenes.iter().filter_map(|s| s.finding(FindingKind::DependentNoise)).count();
    if 2 * smoothed > lens.scenes.len() {
        return Some(SMOOTHED.into());
    }
    (lens.degrees_of_freedom() < FEWEST).then(|| film_instead(lens))
}

fn film_instead(lens: &WeakFormRegression) -> String {
    let seen = lens.degrees_of_freedom();
    format!(
        "only {seen} free-motion residuals, {FEWEST} are needed: record objects that move, for longer and apart from each other"
    )
}

/// Indices of the readings that are not worse than the best by more than chance.
pub fn nearest(costs: impl Iterator<Item = f64>) -> Vec<usize> {
    let costs: Vec<f64> = costs.collect();
    let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
    (0..costs.len()).filter(|&k| costs[k] < least + SAME).collect()
}

fn films_cost(screened: &[ContactCandidate]) -> f64 {
    screened.first().map_or(0.0, |c| c.before)
}

/// The reading whose trajectories follow the scenes best with the laws that are seen in it; a scene that none follows decides
/// little.
fn by_trajectories(
    lens: &WeakFormRegression,
    mut seen: Vec<BaseModel>,
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Option<BaseModel>, FitError> {
    if seen.len() < 2 {
        return Ok(seen.pop());
    }
    let tried = FitOptions { budget_fraction: TRIED_BUDGET_FRACTION, ..options.fit };
    let misfit = |reading: &BaseModel| -> Result<f64, FitError> {
        let motion = &reading.motion;
        let (models, law) = match law_of(&reading.contacts, motion, options) {
            Some(c) => {
                let region = region(lens.scenes);
                (&with_contact(&motion.models, c.entry, &c.values, c.object, &region), Some(c.entry))
            }
            None => (&motion.models, motion.found.last().map(|c| c.entry)),
        };
        let (fit, _) = trajectories(lens, models, law.map(|l| l.spec.name), &tried, stop)?;
        Ok(fit.scenes.iter().map(|s| elementary::ln_1p(s.reduced_chi_square)).sum())
    };
    let misfits: Vec<f64> = seen.par_iter().map(misfit).collect::<Result<_, _>>()?;
    Ok(seen.into_iter().zip(misfits).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(reading, _)| reading))
}

/// The models, and the other reading of the same scenes where the preset has one.
pub fn readings(scenes: &[Scene], models: &[Model]) -> Vec<Vec<Model>> {
    let mut all = vec![models.to_vec()];
    let balls = models.iter().flat_map(|m| &m.bodies).any(|b| b.shape.is_ball());
    let rival = |m: &Model| Preset::named(&m.preset).and_then(|p| p.rival).and_then(Preset::named);
    // A model that the user changed is not read anew.
    let with_pushes =
        |preset: &Preset, s: &Scene, m: &Model| Model { impulses: m.impulses.clone(), ..preset.model(s) };
    let untouched =
        |(s, m): (&Scene, &Model)| Preset::named(&m.preset).is_some_and(|p| with_pushes(p, s, m) == *m);
    if balls && scenes.iter().zip(models).all(untouched) {
        let read = |(s, m): (&Scene, &Model)| rival(m).map(|p| with_pushes(p, s, m));
        let other: Option<Vec<Model>> = scenes.iter().zip(models).map(read).collect();
        all.extend(other);
    }
    all
}

fn not_identifiable(lens: &WeakFormRegression, reason: String) -> Discovery {
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
        reason,
    }
}
