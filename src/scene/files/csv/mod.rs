//! Reads tracks from CSV: one row an object and frame, columns by name.

mod assemble;
mod assumed_size;
mod cell_values;
mod columns;
mod dialect;
mod frame_times;
mod ids;
mod layout;
mod names;
mod notes;
mod rows;
mod survey;
#[cfg(test)]
mod tests;
mod vocabulary;
mod write;

use crate::scene::files::assumptions::{StatedValues, assumptions};
use crate::scene::observation::Scene;
use crate::scene::violations::{SceneError, SceneViolations, readable};
use assemble::scene;
use assumed_size::shrink_to_fit;
pub(super) use cell_values::clock;
use notes::Notes;
pub use notes::TableDefaults;
use rows::{CsvRows, rows};
use std::collections::BTreeSet;
pub(super) use vocabulary::is_unit;
pub use write::written_csv;

/// Reads the text of a CSV file of tracks.
///
/// A header names the columns: `id`, `t` or `frame`, `x`, `y`, and where they are known `yaw`, `visible` (0 or 1),
/// `shape` (disc, ball, cube), `size` (radius or half side), `mass`, `material`, `color`. A unit stands behind a name, as in
/// `x [mm]` or `x_mm`: m, cm, mm, px; s, ms; rad, deg; kg, g. Columns are separated by commas, semicolons or tabs.
///
/// Lines `# key: value` before the header hold for all rows: `fps`, `unit` (of lengths, `size` too), `scale` (m per pixel; without
/// it pixels are refused), `size`, `shape`, `material`, `world`, `setup`, `table` (its cushions: x low, x high, y low, y high).
///
/// Rows may be in any order, one for each object and time. A constant property of an object, such as its mass, may stand
/// in one of its rows only. Everything that is wrong is reported at once, with line and column.
pub fn parse_csv(name: &str, text: &str) -> Result<Scene, SceneError> {
    let text = text.trim_start_matches('\u{feff}');
    Ok(read_table(name, text, &TableDefaults::default())?.0)
}

/// Whether a table with these columns has positions.
pub(super) fn names_positions(names: &[String]) -> bool {
    dialect::is_header(names)
}

/// Whether a text has a header that names positions.
pub(super) fn is_table(text: &str) -> bool {
    dialect::find(text).has_header
}

/// The same for a table of this or another program, with a line for each thing that is assumed because the file does not
/// state it.
pub(super) fn read_table(
    name: &str,
    text: &str,
    defaults: &TableDefaults,
) -> Result<(Scene, Vec<String>), SceneError> {
    let mut r = SceneViolations::of_rows();
    let mut notes = Notes::read(text, defaults, &mut r);
    let rows = rows(text, &notes, &mut r);
    r.finish()?;
    let mut rows = rows?;
    if let Some(size) = rows.measured_size {
        (notes.size, notes.has_size) = (size, true);
    }
    let (mut stated, timed) = (stated(&notes, &rows), rows.timed);
    let sized = notes.has_size || rows.rows.iter().any(|row| row.size.is_some());
    let mut dialect = std::mem::take(&mut rows.dialect);
    let (mut scene, of_rows) = scene(name, &notes, rows)?;
    stated.shrunk = if sized { None } else { shrink_to_fit(&mut scene) };
    let scene = scene.validate()?;
    if timed && !dialect.is_empty() {
        dialect.push(format!("{} frames/s from the times", readable((100.0 * scene.fps).round() / 100.0)));
    }
    let mut assumed = assumptions(&scene, &stated);
    assumed.extend((!dialect.is_empty()).then(|| format!("the table has {}", dialect.join(", "))));
    assumed.extend(of_rows);
    Ok((scene, assumed))
}

/// What a file states, and how to state the rest.
fn stated(notes: &Notes, rows: &CsvRows) -> StatedValues {
    let objects = |sized: bool| -> BTreeSet<usize> {
        rows.rows.iter().filter(|row| !sized || row.size.is_some()).map(|row| row.object).collect()
    };
    StatedValues {
        size: notes.has_size || objects(true) == objects(false),
        fps: rows.timed || notes.fps.is_some(),
        world: notes.has_world,
        shrunk: None,
        how: [
            "`# size: 30 mm`",
            "`# fps: 50`",
            "`# world: air_table`",
            "a column `mass [kg]`",
            "`# unit: cm`",
        ],
    }
}
