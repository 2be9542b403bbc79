//! A lexicon: maps from features to a space, word vectors in it, and words learned from examples.
//!
//! For an object with standardised features f, a family has `z = W f + u` in R^C and for each word w a vector e_w:
//! `P(w|f) = softmax_w(e_w . z / T)`, T the temperature of the calibration, moderated by how far the lessons determine the weights (see
//! `moderated`). The paper's score of the same word is
//! `(cos(z, e_w) - mu)/sigma` with mu = 0.15, sigma = 0.2125 (DCL, Chen et al., ICLR 2021, as released); it is reported beside P.

use super::error::ConceptError;
use super::features::{FEATURES_VERSION, FeatureLayout, appearance, motion, speeds};
use super::moderated::WeightInformation;
use crate::fit::Fit;
use crate::num::elementary::exp;
use crate::reason::{
    ChangeWord, ChangedQuantity, ConceptProbabilities, ConceptTruth, FamilyProbabilities, LexiconWord,
    LogisticWord, WordFamily, WordProbabilities, WordUse, can_be_learned,
};
use crate::scene::Scene;
use serde::{Deserialize, Serialize};

/// Change it when the fields of a lexicon change.
pub const LEXICON_VERSION: u32 = 1;
/// Most words of a lexicon: a text is compared with each of them.
const MOST_WORDS: usize = 1000;
/// Longest name of a word (bytes).
pub const LONGEST_NAME: usize = 40;
/// The paper's cosine score: `(cos - MU)/SIGMA`.
const MU: f64 = 0.15;
const SIGMA: f64 = 0.2125;

/// Words with what they mean in features.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lexicon {
    pub version: u32,
    /// Features of appearance; `None` while no word of appearance is known.
    pub layout: Option<FeatureLayout>,
    /// Of each feature over the objects of the lessons.
    pub mean: Vec<f64>,
    pub scale: Vec<f64>,
    pub families: Vec<LearnedFamily>,
    pub words: Vec<LearnedWord>,
    /// What it was learned from.
    pub videos: usize,
    pub questions: usize,
}

/// Exclusive words: of each family an object has one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LearnedFamily {
    pub family: WordFamily,
    pub words: Vec<String>,
    /// Questions and choices that name each word or have it as their answer.
    pub seen: Vec<usize>,
    /// Dimension C of the space.
    pub dimension: usize,
    /// W, C x D, row by row.
    pub map: Vec<f64>,
    /// u, C.
    pub offset: Vec<f64>,
    /// e_w, words x C, row by row.
    pub vectors: Vec<f64>,
    /// T.
    pub temperature: f64,
    /// How far the lessons determine the weights; `None`: they count as certain.
    #[serde(default)]
    pub information: Option<WeightInformation>,
    pub calibration: Option<WordCalibration>,
}

/// How well probabilities were calibrated on videos that were left out of training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WordCalibration {
    /// Answers on the left-out videos, and the mean negative log probability that they had.
    pub answers: usize,
    pub log_loss: f64,
    /// Share of them whose most probable answer was right.
    pub accuracy: f64,
    /// Share of answers that are wrong whatever the words: events that were missed.
    #[serde(default)]
    pub mistaken: f64,
    /// By the probability of the most probable answer.
    #[serde(default)]
    pub bins: Vec<CalibrationBin>,
}

/// Left-out answers of about one probability.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibrationBin {
    pub answers: usize,
    /// Mean probability of the most probable answers.
    pub probability: f64,
    /// Share of them that are right, and its 95 % interval (Wilson, J. Am. Stat. Assoc. 22 (1927) 209).
    pub accuracy: f64,
    pub interval: [f64; 2],
}

/// What a word from examples is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WordKind {
    /// Of the looks of an object: "shiny".
    Static,
    /// Of the motion of an object: "fast".
    Dynamic,
    /// Of a collision: "glancing".
    Event,
    /// Of what is changed: "heavier".
    Change,
}

