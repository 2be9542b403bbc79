//! Words that stand for what was said before: "it", "the other one", "and when?".

use super::chart::QuestionReader;
use super::lexicon::{OwnWord, TextWord, Vocabulary};
use crate::reason::ReasonError;
use crate::reason::language::{Op, apply};
use crate::reason::types::Type;
use crate::scene::Scene;

/// What was asked before, and the caller's own words. A service keeps none of it: the caller sends it with each question.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Conversation {
    /// The questions before this one, oldest first.
    pub previous: Vec<String>,
    pub words: Vec<OwnWord>,
}

/// The program of a question after others.
type ProgramOf<'a> = &'a dyn Fn(&str, &Conversation) -> Result<Vec<String>, ReasonError>;

/// Questions before this one that are looked at: what is further back is not what "it" means.
const MOST_PREVIOUS: usize = 8;

fn is(word: &TextWord, canonical: &str) -> bool {
    word.canonical.iter().any(|c| c == canonical)
}

/// The phrases of objects in a text, each once: as words, and as its program.
fn mentions(words: &[TextWord], vocabulary: &Vocabulary) -> Vec<(Vec<TextWord>, Vec<String>)> {
    let mut found: Vec<(Vec<TextWord>, Vec<String>)> = vec![];
    for (from, to, program) in QuestionReader::new(words, vocabulary).mentions() {
        if !found.iter().any(|(_, known)| *known == program) {
            found.push((words.get(from..to).unwrap_or_default().to_vec(), program));
        }
    }
    found
}

fn text(words: &[TextWord]) -> String {
    words.iter().map(|w| w.text.as_str()).collect::<Vec<_>>().join(" ")
}

/// The objects that the latest question that names any was about.
fn mentioned_before(
    vocabulary: &Vocabulary,
    conversation: &Conversation,
) -> Vec<(Vec<TextWord>, Vec<String>)> {
    let latest = conversation.previous.iter().rev().take(MOST_PREVIOUS);
    latest.map(|q| mentions(&vocabulary.read(q), vocabulary)).find(|m| !m.is_empty()).unwrap_or_default()
}

/// The words with each object that "it" may mean in its place, and that object's name.
pub fn with_pronouns(
    words: &[TextWord],
    vocabulary: &Vocabulary,
    scene: Option<&Scene>,
    conversation: &Conversation,
) -> Result<Vec<(String, Vec<TextWord>)>, ReasonError> {
    // "The green cube, did it hit the ball?" names what "it" is right before.
    let spans = QuestionReader::new(words, vocabulary).mentions();
    let repeats =
        |k: usize| words.get(k).is_some_and(|w| is(w, "it")) && spans.iter().any(|(_, end, _)| *end == k);
    let words: Vec<TextWord> =
        (0..words.len()).filter(|k| !repeats(*k)).filter_map(|k| words.get(k).cloned()).collect();
    let Some(at) = words.iter().position(|w| is(w, "it") || is(w, "otherone")) else {
        return Ok(vec![(String::new(), words.to_vec())]);
    };
    let is_other = words.get(at).is_some_and(|w| is(w, "otherone"));
    let mut candidates = mentions(words.get(..at).unwrap_or_default(), vocabulary);
    if candidates.is_empty() {
        candidates = mentioned_before(vocabulary, conversation);
    }
    if is_other {
        candidates = others(&candidates, vocabulary, scene);
    }
    let put = |object: &[TextWord]| -> Vec<TextWord> {
        let same = |w: &TextWord| is(w, "it") || is(w, "otherone");
        words.iter().flat_map(|w| if same(w) { object.to_vec() } else { vec![w.clone()] }).collect()
    };
    Ok(candidates.iter().map(|(object, _)| (text(object), put(object))).collect())
}

/// The objects of the scene that were not mentioned, as phrases.
fn others(
    mentioned: &[(Vec<TextWord>, Vec<String>)],
    vocabulary: &Vocabulary,
    scene: Option<&Scene>,
) -> Vec<(Vec<TextWord>, Vec<String>)> {
    let Some(scene) = scene else { return vec![] };
    let is_mentioned = |id: u32| {
        let words =
            |o: &crate::scene::Object| [o.color.clone(), o.material.clone(), o.shape.word().to_string()];
        scene.objects.iter().filter(|o| o.id == id).any(|o| {
            let own = words(o);
            mentioned.iter().any(|(_, program)| {
                let described: Vec<&String> = program
                    .iter()
                    .filter(|t| !t.contains('_') && *t != "objects" && *t != "unique")
                    .collect();
                let number =
                    program.iter().any(|t| t == "object_number") && program.first() == Some(&id.to_string());
                number || (!described.is_empty() && described.iter().all(|t| own.contains(t)))
            })
        })
    };
    let rest = scene.objects.iter().filter(|o| !is_mentioned(o.id));
    rest.map(|o| (vocabulary.read(&format!("object {}", o.id)), vec![o.id.to_string()])).collect()
}

/// The program of a question that only adds to the one before: "and when?", "and the red cube?".
pub fn follow_up(
    words: &[TextWord],
    vocabulary: &Vocabulary,
    conversation: &Conversation,
    program_of: ProgramOf,
) -> Result<Option<Vec<String>>, ReasonError> {
    let Some((last, earlier)) = conversation.previous.split_last() else { return Ok(None) };
    let rest: Vec<&TextWord> = words.iter().filter(|w| !is(w, "and") && w.text != "but").collect();
    let earlier = earlier.iter().rev().take(MOST_PREVIOUS).rev().cloned().collect();
    let before = Conversation { previous: earlier, words: conversation.words.clone() };
    match rest[..] {
        [one] if is(one, "when") => {
            let program = program_of(last, &before)?;
            Ok(event_part(&program).map(|mut tokens| {
                tokens.push("get_time".to_string());
                tokens
            }))
        }
        _ => {
            let own: Vec<TextWord> = rest.iter().filter(|w| !is(w, "what")).map(|w| (*w).clone()).collect();
            let named = QuestionReader::new(&own, vocabulary).mentions();
            let is_name = matches!(named[..], [(0, end, _)] if end == own.len());
            let asked = vocabulary.read(last);
            let spans = QuestionReader::new(&asked, vocabulary).mentions();
            let [(from, to, _)] = spans[..] else { return Ok(None) };
            if !is_name {
                return Ok(None);
            }
            let mut replaced = asked;
            replaced.splice(from..to, own);
            let reading = QuestionReader::new(&replaced, vocabulary).whole("question").into_iter().next();
            let source = |t: String| if t == "@events" { "events".to_string() } else { t };
            Ok(reading.map(|tokens| tokens.into_iter().map(source).collect()))
        }
    }
}

/// The longest start of a program that gives an event, or the first of its events.
fn event_part(program: &[String]) -> Option<Vec<String>> {
    let mut stack: Vec<Type> = vec![];
    let mut best: Option<(usize, Type)> = None;
    for (k, token) in program.iter().enumerate() {
        apply(&Op::of(token)?, &mut stack).ok()?;
        match stack[..] {
            [kind @ (Type::Event | Type::Events)] if k > 0 => best = Some((k + 1, kind)),
            _ => {}
        }
    }
    let (end, kind) = best?;
    let mut tokens: Vec<String> = program.iter().take(end).cloned().collect();
    if kind == Type::Events {
        tokens.extend(["first".to_string(), "filter_order".to_string()]);
    }
    Some(tokens)
}
