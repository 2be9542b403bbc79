//! Collects records with named fields, and writes them as a table.

use crate::scene::files::records::TableText;
use crate::scene::limits::{MAX_FRAMES, MAX_OBJECTS};

/// Most records: those that a scene can hold.
const MAX_RECORDS: usize = MAX_FRAMES * MAX_OBJECTS;
/// Longer texts are no values.
const MAX_TEXT: usize = 200;

/// A field of a record: its name and its value as text.
pub(super) type Field = (String, String);

/// Records with named fields; names in the order in which they are met.
#[derive(Default)]
pub(super) struct RecordTable {
    pub names: Vec<String>,
    rows: Vec<Vec<(usize, String)>>,
    /// Lines in front of the header, such as `# fps: 50`.
    pub notes: Vec<String>,
}

impl RecordTable {
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    pub fn push(&mut self, fields: impl IntoIterator<Item = Field>) {
        if self.rows.len() >= MAX_RECORDS {
            return;
        }
        let row = fields.into_iter().filter(|(_, value)| value.len() <= MAX_TEXT).map(|(name, value)| {
            let at = self.names.iter().position(|known| *known == name).unwrap_or_else(|| {
                self.names.push(name);
                self.names.len() - 1
            });
            (at, value)
        });
        let row = row.collect();
        self.rows.push(row);
    }

    /// Keeps the records whose names fit, and the names that they have; returns how many do not.
    pub fn retain(&mut self, fits: impl Fn(&[String]) -> bool) -> usize {
        let before = self.rows.len();
        let names = std::mem::take(&mut self.names);
        let mut known: std::collections::BTreeMap<Vec<usize>, bool> = std::collections::BTreeMap::new();
        self.rows.retain(|row| {
            let places: Vec<usize> = row.iter().map(|(at, _)| *at).collect();
            let own = || places.iter().filter_map(|at| names.get(*at).cloned()).collect::<Vec<String>>();
            *known.entry(places.clone()).or_insert_with(|| fits(&own()))
        });
        let used: std::collections::BTreeSet<usize> = self.rows.iter().flatten().map(|(at, _)| *at).collect();
        for (at, _) in self.rows.iter_mut().flatten() {
            *at = used.range(..*at).count();
        }
        self.names =
            names.into_iter().enumerate().filter(|(at, _)| used.contains(at)).map(|(_, name)| name).collect();
        before - self.rows.len()
    }

    /// The values of a column, by its place.
    pub fn column(&self, at: usize) -> impl Iterator<Item = &str> {
        self.rows
            .iter()
            .filter_map(move |row| row.iter().find(|(of, _)| *of == at))
            .map(|(_, value)| value.as_str())
    }

    pub fn written(self, taken: Vec<String>) -> TableText {
        let mut text: String = self.notes.iter().map(|note| format!("{note}\n")).collect();
        let line = |cells: &mut dyn Iterator<Item = &str>| {
            let cells: Vec<String> = cells.map(quoted).collect();
            cells.join(",") + "\n"
        };
        text += &line(&mut self.names.iter().map(String::as_str));
        for row in &self.rows {
            let mut cells = vec![""; self.names.len()];
            for (at, value) in row {
                if let Some(cell) = cells.get_mut(*at) {
                    *cell = value;
                }
            }
            text += &line(&mut cells.into_iter());
        }
        TableText { text, taken }
    }
}

/// A cell as CSV has it.
pub(super) fn quoted(cell: &str) -> String {
    let plain = cell.replace(['\n', '\r', '"'], " ");
    let is_plain = !plain.contains(',') && !plain.starts_with(['#', '%', '/']);
    if is_plain { plain } else { format!("\"{plain}\"") }
}