impl WordKind {
    pub fn name(self) -> &'static str {
        match self {
            WordKind::Static => "a word of looks",
            WordKind::Dynamic => "a word of motion",
            WordKind::Event => "a word of events",
            WordKind::Change => "a word of changes",
        }
    }
}

/// A word learned by itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LearnedWord {
    pub name: String,
    pub kind: WordKind,
    pub meaning: Meaning,
    /// Examples that fit and that do not; of a change, questions with answers.
    pub yes: usize,
    pub no: usize,
    /// Log evidence of the chosen features above that of none (nat).
    pub evidence: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Meaning {
    Logistic(LogisticWord),
    Change {
        quantity: ChangedQuantity,
        factor: f64,
        /// 95 % interval.
        interval: [f64; 2],
    },
}

impl Default for Lexicon {
    fn default() -> Self {
        Lexicon {
            version: LEXICON_VERSION,
            layout: None,
            mean: vec![],
            scale: vec![],
            families: vec![],
            words: vec![],
            videos: 0,
            questions: 0,
        }
    }
}

impl Lexicon {
    /// Key of its content: equal lexica have equal keys.
    pub fn digest(&self) -> String {
        crate::scene::canonical_digest("lexicon", self)
    }

    /// All words: of families, and learned by themselves.
    pub fn names(&self) -> Vec<String> {
        let families = self.families.iter().flat_map(|f| f.words.iter().cloned());
        families.chain(self.words.iter().map(|w| w.name.clone())).collect()
    }

    /// All words with how they are used in questions.
    pub fn uses(&self) -> Vec<LexiconWord> {
        let families =
            self.families.iter().flat_map(|f| f.words.iter().map(|w| (w, WordUse::Family(f.family))));
        let words = self.words.iter().map(|w| {
            let of = match w.kind {
                WordKind::Static | WordKind::Dynamic => WordUse::Objects,
                WordKind::Event => WordUse::Encounters,
                WordKind::Change => WordUse::Change,
            };
            (&w.name, of)
        });
        families.chain(words).map(|(word, of)| LexiconWord { word: word.clone(), of }).collect()
    }

    /// Refuses a lexicon that another version of the program made, whose numbers do not fit together, or whose words cannot be used.
    pub fn check(&self) -> Result<(), ConceptError> {
        let features = self.layout.as_ref().map_or(FEATURES_VERSION, |l| l.version);
        for (found, expected) in [(self.version, LEXICON_VERSION), (features, FEATURES_VERSION)] {
            if found != expected {
                return Err(ConceptError::Version { found, expected });
            }
        }
        let features = self.mean.len();
        let whole = features == self.scale.len()
            && self.layout.as_ref().is_none_or(|l| l.count() == features)
            && self.mean.iter().all(|x| x.is_finite())
            && self.scale.iter().all(|x| x.is_finite() && *x > 0.0)
            && self.families.iter().all(|f| f.is_whole(features))
            && self.words.iter().all(|w| w.meaning.is_whole());
        match self.unusable_word() {
            _ if !whole => Err(ConceptError::Incomplete),
            Some(problem) => Err(ConceptError::UnusableWord { problem }),
            None => Ok(()),
        }
    }

    /// Why questions cannot have its words, if one of them cannot.
    fn unusable_word(&self) -> Option<String> {
        let names = self.names();
        if names.len() > MOST_WORDS {
            return Some(format!("it has {} words, and at most {MOST_WORDS} can be read", names.len()));
        }
        let is_short = |name: &str| !name.is_empty() && name.len() <= LONGEST_NAME;
        if let Some(name) = names.iter().find(|n| !is_short(n) || n.chars().any(char::is_control)) {
            let start: String = name.chars().take(LONGEST_NAME).collect();
            let rule = format!("a name has 1 to {LONGEST_NAME} bytes, and no control characters");
            return Some(format!("a word is named {start:?}, but {rule}"));
        }
        if let Some(word) = self.words.iter().find(|w| !can_be_learned(&w.name)) {
            return Some(format!(
                "it has the word \"{}\", which questions use for something else",
                word.name
            ));
        }
        let is_other =
            |w: &&LearnedWord| (w.kind == WordKind::Change) == matches!(w.meaning, Meaning::Logistic(_));
        let other = self.words.iter().find(is_other)?;
        Some(format!("the meaning of \"{}\" is none of a word for a {}", other.name, other.kind.name()))
    }

