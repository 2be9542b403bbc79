//! The light of the empty ground at each pixel, found from frames in which bodies may rest.
//!
//! A temporal background would learn resting bodies. A smooth ground does not have to: ln L of each colour is a polynomial of
//! degree 5 in the image coordinates, fitted by trimmed least squares to the median over time of every fourth pixel:
//!
//! minimise over the coefficients a: `sum over the kept pixels of |ln L(u, v) - sum a_ij u^i v^j|^2`,
//!
//! where a pixel is kept if its residual is below `TRIM` robust deviations of the kept ones; fit and choice alternate. Where the
//! light falls off faster than a polynomial can, the ground is recognised by its soft border: components of large residuals
//! belong to the ground if they have the ground's chroma and the light changes by more than `STEEP` hardly anywhere in them and
//! at their border. A body's edge is a step. Then each pixel's mean over the frames in which it is near the ground so far corrects it (texture, vignetting).
//! A ground that deviates from the polynomial by more than `TEXTURED`, or that covers little of the image, has a pattern: each pixel's median over the frames is taken
//! in its stead. Bodies that rest through most of the video are then part of it.
//! Source: Rousseeuw and Leroy, Robust Regression and Outlier Detection (1987), chapter 4 (concentration steps).

use crate::media::VideoFrame;
use crate::num::{NORMAL_MEDIAN_ABSOLUTE, median, quantile};
use crate::perception::image::light::LIGHT;
use nalgebra::{DMatrix, DVector};

/// Frames that the ground is found from, evenly over the video.
pub(in crate::perception) const GROUND_FRAMES: usize = 24;
const DEGREE: usize = 5;
const TERMS: usize = (DEGREE + 1) * (DEGREE + 2) / 2;
/// Every so many pixels are fitted: 9,600 of 480 x 320 for 21 coefficients.
const STRIDE: usize = 4;
/// First share of the pixels that is kept: bodies and their shadows cover less than the rest.
const FIRST_KEPT: f64 = 0.6;
/// Residuals up to so many robust deviations are kept.
const TRIM: f64 = 2.5;
const TRIM_ROUNDS: usize = 12;
/// Residual (norm of ln L) from which a grid point may be no ground.
const LARGE_RESIDUAL: f64 = 0.15;
/// Change of ln L (norm) between grid points that is an edge: light fades over more than twice their distance.
const STEEP: f64 = 0.5;
const STEEP_SHARE: f64 = 0.05;
/// Fewest grid points of a soft component: fewer may be the blurred edge of a body.
const LEAST_SOFT: usize = 12;
/// Largest chroma (norm) of a change of the ground: compression and noise colour dark parts; bodies have 0.7 and more, or none.
const GROUND_CHROMA: f64 = 0.3;
/// Least deviation of ln L that counts as texture: a step and a half of 8-bit coding in mid grey.
const LEAST_DEVIATION: f64 = 0.02;
/// Chroma of ln L up to which a ground is grey, and the light of a grey ground in a well exposed picture.
const GREY_CHROMA: f64 = 0.25;
const GREY_LIGHT: f64 = 0.25;
/// Deviations of the texture within which a pixel is taken as ground for the correction.
const NEAR_GROUND: f64 = 3.0;

/// Deviation of ln L from a smooth ground from which it has a pattern: bodies must differ by five of it.
pub(in crate::perception) const TEXTURED: f64 = 0.1;
/// Share of the image that differs from the smooth ground from which the median over time is the better ground: bodies cover less,
/// and so do the rails of a table (a third).
const MAX_OTHER_SHARE: f64 = 0.45;
/// Every so many pixels the deviation from the median is measured; no divisor of usual widths.
const DEVIATION_STRIDE: usize = 37;

/// Natural logarithm of the light of the empty ground.
#[derive(Debug, Clone)]
pub(in crate::perception) struct Ground {
    pub size: [usize; 2],
    /// ln L of red, green and blue of each pixel.
    pub ln_light: Vec<[f32; 3]>,
    /// Robust deviation of ln L from this ground: texture and noise.
    pub deviation: f64,
    /// Deviation from a smooth ground, where that is too large and the median over time is taken.
    pub pattern: Option<f64>,
    /// Share of the image that never shows the ground: surroundings and resting bodies.
    pub other_share: f64,
}

impl Ground {
    /// From a picture of the empty ground.
    pub fn of_picture(frame: &VideoFrame) -> Ground {
        let ln_light = frame.rgb.chunks_exact(3).map(ln_of).collect();
        Ground { size: frame.size, ln_light, deviation: LEAST_DEVIATION, pattern: None, other_share: 0.0 }
    }

