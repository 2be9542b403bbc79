//! The account of a search: what was found with its intervals, the ranking, what would have been seen, and why.

use super::contact::{self, ContactCandidate};
use super::contact_law::estimates_of;
use super::free::free_parameters;
use super::jackknife::SharedEstimate;
use super::negligible::{frame, longest_contact};
use super::outcome::{
    DetectionLimit, FoundEffect, NINETY_FIVE, ParameterEstimate, ParameterOwner, ParameterValue,
    RankedEffect, Verdict, reported,
};
use super::proof;
use super::revise::Revision;
use super::screen::{ForceCandidate, LinearisationPoint, detectable, region};
use super::search::{ELSEWHERE, FreeMotion, PROOF};
use super::weak_form::{WeakFormRegression, fit_forces};
use crate::effects::{EffectEntry, ObstacleForm, ParamId, ParamSpec, SearchStart, effect};
use crate::fit::{Estimate, Fit, SceneFit, widened};
use crate::num::elementary;
use crate::world::{EventKind, trace};

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

/// The end of a table that objects hit is known to better than this share of the table (a standard deviation).
const REACHED: f64 = 0.1;

/// Proof that windows around contacts ask for, as that of free motion.
const CONTACT_PROOF: f64 = contact::PROOF;

/// How many times better than free motion trajectories may tell a number. Beyond, it hangs on a contact whose derivatives grow
/// without end: a narrow minimum, one of many.
const NARROW: f64 = 10.0;

/// What was added first, then the others by evidence; `formulas` are the users' laws, as free motion has them.
pub fn ranked(
    motion: &FreeMotion,
    formulas: Vec<RankedEffect>,
    contacts: &[ContactCandidate],
    added: &[&str],
    sigma: f64,
) -> Vec<RankedEffect> {
    let degrees = motion.degrees_of_freedom;
    let of_motion = motion.ranked.iter().map(|(score, c)| {
        let held_out_rmse = sigma * (c.left_out / degrees).max(0.0).sqrt();
        RankedEffect::of_free_motion(c.entry.kind, c.entry.spec.name, 0.5 * score, held_out_rmse)
    });
    let of_contacts =
        contacts.iter().map(|c| RankedEffect::of_contacts(c.entry.kind, c.entry.spec.name, 0.5 * c.score));
    merged(of_motion.chain(formulas).collect(), of_contacts.collect(), added)
}

/// One row an effect, with what either data set says of it. Evidence is compared within one data set only: of the two, those
/// come first that have the proof that their own data set asks for, then those that it speaks for, free motion before contacts.
fn merged(motion: Vec<RankedEffect>, contacts: Vec<RankedEffect>, added: &[&str]) -> Vec<RankedEffect> {
    let mut rows: Vec<RankedEffect> = vec![];
    for row in motion.into_iter().chain(contacts) {
        match rows.iter_mut().find(|known| known.effect == row.effect) {
            Some(known) => {
                let most = |a: Option<f64>, b: Option<f64>| a.into_iter().chain(b).reduce(f64::max);
                if row.log_evidence > known.log_evidence {
                    known.held_out_rmse = row.held_out_rmse;
                }
                known.log_evidence = most(known.log_evidence, row.log_evidence);
                known.contact_log_evidence = most(known.contact_log_evidence, row.contact_log_evidence);
            }
            None => rows.push(row),
        }
    }
    let class = |evidence: f64, proof: f64| match evidence {
        e if e > 0.5 * proof => 0,
        e if e > 0.0 => 1,
        _ => 2,
    };
    let key = |r: &RankedEffect| {
        let motion = r.log_evidence.map(|e| (class(e, PROOF), 0, e));
        let contacts = r.contact_log_evidence.map(|e| (class(e, CONTACT_PROOF), 1, e));
        let best = motion.into_iter().chain(contacts).min_by_key(|(class, data, _)| (*class, *data));
        let place = added.iter().position(|n| *n == r.effect).unwrap_or(added.len());
        let (class, data, evidence) = best.unwrap_or((2, 2, 0.0));
        (place, class, data, evidence)
    };
    rows.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        (a.0, a.1, a.2).cmp(&(b.0, b.1, b.2)).then(b.3.total_cmp(&a.3))
    });
    rows
}

