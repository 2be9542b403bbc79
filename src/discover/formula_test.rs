//! A law that the library lacks: a sparse sum of generic terms explains the motion, and no law of the library does as well.

use super::formula::{ResidualLaw, SIMPLE_TERMS, residual_law};
use super::proof;
use super::proposal::{FORMULA, ModelChange, propose};
use super::revise::{Revision, pooled_noise, revise, without_effect};
use super::screen::{ForceCandidate, region};
use super::search::{CLEAN, FreeMotion, leaves_something};
use super::verdict::DiscoverOptions;
use super::weak_form::{WeakFormRegression, fit_forces};
use crate::effects::formula::Formula;
use crate::fit::{Fit, FitError, FitOptions, StartPoint, estimate};
use crate::num::{Stop, elementary};
use crate::world::Model;

/// A law outside the library must beat what the library found by this (chi-square in units of what remains).
const FORMULA_PROOF: f64 = 40.0;
/// The same where the library need not be asked further.
const PLAIN_PROOF: f64 = 200.0;
/// The same of one that has fewer numbers than the two laws of the library that it stands against.
const SIMPLER_PROOF: f64 = 10.0;
/// The same of one that trajectories are asked about: what the best of 21 terms, as forces and as accelerations, has by chance
/// (2 ln 42).
const WORTH_ASKING: f64 = 7.5;
/// By how much chaos alone makes the error on later frames larger, where a law halves that on the fitted ones.
const CHAOS: f64 = 1.5;

/// The sparse law beside what the models have, of at most so many terms, or one of the waves. What the library has about a place
/// tells where a law may have its centre.
pub fn law_beside(
    lens: &WeakFormRegression,
    models: &[Model],
    motion: &FreeMotion,
    most: usize,
    waves: bool,
) -> Option<ResidualLaw> {
    let (free, seen) = fit_forces(lens, models);
    let place = motion.ranked.iter().find_map(|(_, c)| c.place());
    residual_law(lens, models, &free, &seen, most, waves, place)
}

/// The sparse law that the library's must stand against, of which trajectories may be followed to the noise.
fn simple_law(
    lens: &WeakFormRegression,
    base: &[Model],
    motion: &FreeMotion,
    followed: bool,
) -> Option<ResidualLaw> {
    // Two laws of the library, or one that leaves something, may be the image of one that it lacks.
    let doubtful =
        motion.found.len() > 1 || (!motion.found.is_empty() && motion.trimmed_chi_square > 1.0 + CLEAN);
    // A single law of the library must stand against as many generic terms as it has parameters; none at all, against any
    // that more than one object shows.
    let added = motion.added();
    let terms = if doubtful || added == 0 { SIMPLE_TERMS } else { SIMPLE_TERMS.min(added) };
    // A wave about a mean holds a single law of force: what the lens alone sees beside that may be the lens's error.
    let waves = motion.found.len() != 1 || (doubtful && !followed);
    law_beside(lens, base, motion, terms, waves)
}

