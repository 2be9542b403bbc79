//! Words to a program: all readings of a phrase from a word on, by recursive descent over the table of forms.
//!
//! The table is a context-free grammar: a form is a rule, its slots are nonterminals. The readings of a phrase at a word are found
//! once. The first reading that covers the whole text gives the program, its slots filled in.

use super::forms::{FORMS, Form};
use super::lexicon::{TextWord, Vocabulary};
use crate::reason::units::{MeasureUnit, UNITS};
use crate::reason::words::{LexiconWord, WordUse};
use std::collections::HashMap;
use std::sync::LazyLock;

/// The word after a reading, and its program.
type PhraseReading = (usize, Vec<String>);

/// Programs of the slots of a form so far.
type SlotPrograms = Vec<(&'static str, Vec<String>)>;

/// The forms of each phrase.
static PHRASES: LazyLock<HashMap<&'static str, Vec<&'static Form>>> = LazyLock::new(|| {
    let mut phrases: HashMap<&'static str, Vec<&'static Form>> = HashMap::new();
    FORMS.iter().for_each(|form| phrases.entry(form.phrase).or_default().push(form));
    phrases
});

/// Most readings of a phrase at a word; texts have a handful.
const MOST_READINGS: usize = 64;

pub struct QuestionReader<'a> {
    words: &'a [TextWord],
    vocabulary: &'a Vocabulary,
    /// Number of words that the longest reading understood.
    pub furthest: usize,
    known: HashMap<(&'static str, usize), Vec<PhraseReading>>,
}

/// The name in `{name}`.
pub fn slot(part: &'static str) -> Option<&'static str> {
    part.strip_prefix('{')?.strip_suffix('}')
}

/// The phrase that a slot holds: `{S1}` and `{S2}` hold `S`.
pub fn kind(slot: &'static str) -> &'static str {
    match slot.strip_suffix(['1', '2']) {
        Some(name) if !PHRASES.contains_key(slot) => name,
        _ => slot,
    }
}

impl<'a> QuestionReader<'a> {
    pub fn new(words: &'a [TextWord], vocabulary: &'a Vocabulary) -> QuestionReader<'a> {
        QuestionReader { words, vocabulary, furthest: 0, known: HashMap::new() }
    }

    /// The programs of all readings of the whole text, best first; `@events` is still in them.
    pub fn whole(&mut self, phrase: &'static str) -> Vec<Vec<String>> {
        let end = self.words.len();
        let readings = self.phrase(phrase, 0).into_iter();
        readings.filter(|(at, _)| *at == end).map(|(_, tokens)| tokens).collect()
    }

    /// All readings of a form from the word `start` on.
    fn form(&mut self, form: &'static Form, start: usize) -> Vec<PhraseReading> {
        let mut states: Vec<(usize, SlotPrograms)> = vec![(start, vec![])];
        let mut rest = form.reads;
        while let Some(part) = rest.split_whitespace().next() {
            rest = rest.get(part.len()..).unwrap_or_default().trim_start();
            let mut next = vec![];
            for (at, bound) in states {
                let Some(name) = slot(part) else {
                    if self.stands_for(at, part) {
                        next.push((at + 1, bound));
                        self.furthest = self.furthest.max(at + 1);
                    }
                    continue;
                };
                let readings = self.phrase(kind(name), at);
                for (end, tokens) in readings {
                    next.push((end, [bound.clone(), vec![(name, tokens)]].concat()));
                }
            }
            states = next;
            if states.is_empty() {
                return vec![];
            }
        }
        let distinct = |(_, bound): &(usize, SlotPrograms)| {
            let (first, second) = (one(bound, "S1"), one(bound, "S2"));
            first.is_none() || first != second
        };
        states.into_iter().filter(distinct).map(|(end, bound)| (end, fill(form.program, &bound))).collect()
    }

    fn phrase(&mut self, name: &'static str, at: usize) -> Vec<PhraseReading> {
        self.furthest = self.furthest.max(at.min(self.words.len()));
        if let Some(known) = self.known.get(&(name, at)) {
            return known.clone();
        }
        let readings = match name {
            "S" => self.object(at).into_iter().collect(),
            "number" => self.number(at).map(|n| (at + 1, vec![n.to_string()])).into_iter().collect(),
            "length" => self.measured(at, "m"),
            "seconds" => self.measured(at, "s"),
            "quantity" => self.quantity(at).into_iter().collect(),
            "unit" => self.unit(at).map(|unit| (at + 1, vec![unit.name.to_string()])).into_iter().collect(),
            "some" => self.objects(at).into_iter().collect(),
            "word" => self.learned(at, &|w| w.description().map(|(token, _)| token)),
            "encounter" => self.learned(at, &|w| (w.of == WordUse::Encounters).then(|| w.word.clone())),
            "change_word" => self.learned(at, &|w| (w.of == WordUse::Change).then(|| w.word.clone())),
            _ => {
                let forms = PHRASES.get(name).map(Vec::as_slice).unwrap_or_default();
                forms.iter().flat_map(|f| self.form(f, at)).take(MOST_READINGS).collect::<Vec<_>>()
            }
        };
        self.known.insert((name, at), readings.clone());
        readings
    }

    fn stands_for(&self, at: usize, canonical: &str) -> bool {
        self.words.get(at).is_some_and(|w| w.canonical.iter().any(|c| c == canonical))
    }

    /// A word of the lexicon as a token, if it is used so.
    fn learned(&self, at: usize, token: &dyn Fn(&LexiconWord) -> Option<String>) -> Vec<PhraseReading> {
        let word = self.words.get(at).and_then(|w| self.vocabulary.learned(w));
        word.and_then(token).map(|token| (at + 1, vec![token])).into_iter().collect()
    }

    /// A finite number, 0 or more.
    fn number(&self, at: usize) -> Option<f64> {
        let parse = |w: &String| w.parse().ok().filter(|n: &f64| n.is_finite() && *n >= 0.0);
        self.words.get(at)?.canonical.iter().find_map(parse)
    }

    /// The unit that a word is.
    fn unit(&self, at: usize) -> Option<&'static MeasureUnit> {
        let of = |unit: &&MeasureUnit| match unit.name {
            // In words.txt this is the ordinal too.
            "s" => self.stands_for(at, "second"),
            name => self.stands_for(at, name),
        };
        UNITS.iter().find(of)
    }

    /// A number with a unit of this kind, as a number of the SI unit.
    fn measured(&self, at: usize, base: &str) -> Vec<PhraseReading> {
        let found = self.number(at).zip(self.unit(at + 1).filter(|unit| unit.base == base));
        let value = found.map(|(value, unit)| unit.in_base(value)).filter(|value| value.is_finite());
        value.map(|value| (at + 2, vec![value.to_string()])).into_iter().collect()
    }

    /// A number with any unit.
    fn quantity(&self, at: usize) -> Option<PhraseReading> {
        let (value, unit) = self.number(at).zip(self.unit(at + 1))?;
        Some((at + 2, vec![value.to_string(), unit.name.to_string(), "of_unit".to_string()]))
    }

    /// "blue rubber cube", "object 3": one object, with at least one describing word.
    fn object(&mut self, at: usize) -> Option<PhraseReading> {
        if let Some(number) = self.number(at + 1).filter(|_| self.stands_for(at, "object")) {
            return Some((at + 2, vec![number.to_string(), "object_number".to_string()]));
        }
        let (end, tokens) = self.objects(at).filter(|(_, tokens)| tokens.len() > 1)?;
        // "the red cube (object 3)".
        if let Some(number) = self.number(end + 1).filter(|_| self.stands_for(end, "object")) {
            return Some((end + 2, vec![number.to_string(), "object_number".to_string()]));
        }
        Some((end, [tokens, vec!["unique".to_string()]].concat()))
    }

    /// The phrases of single objects: their first word, the word after them, and their programs.
    pub fn mentions(&mut self) -> Vec<(usize, usize, Vec<String>)> {
        let (mut found, mut at) = (vec![], 0);
        while at < self.words.len() {
            match self.object(at) {
                Some((end, tokens)) => {
                    found.push((at, end, tokens));
                    at = end;
                }
                None => at += 1,
            }
        }
        found
    }

    /// "blue rubber cubes", "objects": the longest phrase of objects.
    fn objects(&self, start: usize) -> Option<PhraseReading> {
        let (mut at, mut found, mut noun) = (start, vec![], false);
        let described = |at: usize| self.words.get(at).and_then(|w| self.vocabulary.description(w));
        while let (Some(described), false) = (described(at), noun) {
            match described {
                None => noun = true,
                // An object has one colour, and any number of other words.
                Some((_, filter))
                    if filter != "filter_concept" && found.iter().any(|(_, f)| *f == filter) =>
                {
                    break;
                }
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
        let described = found.into_iter().flat_map(|(value, filter)| [value, filter.to_string()]);
        (at > start).then(|| (at, std::iter::once("objects".to_string()).chain(described).collect()))
    }
}

fn one<'b>(bound: &'b SlotPrograms, name: &str) -> Option<&'b Vec<String>> {
    bound.iter().find(|(n, _)| *n == name).map(|(_, tokens)| tokens)
}

/// The program of a form: its template with the slots' programs.
fn fill(template: &str, bound: &SlotPrograms) -> Vec<String> {
    let fill = |token: &str| {
        let name = token.strip_prefix('{').and_then(|t| t.strip_suffix('}'));
        match name.and_then(|name| one(bound, name)) {
            Some(tokens) => tokens.clone(),
            None => vec![token.to_string()],
        }
    };
    template.split_whitespace().flat_map(fill).collect()
}
