//! Whether trajectories bear out what the lenses found: a law that is there lowers their error too.

use super::cost::Cost;
use super::intervals::FOLLOWED;
use super::revise::Revision;
use super::search::{ALIKE, CLEAN};
use crate::fit::{Fit, SceneFit};
use crate::num::elementary;
use crate::world::ActiveEffect;

/// What a law leaves that explains trajectories, as a share of what there was without it.
const LITTLE: f64 = 0.4;
/// The same of one that acts beside what engines do.
const NOTICEABLY: f64 = 0.7;
/// Reduced chi-square beyond which a trajectory is lost: chaos decides it, not a law.
const LOST: f64 = 4.0;

/// A gain of one scene that is more than what an engine does at a contact (twice a log likelihood).
const MUCH: f64 = 40.0;
/// A model foretells less whose error is this many times as large; a law of contact changes nothing between contacts.
pub const LESS: f64 = 1.01;
/// A scene is mended that was off the noise by more than this, and is nearer by this factor (reduced chi-square); one that
/// is still lost, by that.
const WELL: f64 = 1.5;
const MENDED: f64 = 2.0;
const MOSTLY_MENDED: f64 = 10.0;

/// Whether a trajectory is lost.
pub fn lost(scene: &SceneFit) -> bool {
    scene.reduced_chi_square > LOST
}

/// How many of its scenes a fit loses.
pub fn losses(fit: &Fit) -> usize {
    fit.scenes.iter().filter(|s| lost(s)).count()
}

/// Whether a fit loses one of its scenes.
pub fn loses(fit: &Fit) -> bool {
    losses(fit) > 0
}

/// Whether an effect follows every trajectory to the noise, with numbers in common.
pub fn explains_all(revision: &Revision) -> bool {
    revision.effect.is_some() && revision.unpooled.is_empty() && revision.fit.scenes.iter().all(is_clean)
}

/// Whether an effect follows the trajectories to the noise, all of them pooled, with numbers in common.
pub fn explains_together(revision: &Revision) -> bool {
    revision.effect.is_some() && revision.unpooled.is_empty() && revision.reduced_chi_square <= 1.0 + CLEAN
}

/// Whether trajectories are followed through their contacts, with numbers in common.
pub fn follows(revision: &Revision) -> bool {
    revision.unpooled.is_empty() && revision.reduced_chi_square < FOLLOWED
}

/// Whether a trajectory is followed to the noise.
fn is_clean(scene: &SceneFit) -> bool {
    scene.reduced_chi_square <= 1.0 + CLEAN
}

/// Whether trajectories are followed to the noise, or three of four of them.
pub fn at_noise(revision: &Revision) -> bool {
    let scenes = &revision.fit.scenes;
    let near = scenes.iter().filter(|s| is_clean(s)).count();
    revision.reduced_chi_square <= 1.0 + CLEAN || (4 * near >= 3 * scenes.len() && revision.effect.is_some())
}

/// Whether the trajectories of `after` are nearer to what was measured than those of `before`, and bend beliefs less, the
/// price of the added parameters paid (BIC with a misfit of its own in each scene, so that no single one decides). A scene
/// that neither follows says nothing; where that is so of all, free motion decides, each video left out in turn. A law that
/// foretells less, of the last frames and of the other videos, is none.
pub fn is_supported(before: &Revision, after: &Revision, added: usize) -> bool {
    let (before_fit, after_fit) = (&before.fit.scenes, &after.fit.scenes);
    let told: Vec<bool> = before_fit.iter().zip(after_fit).map(|(b, a)| !(lost(b) && lost(a))).collect();
    let count: usize =
        after_fit.iter().zip(&told).filter(|(_, t)| **t).map(|(a, _)| a.degrees_of_freedom).sum();
    if count == 0 {
        return after.left_out_rmse < before.left_out_rmse;
    }
    if after.left_out_rmse > LESS * before.left_out_rmse && after.held_out_rmse > LESS * before.held_out_rmse
    {
        return false;
    }
    let added_before = before.effect.as_deref().filter(|law| after.effect.as_deref() == Some(law));
    let prior_penalty = |r: &Revision, law| Cost::of(&r.fit, law).prior_penalty(|k| told[k]);
    // What the model expected of the law is bent only where the law was not added.
    let unbent = prior_penalty(before, added_before) - prior_penalty(after, after.effect.as_deref());
    let nearer: f64 =
        before_fit.iter().zip(after_fit).zip(&told).filter(|(_, t)| **t).map(|((b, a), _)| gain(b, a)).sum();
    // A scene with numbers of its own has paid for none of them yet; one that says nothing need not.
    let own = |r: &Revision| {
        let named = |k: usize| r.unpooled.contains(&r.fit.scenes[k].name);
        ((0..told.len()).filter(|&k| told[k] && named(k)).count() * shared(r)) as f64
    };
    let price = added as f64 + own(after) - own(before);
    nearer + unbent > price * elementary::ln(count as f64)
}