    /// From frames of one size; `None` without any.
    pub fn fit(frames: &[VideoFrame]) -> Option<Ground> {
        let size = frames.first()?.size;
        let grid = GroundGrid::new(frames, size);
        let (coefficients, deviation) = trimmed_fit(&grid.points);
        let ln_light = evaluate(&coefficients, size);
        let mut ground = Ground { size, ln_light, deviation, pattern: None, other_share: 0.0 };
        if deviation > TEXTURED {
            ground.take_median(frames);
            return Some(ground);
        }
        grid.add_soft_residuals(&coefficients, &mut ground);
        if ground.other_share > MAX_OTHER_SHARE {
            ground.take_median(frames);
            ground.other_share = 0.0;
            return Some(ground);
        }
        ground.correct(frames);
        Some(ground)
    }

    /// Takes each pixel's median over the frames as the ground, and the median of the deviations from it.
    fn take_median(&mut self, frames: &[VideoFrame]) {
        let (_, ln) = &*LIGHT;
        let mut bytes: Vec<u8> = vec![];
        let mut deviations = vec![];
        for (k, at) in self.ln_light.iter_mut().enumerate() {
            let mut spread = 0.0;
            for (c, value) in at.iter_mut().enumerate() {
                bytes.clear();
                bytes.extend(frames.iter().filter_map(|f| f.rgb.get(3 * k + c)));
                let middle = bytes.len() / 2;
                if middle >= bytes.len() {
                    continue;
                }
                *value = ln[usize::from(*bytes.select_nth_unstable(middle).1)];
                if k.is_multiple_of(DEVIATION_STRIDE) {
                    let mut far: Vec<f64> =
                        bytes.iter().map(|b| f64::from((ln[usize::from(*b)] - *value).abs())).collect();
                    spread = f64::max(spread, median(&mut far).unwrap_or(0.0));
                }
            }
            if k.is_multiple_of(DEVIATION_STRIDE) {
                deviations.push(spread);
            }
        }
        self.pattern = Some(self.deviation);
        let typical = median(&mut deviations).unwrap_or(0.0) / NORMAL_MEDIAN_ABSOLUTE;
        self.deviation = typical.max(LEAST_DEVIATION);
    }

    /// Lightness and chroma (red, blue) of a coloured ground against a grey one under white light; `None` of a grey ground, which
    /// is the better reference, as it shows the colour of the light.
    pub fn colour_shift(&self) -> Option<[f64; 3]> {
        let count = self.ln_light.len().max(1) as f64;
        let mean = [0, 1, 2].map(|c| self.ln_light.iter().map(|l| f64::from(l[c])).sum::<f64>() / count);
        let lightness = mean.iter().sum::<f64>() / 3.0;
        let (red, blue) = (mean[0] - lightness, mean[2] - lightness);
        let is_grey = red * red + blue * blue + red * blue < GREY_CHROMA * GREY_CHROMA;
        (!is_grey).then(|| [lightness - crate::num::elementary::ln(GREY_LIGHT), red, blue])
    }

    /// Moves each pixel to the mean of the frames in which it is near.
    fn correct(&mut self, frames: &[VideoFrame]) {
        let limit = (NEAR_GROUND * self.deviation.max(LEAST_DEVIATION)) as f32;
        let least = frames.len().div_ceil(3);
        for (k, at) in self.ln_light.iter_mut().enumerate() {
            let (mut sum, mut count) = ([0f32; 3], 0);
            for frame in frames {
                let Some(pixel) = frame.rgb.get(3 * k..3 * k + 3) else { continue };
                let value = ln_of(pixel);
                if (0..3).all(|c| (value[c] - at[c]).abs() < limit) {
                    (0..3).for_each(|c| sum[c] += value[c]);
                    count += 1;
                }
            }
            if count >= least {
                *at = sum.map(|s| s / count as f32);
            }
        }
    }
}

fn ln_of(pixel: &[u8]) -> [f32; 3] {
    let (_, ln) = &*LIGHT;
    [ln[usize::from(pixel[0])], ln[usize::from(pixel[1])], ln[usize::from(pixel[2])]]
}

/// A pixel of the grid: the polynomial's terms and the median of ln L over the frames.
type GridPoint = ([f64; TERMS], [f64; 3]);

fn terms(u: f64, v: f64) -> [f64; TERMS] {
    let mut terms = [0.0; TERMS];
    let (mut k, mut row) = (0, 1.0);
    for i in 0..=DEGREE {
        let mut term = row;
        for _ in 0..=DEGREE - i {
            terms[k] = term;
            (k, term) = (k + 1, term * v);
        }
        row *= u;
    }
    terms
}

/// Coordinates from -1 to 1.
fn scaled(k: usize, size: usize) -> f64 {
    (2.0 * k as f64 + 1.0) / size as f64 - 1.0
}

