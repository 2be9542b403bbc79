//! Logs: lines with names and values, such as `[12:00:01.20] id=3 x=0.12 y=0.4` or `frame 12: (x, y) = (1.2, 3.4)`.

use super::record_table::Field;
use super::{RecordTable, TableText};
use crate::scene::files::csv::{clock, is_unit, names_positions};
use crate::scene::violations::SceneError;

/// A log has positions in this share of its lines at least.
const LEAST_SHARE: f64 = 0.5;
/// Words between a name and its value.
const LINKS: [&str; 8] = ["at", "is", "in", "to", "now", "and", "was", "of"];

/// A part of a line.
#[derive(Debug, Clone, PartialEq)]
enum LogToken {
    Word(String),
    /// The text of a number, and a unit behind it.
    Number(String, Option<String>),
    Sign(char),
}

/// The table that a log holds; `None`: it is none.
pub(super) fn table(text: &str) -> Option<Result<TableText, SceneError>> {
    let (mut table, mut others, mut all) = (RecordTable::default(), vec![], 0usize);
    let mut units: Vec<(String, Option<String>)> = vec![];
    for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        all += 1;
        let found = fields(line).filter(|fields| {
            let names: Vec<String> = fields.iter().map(|(name, _, _)| name.clone()).collect();
            names_positions(&names)
        });
        let Some(found) = found else {
            others.push((number + 1, line.trim()));
            continue;
        };
        for (name, _, unit) in &found {
            match units.iter().find(|(known, _)| known == name) {
                Some((_, known)) if known != unit => {
                    let [known, unit] = [known, unit].map(|unit| unit.clone().unwrap_or("no unit".into()));
                    let message = format!("has {name} in {unit}, lines before it in {known}; write one unit");
                    return Some(Err(SceneError::single(format!("line {}", number + 1), message)));
                }
                Some(_) => {}
                None => units.push((name.clone(), unit.clone())),
            }
        }
        table.push(found.into_iter().map(|(name, value, _)| (name, value)).collect::<Vec<Field>>());
    }
    if table.len() < 2 || (table.len() as f64) < LEAST_SHARE * all as f64 {
        return None;
    }
    let mut taken = vec![format!("lines of a log with {}", table.names.join(", "))];
    if let Some((number, first)) = others.first() {
        let first: String = first.chars().take(40).collect();
        let count = others.len();
        taken.push(format!(
            "{count} lines without positions are left out (the first is line {number}: {first:?})"
        ));
    }
    for name in &mut table.names {
        let unit = units.iter().find(|(known, _)| known == name).and_then(|(_, unit)| unit.clone());
        if let Some(unit) = unit {
            *name += &format!(" [{unit}]");
        }
    }
    Some(Ok(table.written(taken)))
}

/// A field of a line: name, value, unit.
type LogField = (String, String, Option<String>);

/// The fields of a line; `None`: a number in it may be read in two ways.
fn fields(line: &str) -> Option<Vec<LogField>> {
    let (time, rest) = without_time(line);
    let tokens = tokens(&rest)?;
    let mut found: Vec<LogField> = time.map(|time| ("t".to_string(), time, None)).into_iter().collect();
    let mut name: Option<String> = None;
    let mut group: Vec<String> = vec![];
    let mut at = 0;
    while let Some(token) = tokens.get(at) {
        at += 1;
        match token {
            LogToken::Word(word) if LINKS.contains(&word.to_lowercase().as_str()) => {}
            LogToken::Word(word) => {
                let is_value = at >= 2 && matches!(tokens.get(at - 2), Some(LogToken::Sign('=')));
                match name.take().filter(|_| is_value) {
                    Some(known) => found.push((known, word.clone(), None)),
                    None => name = Some(word.clone()),
                }
            }
            LogToken::Number(value, unit) => {
                if let Some(known) = name.clone() {
                    found.push((known, value.clone(), unit.clone()));
                    // The word before is the name of a position that follows, as in `ball 3 at (1, 2)`.
                    name = name.filter(|_| matches!(tokens.get(at), Some(LogToken::Word(word)) if LINKS.contains(&word.as_str())));
                }
            }
            LogToken::Sign('(' | '[' | '{' | '<') => {
                let end = tokens
                    .get(at..)?
                    .iter()
                    .position(|token| matches!(token, LogToken::Sign(')' | ']' | '}' | '>')));
                let inner = tokens.get(at..at + end?)?;
                match values_of(inner) {
                    Some(values) => {
                        found.extend(named(std::mem::take(&mut group), name.take(), values));
                        at += inner.len() + 1;
                    }
                    None => group = words_of(inner, &mut at),
                }
            }
            LogToken::Sign(_) => {}
        }
    }
    let mut distinct: Vec<LogField> = vec![];
    for field in found {
        if distinct.iter().all(|(known, ..)| *known != field.0) {
            distinct.push(field);
        }
    }
    Some(distinct)
}

/// The numbers of a group in brackets, if it has two or three and nothing else.
fn values_of(inner: &[LogToken]) -> Option<Vec<(String, Option<String>)>> {
    let mut values = vec![];
    for token in inner {
        match token {
            LogToken::Number(value, unit) => values.push((value.clone(), unit.clone())),
            LogToken::Sign(',' | ';') => {}
            _ => return None,
        }
    }
    (2..=3).contains(&values.len()).then_some(values)
}

/// The words of a group of names, as in `(x, y) = (1, 2)`, which is passed over.
fn words_of(inner: &[LogToken], at: &mut usize) -> Vec<String> {
    let is_name = |token: &LogToken| matches!(token, LogToken::Word(_) | LogToken::Sign(','));
    if inner.is_empty() || !inner.iter().all(is_name) {
        return vec![];
    }
    *at += inner.len() + 1;
    let words = inner.iter().filter_map(|token| match token {
        LogToken::Word(word) => Some(word.clone()),
        _ => None,
    });
    words.collect()
}

