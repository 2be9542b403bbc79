//! The account of a search: what was found with its intervals, the ranking, what would have been seen, and why.

use super::contact::ContactCandidate;
use super::contact_law::estimates_of;
use super::free::free_parameters;
use super::jackknife::SharedEstimate;
use super::outcome::{
    DetectionLimit, FoundEffect, NINETY_FIVE, ParameterEstimate, ParameterOwner, ParameterValue,
    RankedEffect, Verdict, reported, widened,
};
use super::proof;
use super::revise::Revision;
use super::screen::{ForceCandidate, LinearisationPoint, region, typical_sd};
use super::search::{FreeMotion, PROOF};
use super::weak_form::{WeakFormRegression, fit_forces};
use crate::effects::{EffectEntry, ParamSpec};
use crate::fit::{Estimate, Fit, SceneFit};
use std::collections::BTreeSet;

/// A fit in trajectory space up to this reduced chi-square has followed the contacts.
pub const FOLLOWED: f64 = 1.3;
/// Lens and trajectories agree on a number within this many deviations.
const AGREE: f64 = 2.0;
/// Surfaces give, and sizes are known no better than positions are measured: deviation of a length, or of an angle seen
/// from a metre away, in deviations of a measured position.
const SURFACE: f64 = 0.5;
/// No surface, and no engine, has a law of contact to better than this share of its numbers (a deviation): where bodies jostle,
/// derivatives grow without end, and a fit's own deviation says what nobody can know.
const NO_NEARER: f64 = 0.02;

/// How many times better than free motion trajectories may tell a number. Beyond, it hangs on a contact whose derivatives grow
/// without end: a narrow minimum, one of many.
const NARROW: f64 = 10.0;

/// What was added first, then the others by evidence.
pub fn ranked(
    motion: &FreeMotion,
    contacts: &[ContactCandidate],
    added: &[&str],
    sigma: f64,
) -> Vec<RankedEffect> {
    let degrees = motion.degrees_of_freedom;
    let mut ranked: Vec<RankedEffect> = motion
        .ranked
        .iter()
        .map(|(score, c)| RankedEffect {
            kind: c.entry.kind.to_string(),
            effect: c.entry.spec.name.to_string(),
            log_evidence: 0.5 * score,
            held_out_rmse: sigma * (c.left_out / degrees).max(0.0).sqrt(),
        })
        .collect();
    ranked.extend(contacts.iter().map(|c| RankedEffect {
        kind: c.entry.kind.to_string(),
        effect: c.entry.spec.name.to_string(),
        log_evidence: 0.5 * c.score,
        held_out_rmse: sigma * c.remains.sqrt(),
    }));
    let place = |r: &RankedEffect| added.iter().position(|n| *n == r.effect).unwrap_or(added.len());
    ranked.sort_by(|a, b| place(a).cmp(&place(b)).then(b.log_evidence.total_cmp(&a.log_evidence)));
    // Of a law that both lenses see, what the one says that sees more of it.
    let mut seen = BTreeSet::new();
    ranked.retain(|r| seen.insert(r.effect.clone()));
    ranked
}

/// An effect of force with its numbers: of the fit in trajectory space where that has followed the contacts and the lens
/// agrees, else of the lens. What rest and contacts do to a trajectory and what smoothing does to the lens is in neither's
/// own deviation: the interval holds both.
pub fn found(
    lens: &WeakFormRegression,
    motion: &FreeMotion,
    c: &ForceCandidate,
    revision: &Revision,
) -> FoundEffect {
    if c.entry.of_objects() {
        return FoundEffect::of(c.entry, by_object(&revision.fit, c.entry));
    }
    let scale = motion.reduced_chi_square().max(1.0).sqrt();
    let (mut values, mut sd) = (c.values.clone(), c.sd.iter().map(|s| s * scale).collect::<Vec<f64>>());
    let scatter = lens.scatter(&motion.models, &motion.free, &motion.seen.values);
    let followed = proof::follows(revision);
    for (k, p) in c.entry.spec.params.iter().enumerate() {
        let name = format!("{}.{}", c.entry.spec.name, p.name);
        if let Some(at) = motion.free.iter().position(|f| f.name == name) {
            values[k] = motion.seen.values[at];
            sd[k] = scatter.as_ref().map_or(sd[k], |all| widened(sd[k], all[at]));
        }
        if let (true, [e]) = (followed, &estimates_of(&revision.fit, c.entry.spec.name, p.name)[..]) {
            let apart = e.value - values[k];
            if apart.abs() < AGREE * sd[k] {
                values[k] = e.value;
            }
            sd[k] = sd[k].hypot(apart);
        }
    }
    FoundEffect::of(c.entry, reported(c.entry, &values, &sd))
}

