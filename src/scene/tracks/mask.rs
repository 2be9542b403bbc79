//! Masks as COCO's run lengths (column by column, background first), and boxes around them.

/// Most pixels of a mask: more than any camera has.
const MAX_PIXELS: u64 = 1 << 28;
/// Largest part of a box outside the image, as a share of the image's size: detectors round, and estimate the hidden part.
const MAX_OVERHANG: f64 = 0.1;

/// A box in the image (px); pixel column k reaches from k to k + 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundingBox {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
}

/// What is wrong with a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MaskError {
    #[error("size is {height} x {width}; give height and width of the image in pixels, both at least 1")]
    Size { height: u64, width: u64 },
    #[error(
        "counts has a character at position {at} that no compressed run length has; give COCO's text unchanged"
    )]
    Character { at: usize },
    #[error("counts ends within a number; give COCO's text unchanged")]
    Cut,
    #[error("counts[{index}] is {run}; give a run length from 0 to the number of pixels")]
    Run { index: usize, run: i64 },
    #[error("counts add up to {sum} pixels, but the mask has {expected}; correct counts or size")]
    Total { sum: u64, expected: u64 },
    #[error("is empty; leave out the detection")]
    Empty,
}

/// Run lengths (px) of COCO's compressed text. Each character minus 48 holds five bits of a number, lowest bits first; bit 5 is set
/// if another character follows, and bit 4 of the last character is the sign. From the fourth number on, the difference to the
/// number two before is stored. Source: `rleToString` and `rleFrString` of COCO's `maskApi.c`.
pub fn decompress(text: &str) -> Result<Vec<i64>, MaskError> {
    let mut counts: Vec<i64> = vec![];
    let (mut value, mut shift) = (0i64, 0u32);
    for (at, byte) in text.bytes().enumerate() {
        let digit = i64::from(byte) - 48;
        if !(0..64).contains(&digit) || shift > 50 {
            return Err(MaskError::Character { at });
        }
        value |= (digit & 0x1f) << shift;
        shift += 5;
        if digit & 0x20 != 0 {
            continue;
        }
        if digit & 0x10 != 0 {
            value |= -1 << shift;
        }
        if counts.len() > 2 {
            value = value.saturating_add(counts[counts.len() - 2]);
        }
        counts.push(value);
        (value, shift) = (0, 0);
    }
    if shift == 0 { Ok(counts) } else { Err(MaskError::Cut) }
}

/// The box around a mask of this height and width (px) and these runs (px).
pub fn bounds([height, width]: [u64; 2], counts: &[i64]) -> Result<BoundingBox, MaskError> {
    let expected = height.saturating_mul(width);
    if expected == 0 || expected > MAX_PIXELS {
        return Err(MaskError::Size { height, width });
    }
    let mut at = 0u64;
    let (mut rows, mut columns) = ([u64::MAX, 0], [u64::MAX, 0]);
    for (index, &run) in counts.iter().enumerate() {
        let Some(length) = u64::try_from(run).ok().filter(|&r| r <= expected) else {
            return Err(MaskError::Run { index, run });
        };
        if index % 2 == 1 && length > 0 {
            let last = at + length - 1;
            let (first, end) = (at / height, last / height);
            // A run that continues in the next column touches the bottom of one column and the top of the next.
            let (top, bottom) = if first == end { (at % height, last % height) } else { (0, height - 1) };
            rows = [rows[0].min(top), rows[1].max(bottom)];
            columns = [columns[0].min(first), columns[1].max(end)];
        }
        at += length;
        if at > expected {
            break;
        }
    }
    if at != expected {
        return Err(MaskError::Total { sum: at, expected });
    }
    if columns[0] > columns[1] {
        return Err(MaskError::Empty);
    }
    let [left, top] = [columns[0], rows[0]].map(|k| k as f64);
    let [right, bottom] = [columns[1], rows[1]].map(|k| k as f64 + 1.0);
    Ok(BoundingBox { left, top, right, bottom })
}

impl BoundingBox {
    pub fn centre(&self) -> [f64; 2] {
        [0.5 * (self.left + self.right), 0.5 * (self.top + self.bottom)]
    }

