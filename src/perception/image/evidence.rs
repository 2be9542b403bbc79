//! What each pixel of a frame says: how its light departs from that of the empty ground.
//!
//! With d the difference of ln L from the ground (red, green, blue), `l = mean of d` is the lightness and
//! `c = (d_red - l, d_blue - l)` the chroma of a pixel relative to the ground. A shadow changes l alone and by no more than the
//! share of light that comes from elsewhere; a coloured body changes c; a grey one changes l by more than shadows do.
//! Exposure and white balance drift change d by the same three numbers everywhere: their median over the ground is taken off.

use crate::media::VideoFrame;
use crate::num::quantile;
use crate::perception::image::ground::Ground;
use crate::perception::image::light::{LIGHT, luma_light};

/// Cells of a pixel's code along lightness and each chroma.
pub(in crate::perception) const CELLS: usize = 16;
pub(in crate::perception) const CODES: usize = CELLS * CELLS * CELLS;
/// Least chroma of a body. Soft coloured light from neighbours stays below (measured: 0.25 % of the ground is above).
const LEAST_CHROMA: f32 = 0.15;
/// Lightness below which no shadow falls, and above which no light on the ground does: shadows of up to three area lights with
/// a bright sky keep 40 % of the light.
const DARKER: f32 = -0.9;
const LIGHTER: f32 = 0.35;
/// Deviations of the ground's texture that chroma and lightness must exceed.
const TEXTURE: f32 = 5.0;
/// Every so many pixels the exposure is measured.
const EXPOSURE_STRIDE: usize = 8;

/// Codes of the pixels of one frame; [`IS_BODY`] is set where a pixel shows a body.
#[derive(Debug, Clone)]
pub(in crate::perception) struct Evidence {
    pub size: [usize; 2],
    pub codes: Vec<u16>,
    /// Light of each pixel's luma.
    pub luma: Vec<f32>,
    /// Median difference of ln L from the ground: exposure and white balance.
    pub exposure: [f32; 3],
}

/// Flag of a code.
pub(in crate::perception) const IS_BODY: u16 = 1 << 15;
pub(in crate::perception) const CODE_MASK: u16 = CODES as u16 - 1;

impl Evidence {
    pub fn new(frame: &VideoFrame, ground: &Ground) -> Evidence {
        let (_, ln) = &*LIGHT;
        let exposure = exposure(frame, ground);
        let chroma_limit = LEAST_CHROMA.max(TEXTURE * 0.5 * ground.deviation as f32);
        let texture = TEXTURE * ground.deviation as f32;
        let (darker, lighter) = (DARKER.min(-texture), LIGHTER.max(texture));
        let code = |(pixel, ground): (&[u8], &[f32; 3])| {
            let d: [f32; 3] = std::array::from_fn(|c| ln[usize::from(pixel[c])] - ground[c] - exposure[c]);
            let lightness = (d[0] + d[1] + d[2]) * (1.0 / 3.0);
            let (red, blue) = (d[0] - lightness, d[2] - lightness);
            let chroma_squared = red * red + blue * blue + red * blue;
            let is_body =
                chroma_squared > chroma_limit * chroma_limit || lightness < darker || lightness > lighter;
            let index =
                (cell(lightness, 1.2) * CELLS as u16 + cell(red, 0.75)) * CELLS as u16 + cell(blue, 0.75);
            index | if is_body { IS_BODY } else { 0 }
        };
        let codes = frame.rgb.chunks_exact(3).zip(&ground.ln_light).map(code).collect();
        Evidence { size: frame.size, codes, luma: luma_light(frame), exposure }
    }

    /// Share of the image that shows bodies.
    pub fn body_share(&self) -> f64 {
        let count = self.codes.iter().filter(|c| **c & IS_BODY != 0).count();
        count as f64 / self.codes.len().max(1) as f64
    }
}

/// Cell of a number: fine around zero, coarse far from it.
#[inline]
fn cell(x: f32, scale: f32) -> u16 {
    let at = 8.0 + 10.0 * x / (x.abs() + scale);
    (at as i32).clamp(0, CELLS as i32 - 1) as u16
}

/// Median difference of ln L from the ground over the pixels that look like ground.
fn exposure(frame: &VideoFrame, ground: &Ground) -> [f32; 3] {
    let [width, height] = frame.size;
    let mut differences: [Vec<f64>; 3] = Default::default();
    for y in (EXPOSURE_STRIDE / 2..height).step_by(EXPOSURE_STRIDE) {
        for x in (EXPOSURE_STRIDE / 2..width).step_by(EXPOSURE_STRIDE) {
            let k = y * width + x;
            let (Some(pixel), Some(ground)) = (frame.rgb.get(3 * k..3 * k + 3), ground.ln_light.get(k))
            else {
                continue;
            };
            for c in 0..3 {
                differences[c].push(f64::from(LIGHT.1[usize::from(pixel[c])] - ground[c]));
            }
        }
    }
    differences.map(|mut d| quantile(&mut d, 0.5).unwrap_or(0.0) as f32)
}
