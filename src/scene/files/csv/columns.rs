//! Which column of a table holds what, of which object, and in which unit.

use crate::scene::files::csv::dialect::TableHeader;
use crate::scene::files::csv::names::{
    ColumnName, CsvColumn, checked_names, column_name, measures_images, stem, unit_of, usual_name,
};
use crate::scene::files::csv::notes::Notes;
use crate::scene::files::csv::vocabulary::{ANGLES, LENGTHS, MASSES, PIXELS, TIMES, size_of};
use crate::scene::spelling::misspelt;
use crate::scene::violations::SceneViolations;
use std::collections::BTreeMap;

/// Size of a pixel (m) where a tracker's table does not state it: a usual one of a table from above.
pub(super) const ASSUMED_PIXEL: f64 = 1e-3;

/// The columns of a row: for each its index, and the size of its unit in SI units.
pub(super) type ColumnPlaces = BTreeMap<CsvColumn, (usize, f64)>;

/// The columns of a table.
#[derive(Default)]
pub(super) struct ColumnMap {
    /// Those of all objects.
    pub shared: ColumnPlaces,
    /// In a table with columns for each object: its name and its own columns.
    pub objects: Vec<(String, ColumnPlaces)>,
    /// Columns with another name than in our own files, in words.
    pub renamed: Vec<String>,
}

/// A column that may be used.
struct NamedColumn {
    index: usize,
    name: ColumnName,
}

/// Finds the columns. Unknown ones, such as a speed, are ignored; misspelt ones are reported. `beyond_metres`: positions are
/// too large for metres.
pub(super) fn columns(
    header: &TableHeader,
    notes: &Notes,
    beyond_metres: bool,
    r: &mut SceneViolations,
) -> ColumnMap {
    let stems: Vec<String> = header.names.iter().map(stem).collect();
    let of_image = measures_images(&stems);
    let names_pixels =
        header.names.iter().any(|name| unit_of(name).is_some_and(|unit| PIXELS.contains(&unit.as_str())));
    // What a tracker finds in images has pixels for lengths.
    let in_pixels =
        (of_image || names_pixels || beyond_metres) && notes.scale.is_none() && notes.unit.is_none();
    let unit = Some("px".to_string()).filter(|_| beyond_metres);
    let scaled = Notes { scale: Some(ASSUMED_PIXEL), unit, ..notes.clone() };
    let notes = if in_pixels { &scaled } else { notes };
    let mut found = vec![];
    for (index, header) in header.names.iter().enumerate() {
        match column_name(header) {
            Some(name) if of_image && matches!(name.column, CsvColumn::Mass | CsvColumn::Size) => {}
            Some(name) => found.push(NamedColumn { index, name }),
            None => {
                if let Some(near) = stems.get(index).and_then(|stem| misspelt(stem, checked_names())) {
                    let message = format!("is not a known column; did you mean {near}? rename it");
                    r.add(format!("header, column {} ({header})", index + 1), message);
                }
            }
        }
    }
    let mut map = ColumnMap::default();
    let owners = &header.owners;
    let plain = |column| found.iter().filter(move |c| c.name.column == column && c.name.object.is_none());
    let names_ids = plain(CsvColumn::Id).next().is_some();
    let twice = |column| {
        let best = plain(column).map(|c| c.name.rank).min();
        plain(column).filter(|c| Some(c.name.rank) == best).count() > 1
    };
    let is_repeated = twice(CsvColumn::X) && twice(CsvColumn::Y) && !names_ids;
    let is_plain = plain(CsvColumn::X).next().is_some() && plain(CsvColumn::Y).next().is_some();
    if is_repeated {
        map.objects = repeated(&found, owners, (header, notes), r);
    } else if is_plain {
        let x = plain(CsvColumn::X).next().map_or(0, |c| c.index);
        let owner = owners.get(x).cloned().flatten().filter(|_| !names_ids);
        map.objects = owner.map(|name| (name, ColumnPlaces::new())).into_iter().collect();
    } else {
        map.objects = by_name(&found, (header, notes), r);
    }
    let is_shared = |c: &&NamedColumn| match c.name.column {
        CsvColumn::X | CsvColumn::Y | CsvColumn::Yaw | CsvColumn::Likelihood | CsvColumn::Time
            if is_repeated =>
        {
            false
        }
        _ => c.name.object.is_none(),
    };
    share(&mut map, found.iter().filter(is_shared), (header, notes), r);
    if in_pixels {
        let pixel = 1e3 * ASSUMED_PIXEL;
        map.renamed.push(match of_image || names_pixels {
            true => format!(
                "pixels, taken as {pixel} mm each, so that lengths and forces are relative (`# scale: 0.002` gives m per pixel)"
            ),
            false => format!(
                "no unit, and numbers too large for metres, taken as pixels of {pixel} mm or as mm (`# scale: 0.002` gives m per pixel, `# unit: cm` a unit)"
            ),
        });
    }
    map
}

