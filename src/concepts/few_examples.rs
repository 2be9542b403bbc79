//! A new word from a few examples and counter-examples.
//!
//! Each candidate k, one feature or a group of them, is a logistic regression with the evidence Z_k; Z_0 is that of the bias alone. Half
//! of the prior is for single features, half for groups: `p_k`. The word is the most probable candidate. Where the odds of any against
//! the bias alone, `sum_k p_k Z_k/Z_0`, are below [`LEAST_EVIDENCE`], the word is refused.

use super::error::{ConceptError, ExampleNumber};
use super::features::{FeatureLayout, appearance, motion};
use super::lessons::best_rollout;
use super::lexicon::{LearnedWord, Lexicon, Meaning, WordKind};
use super::logistic::{LogisticFit, fit_columns};
use crate::fit::Fit;
use crate::num::elementary::{exp, ln};
use crate::num::never;
use crate::reason::{FUTURE_FRAMES, can_be_learned, simulated};
use crate::scene::Scene;

/// An object of a scene, or an encounter of two, that fits a word, or does not.
#[derive(Debug, Clone, Copy)]
pub struct Example<'a> {
    pub scene: &'a Scene,
    /// With the scene's index in it; words of events need it.
    pub fit: Option<(&'a Fit, usize)>,
    pub of: ExampleOf,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExampleOf {
    /// Index of the object.
    Object(usize),
    /// Indices of two objects, and about which frame they collide, or come closest to each other.
    Encounter { objects: [usize; 2], frame: usize },
}

/// Log odds against the bias alone that a word needs (nat): twenty to one, where evidence is strong (Jeffreys, Theory of
/// Probability, 1961, app. B). Ten examples have 6.9 nat at most.
const LEAST_EVIDENCE: f64 = 3.0;
/// Two examples closer than this, in deviations of each feature over the examples, are alike.
const ALIKE: f64 = 0.02;
/// Most features that are tried together without being a named group.
const MAX_GROUP: usize = 40;
/// Features that are looked at together: colour, lightness, highlights, form.
const APPEARANCE_GROUPS: [&[usize]; 7] = [
    &[0, 1, 2, 3, 4],
    &[0, 1, 2, 3, 4, 8],
    &[8, 9, 10, 11, 12, 13],
    &[8, 9, 10, 11, 12, 13, 14, 15, 16],
    &[2, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18],
    &[19, 20, 21],
    &[22, 23, 24, 25, 26, 27],
];

/// Of an encounter: how the objects meet, and how fast they are.
const ENCOUNTER_GROUPS: [&[usize]; 2] = [&[2, 4], &[0, 1, 3]];

/// The lexicon with a new word from examples that fit and examples that do not. Deterministic.
pub fn learn_word(
    lexicon: &Lexicon,
    name: &str,
    kind: WordKind,
    yes: &[Example],
    no: &[Example],
) -> Result<Lexicon, ConceptError> {
    lexicon.check()?;
    check_new(lexicon, name)?;
    if yes.len() < 2 || no.len() < 2 {
        return Err(ConceptError::TooFewExamples { name: name.into(), yes: yes.len(), no: no.len() });
    }
    let all: Vec<&Example> = yes.iter().chain(no).collect();
    let mut rows = vec![];
    for (index, example) in all.iter().enumerate() {
        rows.push(features(example, ExampleNumber::of(index, yes.len()), kind)?);
    }
    let fits: Vec<bool> = (0..all.len()).map(|k| k < yes.len()).collect();
    let labels: Vec<String> = all.iter().map(|e| label(e)).collect();
    contradictions(name, &rows, &fits, &labels)?;
    let groups: &[&[usize]] = match kind {
        WordKind::Static if is_perceived(all[0]) => &APPEARANCE_GROUPS,
        WordKind::Event => &ENCOUNTER_GROUPS,
        _ => &[],
    };
    let (best, gain) = best_columns(&rows, &fits, groups);
    if gain < LEAST_EVIDENCE {
        let nearest = nearest_word(lexicon, &all, &fits);
        return Err(ConceptError::NotSeparable { name: name.into(), nearest });
    }
    let mut learned = lexicon.clone();
    if kind == WordKind::Static && learned.layout.is_none() {
        learned.layout = FeatureLayout::of(all[0].scene);
        (learned.mean, learned.scale) = super::features::standard(&rows);
    }
    learned.words.push(LearnedWord {
        name: name.into(),
        kind,
        meaning: Meaning::Logistic(best.word),
        yes: yes.len(),
        no: no.len(),
        evidence: gain,
    });
    Ok(learned)
}

/// Refuses a name that is in use, by the lexicon or by questions.
pub(super) fn check_new(lexicon: &Lexicon, name: &str) -> Result<(), ConceptError> {
    if !can_be_learned(name) {
        return Err(ConceptError::ReservedWord { name: name.into() });
    }
    // Texts are read in lower case.
    let is_same = |word: &String| word.to_lowercase() == name.to_lowercase();
    let of_family = lexicon.families.iter().any(|f| f.words.iter().any(is_same));
    let word = lexicon.words.iter().find(|w| is_same(&w.name)).map(|w| w.kind.name());
    match word.or(of_family.then_some("a word of a family")) {
        Some(kind) => Err(ConceptError::KnownWord { name: name.into(), kind }),
        None => Ok(()),
    }
}

fn is_perceived(example: &Example) -> bool {
    FeatureLayout::of(example.scene).is_some_and(|l| l.is_perceived())
}

/// What an example is called in messages.
fn label(example: &Example) -> String {
    let scene = example.scene;
    let id = |index: usize| scene.objects.get(index).map_or(0, |o| o.id);
    match example.of {
        ExampleOf::Object(object) => format!("object {} of {}", id(object), scene.name),
        ExampleOf::Encounter { objects: [a, b], frame } => {
            format!("encounter of {} and {} near frame {frame} of {}", id(a), id(b), scene.name)
        }
    }
}

fn features(example: &Example, number: ExampleNumber, kind: WordKind) -> Result<Vec<f64>, ConceptError> {
    let objects = example.scene.objects.len();
    let missing = |object| ConceptError::NoSuchObject { example: number, object, objects };
    match (kind, example.of) {
        (WordKind::Static, ExampleOf::Object(object)) => {
            let row = appearance(example.scene).get(object).cloned().ok_or_else(|| missing(object))?;
            if row.is_empty() {
                Err(ConceptError::NoFeatures { video: format!("{number} ({})", label(example)) })
            } else {
                Ok(row)
            }
        }
        (_, ExampleOf::Object(object)) => {
            motion(example.scene, example.fit).get(object).cloned().ok_or_else(|| missing(object))
        }
        (_, ExampleOf::Encounter { objects, frame }) => encounter_features(example, number, objects, frame),
    }
}

/// Features of the encounter of two objects that is nearest to a frame.
fn encounter_features(
    example: &Example,
    number: ExampleNumber,
    objects: [usize; 2],
    frame: usize,
) -> Result<Vec<f64>, ConceptError> {
    let count = example.scene.objects.len();
    if let Some(object) = objects.into_iter().find(|o| *o >= count) {
        return Err(ConceptError::NoSuchObject { example: number, object, objects: count });
    }
    let Some(fit) = example.fit else { return Err(ConceptError::NoFit { example: number }) };
    let mut wanted = objects.to_vec();
    wanted.sort_unstable();
    let frames = example.scene.times.len() + FUTURE_FRAMES;
    let (scenario, simulation) = simulated(example.scene, fit, &best_rollout(&[], frames), &never)?;
    let met = scenario.rollouts.first().map_or(&[][..], |r| r.encounters.of(example.scene, &simulation.best));
    let own = met.iter().filter(|e| e.objects == wanted);
    let nearest = own.min_by_key(|e| e.frame.abs_diff(frame));
    let features = nearest.map(|e| e.features.to_vec());
    features.ok_or_else(|| {
        let objects = objects.map(|o| example.scene.objects[o].id);
        ConceptError::NoEncounter { example: number, objects }
    })
}

/// Refuses examples that look alike but disagree.
fn contradictions(
    name: &str,
    rows: &[Vec<f64>],
    fits: &[bool],
    labels: &[String],
) -> Result<(), ConceptError> {
    let (_, scale) = super::features::standard(rows);
    let alike =
        |a: &[f64], b: &[f64]| a.iter().zip(b).zip(&scale).all(|((x, y), s)| ((x - y) / s).abs() < ALIKE);
    let mut pairs = vec![];
    for i in 0..rows.len() {
        for j in 0..i {
            if fits[i] != fits[j] && alike(&rows[i], &rows[j]) {
                pairs.push(format!("{} and {}", labels[j], labels[i]));
            }
        }
    }
    if pairs.is_empty() { Ok(()) } else { Err(ConceptError::Contradiction { name: name.into(), pairs }) }
}

/// The most probable candidate, and the log odds of any of them against the bias alone.
fn best_columns(rows: &[Vec<f64>], fits: &[bool], groups: &[&[usize]]) -> (LogisticFit, f64) {
    let length = rows.first().map_or(0, Vec::len);
    let none = fit_columns(rows, fits, &[]).evidence;
    let single = (0..length).map(|k| (vec![k], ln(2.0 * length as f64)));
    let mut candidates: Vec<(Vec<usize>, f64)> = single.collect();
    let named: Vec<Vec<usize>> = groups.iter().map(|g| g.to_vec()).collect();
    let whole = if length <= MAX_GROUP { vec![(0..length).collect()] } else { vec![] };
    let together: Vec<Vec<usize>> = named.into_iter().chain(whole).collect();
    let price = ln(2.0 * together.len().max(1) as f64);
    candidates.extend(together.into_iter().map(|columns| (columns, price)));
    let odds = candidates.into_iter().map(|(columns, price)| {
        let fitted = fit_columns(rows, fits, &columns);
        let odds = fitted.evidence - none - price;
        (fitted, odds)
    });
    let all: Vec<(LogisticFit, f64)> = odds.collect();
    let largest = all.iter().map(|c| c.1).fold(f64::NEG_INFINITY, f64::max);
    let any = largest + ln(all.iter().map(|c| exp(c.1 - largest)).sum::<f64>());
    let best = all.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
    best.map_or_else(|| (fit_columns(rows, fits, &[]), f64::NEG_INFINITY), |(fitted, _)| (fitted, any))
}

/// The word of the lexicon that agrees with most examples.
fn nearest_word(lexicon: &Lexicon, examples: &[&Example], fits: &[bool]) -> String {
    let objects: Vec<(&Example, usize, bool)> = examples
        .iter()
        .zip(fits)
        .filter_map(|(e, fit)| match e.of {
            ExampleOf::Object(object) => Some((*e, object, *fit)),
            ExampleOf::Encounter { .. } => None,
        })
        .collect();
    let mut best: Option<(usize, String)> = None;
    for family in &lexicon.families {
        for (w, word) in family.words.iter().enumerate() {
            let agrees = |(e, object, fit): &&(&Example, usize, bool)| {
                let looks = appearance(e.scene);
                let p = looks.get(*object).map(|x| family.probabilities(&lexicon.standardised(x)));
                p.and_then(|p| p.get(w).copied()).is_some_and(|p| (p > 0.5) == *fit)
            };
            let count = objects.iter().filter(agrees).count();
            if best.as_ref().is_none_or(|b| count > b.0) {
                best = Some((count, word.clone()));
            }
        }
    }
    match best {
        Some((count, word)) => {
            format!("the nearest word is \"{word}\", which agrees with {count} of {}", fits.len())
        }
        None => "no word is known to compare with".into(),
    }
}
