//! English to programs: reads a text by the table of forms. A text outside it is refused with the nearest form, never guessed.
//!
//! The table is a context-free grammar: a form is a rule, its slots are nonterminals. All readings of a phrase from a word on are
//! found by recursive descent; the first one that covers the whole text gives the program, its slots filled in.

use super::ReasonError;
use super::grammar::{FORMS, Form};
use super::program::nearest;
use std::collections::BTreeSet;

/// Longest part of a text that an error repeats (characters).
const MAX_PART: usize = 200;
/// Objects in examples.
const OBJECTS: [&str; 2] = ["the blue cube", "the red metal sphere"];

/// The start of a question that each phrase completes, for examples.
const QUESTION_STARTS: [(&str, &str); 5] = [
    ("if", "what will happen"),
    ("change", "what will happen if"),
    ("mass", "what will happen if the blue cube is"),
    ("speed", "what will happen if the blue cube moved"),
    ("law", "what will happen without"),
];
/// Function words, which do not count when texts are compared.
const FUNCTION_WORDS: &[&str] = &[
    "a", "an", "and", "any", "are", "as", "be", "by", "did", "do", "does", "for", "happen", "happens", "how",
    "if", "in", "is", "it", "its", "not", "of", "on", "or", "'s", "that", "the", "there", "this", "to",
    "was", "were", "what", "when", "which", "will", "with", "would",
];
/// Stems of the forms with the stems of their synonyms.
const SYNONYMS: &[(&str, &[&str])] = &[
    ("collid", &["collision", "crash", "bump", "hit", "strik", "touch", "impact", "meet"]),
    ("remov", &["gon", "vanish", "disappear", "miss", "without", "delet", "tak"]),
    ("heavy", &["heavier", "weigh", "weight", "mass", "lighter"]),
    ("fast", &["faster", "speed", "quick", "slow", "slower", "velocity"]),
    ("exit", &["leav", "out"]),
    ("enter", &["appear", "entranc"]),
    ("responsibl", &["caus", "why", "because", "reason"]),
    ("friction", &["slippery"]),
];

/// The program of a question.
pub fn question_program(text: &str) -> Result<Vec<String>, ReasonError> {
    program("question", text, "events")
}

/// The program of a choice. `observed`: the question is explanatory, about events of the video.
pub fn choice_program(text: &str, observed: bool) -> Result<Vec<String>, ReasonError> {
    program("choice", text, if observed { "events" } else { "all_events" })
}

/// Whether the question asks for the causes of an event of the video.
pub(super) fn is_explanatory(question: &[String]) -> bool {
    question.iter().any(|t| t == "filter_ancestor")
}

/// An example of every supported form of a question and of a choice.
pub fn examples() -> Vec<String> {
    FORMS.iter().filter(|f| ["question", "choice"].contains(&f.phrase)).map(example).collect()
}

fn program(phrase: &'static str, text: &str, source: &'static str) -> Result<Vec<String>, ReasonError> {
    let words = words(text);
    let mut reader = QuestionReader { words: &words, source, pending: vec![], furthest: 0, missing: None };
    let mut readings = reader.phrase(phrase, 0).into_iter();
    if let Some((_, tokens)) = readings.find(|(end, _)| *end == words.len()) {
        return Ok(tokens);
    }
    let (understood, rest) = words.split_at(reader.furthest.min(words.len()));
    let completed = reader.missing.filter(|(kept, _)| *kept > 0).map(|(kept, missing)| {
        let mut out = words.iter().take(kept).cloned().collect();
        missing.iter().for_each(|part| spell(part, &mut out));
        sentence(&out)
    });
    // The nearest form shares most content words: the understood part completed by an example, or else an example.
    let mut examples: Vec<String> = FORMS.iter().filter(|f| f.phrase == phrase).map(example).collect();
    if phrase == "question" {
        let completed_phrase = |f: &Form| {
            Some(format!("{} {}", QUESTION_STARTS.iter().find(|w| w.0 == f.phrase)?.1, example(f)))
        };
        examples.extend(FORMS.iter().filter_map(completed_phrase));
    }
    let asked = content(&words);
    let shared = |example: &str| content(&self::words(example)).intersection(&asked).count();
    let most = examples.iter().map(|e| shared(e)).max().unwrap_or(0);
    let nearest = match completed {
        Some(completed) if shared(&completed) >= most => completed,
        _ => {
            let best = examples.iter().filter(|e| shared(e) == most);
            nearest(&words.join(" "), best.map(String::as_str))
        }
    };
    let part = sentence(if rest.is_empty() { understood } else { rest }).chars().take(MAX_PART).collect();
    Err(ReasonError::NotUnderstood { part, nearest })
}

/// The form with every phrase written out, such as "what will not happen if the blue cube is removed".
fn example(form: &Form) -> String {
    let mut out = vec![];
    spell(form.reads, &mut out);
    sentence(&out)
}

