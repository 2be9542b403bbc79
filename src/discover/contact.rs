//! The contact lens: short films around each contact and each jump without a partner, fitted through the contact in
//! trajectory space. Short films start anew, so that no error is carried from contact to contact.

use super::checkpoints::effect_by_name;
use super::contact_law::{estimates_of, is_scale, pooled, with_contact};
use super::cost::Cost;
use super::hidden_geometry::{discs_behind, rectangle, walls};
use super::jackknife::{numbers_of, scatter};
use super::negligible::is_slight;
use super::restitution_decay::{as_met, decays};
use super::revise::{TRIED_BUDGET_FRACTION, agree_on, chi_squares, lower, sum, without_effect};
use super::screen::certain;
use super::window_fits::{AT_NOISE, FOLLOWED, OPTIONS, WindowFits};
use super::windows::ContactWindows;
use crate::effects::{EffectEntry, Hook, ObstacleForm, Region};
use crate::fit::{self, Fit, FitError, FitOptions, StartPoint, estimate, estimate_one, widened};
use crate::num::{Stop, elementary};
use crate::world::Model;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Fall of chi-square, in units of what remains and beyond the price of its parameters, that a law of contact must
/// bring: engines differ in their contacts by more than the noise.
pub const PROOF: f64 = 40.0;
/// One short film alone proves a law when it brings this many times as much.
const STRONG: f64 = 3.0;
/// Reduced chi-square of the short films up to which a law explains them, and the share of what is beyond noise that will do:
/// engines do more at contacts than any law says.
const EXPLAINED: f64 = 2.0;
const MOSTLY: f64 = 0.9;
/// A film is followed, too, where a law leaves this share of its misfit.
const NEARER: f64 = 0.05;
/// Fall of one short film's chi-square that is more than chance, in units of what remains.
const CHANCE: f64 = 6.0;
/// Places, or objects, that one law is tried at with all short films.
const FINALISTS: usize = 2;
/// Iterations of the fit of all films together, the same of all laws at first, and how many laws are followed further.
const COMMON_ITERATIONS: usize = 15;
const FIRST_ITERATIONS: usize = 5;
const FOLLOWED_UP: usize = 3;
/// Walls that are tried.
const WALLS: usize = 3;
/// A law of contact as the short films see it.
#[derive(Clone, Serialize, Deserialize)]
pub struct ContactCandidate {
    #[serde(with = "effect_by_name")]
    pub entry: &'static EffectEntry,
    pub values: Vec<f64>,
    pub sd: Vec<f64>,
    /// Whose parameters these are, where each object has its own.
    pub object: Option<u32>,
    pub added: usize,
    /// Fall of chi-square in units of what remains, the price of the parameters paid.
    pub score: f64,
    /// Chi-square of the short films without and with it.
    pub before: f64,
    pub after: f64,
    /// The same over its degrees of freedom.
    pub remains: f64,
    /// Short films that gained by more than chance.
    pub gained: usize,
}

impl ContactCandidate {
    /// Whether short films speak for it, if too few of them or without one number: trajectories may prove it.
    pub fn suggested(&self) -> bool {
        self.score > PROOF && (self.certain() || self.gained > 1)
    }

    /// Whether an amplitude differs from none.
    fn certain(&self) -> bool {
        certain(&self.values, &self.sd, self.entry.amplitudes)
    }

    /// Whether a single short film speaks for it as clearly as several would.
    pub fn strong(&self) -> bool {
        self.score > STRONG * PROOF && self.remains < super::MISFIT
    }

    /// Whether it explains the contacts, more than one of them (of an unseen thing: any), and by enough.
    pub fn proven(&self) -> bool {
        let law = !self.entry.uses(Hook::Bodies);
        let often = self.gained > 1 || self.strong();
        if self.object.is_some() || is_scale(self.entry) {
            // A mass takes up much of what engines do at that object's contacts, and all of what is odd at one of them; a scale,
            // of what they do at all.
            return self.strong() && self.gained > 1 && self.certain();
        }
        // Judged by what it explains, not by its deviation: where objects stick at a contact, more friction changes nothing.
        let acts = self.values.first().is_some_and(|a| *a != 0.0);
        let beyond = self.before * self.remains / self.after.max(f64::MIN_POSITIVE) - 1.0;
        let explained = self.remains < EXPLAINED || self.remains - 1.0 < (1.0 - MOSTLY) * beyond;
        self.score > PROOF && explained && (!law || (often && acts))
    }
}

