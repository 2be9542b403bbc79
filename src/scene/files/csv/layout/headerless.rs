//! Tables without a header: their numbers can only mean one thing, or a header is asked for.

use std::collections::BTreeSet;

/// Lines that are looked at.
const MOST_ROWS: usize = 20_000;
/// Fewer rows prove nothing.
const FEWEST_ROWS: usize = 3;
/// Columns of a file of the MOT challenge: frame, id, left, top, width, height, and one to four others.
const BOX_COLUMNS: std::ops::RangeInclusive<usize> = 7..=10;
/// Boxes are larger (px).
const LEAST_BOX: f64 = 1.0;

/// Names for the columns of these rows; an empty name: a column of no use. Or why a header is needed.
pub(crate) fn guessed(rows: impl Iterator<Item = Vec<Option<f64>>>) -> Result<Vec<&'static str>, String> {
    let rows: Vec<Vec<Option<f64>>> = rows.take(MOST_ROWS).collect();
    let width = rows.first().map_or(0, Vec::len);
    let needs = |why: &str| Err(format!("is missing, and {why}"));
    if rows.len() < FEWEST_ROWS || rows.iter().rev().skip(1).any(|row| row.len() != width) {
        return needs("its lines do not tell what they hold");
    }
    let column =
        |at: usize| -> Vec<f64> { rows.iter().filter_map(|row| row.get(at).copied().flatten()).collect() };
    let (first, second) = (column(0), column(1));
    match width {
        2 if is_even(&first) => {
            needs("its two columns are a time and one coordinate; two are needed, x and y")
        }
        2 if is_even(&second) => {
            needs("its two columns are one coordinate and a time; two are needed, x and y")
        }
        3 if is_even(&first) && (is_clock(&first) || !is_even(&second) && !is_even(&column(2))) => {
            let is_count = first.iter().all(|v| v.fract() == 0.0);
            Ok(vec![if is_count { "frame" } else { "t" }, "x", "y"])
        }
        4 if names_each_once(&first, &second) && !names_each_once(&second, &first) => {
            Ok(vec!["frame", "id", "x", "y"])
        }
        4 if names_each_once(&second, &first) && !names_each_once(&first, &second) => {
            Ok(vec!["id", "frame", "x", "y"])
        }
        _ if BOX_COLUMNS.contains(&width) && is_boxes(&column(4), &column(5), rows.len()) => {
            if second.iter().all(|id| *id < 0.0) {
                return needs(
                    "its boxes have no ids (-1): they are detections; link them into tracks first, or write them as JSON for `vrdp import`",
                );
            }
            match is_whole(&first) && is_whole(&second) && distinct(&first, &second) {
                true => Ok(["frame", "id", "left", "top", "width", "height"]
                    .into_iter()
                    .chain(std::iter::repeat(""))
                    .take(width)
                    .collect()),
                false => needs("its lines do not tell what they hold"),
            }
        }
        _ => needs(&format!("its {width} columns may hold several things")),
    }
}

/// Whether values increase by nearly equal steps: a time, or the number of a frame.
fn is_even(values: &[f64]) -> bool {
    let mut steps: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let least = steps.iter().copied().fold(f64::INFINITY, f64::min);
    let middle = crate::num::quantile(&mut steps, 0.5).unwrap_or(0.0);
    let usual = steps.iter().filter(|step| (**step - middle).abs() <= 0.1 * middle).count();
    least > 0.0 && 10 * usual >= 9 * steps.len()
}

/// Whether evenly spaced values count from 0, or count by one: no coordinate does.
fn is_clock(values: &[f64]) -> bool {
    values.first() == Some(&0.0) || is_whole(values) && values.windows(2).all(|pair| pair[1] - pair[0] == 1.0)
}

fn is_whole(values: &[f64]) -> bool {
    values.iter().all(|v| v.fract() == 0.0 && *v >= 0.0)
}

/// Whether no pair is there twice.
fn distinct(a: &[f64], b: &[f64]) -> bool {
    let pairs: BTreeSet<(u64, u64)> = a.iter().zip(b).map(|(a, b)| (a.to_bits(), b.to_bits())).collect();
    pairs.len() == a.len() && a.len() == b.len()
}

/// Whether the first column counts frames, and the second names one of a few objects in each.
fn names_each_once(frames: &[f64], ids: &[f64]) -> bool {
    let different = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<BTreeSet<u64>>().len();
    let rows = frames.len();
    is_whole(frames)
        && is_whole(ids)
        && distinct(frames, ids)
        && 2 * different(ids) <= rows
        && different(frames) > different(ids)
}

/// Whether two columns are the widths and heights of boxes.
fn is_boxes(width: &[f64], height: &[f64], rows: usize) -> bool {
    width.len() + 1 >= rows && height.len() + 1 >= rows && width.iter().chain(height).all(|v| *v > LEAST_BOX)
}
