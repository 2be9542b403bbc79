//! The dialect of a text table: what separates its columns, its decimal sign, and where its header stands. Each separator is
//! scored on the first lines.

use crate::scene::files::csv::cell_values::{is_absent, number, ungrouped};
use crate::scene::files::csv::layout::boxes::{BoxColumns, box_columns};
use crate::scene::files::csv::layout::{headerless, planes, tail};
use crate::scene::files::csv::names::{CsvColumn, column_name, names_positions, stem};
use crate::scene::files::csv::vocabulary::is_unit;
use ::csv::{ReaderBuilder, StringRecord, Trim};
use std::borrow::Cow;

/// Lines that are looked at.
const SAMPLE_LINES: usize = 80;
/// Most lines of names above the header and of units below it.
const MAX_HEADER_LINES: usize = 4;
/// What separates columns, the likeliest first; `None`: spaces.
const SEPARATORS: [(Option<char>, &str); 5] = [
    (Some(','), "commas"),
    (Some(';'), "semicolons"),
    (Some('\t'), "tabs"),
    (Some('|'), "bars"),
    (None, "spaces"),
];
/// How comments begin in tables of other programs; ours begin with the first.
const COMMENTS: [&str; 3] = ["#", "%", "//"];
/// A line in which a spreadsheet states the separator: `sep=;`.
const STATED: &str = "sep=";
/// First cells of header lines that do not name objects.
const UNNAMED_LINES: [&str; 2] = ["scorer", "#multi:"];

/// The header of a table.
pub(super) struct TableHeader {
    pub names: StringRecord,
    /// The name of the object that stands above each column.
    pub owners: Vec<Option<String>>,
}

/// A table of text whose rows are read one by one.
pub(super) struct TextTable<'a> {
    pub header: TableHeader,
    /// Whether a header was found; otherwise the first line stands for it.
    pub has_header: bool,
    /// The lines below the header.
    body: Cow<'a, str>,
    /// Number of the header's line, or of the last one below it that has no data.
    header_line: u64,
    delimiter: u8,
    pub decimal_commas: bool,
    /// What separates columns.
    pub separators: &'static str,
    boxes: Option<BoxColumns>,
    /// What was taken of the columns, a line each.
    pub taken: Vec<String>,
    /// Why the columns of a table without a header are not known.
    pub needs_header: Option<String>,
    /// Whether the last line has no end.
    is_open: bool,
}

/// One line that is not empty.
struct SampleLine<'a> {
    number: usize,
    text: &'a str,
    is_comment: bool,
}

/// How well a separator suits, and the header that it leads to: an index of the lines.
struct ScoredDialect {
    separator: (Option<char>, &'static str),
    header: Option<usize>,
    score: f64,
}

fn is_comment(line: &str) -> bool {
    COMMENTS.iter().any(|mark| line.trim_start().starts_with(mark))
}

/// The cells of one line.
fn cells(line: &str, separator: Option<char>) -> Vec<String> {
    let line = COMMENTS.iter().fold(line.trim_start_matches(' '), |line, mark| line.trim_start_matches(mark));
    let Some(separator) = separator else { return line.split_whitespace().map(String::from).collect() };
    let mut reader = ReaderBuilder::new()
        .delimiter(separator as u8)
        .has_headers(false)
        .flexible(true)
        .trim(Trim::All)
        .from_reader(line.as_bytes());
    let record = reader.records().next().and_then(Result::ok).unwrap_or_default();
    record.iter().map(String::from).collect()
}

/// Whether a line of cells has a number, with a decimal point or comma.
fn has_number(cells: &[String]) -> bool {
    cells.iter().any(|cell| number(cell, false).is_some() || number(cell, true).is_some())
}

/// Number of cells, without empty ones at the end.
fn filled(cells: &[String]) -> usize {
    cells.iter().rposition(|cell| !cell.is_empty()).map_or(0, |at| at + 1)
}

/// The boxes that columns with these names hold.
fn boxes<'a>(names: impl Iterator<Item = &'a str> + Clone) -> Option<BoxColumns> {
    let stems: Vec<String> = names.clone().map(stem).collect();
    let is_id = |name| column_name(name).is_some_and(|c| c.column == CsvColumn::Id && c.object.is_none());
    box_columns(&stems, names.into_iter().any(is_id))
}

