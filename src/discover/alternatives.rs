//! The law of contact that short films name, or another choice to which trajectories are nearer.

use super::contact::ContactCandidate;
use super::contact_law::{estimates_of, pooled, with_contact};
use super::proof::{self, alike_kinds};
use super::revise::{Revision, TRIED_BUDGET_FRACTION, revise, trajectories};
use super::screen::{CERTAIN, region};
use super::search::{ALIKE, CLEAN, FreeMotion};
use super::weak_form::WeakFormRegression;
use super::whole_trajectory::balls_roll;
use crate::effects::Hook;
use crate::fit::{FitError, FitOptions};
use crate::num::Stop;
use crate::world::Model;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Most other laws that trajectories are asked about.
const OTHERS: usize = 2;

/// What full trajectories say of other laws of contact in place of the one that windows prove.
#[derive(Default)]
pub struct ContactRivals<'c> {
    /// The one that is nearer, with its revision.
    pub better: Option<(&'c ContactCandidate, Revision)>,
    /// Kinds as near as the best (odds below 20 to 1), it included, those of fewest parameters first; empty if there is one.
    pub alike: Vec<String>,
}

/// Compares laws of contact that windows support as clearly by their trajectories; of bodies that nobody saw, any other that they
/// prove: what was hit may be a wall or an object. Where one object's own law leaves something, one that all have may explain it.
pub fn contact_rivals<'c>(
    lens: &WeakFormRegression,
    law: &ContactCandidate,
    all: &'c [ContactCandidate],
    motion: &FreeMotion,
    revisions: &[Revision],
    options: &FitOptions,
    stop: Stop,
) -> Result<ContactRivals<'c>, FitError> {
    let [.., without, known] = revisions else { return Ok(ContactRivals::default()) };
    let unseen = |c: &ContactCandidate| c.entry.uses(Hook::Bodies);
    let leaves = law.object.is_some() && !proof::explains_all(known);
    let as_clear = |c: &ContactCandidate| law.score - c.score < ALIKE || (unseen(law) && unseen(c));
    let near = |c: &&ContactCandidate| as_clear(c) || (leaves && c.object.is_none() && !unseen(c));
    let others = all.iter().filter(|c| c.proven() && c.entry.kind != law.entry.kind && near(c));
    let region = region(lens.scenes);
    let tried = others.take(OTHERS).collect::<Vec<_>>().into_par_iter().map(|c| {
        let models = with_contact(&motion.models, c.entry, &c.values, c.object, &region);
        Ok((c, revise(lens, &models, Some(c.entry.spec.name), options, stop)?))
    });
    let mut tried: Vec<_> = tried.collect::<Result<_, FitError>>()?;
    tried.retain(|(c, r)| proof::is_supported(without, r, c.added));
    let of = |(c, r): (&ContactCandidate, &Revision)| (c.added, c.entry.kind, proof::deviance(&r.fit));
    let all: Vec<_> = tried.iter().map(|(c, r)| (*c, r)).chain([(law, known)]).map(of).collect();
    let alike = alike_kinds(&all, &known.fit);
    let distance = |r: &Revision| proof::deviance(&r.fit);
    let nearest = tried.into_iter().min_by(|a, b| distance(&a.1).total_cmp(&distance(&b.1)));
    let better = nearest.filter(|(c, r)| match as_clear(c) {
        true => distance(r) < distance(known),
        false => proof::nearer(&known.fit, &r.fit),
    });
    Ok(ContactRivals { better, alike })
}

