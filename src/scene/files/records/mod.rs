//! Files of records that are no table: logs, JSON, XML and the formats of trackers become a table of text, which is read as all
//! tables are.

mod json;
mod log_lines;
mod motion_capture;
mod mtrackj;
mod numpy;
mod record_table;
#[cfg(test)]
mod tests;
mod workbook;
mod xml;

use crate::scene::violations::SceneError;
use record_table::RecordTable;

/// A table of text, and what was taken to make it, a line each.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TableText {
    pub text: String,
    pub taken: Vec<String>,
}

/// The table that bytes which are no text hold: a workbook, or arrays of NumPy.
pub(super) fn of_bytes(bytes: &[u8]) -> Option<Result<TableText, SceneError>> {
    workbook::table(bytes).or_else(|| numpy::table(bytes))
}

/// The table that JSON holds; `None`: it holds no positions, or is none.
pub(super) fn of_json(text: &str) -> Option<Result<TableText, SceneError>> {
    json::table(text)
}

/// The table that XML of other programs than Tracker holds.
pub(super) fn of_xml(text: &str) -> Option<Result<TableText, SceneError>> {
    xml::table(text)
}

/// The table that text without a header of columns holds.
pub(super) fn of_text(text: &str) -> Option<Result<TableText, SceneError>> {
    mtrackj::table(text).map(Ok).or_else(|| log_lines::table(text))
}

/// The table of a motion-capture program, with its own lines about rate and unit as ours.
pub(super) fn of_motion_capture(text: &str) -> Option<TableText> {
    motion_capture::table(text)
}