/// The fields of a group of values: by the names of a group before it, or by the word before it.
fn named(group: Vec<String>, name: Option<String>, values: Vec<(String, Option<String>)>) -> Vec<LogField> {
    let axes = ["x", "y", "z"];
    let names: Vec<String> = match (group.len() == values.len(), name) {
        (true, _) => group,
        (false, Some(name)) => axes.iter().map(|axis| format!("{name}_{axis}")).collect(),
        (false, None) => axes.map(String::from).to_vec(),
    };
    names.into_iter().zip(values).map(|(name, (value, unit))| (name, value, unit)).collect()
}

/// The first time of a clock in a line, and the line without it.
fn without_time(line: &str) -> (Option<String>, String) {
    let words: Vec<&str> = line.split_whitespace().collect();
    let trimmed = |word: &str| word.trim_matches(|c: char| !c.is_ascii_alphanumeric()).to_string();
    for (at, word) in words.iter().enumerate() {
        let time = trimmed(word);
        let date = at
            .checked_sub(1)
            .and_then(|before| words.get(before))
            .map(|before| format!("{} {time}", trimmed(before)));
        let dated = date.filter(|date| clock(date).is_some());
        if time.contains(':') && clock(&time).is_some() {
            let from = at - usize::from(dated.is_some());
            let rest: Vec<&str> = words
                .iter()
                .enumerate()
                .filter(|(k, _)| !(from..=at).contains(k))
                .map(|(_, word)| *word)
                .collect();
            return (Some(dated.unwrap_or(time)), rest.join(" "));
        }
    }
    (None, line.to_string())
}

/// The parts of a line; `None`: it has a number whose comma may be a decimal sign.
fn tokens(line: &str) -> Option<Vec<LogToken>> {
    let chars: Vec<char> = line.chars().collect();
    let at = |k: usize| chars.get(k).copied().unwrap_or(' ');
    let (mut found, mut k, mut depth) = (vec![], 0usize, 0usize);
    while k < chars.len() {
        let c = at(k);
        let signed = "+-.\u{2212}".contains(c)
            && (at(k + 1).is_ascii_digit() || at(k + 1) == '.' && at(k + 2).is_ascii_digit());
        if c.is_ascii_digit() || signed {
            let start = k;
            k += 1;
            while at(k).is_ascii_digit()
                || at(k) == '.'
                || ("eE".contains(at(k)) && (at(k + 1).is_ascii_digit() || "+-".contains(at(k + 1))))
                || ("+-".contains(at(k)) && "eE".contains(at(k - 1)))
            {
                k += 1;
            }
            if at(k) == ',' && at(k + 1).is_ascii_digit() && depth == 0 {
                return None;
            }
            let number: String = chars.get(start..k)?.iter().collect();
            let from = k + usize::from(at(k) == ' ');
            let end = (from..).find(|end| !(at(*end).is_alphabetic() || at(*end) == '°')).unwrap_or(from);
            let unit: String = chars.get(from..end).unwrap_or_default().iter().collect();
            let next = (end..chars.len()).map(at).find(|c| *c != ' ').unwrap_or(' ');
            let is_real = is_unit(&unit.to_lowercase()) && (from == k || !"=:(".contains(next));
            if is_real {
                k = end;
            }
            found.push(LogToken::Number(number.trim_end_matches('.').to_string(), is_real.then_some(unit)));
        } else if c.is_alphabetic() || c == '_' {
            let end =
                (k..).find(|end| !(at(*end).is_alphanumeric() || "_.-".contains(at(*end)))).unwrap_or(k + 1);
            let word: String = chars.get(k..end)?.iter().collect();
            found.push(LogToken::Word(word.trim_end_matches(['.', '-']).to_string()));
            k = end;
        } else {
            depth = match c {
                '(' | '[' | '{' => depth + 1,
                ')' | ']' | '}' => depth.saturating_sub(1),
                _ => depth,
            };
            if !c.is_whitespace() {
                found.push(LogToken::Sign(c));
            }
            k += 1;
        }
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_logs_give_their_fields() {
        let check = |line: &str, expected: &[(&str, &str)]| {
            let found: Vec<(String, String)> =
                fields(line).unwrap().into_iter().map(|(name, value, _)| (name, value)).collect();
            let expected: Vec<(String, String)> =
                expected.iter().map(|(a, b)| (a.to_string(), b.to_string())).collect();
            assert_eq!(found, expected, "{line}");
        };
        check(
            "[12:00:01.20] id=3 x=0.12 y=-0.4",
            &[("t", "12:00:01.20"), ("id", "3"), ("x", "0.12"), ("y", "-0.4")],
        );
        check("frame 12: (x, y) = (1.2, 3.4)", &[("frame", "12"), ("x", "1.2"), ("y", "3.4")]);
        check("INFO ball at (120, 340) r=12", &[("ball_x", "120"), ("ball_y", "340"), ("r", "12")]);
        check(
            "2024-05-01 10:00:00.5 id=red pos=[1, 2]",
            &[("t", "2024-05-01 10:00:00.5"), ("id", "red"), ("pos_x", "1"), ("pos_y", "2")],
        );
        check("x: 1.5e-3 y: 2", &[("x", "1.5e-3"), ("y", "2")]);
        assert_eq!(fields("x=0,12 y=0,4"), None);
        assert_eq!(fields("x=12mm y=3 cm t=1").unwrap()[1], ("y".into(), "3".into(), Some("cm".into())));
    }
}