/// How much nearer to what was measured the trajectory of `after` is (twice a log likelihood, the noise unknown).
fn gain(before: &SceneFit, after: &SceneFit) -> f64 {
    let ratio = before.reduced_chi_square / after.reduced_chi_square.max(f64::MIN_POSITIVE);
    after.degrees_of_freedom as f64 * elementary::ln(ratio)
}

/// Whether half of the scenes, or more, are off their noise: chaos alone loses one or the other of several.
pub fn astray(fit: &Fit) -> bool {
    let off = fit.scenes.iter().filter(|s| s.reduced_chi_square > WELL).count();
    2 * off >= fit.scenes.len()
}

/// Whether a fit loses more than half of its scenes.
pub fn loses_most(fit: &Fit) -> bool {
    2 * losses(fit) > fit.scenes.len()
}

/// How far a fit is from what was measured and believed (twice a negative log likelihood, the noise unknown).
pub fn deviance(fit: &Fit) -> f64 {
    let of = |s: &SceneFit| s.degrees_of_freedom as f64 * elementary::ln(s.reduced_chi_square);
    fit.scenes.iter().map(of).sum::<f64>() + Cost::of(fit, None).prior_penalty(|_| true)
}

/// The kinds of laws, given with their number of parameters and the deviance of their trajectories, that the best does not beat by
/// odds of 20 to 1, those of fewest parameters first; empty if there is one. `fit` is one of theirs.
pub fn alike_kinds(laws: &[(usize, &str, f64)], fit: &Fit) -> Vec<String> {
    let degrees: f64 = fit.scenes.iter().map(|s| s.degrees_of_freedom as f64).sum();
    let priced = |&(added, _, deviance): &(usize, &str, f64)| {
        deviance + added as f64 * elementary::ln(degrees.max(2.0))
    };
    let least = laws.iter().map(priced).fold(f64::INFINITY, f64::min);
    let mut near: Vec<(usize, &str)> =
        laws.iter().filter(|law| priced(law) - least < ALIKE).map(|law| (law.0, law.1)).collect();
    near.sort_unstable();
    let mut kinds: Vec<String> = vec![];
    for (_, kind) in near {
        if !kinds.iter().any(|known| known == kind) {
            kinds.push(kind.into());
        }
    }
    if kinds.len() > 1 { kinds } else { vec![] }
}

/// Whether a fit is much nearer than another.
pub fn nearer(before: &Fit, after: &Fit) -> bool {
    much_nearer(deviance(before), deviance(after))
}

/// The same of distances.
pub fn much_nearer(before: f64, after: f64) -> bool {
    after < before - MUCH
}

/// The same by the scenes that one of them follows, if there are any: by how much others are lost is a matter of chaos.
pub fn follows_better(before: &Fit, after: &Fit) -> bool {
    let pairs = || before.scenes.iter().zip(&after.scenes).filter(|(b, a)| !(lost(b) && lost(a)));
    match pairs().next() {
        Some(_) => pairs().map(|(b, a)| gain(b, a)).sum::<f64>() > MUCH,
        None => nearer(before, after),
    }
}

/// Whether most scenes are lost in both, and the others are as near: then trajectories say nothing.
pub fn uninformative(before: &Fit, after: &Fit) -> bool {
    let both = before.scenes.iter().zip(&after.scenes).filter(|(b, a)| lost(b) && lost(a)).count();
    let most = 2 * both > before.scenes.len();
    most && (both == before.scenes.len() || !follows_better(after, before))
}