/// Whether a line of these cells is a header.
pub(super) fn is_header(cells: &[String]) -> bool {
    let names = || cells.iter().map(String::as_str);
    names_positions(names()) || boxes(names()).is_some()
}

fn scored(lines: &[SampleLine], separator: (Option<char>, &'static str)) -> ScoredDialect {
    let split: Vec<Vec<String>> = lines.iter().map(|line| cells(line.text, separator.0)).collect();
    let names = |at: &usize| split.get(*at).is_some_and(|cells| is_header(cells));
    let of_kind = |comment: bool| {
        lines.iter().enumerate().filter(move |(_, l)| l.is_comment == comment).map(|(at, _)| at)
    };
    let first_row = of_kind(false).next().unwrap_or(lines.len());
    // A program may mark its header as a comment.
    let header =
        of_kind(false).find(names).or_else(|| of_kind(true).filter(|at| *at < first_row).rfind(names));
    let width = header.and_then(|at| split.get(at)).map_or(0, |cells| filled(cells));
    let below = header.map_or(0, |at| at + 1);
    let rows: Vec<usize> =
        of_kind(false).filter(|at| *at >= below).filter_map(|at| split.get(at)).map(|c| filled(c)).collect();
    let alike = rows.iter().filter(|n| **n > 1 && (**n == width || **n == width + 1)).count();
    let share = alike as f64 / rows.len().max(1) as f64;
    ScoredDialect { separator, header, score: if header.is_some() { 1.0 + share } else { 0.0 } }
}

/// Finds the dialect of a text; the text below the header is read with [`TextTable::records`].
pub(super) fn find(text: &str) -> TextTable<'_> {
    let all = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let mut lines: Vec<SampleLine> = all
        .take(SAMPLE_LINES)
        .map(|(number, text)| SampleLine { number, text, is_comment: is_comment(text) })
        .collect();
    let stated = lines
        .first()
        .and_then(|line| line.text.trim().strip_prefix(STATED))
        .and_then(|rest| rest.chars().next());
    if stated.is_some() {
        lines.remove(0);
    }
    let candidates = SEPARATORS.iter().filter(|(separator, _)| stated.is_none() || *separator == stated);
    let best = candidates.map(|separator| scored(&lines, *separator)).reduce(|best, next| {
        match next.score > best.score {
            true => next,
            false => best,
        }
    });
    let best = best.unwrap_or(ScoredDialect { separator: (Some(','), "commas"), header: None, score: 0.0 });
    let first = lines.iter().position(|line| !line.is_comment);
    let Some(at) = best.header.or(first) else { return table(text, &[], 0, best) };
    // Without a header errors speak of the first line, split as it looks.
    let guess = |line: &str| SEPARATORS.iter().find(|(s, _)| s.is_none_or(|s| line.contains(s))).copied();
    let separator = match best.header {
        Some(_) => best.separator,
        None => lines.get(at).and_then(|line| guess(line.text)).unwrap_or(best.separator),
    };
    let dialect = ScoredDialect { separator, ..best };
    match dialect.header.is_none()
        && lines.get(at).is_some_and(|line| cells(line.text, separator.0).iter().all(|cell| is_value(cell)))
    {
        true => headless(text, &lines, at, dialect),
        false => table(text, &lines, at, dialect),
    }
}

/// Whether a cell is a number, or stands for one.
fn is_value(cell: &str) -> bool {
    is_absent(cell) || number(cell, false).is_some() || number(cell, true).is_some()
}

/// A table without a header, whose first row is the line `at`.
fn headless<'a>(text: &'a str, lines: &[SampleLine], at: usize, dialect: ScoredDialect) -> TextTable<'a> {
    let separator = dialect.separator.0;
    let below = after_line(text, lines.get(at).map_or(0, |line| line.number));
    let texts = || below.lines().filter(|line| !line.trim().is_empty() && !is_comment(line));
    let sample: Vec<Vec<String>> = texts().take(SAMPLE_LINES).map(|line| cells(line, separator)).collect();
    let commas = has_decimal_commas(&sample, separator);
    let values = |line| cells(line, separator).iter().map(|cell| number(cell, commas)).collect();
    let mut found = table(text, lines, at, dialect);
    match headerless::guessed(texts().map(values)) {
        Ok(names) => {
            found.header = TableHeader { owners: vec![None; names.len()], names: StringRecord::from(names) };
            found.boxes = boxes(found.header.names.iter());
            found.header_line = lines.get(at).map_or(0, |line| line.number) as u64;
            found.body = body(below, separator);
            (found.has_header, found.decimal_commas) = (true, commas);
            let taken =
                found.header.names.iter().filter(|name| !name.is_empty()).collect::<Vec<_>>().join(", ");
            found.taken.push(format!("no header: the columns are taken as {taken} (a header names them)"));
        }
        Err(why) => found.needs_header = Some(why),
    }
    found
}