fn sentence(words: &[String]) -> String {
    words.join(" ").replace(" 's", "'s")
}

/// Writes words, each phrase in its first form.
fn spell(reads: &'static str, out: &mut Vec<String>) {
    for part in reads.split_whitespace() {
        match slot(part).map(kind) {
            None => out.push(part.split('|').next().unwrap_or(part).to_string()),
            Some("S") => {
                let free = OBJECTS.iter().find(|o| !out.join(" ").contains(**o)).unwrap_or(&OBJECTS[0]);
                out.push(free.to_string());
            }
            Some("number") => out.push("3".into()),
            Some("length") => out.extend(["0.5".into(), "m".into()]),
            Some("some") => {
                out.push(if out.ends_with(&["the".to_string()]) { "cube" } else { "cubes" }.into())
            }
            Some(name) => {
                if let Some(form) = FORMS.iter().find(|f| f.phrase == name) {
                    spell(form.reads, out);
                }
            }
        }
    }
}

/// The name in `{name}`.
fn slot(part: &'static str) -> Option<&'static str> {
    part.strip_prefix('{')?.strip_suffix('}')
}

/// The phrase that a slot holds.
fn kind(slot: &'static str) -> &'static str {
    slot.trim_end_matches(|c: char| c.is_ascii_digit())
}

/// The word after a reading, and its program.
type PhraseReading = (usize, Vec<String>);

/// Programs of the slots of a form so far.
type SlotPrograms = Vec<(&'static str, Vec<String>)>;

struct QuestionReader<'a> {
    words: &'a [String],
    /// The token of the events that `@events` stands for.
    source: &'static str,
    /// What the enclosing phrases still require.
    pending: Vec<&'static str>,
    /// Number of words that the longest reading understood.
    furthest: usize,
    /// What the longest reading requires after this many words.
    missing: Option<(usize, Vec<&'static str>)>,
}

impl QuestionReader<'_> {
    /// All readings of a form from the word `start` on.
    fn form(&mut self, form: &'static Form, start: usize) -> Vec<PhraseReading> {
        let mut states: Vec<(usize, SlotPrograms)> = vec![(start, vec![])];
        let mut rest = form.reads;
        while let Some(part) = rest.split_whitespace().next() {
            let here = rest;
            rest = rest.get(part.len()..).unwrap_or_default().trim_start();
            let mut next = vec![];
            for (at, bound) in states {
                let Some(name) = slot(part) else {
                    if self.word(at).is_some_and(|w| part.split('|').any(|p| p == w)) {
                        next.push((at + 1, bound));
                    } else {
                        self.stuck(at, at, here);
                    }
                    continue;
                };
                self.pending.push(rest);
                let readings = self.phrase(kind(name), at);
                self.pending.pop();
                for (end, tokens) in readings {
                    next.push((end, [bound.clone(), vec![(name, tokens)]].concat()));
                }
            }
            states = next;
        }
        for (end, _) in &states {
            if self.pending.iter().all(|rest| rest.is_empty()) {
                self.stuck(*end, *end, "");
            }
        }
        states.into_iter().map(|(end, bound)| (end, self.program(form.program, &bound))).collect()
    }

    /// Records what a reading lacks that understood the words before `furthest`, if it is the first of the longest readings.
    fn stuck(&mut self, furthest: usize, kept: usize, missing: &'static str) {
        if self.missing.is_none() || furthest > self.furthest {
            self.furthest = furthest;
            self.missing =
                Some((kept, std::iter::once(missing).chain(self.pending.iter().rev().copied()).collect()));
        }
    }

    fn phrase(&mut self, name: &'static str, at: usize) -> Vec<PhraseReading> {
        match name {
            "S" => self.object(at).into_iter().collect(),
            "number" => match self.word(at) {
                Some(w) if positive(w).is_some() => vec![(at + 1, vec![w.to_string()])],
                _ => vec![],
            },
            "length" => self.length(at).into_iter().collect(),
            "some" => {
                let some = self.objects(at);
                if some.is_none() {
                    self.stuck(at, at, "{some}");
                }
                some.into_iter().collect()
            }
            _ => FORMS.iter().filter(|f| f.phrase == name).flat_map(|f| self.form(f, at)).collect(),
        }
    }

    fn program(&self, template: &str, bound: &[(&str, Vec<String>)]) -> Vec<String> {
        let fill = |token: &'_ str| match bound.iter().find(|(name, _)| token == format!("{{{name}}}")) {
            Some((_, tokens)) => tokens.clone(),
            None if token == "@events" => vec![self.source.to_string()],
            None => vec![token.to_string()],
        };
        template.split_whitespace().flat_map(fill).collect()
    }

    fn word(&self, at: usize) -> Option<&str> {
        self.words.get(at).map(String::as_str)
    }

    /// "0.5 m", "20 cm": a length in metres.
    fn length(&self, at: usize) -> Option<PhraseReading> {
        let value = positive(self.word(at)?)?;
        let metres = match self.word(at + 1)? {
            "m" | "metre" | "metres" | "meter" | "meters" => value,
            "cm" | "centimetres" | "centimeters" => value / 100.0,
            "mm" | "millimetres" | "millimeters" => value / 1000.0,
            _ => return None,
        };
        Some((at + 2, vec![metres.to_string()]))
    }

    /// "[the] blue rubber cube": one object, with at least one describing word.
    fn object(&mut self, at: usize) -> Option<PhraseReading> {
        let start = if self.word(at) == Some("the") { at + 1 } else { at };
        match self.objects(start) {
            Some((end, tokens)) if tokens.len() > 1 => {
                Some((end, [tokens, vec!["unique".to_string()]].concat()))
            }
            partly => {
                self.stuck(partly.map_or(start, |(end, _)| end), at, "{S}");
                None
            }
        }
    }

    /// "blue rubber cubes", "objects": the longest phrase of objects.
    fn objects(&self, start: usize) -> Option<PhraseReading> {
        let (mut at, mut found, mut noun) = (start, vec![], false);
        while let (Some(described), false) = (self.word(at).and_then(word), noun) {
            match described {
                None => noun = true,
                Some((_, filter)) if found.iter().any(|(_, f)| *f == filter) => break,
                Some(pair) => {
                    noun = pair.1 == "filter_shape";
                    found.push(pair);
                }
            }
            at += 1;
        }
        found.sort_by_key(|(_, f)| {
            ["filter_color", "filter_material", "filter_shape"].iter().position(|k| k == f)
        });
        let described = found.into_iter().flat_map(|(value, filter)| [value.to_string(), filter.to_string()]);
        (at > start).then(|| (at, std::iter::once("objects".to_string()).chain(described).collect()))
    }
}

/// Lower case words without punctuation; a possessive is a word of its own.
fn words(text: &str) -> Vec<String> {
    let text = text.to_lowercase().replace(['\u{2019}', '\u{2018}', '`'], "'").replace("'s", " 's ");
    let text = text.replace("billiard ball", "ball");
    // No form has the word "minus", so that a negative number is refused and not read without its sign.
    let negative = |w: &str| {
        w.strip_prefix(['-', '\u{2212}']).is_some_and(|n| n.starts_with(|c: char| c.is_ascii_digit()))
    };
    let signed =
        text.split_whitespace().map(|w| if negative(w) { format!("minus {w}") } else { w.to_string() });
    let text = signed.collect::<Vec<_>>().join(" ");
    let split = text.split(|c: char| !(c.is_alphanumeric() || c == '\'' || c == '.'));
    split.map(|w| w.trim_matches('.')).filter(|w| !w.is_empty()).map(str::to_string).collect()
}

/// Stems of the content words; all words for objects are one.
fn content(words: &[String]) -> BTreeSet<&str> {
    words.iter().filter_map(|w| stem(w)).collect()
}

/// The stem of a word, or of the form's word that it is a synonym of; `None` for function words.
fn stem(w: &str) -> Option<&str> {
    if FUNCTION_WORDS.contains(&w) || word(w) == Some(None) {
        return None;
    }
    if word(w).is_some() {
        return Some("object");
    }
    let stem = ["ing", "es", "ed", "s", "e"].iter().find_map(|end| w.strip_suffix(end));
    let stem = stem.filter(|s| s.len() > 2).unwrap_or(w);
    let synonym = SYNONYMS.iter().find(|(known, others)| *known == stem || others.contains(&stem));
    Some(synonym.map_or(stem, |(known, _)| known))
}

/// A finite number above 0.
fn positive(word: &str) -> Option<f64> {
    word.parse().ok().filter(|n: &f64| n.is_finite() && *n > 0.0)
}

/// For a describing word, the vocabulary's word and its filter; `Some(None)` for words such as "object".
fn word(w: &str) -> Option<Option<(&'static str, &'static str)>> {
    let (c, m, s) = ("filter_color", "filter_material", "filter_shape");
    Some(Some(match w {
        "gray" | "grey" => ("gray", c),
        "red" => ("red", c),
        "blue" => ("blue", c),
        "green" => ("green", c),
        "brown" => ("brown", c),
        "cyan" => ("cyan", c),
        "purple" => ("purple", c),
        "yellow" => ("yellow", c),
        "white" => ("white", c),
        "black" => ("black", c),
        "orange" => ("orange", c),
        "pink" => ("pink", c),
        "rubber" | "matte" => ("rubber", m),
        "metal" | "metallic" | "shiny" => ("metal", m),
        "sphere" | "spheres" | "ball" | "balls" | "billiard" | "billiards" => ("sphere", s),
        "cylinder" | "cylinders" | "disc" | "puck" => ("cylinder", s),
        "cube" | "cubes" | "box" | "boxes" | "block" | "blocks" => ("cube", s),
        "object" | "objects" | "thing" | "things" | "one" | "ones" => return Some(None),
        _ => return None,
    }))
}
