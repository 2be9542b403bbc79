//! The header of a CSV file: which column holds what, and in which unit.

use crate::scene::files::csv::notes::Notes;
use crate::scene::files::csv::vocabulary::{ANGLES, LENGTHS, MASSES, PIXELS, TIMES, size_of};
use crate::scene::spelling::misspelt;
use crate::scene::violations::SceneViolations;
use ::csv::StringRecord;
use std::collections::BTreeMap;

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum CsvColumn {
    Id,
    Time,
    Frame,
    X,
    Y,
    Yaw,
    Visible,
    Shape,
    Size,
    Mass,
    Material,
    Color,
}

/// The columns and their names.
const COLUMNS: [(CsvColumn, &[&str]); 12] = [
    (CsvColumn::Id, &["id", "object_id", "object", "track"]),
    (CsvColumn::Time, &["t", "time"]),
    (CsvColumn::Frame, &["frame"]),
    (CsvColumn::X, &["x"]),
    (CsvColumn::Y, &["y"]),
    (CsvColumn::Yaw, &["yaw", "theta", "angle"]),
    (CsvColumn::Visible, &["visible"]),
    (CsvColumn::Shape, &["shape"]),
    (CsvColumn::Size, &["size", "radius"]),
    (CsvColumn::Mass, &["mass"]),
    (CsvColumn::Material, &["material"]),
    (CsvColumn::Color, &["color", "colour"]),
];

/// The columns of a file: for each its index, and the size of its unit in SI units.
pub(super) type ColumnPlaces = BTreeMap<CsvColumn, (usize, f64)>;

/// Splits a column name from its unit: `x [mm]`, `x (mm)`, `x_mm`, `x/mm`.
fn split_unit(name: &str) -> (String, Option<String>) {
    let name = name.trim().to_ascii_lowercase();
    let known = |n: &str| COLUMNS.iter().any(|(_, names)| names.contains(&n));
    if known(&name) {
        return (name, None);
    }
    match name.rsplit_once(['[', '(', '_', '/', ' ']) {
        Some((stem, unit)) => {
            let unit = unit.trim_end_matches([']', ')']).trim().to_string();
            (stem.trim_end_matches(['[', '(', '_', '/', ' ']).to_string(), Some(unit))
        }
        None => (name, None),
    }
}

/// The known columns of a header. Unknown ones, such as a speed, are ignored; misspelt ones are reported.
pub(super) fn columns(names: &StringRecord, notes: &Notes, r: &mut SceneViolations) -> ColumnPlaces {
    let mut places = BTreeMap::new();
    for (index, header) in names.iter().enumerate() {
        let (name, unit) = split_unit(header);
        let at = format!("header, column {} ({header})", index + 1);
        let Some((column, _)) = COLUMNS.iter().find(|(_, names)| names.contains(&name.as_str())) else {
            let known = COLUMNS.iter().flat_map(|(_, names)| names.iter().copied());
            if let Some(near) = misspelt(&name, known) {
                r.add(at, format!("is not a known column; did you mean {near}? rename it"));
            }
            continue;
        };
        let factor = unit_size(*column, unit, notes).unwrap_or_else(|message| {
            r.add(at.clone(), message);
            1.0
        });
        if places.insert(*column, (index, factor)).is_some() {
            r.add(at, "is there twice; remove one");
        }
    }
    places
}

/// Size of a column's unit in SI units, or what is wrong with the unit.
fn unit_size(column: CsvColumn, unit: Option<String>, notes: &Notes) -> Result<f64, String> {
    let units: &[(&str, f64)] = match column {
        CsvColumn::X | CsvColumn::Y | CsvColumn::Size => &LENGTHS,
        CsvColumn::Time => &TIMES,
        CsvColumn::Yaw => &ANGLES,
        CsvColumn::Mass => &MASSES,
        _ => &[],
    };
    let is_length = units == LENGTHS;
    let Some(unit) = unit.or_else(|| notes.unit.clone().filter(|_| is_length)) else { return Ok(1.0) };
    let size = if is_length { notes.metres(&unit) } else { size_of(units, &unit) };
    size.ok_or_else(|| match is_length && PIXELS.contains(&unit.as_str()) {
        true => "is in pixels; give the scale in a line `# scale: 0.002` (m per pixel)".to_string(),
        false => {
            let known: Vec<&str> = units.iter().map(|u| u.0).collect();
            format!("has the unit {unit:?}; known: {}", known.join(", "))
        }
    })
}
