//! Lines that are no rows: a summary below the table, a last line that is cut, a comment behind a row.

use crate::scene::files::csv::cell_values::{is_absent, number};
use ::csv::StringRecord;
use std::collections::BTreeSet;

/// Most lines of a summary.
const SUMMARY_LINES: usize = 8;
/// First words of a line that sums up, in lower case.
const SUMMARIES: [&str; 16] = [
    "total", "sum", "mean", "average", "avg", "median", "std", "min", "max", "count", "rows", "end", "done",
    "finished", "summary", "eof",
];
/// How a comment behind a row begins.
const COMMENTS: [&str; 3] = ["#", "//", "%"];

/// The records that are rows, and what was left out at the end, in words. `is_open`: the file does not end with a line's end.
pub(crate) fn without_tail(
    mut records: Vec<(u64, StringRecord)>,
    columns: usize,
    (is_open, decimal_commas): (bool, bool),
) -> (Vec<(u64, StringRecord)>, Vec<String>) {
    let mut words = vec![];
    let typical = records.first().map_or(columns, |(_, record)| record.len());
    if is_open
        && records.len() > 2
        && is_cut(&records, typical, decimal_commas)
        && let Some((line, last)) = records.pop()
    {
        let text = last.iter().collect::<Vec<_>>().join(" ");
        words.push(format!("the last line ({line}: {text:?}) is cut and left out"));
    }
    let from = records.len().saturating_sub(SUMMARY_LINES);
    let first_cell = |record: &StringRecord| record.get(0).unwrap_or_default().to_string();
    // What rows before begin with, too, is the name of an object.
    let known: BTreeSet<String> = records.iter().take(from).map(|(_, record)| first_cell(record)).collect();
    for _ in 0..SUMMARY_LINES {
        let last = records.last().filter(|(_, record)| !known.contains(&first_cell(record)));
        let Some((line, text)) = last.and_then(|(line, record)| Some((*line, summary(record, columns)?)))
        else {
            break;
        };
        records.pop();
        words.push(format!("line {line} ({text:?}) is no row and left out"));
    }
    (records, words)
}

/// Whether the last record is cut: it has fewer cells than the others, or fewer decimals than all of them.
fn is_cut(records: &[(u64, StringRecord)], typical: usize, decimal_commas: bool) -> bool {
    let Some(((_, last), others)) = records.split_last() else { return false };
    if last.len() < typical {
        return others.iter().all(|(_, record)| record.len() >= typical);
    }
    let decimals = |record: &StringRecord| {
        let cell = record.get(typical.checked_sub(1)?)?;
        let (_, decimals) = cell.split_once(if decimal_commas { ',' } else { '.' })?;
        number(cell, decimal_commas).map(|_| decimals.len())
    };
    let at_end = last.get(typical.saturating_sub(1)).unwrap_or_default();
    if last.len() > typical || is_absent(at_end) || number(at_end, decimal_commas).is_none() {
        return false;
    }
    let mut known = others.iter().filter_map(|(_, record)| decimals(record));
    let Some(first) = known.next() else { return false };
    first > 1 && known.all(|count| count == first) && decimals(last).unwrap_or(0) < first
}

/// The text of a line that is no row but sums up.
fn summary(record: &StringRecord, columns: usize) -> Option<String> {
    let filled: Vec<&str> = record.iter().filter(|cell| !cell.is_empty()).collect();
    let first = filled.first()?;
    let word: String = first.chars().take_while(|c| c.is_alphabetic()).collect::<String>().to_lowercase();
    let has_letters = first.chars().next().is_some_and(|c| c.is_alphabetic() || "-=*#".contains(c));
    let is_alone = filled.len() == 1 && columns > 1 && has_letters;
    let is_rule = filled.iter().all(|cell| cell.len() > 1 && cell.chars().all(|c| "-=*_".contains(c)));
    (SUMMARIES.contains(&word.as_str()) || is_alone || is_rule).then(|| filled.join(" "))
}

/// A record without the comment behind it, and the comment.
pub(crate) fn without_comment(record: &StringRecord, columns: usize) -> Option<(StringRecord, String)> {
    let from = columns.saturating_sub(1);
    let starts = |cell: &str| COMMENTS.iter().filter_map(|mark| cell.find(mark)).min();
    let (at, start) =
        record.iter().enumerate().skip(from).find_map(|(at, cell)| Some((at, starts(cell)?)))?;
    let (kept, comment) = record.get(at)?.split_at_checked(start)?;
    // An id may have such a sign, as in `ball #1`.
    if !kept.trim().is_empty() && number(kept.trim(), false).or_else(|| number(kept.trim(), true)).is_none() {
        return None;
    }
    // So may an id in the last column, as in `#1`.
    let is_bare = kept.trim().is_empty() && at < columns && !comment.trim().contains(' ');
    if is_bare && record.len() <= columns {
        return None;
    }
    let mut row: StringRecord = record.iter().take(at).collect();
    if row.len() < columns {
        row.push_field(kept.trim());
    }
    let rest = std::iter::once(comment).chain(record.iter().skip(at + 1)).collect::<Vec<_>>().join(" ");
    Some((row, rest.trim_start_matches(['#', '/', '%', ' ']).to_string()))
}
