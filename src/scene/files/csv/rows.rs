//! The rows of a table in SI units; what is wrong with a cell is reported with line and column.

use crate::scene::files::csv::cell_values::{clock, image_number, is_absent, number};
use crate::scene::files::csv::columns::{ASSUMED_PIXEL, ColumnMap, ColumnPlaces, columns};
use crate::scene::files::csv::dialect::{TextTable, find};
use crate::scene::files::csv::ids::ObjectNames;
use crate::scene::files::csv::names::CsvColumn;
use crate::scene::files::csv::notes::Notes;
use crate::scene::files::csv::survey::{MAX_COORDINATE, TableCells};
use crate::scene::files::csv::vocabulary::{MAX_SIZE, SHAPES, ShapeKind, shape_kind};
use crate::scene::limits::{MASS_RANGE, SIZE_RANGE};
use crate::scene::violations::{SceneError, SceneViolations, readable};
use ::csv::StringRecord;
use std::collections::BTreeMap;

/// A valid start of a file, for messages.
const EXAMPLE_HEADER: &str = "id,t [s],x [mm],y [mm]";
/// Least likelihood of a position that counts: the default of DeepLabCut.
const LEAST_LIKELIHOOD: f64 = 0.6;
/// Cells at the start of a row that the path of an image takes, at most: folders and name.
const MAX_PATH_CELLS: usize = 3;

