//! Which bodies can come near each other in a step: a grid over the boxes of their paths.

use crate::num::{Vec2, vec2};

/// Up to this number of bodies, testing every pair costs less than the grid.
const MAX_WITHOUT_GRID: usize = 24;

/// Bodies by the cells that their boxes cover. Boxes outside the grid count to its outermost cells.
#[derive(Default)]
pub(in crate::world) struct Grid {
    low: Vec2,
    /// Side of a cell (m).
    side: f64,
    columns: usize,
    rows: usize,
    cells: Vec<Vec<usize>>,
    /// First and last column and row of each body; empty without a grid.
    spans: Vec<[usize; 4]>,
}

impl Grid {
    /// Builds the grid over these boxes (lower and upper corner, m), one per body.
    pub fn fill(&mut self, boxes: impl Iterator<Item = (Vec2, Vec2)> + Clone) {
        let count = boxes.clone().count();
        self.spans.clear();
        if count <= MAX_WITHOUT_GRID {
            return;
        }
        let (mut low, mut high) = boxes.clone().next().unwrap_or_default();
        let mut extent = 0.0;
        for (a, b) in boxes.clone() {
            low = vec2(low.x.min(a.x), low.y.min(a.y));
            high = vec2(high.x.max(b.x), high.y.max(b.y));
            extent += (b.x - a.x).max(b.y - a.y) / count as f64;
        }
        let (width, height) = (high.x - low.x, high.y - low.y);
        // A body covers a few cells, and the number of cells is of the order of the number of bodies.
        self.side = extent.max((width * height / count as f64).sqrt()).max(width.max(height) / count as f64);
        self.low = low;
        let cells = |length: f64| (length / self.side) as usize + 1;
        (self.columns, self.rows) = (cells(width), cells(height));
        self.cells.iter_mut().for_each(Vec::clear);
        self.cells.resize(self.columns * self.rows, vec![]);
        for (body, (a, b)) in boxes.enumerate() {
            self.spans.push(self.span(a, b));
            for cell in self.covered(body) {
                self.cells[cell].push(body);
            }
        }
    }

    /// Replaces the box of a body.
    pub fn update(&mut self, body: usize, low: Vec2, high: Vec2) {
        let span = self.span(low, high);
        if self.spans.get(body).is_none_or(|old| *old == span) {
            return;
        }
        for cell in self.covered(body) {
            self.cells[cell].retain(|&other| other != body);
        }
        self.spans[body] = span;
        for cell in self.covered(body) {
            self.cells[cell].push(body);
        }
    }

    /// The bodies that share a cell with this one, in order; `None` without a grid: all may be near.
    pub fn near(&self, body: usize) -> Option<Vec<usize>> {
        self.spans.get(body)?;
        let mut near: Vec<usize> =
            self.covered(body).flat_map(|cell| &self.cells[cell]).copied().filter(|&j| j != body).collect();
        near.sort_unstable();
        near.dedup();
        Some(near)
    }

    fn span(&self, low: Vec2, high: Vec2) -> [usize; 4] {
        let place = |x: f64, low: f64, cells: usize| (((x - low) / self.side) as usize).min(cells.max(1) - 1);
        let column = |x| place(x, self.low.x, self.columns);
        let row = |y| place(y, self.low.y, self.rows);
        [column(low.x), column(high.x), row(low.y), row(high.y)]
    }

    fn covered(&self, body: usize) -> impl Iterator<Item = usize> + use<> {
        let ([left, right, bottom, top], columns) = (self.spans[body], self.columns);
        (bottom..=top).flat_map(move |row| (left..=right).map(move |column| row * columns + column))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn boxes_that_overlap_are_near(
            places in prop::collection::vec((-5.0..5.0f64, -5.0..5.0f64, 0.0..1.5f64), 25..60),
            moved in (0usize..25, -9.0..9.0f64, -9.0..9.0f64, 0.0..3.0f64),
        ) {
            let around = |(x, y, r): (f64, f64, f64)| (vec2(x - r, y - r), vec2(x + r, y + r));
            let mut boxes: Vec<_> = places.into_iter().map(around).collect();
            let mut grid = Grid::default();
            grid.fill(boxes.iter().copied());
            boxes[moved.0] = around((moved.1, moved.2, moved.3));
            grid.update(moved.0, boxes[moved.0].0, boxes[moved.0].1);
            for (i, a) in boxes.iter().enumerate() {
                let near = grid.near(i).expect("they are many");
                for (j, b) in boxes.iter().enumerate().filter(|(j, _)| *j != i) {
                    let overlap = a.0.x <= b.1.x && b.0.x <= a.1.x && a.0.y <= b.1.y && b.0.y <= a.1.y;
                    prop_assert!(!overlap || near.contains(&j), "{i} {j}");
                }
                prop_assert!(near.is_sorted());
            }
        }
    }
}
