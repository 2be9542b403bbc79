//! Words of a lexicon: how probable each is of the objects and events of one scene, and draws of them.
//!
//! In draw k each object has one word of each family (colour, material, shape) and has or lacks each other word, drawn from
//! `P(word)`; draw 0 has the most probable ones. A program runs on each draw as on certain words, so that the probability of an
//! answer holds the uncertainty of the words as well as that of the physics. Draws in which a phrase names no object, or several, do
//! not count: the question presupposes that it names one.
//!
//! A word by logistic regression has `P(word|x) = sigma(kappa m)`, `m = w.z + b`, `kappa = 1/sqrt(1 + pi s^2/8)`, with z the
//! standardised features and s^2 the posterior variance of m (MacKay, Neural Computation 4 (1992) 720).

use crate::num::elementary::exp;
use crate::scene::Scene;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};

/// What the words of a family describe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WordFamily {
    Color,
    Material,
    Shape,
}

impl WordFamily {
    pub const ALL: [WordFamily; 3] = [WordFamily::Color, WordFamily::Material, WordFamily::Shape];

    /// The family that an operation filters by, asks for or counts.
    pub fn of_operation(token: &str) -> WordFamily {
        match token {
            "filter_color" | "query_color" | "count_colors" => WordFamily::Color,
            "filter_material" | "query_material" | "count_materials" => WordFamily::Material,
            _ => WordFamily::Shape,
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            WordFamily::Color => "color",
            WordFamily::Material => "material",
            WordFamily::Shape => "shape",
        }
    }

    /// The operation that filters by a word of this family.
    pub fn filter(self) -> &'static str {
        match self {
            WordFamily::Color => "filter_color",
            WordFamily::Material => "filter_material",
            WordFamily::Shape => "filter_shape",
        }
    }
}

/// How a word of the lexicon is used in a question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WordUse {
    Family(WordFamily),
    /// It describes objects.
    Objects,
    /// It describes collisions or approaches.
    Encounters,
    /// It stands for a change of an object.
    Change,
}

/// A word of the lexicon, and how it is used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LexiconWord {
    pub word: String,
    pub of: WordUse,
}

/// The words as they are written.
pub fn spellings(lexicon: &[LexiconWord]) -> Vec<String> {
    lexicon.iter().map(|w| w.word.clone()).collect()
}

impl LexiconWord {
    /// The token and the operation that filters objects by it, if it describes objects.
    pub fn description(&self) -> Option<(String, &'static str)> {
        match self.of {
            WordUse::Family(family) => Some((format!("{}:{}", family.name(), self.word), family.filter())),
            WordUse::Objects => Some((self.word.clone(), "filter_concept")),
            WordUse::Encounters | WordUse::Change => None,
        }
    }
}

/// Words of which an object has exactly one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FamilyProbabilities {
    pub family: WordFamily,
    pub words: Vec<String>,
    /// `probabilities[object][word]`; each row sums to one.
    pub probabilities: Vec<Vec<f64>>,
    /// The paper's score of the same words, which answers do not use; may be empty.
    #[serde(default)]
    pub cosine_scores: Vec<Vec<f64>>,
}

/// How probable a word is of one object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WordOfObject {
    pub word: String,
    /// The scene's id of the object.
    pub object_id: u32,
    pub probability: f64,
    /// The paper's cosine score, of a word of a family.
    pub cosine_score: Option<f64>,
}

/// A word that an object, a moment of an object, or an event has or lacks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ConceptProbabilities {
    pub name: String,
    pub holds: ConceptTruth,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ConceptTruth {
    /// `[object]`: of its looks, or of its motion over the whole video.
    Objects(Vec<f64>),
    /// `whole[object]` over the video, and `frames[object][frame]`; 0 where the object is not seen.
    Motion { whole: Vec<f64>, frames: Vec<Vec<f64>> },
    /// Of the [`ENCOUNTER_FEATURES`](super::ENCOUNTER_FEATURES) of a collision or an approach.
    Encounters(LogisticWord),
}

/// What a change multiplies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChangedQuantity {
    Mass,
    Velocity,
    Restitution,
    /// Friction of the ground.
    Friction,
}

/// A change that a word stands for: "heavier" multiplies the mass.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChangeWord {
    pub name: String,
    pub quantity: ChangedQuantity,
    pub factor: f64,
}

/// The words of a lexicon for one scene.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct WordProbabilities {
    pub families: Vec<FamilyProbabilities>,
    pub concepts: Vec<ConceptProbabilities>,
    pub changes: Vec<ChangeWord>,
}

