//! Text to tokens: the words of a question in the canonical words of `words.txt`, spelling corrected.
//!
//! Each word of a text has the canonical words that it may stand for: its own, or those of its stem. An unknown word is corrected
//! to the nearest known one by edit distance if it is the only nearest one; otherwise it stays, and the grammar refuses it.

use super::forms::FORMS;
use crate::reason::units;
use crate::reason::words::{LexiconWord, WordUse};
use crate::scene::Scene;
use std::collections::{HashMap, HashSet};
use std::sync::LazyLock;

/// A word of the caller's own and what it means in known words, such as "cue ball" for "white ball".
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct OwnWord {
    pub word: String,
    pub means: String,
}

/// A word of a text.
#[derive(Debug, Clone, PartialEq)]
pub struct TextWord {
    /// As written.
    pub text: String,
    /// The canonical words that it may stand for; none for an unknown word.
    pub canonical: Vec<String>,
    /// The known word that its spelling was corrected to.
    pub corrected: Option<String>,
}

/// A describing word of objects: the token and the operation that filters by it; `None` for "object".
pub type Description = Option<(String, &'static str)>;

pub struct EnglishWords {
    canonical: HashMap<String, Vec<String>>,
    /// Variants of several words, longest first, and what they stand for; nothing for those that are skipped.
    phrases: Vec<(Vec<String>, Vec<String>)>,
    skipped: HashSet<String>,
    /// Words of English that are not in use here: they are no misspelling of a word that is.
    known: HashSet<String>,
    descriptions: HashMap<String, Description>,
    /// Canonical words for what objects are like or do.
    qualities: HashSet<String>,
    /// All spellings of known words, for corrections.
    spellings: Vec<String>,
}

static ENGLISH: LazyLock<EnglishWords> = LazyLock::new(|| EnglishWords::parse(include_str!("words.txt")));

/// Most words of a text: 2,000 bytes have no more.
const MOST_WORDS: usize = 1000;
/// Letters that a word must have before it is corrected: one edit of a shorter word makes other words of it.
const CORRECTED_FROM: usize = 4;
/// Letters from which on two edits are allowed.
const TWO_EDITS_FROM: usize = 7;

impl EnglishWords {
    fn parse(table: &str) -> EnglishWords {
        let mut lexicon = EnglishWords {
            canonical: HashMap::new(),
            phrases: vec![],
            skipped: HashSet::new(),
            known: HashSet::new(),
            descriptions: HashMap::new(),
            qualities: HashSet::new(),
            spellings: vec![],
        };
        let mut section = "";
        for line in table.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#')) {
            if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
                section = name;
                continue;
            }
            match section {
                "skip" => line.split(',').for_each(|v| lexicon.add(v.trim(), &[])),
                "known" => lexicon.known.extend(line.split(',').map(|v| v.trim().to_string())),
                _ => lexicon.add_line(section, line),
            }
        }
        // A word of the forms stands for itself.
        for word in FORMS.iter().flat_map(|f| f.reads.split_whitespace()).filter(|w| !w.starts_with('{')) {
            lexicon.add(word, &[word.to_string()]);
        }
        // Longest first, and of equal length as listed.
        lexicon.phrases.sort_by_key(|(words, _)| std::cmp::Reverse(words.len()));
        let words = lexicon.canonical.keys().chain(&lexicon.skipped);
        let is_known = |word: &String| lexicon.skipped.contains(word) || lexicon.lookup(word).is_some();
        lexicon.spellings = words.flat_map(|word| inflected(word)).filter(is_known).collect();
        lexicon.spellings.sort_unstable();
        lexicon.spellings.dedup();
        lexicon
    }

    fn add_line(&mut self, section: &str, line: &str) {
        let Some((canonical, variants)) = line.split_once(':') else { return };
        let mut meaning: Vec<String> = canonical.split_whitespace().map(str::to_string).collect();
        if section == "describe" {
            let (kind, value) = canonical.split_once(' ').unwrap_or(("", canonical));
            let filter = filter_of(kind);
            let description = filter.map(|filter| (value.to_string(), filter));
            meaning = vec![if filter.is_some() { format!("{kind}={value}") } else { value.to_string() }];
            self.descriptions.insert(meaning.join(" "), description);
        }
        if section == "qualities" {
            self.qualities.extend(meaning.iter().cloned());
        }
        variants.split(',').for_each(|v| self.add(v.trim(), &meaning));
    }

    fn add(&mut self, variant: &str, meaning: &[String]) {
        let words: Vec<String> = variant.split_whitespace().map(str::to_string).collect();
        match (&words[..], meaning) {
            ([], _) => {}
            ([one], []) => {
                self.skipped.insert(one.clone());
            }
            ([one], [_]) => {
                let entry = self.canonical.entry(one.clone()).or_default();
                entry.extend(meaning.iter().filter(|m| !entry.contains(m)).cloned().collect::<Vec<_>>());
            }
            _ => self.phrases.push((words.clone(), meaning.to_vec())),
        }
    }

    /// The canonical words of a word or of its stem.
    fn lookup(&self, word: &str) -> Option<Vec<String>> {
        if let Some(found) = self.canonical.get(word) {
            return Some(found.clone());
        }
        if is_number(word) {
            return Some(vec![word.to_string()]);
        }
        stems(word).iter().find_map(|stem| self.canonical.get(stem).cloned())
    }

    /// Whether questions need the word for what they say of objects, so that no word of a lexicon may be it.
    fn is_reserved(&self, word: &str) -> bool {
        let describes = |c: &String| self.descriptions.get(c).is_some_and(Option::is_some);
        let needed = |c: &String| !self.qualities.contains(c) && !describes(c);
        self.skipped.contains(word)
            || self.lookup(word).is_some_and(|canonical| canonical.iter().any(needed))
            || self.phrases.iter().any(|(phrase, _)| phrase.len() == 1 && phrase[0] == word)
    }
}