/// GroundGrid points with the medians over the frames, row by row.
struct GroundGrid {
    points: Vec<GridPoint>,
    columns: usize,
    stride: usize,
}

impl GroundGrid {
    fn new(frames: &[VideoFrame], [width, height]: [usize; 2]) -> GroundGrid {
        let mut points = vec![];
        let mut values = vec![];
        // Larger images have as many grid points as a small one.
        let stride = STRIDE * (width * height / (480 * 320)).isqrt().max(1);
        for y in (stride / 2..height).step_by(stride) {
            for x in (stride / 2..width).step_by(stride) {
                let at = 3 * (y * width + x);
                let of = |c: usize, values: &mut Vec<f64>| {
                    values.clear();
                    let bytes = frames.iter().filter_map(|f| f.rgb.get(at + c));
                    values.extend(bytes.map(|&b| f64::from(LIGHT.1[usize::from(b)])));
                    median(values).unwrap_or(0.0)
                };
                let light = [of(0, &mut values), of(1, &mut values), of(2, &mut values)];
                points.push((terms(scaled(x, width), scaled(y, height)), light));
            }
        }
        GroundGrid { points, columns: (stride / 2..width).step_by(stride).count(), stride }
    }

    /// Neighbours of a grid point to the right, left, below and above.
    fn neighbours(&self, k: usize) -> impl Iterator<Item = usize> + '_ {
        let x = k % self.columns;
        let all = [
            (x + 1 < self.columns).then_some(k + 1),
            (x > 0).then(|| k - 1),
            Some(k + self.columns).filter(|&n| n < self.points.len()),
            k.checked_sub(self.columns),
        ];
        all.into_iter().flatten()
    }

    /// Adds the residuals of points that are ground by their soft border, and of all near ones.
    fn add_soft_residuals(&self, coefficients: &[[f64; TERMS]; 3], ground: &mut Ground) {
        let mut residuals: Vec<[f64; 3]> = self.points.iter().map(|p| residual(p, coefficients)).collect();
        let limit = LARGE_RESIDUAL.max(2.0 * TRIM * ground.deviation);
        let chroma_limit = GROUND_CHROMA.max(TRIM * ground.deviation);
        let chroma = |r: &[f64; 3]| {
            let mean = r.iter().sum::<f64>() / 3.0;
            length(r.map(|x| x - mean))
        };
        let is_large: Vec<bool> = residuals.iter().map(|r| length(*r) > limit).collect();
        let is_open: Vec<bool> =
            residuals.iter().zip(&is_large).map(|(r, large)| *large && chroma(r) <= chroma_limit).collect();
        let mut member = vec![false; residuals.len()];
        for start in 0..residuals.len() {
            if !is_open[start] || member[start] {
                continue;
            }
            let component = self.soft_component(start, &is_open, &mut member);
            // Steps to the ground and within the component; other components and coloured bodies do not count.
            let inside: std::collections::BTreeSet<usize> = component.iter().copied().collect();
            let (mut steep, mut all) = (0usize, 0usize);
            for &k in &component {
                for n in self.neighbours(k).filter(|n| !is_large[*n] || inside.contains(n)) {
                    all += 1;
                    steep += usize::from(self.step(k, n) > STEEP);
                }
            }
            if component.len() < LEAST_SOFT || steep as f64 > STEEP_SHARE * all as f64 {
                component.iter().for_each(|&k| residuals[k] = [0.0; 3]);
            }
        }
        let mut others = 0usize;
        for (k, r) in residuals.iter_mut().enumerate() {
            if is_large[k] && !member[k] {
                *r = [0.0; 3];
                others += 1;
            }
        }
        ground.other_share = others as f64 / residuals.len().max(1) as f64;
        self.add_interpolated(&residuals, ground);
    }

    /// Change of ln L between two grid points.
    fn step(&self, a: usize, b: usize) -> f64 {
        length([0, 1, 2].map(|c| self.points[a].1[c] - self.points[b].1[c]))
    }

    /// Open points that soft steps connect with `start`.
    fn soft_component(&self, start: usize, is_open: &[bool], member: &mut [bool]) -> Vec<usize> {
        let mut component = vec![start];
        member[start] = true;
        let mut next = 0;
        while let Some(&k) = component.get(next) {
            next += 1;
            for n in self.neighbours(k) {
                if is_open[n] && !member[n] && self.step(k, n) <= STEEP {
                    member[n] = true;
                    component.push(n);
                }
            }
        }
        component
    }

    /// Adds values at grid points, interpolated between four of them, to all pixels.
    fn add_interpolated(&self, values: &[[f64; 3]], ground: &mut Ground) {
        let [width, height] = ground.size;
        let rows = values.len() / self.columns.max(1);
        let place = |k: usize, count: usize| {
            let at =
                ((k as f64 - (self.stride / 2) as f64) / self.stride as f64).clamp(0.0, (count - 1) as f64);
            let low = (at as usize).min(count.saturating_sub(2));
            (low, (low + 1).min(count - 1), at - low as f64)
        };
        if rows == 0 {
            return;
        }
        for y in 0..height {
            let (top, bottom, fy) = place(y, rows);
            for x in 0..width {
                let (left, right, fx) = place(x, self.columns);
                let at = |row: usize, column: usize| values[row * self.columns + column];
                let (a, b, d, e) = (at(top, left), at(top, right), at(bottom, left), at(bottom, right));
                for c in 0..3 {
                    let (upper, lower) = (a[c] + fx * (b[c] - a[c]), d[c] + fx * (e[c] - d[c]));
                    ground.ln_light[y * width + x][c] += (upper + fy * (lower - upper)) as f32;
                }
            }
        }
    }
}