/// The text below the header, with tabs in place of spaces.
fn body(rest: &str, separator: Option<char>) -> Cow<'_, str> {
    match separator {
        Some(_) => Cow::Borrowed(rest),
        None => Cow::Owned(tabbed(rest)),
    }
}

/// Whether the decimal sign of these cells is a comma. Numbers that can be read in one way only decide.
fn has_decimal_commas(rows: &[Vec<String>], separator: Option<char>) -> bool {
    let count = |sign: char, other: char, commas: bool| {
        let has_sign = |cell: &&String| cell.contains(sign) && number(cell, commas).is_some();
        let found: Vec<&String> = rows.iter().flatten().filter(has_sign).collect();
        let both = found.iter().filter(|cell| cell.contains(other)).count();
        let sure =
            found.iter().filter(|cell| cell.contains(other) || ungrouped(cell, sign).is_none()).count();
        [both, sure, found.len()]
    };
    let ([commas, sure_commas, all_commas], [points, sure_points, all_points]) =
        (count(',', '.', true), count('.', ',', false));
    match (commas != points, separator) {
        (true, _) => commas > points,
        // A comma in a cell between commas is quoted, and separates thousands.
        (_, Some(',')) => false,
        _ if sure_commas != sure_points => sure_commas > sure_points,
        _ => all_commas > all_points,
    }
}

/// The table whose header is the line `at`.
fn table<'a>(text: &'a str, lines: &[SampleLine], at: usize, dialect: ScoredDialect) -> TextTable<'a> {
    let (separator, separators) = dialect.separator;
    let split = |line: &SampleLine| cells(line.text, separator);
    let mut names = lines.get(at).map(split).unwrap_or_default();
    let above: Vec<Vec<String>> = lines
        .get(..at)
        .unwrap_or_default()
        .iter()
        .rev()
        .take_while(|l| !l.is_comment)
        .take(MAX_HEADER_LINES)
        .map(split)
        .collect();
    let mut owners = owners(&above, names.len());
    let below = lines.get(at + 1..).unwrap_or_default();
    let rows: Vec<Vec<String>> = below.iter().filter(|line| !line.is_comment).map(split).collect();
    let mut header_line = lines.get(at).map_or(0, |line| line.number + 1);
    // Lines of units or descriptions stand between the header and the first number.
    let start = rows.iter().position(|row| has_number(row)).unwrap_or(0);
    if start <= MAX_HEADER_LINES && dialect.header.is_some() && start > 0 {
        let with_units = rows.get(..start).unwrap_or_default().iter().find(|row| has_units(row));
        for (name, unit) in names.iter_mut().zip(with_units.into_iter().flatten()) {
            let unit = unit.trim_matches(['[', ']', '(', ')']);
            if !unit.is_empty() && !name.is_empty() && !name.contains(['[', '(']) {
                *name = format!("{name} [{unit}]");
            }
        }
        let last = below.iter().filter(|line| !line.is_comment).nth(start - 1);
        header_line = last.map_or(header_line, |line| line.number + 1);
    }
    // R leaves out the name of the column with the rows' names.
    let longer =
        rows.iter().filter(|row| row.len() == names.len() + 1 && !row.last().is_some_and(String::is_empty));
    if dialect.header.is_some() && 2 * longer.count() > rows.len() {
        names.insert(0, String::new());
        owners.insert(0, None);
    }
    let rest = after_line(text, header_line);
    TextTable {
        boxes: dialect.header.and_then(|_| boxes(names.iter().map(String::as_str))),
        header: TableHeader { names: StringRecord::from(names), owners },
        has_header: dialect.header.is_some(),
        body: body(rest, separator),
        header_line: header_line as u64,
        delimiter: separator.map_or(b'\t', |separator| separator as u8),
        decimal_commas: has_decimal_commas(&rows, separator),
        separators,
        needs_header: None,
        taken: vec![],
        is_open: !text.ends_with('\n'),
    }
}