/// The columns of all objects; of two that hold the same, the one with the more usual name.
fn share<'a>(
    map: &mut ColumnMap,
    columns: impl Iterator<Item = &'a NamedColumn>,
    of: (&TableHeader, &Notes),
    r: &mut SceneViolations,
) {
    let mut ranks: BTreeMap<CsvColumn, usize> = BTreeMap::new();
    let mut chosen: BTreeMap<CsvColumn, &NamedColumn> = BTreeMap::new();
    for column in columns {
        let ColumnName { column: kind, rank, .. } = column.name;
        match ranks.get(&kind) {
            Some(known) if *known == rank => {
                let header = of.0.names.get(column.index).unwrap_or_default();
                r.add(
                    format!("header, column {} ({header})", column.index + 1),
                    "is there twice; remove one",
                );
            }
            Some(known) if *known < rank => {}
            _ => {
                ranks.insert(kind, rank);
                chosen.insert(kind, column);
            }
        }
    }
    let has_time = chosen.contains_key(&CsvColumn::Time);
    for (kind, column) in chosen {
        map.shared.insert(kind, place(column, of, r));
        let (written, usual) = (of.0.names.get(column.index).unwrap_or_default(), usual_name(kind));
        let is_used = kind != CsvColumn::Frame || !has_time;
        if is_used && !stem(written).eq_ignore_ascii_case(usual) {
            map.renamed.push(format!("column `{}` as {usual}", written.trim()));
        }
    }
}

/// Objects whose columns have the same names: an x, what follows up to the next one, and the last time before it.
fn repeated(
    found: &[NamedColumn],
    owners: &[Option<String>],
    of: (&TableHeader, &Notes),
    r: &mut SceneViolations,
) -> Vec<(String, ColumnPlaces)> {
    let mut objects: Vec<(String, ColumnPlaces)> = vec![];
    let mut time = None;
    for column in found.iter().filter(|c| c.name.object.is_none()) {
        let kind = column.name.column;
        match kind {
            CsvColumn::Time => time = Some(place(column, of, r)),
            CsvColumn::X => {
                let owner = owners.get(column.index).cloned().flatten();
                let owner = owner.filter(|name| objects.iter().all(|(known, _)| known != name));
                let name = owner.unwrap_or_else(|| objects.len().to_string());
                let own = time.map(|time| (CsvColumn::Time, time));
                objects.push((name, own.into_iter().chain([(kind, place(column, of, r))]).collect()));
            }
            CsvColumn::Y | CsvColumn::Yaw | CsvColumn::Likelihood => {
                let Some((_, places)) = objects.last_mut() else { continue };
                if let std::collections::btree_map::Entry::Vacant(free) = places.entry(kind) {
                    free.insert(place(column, of, r));
                }
            }
            _ => {}
        }
    }
    for (name, places) in objects.iter().filter(|(_, places)| !places.contains_key(&CsvColumn::Y)) {
        let at = places.get(&CsvColumn::X).map_or(0, |(index, _)| index + 1);
        r.add(
            format!("header, column {at}"),
            format!(
                "is the x of object {name}, which has no y before the next x; order the columns as x, y, x, y"
            ),
        );
    }
    objects
}

/// Objects whose names stand in the names of their columns, as in `A_x, A_y`.
fn by_name(
    found: &[NamedColumn],
    of: (&TableHeader, &Notes),
    r: &mut SceneViolations,
) -> Vec<(String, ColumnPlaces)> {
    let mut objects: Vec<(String, ColumnPlaces)> = vec![];
    for column in found {
        let Some(name) = &column.name.object else { continue };
        let at = objects.iter().position(|(known, _)| known == name).unwrap_or_else(|| {
            objects.push((name.clone(), ColumnPlaces::new()));
            objects.len() - 1
        });
        if let Some((_, places)) = objects.get_mut(at) {
            places.insert(column.name.column, place(column, of, r));
        }
    }
    let is_placed =
        |places: &ColumnPlaces| [CsvColumn::X, CsvColumn::Y].iter().all(|c| places.contains_key(c));
    objects.retain(|(_, places)| is_placed(places));
    objects
}

/// Index of a column, and the size of its unit; what is wrong with the unit is reported.
fn place(
    column: &NamedColumn,
    (header, notes): (&TableHeader, &Notes),
    r: &mut SceneViolations,
) -> (usize, f64) {
    let unit = column.name.unit.clone();
    let factor = unit_size(column.name.column, unit, notes).unwrap_or_else(|message| {
        let name = header.names.get(column.index).unwrap_or_default();
        r.add(format!("header, column {} ({name})", column.index + 1), message);
        1.0
    });
    (column.index, factor)
}

/// Size of a column's unit in SI units, or what is wrong with the unit.
fn unit_size(column: CsvColumn, unit: Option<String>, notes: &Notes) -> Result<f64, String> {
    let units: &[(&str, f64)] = match column {
        CsvColumn::X | CsvColumn::Y | CsvColumn::Size => &LENGTHS,
        CsvColumn::Time => &TIMES,
        CsvColumn::Yaw => &ANGLES,
        CsvColumn::Mass => &MASSES,
        _ => return Ok(1.0),
    };
    let is_length = units == LENGTHS;
    let unit = unit.or_else(|| notes.unit.clone().filter(|_| is_length));
    // A scale says that positions are in pixels.
    let is_scaled = notes.scale.is_some() && matches!(column, CsvColumn::X | CsvColumn::Y);
    let Some(unit) = unit.or_else(|| PIXELS.first().filter(|_| is_scaled).map(|unit| unit.to_string()))
    else {
        return Ok(1.0);
    };
    let size = if is_length { notes.metres(&unit) } else { size_of(units, &unit) };
    size.ok_or_else(|| match is_length && PIXELS.contains(&unit.as_str()) {
        true => "is in pixels; give the scale in a line `# scale: 0.002` (m per pixel)".to_string(),
        false => {
            let known: Vec<&str> = units.iter().map(|u| u.0).collect();
            format!("has the unit {unit:?}; known: {}", known.join(", "))
        }
    })
}
