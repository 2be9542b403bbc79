//! What of the lenses' findings trajectories bear out, and the verdict.

use super::alternatives::{contact_rivals, keeps, otherwise};
use super::change::{self, rank_formulas};
use super::contact::ContactCandidate;
use super::contact_law::{estimates_of, pooled, with_contact};
use super::departures::departure;
use super::experiment::tell_apart;
use super::formula::{MOST_TERMS, ResidualLaw};
use super::formula_test::{formula_beats_library, law_beside, once, predicts_held_out, written};
use super::intervals::{
    FOLLOWED, contact_duration, contact_numbers, found, found_contact, has_contacts, numbers_of_rivals,
    ranked, reason, smallest, table_advice,
};
use super::jackknife::{SharedEstimate, numbers_of, of_videos};
use super::outcome::{Discovery, FoundEffect, Verdict, may_be_none};
use super::proof::{self, alike_kinds, at_noise, explains_all};
use super::proposal::FORMULA;
use super::revise::{Revision, fits_of_revision, pooled_noise, revise, revise_from};
use super::screen::region;
use super::search::{CLEAN, FreeMotion, fewer, instead};
use super::trajectory_check::heard;
use super::user_formula::with_numbers;
use super::weak_form::WeakFormRegression;
use super::whole_trajectory::{asked, recovers, sticking, sticks};
use super::window_fits::WindowFits;
use super::windows::contacts;
use crate::effects::formula::Formula;
use crate::effects::{Hook, ParamSpec, effect_with};
use crate::fit::{FitError, FitOptions};
use crate::num::{Stop, elementary, progress_of_jobs, progress_within};
use crate::world::Model;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A scene up to this reduced chi-square is explained but for what engines do at contacts.
const NEARLY: f64 = 2.0;
/// What nobody saw explains the trajectories when it takes this share of their misfit: it struck where no lens looked.
const MOSTLY: f64 = 0.9;
/// A formula that foretells is added in place of what the library has, where its error is at most this many times as large.
const AS_NEAR: f64 = 1.05;
/// Share of the work that the revisions take.
const REVISIONS: f64 = 0.7;
/// Laws that few short films speak for and trajectories are asked about.
const SUGGESTIONS: usize = 2;
/// Trajectories beyond this reduced chi-square are not what chaos makes of a right model.
const LOST: f64 = 100.0;

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DiscoverOptions {
    /// Most effects that are added.
    pub max_effects: usize,
    pub fit: FitOptions,
}

impl Default for DiscoverOptions {
    fn default() -> Self {
        DiscoverOptions { max_effects: 2, fit: FitOptions { max_iterations: 60, ..FitOptions::default() } }
    }
}

/// One reading of the base with what the lenses see of it.
#[derive(Clone)]
pub struct BaseModel {
    pub models: Vec<Model>,
    pub motion: FreeMotion,
    pub contacts: Vec<ContactCandidate>,
    /// Chi-square of the short films around contacts.
    pub films: f64,
}

/// The law of contact that short films prove beside the forces, where there is room for one.
pub fn law_of<'c>(
    contacts: &'c [ContactCandidate],
    motion: &FreeMotion,
    options: &DiscoverOptions,
) -> Option<&'c ContactCandidate> {
    let room = options.max_effects > motion.found.len();
    contacts.iter().find(|c| c.proven() && room)
}

