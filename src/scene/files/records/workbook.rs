//! Workbooks (.xlsx): the first sheet with positions becomes a table.

use super::TableText;
use super::record_table::quoted;
use crate::scene::files::archive::{content, entries, is_archive};
use crate::scene::files::csv::is_table;
use crate::scene::violations::SceneError;
use roxmltree::{Document, Node};

/// Widest table (columns): that of the most objects with several columns each.
const MAX_COLUMNS: usize = 2048;
/// Most cells of a table.
const MAX_CELLS: usize = 20_000_000;

/// The table of a workbook; `None`: it is none.
pub(super) fn table(bytes: &[u8]) -> Option<Result<TableText, SceneError>> {
    if !is_archive(bytes) {
        return None;
    }
    let mut sheets: Vec<Vec<u8>> = entries(bytes)
        .iter()
        .map(|entry| entry.name.to_vec())
        .filter(|name| name.starts_with(b"xl/worksheets/sheet") && name.ends_with(b".xml"))
        .collect();
    if sheets.is_empty() {
        return None;
    }
    sheets.sort_by_key(|name| (name.len(), name.clone()));
    let xml = |name: &str| String::from_utf8(content(bytes, name)?).ok();
    let strings = xml("xl/sharedStrings.xml").map(|text| shared(&text)).unwrap_or_default();
    let refused = |message: &str| Some(Err(SceneError::single("(file)", message)));
    let mut texts = vec![];
    for name in &sheets {
        let text = std::str::from_utf8(name).ok().and_then(&xml).and_then(|text| sheet(&text, &strings));
        let Some(text) = text else {
            return refused("is a workbook that is damaged or too large; save its sheet as CSV");
        };
        texts.push(text);
    }
    let count = texts.len();
    let found: Vec<usize> =
        (0..count).filter(|at| texts.get(*at).is_some_and(|text| is_table(text))).collect();
    let taken = match (found.as_slice(), count) {
        ([one], 1) => (*one, "the sheet of a workbook".to_string()),
        ([one, more @ ..], _) => {
            let others = if more.is_empty() { "" } else { "; others have positions too (save them as CSV)" };
            (*one, format!("sheet {} of {count} of a workbook{others}", one + 1))
        }
        ([], _) => (0, "the first sheet of a workbook".to_string()),
    };
    let text = texts.into_iter().nth(taken.0)?;
    Some(Ok(TableText { text, taken: vec![taken.1] }))
}

/// All text of a node.
fn text_of(node: Node) -> String {
    let parts = node.descendants().filter(|part| part.tag_name().name() == "t");
    parts.filter_map(|part| part.text()).collect()
}

/// The texts that cells refer to.
fn shared(xml: &str) -> Vec<String> {
    let document = Document::parse(xml).ok();
    let root = document.as_ref().map(|document| document.root_element());
    root.into_iter()
        .flat_map(|root| root.children())
        .filter(|node| node.tag_name().name() == "si")
        .map(text_of)
        .collect()
}

/// The index of a cell's column: 0 of `A1`, 27 of `AB7`.
fn column_of(reference: &str) -> Option<usize> {
    let letters = reference.bytes().take_while(u8::is_ascii_uppercase);
    let index = letters.take(4).fold(0, |sum, letter| 26 * sum + usize::from(letter - b'A') + 1);
    index.checked_sub(1).filter(|column| *column < MAX_COLUMNS)
}

/// The cells of a sheet as CSV; `None`: it is damaged or too large.
fn sheet(xml: &str, strings: &[String]) -> Option<String> {
    let document = Document::parse(xml).ok()?;
    let is = |name: &'static str| move |node: &Node| node.tag_name().name() == name;
    let (mut text, mut all) = (String::new(), 0);
    for row in document.descendants().filter(is("row")) {
        let mut cells: Vec<String> = vec![];
        for cell in row.children().filter(is("c")) {
            let column = match cell.attribute("r") {
                Some(reference) => column_of(reference)?,
                None => cells.len(),
            };
            let value = cell.children().find(is("v")).and_then(|value| value.text()).unwrap_or_default();
            let value = match cell.attribute("t") {
                Some("s") => {
                    value.parse().ok().and_then(|at: usize| strings.get(at)).cloned().unwrap_or_default()
                }
                Some("inlineStr") => text_of(cell),
                _ => value.to_string(),
            };
            all += column + 1 - cells.len().min(column + 1);
            if all > MAX_CELLS {
                return None;
            }
            cells.resize(cells.len().max(column), String::new());
            cells.push(value);
        }
        text += &cells.iter().map(|cell| quoted(cell)).collect::<Vec<_>>().join(",");
        text.push('\n');
    }
    Some(text)
}