impl WordProbabilities {
    /// All words: those of families, then the others, then the changes.
    pub fn vocabulary(&self) -> Vec<String> {
        let families = self.families.iter().flat_map(|f| f.words.iter().cloned());
        let concepts = self.concepts.iter().map(|c| c.name.clone());
        families.chain(concepts).chain(self.changes.iter().map(|c| c.name.clone())).collect()
    }

    /// How probable words are of the objects of their scene: of those words that describe objects over the whole video.
    pub fn of_objects(&self, scene: &Scene, words: &[String]) -> Vec<WordOfObject> {
        let mut found = vec![];
        for word in words {
            for (k, object) in scene.objects.iter().enumerate() {
                let Some((probability, cosine_score)) = self.of_object(word, k) else { continue };
                let (word, object_id) = (word.clone(), object.id);
                found.push(WordOfObject { word, object_id, probability, cosine_score });
            }
        }
        found
    }

    fn of_object(&self, word: &str, object: usize) -> Option<(f64, Option<f64>)> {
        for family in &self.families {
            if let Some(w) = family.words.iter().position(|known| known == word) {
                let at = |rows: &[Vec<f64>]| rows.get(object).and_then(|row| row.get(w)).copied();
                return Some((at(&family.probabilities)?, at(&family.cosine_scores)));
            }
        }
        let concept = self.concepts.iter().find(|c| c.name == word)?;
        let probability = match &concept.holds {
            ConceptTruth::Objects(p) | ConceptTruth::Motion { whole: p, .. } => p.get(object)?,
            ConceptTruth::Encounters(_) => return None,
        };
        Some((*probability, None))
    }

    /// All words with their uses, in the order of [`WordProbabilities::vocabulary`].
    pub fn lexicon_words(&self) -> Vec<LexiconWord> {
        let word = |word: &String, of| LexiconWord { word: word.clone(), of };
        let families = self.families.iter();
        let families = families.flat_map(|f| f.words.iter().map(move |w| word(w, WordUse::Family(f.family))));
        let concepts = self.concepts.iter().map(|c| {
            let of = match c.holds {
                ConceptTruth::Encounters(_) => WordUse::Encounters,
                _ => WordUse::Objects,
            };
            word(&c.name, of)
        });
        families.chain(concepts).chain(self.changes.iter().map(|c| word(&c.name, WordUse::Change))).collect()
    }

    pub fn family(&self, family: WordFamily) -> Option<&FamilyProbabilities> {
        self.families.iter().find(|f| f.family == family)
    }
}

/// A word as a logistic regression with the posterior of its weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LogisticWord {
    /// Which features it looks at.
    pub columns: Vec<usize>,
    /// Mean and standard deviation of each of them over the examples.
    pub mean: Vec<f64>,
    pub scale: Vec<f64>,
    /// Of the standardised features; the last one is the bias.
    pub weights: Vec<f64>,
    /// Posterior covariance of the weights, row by row.
    pub covariance: Vec<f64>,
}

impl LogisticWord {
    /// Whether it has all numbers for its features.
    pub fn is_whole(&self) -> bool {
        let n = self.columns.len() + 1;
        self.mean.len() + 1 == n
            && self.scale.len() + 1 == n
            && self.weights.len() == n
            && n.checked_mul(n) == Some(self.covariance.len())
            && self.scale.iter().all(|s| *s > 0.0)
            && [&self.mean, &self.scale, &self.weights, &self.covariance]
                .iter()
                .all(|numbers| numbers.iter().all(|x| x.is_finite()))
    }

    /// The standardised features and a one; a missing feature counts as the mean.
    pub fn inputs(&self, features: &[f64]) -> Vec<f64> {
        let at = |(k, column): (usize, &usize)| {
            let value = features.get(*column).copied().filter(|v| v.is_finite()).unwrap_or(self.mean[k]);
            ((value - self.mean[k]) / self.scale[k]).clamp(-FARTHEST, FARTHEST)
        };
        self.columns.iter().enumerate().map(at).chain([1.0]).collect()
    }

    /// P(word) of an object with these features.
    pub fn probability(&self, features: &[f64]) -> f64 {
        let x = self.inputs(features);
        let n = x.len();
        let mean: f64 = x.iter().zip(&self.weights).map(|(x, w)| x * w).sum();
        let row = |i: usize| (0..n).map(|j| self.covariance[i * n + j] * x[j]).sum::<f64>();
        let variance: f64 = (0..n).map(|i| x[i] * row(i)).sum::<f64>().max(0.0);
        logistic(mean / (1.0 + std::f64::consts::PI * variance / 8.0).sqrt())
    }
}

/// Farthest standardised feature: beyond it the examples say nothing more.
const FARTHEST: f64 = 20.0;

