//! Connected pixels of a mask.

/// Pixels that are connected by their sides.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PixelRegion {
    /// Indices of its pixels, row by row.
    pub pixels: Vec<usize>,
    /// First column, first row, and the column and row after the last.
    pub bounds: [usize; 4],
}

/// The region of all these pixels of an image so wide; `None`: there are none.
pub(super) fn region(mut pixels: Vec<usize>, width: usize) -> Option<PixelRegion> {
    pixels.sort_unstable();
    let (first, last) = (pixels.first()? / width, pixels.last()? / width);
    let columns = pixels.iter().map(|p| p % width);
    let (left, right) = columns.fold((width, 0), |(low, high), c| (low.min(c), high.max(c)));
    Some(PixelRegion { pixels, bounds: [left, first, right + 1, last + 1] })
}

/// The connected regions of a mask so wide, by their first pixels.
pub(super) fn connected(mask: &[bool], width: usize) -> Vec<PixelRegion> {
    let mut open = mask.to_vec();
    let mut found = vec![];
    for start in 0..open.len() {
        if !std::mem::take(&mut open[start]) {
            continue;
        }
        let mut pixels = vec![start];
        let mut next = 0;
        while let Some(&at) = pixels.get(next) {
            next += 1;
            let column = at % width;
            let neighbours = [
                (column > 0).then(|| at - 1),
                (column + 1 < width).then_some(at + 1),
                at.checked_sub(width),
                Some(at + width),
            ];
            for neighbour in neighbours.into_iter().flatten() {
                if open.get_mut(neighbour).is_some_and(std::mem::take) {
                    pixels.push(neighbour);
                }
            }
        }
        found.extend(region(pixels, width));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_touch_by_sides_and_not_around_the_edge() {
        let mask: Vec<bool> = "##..#.#..##...#.#..#".chars().map(|c| c == '#').collect();
        let found = connected(&mask, 5);
        let bounds: Vec<[usize; 4]> = found.iter().map(|r| r.bounds).collect();
        assert_eq!(bounds, [[0, 0, 2, 2], [4, 0, 5, 4], [0, 2, 1, 3], [1, 3, 2, 4]]);
        assert_eq!(found[1].pixels, [4, 9, 14, 19]);
        assert_eq!(region(vec![7, 3], 5).unwrap().bounds, [2, 0, 4, 2]);
        assert!(connected(&[], 5).is_empty() && region(vec![], 5).is_none());
    }
}