/// The same law of contact with what short films could not choose chosen otherwise, where trajectories are nearer to that.
pub fn otherwise(
    lens: &WeakFormRegression,
    law: &ContactCandidate,
    models: &[Model],
    known: &Revision,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<(ContactCandidate, Revision)>, FitError> {
    if law.object.is_some() {
        return of_another(lens, law, models, known, options, stop);
    }
    // Seeds of an unseen thing are places, and no choice.
    let asks = balls_roll(models) && !law.entry.uses(Hook::Bodies) && known.reduced_chi_square > 1.0 + CLEAN;
    if !asks {
        return Ok(None);
    }
    let region = region(lens.scenes);
    let mut best = None;
    let mut nearest = proof::deviance(&known.fit);
    for values in law.entry.choices(&law.values, &region) {
        let with = with_contact(models, law.entry, &values, None, &region);
        let revision = revise(lens, &with, Some(law.entry.spec.name), options, stop)?;
        let distance = proof::deviance(&revision.fit);
        if distance < nearest {
            nearest = distance;
            best = Some((ContactCandidate { values, ..law.clone() }, revision));
        }
    }
    Ok(best)
}

/// What befalls one object befalling another, where that which short films name loses a scene.
fn of_another(
    lens: &WeakFormRegression,
    law: &ContactCandidate,
    models: &[Model],
    known: &Revision,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<(ContactCandidate, Revision)>, FitError> {
    if !proof::loses(&known.fit) {
        return Ok(None);
    }
    let name = law.entry.spec.name;
    let mut others: BTreeSet<u32> = models.iter().flat_map(|m| m.bodies.iter().map(|b| b.id)).collect();
    others.retain(|id| law.object != Some(*id));
    let (region, none) = (region(lens.scenes), vec![0.0; law.values.len()]);
    let less = FitOptions { budget_fraction: TRIED_BUDGET_FRACTION, ..*options };
    let tried = others.into_par_iter().map(|id| {
        let with = with_contact(models, law.entry, &none, Some(id), &region);
        let (fit, _) = trajectories(lens, &with, Some(name), &less, stop)?;
        Ok((proof::deviance(&fit), id, with))
    });
    let tried: Vec<_> = tried.collect::<Result<_, FitError>>()?;
    let Some((_, id, with)) = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { return Ok(None) };
    let revision = revise(lens, &with, Some(name), options, stop)?;
    let of = |p: &str| pooled(&estimates_of(&revision.fit, name, p)).unwrap_or_default();
    let (values, sd) = law.entry.spec.params.iter().map(|p| of(p.name)).unzip();
    let other = ContactCandidate { object: Some(id), values, sd, ..law.clone() };
    let nearer = proof::deviance(&revision.fit) < proof::deviance(&known.fit);
    Ok((nearer && keeps(&other, &revision)).then_some((other, revision)))
}

/// Whether the number of one object is still there in trajectories, which may follow better for another reason.
pub fn keeps(c: &ContactCandidate, found: &Revision) -> bool {
    let Some(p) = c.entry.spec.params.first().filter(|_| c.object.is_some()) else { return true };
    let told = pooled(&estimates_of(&found.fit, c.entry.spec.name, p.name));
    told.is_none_or(|(value, sd)| value.abs() > CERTAIN * sd)
}

#[cfg(test)]
mod tests {
    use super::super::revise::chi_squares;
    use super::super::screen::with_nuisance;
    use super::super::tests::{DISC, film, heavier_than_believed, models};
    use super::super::verdict::DiscoverOptions;
    use super::*;
    use crate::effects::effect;
    use crate::num::never;

    #[test]
    fn a_mass_that_trajectories_have_as_it_was_believed_is_none() {
        let meet = [vec![(DISC, 1.0, [-1.2, 0.0], [1.2, 0.0]), (DISC, 1.0, [0.2, 0.1], [0.0, 0.0])]];
        for (scenes, is_wrong) in [(heavier_than_believed(), true), (film(&meet, None), false)] {
            let (lens, region) = (WeakFormRegression::new(&scenes), region(&scenes));
            let entry = effect("mass_change").expect("it is in the library");
            let models = with_contact(&with_nuisance(&models(&scenes)), entry, &[0.3], Some(1), &region);
            let options = DiscoverOptions::default().fit;
            let found =
                revise(&lens, &models, Some(entry.spec.name), &options, &never).expect("it can be fitted");
            let law = ContactCandidate {
                entry,
                values: vec![0.3],
                sd: vec![0.01],
                object: Some(1),
                added: 1,
                score: 200.0,
                before: 1000.0,
                after: chi_squares(&found.fit).iter().sum(),
                remains: 1.0,
                gained: 2,
            };
            assert_eq!(keeps(&law, &found), is_wrong);
        }
    }
}
