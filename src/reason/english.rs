//! English to programs: a small grammar; what it does not understand is refused by name, never guessed.

use super::ReasonError;
use super::program::nearest;

/// Every supported form; S is an object phrase such as "blue rubber cube".
pub const FORMS: &[&str] = &[
    "what will happen next?",
    "which event will happen next?",
    "what will [not] happen if the S is removed?",
    "which event will [not] happen without the S?",
    "which of the following will [not] happen if the S is removed?",
    "if the S is removed, what will [not] happen?",
    "without the S, which event will [not] happen?",
    "what would happen if the S were heavier?",
    "which event would happen if the S were lighter?",
    "if the S were heavier, what would [not] happen?",
    "if the S were lighter, which of the events that happened would not have happened?",
    "which of the following is [not] responsible for the collision between the S and the S?",
    "which of the following is [not] responsible for the S's colliding with the S?",
    "which of the following is [not] responsible for the S's exit?",
    "the S collides with the S",
    "the S and the S collide",
    "the S exits the scene",
    "the S enters the scene",
    "the presence of the S",
    "the S's colliding with the S",
    "the collision between the S and the S",
    "the S's entrance",
    "the S's entering the scene",
];

/// The program of a question.
pub fn question_program(text: &str) -> Result<Vec<String>, ReasonError> {
    let words = words(text);
    question(&words.iter().map(String::as_str).collect::<Vec<_>>()).map_err(|part| refusal(text, &part))
}

/// The program of a choice; `observed` where the question is about what the video shows (explanatory).
pub fn choice_program(text: &str, observed: bool) -> Result<Vec<String>, ReasonError> {
    let words = words(text);
    let source = if observed { "events" } else { "all_events" };
    choice(&words.iter().map(String::as_str).collect::<Vec<_>>(), source).map_err(|part| refusal(text, &part))
}

/// Whether the question asks what led to something that the video shows.
pub(super) fn is_explanatory(question: &[String]) -> bool {
    question.iter().any(|t| t == "filter_ancestor")
}

fn refusal(text: &str, part: &str) -> ReasonError {
    let part = if part.is_empty() { text } else { part };
    let plain: Vec<String> =
        words(text).into_iter().map(|w| if word(&w).is_some() { "S".into() } else { w }).collect();
    let nearest = nearest(&plain.join(" "), FORMS.iter().copied());
    ReasonError::NotUnderstood { part: part.chars().take(200).collect(), nearest }
}

/// Lower case words without punctuation; a possessive is a word of its own.
fn words(text: &str) -> Vec<String> {
    let text = text.to_lowercase().replace(['\u{2019}', '\u{2018}', '`'], "'").replace("'s", " 's ");
    let split = text.split(|c: char| !(c.is_alphanumeric() || c == '\''));
    split.filter(|w| !w.is_empty()).map(str::to_string).collect()
}

/// The vocabulary's word for a describing word, and its filter; none for "object".
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
        "rubber" | "matte" => ("rubber", m),
        "metal" | "metallic" | "shiny" => ("metal", m),
        "sphere" | "spheres" | "ball" | "balls" => ("sphere", s),
        "cylinder" | "cylinders" | "disc" | "puck" => ("cylinder", s),
        "cube" | "cubes" | "box" | "boxes" | "block" | "blocks" => ("cube", s),
        "object" | "objects" | "thing" | "one" => return Some(None),
        _ => return None,
    }))
}

/// Why a text was not understood: the part.
type Part = String;

/// Tokens of "[the] blue rubber cube", which must be all of `words`.
fn object(words: &[&str]) -> Result<Vec<String>, Part> {
    let rest = words.strip_prefix(&["the"]).unwrap_or(words);
    let (mut found, mut noun) = (vec![], false);
    for w in rest {
        match word(w) {
            Some(None) if !noun => noun = true,
            Some(Some(pair)) if !noun && !found.iter().any(|(_, f)| *f == pair.1) => {
                noun = pair.1 == "filter_shape";
                found.push(pair);
            }
            _ => return Err(if word(w).is_none() { w.to_string() } else { words.join(" ") }),
        }
    }
    if found.is_empty() {
        return Err(words.join(" "));
    }
    found.sort_by_key(|(_, f)| {
        ["filter_color", "filter_material", "filter_shape"].iter().position(|k| k == f)
    });
    let mut tokens = vec!["objects".to_string()];
    for (value, filter) in found {
        tokens.extend([value.to_string(), filter.to_string()]);
    }
    tokens.push("unique".to_string());
    Ok(tokens)
}

fn join(parts: &[&[&str]]) -> Vec<String> {
    parts.iter().flat_map(|p| p.iter().map(|t| t.to_string())).collect()
}

fn around(before: &[&str], object: Vec<String>, after: &[&str]) -> Vec<String> {
    [join(&[before]), object, join(&[after])].concat()
}

fn collision(source: &str, a: &[&str], b: &[&str]) -> Result<Vec<String>, Part> {
    let first = around(&[source], object(a)?, &["filter_collision"]);
    Ok([first, around(&[], object(b)?, &["filter_collision", "unique"])].concat())
}

