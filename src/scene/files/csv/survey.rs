//! What all rows of a table together say of its numbers: whether lengths can be metres, what a comma or point separates, and
//! whether a size is measured in each row.

use crate::num::quantile;
use crate::scene::files::csv::cell_values::{is_absent, number, ungrouped};
use crate::scene::files::csv::columns::{ColumnMap, ColumnPlaces};
use crate::scene::files::csv::names::{CsvColumn, unit_of};
use crate::scene::violations::SceneViolations;
use ::csv::StringRecord;
use std::collections::BTreeSet;

/// Largest coordinate (m): longer than any pitch, rink or lane. Larger numbers are in another unit.
pub(super) const MAX_COORDINATE: f64 = 200.0;
/// Fewer of the numbers are errors of a tracker, or its sign for "not seen".
const LEAST_LARGE_SHARE: f64 = 0.05;
/// A constant of an object has so many values at most, by mistake; a measured one has more.
const MOST_CONSTANT_VALUES: usize = 4;
/// So many objects may have one row each, by chance.
const MOST_COUNTED: usize = 8;

/// The records of a table with the numbers of their lines, the names of its columns, and its decimal sign.
pub(super) struct TableCells<'a> {
    pub names: &'a StringRecord,
    pub records: &'a [(u64, StringRecord)],
    pub decimal_commas: bool,
}