/// Deviations of a law's numbers, which trajectories have as `told` (values and deviations): of those that are too narrow free
/// motion's, with how far it is from them, where that is followed or trajectories are not.
pub fn plausible(
    lens: &WeakFormRegression,
    fit: &Fit,
    law: &str,
    names: &[&str],
    told: &[(f64, f64)],
) -> Vec<f64> {
    let models = fit.models();
    let own: Vec<String> = names.iter().map(|name| format!("{law}.{name}")).collect();
    // Of a law of contact free motion has no number.
    if !free_parameters(lens.scenes, &models).iter().any(|f| own.contains(&f.name)) {
        return told.iter().map(|t| t.1).collect();
    }
    let (free, seen) = fit_forces(lens, &models);
    let reduced = seen.chi_square / lens.degrees_of_freedom().max(1) as f64;
    let lost = fit.scenes.iter().any(proof::lost);
    let scatter = lens.scatter(&models, &free, &seen.values).filter(|_| lost || reduced < super::MISFIT);
    let one = |(name, &(value, sd)): (&String, &(f64, f64))| {
        let at = free.iter().position(|f| f.name == *name);
        let known = at.zip(scatter.as_ref()).map(|(at, scatter)| {
            widened(seen.sd[at] * reduced.max(1.0).sqrt(), scatter[at]).hypot(value - seen.values[at])
        });
        known.filter(|known| sd > 0.0 && NARROW * sd < *known).unwrap_or(sd)
    };
    own.iter().zip(told).map(one).collect()
}

/// The parameters of a law in which each object differs, object by object: of those that differ from its absence by more
/// than chance, the surest first; where none does, of the one that is nearest to it.
pub fn by_object(fit: &Fit, entry: &EffectEntry) -> Vec<ParameterEstimate> {
    let first: Vec<&Estimate> =
        entry.spec.params.first().map_or(vec![], |p| estimates_of(fit, entry.spec.name, p.name));
    let one = |e: &&Estimate| -> Option<(f64, Vec<ParameterEstimate>)> {
        let object: u32 = e.name.rsplit_once('[')?.1.strip_suffix(']')?.parse().ok()?;
        let label = format!("[{object}]");
        let of = |name: &str| {
            let mut all = estimates_of(fit, entry.spec.name, name).into_iter();
            all.find(|o| o.scene == e.scene && o.name.ends_with(&label))
        };
        let own: Vec<Option<&Estimate>> = entry.spec.params.iter().map(|p| of(p.name)).collect();
        let number =
            |(e, p): (&Option<&Estimate>, &ParamSpec)| e.map_or((p.default, 0.0), |e| (e.value, e.sd));
        let (values, sd): (Vec<f64>, Vec<f64>) = own.iter().zip(entry.spec.params).map(number).unzip();
        let amplitudes = own.iter().take(entry.amplitudes).flatten();
        let sure = amplitudes.map(|e| e.value.abs() / e.sd.max(f64::MIN_POSITIVE));
        let owner =
            ParameterOwner { object, scene: e.scene, identified: own.iter().flatten().all(|e| e.identified) };
        let told =
            reported(entry, &values, &sd).into_iter().map(|r| ParameterEstimate { owner: Some(owner), ..r });
        Some((sure.fold(0.0, f64::max), told.collect()))
    };
    let mut all: Vec<(f64, Vec<ParameterEstimate>)> = first.iter().filter_map(one).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let differ = all.iter().take_while(|o| o.0 > NINETY_FIVE).count();
    all.into_iter().take(differ.max(1)).flat_map(|o| o.1).collect()
}