/// An effect of force with its numbers: of the fit in trajectory space, as the revision's model has them, where that has followed
/// the contacts; else of the lens. What rest and contacts do to a trajectory and what smoothing does to the lens is in neither's
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
        let name = ParamId { effect: c.entry.spec.name, parameter: p.name, label: "" }.to_string();
        if let Some(at) = motion.free.iter().position(|f| f.name == name) {
            values[k] = motion.seen.values[at];
            sd[k] = scatter.as_ref().map_or(sd[k], |all| widened(sd[k], all[at]));
        }
        if let (true, [e]) = (followed, &estimates_of(&revision.fit, c.entry.spec.name, p.name)[..]) {
            sd[k] = elementary::hypot(sd[k], e.value - values[k]);
            values[k] = e.value;
        }
    }
    FoundEffect::with_numbers(c.entry, &values, &sd)
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
    let id = |parameter| ParamId { effect: law, parameter, label: "" };
    let own: Vec<String> = names.iter().map(|name| id(name).to_string()).collect();
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
            elementary::hypot(
                widened(seen.sd[at] * reduced.max(1.0).sqrt(), scatter[at]),
                value - seen.values[at],
            )
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
        let object = ParamId::parse(&e.name)?.object()?;
        let of = |name: &str| {
            let mut all = estimates_of(fit, entry.spec.name, name).into_iter();
            all.find(|o| {
                o.scene == e.scene && ParamId::parse(&o.name).is_some_and(|id| id.object() == Some(object))
            })
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
        sd: vec![0.0],
        owner: None,
    });
    let mut found = FoundEffect::with_numbers(c.entry, values, sd);
    found.parameters.extend(object);
    found
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
            sd[k] = if own < sd[k] {
                widened(own, elementary::hypot(sd[k], apart.min(AGREE * sd[k])))
            } else {
                own
            };
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
        let price = PROOF + c.added as f64 * elementary::ln(motion.degrees_of_freedom);
        let value = detectable(lens, &stand, entry, &region, [price * unit, ELSEWHERE])?;
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
    last: Option<(&Revision, bool)>,
) -> String {
    let mostly_lost = last.is_some_and(|(r, _)| proof::loses_most(&r.fit));
    let off = last.is_some_and(|(r, _)| r.reduced_chi_square > super::MISFIT);
    let contacts = last.is_some_and(|(_, contacts)| contacts);
    let names: Vec<&str> = effects.iter().map(|e| e.kind.as_str()).collect();
    match verdict {
        Verdict::EffectFound => {
            let what = if mostly_lost { "a part of the motion" } else { "the motion" };
            let explain = if names.len() == 1 { "explains" } else { "explain" };
            format!("{} {explain} {what}; {left} remains", names.join(" and "))
        }
        Verdict::Ambiguous => format!(
            "{} explain the motion equally well; record the launch given as experiment",
            ambiguous.iter().map(|set| set.join(" or ")).collect::<Vec<_>>().join("; ")
        ),
        Verdict::Adequate if mostly_lost && !contacts => {
            format!(
                "no effect of the library is missing piece by piece; {left}, but whole tracks are not explained"
            )
        }
        Verdict::Adequate if mostly_lost => {
            format!(
                "between contacts no effect of the library is missing; {left}, but the contacts are not explained: record isolated contacts"
            )
        }
        Verdict::Adequate if off && motion.reduced_chi_square() > super::MISFIT => format!(
            "no effect is missing that more than one object shows; {left}, because one object moves in a way no effect explains \
             (perhaps an unseen contact); run `diagnose` to see where"
        ),
        Verdict::Adequate if off => format!(
            "no effect is proven to be missing; {left}, but more remains after contacts: record more videos, and isolated contacts"
        ),
        Verdict::Adequate => format!("nothing is missing at this noise; {left}"),
        Verdict::OutsideLibrary if written && motion.trimmed_chi_square <= super::MISFIT => {
            "the formula explains the motion better than any effect of the library, with no more parameters"
                .into()
        }
        Verdict::OutsideLibrary if motion.trimmed_chi_square <= super::MISFIT => {
            "the motion is explained between contacts, but not at contacts: record isolated contacts".into()
        }
        Verdict::OutsideLibrary => {
            let formula = match written {
                true => "the formula explains more",
                false => "no formula tried halves the error on held-out frames",
            };
            let after = if effects.is_empty() { "" } else { " after the best of them" };
            format!("no effect of the library explains the motion; {left} remains{after}, and {formula}")
        }
        Verdict::NotIdentifiable => String::new(),
    }
}

/// The amplitudes of the laws of force that the videos do not tell apart: what is known whichever acts.
pub fn numbers_of_rivals(
    motion: &FreeMotion,
    ambiguous: &[Vec<String>],
    substitutes: &[Vec<ForceCandidate>],
) -> String {
    let of_kind = |kind: &String| {
        let mut known = substitutes.iter().flatten().chain(motion.ranked.iter().map(|(_, c)| c));
        known.find(|c| c.entry.kind == kind && !c.entry.of_objects())
    };
    let numbers = |c: &ForceCandidate| -> String {
        let scale = motion.reduced_chi_square().max(1.0).sqrt();
        let of = c.entry.spec.params.iter().zip(&c.values).zip(&c.sd).take(c.entry.amplitudes);
        let one = |((p, value), sd): ((&ParamSpec, &f64), &f64)| {
            let sd = sd * scale;
            let decimals = decimals(sd);
            format!("{} {value:.decimals$} ± {sd:.decimals$} {}", p.name, p.unit)
        };
        format!("{}: {}", c.entry.kind, of.map(one).collect::<Vec<_>>().join(", "))
    };
    let all: Vec<String> = ambiguous.iter().flatten().filter_map(of_kind).map(numbers).collect();
    if all.is_empty() { String::new() } else { format!(" ({})", all.join("; ")) }
}