    /// Standardised features of appearance.
    pub fn standardised(&self, features: &[f64]) -> Vec<f64> {
        let each = features.iter().zip(self.mean.iter().zip(&self.scale));
        each.map(|(x, (mean, scale))| ((x - mean) / scale).clamp(-FARTHEST_FEATURE, FARTHEST_FEATURE))
            .collect()
    }
}

/// Farthest standardised feature: one that lies farther is an artefact of measurement.
const FARTHEST_FEATURE: f64 = 8.0;

impl Meaning {
    /// Whether it has all its numbers.
    fn is_whole(&self) -> bool {
        match self {
            Meaning::Logistic(model) => model.is_whole(),
            Meaning::Change { factor, interval: [low, high], .. } => {
                [*factor, *low, *high].iter().all(|f| f.is_finite() && *f > 0.0)
            }
        }
    }
}

impl LearnedFamily {
    /// Whether it has all numbers for this number of features.
    fn is_whole(&self, features: usize) -> bool {
        let sized =
            |numbers: &[f64], rows: usize, columns: usize| rows.checked_mul(columns) == Some(numbers.len());
        let numbers = self.map.iter().chain(&self.offset).chain(&self.vectors);
        self.temperature.is_finite()
            && self.temperature > 0.0
            && numbers.into_iter().all(|x| x.is_finite())
            && sized(&self.map, self.dimension, features)
            && self.offset.len() == self.dimension
            && sized(&self.vectors, self.words.len(), self.dimension)
            && self.information.as_ref().is_none_or(|i| i.is_whole(self.words.len(), features))
    }

    /// z = W f + u.
    pub fn place(&self, features: &[f64]) -> Vec<f64> {
        let rows = self.map.chunks(features.len().max(1)).zip(&self.offset);
        rows.map(|(row, u)| u + row.iter().zip(features).map(|(w, f)| w * f).sum::<f64>()).collect()
    }

    fn vector(&self, word: usize) -> &[f64] {
        &self.vectors[word * self.dimension..(word + 1) * self.dimension]
    }

    /// e_w . z for each word.
    pub fn logits(&self, features: &[f64]) -> Vec<f64> {
        let z = self.place(features);
        (0..self.words.len()).map(|w| self.vector(w).iter().zip(&z).map(|(e, z)| e * z).sum()).collect()
    }

    /// P(w|f) for each word.
    pub fn probabilities(&self, features: &[f64]) -> Vec<f64> {
        self.probabilities_at(features, self.temperature)
    }

    /// The same at another temperature.
    pub fn probabilities_at(&self, features: &[f64], temperature: f64) -> Vec<f64> {
        let logits: Vec<f64> = self.logits(features).iter().map(|l| l / temperature).collect();
        match &self.information {
            Some(information) => information.moderated(&logits, features),
            None => softmax(&logits),
        }
    }

    /// The paper's `(cos(z, e_w) - mu)/sigma` for each word.
    pub fn cosine_scores(&self, features: &[f64]) -> Vec<f64> {
        let z = self.place(features);
        let score = |w| (cosine(self.vector(w), &z) - MU) / SIGMA;
        (0..self.words.len()).map(score).collect()
    }

    /// The words nearest to a word, by the cosine of their vectors; nearest first.
    pub fn nearest(&self, word: usize) -> Vec<(String, f64)> {
        let others = (0..self.words.len()).filter(|w| *w != word);
        let mut all: Vec<(String, f64)> =
            others.map(|w| (self.words[w].clone(), cosine(self.vector(w), self.vector(word)))).collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        all
    }