/// One row in SI units.
pub(super) struct Row {
    pub line: u64,
    /// Place of the object in the names.
    pub object: usize,
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
#[derive(Default)]
pub(super) struct CsvRows {
    /// Whether `Row::when` is a time, not a frame's number.
    pub timed: bool,
    pub rows: Vec<Row>,
    pub names: ObjectNames,
    /// Whether ids or names of columns tell objects apart.
    pub has_ids: bool,
    /// How the table differs from our own, in a few words each.
    pub dialect: Vec<String>,
    /// What was assumed of the rows, a line each.
    pub assumed: Vec<String>,
    /// Median of a size that is measured in each row (m).
    pub measured_size: Option<f64>,
}

/// Where the time of a row stands; `None`: rows are frames.
type RowClock = Option<CsvColumn>;

/// The constant properties of objects: for each the line that stated it first, and its value as text.
type Stated = BTreeMap<(usize, CsvColumn), (u64, String)>;

/// Reads the header and all rows.
pub(super) fn rows(text: &str, notes: &Notes, r: &mut SceneViolations) -> Result<CsvRows, SceneError> {
    let mut found = CsvRows::default();
    if text.lines().all(|line| line.trim().is_empty() || line.trim_start().starts_with('#')) {
        let form = "then one row an object and frame";
        r.add("(file)", format!("has no rows; begin with a header such as `{EXAMPLE_HEADER}`, {form}"));
        return Ok(found);
    }
    let mut table = find(text);
    let records = match table.records() {
        Ok(records) => records,
        Err(error) => {
            r.add("(file)", error.to_string());
            return Ok(found);
        }
    };
    let mut map = surveyed(&mut table, &records, notes, (&mut found, r));
    let clock = row_clock(&table, &records, &mut map);
    found.timed = clock == Some(CsvColumn::Time);
    if clock.is_some() {
        let names = &table.header.names;
        TableCells { names, records: &records, decimal_commas: table.decimal_commas }.check_ids(&map, r);
    }
    // Rows cannot be judged without these columns.
    if !has_required_columns(&table, &map, clock, r) {
        return Ok(found);
    }
    let mut reader =
        TableReader { table: &table, map: &map, clock, stated: Stated::new(), counts: RowCounts::default() };
    for (line, record) in &records {
        reader.take(*line, record, &mut found, r);
    }
    let counts = reader.counts;
    if found.rows.is_empty() && r.is_empty() {
        r.add("(file)", "has a header only; give a row for each object and frame");
    }
    if table.separators != "commas" || table.decimal_commas {
        let commas = if table.decimal_commas { ", decimal commas" } else { "" };
        found.dialect.push(format!("{}{commas}", table.separators));
    }
    found.dialect.append(&mut map.renamed);
    found.assumed.extend(std::mem::take(&mut table.taken));
    found.assumed.extend(counts.in_words());
    if clock.is_none() {
        found.assumed.push("one row for each frame (a column `frame` or `t [s]`)".into());
    }
    found.has_ids = !map.objects.is_empty() || map.shared.contains_key(&CsvColumn::Id);
    if !found.has_ids {
        found.assumed.push("one object, with id 0 (a column `id`)".into());
    }
    found.assumed.extend(found.names.in_words());
    Ok(found)
}

/// The columns, chosen by what all rows hold; reports numbers that may be read in two ways.
fn surveyed(
    table: &mut TextTable,
    records: &[(u64, StringRecord)],
    notes: &Notes,
    (found, r): (&mut CsvRows, &mut SceneViolations),
) -> ColumnMap {
    let names = table.header.names.clone();
    let cells = TableCells { names: &names, records, decimal_commas: table.decimal_commas };
    table.choose_plane(|at| cells.spread(at));
    let rough = |table: &TextTable| columns(&table.header, notes, false, &mut SceneViolations::default());
    let mut known = rough(table);
    while let Some(at) = cells.empty_column(&known) {
        table.pass_over(at);
        known = rough(table);
    }
    let (rough, names) = (known, table.header.names.clone());
    let cells = TableCells { names: &names, ..cells };
    cells.check_signs(&rough, r);
    let has_unit = notes.unit.is_some() || notes.scale.is_some();
    let mut map =
        columns(&table.header, notes, !has_unit && cells.is_beyond_metres(&rough, ASSUMED_PIXEL), r);
    if let Some(size) = cells.measured_size(&map)
        && let Some((at, unit)) = map.shared.remove(&CsvColumn::Size)
    {
        let name = names.get(at).unwrap_or_default();
        found.measured_size = Some(size * unit);
        found
            .assumed
            .push(format!("the median of `{name}`, which differs from row to row, as radius or half side"));
    }
    map
}

/// The column with the time of each row.
fn row_clock(table: &TextTable, records: &[(u64, StringRecord)], map: &mut ColumnMap) -> RowClock {
    let has = |places: &ColumnPlaces, column| places.contains_key(&column);
    if has(&map.shared, CsvColumn::Time) || map.objects.iter().any(|(_, own)| has(own, CsvColumn::Time)) {
        return Some(CsvColumn::Time);
    }
    // The index of a data frame has no name.
    let first = records.first();
    let is_count = |cell: &str| number(cell, false).is_some_and(|value| value.fract() == 0.0);
    let is_index = table.header.names.get(0).is_some_and(str::is_empty)
        && first.is_some_and(|(_, record)| record.get(0).is_some_and(is_count));
    if !has(&map.shared, CsvColumn::Frame) && !has(&map.shared, CsvColumn::Id) && is_index {
        map.shared.insert(CsvColumn::Frame, (0, 1.0));
    }
    has(&map.shared, CsvColumn::Frame).then_some(CsvColumn::Frame)
}

/// Whether no required column is missing; missing ones are reported.
fn has_required_columns(
    table: &TextTable,
    map: &ColumnMap,
    clock: RowClock,
    r: &mut SceneViolations,
) -> bool {
    let has = |column| map.shared.contains_key(&column);
    let names: Vec<&str> = table.header.names.iter().collect();
    let is_placed =
        (has(CsvColumn::X) && has(CsvColumn::Y)) || map.objects.iter().any(|(_, own)| !own.is_empty());
    if !table.has_header
        && (table.needs_header.is_some() || names.iter().all(|name| number(name, false).is_some()))
    {
        let why = table.needs_header.as_deref().unwrap_or("is missing");
        r.add(
            "header",
            format!("{why}; put a line in front that names the columns, such as `{EXAMPLE_HEADER}`"),
        );
        return false;
    }
    if !is_placed {
        for (column, wanted) in [(CsvColumn::Id, "id"), (CsvColumn::X, "x"), (CsvColumn::Y, "y")] {
            if !has(column) {
                let found = names.join(", ");
                let message = format!("has no column {wanted}; it has {found}: rename the one that holds it");
                r.add("header", message);
            }
        }
    }
    let needs_clock = !is_placed || has(CsvColumn::Id);
    if clock.is_none() && needs_clock {
        r.add("header", "has neither a column t nor a column frame; give one");
    }
    is_placed && (clock.is_some() || !needs_clock)
}

/// Rows that are read in a way to be named.
#[derive(Default)]
struct RowCounts {
    records: usize,
    without_id: usize,
    unlikely: usize,
}

impl RowCounts {
    fn in_words(&self) -> Vec<String> {
        let line = |count: usize, words: String| (count > 0).then_some(words);
        let without = format!("{} rows without an id are ignored", self.without_id);
        let unlikely =
            format!("{} positions with a likelihood below {LEAST_LIKELIHOOD} were not seen", self.unlikely);
        [line(self.without_id, without), line(self.unlikely, unlikely)].into_iter().flatten().collect()
    }
}

/// Reads the rows of a table.
struct TableReader<'a> {
    table: &'a TextTable<'a>,
    map: &'a ColumnMap,
    clock: RowClock,
    stated: Stated,
    counts: RowCounts,
}

