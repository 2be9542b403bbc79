//! What a word of a lexicon means: what it looks at, the words near it, and its figures.

use super::error::ConceptError;
use super::features::{FeatureLayout, MOTION};
use super::lexicon::{LearnedWord, Lexicon, Meaning, WordCalibration, WordKind};
use crate::reason::{ENCOUNTER_FEATURES, WordFamily};
use serde::{Deserialize, Serialize};

/// Features that a description lists.
const LISTED: usize = 8;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WordDescription {
    pub name: String,
    /// The family, of a word of a family.
    pub family: Option<WordFamily>,
    /// The kind, of a word learned by itself.
    pub kind: Option<WordKind>,
    /// Features with the largest weights, standardised; largest first.
    pub looks_at: Vec<(String, f64)>,
    /// Words of the family by the cosine of their vectors; nearest first.
    pub nearest: Vec<(String, f64)>,
    /// Questions that name it, or examples that fit.
    pub examples: usize,
    pub counter_examples: usize,
    pub calibration: Option<WordCalibration>,
    /// Of a change: its factor and the 95 % interval.
    pub factor: Option<[f64; 3]>,
    /// Log evidence above no feature at all (nat), of a word learned by itself.
    pub evidence: Option<f64>,
}

/// Describes a word of the lexicon.
pub fn describe(lexicon: &Lexicon, name: &str) -> Result<WordDescription, ConceptError> {
    for family in &lexicon.families {
        if let Some(word) = family.words.iter().position(|w| w == name) {
            let names = lexicon.layout.as_ref().map_or(vec![], FeatureLayout::names);
            return Ok(WordDescription {
                name: name.into(),
                family: Some(family.family),
                kind: None,
                looks_at: largest(&names, &family.weights(word)),
                nearest: family.nearest(word),
                examples: family.seen.get(word).copied().unwrap_or(0),
                counter_examples: 0,
                calibration: family.calibration.clone(),
                factor: None,
                evidence: None,
            });
        }
    }
    let known = || ConceptError::UnknownWord { name: name.into(), known: lexicon.names() };
    let word = lexicon.words.iter().find(|w| w.name == name).ok_or_else(known)?;
    let (mut looks_at, mut factor) = (vec![], None);
    match &word.meaning {
        Meaning::Logistic(model) => {
            let all = feature_names(lexicon, word);
            let names: Vec<String> = model.columns.iter().filter_map(|c| all.get(*c).cloned()).collect();
            looks_at = largest(&names, &model.weights);
        }
        Meaning::Change { factor: f, interval: [low, high], .. } => factor = Some([*f, *low, *high]),
    }
    Ok(WordDescription {
        name: name.into(),
        family: None,
        kind: Some(word.kind),
        looks_at,
        nearest: vec![],
        examples: word.yes,
        counter_examples: word.no,
        calibration: None,
        factor,
        evidence: Some(word.evidence),
    })
}

fn feature_names(lexicon: &Lexicon, word: &LearnedWord) -> Vec<String> {
    let owned = |names: &[&str]| names.iter().map(|n| n.to_string()).collect();
    match word.kind {
        WordKind::Static => lexicon.layout.as_ref().map_or(vec![], FeatureLayout::names),
        WordKind::Dynamic => owned(&MOTION),
        WordKind::Event | WordKind::Change => owned(&ENCOUNTER_FEATURES),
    }
}

fn largest(names: &[String], weights: &[f64]) -> Vec<(String, f64)> {
    let mut all: Vec<(String, f64)> = names.iter().cloned().zip(weights.iter().copied()).collect();
    all.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    all.truncate(LISTED);
    all
}