/// How long contacts last by a law that was found.
pub fn contact_duration(lens: &WeakFormRegression, last: &Revision, effects: &[FoundEffect]) -> String {
    let takes_time = |e: &&EffectEntry| matches!(e.profile.start, Some(SearchStart::ContactFrames(_)));
    let Some(entry) = effects.iter().filter_map(|e| effect(&e.effect)).find(takes_time) else {
        return String::new();
    };
    let models = last.fit.models();
    let active = models.first().and_then(|m| m.effect(entry.spec.name));
    let values: Vec<f64> =
        active.map_or(vec![], |e| e.parameters.iter().filter_map(|p| p.values.first().copied()).collect());
    if values.len() < entry.spec.params.len() {
        return String::new();
    }
    let time = longest_contact(entry, &values, &models);
    format!("; contacts last up to {:.0} ms ({:.1} frames)", 1e3 * time, time / frame(lens.scenes))
}

/// A length (m) rounded to what a statement of a table needs.
fn tenths_of_a_millimetre(length: f64) -> f64 {
    (length * 1e4).round() / 1e4 + 0.0
}

/// Decimals that show two digits of a standard deviation, or three where there is none.
fn decimals(sd: f64) -> usize {
    let digits = 1.0 - elementary::ln(sd) / std::f64::consts::LN_10;
    if digits.is_finite() { digits.ceil().clamp(0.0, 12.0) as usize } else { 3 }
}

/// The line that states the walls that were found around the objects, so that the next fit knows them; none where an end of them
/// is not known to better than a tenth of what lies between.
pub fn table_advice(effects: &[FoundEffect]) -> String {
    let around =
        |e: &&FoundEffect| effect(&e.effect).is_some_and(|e| e.obstacle() == Some(ObstacleForm::Rectangle));
    let Some(found) = effects.iter().find(around) else { return String::new() };
    let sides: Vec<(f64, f64)> = found
        .parameters
        .iter()
        .filter(|p| p.unit == "m")
        .filter_map(|p| match p.value {
            // Without the sign of a zero.
            ParameterValue::Number(value) => {
                Some((tenths_of_a_millimetre(value), p.sd.first().copied().unwrap_or(f64::INFINITY)))
            }
            _ => None,
        })
        .collect();
    let [(left, a), (right, b), (bottom, c), (top, d)] = sides[..] else { return String::new() };
    if a.max(b) > REACHED * (right - left) || c.max(d) > REACHED * (top - bottom) {
        return "; walls stand around the objects: state the table of each file with a line `# table: LEFT RIGHT BOTTOM TOP` (m)"
            .into();
    }
    format!(
        "; walls stand around the objects: state them in each file with the line `# table: {left:.4} {right:.4} {bottom:.4} {top:.4}`"
    )
}

/// Whether objects come near each other in one of these videos, or collide in its simulation.
pub fn has_contacts(lens: &WeakFormRegression, last: &Revision, these: impl Fn(&SceneFit) -> bool) -> bool {
    let mut these = last.fit.scenes.iter().enumerate().filter(|(_, s)| these(s));
    let touches = |(k, fitted): (usize, &SceneFit)| {
        let near = lens.paths[k].iter().any(|path| !path.near.is_empty());
        let times = &lens.scenes[k].times;
        near || trace(&fitted.model, times).events.iter().any(|e| e.kind == EventKind::Collision)
    };
    these.any(touches)
}

#[cfg(test)]
mod tests {
    use super::super::change::{Origin, change};
    use super::super::discovery::discover;
    use super::super::proposal::ModelChange;
    use super::super::tests::{CUBE, DISC, film, models};
    use super::super::verdict::DiscoverOptions;
    use super::*;
    use crate::fit::{FitOptions, StartPoint, estimate};
    use crate::num::never;

    fn row(effect: &str, motion: Option<f64>, contacts: Option<f64>) -> RankedEffect {
        let (kind, effect) = (effect.into(), effect.into());
        RankedEffect {
            kind,
            effect,
            log_evidence: motion,
            contact_log_evidence: contacts,
            held_out_rmse: None,
        }
    }