fn residual(point: &GridPoint, coefficients: &[[f64; TERMS]; 3]) -> [f64; 3] {
    [0, 1, 2].map(|c| point.1[c] - coefficients[c].iter().zip(&point.0).map(|(a, t)| a * t).sum::<f64>())
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Coefficients of each colour and the deviation of the kept points.
fn trimmed_fit(points: &[GridPoint]) -> ([[f64; TERMS]; 3], f64) {
    // The first choice: points near the median colour of all.
    let middle = [0, 1, 2].map(|c| {
        let mut all: Vec<f64> = points.iter().map(|p| p.1[c]).collect();
        median(&mut all).unwrap_or(0.0)
    });
    let mut residuals: Vec<f64> =
        points.iter().map(|p| length([0, 1, 2].map(|c| p.1[c] - middle[c]))).collect();
    let mut limit = quantile(&mut residuals.clone(), FIRST_KEPT).unwrap_or(f64::INFINITY);
    let mut fitted = ([[0.0; TERMS]; 3], LEAST_DEVIATION);
    for _ in 0..TRIM_ROUNDS {
        let kept: Vec<&GridPoint> =
            points.iter().zip(&residuals).filter(|(_, r)| **r <= limit).map(|(p, _)| p).collect();
        fitted.0 = least_squares(&kept);
        for (residual, point) in residuals.iter_mut().zip(points) {
            *residual = length(self::residual(point, &fitted.0));
        }
        // The deviation of the better part, as if its residuals were the lower share of a half-normal sample.
        let part = quantile(&mut residuals.clone(), 0.5 * FIRST_KEPT).unwrap_or(0.0);
        fitted.1 = (part / NORMAL_MEDIAN_ABSOLUTE).max(LEAST_DEVIATION);
        limit = TRIM * fitted.1;
    }
    fitted
}

fn least_squares(kept: &[&GridPoint]) -> [[f64; TERMS]; 3] {
    let mut normal = DMatrix::<f64>::zeros(TERMS, TERMS);
    let mut right = [0, 1, 2].map(|_| DVector::<f64>::zeros(TERMS));
    for (terms, light) in kept {
        for i in 0..TERMS {
            for j in 0..=i {
                normal[(i, j)] += terms[i] * terms[j];
            }
            (0..3).for_each(|c| right[c][i] += terms[i] * light[c]);
        }
    }
    // A ridge far below the data keeps the higher terms finite where few pixels are kept.
    let ridge = 1e-6 * (1.0 + kept.len() as f64);
    for i in 0..TERMS {
        normal[(i, i)] += ridge;
        for j in 0..i {
            normal[(j, i)] = normal[(i, j)];
        }
    }
    let Some(factor) = normal.cholesky() else { return [[0.0; TERMS]; 3] };
    right.map(|r| {
        let solution = factor.solve(&r);
        std::array::from_fn(|k| solution[k])
    })
}

/// The polynomial at every pixel, by rows: Horner's scheme in u with coefficients that depend on v.
fn evaluate(coefficients: &[[f64; TERMS]; 3], [width, height]: [usize; 2]) -> Vec<[f32; 3]> {
    let mut out = Vec::with_capacity(width * height);
    for y in 0..height {
        let v = scaled(y, height);
        let in_u: [[f64; DEGREE + 1]; 3] = coefficients.map(|a| {
            let mut k = 0;
            std::array::from_fn(|i| {
                let count = DEGREE + 1 - i;
                let sum = a[k..k + count].iter().rev().fold(0.0, |sum, a| sum * v + a);
                k += count;
                sum
            })
        });
        for x in 0..width {
            let u = scaled(x, width);
            out.push(in_u.map(|a| a.iter().rev().fold(0.0, |sum, a| sum * u + a) as f32));
        }
    }
    out
}
