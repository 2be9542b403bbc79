//! Arrays of NumPy: a structured array or one with two axes (.npy), or arrays of one length in an archive (.npz), as TRex
//! writes them.

use super::TableText;
use crate::scene::files::archive::{entries, is_archive};
use crate::scene::violations::SceneError;

/// Begin of a file with an array.
const MAGIC: &[u8] = b"\x93NUMPY";
/// Most numbers of an array.
const MAX_NUMBERS: usize = 50_000_000;

/// An array: names of its fields (none: a plain array), its axes, and its numbers.
struct NumpyArray {
    fields: Vec<String>,
    axes: Vec<usize>,
    numbers: Vec<f64>,
}

/// The kind of a number: letter, size in bytes, and whether its first byte is the highest.
type NumberKind = (char, usize, bool);

/// The table of arrays of NumPy; `None`: it is none, or of another kind.
pub(super) fn table(bytes: &[u8]) -> Option<Result<TableText, SceneError>> {
    if bytes.starts_with(MAGIC) {
        let array = array(bytes)?;
        return Some(of_array(&array));
    }
    if !is_archive(bytes) {
        return None;
    }
    let mut columns: Vec<(String, Vec<f64>)> = vec![];
    for entry in entries(bytes) {
        let name = std::str::from_utf8(entry.name).ok().and_then(|name| name.strip_suffix(".npy"));
        let (Some(name), Some(content)) = (name, entry.content(bytes)) else { continue };
        let found = array(&content).filter(|array| array.axes.len() == 1 && array.fields.is_empty());
        columns.extend(found.map(|array| (name.to_string(), array.numbers)));
    }
    // The positions give the length; single values and other series are left out.
    let length =
        |axis: &str| columns.iter().find(|(name, _)| stem(name) == axis).map(|(_, numbers)| numbers.len());
    let rows = length("x").filter(|rows| Some(*rows) == length("y"))?;
    columns.retain(|(_, numbers)| numbers.len() == rows);
    let names: Vec<String> = columns.iter().map(|(name, _)| name.replace(',', " ")).collect();
    let mut text = names.join(",") + "\n";
    for row in 0..rows {
        let cells: Vec<String> = columns.iter().map(|(_, numbers)| cell(numbers.get(row).copied())).collect();
        text += &(cells.join(",") + "\n");
    }
    Some(Ok(TableText { text, taken: vec![format!("arrays of NumPy with {}", names.join(", "))] }))
}

/// The axis that a name begins with, as `X#wcentroid` does.
fn stem(name: &str) -> String {
    name.split(['#', ' ', '_']).next().unwrap_or_default().to_lowercase()
}

/// A number as text; what is not finite is an empty cell.
fn cell(number: Option<f64>) -> String {
    number.filter(|number| number.is_finite()).map(|number| number.to_string()).unwrap_or_default()
}

fn of_array(array: &NumpyArray) -> Result<TableText, SceneError> {
    let width = match (array.fields.len(), array.axes.as_slice()) {
        (0, [_, width]) => *width,
        (0, axes) => {
            let message = format!(
                "is a NumPy array with {} axes, whose columns are not known; write CSV: `numpy.savetxt(\"tracks.csv\", array, \
                 delimiter=\",\", header=\"id,frame,x,y\", comments=\"\")`",
                axes.len()
            );
            return Err(SceneError::single("(file)", message));
        }
        (fields, _) => fields,
    };
    let mut text = String::new();
    if !array.fields.is_empty() {
        text += &(array.fields.join(",") + "\n");
    }
    for row in array.numbers.chunks(width.max(1)) {
        let cells: Vec<String> = row.iter().map(|number| cell(Some(*number))).collect();
        text += &(cells.join(",") + "\n");
    }
    let fields = if array.fields.is_empty() { format!("{width} columns") } else { array.fields.join(", ") };
    Ok(TableText { text, taken: vec![format!("an array of NumPy with {fields}")] })
}

/// The array in these bytes.
fn array(bytes: &[u8]) -> Option<NumpyArray> {
    let version = *bytes.get(6)?;
    let (size, start): (usize, usize) = match version {
        1 => (usize::from(u16::from_le_bytes(bytes.get(8..10)?.try_into().ok()?)), 10),
        _ => (u32::from_le_bytes(bytes.get(8..12)?.try_into().ok()?) as usize, 12),
    };
    let header = std::str::from_utf8(bytes.get(start..start.checked_add(size)?)?).ok()?;
    if header.contains("'fortran_order': True") {
        return None;
    }
    let shape = header.split_once("'shape':")?.1;
    let shape = shape.split_once('(')?.1.split_once(')')?.0;
    let axes: Vec<usize> = shape
        .split(',')
        .map(str::trim)
        .filter(|axis| !axis.is_empty())
        .map(|axis| axis.parse().ok())
        .collect::<Option<_>>()?;
    let descr = header.split_once("'descr':")?.1.trim_start();
    let (fields, kinds) =
        if descr.starts_with('[') { fields(descr)? } else { (vec![], vec![kind(quoted(descr)?)?]) };
    let count = axes.iter().try_fold(kinds.len(), |product, axis| product.checked_mul(*axis))?;
    if count > MAX_NUMBERS {
        return None;
    }
    let mut data = bytes.get(start + size..)?;
    let mut numbers = vec![];
    for kind in kinds.iter().cycle().take(count) {
        let (own, rest) = data.split_at_checked(kind.1)?;
        numbers.push(value(own, *kind)?);
        data = rest;
    }
    Some(NumpyArray { fields, axes, numbers })
}

/// The text between the next two quotes.
fn quoted(text: &str) -> Option<&str> {
    Some(text.split_once('\'')?.1.split_once('\'')?.0)
}

/// Names and kinds of the fields of a structured array.
fn fields(descr: &str) -> Option<(Vec<String>, Vec<NumberKind>)> {
    let (mut names, mut kinds) = (vec![], vec![]);
    let list = descr.split_once('[')?.1.split_once(']')?.0;
    for field in list.split('(').skip(1) {
        let (name, rest) = field.split_once(',')?;
        // A field may have axes of its own: these are of no use here.
        if rest.matches('\'').count() != 2 {
            return None;
        }
        names.push(quoted(name)?.replace(',', " "));
        kinds.push(kind(quoted(rest)?)?);
    }
    Some((names, kinds))
}

fn kind(text: &str) -> Option<NumberKind> {
    let (order, rest) = text.split_at_checked(1)?;
    let (letter, size) = rest.split_at_checked(1)?;
    let size = size.parse().ok().filter(|size| [1, 2, 4, 8].contains(size))?;
    let letter = letter.chars().next().filter(|letter| "fiub".contains(*letter))?;
    (letter != 'f' || size >= 4).then_some((letter, size, order == ">"))
}

fn value(bytes: &[u8], (letter, size, is_big): NumberKind) -> Option<f64> {
    let mut low = [0u8; 8];
    for (place, byte) in low.iter_mut().enumerate().take(size) {
        let at = if is_big { size - 1 - place } else { place };
        *byte = *bytes.get(at)?;
    }
    let raw = u64::from_le_bytes(low);
    Some(match (letter, size) {
        ('f', 4) => f64::from(f32::from_bits(raw as u32)),
        ('f', _) => f64::from_bits(raw),
        ('i', 1) => f64::from(raw as u8 as i8),
        ('i', 2) => f64::from(raw as u16 as i16),
        ('i', 4) => f64::from(raw as u32 as i32),
        ('i', _) => raw as i64 as f64,
        _ => raw as f64,
    })
}
