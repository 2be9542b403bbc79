//! Boxes in place of positions: the middle of a box is the position.

use crate::scene::files::csv::cell_values::number;
use crate::scene::files::csv::names::unit_of;
use ::csv::StringRecord;

/// Names of the edges of a box: words of lower case, joined by `_`.
const LEFT: [&str; 14] = [
    "left",
    "bb_left",
    "bbox_left",
    "box_left",
    "bbox_x",
    "bbox_x1",
    "box_x",
    "xmin",
    "x_min",
    "xtl",
    "bbox_xmin",
    "x_left",
    "bx",
    "tl_x",
];
const TOP: [&str; 14] = [
    "top",
    "bb_top",
    "bbox_top",
    "box_top",
    "bbox_y",
    "bbox_y1",
    "box_y",
    "ymin",
    "y_min",
    "ytl",
    "bbox_ymin",
    "y_top",
    "by",
    "tl_y",
];
const RIGHT: [&str; 8] = ["right", "bb_right", "bbox_right", "bbox_x2", "xmax", "x_max", "xbr", "bbox_xmax"];
const BOTTOM: [&str; 8] =
    ["bottom", "bb_bottom", "bbox_bottom", "bbox_y2", "ymax", "y_max", "ybr", "bbox_ymax"];
const WIDTH: [&str; 7] = ["w", "width", "bb_width", "bbox_width", "box_width", "bbox_w", "bw"];
const HEIGHT: [&str; 7] = ["h", "height", "bb_height", "bbox_height", "box_height", "bbox_h", "bh"];

/// Columns of boxes: those of the left and upper edge, and of the right and lower one, or of width and height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BoxColumns {
    low: [usize; 2],
    high: [usize; 2],
    is_size: bool,
}

/// The boxes that a table with these names has; `has_ids`: an object has an id, so that `x1, y1, x2, y2` are corners.
pub(crate) fn box_columns(stems: &[String], has_ids: bool) -> Option<BoxColumns> {
    let find = |names: &[&str]| stems.iter().position(|stem| names.contains(&stem.as_str()));
    let pair = |x: &[&str], y: &[&str]| Some([find(x)?, find(y)?]);
    let corners = || Some((pair(&["x1"], &["y1"])?, pair(&["x2"], &["y2"])?));
    let has_others = || find(&["x3"]).is_some() || find(&["x0"]).is_some();
    let low = pair(&LEFT, &TOP);
    let (low, high, is_size) = match (low, pair(&RIGHT, &BOTTOM), pair(&WIDTH, &HEIGHT)) {
        (Some(low), Some(high), _) => (low, high, false),
        (Some(low), None, Some(size)) => (low, size, true),
        _ => match corners().filter(|_| has_ids && !has_others()) {
            Some((low, high)) => (low, high, false),
            // As OpenCV and COCO have it: x and y are those of a corner.
            None => (pair(&["x"], &["y"])?, pair(&WIDTH, &HEIGHT)?, true),
        },
    };
    Some(BoxColumns { low, high, is_size })
}

impl BoxColumns {
    /// The header with the names of the middle, in place of those of the edges.
    pub fn renamed(&self, names: &StringRecord) -> StringRecord {
        let unit = self.low.map(|at| names.get(at).and_then(unit_of));
        let is_edge = |at: usize| self.low.contains(&at) || self.high.contains(&at);
        let edge = |(at, name)| if is_edge(at) { "edge" } else { name };
        let mut renamed: StringRecord = names.iter().enumerate().map(edge).collect();
        for (axis, unit) in ["x", "y"].into_iter().zip(unit) {
            renamed.push_field(&unit.map_or(axis.to_string(), |unit| format!("{axis} [{unit}]")));
        }
        renamed
    }

    /// The record with the middle of its box, behind the cells of the header's columns.
    pub fn with_middle(&self, record: &StringRecord, columns: usize, decimal_commas: bool) -> StringRecord {
        let mut longer: StringRecord = record.iter().chain(std::iter::repeat("")).take(columns).collect();
        for (low, high) in self.low.into_iter().zip(self.high) {
            let text = |at: usize| record.get(at).unwrap_or_default();
            let middle = || {
                let (low, high) = (number(text(low), decimal_commas)?, number(text(high), decimal_commas)?);
                Some(if self.is_size { low + 0.5 * high } else { 0.5 * (low + high) })
            };
            let sign = if decimal_commas { "," } else { "." };
            let middle = middle().map(|middle| middle.to_string().replace('.', sign));
            // What is no number is reported with the cell's own text.
            longer.push_field(middle.as_deref().unwrap_or(text(low)));
        }
        longer
    }

    /// What was taken, in words.
    pub fn in_words(&self, names: &StringRecord) -> String {
        let [x, y] = self.low.map(|at| names.get(at).unwrap_or_default().trim());
        let [w, h] = self.high.map(|at| names.get(at).unwrap_or_default().trim());
        format!(
            "the middle of boxes `{x}, {y}, {w}, {h}` as position (name a centre `x, y` and delete the others)"
        )
    }
}