    /// What is wrong with it in an image of this width and height (px).
    pub fn check(&self, [width, height]: [f64; 2]) -> Result<(), String> {
        let [left, top, right, bottom] = self.edges();
        if !self.edges().iter().all(|v| v.is_finite()) {
            return Err("is not finite; give pixels".into());
        }
        if left >= right || top >= bottom {
            return Err(format!(
                "is {} x {} px; give a width and a height above 0",
                right - left,
                bottom - top
            ));
        }
        let out = |low: f64, high: f64, size: f64| {
            low < -MAX_OVERHANG * size || high > (1.0 + MAX_OVERHANG) * size || low >= size || high <= 0.0
        };
        if out(left, right, width) || out(top, bottom, height) {
            return Err(format!(
                "from ({left}, {top}) to ({right}, {bottom}) lies outside the image of {width} x {height} px; give \
                 pixels of this image: left, top, width and height"
            ));
        }
        Ok(())
    }

    /// Left, top, right, bottom.
    pub fn edges(&self) -> [f64; 4] {
        [self.left, self.top, self.right, self.bottom]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The inverse of [`decompress`], as COCO's own code writes it.
    fn compress(counts: &[i64]) -> String {
        let mut text = String::new();
        for (i, &count) in counts.iter().enumerate() {
            let mut x = if i > 2 { count - counts[i - 2] } else { count };
            loop {
                let digit = x & 0x1f;
                x >>= 5;
                let more = if digit & 0x10 != 0 { x != -1 } else { x != 0 };
                text.push(char::from((digit + if more { 0x20 } else { 0 } + 48) as u8));
                if !more {
                    break;
                }
            }
        }
        text
    }

    proptest! {
        #[test]
        fn bounds_are_those_of_the_pixels(h in 1..9u64, w in 1..9u64, bits in any::<u64>(), other in any::<u64>()) {
            let pixels: Vec<bool> = (0..h * w).map(|k| (bits & other) >> (k % 64) & 1 == 1).collect();
            let mut counts = vec![0];
            let mut now = false;
            for &p in &pixels {
                if p != now {
                    counts.push(0);
                    now = p;
                }
                *counts.last_mut().unwrap() += 1;
            }
            let on: Vec<(u64, u64)> =
                (0..h * w).filter(|&k| pixels[k as usize]).map(|k| (k % h, k / h)).collect();
            let read = decompress(&compress(&counts)).unwrap();
            prop_assert_eq!(&read, &counts);
            match bounds([h, w], &read) {
                Err(error) => prop_assert!(on.is_empty() && error == MaskError::Empty),
                Ok(found) => {
                    let least = |f: fn(&(u64, u64)) -> u64| on.iter().map(f).min().unwrap() as f64;
                    let most = |f: fn(&(u64, u64)) -> u64| on.iter().map(f).max().unwrap() as f64 + 1.0;
                    prop_assert_eq!(found.edges(), [least(|p| p.1), least(|p| p.0), most(|p| p.1), most(|p| p.0)]);
                }
            }
        }

        #[test]
        fn any_text_is_read_or_refused(text in "[ -~]{0,40}", h in 0..400u64, w in 0..600u64) {
            if let Ok(counts) = decompress(&text) {
                let _ = bounds([h, w], &counts);
            }
        }
    }

    #[test]
    fn broken_runs_are_named() {
        assert_eq!(decompress("5\u{7f}"), Err(MaskError::Character { at: 1 }));
        assert_eq!(decompress("5P"), Err(MaskError::Cut));
        assert_eq!(bounds([2, 2], &[1, -2, 5]), Err(MaskError::Run { index: 1, run: -2 }));
        assert_eq!(bounds([2, 2], &[1, 2]), Err(MaskError::Total { sum: 3, expected: 4 }));
        assert_eq!(bounds([2, 2], &[4]), Err(MaskError::Empty));
        assert_eq!(bounds([0, 2], &[]), Err(MaskError::Size { height: 0, width: 2 }));
    }
}