    #[test]
    fn evidence_of_free_motion_and_of_contacts_is_never_compared() {
        let of_motion = |effect: &str, e: f64| row(effect, Some(e), None);
        let of_contacts = |effect: &str, e: f64| row(effect, None, Some(e));
        let names = |motion: &[RankedEffect], contacts: &[RankedEffect], added: &[&str]| -> Vec<String> {
            merged(motion.to_vec(), contacts.to_vec(), added).into_iter().map(|r| r.effect).collect()
        };
        let motion = [of_motion("drag", 30.0), of_motion("wind", 4.0), of_motion("tilt", -3.0)];
        let contacts = [of_contacts("mass", 900.0), of_contacts("size", 19.0), of_contacts("size", 12.0)];
        assert_eq!(names(&motion, &contacts, &[]), ["drag", "mass", "wind", "size", "tilt"]);
        // However large the numbers of one data set are, they move nothing of the other.
        let larger = contacts.clone().map(|r| RankedEffect {
            contact_log_evidence: r.contact_log_evidence.map(|e| if e > 20.0 { 1e6 * e } else { e }),
            ..r
        });
        assert_eq!(names(&motion, &larger, &[]), names(&motion, &contacts, &[]));
        assert_eq!(names(&motion, &contacts, &["size"])[0], "size");
        let both = merged(vec![of_motion("marker", 1.0)], vec![of_contacts("marker", 50.0)], &[]);
        assert_eq!(both, [row("marker", Some(1.0), Some(50.0))]);
    }

    /// Windows around contacts are all fitted: none is held out. Whole trajectories give no priced evidence.
    #[test]
    fn what_was_not_measured_is_left_empty() {
        let contacts = RankedEffect::of_contacts("mass_change", "mass_change", 50.0);
        assert_eq!((contacts.log_evidence, contacts.held_out_rmse), (None, None));
        let launch = vec![(DISC, 0.6, [-1.5, 0.0], [1.0, 0.2])];
        let scenes = film(&[launch], None);
        let options = DiscoverOptions::default().fit;
        let lens = WeakFormRegression::new(&scenes);
        let revision = super::super::revise::revise(&lens, &models(&scenes), None, &options, &never);
        let revision = revision.expect("it can be fitted");
        let spin = RankedEffect::of_trajectories("ball_spin", "ball_spin", &revision);
        assert_eq!((spin.log_evidence, spin.contact_log_evidence), (None, None));
        assert_eq!(spin.held_out_rmse, Some(revision.left_out_rmse));
    }

    /// What `discover` and `revise` report of a law, and what fits, traces and reports have of its revision, is one posterior.
    #[test]
    fn a_law_and_its_revision_have_one_uncertainty() {
        let launch = |v: f64| vec![(DISC, 0.6, [-1.5, 0.0], [v, 0.2]), (CUBE, 0.8, [1.0, 1.5], [-0.5, 0.3])];
        // The videos disagree, which the noise does not explain.
        let with = |c: f64, speeds: [f64; 2]| film(&speeds.map(launch), Some(("linear_drag", &[("c", c)])));
        let scenes = [with(0.30, [1.0, 1.6]), with(0.315, [1.3, 2.2])].concat();
        let (base, options) = (models(&scenes), DiscoverOptions::default());
        let asked = ModelChange::Add("linear_drag".into());
        let made = change(&scenes, &Origin::Start(&base), &asked, &options.fit, &never).expect("it runs");
        let found = discover(&scenes, &base, &options, &never).expect("it runs");
        let last = found.revisions.last().expect("the first is always there");
        let near = FitOptions { start_point: StartPoint::NearOptimum, ..options.fit };
        let again = estimate(&scenes, &made.after.fit.models(), &near, &never).expect("it runs");
        let sd = |fit| estimates_of(fit, "linear_drag", "c")[0].sd;
        assert!(sd(&made.after.fit) > 1.5 * sd(&again), "{} {}", sd(&made.after.fit), sd(&again));
        let effects = [made.added.as_ref().expect("it was added"), &found.effects[0]];
        for (effect, fit) in effects.into_iter().zip([&made.after.fit, &last.fit]) {
            let [e] = estimates_of(fit, "linear_drag", "c")[..] else {
                panic!("one value of {:?}: {}", found.effects, found.reason)
            };
            let number = |value: &ParameterValue| match value {
                ParameterValue::Number(number) => *number,
                other => panic!("{other:?}"),
            };
            let p = &effect.parameters[0];
            let sd = (number(&p.high) - number(&p.low)) / (2.0 * NINETY_FIVE);
            assert!((sd / e.sd - 1.0).abs() < 1e-6, "{sd} {}", e.sd);
            assert!((number(&p.value) - e.value).abs() < 1e-12, "{p:?} {}", e.value);
        }
    }

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