/// A law of contact with its numbers and their deviations, on one object if it has one.
pub fn found_contact(c: &ContactCandidate, values: &[f64], sd: &[f64]) -> FoundEffect {
    let object = c.object.map(f64::from).map(ParameterValue::Number);
    let object = object.map(|id| ParameterEstimate {
        name: "object_id".into(),
        unit: String::new(),
        value: id.clone(),
        low: id.clone(),
        high: id,
        owner: None,
    });
    let mut parameters = reported(c.entry, values, sd);
    parameters.extend(object);
    FoundEffect::of(c.entry, parameters)
}

/// Numbers of a law of contact and their deviations: those of the `videos` that are followed, else those of short films. Near
/// where surfaces stick and where bodies jostle a fit's own deviation is too small: the interval holds how far the videos
/// disagree, and up to a point how far the short films do.
pub fn contact_numbers(
    c: &ContactCandidate,
    noise_sigma: f64,
    videos: Option<&[Option<SharedEstimate>]>,
) -> (Vec<f64>, Vec<f64>) {
    let scale = c.remains.max(1.0).sqrt();
    let least = |k: usize, value: f64| match c.entry.spec.params[k].unit {
        "m" | "rad" => SURFACE * noise_sigma,
        _ => NO_NEARER * value.abs(),
    };
    let mut sd: Vec<f64> = c.sd.iter().map(|sd| scale * sd).collect();
    let mut values = c.values.clone();
    for (k, value) in values.iter_mut().enumerate() {
        if let Some(s) = videos.and_then(|v| v[k]) {
            let (own, apart) = (s.sd.max(s.scatter), (s.value - *value).abs());
            sd[k] = if own < sd[k] { widened(own, sd[k].hypot(apart.min(AGREE * sd[k]))) } else { own };
            *value = s.value;
        }
        sd[k] = sd[k].max(least(k, *value));
    }
    (values, sd)
}