impl TableReader<'_> {
    /// The rows of one line: one, or one for each object with columns of its own.
    fn take(&mut self, line: u64, record: &StringRecord, found: &mut CsvRows, r: &mut SceneViolations) {
        let names = &self.table.header.names;
        let too_long = record.iter().skip(names.len()).any(|cell| !cell.is_empty());
        // Programs leave out empty cells at the end of a line.
        if too_long || (record.len() < names.len() && self.map.objects.is_empty()) {
            let (own, header) = (record.len(), names.len());
            let decimals = match own >= 2 * header - 1 && self.table.separators == "commas" {
                true => "; if commas are decimal signs, separate columns by semicolons",
                false => "",
            };
            let message =
                format!("has {own} columns; the header has {header}; give the same number{decimals}");
            r.add(format!("line {line}"), message);
            return;
        }
        let number = self.counts.records as f64;
        self.counts.records += 1;
        let no_objects = [(String::new(), ColumnPlaces::new())];
        let objects = if self.map.objects.is_empty() { &no_objects[..] } else { &self.map.objects };
        let mut known: Option<((usize, f64), Option<f64>)> = None;
        for (name, own) in objects {
            let mut places = self.map.shared.clone();
            places.extend(own);
            let (stated, counts) = (&mut self.stated, &mut self.counts);
            let of_table = (names, self.table.decimal_commas);
            let mut cells = Cells { record, of_table, places: &places, line, stated, counts, r };
            let at = self.clock.and_then(|clock| places.get(&clock).copied());
            let when = match (known, at) {
                (_, None) => Some(number),
                (Some((place, when)), Some(at)) if place == at => when,
                (_, Some(at)) => {
                    let when = cells.when(self.clock);
                    known = Some((at, when));
                    when
                }
            };
            found.rows.extend(cells.row(name, when, &mut found.names));
        }
    }
}

/// The cells of one row, by column.
struct Cells<'a> {
    record: &'a StringRecord,
    /// Names of the columns, and whether decimal signs are commas.
    of_table: (&'a StringRecord, bool),
    places: &'a ColumnPlaces,
    line: u64,
    stated: &'a mut Stated,
    counts: &'a mut RowCounts,
    r: &'a mut SceneViolations,
}