/// Laws of contact and things that nobody saw, best first, and what the short films cost that nothing follows. Empty where
/// nothing touches anything.
pub fn screen_contacts(
    alone: &WindowFits,
    region: &Region,
    candidates: &[&'static EffectEntry],
    stop: Stop,
) -> Result<(Vec<ContactCandidate>, f64), FitError> {
    let (WindowFits { mut films, fits }, mut lost) = alone.without_heaps(stop)?;
    if films.scenes.is_empty() {
        return Ok((vec![], lost));
    }
    let options = FitOptions { budget_fraction: TRIED_BUDGET_FRACTION, ..OPTIONS };
    let near =
        FitOptions { start_point: StartPoint::NearOptimum, max_iterations: COMMON_ITERATIONS, ..options };
    let mut base = fit::fit_jointly(&films.scenes, &films.models, &fits, &near, stop)?;
    let mut before = chi_squares(&base);
    let mut ended = base.models();
    let off = |fit: &Fit, film: usize| fit.scenes[film].reduced_chi_square;
    let unfollowed =
        |base: &Fit| -> Vec<usize> { (0..base.scenes.len()).filter(|&k| off(base, k) > AT_NOISE).collect() };
    let anew = unfollowed(&base);
    let mut trials: Vec<(&'static EffectEntry, Vec<f64>, Option<u32>)> = vec![];
    for &entry in candidates {
        match entry.obstacle() {
            Some(ObstacleForm::Wall) => trials.extend(
                walls(&films.jumps, &films.models).into_iter().take(WALLS).map(|p| (entry, p.values, None)),
            ),
            Some(ObstacleForm::Disc) => trials.extend(
                discs_behind(&films.jumps, &films.models).into_iter().map(|p| (entry, p.values, None)),
            ),
            Some(ObstacleForm::Rectangle) => {
                trials.extend(rectangle(&films.jumps, &films.models, region).map(|p| (entry, p.values, None)))
            }
            // One object at a time: masses that are all free take up much of what engines do at contacts.
            None if entry.of_objects() => {
                let ids = odd_ones(&films, &ended, &before, entry, region, &near, stop)?;
                let none = vec![0.0; entry.spec.params.len()];
                trials.extend(ids.into_iter().map(|id| (entry, none.clone(), Some(id))));
            }
            // What acts between objects that are near shows where they meet, and there alone if they are slow.
            None if entry.uses(Hook::Contact) || entry.uses(Hook::Pair) || is_scale(entry) => {
                trials.extend(entry.seeds(region).into_iter().map(|values| (entry, values, None)));
            }
            None => {}
        }
    }
    let (plain, mut met) = (trials.len(), vec![]);
    if let Some(entry) = candidates.iter().find(|entry| decays(entry))
        && let Some((inverse_v0, models)) = as_met(&films, &ended)
    {
        trials.push((entry, vec![inverse_v0], None));
        met = models;
    }
    // What the base fits goes on from there; the others begin anew, each alone: one that leads astray takes no other with
    // it, and is not searched again with all of them.
    let begun: Result<Vec<StartedLaw>, FitError> = trials
        .into_par_iter()
        .enumerate()
        .map(|(k, (entry, values, object))| {
            let stand = if k < plain { &ended } else { &met };
            let mut models = with_contact(stand, entry, &values, object, region);
            let (mut fall, mut tried) = (0.0, vec![]);
            let mut least: Vec<f64> = fits.iter().map(|fit| off(fit, 0)).collect();
            for film in 0..models.len() {
                let anew = anew.contains(&film);
                // What befalls one object shows where it is.
                if !object.map_or(anew, |id| models[film].body_index(id).is_some()) {
                    continue;
                }
                let asked = match anew {
                    true => {
                        with_contact(&films.models[film..=film], entry, &values, object, region).remove(0)
                    }
                    false => models[film].clone(),
                };
                let alone =
                    estimate_one(&films.scenes[film], &asked, if anew { &options } else { &near }, stop)?;
                fall += before[film] - sum(&chi_squares(&alone));
                least[film] = least[film].min(off(&alone, 0));
                models[film].copy_state_from(&alone.scenes[0].model);
                tried.push(alone);
            }
            agree_on(&mut models, entry.spec.name, &tried);
            // What a film has of an unseen thing by itself may be far from where the others have it: then its objects stand
            // better as they did without.
            if entry.uses(Hook::Bodies) {
                let as_it_is = FitOptions { max_iterations: 0, ..near };
                for &film in &anew {
                    let scene = &films.scenes[film];
                    let mut as_before = models[film].clone();
                    as_before.copy_state_from(&stand[film]);
                    let misfit =
                        |m: &Model| Ok::<_, FitError>(off(&estimate_one(scene, m, &as_it_is, stop)?, 0));
                    if misfit(&as_before)? < misfit(&models[film])? {
                        models[film] = as_before;
                    }
                }
            }
            Ok(StartedLaw { entry, values, object, models, fall, least })
        })
        .collect();
    let mut begun = begun?;
    // What nothing follows, even by itself, would lead all the others astray.
    let least = |film: usize| begun.iter().map(|b| b.least[film]).fold(off(&base, film), f64::min);
    let mut followed = followed(&base, least);
    // Nor do those say much that are only nearer, where others are followed to the end.
    let recovers = |film: &usize| off(&base, *film) > FOLLOWED && least(*film) < FOLLOWED;
    if followed.iter().any(recovers) {
        followed.retain(|&film| least(film) < FOLLOWED);
    }
    if followed.len() < films.scenes.len() {
        (films, base, lost) = without_lost(&films, &base, &followed, lost, &near, stop)?;
        if followed.is_empty() {
            return Ok((vec![], lost));
        }
        before = chi_squares(&base);
        ended = base.models();
        begun.iter_mut().for_each(|b| b.models = followed.iter().map(|&k| b.models[k].clone()).collect());
    }
    let (films, unfollowed) = (&films, unfollowed(&base));
    let few = FitOptions { max_iterations: FIRST_ITERATIONS, ..near };
    let first: Result<Vec<FittedLaw>, FitError> = finalists(begun)
        .into_par_iter()
        .map(|StartedLaw { entry, values, object, models, .. }| {
            let mut found = estimate(&films.scenes, &models, &few, stop)?;
            // A search that went astray begins where the models without the effect ended.
            if !unfollowed.is_empty() && sum(&chi_squares(&found)) > sum(&before) + CHANCE {
                let models = with_contact(&ended, entry, &values, object, region);
                found = lower(found, estimate(&films.scenes, &models, &few, stop)?);
            }
            Ok(FittedLaw { entry, start: values, object, fit: found })
        })
        .collect();
    let first = first?;
    let known = Cost::of(&base, None);
    // A film that has gone astray counts as it was: it begins anew.
    let cost = |t: &FittedLaw| {
        let after = Cost::of(&t.fit, Some(t.entry.spec.name));
        let beyond = |k: usize| f64::max(after.of_scene(k) - known.of_scene(k), 0.0);
        after.total() - (0..films.scenes.len()).map(beyond).sum::<f64>()
    };
    let costs: Vec<f64> = first.iter().map(cost).collect();
    let fitted: Result<Vec<_>, FitError> = first
        .into_par_iter()
        .zip(&costs)
        .map(|(tried, cost)| {
            // A law that little speaks for after a few steps is not the one.
            if costs.iter().filter(|c| *c < cost).count() >= FOLLOWED_UP {
                return Ok(tried);
            }
            let FittedLaw { entry, start: values, object, fit: begun } = tried;
            let models = begun.models();
            let mut found = lower(begun, estimate(&films.scenes, &models, &near, stop)?);
            // What is still lost begins anew with what the others agree on, and what has gone astray since.
            let after = Cost::of(&found, Some(entry.spec.name));
            let astray = |k: &usize| after.of_scene(*k) > known.of_scene(*k) + CHANCE;
            let lost: Vec<usize> = (0..before.len())
                .filter(|k| off(&found, *k) > AT_NOISE && (unfollowed.contains(k) || astray(k)))
                .collect();
            let others = |cost: &Cost| cost.total() - lost.iter().map(|&k| cost.of_scene(k)).sum::<f64>();
            let gains = others(&after) < others(&known) - CHANCE;
            if (gains || entry.uses(Hook::Bodies)) && !lost.is_empty() && lost.len() < before.len() {
                let mut models = found.models();
                for film in lost {
                    let begun = &films.models[film..=film];
                    let mut begun = with_contact(begun, entry, &values, object, region).remove(0);
                    begun.copy_shared_from(&models[film]);
                    let alone = estimate_one(&films.scenes[film], &begun, &options, stop)?;
                    if off(&alone, 0) < off(&found, film) {
                        models[film].clone_from(&alone.scenes[0].model);
                    }
                }
                found = lower(found, estimate(&films.scenes, &models, &near, stop)?);
            }
            Ok(FittedLaw { entry, start: values, object, fit: found })
        })
        .collect();
    judged(films, base, fitted?, lost, &options, stop)
}

/// One law of contact, or an unseen thing, before all short films are fitted with it.
struct StartedLaw {
    entry: &'static EffectEntry,
    values: Vec<f64>,
    object: Option<u32>,
    models: Vec<Model>,
    /// Fall of chi-square of the films that were fitted with it, each alone.
    fall: f64,
    /// The least reduced chi-square of each film by itself.
    least: Vec<f64>,
}

/// The films that something follows, given the least reduced chi-square that each was brought to.
fn followed(base: &Fit, least: impl Fn(usize) -> f64) -> Vec<usize> {
    let follows =
        |film: &usize| least(*film) < f64::max(FOLLOWED, NEARER * base.scenes[*film].reduced_chi_square);
    (0..base.scenes.len()).filter(follows).collect()
}

/// The films that are `followed`, fitted without what pulled at them, and what the others cost beside what is `lost`.
fn without_lost(
    films: &ContactWindows,
    base: &Fit,
    followed: &[usize],
    lost: f64,
    near: &FitOptions,
    stop: Stop,
) -> Result<(ContactWindows, Fit, f64), FitError> {
    let left_out = (0..films.scenes.len()).filter(|film| !followed.contains(film));
    let lost =
        lost + left_out.map(|film| FOLLOWED * base.scenes[film].degrees_of_freedom as f64).sum::<f64>();
    let rest = films.only(|film| followed.contains(&film));
    let base = if followed.is_empty() { base.clone() } else { of_some(&rest, base, followed, near, stop)? };
    Ok((rest, base, lost))
}

/// The fit of some films, from where they stand in a fit of more.
fn of_some(
    films: &ContactWindows,
    of_more: &Fit,
    which: &[usize],
    near: &FitOptions,
    stop: Stop,
) -> Result<Fit, FitError> {
    let models: Vec<Model> = which.iter().map(|&film| of_more.scenes[film].model.clone()).collect();
    estimate(&films.scenes, &models, near, stop)
}

/// Of places and objects that one law may befall, those that promise most; in the order given.
fn finalists(begun: Vec<StartedLaw>) -> Vec<StartedLaw> {
    let better = |b: &StartedLaw| {
        begun.iter().filter(|o| o.entry.spec.name == b.entry.spec.name && o.fall > b.fall).count()
    };
    let stays: Vec<bool> = begun.iter().map(|b| better(b) < FINALISTS).collect();
    begun.into_iter().zip(stays).filter(|(_, stays)| *stays).map(|(b, _)| b).collect()
}

/// One law of contact, or an unseen thing, fitted to the short films.
struct FittedLaw {
    entry: &'static EffectEntry,
    start: Vec<f64>,
    object: Option<u32>,
    fit: Fit,
}

/// See [`screen_contacts`]; `lost` is the cost of films that were left out before.
fn judged(
    films: &ContactWindows,
    base: Fit,
    fitted: Vec<FittedLaw>,
    lost: f64,
    options: &FitOptions,
    stop: Stop,
) -> Result<(Vec<ContactCandidate>, f64), FitError> {
    let before = Cost::of(&base, None);
    let off = |fit: &Fit, film: usize| fit.scenes[film].reduced_chi_square;
    let least = |film: usize| fitted.iter().map(|f| off(&f.fit, film)).fold(off(&base, film), f64::min);
    let followed = followed(&base, least);
    if followed.len() < films.scenes.len() {
        let near = FitOptions { start_point: StartPoint::NearOptimum, ..*options };
        let (rest, base, lost) = without_lost(films, &base, &followed, lost, &near, stop)?;
        if followed.is_empty() {
            return Ok((vec![], lost));
        }
        let fitted: Result<Vec<FittedLaw>, FitError> = fitted
            .into_par_iter()
            .map(|t| Ok(FittedLaw { fit: of_some(&rest, &t.fit, &followed, &near, stop)?, ..t }))
            .collect();
        return judged(&rest, base, fitted?, lost, options, stop);
    }
    let degrees: usize = base.scenes.iter().map(|s| s.degrees_of_freedom).sum();
    let least = fitted.iter().map(|f| chi_squares(&f.fit).iter().sum::<f64>()).fold(f64::INFINITY, f64::min);
    let unit = (least / degrees.max(1) as f64).max(1.0);
    let all: Result<Vec<ContactCandidate>, FitError> = fitted
        .into_par_iter()
        .map(|FittedLaw { entry, start, object, fit }| {
            let after = Cost::of(&fit, Some(entry.spec.name));
            // What brings nothing against the one minimum brings nothing against the better of two.
            let before = match before.total() - after.total() > 0.5 * PROOF * unit {
                true => without(films, &fit, entry, &before, options, stop)?,
                false => before.clone(),
            };
            let mut values = start.clone();
            let mut sd = vec![0.0; values.len()];
            let mut added = 0;
            for (k, p) in entry.spec.params.iter().enumerate() {
                let of = estimates_of(&fit, entry.spec.name, p.name);
                added += of.len();
                if let Some(pooled) = pooled(&of) {
                    (values[k], sd[k]) = pooled;
                }
            }
            let score = (before.total() - after.total()) / unit
                - added as f64 * elementary::ln(degrees.max(2) as f64);
            let told: Vec<usize> = (0..films.scenes.len())
                .filter(|&k| before.of_scene(k) - after.of_scene(k) > CHANCE * unit)
                .collect();
            if score > PROOF && told.len() > 1 {
                let scatter =
                    scatter(&films.scenes, &fit, &numbers_of(entry), &values, &told, options, stop)?;
                sd.iter_mut().zip(scatter).for_each(|(sd, scatter)| *sd = widened(*sd, scatter));
            }
            Ok(ContactCandidate {
                entry,
                values,
                sd,
                object,
                added,
                score,
                before: sum(&before.misfit),
                after: sum(&after.misfit),
                remains: sum(&after.misfit) / degrees.max(1) as f64,
                gained: told.len(),
            })
        })
        .collect();
    let mut all = all?;
    all.retain(|c| !is_slight(c.entry, &c.values, &films.scenes, &films.models));
    all.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut kept: Vec<ContactCandidate> = vec![];
    for c in all {
        if !kept.iter().any(|k| k.entry.spec.name == c.entry.spec.name) {
            kept.push(c);
        }
    }
    Ok((kept, lost))
}

/// Cost of the short films without the effect, at the better of its own minimum and the one that the fit with
/// the effect leads to: a search that escaped a bad minimum is no discovery.
fn without(
    films: &ContactWindows,
    with: &Fit,
    entry: &EffectEntry,
    before: &Cost,
    options: &FitOptions,
    stop: Stop,
) -> Result<Cost, FitError> {
    let models = without_effect(with, entry.spec.name);
    let near = FitOptions { start_point: StartPoint::NearOptimum, ..*options };
    let again = Cost::of(&estimate(&films.scenes, &models, &near, stop)?, None);
    Ok(if again.total() < before.total() { again } else { before.clone() })
}

/// Ids of the objects that meet others, those of which the law promises most: each tried in the films that show it, from where
/// these are followed best.
fn odd_ones(
    films: &ContactWindows,
    ended: &[Model],
    before: &[f64],
    entry: &'static EffectEntry,
    region: &Region,
    near: &FitOptions,
    stop: Stop,
) -> Result<Vec<u32>, FitError> {
    let meet = |m: &&Model| m.bodies.len() > 1;
    let ids: BTreeSet<u32> =
        films.models.iter().filter(meet).flat_map(|m| m.bodies.iter().map(|b| b.id)).collect();
    let fall = |id: u32| -> Result<(f64, u32), FitError> {
        let none = vec![0.0; entry.spec.params.len()];
        let models = with_contact(ended, entry, &none, Some(id), region);
        let mut fall = 0.0;
        for film in (0..models.len()).filter(|&film| models[film].body_index(id).is_some()) {
            let fitted = estimate_one(&films.scenes[film], &models[film], near, stop)?;
            fall += before[film] - sum(&chi_squares(&fitted));
        }
        Ok((fall, id))
    };
    let mut all: Vec<(f64, u32)> = ids.into_par_iter().map(fall).collect::<Result<_, _>>()?;
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    Ok(all.into_iter().take(FINALISTS).map(|(_, id)| id).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::effect;

    #[test]
    fn two_of_each_law_are_tried_with_all_films() {
        let begun = |name: &str, object: u32, fall: f64| StartedLaw {
            entry: effect(name).expect("it is there"),
            values: vec![],
            object: Some(object),
            models: vec![],
            fall,
            least: vec![],
        };
        let all = vec![
            begun("mass_change", 1, 5.0),
            begun("mass_change", 2, -3.0),
            begun("mass_change", 3, 9.0),
            begun("contact_friction", 4, -50.0),
        ];
        let stay: Vec<Option<u32>> = finalists(all).iter().map(|b| b.object).collect();
        assert_eq!(stay, [Some(1), Some(3), Some(4)]);
    }
}
