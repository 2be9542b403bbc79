//! The rows of a CSV file in SI units; what is wrong with a cell is reported with line and column.

use crate::scene::files::csv::columns::{ColumnPlaces, CsvColumn, columns};
use crate::scene::files::csv::notes::Notes;
use crate::scene::files::csv::vocabulary::{MAX_SIZE, SHAPES, ShapeKind, shape_kind};
use crate::scene::limits::{MASS_RANGE, SIZE_RANGE};
use crate::scene::violations::{SceneError, SceneViolations, readable};
use ::csv::{ReaderBuilder, StringRecord, Trim};
use std::collections::BTreeMap;

/// Largest coordinate (m): longer than any pitch, rink or lane. Larger numbers are in another unit.
const MAX_COORDINATE: f64 = 200.0;
/// A valid start of a file, for messages.
const EXAMPLE_HEADER: &str = "id,t [s],x [mm],y [mm]";

/// One row in SI units.
pub(super) struct Row {
    pub line: u64,
    pub id: u32,
    /// Time (s), or the frame's number.
    pub when: f64,
    /// Position (m) and yaw (rad), where the object was visible.
    pub seen: Option<(f64, f64, Option<f64>)>,
    pub shape: Option<ShapeKind>,
    pub size: Option<f64>,
    pub mass: Option<f64>,
    pub material: Option<String>,
    pub color: Option<String>,
}

/// All rows of a file.
pub(super) struct CsvRows {
    /// Whether `Row::when` is a time, not a frame's number.
    pub timed: bool,
    pub rows: Vec<Row>,
}

/// The constant properties of objects: for each the line that stated it first, and its value as text.
type Stated = BTreeMap<(u32, CsvColumn), (u64, String)>;

/// Reads the header and all rows.
pub(super) fn rows(text: &str, notes: &Notes, r: &mut SceneViolations) -> Result<CsvRows, SceneError> {
    let nothing = |timed| Ok(CsvRows { timed, rows: vec![] });
    let header =
        text.lines().find(|l| !l.trim().is_empty() && !l.trim_start().starts_with('#')).unwrap_or_default();
    if header.is_empty() {
        r.add(
            "(file)",
            format!(
                "has no rows; begin with a header such as `{EXAMPLE_HEADER}`, then one row an object and frame"
            ),
        );
        return nothing(false);
    }
    let delimiter = [b',', b';', b'\t'].into_iter().find(|d| header.as_bytes().contains(d)).unwrap_or(b',');
    let mut reader = ReaderBuilder::new()
        .delimiter(delimiter)
        .comment(Some(b'#'))
        .trim(Trim::All)
        .flexible(true)
        .from_reader(text.as_bytes());
    let names = reader.headers().map_err(|e| SceneError::single("(file)", e.to_string()))?.clone();
    let places = columns(&names, notes, r);
    let timed = places.contains_key(&CsvColumn::Time);
    // Rows cannot be judged without these columns.
    if !has_required_columns(&names, &places, r) {
        return nothing(timed);
    }
    let (mut rows, mut stated) = (vec![], Stated::new());
    for record in reader.records() {
        let record = match record {
            Ok(record) => record,
            Err(error) => {
                r.add("(file)", error.to_string());
                break;
            }
        };
        let line = record.position().map_or(0, |p| p.line());
        if record.len() != names.len() {
            r.add(
                format!("line {line}"),
                format!("has {} columns; the header has {}; give the same number", record.len(), names.len()),
            );
            continue;
        }
        let mut cells =
            Cells { record: &record, names: &names, places: &places, line, stated: &mut stated, r };
        rows.extend(cells.row(timed));
    }
    if rows.is_empty() && r.is_empty() {
        r.add("(file)", "has a header only; give a row for each object and frame");
    }
    Ok(CsvRows { timed, rows })
}

/// Whether no required column is missing; missing ones are reported.
fn has_required_columns(names: &StringRecord, places: &ColumnPlaces, r: &mut SceneViolations) -> bool {
    let mut complete = true;
    for (column, wanted) in [(CsvColumn::Id, "id"), (CsvColumn::X, "x"), (CsvColumn::Y, "y")] {
        if !places.contains_key(&column) {
            complete = false;
            let found: Vec<&str> = names.iter().collect();
            let message =
                format!("has no column {wanted}; it has {}: rename the one that holds it", found.join(", "));
            r.add("header", message);
        }
    }
    if !places.contains_key(&CsvColumn::Time) && !places.contains_key(&CsvColumn::Frame) {
        complete = false;
        r.add("header", "has neither a column t nor a column frame; give one");
    }
    complete
}

/// The cells of one row, by column.
struct Cells<'a> {
    record: &'a StringRecord,
    names: &'a StringRecord,
    places: &'a ColumnPlaces,
    line: u64,
    stated: &'a mut Stated,
    r: &'a mut SceneViolations,
}

