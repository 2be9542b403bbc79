//! What to ask instead: the example that shares most with a text, about objects of the text or of the scene.

use super::chart::QuestionReader;
use super::lexicon::{TextWord, Vocabulary};
use crate::reason::ReasonError;
use crate::reason::language::nearest;
use crate::reason::operations::ops;
use crate::scene::Scene;
use std::collections::BTreeSet;

/// Longest part of a text that an error repeats (characters).
const MAX_PART: usize = 200;
/// Objects in examples without a scene.
const OBJECTS: [&str; 2] = ["the blue cube", "the red metal sphere"];

const QUESTIONS: &str = include_str!("examples.txt");
const CHOICES: &str = include_str!("choices.txt");

/// An example of every kind of question and choice.
pub fn examples() -> Vec<String> {
    QUESTIONS.lines().chain(CHOICES.lines()).map(|line| filled(line, &OBJECTS.map(str::to_string))).collect()
}

fn filled(line: &str, objects: &[String; 2]) -> String {
    line.replace("{1}", &objects[0]).replace("{2}", &objects[1])
}

/// The part of a text that was not understood, and the nearest example.
pub fn not_understood(
    phrase: &str,
    words: &[TextWord],
    furthest: usize,
    vocabulary: &Vocabulary,
    scene: Option<&Scene>,
) -> ReasonError {
    let unknown: Vec<&str> =
        words.iter().filter(|w| w.canonical.is_empty()).map(|w| w.text.as_str()).collect();
    // A phrase of several words is the text of each of its canonical words.
    let texts = |from: usize| {
        let mut texts: Vec<&str> = words.iter().skip(from).map(|w| w.text.as_str()).collect();
        texts.dedup();
        texts
    };
    let (rest, all) = (texts(furthest), texts(0));
    let whole = all.join(" ");
    let part = [unknown.join(" "), rest.join(" "), whole.clone()].into_iter().find(|p| !p.is_empty());
    let part = part.unwrap_or_default();
    let objects = named(words, vocabulary, scene);
    let lines = if phrase == "choice" { CHOICES } else { QUESTIONS }.lines();
    let examples: Vec<String> = lines.map(|line| filled(line, &objects)).collect();
    let asked = content(words, vocabulary);
    let shared = |example: &str| content(&vocabulary.read(example), vocabulary).intersection(&asked).count();
    let most = examples.iter().map(|e| shared(e)).max().unwrap_or(0);
    let best = examples.iter().filter(|e| shared(e) == most);
    let nearest = nearest(&whole, best.map(String::as_str));
    ReasonError::NotUnderstood { part: part.chars().take(MAX_PART).collect(), nearest }
}

/// Two objects to speak of: those of the text, then those of the scene.
fn named(words: &[TextWord], vocabulary: &Vocabulary, scene: Option<&Scene>) -> [String; 2] {
    let mut found: Vec<String> = vec![];
    for (from, to, _) in QuestionReader::new(words, vocabulary).mentions() {
        let mut texts: Vec<&str> = words.iter().skip(from).take(to - from).map(|w| w.text.as_str()).collect();
        texts.dedup();
        found.push(format!("the {}", texts.join(" ")));
    }
    match scene {
        Some(scene) => found.extend((0..scene.objects.len()).map(|i| ops::name(scene, i))),
        None => found.extend(OBJECTS.map(str::to_string)),
    }
    found.dedup();
    let first = found.first().cloned().unwrap_or_default();
    let second = found.iter().find(|o| **o != first).cloned().unwrap_or_else(|| first.clone());
    [first, second]
}

/// The canonical words of a text; all objects are one.
fn content(words: &[TextWord], vocabulary: &Vocabulary) -> BTreeSet<String> {
    let of = |w: &TextWord| match vocabulary.description(w) {
        Some(_) => vec!["object".to_string()],
        None => w.canonical.clone(),
    };
    words.iter().flat_map(of).collect()
}
