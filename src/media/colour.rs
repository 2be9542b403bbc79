//! Decoded planes to RGB.
//!
//! `R' = Y' + a Cr, G' = Y' - b Cb - c Cr, B' = Y' + d Cb` with `a = 2 (1 - Kr)`, `d = 2 (1 - Kb)`, `b = d Kb / Kg`, `c = a Kr / Kg`.
//! BT.601 has Kr 0.299, Kb 0.114; BT.709 has Kr 0.2126, Kb 0.0722. Limited range maps Y' 16..235 and C 16..240 to the full one.
//! Chroma of 4:2:0 lies at even columns and midway between two rows (H.264, Annex E, chroma_sample_loc_type 0); it is
//! interpolated linearly. Sources: ITU-R BT.601-7, BT.709-6.

use super::packets::QuarterTurns;

/// Luma coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColourMatrix {
    Bt601,
    Bt709,
}

/// How the numbers of a picture are coded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ColourCoding {
    pub matrix: ColourMatrix,
    pub full_range: bool,
}

/// Planes of a 4:2:0 picture without padding: chroma has half the width and height, rounded up.
pub(super) struct Planes<'a> {
    pub width: usize,
    pub height: usize,
    pub y: &'a [u8],
    pub u: &'a [u8],
    pub v: &'a [u8],
}

/// Fixed-point factors (2^14 = 1): luma, Cr to R, Cb to G, Cr to G, Cb to B; and the black level.
fn factors(coding: ColourCoding) -> ([i32; 5], i32) {
    let (kr, kb) = match coding.matrix {
        ColourMatrix::Bt601 => (0.299, 0.114),
        ColourMatrix::Bt709 => (0.2126, 0.0722),
    };
    let kg = 1.0 - kr - kb;
    let (luma, chroma, black) =
        if coding.full_range { (1.0, 1.0, 0) } else { (255.0 / 219.0, 255.0 / 224.0, 16) };
    let (a, d) = (2.0 * (1.0 - kr), 2.0 * (1.0 - kb));
    let exact = [luma, chroma * a, chroma * d * kb / kg, chroma * a * kr / kg, chroma * d];
    (exact.map(|f| (f * 16384.0_f64).round() as i32), black)
}

/// RGB pixels, three bytes each, row by row.
pub(super) fn to_rgb(planes: &Planes, coding: ColourCoding) -> Vec<u8> {
    let (width, height) = (planes.width, planes.height);
    let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
    let ([fy, rv, gu, gv, bu], black) = factors(coding);
    let mut rgb = vec![0u8; 3 * width * height];
    // Chroma of a row times 4 and minus its zero; one more at the end, so that the last odd column has a right neighbour.
    let (mut row_u, mut row_v) = (vec![0i32; half_width + 1], vec![0i32; half_width + 1]);
    for (v, row) in rgb.chunks_exact_mut(3 * width).enumerate() {
        let near = (v / 2).min(half_height - 1);
        let far = if v % 2 == 0 { near.saturating_sub(1) } else { (near + 1).min(half_height - 1) };
        for (plane, out) in [(planes.u, &mut row_u), (planes.v, &mut row_v)] {
            let (a, b) =
                (&plane[near * half_width..][..half_width], &plane[far * half_width..][..half_width]);
            for ((o, &a), &b) in out.iter_mut().zip(a).zip(b) {
                *o = 3 * i32::from(a) + i32::from(b) - 512;
            }
            out[half_width] = out[half_width - 1];
        }
        let luma = &planes.y[v * width..][..width];
        for (k, (pair, y)) in row.chunks_mut(6).zip(luma.chunks(2)).enumerate() {
            let both = [[2 * row_u[k], 2 * row_v[k]], [row_u[k] + row_u[k + 1], row_v[k] + row_v[k + 1]]];
            for ((pixel, &y), [u, v]) in pair.chunks_exact_mut(3).zip(y).zip(both) {
                // Chroma has 3 more bits than luma.
                let y = (i32::from(y) - black) * fy + (1 << 13);
                pixel[0] = ((y + ((rv * v) >> 3)) >> 14).clamp(0, 255) as u8;
                pixel[1] = ((y - ((gu * u + gv * v) >> 3)) >> 14).clamp(0, 255) as u8;
                pixel[2] = ((y + ((bu * u) >> 3)) >> 14).clamp(0, 255) as u8;
            }
        }
    }
    rgb
}

/// The pixels turned clockwise, with their new width and height.
pub(super) fn turned(
    rgb: Vec<u8>,
    [width, height]: [usize; 2],
    turns: QuarterTurns,
) -> (Vec<u8>, [usize; 2]) {
    let size = match turns {
        QuarterTurns::None => return (rgb, [width, height]),
        QuarterTurns::Half => [width, height],
        QuarterTurns::Quarter | QuarterTurns::ThreeQuarters => [height, width],
    };
    let mut out = Vec::with_capacity(rgb.len());
    for v in 0..size[1] {
        for u in 0..size[0] {
            let (x, y) = match turns {
                QuarterTurns::None => (u, v),
                QuarterTurns::Quarter => (v, height - 1 - u),
                QuarterTurns::Half => (width - 1 - u, height - 1 - v),
                QuarterTurns::ThreeQuarters => (width - 1 - v, u),
            };
            out.extend_from_slice(&rgb[3 * (y * width + x)..][..3]);
        }
    }
    (out, size)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(y: u8, u: u8, v: u8, coding: ColourCoding) -> [u8; 3] {
        let planes = Planes { width: 2, height: 2, y: &[y; 4], u: &[u], v: &[v] };
        let rgb = to_rgb(&planes, coding);
        assert!(rgb.chunks(3).all(|p| p == &rgb[..3]));
        [rgb[0], rgb[1], rgb[2]]
    }

    #[test]
    fn ranges_and_matrices_give_the_standard_colours() {
        let limited = |matrix| ColourCoding { matrix, full_range: false };
        assert_eq!(one(235, 128, 128, limited(ColourMatrix::Bt601)), [255; 3]);
        assert_eq!(one(16, 128, 128, limited(ColourMatrix::Bt709)), [0; 3]);
        let full = ColourCoding { matrix: ColourMatrix::Bt601, full_range: true };
        assert_eq!(one(17, 128, 128, full), [17; 3]);
        // Pure red of BT.601 and BT.709 in limited range: Y 81, Cb 90, Cr 240 and Y 63, Cb 102, Cr 240.
        for (y, u, v, matrix) in [(81, 90, 240, ColourMatrix::Bt601), (63, 102, 240, ColourMatrix::Bt709)] {
            let [r, g, b] = one(y, u, v, limited(matrix));
            assert!(r >= 253 && g <= 2 && b <= 2, "{r} {g} {b}");
        }
    }

    #[test]
    fn a_quarter_turn_is_clockwise() {
        let rgb: Vec<u8> = (0..6u8).flat_map(|k| [k; 3]).collect();
        let shown = |turns| {
            let (out, size) = turned(rgb.clone(), [3, 2], turns);
            (out.chunks(3).map(|p| p[0]).collect::<Vec<_>>(), size)
        };
        assert_eq!(shown(QuarterTurns::Quarter), (vec![3, 0, 4, 1, 5, 2], [2, 3]));
        assert_eq!(shown(QuarterTurns::Half), (vec![5, 4, 3, 2, 1, 0], [3, 2]));
        assert_eq!(shown(QuarterTurns::ThreeQuarters), (vec![2, 5, 1, 4, 0, 3], [2, 3]));
    }
}