impl Cells<'_> {
    fn row(&mut self, timed: bool) -> Option<Row> {
        let id = self.whole(CsvColumn::Id);
        let when =
            if timed { self.number(CsvColumn::Time) } else { self.whole(CsvColumn::Frame).map(f64::from) };
        let clock = if timed { CsvColumn::Time } else { CsvColumn::Frame };
        if when.is_none() && self.lacks(clock) {
            self.wrong(clock, "is empty or NaN; give the time or the frame");
        }
        let visible = match self.text(CsvColumn::Visible).map(str::to_ascii_lowercase).as_deref() {
            None | Some("1" | "true" | "yes") => true,
            Some("0" | "false" | "no") => false,
            Some(other) => {
                let message = format!("is {other:?}; it must be 0 or 1");
                self.wrong(CsvColumn::Visible, message);
                true
            }
        };
        let (x, y, yaw) = (self.number(CsvColumn::X), self.number(CsvColumn::Y), self.number(CsvColumn::Yaw));
        let seen = match (x, y) {
            (Some(x), Some(y)) if visible => Some((x, y, yaw)),
            (None, Some(_)) if visible && self.lacks(CsvColumn::X) => {
                self.wrong(
                    CsvColumn::X,
                    "is empty or NaN, but y is not; leave both empty where it was not seen",
                );
                None
            }
            (Some(_), None) if visible && self.lacks(CsvColumn::Y) => {
                self.wrong(
                    CsvColumn::Y,
                    "is empty or NaN, but x is not; leave both empty where it was not seen",
                );
                None
            }
            _ => None,
        };
        if let Some((x, y, _)) = seen {
            self.check_coordinate(CsvColumn::X, x);
            self.check_coordinate(CsvColumn::Y, y);
        }
        let word = self.text(CsvColumn::Shape).map(str::to_string);
        let shape = word.as_deref().and_then(shape_kind);
        if let (Some(word), None) = (word, shape) {
            self.wrong(CsvColumn::Shape, format!("is {word:?}; it must be {SHAPES}"));
        }
        let (size, mass) = (
            self.within(CsvColumn::Size, [SIZE_RANGE[0], MAX_SIZE], "m"),
            self.within(CsvColumn::Mass, MASS_RANGE, "kg"),
        );
        let [material, color] =
            [CsvColumn::Material, CsvColumn::Color].map(|c| self.text(c).map(str::to_ascii_lowercase));
        let id = id?;
        self.constant(id, CsvColumn::Shape, shape.map(|kind| kind.0.to_string()));
        self.constant(id, CsvColumn::Size, size.map(|v| format!("{v} m")));
        self.constant(id, CsvColumn::Mass, mass.map(|v| format!("{v} kg")));
        self.constant(id, CsvColumn::Material, material.clone());
        self.constant(id, CsvColumn::Color, color.clone());
        Some(Row { line: self.line, id, when: when?, seen, shape, size, mass, material, color })
    }

    /// Reports a property that differs from the one stated for this object first.
    fn constant(&mut self, id: u32, column: CsvColumn, value: Option<String>) {
        let Some(value) = value else { return };
        let (line, first) = self.stated.entry((id, column)).or_insert_with(|| (self.line, value.clone()));
        if *first != value {
            let message = format!(
                "is {value:?} where object {id} has {first:?} in line {line}; give the same value in all its rows, or \
                 another object another id"
            );
            self.wrong(column, message);
        }
    }

    /// Reports a coordinate (m) that is too large.
    fn check_coordinate(&mut self, column: CsvColumn, value: f64) {
        if value.abs() > MAX_COORDINATE {
            let name = if column == CsvColumn::X { "x" } else { "y" };
            let value = readable(value);
            let message = format!(
                "is {value} m; it must be within {MAX_COORDINATE} m; if it is in millimetres, name the column \
                 `{name} [mm]`, and `{name} [px]` if in pixels"
            );
            self.wrong(column, message);
        }
    }

    /// A number in SI units, within a range.
    fn within(&mut self, column: CsvColumn, [low, high]: [f64; 2], unit: &str) -> Option<f64> {
        let value = self.number(column)?;
        let fits = (low..=high).contains(&value);
        if !fits {
            let value = readable(value);
            self.wrong(column, format!("is {value} {unit}; it must be from {low:e} to {high:e} {unit}"));
        }
        fits.then_some(value)
    }

    fn text(&self, column: CsvColumn) -> Option<&str> {
        let (index, _) = self.places.get(&column)?;
        self.record.get(*index).filter(|cell| !cell.is_empty())
    }

    /// Whether the cell is empty or NaN.
    fn lacks(&self, column: CsvColumn) -> bool {
        self.text(column).is_none_or(|text| text.eq_ignore_ascii_case("nan"))
    }

    /// A number in SI units; `None` where the cell is empty, NaN or wrong.
    fn number(&mut self, column: CsvColumn) -> Option<f64> {
        let factor = self.places.get(&column)?.1;
        let text = self.text(column)?.to_string();
        match text.parse::<f64>() {
            Ok(v) if v.is_finite() => Some(v * factor),
            _ if text.eq_ignore_ascii_case("nan") => None,
            _ => {
                let wanted = match column {
                    CsvColumn::Id => "give a whole number from 0 as the object's id",
                    _ if text.replace(',', ".").parse::<f64>().is_ok() => {
                        "write a point before decimals: 1.5, not 1,5"
                    }
                    _ => "give a number such as 1.5",
                };
                self.wrong(column, format!("is {text:?}; {wanted}"));
                None
            }
        }
    }

    fn whole(&mut self, column: CsvColumn) -> Option<u32> {
        let value = self.number(column)?;
        let whole = value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0;
        if !whole {
            self.wrong(column, format!("is {}; give a whole number from 0", readable(value)));
        }
        whole.then_some(value as u32)
    }

    fn wrong(&mut self, column: CsvColumn, message: impl Into<String>) {
        let at = match self.places.get(&column) {
            Some((index, _)) => {
                let name = self.names.get(*index).unwrap_or_default();
                format!("line {}, column {} ({name})", self.line, index + 1)
            }
            None => format!("line {}", self.line),
        };
        self.r.add(at, message);
    }
}