/// Whether a word of a lexicon may have this name.
pub fn can_be_learned(name: &str) -> bool {
    split(name).iter().any(|part| !ENGLISH.is_reserved(part))
}

/// The operation that filters by a kind of describing word.
fn filter_of(kind: &str) -> Option<&'static str> {
    match kind {
        "color" => Some("filter_color"),
        "material" => Some("filter_material"),
        "shape" => Some("filter_shape"),
        _ => None,
    }
}

fn is_number(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_digit()) && word.parse::<f64>().is_ok_and(f64::is_finite)
}

/// The words of which this may be an inflection.
fn stems(word: &str) -> Vec<String> {
    let mut stems = vec![];
    for end in ["ing", "es", "ed", "s", "d"] {
        let Some(stem) = word.strip_suffix(end).filter(|s| s.len() > 1) else { continue };
        stems.push(stem.to_string());
        if end == "ing" || end == "ed" {
            stems.push(format!("{stem}e"));
            let mut letters = stem.chars().rev();
            if letters.next() == letters.next() {
                stems.push(
                    stem[..stem.len() - stem.chars().next_back().map_or(0, char::len_utf8)].to_string(),
                );
            }
        }
        if end == "es" || end == "ed" {
            stems.extend(stem.strip_suffix('i').map(|s| format!("{s}y")));
        }
    }
    stems
}

/// Whether a word of a text is a word of the lexicon, perhaps inflected otherwise.
fn is_form_of(word: &str, text: &str) -> bool {
    if word == text || word.chars().next() != text.chars().next() {
        return word == text;
    }
    let (own, other) = (stems(word), stems(text));
    own.iter().any(|s| s == text) || other.iter().any(|s| s == word || own.contains(s))
}

/// Whether the table has the word with the same meaning: colours, materials and shapes of CLEVRER.
fn is_in_table(word: &LexiconWord) -> bool {
    match word.of {
        WordUse::Family(family) => {
            ENGLISH.descriptions.contains_key(&format!("{}={}", family.name(), word.word))
        }
        _ => false,
    }
}

/// A word and its regular inflections.
fn inflected(word: &str) -> Vec<String> {
    if word.len() < CORRECTED_FROM || !word.chars().all(char::is_alphabetic) {
        return vec![word.to_string()];
    }
    let base = word.strip_suffix('e').unwrap_or(word);
    vec![word.to_string(), format!("{word}s"), format!("{base}es"), format!("{base}ed"), format!("{base}ing")]
}

/// A word of the scene that no table has, as its description.
fn scene_words(scene: &Scene) -> Vec<(String, Description)> {
    let mut found: Vec<(String, Description)> = vec![];
    for object in scene.objects.iter().chain(&scene.absent) {
        let words = [
            ("color", object.color.as_str()),
            ("material", &object.material),
            ("shape", object.shape.word()),
        ];
        for (kind, word) in words {
            let is_word = !word.is_empty() && word.chars().all(|c| c.is_ascii_lowercase());
            let is_known = ENGLISH.descriptions.contains_key(&format!("{kind}={word}"));
            if is_word && !is_known && !found.iter().any(|(w, _)| w == word) {
                let description = filter_of(kind).map(|filter| (format!("{kind}:{word}"), filter));
                found.push((word.to_string(), description));
            }
        }
    }
    found
}

/// The canonical word of a word of the lexicon.
const LEARNED: &str = "learned=";

/// The words that a text is read with: those of the table, the scene's, the caller's, and those of a lexicon, which go first.
pub struct Vocabulary {
    /// Words of the lexicon as texts have them, longest first.
    learned: Vec<(Vec<String>, LexiconWord)>,
    scene: Vec<(String, Description)>,
    own: Vec<(Vec<String>, Vec<String>)>,
}

