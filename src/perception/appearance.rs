//! What a body looks like, summed over its frames: colour and material.
//!
//! Of the visible pixels, two away from the outline, l and c are the lightness and chroma against the ground (see `evidence`).
//! The sums are weighted by visible pixels, so that frames that show more of the body count more.

use serde::Serialize;

/// Bins of lightness from -4 to 2.
const BINS: usize = 96;

#[derive(Debug, Clone)]
pub(super) struct Appearance {
    lightness: Vec<f64>,
    /// Sums of chroma, red and blue, by bin of lightness.
    chroma: Vec<[f64; 2]>,
    total: f64,
}

impl Default for Appearance {
    fn default() -> Self {
        Appearance { lightness: vec![0.0; BINS], chroma: vec![[0.0; 2]; BINS], total: 0.0 }
    }
}

/// The numbers that colour and material are decided by.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AppearanceFeatures {
    /// Mean chroma (red, blue) of the pixels between the quartiles of lightness.
    pub chroma: [f64; 2],
    /// Quantiles of lightness: 5, 25, 50, 75, 95, 99 %.
    pub lightness: [f64; 6],
    /// Chroma of the lightest pixels (above the 97 % quantile).
    pub highlight_chroma: [f64; 2],
}

impl AppearanceFeatures {
    /// Against another reference: lightness, red and blue chroma of the old reference against the new one.
    pub(super) fn shifted(self, [lightness, red, blue]: [f64; 3]) -> AppearanceFeatures {
        let chroma = |c: [f64; 2]| [c[0] + red, c[1] + blue];
        AppearanceFeatures {
            chroma: chroma(self.chroma),
            lightness: self.lightness.map(|l| l + lightness),
            highlight_chroma: chroma(self.highlight_chroma),
        }
    }
}

impl Appearance {
    pub fn add(&mut self, lightness: f32, red: f32, blue: f32) {
        let bin = (((f64::from(lightness) + 4.0) / 6.0 * BINS as f64) as usize).min(BINS - 1);
        self.lightness[bin] += 1.0;
        self.chroma[bin][0] += f64::from(red);
        self.chroma[bin][1] += f64::from(blue);
        self.total += 1.0;
    }

    pub fn is_empty(&self) -> bool {
        self.total == 0.0
    }

    pub fn features(&self) -> AppearanceFeatures {
        let quantile = |q: f64| {
            let mut sum = 0.0;
            for (bin, count) in self.lightness.iter().enumerate() {
                if sum + count >= q * self.total && *count > 0.0 {
                    return (bin as f64 + (q * self.total - sum) / count) / BINS as f64 * 6.0 - 4.0;
                }
                sum += count;
            }
            2.0
        };
        let mean = |low: f64, high: f64| {
            let (mut sum, mut count) = ([0.0; 2], 0.0);
            for (bin, &n) in self.lightness.iter().enumerate() {
                let l = (bin as f64 + 0.5) / BINS as f64 * 6.0 - 4.0;
                if l >= low - 0.04 && l <= high + 0.04 {
                    sum = [sum[0] + self.chroma[bin][0], sum[1] + self.chroma[bin][1]];
                    count += n;
                }
            }
            sum.map(|s| s / f64::max(count, 1.0))
        };
        AppearanceFeatures {
            chroma: mean(quantile(0.25), quantile(0.75)),
            lightness: [0.05, 0.25, 0.5, 0.75, 0.95, 0.99].map(quantile),
            highlight_chroma: mean(quantile(0.97), 2.0),
        }
    }
}