/// Splits at the first occurrence of `mid`.
fn split<'a>(words: &'a [&'a str], mid: &[&str]) -> Option<(&'a [&'a str], &'a [&'a str])> {
    let at = words.windows(mid.len()).position(|w| w == mid)?;
    Some((words.get(..at)?, words.get(at + mid.len()..)?))
}

/// The event that a phrase names; `None` where it names none.
fn event(w: &[&str], source: &str) -> Result<Option<Vec<String>>, Part> {
    for mid in
        [&["'s", "colliding", "with"][..], &["collides", "with"], &["hits"], &["will", "collide", "with"]]
    {
        if let Some((a, b)) = split(w, mid) {
            return collision(source, a, b).map(Some);
        }
    }
    let between = w.strip_prefix(&["the", "collision", "between"]);
    if let Some(pair) =
        between.or(w.strip_suffix(&["collide"])).or(w.strip_suffix(&["collide", "with", "each", "other"]))
    {
        let (a, b) = split(pair, &["and"]).ok_or_else(|| pair.join(" "))?;
        return collision(source, a, b).map(Some);
    }
    let ends: [(&[&str], &str); 8] = [
        (&["'s", "entrance"], "filter_in"),
        (&["'s", "entering", "the", "scene"], "filter_in"),
        (&["enters", "the", "scene"], "filter_in"),
        (&["'s", "exit"], "filter_out"),
        (&["'s", "exiting", "the", "scene"], "filter_out"),
        (&["exits", "the", "scene"], "filter_out"),
        (&["leaves", "the", "scene"], "filter_out"),
        (&["exits"], "filter_out"),
    ];
    for (end, filter) in ends {
        if let Some(phrase) = w.strip_suffix(end) {
            return Ok(Some(around(&[source], object(phrase)?, &[filter, "unique"])));
        }
    }
    Ok(None)
}

fn choice(w: &[&str], source: &str) -> Result<Vec<String>, Part> {
    if let Some(phrase) = w.strip_prefix(&["the", "presence", "of"]) {
        return object(phrase);
    }
    event(w, source)?.ok_or_else(String::new)
}

fn question(w: &[&str]) -> Result<Vec<String>, Part> {
    let asks = |w: &[&str]| -> Option<bool> {
        let starts: [&[&str]; 4] = [
            &["what"],
            &["which", "event"],
            &["which", "of", "the", "following"],
            &["which", "of", "the", "events", "that", "happened"],
        ];
        let rest = starts.iter().find_map(|s| w.strip_prefix(*s))?;
        let rest = rest.strip_prefix(&["will"]).or(rest.strip_prefix(&["would"]))?;
        match rest {
            ["happen"] | ["have", "happened"] => Some(false),
            ["not", "happen"] | ["not", "have", "happened"] => Some(true),
            _ => None,
        }
    };
    if w.strip_suffix(&["next"]).and_then(asks) == Some(false) {
        return Ok(join(&[&["unseen_events", "belong_to"]]));
    }
    if let Some((head, tail)) = split(w, &["responsible", "for"]) {
        let negate = match head {
            ["which", "of", "the", "following", "is"] | ["what", "is"] => false,
            ["which", "of", "the", "following", "is", "not"] | ["what", "is", "not"] => true,
            _ => return Err(head.join(" ")),
        };
        let cause = event(tail, "events")?.ok_or_else(|| tail.join(" "))?;
        let mut tokens = around(&["events"], cause, &["filter_ancestor", "belong_to"]);
        tokens.extend(negate.then(|| "negate".to_string()));
        return Ok(tokens);
    }
    // The question comes first or last; between lies the condition.
    for at in 0..=w.len() {
        let (Some(head), Some(tail)) = (w.get(..at), w.get(at..)) else { continue };
        for (asked, condition) in [(asks(head), tail), (asks(tail), head)] {
            if let (Some(negate), false) = (asked, condition.is_empty()) {
                return counterfactual(condition, negate);
            }
        }
    }
    Err(String::new())
}

fn counterfactual(w: &[&str], negate: bool) -> Result<Vec<String>, Part> {
    let removed = w.strip_prefix(&["without"]).or_else(|| {
        let rest = w.strip_prefix(&["if"])?;
        ["is", "were", "was"].iter().find_map(|verb| rest.strip_suffix(&[*verb, "removed"]))
    });
    let (phrase, apply) = if let Some(phrase) = removed {
        (phrase, None)
    } else {
        let rest = w.strip_prefix(&["if"]).ok_or_else(|| w.join(" "))?;
        let (rest, apply) = match rest {
            [rest @ .., "heavier"] => (rest, "apply_heavier"),
            [rest @ .., "lighter"] => (rest, "apply_lighter"),
            _ => return Err(w.join(" ")),
        };
        let rest = rest.strip_suffix(&["much"]).unwrap_or(rest);
        let phrase =
            rest.strip_suffix(&["were"]).or(rest.strip_suffix(&["was"])).or(rest.strip_suffix(&["is"]));
        (phrase.ok_or_else(|| w.join(" "))?, Some(apply))
    };
    let mut tokens = around(&["all_events"], object(phrase)?, &[]);
    tokens.extend(apply.map(str::to_string));
    tokens.extend(join(&[&["filter_counterfact", "belong_to"]]));
    tokens.extend(negate.then(|| "negate".to_string()));
    Ok(tokens)
}