/// A sparse law of which what the library has is a compromise, the last of the revisions.
pub fn formula_beats_library(
    lens: &WeakFormRegression,
    base: &[Model],
    motion: &FreeMotion,
    revisions: &[Revision],
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Option<ResidualLaw>, FitError> {
    let Some(last) = revisions.last() else { return Ok(None) };
    let followed = proof::explains_together(last);
    // An effect in other words is none that the library lacks.
    let law = simple_law(lens, base, motion, followed).filter(|law| !law.in_library);
    let Some(law) = law else { return Ok(None) };
    let added = motion.added();
    // What the library's follows to the noise only trajectories can take from it: the lens may be misled.
    let better = (!followed && beats(&law, motion, proof_against(&law, motion)))
        || (added > 0
            && beats(&law, motion, worth_asking(&law, motion))
            && followed_better(lens, &law, base, motion, revisions, options, stop)?);
    Ok((better && (added > 0 || shared(&law, motion))).then_some(law))
}

/// What remains, the law's price paid, where a single look at the library leaves no doubt: a law of which no part is in it
/// leaves noise, and the best that the library has is far from that, or a rhythm that nobody saw repeat.
pub fn formula_is_decisive(lens: &WeakFormRegression, base: &[Model], motion: &FreeMotion) -> Option<f64> {
    let duration = region(lens.scenes).duration;
    let once = motion.found.iter().any(|c| once(c, duration));
    // What leaves noise alone, no law beats by that much.
    if !once && !leaves_something(motion.priced(), motion.degrees_of_freedom) {
        return None;
    }
    let proof = if once { 0.0 } else { PLAIN_PROOF };
    let far = |law: &ResidualLaw| {
        law.not_in_library
            && law.cost < (1.0 + CLEAN) * motion.degrees_of_freedom
            && beats(law, motion, proof)
            && (motion.added() > 0 || shared(law, motion))
    };
    simple_law(lens, base, motion, false).filter(far).map(|law| priced(&law, motion))
}

/// What a sparse law must beat the library's by. Where two laws of the library would be needed, a simpler one need not be
/// better by as much.
fn proof_against(law: &ResidualLaw, motion: &FreeMotion) -> f64 {
    if motion.found.len() > 1 && law.numbers < motion.added() { SIMPLER_PROOF } else { FORMULA_PROOF }
}

/// What trajectories are asked about must beat the library's by: two laws of the library take up more of what the lens does not
/// know than a single one that it lacks, of which they are the image.
fn worth_asking(law: &ResidualLaw, motion: &FreeMotion) -> f64 {
    if motion.found.len() > 1 && law.numbers < motion.added() { -FORMULA_PROOF } else { WORTH_ASKING }
}

/// Whether a sparse law of generic terms explains the free motion better, and more simply, than the library's, by a `proof`.
fn beats(law: &ResidualLaw, motion: &FreeMotion, proof: f64) -> bool {
    (motion.priced() - priced(law, motion)) / unit(law, motion) > proof
}

/// Whether trajectories, which see more of a law than free motion does, are much nearer with a sparse law than with what the
/// library has, the last of the revisions, and foretell no less. A search that escaped a bad minimum proves nothing.
fn followed_better(
    lens: &WeakFormRegression,
    law: &ResidualLaw,
    base: &[Model],
    motion: &FreeMotion,
    revisions: &[Revision],
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<bool, FitError> {
    let ([first, ..], [.., library]) = (revisions, revisions) else { return Ok(false) };
    let Some(written) = written(lens, &law.text, base, options, stop)? else { return Ok(false) };
    // The library's pays for the numbers that it has more.
    let priced = |known: &Fit| proof::deviance(known) + motion.dearer(law.numbers);
    let nearer = |known: &Fit| proof::much_nearer(priced(known), proof::deviance(&written.fit));
    if !nearer(&library.fit)
        || !proof::is_supported(library, &written, law.numbers.saturating_sub(motion.added()))
        || written.held_out_rmse > proof::LESS * library.held_out_rmse
        || !halves_excess_error(first.held_out_rmse, written.held_out_rmse, pooled_noise(lens))
    {
        return Ok(false);
    }
    let mut there = without_effect(&written.fit, FORMULA);
    for (model, known) in there.iter_mut().zip(&library.fit.scenes) {
        let laws = known.model.effects.iter().filter(|e| model.effect(&e.name).is_none()).cloned();
        model.effects.extend(laws.collect::<Vec<_>>());
    }
    let near = FitOptions { start_point: StartPoint::NearOptimum, ..options.fit };
    Ok(nearer(&estimate(lens.scenes, &there, &near, stop)?))
}

/// Whether a law has its proof without the object on which it shows most, which may have met something, and against the laws
/// of the library that lack theirs too.
fn shared(law: &ResidualLaw, motion: &FreeMotion) -> bool {
    let (price, degrees) = (priced(law, motion) - law.cost, motion.degrees_of_freedom);
    let known = motion
        .ranked
        .iter()
        .map(|(_, c)| c.gain - c.added as f64 * elementary::ln(degrees))
        .fold(0.0, f64::max);
    let proof = FORMULA_PROOF * unit(law, motion);
    law.gain_without_best_track - price > proof && motion.base.cost - priced(law, motion) > known + proof
}

fn priced(law: &ResidualLaw, motion: &FreeMotion) -> f64 {
    law.cost + law.numbers as f64 * elementary::ln(motion.degrees_of_freedom)
}

fn unit(law: &ResidualLaw, motion: &FreeMotion) -> f64 {
    (law.cost / motion.degrees_of_freedom).max(1.0)
}

/// Whether an error falls to half of what it was beyond the noise: a law that does less is shown to nobody.
fn halves_excess_error(before: f64, after: f64, noise: f64) -> bool {
    let beyond = |error: f64| error * error - noise * noise;
    4.0 * beyond(after) < beyond(before)
}

/// Whether a law halves the error on frames that it has not seen: on later ones where the videos left out bear it out, or, where
/// chaos leaves these little to say, on those of videos left out.
pub fn predicts_held_out(before: &Revision, after: &Revision, noise: f64) -> bool {
    let later = after.held_out_rmse / before.held_out_rmse;
    (halves_excess_error(before.held_out_rmse, after.held_out_rmse, noise)
        && after.left_out_rmse <= before.left_out_rmse)
        || (halves_excess_error(before.left_out_rmse, after.left_out_rmse, noise)
            && (later < 1.0 || (later < CHAOS && halves_excess_error(before.rmse, after.rmse, noise))))
}

/// The models with a law that is written so, as a revision; `None` where it has no value.
pub fn written(
    lens: &WeakFormRegression,
    text: &str,
    models: &[Model],
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Option<Revision>, FitError> {
    let Ok(formula) = Formula::new(text, vec![]) else { return Ok(None) };
    let with = propose(lens, models, &ModelChange::Write(FORMULA.into(), formula), stop)?.models;
    match revise(lens, &with, Some(FORMULA), &options.fit, stop) {
        Ok(revision) => Ok(Some(revision)),
        Err(FitError::FormulaUndefined { .. }) => Ok(None),
        Err(other) => Err(other),
    }
}

/// Whether a law found is a rhythm whose period the films are too short for.
pub fn once(c: &ForceCandidate, duration: f64) -> bool {
    let frequency = c.entry.spec.params.iter().position(|p| p.unit == "Hz");
    frequency.and_then(|k| c.values.get(k)).is_some_and(|f| f * duration < 1.0)
}

#[cfg(test)]
mod tests {
    use super::super::discovery::discover;
    use super::super::outcome::{ParameterValue, Verdict};
    use super::super::tests::{CUBE, DISC, film_under, models};
    use super::*;
    use crate::num::never;
    use crate::world::ActiveEffect;

    /// Between contacts a lateral force looks almost like the library's that is next to it; whole trajectories tell.
    #[test]
    fn a_law_close_to_one_of_the_library_is_told_from_it() {
        let launches = [
            vec![(DISC, 0.6, [-2.0, 0.0], [1.5, 0.0]), (CUBE, 1.2, [0.4, 0.1], [-0.2, 0.05])],
            vec![(CUBE, 0.8, [0.0, 2.0], [0.4, -1.4]), (DISC, 0.6, [0.4, 0.2], [0.0, 0.3])],
            vec![(DISC, 1.5, [-1.5, -1.5], [0.8, 0.9]), (DISC, 0.6, [-0.2, -0.4], [-0.3, 0.2])],
        ];
        for (factor, verdict) in [("speed", Verdict::OutsideLibrary), ("1", Verdict::EffectFound)] {
            let lateral = format!("fx = 0.25*vy*{factor}; fy = -0.25*vx*{factor}");
            let scenes = film_under(&launches, |model| {
                let formula = Formula::new(&lateral, vec![]).expect("it is one");
                let active = ActiveEffect::of_formula("lateral_by_speed", formula, &model.bodies);
                model.effects.push(active.expect("it is one"));
            });
            let options = DiscoverOptions::default();
            let found = discover(&scenes, &models(&scenes), &options, &never).expect("it runs");
            assert_eq!(found.verdict, verdict, "{factor}: {}", found.reason);
            let outside = verdict == Verdict::OutsideLibrary;
            assert_eq!(found.formula.is_some_and(|text| text.contains("speed")), outside, "{factor}");
            let last = found.revisions.last().expect("there is the first");
            assert!(last.reduced_chi_square < 1.2, "{factor}: {}", last.reduced_chi_square);
            if outside {
                assert!(
                    found.reason.contains("on these tracks it changes accelerations by 0."),
                    "{}",
                    found.reason
                );
                assert_eq!(
                    (&found.effects[..1], found.ranked[0].kind.as_str()),
                    (&found.effects[..], FORMULA)
                );
                let c1 = &found.effects[0].parameters[0];
                let (ParameterValue::Number(low), ParameterValue::Number(high)) = (&c1.low, &c1.high) else {
                    panic!("{c1:?}")
                };
                assert!((*low..*high).contains(&-0.25), "{c1:?}");
            }
        }
    }

    #[test]
    fn a_law_foretells_later_frames_only_where_other_videos_bear_it_out() {
        let scenes = film_under(&[vec![(DISC, 0.6, [-2.0, 0.0], [1.5, 0.0])]], |_| {});
        let base = models(&scenes);
        let before =
            revise(&WeakFormRegression::new(&scenes), &base, None, &DiscoverOptions::default().fit, &never);
        let before = Revision { left_out_rmse: 0.08, held_out_rmse: 0.04, ..before.expect("it runs") };
        let after = |left_out_rmse| Revision { left_out_rmse, held_out_rmse: 0.01, ..before.clone() };
        assert!(predicts_held_out(&before, &after(0.07), 0.005));
        assert!(!predicts_held_out(&before, &after(0.1), 0.005));
    }

    #[test]
    fn a_law_is_shown_that_halves_what_is_beyond_the_noise() {
        assert!(halves_excess_error(0.0466, 0.0052, 0.005));
        assert!(halves_excess_error(0.0075, 0.0055, 0.005), "no error falls below the noise");
        assert!(!halves_excess_error(0.00126, 0.00121, 0.00001), "a law of six terms that changes little");
        assert!(!halves_excess_error(0.005, 0.005, 0.005));
    }
}
