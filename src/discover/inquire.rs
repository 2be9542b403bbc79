//! The whole loop: is the base right, which law is missing, does the error fall when it is added.

use super::contact::{ContactCandidate, contacts, estimates_of, screen_contacts, with_contact};
use super::experiment::tell_apart;
use super::force::{Lens, fit_forces};
use super::formula::residual_law;
use super::outcome::{Discovery, Found, Ranked, Smallest, Verdict, reported};
use super::revise::{Revision, pooled_noise, revise};
use super::screen::{Candidate, region, sought, with_nuisance};
use super::search::{FreeMotion, PROOF, search};
use crate::effects::EffectEntry;
use crate::fit::{Fit, FitError, FitOptions};
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::{Model, Preset};
use serde::{Deserialize, Serialize};

/// Residuals in free motion below which nothing can be said.
const FEWEST: usize = 60;
/// Two readings of the base closer than this in the lens are told apart by their contacts (chi-square).
const SAME: f64 = 20.0;
/// A fit in trajectory space up to this reduced chi-square has followed the contacts.
const FOLLOWED: f64 = 3.0;

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DiscoverOptions {
    /// Most effects that are added.
    pub max_effects: usize,
    pub fit: FitOptions,
}

impl Default for DiscoverOptions {
    fn default() -> Self {
        DiscoverOptions { max_effects: 2, fit: FitOptions::default() }
    }
}

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
    let readings = readings(scenes, models);
    let most = options.max_effects.max(1);
    let mut found: Vec<(Vec<Model>, FreeMotion)> = vec![];
    for models in readings {
        let models = with_nuisance(&models);
        let motion = search(&lens, &models, 1, stop)?;
        found.push((models, motion));
    }
    let least = found.iter().map(|f| f.1.priced()).fold(f64::INFINITY, f64::min);
    found.retain(|f| f.1.priced() < least + SAME);
    let mut best: Option<(Vec<Model>, FreeMotion, Revision)> = None;
    for (models, motion) in found {
        let motion =
            if most > 1 && !motion.found.is_empty() { search(&lens, &models, most, stop)? } else { motion };
        let last = motion.found.last().map(|c| c.entry.spec.name);
        let revision = revise(&lens, &motion.models, last, &options.fit, stop)?;
        let better = |b: &Revision| revision.reduced_chi_square < b.reduced_chi_square;
        if best.as_ref().is_none_or(|(_, _, b)| better(b)) {
            best = Some((models, motion, revision));
        }
    }
    let Some((models, motion, last)) = best else { return Ok(not_identifiable(&lens)) };
    conclude(&lens, &models, motion, last, options, stop)
}