/// How many scenes are followed much better than before.
pub fn gained(before: &Fit, after: &Fit) -> usize {
    let pairs = before.scenes.iter().zip(&after.scenes);
    pairs.filter(|(b, a)| gain(b, a) > MUCH).count()
}

/// Which scenes are followed much worse than before.
pub fn farther(before: &Fit, after: &Fit) -> Vec<bool> {
    before.scenes.iter().zip(&after.scenes).map(|(b, a)| !lost(b) && gain(a, b) > MUCH).collect()
}

/// How much nearer all scenes are but the one that gains most (twice a log likelihood, the noise unknown).
pub fn fall_without_best_scene(before: &Fit, after: &Fit) -> f64 {
    let gains: Vec<f64> = before.scenes.iter().zip(&after.scenes).map(|(b, a)| gain(b, a)).collect();
    gains.iter().sum::<f64>() - gains.iter().copied().fold(0.0, f64::max)
}

/// Whether a fit follows at least two scenes much better that another does not: one may be lost, and found, by chance.
pub fn mends(before: &[SceneFit], after: &[SceneFit]) -> bool {
    let recovers = |(b, a): &(&SceneFit, &SceneFit)| {
        let factor = if lost(a) { MOSTLY_MENDED } else { MENDED };
        b.reduced_chi_square > f64::max(WELL, factor * a.reduced_chi_square)
    };
    before.iter().zip(after).filter(recovers).count() > 1
}

/// What fits leave beyond the noise (reduced chi-squares less one).
fn beyond(fits: &[SceneFit]) -> f64 {
    fits.iter().map(|s| (s.reduced_chi_square - 1.0).max(0.0)).sum()
}

/// Whether a fit leaves noticeably less beyond the noise than another: any law takes up some of what an engine does.
pub fn lessens(before: &Fit, after: &Fit) -> bool {
    beyond(&after.scenes) < NOTICEABLY * beyond(&before.scenes)
}

/// Whether a fit leaves little of what another leaves beyond the noise, and nothing in half of the scenes.
pub fn explains(before: &[SceneFit], after: &[SceneFit]) -> bool {
    let clean = after.iter().filter(|s| s.reduced_chi_square < FOLLOWED).count();
    2 * clean >= after.len() && beyond(after) < LITTLE * beyond(before)
}

/// Whether a fit follows a scene to its noise that another loses.
pub fn finds(before: &[SceneFit], after: &[SceneFit]) -> bool {
    before.iter().zip(after).any(|(b, a)| lost(b) && a.reduced_chi_square < WELL)
}

