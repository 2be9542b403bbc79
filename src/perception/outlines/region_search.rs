//! The coarse fit: the silhouette is moved by whole pixels to where most pixels look like the body.
//!
//! If body b covers pixel p, the log likelihood changes by `L_b(p) - L_o(p)`, L the log likelihood ratio against the ground (see
//! `colour_histogram`) and o the body behind (L = 0 for the ground); pixels of nearer bodies change nothing. The sum over a
//! silhouette needs two numbers of each row if the rows' running sums are known, so that hundreds of shifts are tried quickly.

use crate::perception::image::colour_histogram::Likelihoods;
use crate::perception::image::evidence::{CODE_MASK, Evidence};
use crate::perception::outlines::depth_order::{NOBODY, Owners, Silhouette};
use crate::perception::outlines::outline::Spans;

/// Share of the silhouette's area that a shift by the whole reach costs: decides where the evidence does not.
const SHIFT_COST: f64 = 0.05;
/// First step between shifts (px): an eighth of a silhouette's usual width.
const FIRST_STEP: i32 = 4;

/// A frame's evidence, painted silhouettes and what each owner looks like.
pub(in crate::perception) struct RegionEvidence<'a> {
    pub evidence: &'a Evidence,
    pub owners: &'a Owners,
    pub silhouettes: &'a [Silhouette],
    /// Log likelihood ratios of each body.
    pub likelihoods: &'a [&'a Likelihoods],
}

/// Running sums of the gain along each row of a part of the image.
struct RowSums {
    left: i32,
    top: i32,
    width: usize,
    height: usize,
    sums: Vec<f32>,
}

impl RowSums {
    fn over(&self, spans: &Spans, [du, dv]: [i32; 2]) -> f32 {
        let mut total = 0.0;
        for (k, &[a, b]) in spans.rows.iter().enumerate() {
            let row = spans.top + k as i32 + dv - self.top;
            if row < 0 || row >= self.height as i32 {
                continue;
            }
            let limit = |u: i32| (u + du - self.left).clamp(0, self.width as i32) as usize;
            let base = row as usize * (self.width + 1);
            if let (Some(high), Some(low)) = (self.sums.get(base + limit(b)), self.sums.get(base + limit(a)))
            {
                total += high - low;
            }
        }
        total
    }
}

impl RegionEvidence<'_> {
    /// Gain of body `body` at a pixel.
    #[inline]
    fn gain(&self, body: usize, pixel: usize) -> f32 {
        let code = usize::from(self.evidence.codes[pixel] & CODE_MASK);
        let own = self.likelihoods[body][code];
        match self.owners.pixels[pixel] {
            NOBODY => own,
            owner => {
                let other = usize::from(owner) - 1;
                if other == body {
                    own
                } else if self.silhouettes[other].depth < self.silhouettes[body].depth {
                    0.0
                } else {
                    own - self.likelihoods[other][code]
                }
            }
        }
    }

    /// The best shift (px) up to `reach` each way. The body itself must not be painted over others: its own pixels count as free.
    pub fn best_shift(&self, body: usize, reach: i32) -> [i32; 2] {
        let spans = &self.silhouettes[body].spans;
        let sums = self.row_sums(body, reach);
        let area = spans.area().max(1) as f64;
        let score = |[du, dv]: [i32; 2]| {
            let share = f64::from(du * du + dv * dv) / f64::from(reach * reach).max(1.0);
            f64::from(sums.over(spans, [du, dv])) - SHIFT_COST * area * share
        };
        let (mut best, mut best_score) = ([0, 0], score([0, 0]));
        let mut step = FIRST_STEP.min(reach.max(1));
        let mut radius = reach;
        while step >= 1 {
            let centre = best;
            let count = radius / step;
            for i in -count..=count {
                for j in -count..=count {
                    let shift = [centre[0] + i * step, centre[1] + j * step];
                    let value = score(shift);
                    if value > best_score {
                        (best, best_score) = (shift, value);
                    }
                }
            }
            (radius, step) = (step, step / 2);
        }
        best
    }

    fn row_sums(&self, body: usize, reach: i32) -> RowSums {
        let spans = &self.silhouettes[body].spans;
        let [width, height] = self.evidence.size.map(|s| s as i32);
        let left = spans.rows.iter().map(|r| r[0]).min().unwrap_or(0) - reach;
        let right = spans.rows.iter().map(|r| r[1]).max().unwrap_or(0) + reach;
        let (left, right) = (left.clamp(0, width), right.clamp(0, width));
        let top = (spans.top - reach).clamp(0, height);
        let bottom = (spans.top + spans.rows.len() as i32 + reach).clamp(0, height);
        let (w, h) = ((right - left).max(0) as usize, (bottom - top).max(0) as usize);
        let mut sums = Vec::with_capacity((w + 1) * h);
        for row in top..bottom {
            let mut sum = 0.0;
            sums.push(sum);
            for u in left..right {
                sum += self.gain(body, (row * width + u) as usize);
                sums.push(sum);
            }
        }
        RowSums { left, top, width: w, height: h, sums }
    }

    /// Pixels of the body's silhouette that no nearer body hides, and how many of them look more like it than like the ground.
    pub fn support(&self, body: usize) -> (usize, usize) {
        let [width, _] = self.evidence.size;
        let owner = body as u8 + 1;
        let (mut visible, mut alike) = (0, 0);
        for (row, a, b) in self.silhouettes[body].spans.clipped(self.evidence.size) {
            for pixel in row * width + a..row * width + b {
                if self.owners.pixels[pixel] == owner {
                    visible += 1;
                    let code = usize::from(self.evidence.codes[pixel] & CODE_MASK);
                    alike += usize::from(self.likelihoods[body][code] > 0.0);
                }
            }
        }
        (visible, alike)
    }
}
