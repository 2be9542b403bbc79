//! Three coordinates: the two with the widest motion are the plane.

use crate::scene::files::csv::names::{CsvColumn, column_name};
use ::csv::StringRecord;

/// A coordinate is left out for another one whose range is so many times wider.
const WIDER: f64 = 2.0;
/// Names of a column that is left out: not known, so that it is not read.
const UNUSED: &str = "height";

/// The name with one letter for another, if that makes it the name of an x.
fn with_letter(name: &str, from: char, to: &str) -> Option<String> {
    let places = name.char_indices().filter(|(_, c)| c.eq_ignore_ascii_case(&from));
    let replaced = |(at, c): (usize, char)| {
        let to = if c.is_ascii_uppercase() { to.to_uppercase() } else { to.to_string() };
        let (before, rest) = name.split_at_checked(at)?;
        Some(format!("{before}{to}{}", rest.get(c.len_utf8()..)?))
    };
    let is_x = |name: &String| column_name(name).is_some_and(|found| found.column == CsvColumn::X);
    places.filter_map(replaced).find(is_x)
}

/// The index of each z column, and its name as a y.
fn heights(names: &StringRecord) -> Vec<(usize, String)> {
    let as_y = |(at, name): (usize, &str)| {
        let as_x = column_name(&with_letter(name, 'z', "x")?)?;
        let is_beside =
            |other| column_name(other).is_some_and(|c| c.column == CsvColumn::X && c.object == as_x.object);
        names.iter().find(|other| is_beside(*other))?;
        let places = name.char_indices().filter(|(_, c)| c.eq_ignore_ascii_case(&'z'));
        let renamed = places.filter_map(|(z, c)| {
            let to = if c == 'Z' { "Y" } else { "y" };
            Some(format!("{}{to}{}", name.get(..z)?, name.get(z + 1..)?))
        });
        let is_y = |name: &String| column_name(name).is_some_and(|found| found.column == CsvColumn::Y);
        Some((at, renamed.into_iter().find(is_y)?))
    };
    names.iter().enumerate().filter_map(as_y).collect()
}

/// Names of columns in which z stands for y where it moves more, and what was taken; `None`: there is no z.
pub(crate) fn plane(names: &StringRecord, spread: impl Fn(usize) -> f64) -> Option<(StringRecord, String)> {
    let heights = heights(names);
    let of = |column| {
        names
            .iter()
            .enumerate()
            .filter_map(move |(at, name)| (column_name(name)?.column == column).then_some(at))
    };
    if heights.is_empty() || of(CsvColumn::X).next().is_none() || of(CsvColumn::Y).next().is_none() {
        return None;
    }
    let widest = |places: &mut dyn Iterator<Item = usize>| places.map(&spread).fold(0.0, f64::max);
    let [x, y] = [CsvColumn::X, CsvColumn::Y].map(|column| widest(&mut of(column)));
    let z = widest(&mut heights.iter().map(|(at, _)| *at));
    if z <= WIDER * y || x <= y && z <= WIDER * x {
        let words = "x and y of three coordinates; z is left out (rename the columns to take others)";
        return (z > 0.0).then(|| (names.clone(), words.to_string()));
    }
    let renamed = |(at, name): (usize, &str)| match heights.iter().find(|(of, _)| *of == at) {
        Some((_, as_y)) => as_y.clone(),
        None if column_name(name).is_some_and(|found| found.column == CsvColumn::Y) => UNUSED.to_string(),
        None => name.to_string(),
    };
    let names = names.iter().enumerate().map(renamed).collect::<Vec<String>>();
    let words = "x and z of three coordinates, which move most, as x and y; y is left out (rename the columns to take others)";
    Some((StringRecord::from(names), words.to_string()))
}