/// The names of objects above the columns: each holds up to the next one. Of several lines those that differ count.
fn owners(above: &[Vec<String>], width: usize) -> Vec<Option<String>> {
    let mut owners: Vec<Vec<String>> = vec![vec![]; width];
    for line in above.iter().rev() {
        let first = line.first().map(|cell| cell.to_lowercase()).unwrap_or_default();
        let is_alike = line.len() > 2
            && line.get(1..).is_some_and(|rest| rest.windows(2).all(|pair| pair[0] == pair[1]));
        if UNNAMED_LINES.contains(&first.as_str()) || (is_alike && above.len() > 1) || has_number(line) {
            continue;
        }
        let mut name = "";
        for (at, own) in owners.iter_mut().enumerate() {
            let cell = line.get(at).map_or("", |cell| cell.trim_start_matches("multi:").trim());
            name = if cell.is_empty() { name } else { cell };
            own.extend((!name.is_empty()).then(|| name.to_string()));
        }
    }
    owners.into_iter().map(|words| (!words.is_empty()).then(|| words.join(" "))).collect()
}

/// Whether a line without numbers has units, as spreadsheets have them below the header.
fn has_units(cells: &[String]) -> bool {
    cells.iter().any(|cell| is_unit(&cell.trim_matches(['[', ']', '(', ')']).to_lowercase()))
}

/// The text after its first lines.
fn after_line(text: &str, lines: usize) -> &str {
    let mut rest = text;
    for _ in 0..lines {
        rest = rest.split_once('\n').map_or("", |(_, rest)| rest);
    }
    rest
}

/// The text with tabs in place of spaces between columns.
fn tabbed(text: &str) -> String {
    text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join("\t") + "\n").collect()
}

impl TextTable<'_> {
    /// The rows, each with the number of its line; then the header has names for what the reader adds. What was taken or left
    /// out stands in `taken`.
    pub fn records(&mut self) -> Result<Vec<(u64, StringRecord)>, ::csv::Error> {
        let reader = ReaderBuilder::new()
            .delimiter(self.delimiter)
            .comment(Some(b'#'))
            .trim(Trim::All)
            .flexible(true)
            .has_headers(false)
            .from_reader(self.body.as_bytes());
        let (columns, mut records, mut comments) = (self.header.names.len(), vec![], vec![]);
        for record in reader.into_records() {
            let record = record?;
            let line = record.position().map_or(0, |p| p.line()) + self.header_line;
            match tail::without_comment(&record, columns) {
                Some((_, comment)) if record.iter().all(|cell| !comment.is_empty() && cell.is_empty()) => {}
                Some((record, comment)) => {
                    comments.push((line, comment));
                    records.push((line, record));
                }
                None => records.push((line, record)),
            }
        }
        if let Some((line, first)) = comments.first() {
            let count = comments.len();
            self.taken.push(format!(
                "comments behind rows are left out ({count}, the first in line {line}: {first:?})"
            ));
        }
        let (records, left_out) = tail::without_tail(records, columns, (self.is_open, self.decimal_commas));
        self.taken.extend(left_out);
        Ok(self.with_boxes(records))
    }

    /// The records with the middles of their boxes.
    fn with_boxes(&mut self, records: Vec<(u64, StringRecord)>) -> Vec<(u64, StringRecord)> {
        let Some(boxes) = self.boxes else { return records };
        let columns = self.header.names.len();
        self.taken.push(boxes.in_words(&self.header.names));
        self.header.names = boxes.renamed(&self.header.names);
        self.header.owners.resize(columns + 2, None);
        let commas = self.decimal_commas;
        let longer = |(line, record): (u64, StringRecord)| match record.len() <= columns {
            true => (line, boxes.with_middle(&record, columns, commas)),
            false => (line, record),
        };
        records.into_iter().map(longer).collect()
    }

    /// Takes a column for one of no use.
    pub fn pass_over(&mut self, column: usize) {
        let name = |(at, name)| if at == column { "" } else { name };
        self.header.names = self.header.names.iter().enumerate().map(name).collect();
    }

    /// Takes the two of three coordinates that move most.
    pub fn choose_plane(&mut self, spread: impl Fn(usize) -> f64) {
        if let Some((names, words)) = planes::plane(&self.header.names, spread) {
            self.header.names = names;
            self.taken.push(words);
        }
    }
}