impl Cells<'_> {
    /// Time (s), or number of the frame.
    fn when(&mut self, clock: RowClock) -> Option<f64> {
        let clock = clock?;
        let when = match clock {
            CsvColumn::Frame => self.frame(),
            _ => self.time(),
        };
        let is_empty = self.lacks(CsvColumn::X) && self.lacks(CsvColumn::Y);
        if when.is_none() && self.lacks(clock) && !is_empty {
            self.wrong(clock, "is empty or NaN; give the time or the frame");
        }
        when
    }

    /// The row of an object, which the id or the columns' name says.
    fn row(&mut self, name: &str, when: Option<f64>, names: &mut ObjectNames) -> Option<Row> {
        let id = self.id(name);
        let visible = self.is_visible();
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
        let name = id?;
        let object = names.place(&name);
        self.constant((object, &name), CsvColumn::Shape, shape.map(|kind| kind.0.to_string()));
        self.constant((object, &name), CsvColumn::Size, size.map(|v| format!("{v} m")));
        self.constant((object, &name), CsvColumn::Mass, mass.map(|v| format!("{v} kg")));
        self.constant((object, &name), CsvColumn::Material, material.clone());
        self.constant((object, &name), CsvColumn::Color, color.clone());
        Some(Row { line: self.line, object, when: when?, seen, shape, size, mass, material, color })
    }

    /// The name of the object: its id, the name of its columns, or both; 0 where there is neither.
    fn id(&mut self, name: &str) -> Option<String> {
        if !self.places.contains_key(&CsvColumn::Id) {
            return Some(if name.is_empty() { "0".into() } else { name.to_string() });
        }
        let Some(id) = self.text(CsvColumn::Id).map(str::to_string) else {
            self.counts.without_id += 1;
            return None;
        };
        if number(&id, false).is_some() {
            self.whole(CsvColumn::Id)?;
        }
        Some(if name.is_empty() { id } else { format!("{id} {name}") })
    }

    /// Whether the row's object was seen, as far as columns say so.
    fn is_visible(&mut self) -> bool {
        for (column, shown) in [(CsvColumn::Visible, true), (CsvColumn::Missing, false)] {
            match self.text(column).map(str::to_ascii_lowercase).as_deref() {
                None => {}
                Some("1" | "1.0" | "true" | "yes") if shown => {}
                Some("0" | "0.0" | "false" | "no") if !shown => {}
                Some("0" | "0.0" | "false" | "no" | "1" | "1.0" | "true" | "yes") => return false,
                Some(other) => {
                    let message = format!("is {other:?}; it must be 0 or 1");
                    self.wrong(column, message);
                }
            }
        }
        let unlikely = self.number(CsvColumn::Likelihood).is_some_and(|value| value < LEAST_LIKELIHOOD);
        self.counts.unlikely += usize::from(unlikely);
        !unlikely
    }

    /// Reports a property that differs from the one stated for this object first.
    fn constant(&mut self, (object, name): (usize, &str), column: CsvColumn, value: Option<String>) {
        let Some(value) = value else { return };
        let (line, first) = self.stated.entry((object, column)).or_insert_with(|| (self.line, value.clone()));
        if *first != value {
            let message = format!(
                "is {value:?} where object {name} has {first:?} in line {line}; give the same value in all its rows, or \
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
                 `{name} [mm]`; if in pixels, put a line `# scale: 0.002` (m per pixel) in front"
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

    /// The text of a cell; `None` where it holds nothing.
    fn text(&self, column: CsvColumn) -> Option<&str> {
        let (index, _) = self.places.get(&column)?;
        self.record.get(*index).filter(|cell| !is_absent(cell))
    }

    /// Whether the cell holds nothing.
    fn lacks(&self, column: CsvColumn) -> bool {
        self.text(column).is_none()
    }

    /// A number in SI units; `None` where the cell holds nothing or is wrong.
    fn number(&mut self, column: CsvColumn) -> Option<f64> {
        let factor = self.places.get(&column)?.1;
        let text = self.text(column)?;
        let value = number(text, self.of_table.1);
        if value.is_none() {
            let wanted = match number(text, true) {
                Some(_) => "write a point before decimals: 1.5, not 1,5",
                None => "give a number such as 1.5",
            };
            let message = format!("is {text:?}; {wanted}");
            self.wrong(column, message);
        }
        Some(value? * factor)
    }

    /// Seconds, also of a clock time.
    fn time(&mut self) -> Option<f64> {
        match self.text(CsvColumn::Time).and_then(clock) {
            Some(seconds) => Some(seconds),
            None => self.number(CsvColumn::Time),
        }
    }

    /// A whole number, also below 0.
    fn frame(&mut self) -> Option<f64> {
        let text = self.text(CsvColumn::Frame)?;
        // Labelled images, whose path may take several cells.
        if number(text, self.of_table.1).is_none()
            && let Some(image) = self.record.iter().take(MAX_PATH_CELLS).find_map(image_number)
        {
            return Some(image);
        }
        let value = self.number(CsvColumn::Frame)?;
        if value.fract() != 0.0 {
            self.wrong(CsvColumn::Frame, format!("is {}; give a whole number", readable(value)));
        }
        (value.fract() == 0.0).then_some(value)
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
                let name = self.of_table.0.get(*index).unwrap_or_default();
                format!("line {}, column {} ({name})", self.line, index + 1)
            }
            None => format!("line {}", self.line),
        };
        self.r.add(at, message);
    }
}