/// How many free numbers the scenes of a revision share.
fn shared(revision: &Revision) -> usize {
    let effects = revision.fit.scenes.first().map_or(&[][..], |s| &s.model.effects);
    let of = |e: &ActiveEffect| {
        let free = e.parameters.iter().filter(|p| p.prior.sd > 0.0 && e.shares(p));
        free.map(|p| p.labels.len()).sum::<usize>()
    };
    effects.iter().filter(|e| e.on).map(of).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::effect;
    use crate::world::Model;

    fn fits(chi_squares: [f64; 3]) -> [SceneFit; 3] {
        chi_squares.map(|reduced_chi_square| SceneFit {
            name: String::new(),
            model: Model {
                preset: String::new(),
                bodies: vec![],
                walls: vec![],
                effects: vec![],
                mass_sd: 0.0,
                spin_sd: 0.0,
                corrections: vec![],
                impulses: vec![],
            },
            noise_sigma: 0.005,
            noise_yaw: None,
            rmse: 0.005,
            reduced_chi_square,
            degrees_of_freedom: 100,
            adequate: reduced_chi_square < WELL,
        })
    }

    fn fit(chi_squares: [f64; 3]) -> Fit {
        Fit {
            scenes: fits(chi_squares).to_vec(),
            posterior: Default::default(),
            iterations: 0,
            outcome: crate::fit::Termination::Converged,
            losses: vec![],
        }
    }

    #[test]
    fn what_neither_follows_says_nothing() {
        let better = |before, after| follows_better(&fit(before), &fit(after));
        assert!(better([45.0, 7.1, 1.0], [402.0, 1.7, 1.1]), "it follows one more");
        assert!(!better([402.0, 1.7, 1.1], [45.0, 7.1, 1.0]));
        assert!(better([402.0, 90.0, 80.0], [45.0, 70.0, 10.0]), "none is followed");
        let uninformative = |before, after| uninformative(&fit(before), &fit(after));
        assert!(uninformative([5.2, 94.0, 1.0], [39.9, 102.0, 1.0]));
        assert!(
            !uninformative([5.2, 94.0, 1.0], [39.9, 102.0, 2.0]),
            "the one that is followed speaks against it"
        );
        assert!(!uninformative([1.2, 94.0, 1.0], [1.1, 102.0, 1.0]), "most are followed");
    }

    /// Numbers of its own in a scene that neither follows are no gift to the law that does without.
    #[test]
    fn a_lost_scene_pays_no_price() {
        let revision = |unpooled: &[&str]| {
            let mut fit = fit([480.0, 1.0, 1.0]);
            for (k, scene) in fit.scenes.iter_mut().enumerate() {
                let mut active = ActiveEffect::new(&effect("tilt").expect("it is there").spec, &[]);
                for p in &mut active.parameters {
                    (p.prior.sd, p.labels) = (1.0, vec![String::new()]);
                }
                scene.model.effects.push(active);
                scene.name = k.to_string();
            }
            let unpooled = unpooled.iter().map(|s| s.to_string()).collect();
            let [rmse, held_out_rmse, left_out_rmse] = [0.01; 3];
            Revision {
                effect: None,
                fit,
                rmse,
                held_out_rmse,
                left_out_rmse,
                reduced_chi_square: 160.0,
                unpooled,
            }
        };
        assert!(!is_supported(&revision(&["0"]), &revision(&[]), 1));
        assert!(is_supported(&revision(&["1"]), &revision(&[]), 1), "two numbers of its own in place of one");
    }

    #[test]
    fn what_is_followed_worse_begins_again_and_what_was_lost_does_not() {
        assert_eq!(farther(&fit([1.2, 1.2, 9.0]), &fit([1.9, 1.3, 40.0])), [true, false, false]);
    }

    #[test]
    fn one_video_of_three_may_be_lost_to_chaos() {
        let (one, two) = (fit([1.0, 90.0, 1.2]), fit([1.0, 90.0, 1.7]));
        assert_eq!((losses(&one), astray(&one)), (1, false));
        assert_eq!((losses(&two), astray(&two)), (1, true));
    }

    #[test]
    fn a_law_that_explains_leaves_little_and_half_of_the_videos_clean() {
        let explained = |before, after| explains(&fits(before), &fits(after));
        assert!(explained([1.9, 2.0, 3.2], [1.1, 1.2, 1.9]));
        assert!(!explained([1.9, 2.0, 3.2], [1.1, 1.4, 1.4]), "only one is clean");
        assert!(!explained([1.9, 2.0, 3.2], [1.1, 1.2, 2.9]), "too much is left");
    }

    #[test]
    fn a_law_that_takes_up_a_little_of_what_is_left_does_not_lessen_it() {
        assert!(!lessens(&fit([1.4, 1.2, 1.1]), &fit([1.3, 1.2, 1.1])));
        assert!(lessens(&fit([1.4, 1.2, 1.1]), &fit([1.1, 1.1, 1.1])));
        assert!(!lessens(&fit([0.9, 1.0, 0.8]), &fit([0.7, 0.9, 0.8])));
    }

    #[test]
    fn two_videos_must_be_mended_and_what_stays_lost_tenfold() {
        let recovers = |before, after| mends(&fits(before), &fits(after));
        assert!(recovers([9.0, 1.0, 2.5], [1.1, 1.0, 1.0]));
        assert!(!recovers([9.0, 1.0, 1.4], [1.1, 1.0, 0.6]), "what was at the noise needs no law");
        assert!(!recovers([9.0, 1.0, 63.0], [1.1, 1.0, 30.0]), "lost, and only twice as near");
        assert!(recovers([9.0, 1.0, 63.0], [1.1, 1.0, 5.4]));
    }
}