/// What the trajectories bear out of what the lenses see.
pub fn conclude(
    lens: &WeakFormRegression,
    reading: BaseModel,
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Discovery, FitError> {
    let BaseModel { models, motion, contacts: of_contacts, .. } = reading;
    let noise_sigma = pooled_noise(lens);
    let region = region(lens.scenes);
    let room = options.max_effects > motion.found.len();
    let proven = law_of(&of_contacts, &motion, options);
    let base = models.clone();
    let mut steps: Vec<(Option<&str>, Vec<Model>)> = vec![(None, models)];
    for (number, step) in motion.found.iter().enumerate() {
        let last = number + 1 == motion.found.len();
        let models = if last { &motion.models } else { &step.models };
        steps.push((Some(step.entry.spec.name), models.clone()));
    }
    let most = steps.len() + 2 * usize::from(proven.is_some());
    let told = progress_of_jobs(stop, [0.0, REVISIONS], most * fits_of_revision(lens.scenes));
    let revise =
        |(effect, models): &(Option<&str>, Vec<Model>)| revise(lens, models, *effect, &options.fit, &told);
    let mut revisions: Vec<Revision> = steps.par_iter().map(revise).collect::<Result<_, FitError>>()?;
    // Where forces follow all to the noise, contacts show nothing else.
    let proven = proven.filter(|_| !revisions.last().is_some_and(explains_all));
    if let Some(c) = proven {
        let name = Some(c.entry.spec.name);
        let mut steps = vec![(name, with_contact(&motion.models, c.entry, &c.values, c.object, &region))];
        // What nobody saw, or a law of contact, may look like a force.
        if !motion.found.is_empty() {
            steps.push((name, with_contact(&base, c.entry, &c.values, c.object, &region)));
        }
        let further: Result<Vec<Revision>, FitError> = steps.par_iter().map(revise).collect();
        revisions.extend(further?);
    }
    let stop: Stop = &progress_within(stop, [REVISIONS, 1.0]);
    let (asked_for, forces) = (proven, motion.found.len());
    let (mut revisions, mut motion, mut proven) =
        is_supported(lens, &base, revisions, motion, proven, &options.fit, stop)?;
    if proven.is_none()
        && room
        && let Some((law, revision)) = heard(lens, &base, &motion, &revisions[0], &options.fit, stop)?
    {
        motion = law;
        revisions.push(revision);
    }
    let room = room && options.max_effects > motion.found.len();
    let mut of_contact = vec![];
    if let Some(c) = proven {
        let rivals = contact_rivals(lens, c, &of_contacts, &motion, &revisions, &options.fit, stop)?;
        of_contact = rivals.alike;
        if let Some((other, nearer)) = rivals.better {
            revisions.pop();
            revisions.push(nearer);
            proven = Some(other);
        }
    }
    // What sticks is followed by nothing else: where that explains what is lost, no other law is tried whole.
    let at_large = &revisions[motion.found.len()];
    let early = match proven {
        None if room && proof::loses_most(&at_large.fit) => {
            Some(sticking(lens, &motion.models, &options.fit, stop)?)
        }
        _ => None,
    };
    let stick = early.iter().flatten().any(|r| sticks(at_large, r) && !proof::astray(&r.fit));
    if proven.is_none() && room && !stick {
        let law = |c: &ContactCandidate| with_contact(&motion.models, c.entry, &c.values, c.object, &region);
        // What was refused beside the same forces would be again.
        let refused = asked_for.filter(|_| motion.found.len() == forces).map(|c| c.entry.spec.name);
        let open = |c: &&ContactCandidate| c.suggested() && refused != Some(c.entry.spec.name);
        let last = &revisions[motion.found.len()];
        let suggestions: Vec<_> = of_contacts.iter().filter(open).take(SUGGESTIONS).collect();
        let tried = suggestions.into_par_iter().map(|c| {
            let recovers = recovers(lens, last, c, &law(c), &options.fit, stop)?;
            Ok(recovers.map(|revision| (c, revision)))
        });
        let tried: Vec<_> = tried.collect::<Result<_, FitError>>()?;
        let tried: Vec<_> = tried.into_iter().flatten().collect();
        let of = |(c, r): &(&ContactCandidate, Revision)| (c.added, c.entry.kind, proof::deviance(&r.fit));
        of_contact = alike_kinds(&tried.iter().map(of).collect::<Vec<_>>(), &at_large.fit);
        let nearer = |a: &Revision, b: &Revision| proof::deviance(&a.fit).total_cmp(&proof::deviance(&b.fit));
        if let Some((c, recovers)) = tried.into_iter().min_by(|a, b| nearer(&a.1, &b.1)) {
            revisions.push(recovers);
            proven = Some(c);
        }
    }
    let other = match (proven, revisions.last()) {
        (Some(c), Some(known)) => otherwise(lens, c, &motion.models, known, &options.fit, stop)?,
        _ => None,
    };
    let other = other.map(|(law, revision)| {
        revisions.pop();
        revisions.push(revision);
        law
    });
    proven = other.as_ref().or(proven);
    let whole = match proven {
        None if room && !stick && motion.trimmed_chi_square < super::MISFIT => {
            asked(lens, &revisions[motion.found.len()], &motion.models, &options.fit, stop)?
        }
        _ => None,
    };
    let whole = whole.map(|(law, recovers, alike)| {
        revisions.push(recovers);
        of_contact = alike;
        law
    });
    proven = proven.or(whole.as_ref());
    if let Some(c) = proven
        && let Some(alone) = without_forces(lens, &base, &motion, c, &revisions, &options.fit, stop)?
    {
        motion = fewer(lens, &base, &motion, motion.found.len(), stop)?;
        revisions.truncate(1);
        revisions.push(alone);
    }
    let last = &revisions[motion.found.len()];
    let mut effects: Vec<FoundEffect> = motion.found.iter().map(|c| found(lens, &motion, c, last)).collect();
    let mut rivals = motion.alike.clone();
    if rivals.is_empty() {
        rivals = motion.rivals(lens, effects.iter().any(|e| e.uncertain));
    }
    // A law of force that may be absent, and has no rival, is not proven.
    if rivals.is_empty() && proven.is_none() && effects.last().is_some_and(|e| e.uncertain) {
        effects.pop();
        revisions.pop();
        motion = fewer(lens, &base, &motion, 1, stop)?;
    }
    let last = &revisions[motion.found.len()];
    // One video may be lost to chaos alone; what is missing is missing in most, and where no more than a few objects meet.
    let off = last.fit.scenes.iter().filter(|s| s.reduced_chi_square > LOST).count();
    let lost = proven.is_none()
        && 2 * off > last.fit.scenes.len()
        && WindowFits::of(&contacts(lens, &motion.models), stop)?.meetings_lost();
    // What sticks may look like another law of contact, which then does not follow what was filmed.
    let told = revisions.last().unwrap_or(last);
    let open = match proven {
        None => room && told.reduced_chi_square > FOLLOWED && proof::astray(&told.fit),
        Some(_) => proof::loses(&told.fit),
    };
    let stuck = match early {
        Some(known) => known.filter(|_| open),
        None if open => sticking(lens, &motion.models, &options.fit, stop)?,
        None => None,
    };
    if let Some(stuck) = stuck.filter(|r| sticks(told, r)) {
        proven = None;
        effects.extend(
            effect_with(|e| e.all_or_nothing().is_some()).map(|entry| FoundEffect::of(entry, vec![])),
        );
        revisions.truncate(motion.found.len() + 1);
        revisions.push(stuck);
    }
    if let (Some(c), Some(last)) = (proven, revisions.last()) {
        match contact_effect(lens, last, c, whole.is_some() || !c.strong(), &options.fit, stop)? {
            Some(found) => effects.push(found),
            None => {
                proven = None;
                revisions.pop();
            }
        }
    }
    let names: Vec<&str> = effects.iter().map(|e| e.effect.as_str()).collect();
    let mut ranked = ranked(&motion, vec![], &of_contacts, &names, noise_sigma);
    // Rivals of a law of contact that was not kept are none.
    if proven.is_none() {
        of_contact.clear();
    }
    let substitutes = motion.substitutes(lens, &base, stop)?;
    let mut ambiguous: Vec<Vec<String>> =
        [rivals.clone(), of_contact].into_iter().filter(|kinds| !kinds.is_empty()).collect();
    ambiguous.extend(substitutes.iter().map(|alike| alike.iter().map(|c| c.entry.kind.into()).collect()));
    // What nobody saw may have struck where the lens took the motion for free: then the trajectories judge.
    // Engines do more at contacts than any law, and a video may be lost to chaos alone.
    let unseen = proven.is_some_and(|c| c.entry.uses(Hook::Bodies));
    let explains = |r: &Revision| {
        let near = r.fit.scenes.iter().filter(|s| s.reduced_chi_square < NEARLY).count();
        let first = revisions.first().map_or(0.0, |r| r.reduced_chi_square);
        let mostly = r.reduced_chi_square - 1.0 < (1.0 - MOSTLY) * (first - 1.0);
        r.reduced_chi_square < super::MISFIT || 2 * near >= r.fit.scenes.len() || (unseen && mostly)
    };
    let explained = proven.is_some() && revisions.last().is_some_and(explains);
    // Where trajectories are followed from their start, the lens is what fails, at contacts that come too close; chaos may lose
    // one of several.
    let ended = revisions.last().map_or(f64::INFINITY, |r| r.reduced_chi_square);
    let followed = revisions.last().is_some_and(at_noise);
    let misfit = motion.trimmed_chi_square > super::MISFIT && !explained && !followed;
    let formula_beats_library = formula_beats_library(lens, &base, &motion, &revisions, options, stop)?;
    // The lens takes its blows for a force.
    let formula_beats_library = formula_beats_library.filter(|_| !(unseen && explained));
    // A rhythm that nobody saw repeat is none.
    let once = motion.found.iter().any(|c| once(c, region.duration));
    // Trajectories that are followed without any force have nothing outside; with one, it may be the image of another.
    let still = followed && motion.found.is_empty();
    let outside =
        !still && (misfit || once || formula_beats_library.is_some() || (lost && effects.is_empty()));
    // Beside which of the library's laws: none, or all of force.
    let alone = |law: ResidualLaw| (law.text, 0);
    let beside = |law: ResidualLaw| (law.text, motion.found.len());
    let law = formula_beats_library
        .filter(|_| outside)
        .map(alone)
        .or_else(|| {
            (outside && misfit)
                .then(|| law_beside(lens, &motion.models, &motion, MOST_TERMS, true))
                .flatten()
                .map(beside)
        })
        .or_else(|| {
            (outside && once).then(|| law_beside(lens, &base, &motion, MOST_TERMS, true)).flatten().map(alone)
        });
    let (mut formula, mut strength) = (None, String::new());
    if let Some((text, kept)) = law
        && let models = if kept == 0 { &base } else { &motion.models }
        && let Some(with) = written(lens, &text, models, options, stop)?
        && predicts_held_out(&revisions[kept], &with, noise_sigma)
    {
        let law = Formula::new(&text, vec![]).map(|law| (FORMULA.to_string(), law)).into_iter();
        ranked.splice(kept..kept, rank_formulas(lens, models, &law.collect::<Vec<_>>(), motion.unit()));
        // What the model's own numbers take back of it (a constant, by a tilt of the table) is no force.
        let [rms, most] = lens.apart(&with.fit.models(), &revisions[kept].fit.models());
        strength = format!(
            "; on these tracks it changes accelerations by {rms:.3} m/s^2 (root mean square; {most:.3} at most)"
        );
        let mut text = text;
        if revisions.last().is_some_and(|last| with.rmse < AS_NEAR * last.rmse) {
            let found = change::found(lens, &with, FORMULA, &options.fit, stop)?;
            text = with_numbers(&text, |name| found.number(name));
            effects.truncate(kept);
            effects.push(found);
            revisions.truncate(kept + 1);
            revisions.push(with);
        }
        formula = Some(text);
    }
    let verdict = match () {
        () if outside => Verdict::OutsideLibrary,
        () if !ambiguous.is_empty() => Verdict::Ambiguous,
        () if !effects.is_empty() => Verdict::EffectFound,
        () => Verdict::Adequate,
    };
    if let Some(last) = revisions.last_mut() {
        effects.iter().for_each(|effect| effect.widen(&mut last.fit));
    }
    let experiment = match verdict {
        Verdict::Ambiguous => {
            tell_apart(lens, &motion, &rivals, substitutes.first().map_or(&[], Vec::as_slice))
        }
        _ => None,
    };
    let left = match followed || unseen {
        true => format!("reduced chi-square {ended:.2}"),
        false => {
            let any = revisions.last().is_some_and(|last| has_contacts(lens, last, |_| true));
            let part = if any { "between contacts" } else { "in free motion" };
            format!("{part} reduced chi-square {:.2}", motion.reduced_chi_square())
        }
    };
    let last = revisions.last().map(|last| (last, has_contacts(lens, last, proof::lost)));
    let mut reason = reason(verdict, &motion, &left, &effects, &ambiguous, formula.is_some(), last);
    if verdict == Verdict::Ambiguous {
        reason += &numbers_of_rivals(&motion, &ambiguous, &substitutes);
    }
    let duration = revisions.last().map_or(String::new(), |last| contact_duration(lens, last, &effects));
    let mut aside = String::new();
    if verdict == Verdict::Adequate
        && ended > FOLLOWED
        && let Some(c) = of_contacts.iter().find(|c| c.proven() || c.suggested())
    {
        aside += &format!(
            "; windows around contacts support {}, but it does not improve the full-trajectory fit: record more contacts",
            c.entry.kind
        );
    }
    if let Some(last) = revisions.last() {
        aside += &departure(lens, last, &options.fit, stop)?.unwrap_or_default();
    }
    Ok(Discovery {
        reason: reason + &strength + &table_advice(&effects) + &duration + &aside,
        verdict,
        effects,
        ranked,
        ambiguous,
        experiment,
        formula,
        smallest: if verdict == Verdict::Adequate { smallest(lens, &motion) } else { vec![] },
        noise_sigma,
        revisions,
    })
}

/// A law of contact with its numbers by the trajectories of the last revision. `None` where its absence is as likely, or where no
/// window speaks for it clearly (`doubtful`) and the videos disagree on whether it acts at all.
fn contact_effect(
    lens: &WeakFormRegression,
    last: &Revision,
    c: &ContactCandidate,
    doubtful: bool,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<FoundEffect>, FitError> {
    // What strikes a thing that nobody saw rebounds from it each in its own way: of that, windows tell the spread, and the numbers
    // too where trajectories are not followed.
    let videos = match c.entry.uses(Hook::Bodies) {
        true => followed(last, c),
        false => of_videos(lens, last, &numbers_of(c.entry), options, stop)?,
    };
    let amplitude = videos.as_ref().and_then(|v| *v.first()?);
    if doubtful && amplitude.is_some_and(|s| may_be_none(s.value, s.scatter)) {
        return Ok(None);
    }
    let (values, sd) = contact_numbers(c, pooled_noise(lens), videos.as_deref());
    let found = found_contact(c, &values, &sd);
    Ok((!found.uncertain).then_some(found))
}

/// What of the findings the trajectories bear out, with its revisions: the one without any, one for each force, one for the
/// law of contact, and one for that law without the forces where there are both.
fn is_supported<'c>(
    lens: &WeakFormRegression,
    base: &[Model],
    mut revisions: Vec<Revision>,
    mut motion: FreeMotion,
    proven: Option<&'c ContactCandidate>,
    options: &FitOptions,
    stop: Stop,
) -> Result<(Vec<Revision>, FreeMotion, Option<&'c ContactCandidate>), FitError> {
    let forces = motion.found.len();
    let with_contact = revisions.split_off(forces + 1);
    let added = motion.added();
    if let (Some(c), [all, alone @ ..]) = (proven, &with_contact[..]) {
        if let [alone] = alone
            && !proof::is_supported(alone, all, added)
            && proof::is_supported(&revisions[0], alone, c.added)
        {
            let motion = fewer(lens, base, &motion, forces, stop)?;
            revisions.truncate(1);
            revisions.push(alone.clone());
            return Ok((revisions, motion, proven));
        }
        let before = &revisions[forces];
        // Where chaos leaves trajectories nothing to say, several short films stand.
        let films_stand = || c.strong() && c.gained > 1 && proof::uninformative(&before.fit, &all.fit);
        if keeps(c, all) && (proof::is_supported(before, all, c.added) || films_stand()) {
            revisions.push(all.clone());
            return Ok((revisions, motion, proven));
        }
    }
    // A lens knows less of the state than a trajectory (a ball's spin): where it is blind to what trajectories follow
    // from the start, what it saw is nothing.
    let blind = revisions[0].reduced_chi_square <= 1.0 + CLEAN && motion.trimmed_chi_square > super::MISFIT;
    if let [.., before, after] = &revisions[..]
        && !blind
        && let own = motion.found.last().map_or(0, |c| c.added)
        && let starts = stands(before, after, proof::is_supported(before, after, own))
        && let Some(nearer) = search_again(lens, &motion.models, starts, after, options, stop)?
        && let Some(last) = revisions.last_mut()
    {
        *last = nearer;
    }
    let mut refused = 0;
    while let [.., before, after] = &revisions[..] {
        let left = &motion.found[..forces - refused];
        let own = left.last().map_or(0, |c| c.added);
        let all = left.iter().map(|c| c.added).sum();
        // Each step by itself, and all of them against none: one may mend what another spoilt.
        if !blind && proof::is_supported(before, after, own) && proof::is_supported(&revisions[0], after, all)
        {
            break;
        }
        refused += 1;
        revisions.pop();
    }
    if refused > 0 {
        motion = fewer(lens, base, &motion, refused, stop)?;
    }
    if let Some(last) = revisions.last()
        && let Some((one, nearer)) = one_for_all(lens, base, &motion, last, options, stop)?
    {
        revisions.truncate(1);
        revisions.push(nearer);
        motion = one;
    }
    Ok((revisions, motion, None))
}

/// The revision with a law of contact alone, where forces found in free motion bring nothing beside it: what pushes before it
/// touches looks like a source where the objects met.
fn without_forces(
    lens: &WeakFormRegression,
    base: &[Model],
    motion: &FreeMotion,
    law: &ContactCandidate,
    revisions: &[Revision],
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<Revision>, FitError> {
    let ([first, .., all], false) = (revisions, motion.found.is_empty()) else { return Ok(None) };
    let models = with_contact(base, law.entry, &law.values, law.object, &region(lens.scenes));
    let alone = revise(lens, &models, Some(law.entry.spec.name), options, stop)?;
    let enough =
        !proof::is_supported(&alone, all, motion.added()) && proof::is_supported(first, &alone, law.added);
    Ok(enough.then_some(alone))
}

/// The law that explains most alone in place of several, where trajectories are as near to it and the price of the numbers that
/// the several have more is paid: what one leaves may be taken up by another with a rival beside.
fn one_for_all(
    lens: &WeakFormRegression,
    base: &[Model],
    motion: &FreeMotion,
    several: &Revision,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<(FreeMotion, Revision)>, FitError> {
    let Some((_, law)) = motion.ranked.first().filter(|_| motion.found.len() > 1) else { return Ok(None) };
    let name = law.entry.spec.name;
    if motion.found.iter().any(|c| c.entry.spec.name == name) {
        return Ok(None);
    }
    let one = instead(lens, base, motion, law, stop)?;
    let revision = revise(lens, &one.models, Some(name), options, stop)?;
    let nearer = proof::deviance(&revision.fit) < proof::deviance(&several.fit) + motion.dearer(law.added);
    Ok(nearer.then_some((one, revision)))
}

/// Numbers of an unseen thing by trajectories that are followed; as uncertain as short films have them, and as far as these
/// disagree.
fn followed(revision: &Revision, c: &ContactCandidate) -> Option<Vec<Option<SharedEstimate>>> {
    let all = proof::follows(revision) || at_noise(revision);
    let one = |(p, (known, own)): (&ParamSpec, (&f64, &f64))| {
        let (value, sd) = pooled(&estimates_of(&revision.fit, c.entry.spec.name, p.name))?;
        let apart = value - known;
        let apart = if p.unit == "rad" { elementary::sin(apart).abs() } else { apart };
        Some(SharedEstimate { value, sd, scatter: elementary::hypot(*own, apart) })
    };
    all.then(|| c.entry.spec.params.iter().zip(c.values.iter().zip(&c.sd)).map(one).collect())
}

/// Where the search for the models of `after` is to begin again, if it has lost its way: a law more is never farther than none, as it
/// may be absent. Scenes that are farther with it begin where they stood `before`; all of them do where the law is refused and none,
/// or each, is farther.
fn stands<'r>(before: &'r Revision, after: &'r Revision, supported: bool) -> Option<Vec<Option<&'r Model>>> {
    let farther = proof::farther(&before.fit, &after.fit);
    let mixed = farther.contains(&true) && farther.contains(&false);
    if supported && !mixed {
        return None;
    }
    let scenes = before.fit.scenes.iter().zip(&after.fit.scenes).zip(&farther);
    Some(scenes.map(|((b, a), &farther)| Some(if farther || !mixed { &b.model } else { &a.model })).collect())
}

/// The revision `after`, searched again from there: a search that lost its way says nothing against the law. `None` where that is not nearer.
fn search_again(
    lens: &WeakFormRegression,
    models: &[Model],
    starts: Option<Vec<Option<&Model>>>,
    after: &Revision,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<Revision>, FitError> {
    let Some(starts) = starts else { return Ok(None) };
    let again = revise_from(lens, models, &starts, after.effect.as_deref(), options, stop)?;
    Ok((proof::deviance(&again.fit) < proof::deviance(&after.fit)).then_some(again))
}
