//! Which pixels look like a body: histograms of the pixels' codes.
//!
//! With h_b(k) and h_g(k) the shares of code k among the pixels of body b and of the ground (its shadows and reflections
//! included), a pixel of code k favours b by the log likelihood ratio `ln((h_b(k) + e)/(h_g(k) + e))`, clamped: no pixel decides
//! alone. Histograms are smoothed by (1, 2, 1)/4 along each axis: neighbouring codes are alike.
//! Source: Bibby and Reid, Robust real-time visual tracking using pixel-wise posteriors, ECCV 2008.

use crate::perception::image::evidence::{CELLS, CODE_MASK, CODES};

/// Share that a code has at least; 1 in 20,000 pixels.
const FLOOR: f32 = 5e-5;
/// Largest log likelihood ratio of one pixel.
const CLAMP: f32 = 4.0;

#[derive(Debug, Clone)]
pub(in crate::perception) struct ColourHistogram {
    counts: Vec<f32>,
    total: f32,
}

/// Log likelihood ratio by code.
pub(in crate::perception) type Likelihoods = Vec<f32>;

impl Default for ColourHistogram {
    fn default() -> Self {
        ColourHistogram { counts: vec![0.0; CODES], total: 0.0 }
    }
}

impl ColourHistogram {
    pub fn add(&mut self, code: u16) {
        if let Some(count) = self.counts.get_mut(usize::from(code & CODE_MASK)) {
            *count += 1.0;
            self.total += 1.0;
        }
    }

    /// Reduces what was counted before, so that new frames weigh more.
    pub fn fade(&mut self, factor: f32) {
        self.counts.iter_mut().for_each(|c| *c *= factor);
        self.total *= factor;
    }

    /// Shares of the codes, smoothed.
    pub fn shares(&self) -> Vec<f32> {
        let mut shares = self.counts.clone();
        for stride in [1, CELLS, CELLS * CELLS] {
            let before = shares.clone();
            for (k, share) in shares.iter_mut().enumerate() {
                let place = k / stride % CELLS;
                let low = if place > 0 { before[k - stride] } else { before[k] };
                let high = if place + 1 < CELLS { before[k + stride] } else { before[k] };
                *share = 0.25 * (low + 2.0 * before[k] + high);
            }
        }
        let scale = 1.0 / self.total.max(1.0);
        shares.iter_mut().for_each(|s| *s *= scale);
        shares
    }
}

/// Log likelihood ratios of a body against the ground, from the shares of both.
pub(in crate::perception) fn likelihoods(body: &[f32], ground: &[f32]) -> Likelihoods {
    let ratio = |(b, g): (&f32, &f32)| {
        let ratio = f64::from((b + FLOOR) / (g + FLOOR));
        (crate::num::elementary::ln(ratio) as f32).clamp(-CLAMP, CLAMP)
    };
    body.iter().zip(ground).map(ratio).collect()
}
