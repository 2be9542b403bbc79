//! Files of MTrackJ (ImageJ): a line for each track and each of its points.

use super::{RecordTable, TableText};

/// The table of a file of MTrackJ; `None`: it is none.
pub(super) fn table(text: &str) -> Option<TableText> {
    if !text.trim_start().starts_with("MTrackJ") {
        return None;
    }
    let mut table = RecordTable::default();
    let mut track = 0;
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["Track", ..] => track += 1,
            ["Point", _, x, y, _, frame, ..] => {
                let fields = [
                    ("id", track.to_string()),
                    ("frame", whole(frame)),
                    ("x [px]", x.to_string()),
                    ("y [px]", y.to_string()),
                ];
                table.push(fields.map(|(name, value)| (name.to_string(), value)));
            }
            _ => {}
        }
    }
    Some(table.written(vec!["tracks of MTrackJ, numbered in their order".into()]))
}

/// A frame as a whole number: MTrackJ writes 1.0.
fn whole(frame: &str) -> String {
    frame.strip_suffix(".0").unwrap_or(frame).to_string()
}
