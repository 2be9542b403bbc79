//! Pixel values as light.
//!
//! A pixel value x (0..1) codes the light `L = ((x + 0.055)/1.055)^2.4`, or x/12.92 below 0.04045 (sRGB, IEC 61966-2-1). At an
//! edge a pixel sums light, so that edges are located in L. A shadow or another exposure multiplies L, so that bodies are separated
//! from the ground in ln L.

use crate::media::VideoFrame;
use crate::num::elementary;
use std::sync::LazyLock;

/// Light below this share of full scale is taken as this: below, one step of the coding changes ln L by more than 0.5.
const DARKEST: f64 = 0.002;

/// Light of each pixel value, and its natural logarithm.
pub(in crate::perception) static LIGHT: LazyLock<([f32; 256], [f32; 256])> = LazyLock::new(|| {
    let light = |value: usize| {
        let x = value as f64 / 255.0;
        if x <= 0.04045 { x / 12.92 } else { elementary::powf((x + 0.055) / 1.055, 2.4) }
    };
    let linear = std::array::from_fn(|k| light(k) as f32);
    (linear, std::array::from_fn(|k| elementary::ln(light(k) + DARKEST) as f32))
});

/// Light of a pixel's luma, `Y = 0.299 R + 0.587 G + 0.114 B`. Video stores luma at every pixel and colour at every fourth.
#[inline]
pub(in crate::perception) fn luma_light(p: &[u8]) -> f32 {
    let (linear, _) = &*LIGHT;
    let luma = (77 * u32::from(p[0]) + 150 * u32::from(p[1]) + 29 * u32::from(p[2]) + 128) >> 8;
    linear[luma as usize & 255]
}

/// Value of a plane at a point of the image, interpolated between the four pixels around it.
#[inline]
pub(in crate::perception) fn plane_at(
    plane: &[f32],
    [width, height]: [usize; 2],
    u: f64,
    v: f64,
) -> Option<f32> {
    let (x, y) = (u - 0.5, v - 0.5);
    if !(x >= 0.0 && y >= 0.0 && x < (width - 1) as f64 && y < (height - 1) as f64) {
        return None;
    }
    let (i, j) = (x as usize, y as usize);
    let (fx, fy) = ((x - i as f64) as f32, (y - j as f64) as f32);
    let at = j * width + i;
    let (upper, lower) = (plane.get(at..at + 2)?, plane.get(at + width..at + width + 2)?);
    let (top, bottom) = (upper[0] + fx * (upper[1] - upper[0]), lower[0] + fx * (lower[1] - lower[0]));
    Some(top + fy * (bottom - top))
}

/// Light at a point of the image, interpolated between the four pixels around it; `None` outside the pixels' centres.
#[inline]
pub(in crate::perception) fn light_at(frame: &VideoFrame, u: f64, v: f64) -> Option<[f32; 3]> {
    let [width, height] = frame.size;
    let (x, y) = (u - 0.5, v - 0.5);
    // Also false for NaN.
    if !(x >= 0.0 && y >= 0.0 && x < (width - 1) as f64 && y < (height - 1) as f64) {
        return None;
    }
    let (i, j) = (x as usize, y as usize);
    let (fx, fy) = ((x - i as f64) as f32, (y - j as f64) as f32);
    let (linear, _) = &*LIGHT;
    let at = 3 * (j * width + i);
    let upper = frame.rgb.get(at..at + 6)?;
    let lower = frame.rgb.get(at + 3 * width..at + 3 * width + 6)?;
    Some(std::array::from_fn(|c| {
        let (a, b) = (linear[usize::from(upper[c])], linear[usize::from(upper[c + 3])]);
        let (d, e) = (linear[usize::from(lower[c])], linear[usize::from(lower[c + 3])]);
        let (top, bottom) = (a + fx * (b - a), d + fx * (e - d));
        top + fy * (bottom - top)
    }))
}