    /// Weight of each standardised feature in the logit of a word, above the mean over the family.
    pub fn weights(&self, word: usize) -> Vec<f64> {
        let length = self.map.len() / self.dimension.max(1);
        let of = |w: usize, k: usize| {
            (0..self.dimension).map(|c| self.vector(w)[c] * self.map[c * length + k]).sum::<f64>()
        };
        let n = self.words.len().max(1) as f64;
        (0..length).map(|k| of(word, k) - (0..self.words.len()).map(|w| of(w, k)).sum::<f64>() / n).collect()
    }
}

/// e^(a_k) / sum e^(a_j).
pub fn softmax(logits: &[f64]) -> Vec<f64> {
    let largest = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = logits.iter().map(|l| exp(l - largest)).collect();
    let total: f64 = weights.iter().sum();
    weights.into_iter().map(|w| w / total).collect()
}

/// The cosine of the angle between two vectors; 0 where one has no length.
pub fn cosine(a: &[f64], b: &[f64]) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let length = (dot(a, a) * dot(b, b)).sqrt();
    if length > 0.0 { dot(a, b) / length } else { 0.0 }
}

/// How probable each word of a lexicon is of the objects and events of a scene. `fit`: with the scene's index in it.
pub fn word_probabilities(
    lexicon: &Lexicon,
    scene: &Scene,
    fit: Option<(&Fit, usize)>,
) -> Result<WordProbabilities, ConceptError> {
    lexicon.check()?;
    if lexicon.layout.is_some() {
        let video = || format!("video \"{}\"", scene.name);
        FeatureLayout::of_video(&video, scene, lexicon.layout.as_ref())?;
    }
    let looks = appearance(scene);
    let standard: Vec<Vec<f64>> = looks.iter().map(|f| lexicon.standardised(f)).collect();
    let family = |f: &LearnedFamily| FamilyProbabilities {
        family: f.family,
        words: f.words.clone(),
        probabilities: standard.iter().map(|x| f.probabilities(x)).collect(),
        cosine_scores: standard.iter().map(|x| f.cosine_scores(x)).collect(),
    };
    let mut words = WordProbabilities {
        families: lexicon.families.iter().map(family).collect(),
        ..WordProbabilities::default()
    };
    let has_motion = lexicon.words.iter().any(|w| w.kind == WordKind::Dynamic);
    let moves = if has_motion { motion(scene, fit) } else { vec![] };
    for word in &lexicon.words {
        let holds = match (&word.meaning, word.kind) {
            (Meaning::Change { quantity, factor, .. }, _) => {
                words.changes.push(ChangeWord {
                    name: word.name.clone(),
                    quantity: *quantity,
                    factor: *factor,
                });
                continue;
            }
            (Meaning::Logistic(model), WordKind::Static) => {
                ConceptTruth::Objects(looks.iter().map(|x| model.probability(x)).collect())
            }
            (Meaning::Logistic(model), WordKind::Dynamic) => ConceptTruth::Motion {
                whole: moves.iter().map(|x| model.probability(x)).collect(),
                frames: at_frames(scene, model, &moves),
            },
            (Meaning::Logistic(model), _) => ConceptTruth::Encounters(model.clone()),
        };
        words.concepts.push(ConceptProbabilities { name: word.name.clone(), holds });
    }
    Ok(words)
}

/// P(word of motion) in each frame: the speeds of the whole video are replaced by that of the frame.
fn at_frames(scene: &Scene, model: &LogisticWord, moves: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let of = |(speeds, whole): (Vec<Option<f64>>, &Vec<f64>)| {
        let at = |speed: &Option<f64>| {
            let Some(speed) = speed else { return 0.0 };
            let mut features = whole.clone();
            features.iter_mut().take(SPEED_FEATURES).for_each(|f| *f = *speed);
            model.probability(&features)
        };
        speeds.iter().map(at).collect()
    };
    speeds(scene).into_iter().zip(moves).map(of).collect()
}

/// The first features of motion are speeds.
const SPEED_FEATURES: usize = 3;