/// 1/(1 + e^-x).
pub fn logistic(x: f64) -> f64 {
    if x >= 0.0 {
        1.0 / (1.0 + exp(-x))
    } else {
        let e = exp(x);
        e / (1.0 + e)
    }
}

/// The words of one draw.
#[derive(Debug, Clone, PartialEq)]
pub struct WordDraw {
    /// `families[family][object]`: index of the word.
    families: Vec<Vec<usize>>,
    /// `uniform[concept][object]`: the word holds where its probability is above.
    uniform: Vec<Vec<f64>>,
}

impl WordDraw {
    /// The most probable words.
    pub fn best(words: &WordProbabilities, objects: usize) -> WordDraw {
        let most = |row: &Vec<f64>| {
            let best = row.iter().enumerate().rev().max_by(|a, b| a.1.total_cmp(b.1));
            best.map_or(0, |(k, _)| k)
        };
        WordDraw {
            families: words.families.iter().map(|f| f.probabilities.iter().map(most).collect()).collect(),
            uniform: vec![vec![0.5; objects.max(1)]; words.concepts.len()],
        }
    }

    /// Draw number `k` of a seed.
    pub fn drawn(words: &WordProbabilities, objects: usize, seed: u64, k: usize) -> WordDraw {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ WORD_STREAM);
        random.set_stream(k as u64);
        let mut uniform = || (random.next_u64() >> 11) as f64 * (f64::EPSILON / 2.0);
        let mut families = vec![];
        for family in &words.families {
            let rows = family.probabilities.iter();
            families.push(rows.map(|row| pick(row, uniform())).collect());
        }
        let concepts = words.concepts.iter();
        let uniform = concepts.map(|_| (0..objects.max(1)).map(|_| uniform()).collect()).collect();
        WordDraw { families, uniform }
    }
}

/// Keeps the draws of words apart from those of the physics.
const WORD_STREAM: u64 = 0x776f_7264;

/// The index at which the sum of the probabilities passes `u`.
fn pick(row: &[f64], u: f64) -> usize {
    let mut sum = 0.0;
    for (k, p) in row.iter().enumerate() {
        sum += p;
        if u < sum {
            return k;
        }
    }
    row.len().saturating_sub(1)
}

/// The words of a scene as one draw has them.
#[derive(Debug, Clone, Copy)]
pub struct DrawnWords<'a> {
    pub words: &'a WordProbabilities,
    pub draw: &'a WordDraw,
}

impl<'a> DrawnWords<'a> {
    /// The object's word of a family, if the lexicon has the family.
    pub fn of_family(&self, family: WordFamily, object: usize) -> Option<&'a str> {
        let at = self.words.families.iter().position(|f| f.family == family)?;
        let word = *self.draw.families.get(at)?.get(object)?;
        self.words.families[at].words.get(word).map(String::as_str)
    }

    /// Whether a word that is neither of a family nor a change holds for an object, in a frame or over the whole video.
    pub fn holds(&self, name: &str, object: usize, frame: Option<usize>) -> bool {
        let Some(k) = self.words.concepts.iter().position(|c| c.name == name) else {
            // A word of a family may be asked for as any other.
            return self.words.families.iter().any(|f| self.of_family(f.family, object) == Some(name));
        };
        let probability = match (&self.words.concepts[k].holds, frame) {
            (ConceptTruth::Objects(p), _) => p.get(object).copied(),
            (ConceptTruth::Motion { whole, .. }, None) => whole.get(object).copied(),
            (ConceptTruth::Motion { frames, .. }, Some(f)) => {
                frames.get(object).and_then(|p| p.get(f)).copied()
            }
            (ConceptTruth::Encounters(_), _) => None,
        };
        probability.is_some_and(|p| p > self.uniform(k, object))
    }

    /// Whether a word holds for a collision or an approach of these objects with these features.
    pub fn holds_for_encounter(&self, name: &str, objects: &[usize], features: &[f64]) -> bool {
        let Some(k) = self.words.concepts.iter().position(|c| c.name == name) else { return false };
        match &self.words.concepts[k].holds {
            ConceptTruth::Encounters(word) => {
                word.probability(features) > self.uniform(k, objects.first().copied().unwrap_or(0))
            }
            _ => false,
        }
    }

    pub fn change(&self, name: &str) -> Option<&'a ChangeWord> {
        self.words.changes.iter().find(|c| c.name == name)
    }

    fn uniform(&self, concept: usize, object: usize) -> f64 {
        self.draw.uniform.get(concept).and_then(|u| u.get(object)).copied().unwrap_or(0.5)
    }
}
