//! Reads tracks from CSV: one row an object and frame, columns by name.

mod assemble;
mod columns;
mod notes;
mod rows;
#[cfg(test)]
mod tests;
mod vocabulary;

use crate::scene::observation::Scene;
use crate::scene::violations::{SceneError, SceneViolations};
use assemble::scene;
use notes::Notes;
use rows::rows;

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
    let mut r = SceneViolations::of_rows();
    let notes = Notes::read(text, &mut r);
    let rows = rows(text, &notes, &mut r);
    r.finish()?;
    scene(name, &notes, rows?)?.validate()
}