impl TableCells<'_> {
    /// The texts of a column that hold something, each with its line.
    fn column(&self, at: usize) -> impl Iterator<Item = (u64, &str)> {
        let cell = move |(line, record): &'_ (u64, StringRecord)| -> Option<(u64, usize)> {
            record.get(at).filter(|cell| !is_absent(cell)).map(|_| (*line, at))
        };
        self.records.iter().filter_map(move |row| {
            let (line, at) = cell(row)?;
            Some((line, row.1.get(at)?))
        })
    }

    fn numbers(&self, at: usize) -> impl Iterator<Item = f64> {
        self.column(at).filter_map(|(_, cell)| number(cell, self.decimal_commas))
    }

    /// A column of ids or times that holds none.
    pub fn empty_column(&self, map: &ColumnMap) -> Option<usize> {
        let places = [CsvColumn::Id, CsvColumn::Time, CsvColumn::Frame]
            .into_iter()
            .filter_map(|column| map.shared.get(&column));
        let is_empty = |at: &usize| !self.records.is_empty() && self.column(*at).next().is_none();
        places.map(|(at, _)| *at).find(is_empty)
    }

    /// The width of the range that holds nine tenths of a column's numbers.
    pub fn spread(&self, at: usize) -> f64 {
        let mut values: Vec<f64> = self.numbers(at).collect();
        let [low, high] = [0.05, 0.95].map(|share| quantile(&mut values, share).unwrap_or(0.0));
        high - low
    }

    /// Whether positions without a unit are too large for metres, and not for units of this size (m).
    pub fn is_beyond_metres(&self, map: &ColumnMap, unit: f64) -> bool {
        let (mut all, mut large, mut largest) = (0usize, 0usize, 0.0f64);
        for at in indices(map, &[CsvColumn::X, CsvColumn::Y]) {
            if self.names.get(at).and_then(unit_of).is_some() {
                return false;
            }
            for value in self.numbers(at) {
                all += 1;
                largest = largest.max(value.abs());
                large += usize::from(value.abs() > MAX_COORDINATE);
            }
        }
        largest * unit <= MAX_COORDINATE && large > 0 && large as f64 >= LEAST_LARGE_SHARE * all as f64
    }

    /// The median of a size that differs from row to row (in the unit of its column).
    pub fn measured_size(&self, map: &ColumnMap) -> Option<f64> {
        let (at, _) = map.shared.get(&CsvColumn::Size)?;
        let mut values: Vec<f64> = self.numbers(*at).filter(|value| *value > 0.0).collect();
        let different: BTreeSet<u64> = values.iter().map(|value| value.to_bits()).collect();
        let objects = match map.shared.get(&CsvColumn::Id) {
            Some((id, _)) => self.column(*id).map(|(_, cell)| cell).collect::<BTreeSet<&str>>().len(),
            None => 1,
        };
        (different.len() > MOST_CONSTANT_VALUES * objects).then(|| quantile(&mut values, 0.5)).flatten()
    }

    /// Reports an id that no two of many rows share: it counts rows.
    pub fn check_ids(&self, map: &ColumnMap, r: &mut SceneViolations) {
        let Some((at, _)) = map.shared.get(&CsvColumn::Id) else { return };
        let (different, all) = (
            self.column(*at).map(|(_, cell)| cell).collect::<BTreeSet<&str>>().len(),
            self.column(*at).count(),
        );
        if all > MOST_COUNTED && different == all {
            let name = self.names.get(*at).unwrap_or_default();
            let message = format!(
                "has another id in each of {all} rows: it counts rows; name the column `id` that stays the same for an object, and \
                 this one otherwise"
            );
            r.add(format!("header, column {} ({name})", at + 1), message);
        }
    }

    /// Reports numbers whose comma or point may separate thousands as well as decimals.
    pub fn check_signs(&self, map: &ColumnMap, r: &mut SceneViolations) {
        let places = indices(map, &[CsvColumn::X, CsvColumn::Y, CsvColumn::Time, CsvColumn::Frame]);
        let sign = if self.decimal_commas { ',' } else { '.' };
        let decimals = |cell: &str| cell.contains(sign) && ungrouped(cell, sign).is_none();
        if self.decimal_commas && places.iter().any(|at| self.column(*at).any(|(_, cell)| decimals(cell))) {
            return self.check_other_sign(&places, r);
        }
        for at in places {
            let (mut grouped, mut whole) = (None, None);
            if self.column(at).any(|(_, cell)| decimals(cell)) {
                continue;
            }
            for (line, cell) in self.column(at) {
                if cell.contains(sign) {
                    grouped = grouped.or(Some((line, cell)));
                } else if number(cell, self.decimal_commas)
                    .is_some_and(|v| (100.0..1000.0).contains(&v.abs()))
                {
                    whole = whole.or(Some(cell));
                }
            }
            let Some((line, cell)) = grouped else { continue };
            let beside = whole.map(|whole| format!(" beside {whole}")).unwrap_or_default();
            if self.decimal_commas || whole.is_some() {
                self.ambiguous((at, line), &format!("{cell:?}{beside}"), sign, r);
            }
        }
    }

    /// In a table with decimal commas: reports numbers with points only that may be thousands.
    fn check_other_sign(&self, places: &[usize], r: &mut SceneViolations) {
        for at in places {
            let is_both = |cell: &str| !cell.contains(',') && ungrouped(cell, '.').is_some();
            if let Some((line, cell)) = self.column(*at).find(|(_, cell)| is_both(cell)) {
                self.ambiguous((*at, line), &format!("{cell:?} in a table with decimal commas"), '.', r);
            }
        }
    }

    fn ambiguous(&self, (at, line): (usize, u64), found: &str, sign: char, r: &mut SceneViolations) {
        let name = self.names.get(at).unwrap_or_default();
        let message = format!(
            "is {found}: `{sign}` may separate thousands or decimals; write numbers without separators of thousands, and \
             decimals with a point (1234 or 1.234)"
        );
        r.add(format!("line {line}, column {} ({name})", at + 1), message);
    }
}

/// The indices of these columns, for all objects.
fn indices(map: &ColumnMap, columns: &[CsvColumn]) -> Vec<usize> {
    let of = |places: &ColumnPlaces| -> Vec<usize> {
        columns.iter().filter_map(|column| places.get(column)).map(|(at, _)| *at).collect()
    };
    let own = map.objects.iter().flat_map(|(_, places)| of(places));
    let all: BTreeSet<usize> = of(&map.shared).into_iter().chain(own).collect();
    all.into_iter().collect()
}