/// The smallest amplitude of each kind of force that the lens would have proven, at a place or frequency of medium sensitivity; not of
/// one that shows at no size that it may have, nor of what each object has for itself.
pub fn smallest(lens: &WeakFormRegression, motion: &FreeMotion) -> Vec<DetectionLimit> {
    let stand = LinearisationPoint::new(lens, &motion.models, &motion.free, &motion.seen, true);
    let region = region(lens.scenes);
    let unit = motion.reduced_chi_square().max(1.0);
    let one = |c: &ForceCandidate| -> Option<DetectionLimit> {
        let (entry, amplitude): (&'static EffectEntry, _) = (c.entry, c.entry.spec.params.first()?);
        let price = PROOF + c.added as f64 * motion.degrees_of_freedom.ln();
        let value = (price * unit).sqrt() * typical_sd(lens, &stand, entry, &region)?;
        (value <= amplitude.max).then(|| DetectionLimit {
            kind: entry.kind.to_string(),
            effect: entry.spec.name.to_string(),
            parameter: amplitude.name.strip_suffix("_x").unwrap_or(amplitude.name).to_string(),
            value,
            unit: amplitude.unit.to_string(),
        })
    };
    motion.ranked.iter().filter(|(_, c)| !c.entry.of_objects()).filter_map(|(_, c)| one(c)).collect()
}

/// Why the verdict is what it is.
pub fn reason(
    verdict: Verdict,
    motion: &FreeMotion,
    left: &str,
    effects: &[FoundEffect],
    ambiguous: &[Vec<String>],
    written: bool,
    last: Option<&Revision>,
) -> String {
    let mostly_lost = last.is_some_and(|r| proof::loses_most(&r.fit));
    let off = last.is_some_and(|r| r.reduced_chi_square > super::MISFIT);
    let names: Vec<&str> = effects.iter().map(|e| e.kind.as_str()).collect();
    match verdict {
        Verdict::EffectFound => {
            let what = if mostly_lost { "a part of the motion" } else { "the motion" };
            let explain = if names.len() == 1 { "explains" } else { "explain" };
            format!("{} {explain} {what}; {left} remains", names.join(" and "))
        }
        Verdict::Ambiguous => format!(
            "{} explain the motion equally well; film the launch given as experiment",
            ambiguous.iter().map(|set| set.join(" or ")).collect::<Vec<_>>().join("; ")
        ),
        Verdict::Adequate if mostly_lost => {
            format!(
                "between contacts nothing is missing that the library has; {left}, but contacts are not explained: film single ones"
            )
        }
        Verdict::Adequate if off && motion.reduced_chi_square() > super::MISFIT => format!(
            "nothing is missing that more than one object shows; {left}, as one object moves as nothing explains: it may have \
             met something; diagnose shows where"
        ),
        Verdict::Adequate if off => format!(
            "nothing is proven to be missing; {left}, but past contacts more remains: film more, and single contacts"
        ),
        Verdict::Adequate => format!("nothing is missing at this noise; {left}"),
        Verdict::OutsideLibrary if written && motion.trimmed_chi_square <= super::MISFIT => {
            "the formula explains the motion better than any law of the library, and is as simple".into()
        }
        Verdict::OutsideLibrary if motion.trimmed_chi_square <= super::MISFIT => {
            "between contacts the motion is explained, what contacts do is not; film single contacts".into()
        }
        Verdict::OutsideLibrary => {
            let formula = match written {
                true => "the formula says more",
                false => {
                    "no formula that was tried halves_excess_error the error on frames that it has not seen"
                }
            };
            let after = if effects.is_empty() { "" } else { " after its best" };
            format!("no law of the library is the one; {left} remains{after}, and {formula}")
        }
        Verdict::NotIdentifiable => String::new(),
    }
}

/// What to say of the videos that the trajectories do not follow, though between contacts nothing is missing there.
pub fn unfollowed(last: &Revision) -> String {
    let mut lost: Vec<&SceneFit> = last.fit.scenes.iter().filter(|s| proof::lost(s)).collect();
    lost.sort_by(|a, b| b.reduced_chi_square.total_cmp(&a.reduced_chi_square));
    let Some(worst) = lost.first() else { return String::new() };
    let others = match lost.len() {
        1 => String::new(),
        n => format!(" and {} more", n - 1),
    };
    format!(
        "; the simulation does not follow {}{others} (reduced chi-square {:.0}): its contacts are chaotic or unlike the \
         model's, or its law is another; compare shows where",
        worst.name, worst.reduced_chi_square
    )
}

#[cfg(test)]
mod tests {
    use super::super::change::{ModelChange, Origin, change};
    use super::super::tests::{CUBE, DISC, film, models};
    use super::super::verdict::DiscoverOptions;
    use super::*;
    use crate::num::never;

    #[test]
    fn a_number_that_trajectories_know_far_too_well_is_as_uncertain_as_by_free_motion() {
        let launch = |v: f64| vec![(DISC, 0.6, [-1.5, 0.0], [v, 0.2]), (CUBE, 0.8, [1.0, 1.5], [-0.5, 0.3])];
        let scenes = film(&[launch(1.0), launch(1.6)], Some(("linear_drag", &[("c", 0.3)])));
        let (base, options) = (models(&scenes), DiscoverOptions::default().fit);
        let asked = ModelChange::Add("linear_drag".into());
        let made = change(&scenes, &Origin::Start(&base), &asked, &options, &never).expect("it runs");
        let lens = WeakFormRegression::new(&scenes);
        let sd = |told| plausible(&lens, &made.after.fit, "linear_drag", &["c"], &[told])[0];
        assert_eq!([sd((0.3, 0.01)), sd((0.3, 0.0))], [0.01, 0.0], "what is fixed stays so");
        let (near, far) = (sd((0.3, 1e-9)), sd((0.5, 1e-9)));
        assert!((1e-3..0.1).contains(&near) && far > 0.1, "{near} {far}");
    }
}
