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
        let [width, height] = frame.size;
        Evidence::within(frame, ground, exposure(frame, ground), [0, 0, width, height])
    }

    /// Of a part of the image alone: left, top, right, bottom, the latter two exclusive. Codes and light elsewhere are 0.
    pub fn within(frame: &VideoFrame, ground: &Ground, exposure: [f32; 3], part: [usize; 4]) -> Evidence {
        let [width, height] = frame.size;
        let coder = PixelCoder::new(ground, exposure);
        let (mut codes, mut luma) = (vec![0; width * height], vec![0.0; width * height]);
        let (left, right) = (part[0].min(width), part[2].min(width));
        for row in part[1]..part[3].min(height) {
            let range = row * width + left..row * width + right.max(left);
            let Some(rgb) = frame.rgb.get(3 * range.start..3 * range.end) else { continue };
            let at = ground.ln_light.get(range.clone()).unwrap_or(&[]);
            for ((code, pixel), at) in codes[range.clone()].iter_mut().zip(rgb.chunks_exact(3)).zip(at) {
                *code = coder.code(pixel, at);
            }
            luma[range].iter_mut().zip(rgb.chunks_exact(3)).for_each(|(l, p)| *l = luma_light(p));
        }
        Evidence { size: frame.size, codes, luma, exposure }
    }

    /// Share of the image that shows bodies.
    pub fn body_share(&self) -> f64 {
        let count = self.codes.iter().filter(|c| **c & IS_BODY != 0).count();
        count as f64 / self.codes.len().max(1) as f64
    }
}

/// Codes pixels against one ground and exposure.
struct PixelCoder {
    exposure: [f32; 3],
    chroma_limit: f32,
    darker: f32,
    lighter: f32,
}

impl PixelCoder {
    fn new(ground: &Ground, exposure: [f32; 3]) -> PixelCoder {
        let texture = TEXTURE * ground.deviation as f32;
        PixelCoder {
            exposure,
            chroma_limit: LEAST_CHROMA.max(0.5 * texture),
            darker: DARKER.min(-texture),
            lighter: LIGHTER.max(texture),
        }
    }

    #[inline]
    fn code(&self, pixel: &[u8], ground: &[f32; 3]) -> u16 {
        let (_, ln) = &*LIGHT;
        let d: [f32; 3] = std::array::from_fn(|c| ln[usize::from(pixel[c])] - ground[c] - self.exposure[c]);
        let lightness = (d[0] + d[1] + d[2]) * (1.0 / 3.0);
        let (red, blue) = (d[0] - lightness, d[2] - lightness);
        let chroma_squared = red * red + blue * blue + red * blue;
        let is_body = chroma_squared > self.chroma_limit * self.chroma_limit
            || lightness < self.darker
            || lightness > self.lighter;
        let index = (cell(lightness, 1.2) * CELLS as u16 + cell(red, 0.75)) * CELLS as u16 + cell(blue, 0.75);
        index | if is_body { IS_BODY } else { 0 }
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