impl Vocabulary {
    pub fn new(scene: Option<&Scene>, own: &[OwnWord], lexicon: &[LexiconWord]) -> Vocabulary {
        let mut own: Vec<_> = own.iter().map(|w| (split(&w.word), split(&w.means))).collect();
        own.retain(|(word, _)| !word.is_empty());
        own.sort_by_key(|(word, _)| std::cmp::Reverse(word.len()));
        let mut learned: Vec<_> = lexicon.iter().map(|w| (split(&w.word), w.clone())).collect();
        learned.retain(|(parts, word)| !parts.is_empty() && !is_in_table(word));
        learned.sort_by_key(|(parts, _)| std::cmp::Reverse(parts.len()));
        Vocabulary { learned, scene: scene.map(scene_words).unwrap_or_default(), own }
    }

    /// The word of the lexicon that a word of a text is.
    pub fn learned(&self, word: &TextWord) -> Option<&LexiconWord> {
        let name = word.canonical.iter().find_map(|c| c.strip_prefix(LEARNED))?;
        self.learned.iter().map(|(_, w)| w).find(|w| w.word == name)
    }

    /// The word of the lexicon with which these texts begin, and how many of them it has.
    fn learned_at(&self, texts: &[String]) -> Option<(usize, &LexiconWord)> {
        let starts = |parts: &[String]| {
            let Some(own) = texts.get(..parts.len()) else { return false };
            // "Does" is no form of "doe".
            let may_be_form = || own.iter().any(|text| !ENGLISH.is_reserved(text));
            own == parts || (parts.iter().zip(own).all(|(a, b)| is_form_of(a, b)) && may_be_form())
        };
        self.learned.iter().find(|(parts, _)| starts(parts)).map(|(parts, word)| (parts.len(), word))
    }

    /// What a word describes of an object, if it does.
    pub fn description(&self, word: &TextWord) -> Option<Description> {
        let token = self.learned(word).and_then(LexiconWord::description);
        if let Some((token, filter)) = token {
            return Some(Some((token, filter)));
        }
        let of = |canonical: &String| {
            let own = self.scene.iter().find(|(w, _)| canonical == &format!("scene={w}"));
            own.map(|(_, d)| d.clone()).or_else(|| ENGLISH.descriptions.get(canonical).cloned())
        };
        word.canonical.iter().find_map(of)
    }

    /// The words of a text in canonical words, without those that are skipped.
    pub fn read(&self, text: &str) -> Vec<TextWord> {
        let texts = replaced(split(text), &self.own);
        let mut words: Vec<TextWord> = vec![];
        let mut at = 0;
        while at < texts.len() {
            let rest = &texts[at..];
            let starts = |(phrase, _): &&(Vec<String>, Vec<String>)| rest.starts_with(phrase);
            let phrase = ENGLISH.phrases.iter().find(starts);
            let learned = self.learned_at(rest);
            // A longer phrase goes first ("going to", for a word "going").
            let longest = phrase.map_or(0, |(phrase, _)| phrase.len());
            if let Some((length, learned)) = learned.filter(|(length, _)| *length >= longest) {
                let text = rest[..length].join(" ");
                let canonical = canonical_of(&text, learned);
                words.push(TextWord { text, canonical, corrected: None });
                at += length;
                continue;
            }
            if let Some((phrase, meaning)) = phrase {
                let text = rest.iter().take(phrase.len()).cloned().collect::<Vec<_>>().join(" ");
                for one in meaning {
                    // A phrase may stand for describing words ("cue ball").
                    let described = ENGLISH.lookup(one).filter(|c| c.len() == 1 && c[0].contains('='));
                    let canonical = described.unwrap_or_else(|| vec![one.clone()]);
                    words.push(TextWord { text: text.clone(), canonical, corrected: None });
                }
                at += phrase.len();
                continue;
            }
            words.extend(self.word(&texts[at]));
            at += 1;
        }
        words
    }

    /// A word; `None` if it is skipped.
    fn word(&self, text: &str) -> Option<TextWord> {
        let is_english =
            || ENGLISH.known.contains(text) || stems(text).iter().any(|s| ENGLISH.known.contains(s));
        let is_known = self.canonical(text).is_some() || is_english();
        let corrected = if is_known { None } else { self.correct(text) };
        let canonical = self.canonical(corrected.as_deref().unwrap_or(text));
        if canonical.as_ref().is_some_and(Vec::is_empty) {
            return None;
        }
        Some(TextWord { text: text.to_string(), canonical: canonical.unwrap_or_default(), corrected })
    }