/// The models, and the other reading of the same scenes where the preset has one.
fn readings(scenes: &[Scene], models: &[Model]) -> Vec<Vec<Model>> {
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

fn conclude(
    lens: &Lens,
    models: &[Model],
    motion: FreeMotion,
    last: Revision,
    options: &DiscoverOptions,
    stop: Stop,
) -> Result<Discovery, FitError> {
    let noise_sigma = pooled_noise(lens);
    let region = region(lens.scenes);
    let room = options.max_effects.saturating_sub(motion.found.len());
    let films = contacts(lens, &motion.models);
    let of_contacts = match room {
        0 => vec![],
        _ => screen_contacts(&films, &region, &sought(&motion.models, lens.scenes), stop)?,
    };
    let proven: Option<&ContactCandidate> = of_contacts.iter().find(|c| c.proven());
    let mut revisions = vec![];
    if !motion.found.is_empty() {
        revisions.push(revise(lens, models, None, &options.fit, stop)?);
        for step in &motion.found[..motion.found.len() - 1] {
            let name = Some(step.entry.spec.name);
            revisions.push(revise(lens, &step.models, name, &options.fit, stop)?);
        }
    }
    let mut effects: Vec<Found> = motion.found.iter().map(|c| found(lens, &motion, c, &last.fit)).collect();
    revisions.push(last);
    if let Some(c) = proven {
        let with = with_contact(&motion.models, c.entry, &c.values, &region);
        revisions.push(revise(lens, &with, Some(c.entry.spec.name), &options.fit, stop)?);
        effects.push(Found {
            kind: c.entry.kind.to_string(),
            effect: c.entry.spec.name.to_string(),
            parameters: reported(c.entry, &c.values, &c.sd),
        });
    }
    let degrees = motion.degrees_of_freedom;
    let mut ranked: Vec<Ranked> = motion
        .ranked
        .iter()
        .map(|(score, c)| Ranked {
            kind: c.entry.kind.to_string(),
            effect: c.entry.spec.name.to_string(),
            log_evidence: 0.5 * score,
            held_out_rmse: noise_sigma * (c.left_out / degrees).max(0.0).sqrt(),
        })
        .collect();
    ranked.extend(of_contacts.iter().map(|c| Ranked {
        kind: c.entry.kind.to_string(),
        effect: c.entry.spec.name.to_string(),
        log_evidence: 0.5 * c.score,
        held_out_rmse: noise_sigma * c.remains.sqrt(),
    }));
    let names: Vec<&str> = effects.iter().map(|e| e.effect.as_str()).collect();
    // What was added comes first, then the others by evidence.
    let place = |r: &Ranked| names.iter().position(|n| *n == r.effect).unwrap_or(names.len());
    ranked.sort_by(|a, b| place(a).cmp(&place(b)).then(b.log_evidence.total_cmp(&a.log_evidence)));
    let ambiguous: Vec<Vec<String>> =
        motion.alike.iter().map(|kinds| kinds.iter().map(|k| k.to_string()).collect()).collect();
    let outside = motion.reduced_chi_square() > super::MISFIT;
    let (free, seen) = fit_forces(lens, &motion.models);
    let formula = outside.then(|| residual_law(lens, &motion.models, &free, &seen.values)).flatten();
    let verdict = match () {
        () if outside => Verdict::OutsideLibrary,
        () if !ambiguous.is_empty() => Verdict::Ambiguous,
        () if !effects.is_empty() => Verdict::EffectFound,
        () => Verdict::Adequate,
    };
    let experiment = match verdict {
        Verdict::Ambiguous => tell_apart(lens, &motion),
        _ => None,
    };
    Ok(Discovery {
        reason: reason(verdict, &motion, &effects, &ambiguous),
        verdict,
        effects,
        ranked,
        ambiguous,
        experiment,
        formula,
        smallest: smallest(&motion),
        noise_sigma,
        revisions,
    })
}

/// An effect of force with its numbers: of the fit in trajectory space where that has followed the contacts, else of
/// the lens.
fn found(lens: &Lens, motion: &FreeMotion, c: &Candidate, fit: &Fit) -> Found {
    let scale = motion.reduced_chi_square().max(1.0).sqrt();
    let (mut values, mut sd) = (c.values.clone(), c.sd.iter().map(|s| s * scale).collect::<Vec<f64>>());
    let followed = fit.scenes.iter().all(|s| s.reduced_chi_square < FOLLOWED);
    for (k, p) in c.entry.spec.params.iter().enumerate() {
        let name = format!("{}.{}", c.entry.spec.name, p.name);
        if let Some(at) = motion.free.iter().position(|f| f.name == name) {
            (values[k], sd[k]) = (motion.seen.values[at], motion.seen.sd[at] * scale);
        }
        if let (true, [e]) = (followed, &estimates_of(fit, c.entry, p.name)[..]) {
            values[k] = e.value;
        }
    }
    debug_assert!(!lens.scenes.is_empty());
    Found {
        kind: c.entry.kind.to_string(),
        effect: c.entry.spec.name.to_string(),
        parameters: reported(c.entry, &values, &sd),
    }
}

/// The smallest amplitude of each kind of force that the lens would have proven.
fn smallest(motion: &FreeMotion) -> Vec<Smallest> {
    let price = |c: &Candidate| PROOF + c.added as f64 * motion.degrees_of_freedom.ln();
    let unit = motion.reduced_chi_square().max(1.0);
    let one = |c: &Candidate| {
        let entry: &'static EffectEntry = c.entry;
        let sd = c.sd[..entry.amplitudes.min(c.sd.len())].iter().fold(0.0, |a: f64, b| a.max(*b));
        Smallest {
            kind: entry.kind.to_string(),
            effect: entry.spec.name.to_string(),
            parameter: entry.spec.params[0].name.to_string(),
            value: (price(c) * unit).sqrt() * sd,
            unit: entry.spec.params[0].unit.to_string(),
        }
    };
    motion.ranked.iter().map(|(_, c)| one(c)).collect()
}

fn reason(verdict: Verdict, motion: &FreeMotion, effects: &[Found], ambiguous: &[Vec<String>]) -> String {
    let left = motion.reduced_chi_square();
    let names: Vec<&str> = effects.iter().map(|e| e.kind.as_str()).collect();
    match verdict {
        Verdict::EffectFound => {
            format!("{} explains the motion; reduced chi-square {left:.2} remains", names.join(" and "))
        }
        Verdict::Ambiguous => format!(
            "{} explain the motion equally well; film the launch given as experiment",
            ambiguous.iter().map(|set| set.join(" or ")).collect::<Vec<_>>().join("; ")
        ),
        Verdict::Adequate => format!("nothing is missing at this noise; reduced chi-square {left:.2}"),
        Verdict::OutsideLibrary => {
            format!("reduced chi-square {left:.2} remains after the best laws of the library")
        }
        Verdict::NotIdentifiable => String::new(),
    }
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
