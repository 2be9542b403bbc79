//! Reads tracks from CSV: one row an object and frame, columns by name.

mod assemble;
mod columns;
mod notes;
mod rows;
#[cfg(test)]
mod tests;
mod vocabulary;

use crate::scene::files::assumptions::{StatedValues, assumptions};
use crate::scene::observation::Scene;
use crate::scene::violations::{SceneError, SceneViolations};
use assemble::scene;
use notes::Notes;
use rows::{CsvRows, rows};
use std::collections::BTreeSet;

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
    Ok(read_csv(name, text)?.0)
}

/// The same, with a line for each thing that is assumed because the file does not state it.
pub fn read_csv(name: &str, text: &str) -> Result<(Scene, Vec<String>), SceneError> {
    let text = text.trim_start_matches('\u{feff}');
    let mut r = SceneViolations::of_rows();
    let notes = Notes::read(text, &mut r);
    let rows = rows(text, &notes, &mut r);
    r.finish()?;
    let rows = rows?;
    let stated = stated(&notes, &rows);
    let scene = scene(name, &notes, rows)?.validate()?;
    let assumed = assumptions(&scene, &stated);
    Ok((scene, assumed))
}

/// What a file states, and how to state the rest.
fn stated(notes: &Notes, rows: &CsvRows) -> StatedValues {
    let ids = |sized: bool| -> BTreeSet<u32> {
        rows.rows.iter().filter(|row| !sized || row.size.is_some()).map(|row| row.id).collect()
    };
    StatedValues {
        size: notes.has_size || ids(true) == ids(false),
        fps: rows.timed || notes.fps.is_some(),
        world: notes.has_world,
        how: [
            "`# size: 30 mm`",
            "`# fps: 50`",
            "`# world: air_table`",
            "a column `mass [kg]`",
            "`# unit: cm`",
        ],
    }
}