    /// The canonical words of a word of the lexicon, the scene or the tables; empty for one that is skipped.
    fn canonical(&self, text: &str) -> Option<Vec<String>> {
        if let Some((1, learned)) = self.learned_at(&[text.to_string()]) {
            return Some(canonical_of(text, learned));
        }
        let of_scene = self.scene.iter().find(|(w, _)| w == text || format!("{w}s") == text);
        match of_scene {
            Some((word, _)) => Some(vec![format!("scene={word}")]),
            None if ENGLISH.skipped.contains(text) => Some(vec![]),
            None => ENGLISH.lookup(text),
        }
    }

    /// The only nearest known spelling; `None` if there is none, or if the nearest ones mean different things.
    fn correct(&self, text: &str) -> Option<String> {
        let letters = text.chars().count();
        if letters + 1 < CORRECTED_FROM || !text.chars().all(char::is_alphabetic) {
            return None;
        }
        let allowed = if letters < TWO_EDITS_FROM { 1 } else { 2 };
        // In a word of three letters, letters may only have changed places ("teh").
        let sorted = |word: &str| {
            let mut letters: Vec<char> = word.chars().collect();
            letters.sort_unstable();
            letters
        };
        let is_possible = |known: &str| letters >= CORRECTED_FROM || sorted(text) == sorted(known);
        let learned = self.learned.iter().filter_map(|(parts, _)| parts.first().filter(|_| parts.len() == 1));
        let own = self.scene.iter().map(|(w, _)| w).chain(learned);
        let distances = ENGLISH.spellings.iter().chain(own).filter_map(|known| {
            let apart = known.chars().count().abs_diff(letters);
            let distance = if apart > allowed { usize::MAX } else { strsim::osa_distance(text, known) };
            (distance <= allowed && is_possible(known)).then_some((distance, known))
        });
        let mut found: Vec<(usize, &String)> = distances.collect();
        let least = found.iter().map(|(d, _)| *d).min()?;
        found.retain(|(d, _)| *d == least);
        let (_, first) = found.first()?;
        let meaning = self.canonical(first);
        found.iter().all(|(_, word)| self.canonical(word) == meaning).then(|| first.to_string())
    }
}

/// The canonical words of a word of the lexicon as a text has it. It may be another one of the table's, too: the grammar decides.
fn canonical_of(text: &str, learned: &LexiconWord) -> Vec<String> {
    let of_table = ENGLISH.lookup(text).unwrap_or_default();
    std::iter::once(format!("{LEARNED}{}", learned.word)).chain(of_table).collect()
}

/// The texts with the caller's own words replaced by what they mean, in one pass: meanings are in known words. What would make the text
/// longer than any question may be stays.
fn replaced(texts: Vec<String>, own: &[(Vec<String>, Vec<String>)]) -> Vec<String> {
    let (mut out, mut rest) = (vec![], &texts[..]);
    while let Some((first, after)) = rest.split_first() {
        let fits = |(word, means): &&(Vec<String>, Vec<String>)| {
            rest.starts_with(word) && out.len() + means.len() <= MOST_WORDS
        };
        match own.iter().find(fits) {
            Some((word, means)) => {
                out.extend(means.iter().cloned());
                rest = &rest[word.len()..];
            }
            None => {
                out.push(first.clone());
                rest = after;
            }
        }
    }
    out
}

/// Lower case words without punctuation. A possessive is a word of its own; so are a number and its unit.
pub fn split(text: &str) -> Vec<String> {
    let text = text.to_lowercase().replace(['\u{2019}', '\u{2018}', '`'], "'").replace("'s", " 's ");
    let text = text.replace("'ll", " 'll ").replace("'d ", " 'd ");
    // No form has the word "minus", so that a negative number is refused and not read without its sign.
    let negative = |w: &str| {
        w.strip_prefix(['-', '\u{2212}']).is_some_and(|n| n.starts_with(|c: char| c.is_ascii_digit()))
    };
    let signed =
        text.split_whitespace().map(|w| if negative(w) { format!("minus {w}") } else { w.to_string() });
    let text = signed.collect::<Vec<_>>().join(" ");
    let parts = text.split(|c: char| !(c.is_alphanumeric() || c == '\'' || c == '.'));
    let parts = parts.map(|w| w.trim_matches('.')).filter(|w| !w.is_empty());
    parts.flat_map(number_and_unit).collect()
}

/// "2.5s" as "2.5" and "s"; "1st" stays.
fn number_and_unit(word: &str) -> Vec<String> {
    let unit = word.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.');
    let number = &word[..word.len() - unit.len()];
    // In words.txt "second" is the ordinal too, and "2x" is two times.
    let measures = |c: &String| c == "second" || c == "times" || units::named(c).is_some();
    let is_unit = || ENGLISH.canonical.get(unit).is_some_and(|all| all.iter().any(measures));
    match is_number(number) && is_unit() {
        true => vec![number.to_string(), unit.to_string()],
        false => vec![word.to_string()],
    }
}
