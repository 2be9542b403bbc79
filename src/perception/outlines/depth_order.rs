//! Which body each pixel shows: silhouettes are painted from the farthest to the nearest.

use crate::perception::outlines::outline::{Outline, Pose, Spans};
use crate::perception::outlines::viewpoint::Viewpoint;

/// No body.
pub(in crate::perception) const NOBODY: u8 = 0;
/// Most bodies of one frame: an owner is one byte.
pub(in crate::perception) const MAX_BODIES_IN_FRAME: usize = 128;

/// The owner of each pixel: 0 for none, k + 1 for body k.
#[derive(Debug, Clone)]
pub(in crate::perception) struct Owners {
    pub size: [usize; 2],
    pub pixels: Vec<u8>,
}

/// A body's silhouette in a frame.
#[derive(Debug, Clone, Default)]
pub(in crate::perception) struct Silhouette {
    pub spans: Spans,
    pub depth: f64,
}

impl Silhouette {
    pub fn new(view: &Viewpoint, pose: &Pose) -> Silhouette {
        let spans = Outline::new(view, pose).map(|o| o.spans()).unwrap_or_default();
        Silhouette { spans, depth: view.depth(pose.at) }
    }
}

impl Owners {
    pub fn none(size: [usize; 2]) -> Owners {
        Owners { size, pixels: vec![NOBODY; size[0] * size[1]] }
    }

    /// Paints all silhouettes.
    pub fn paint(&mut self, silhouettes: &[Silhouette]) {
        self.pixels.fill(NOBODY);
        for k in order(silhouettes) {
            self.fill(&silhouettes[k].spans, k as u8 + 1);
        }
    }

    fn fill(&mut self, spans: &Spans, owner: u8) {
        let [width, _] = self.size;
        for (row, a, b) in spans.clipped(self.size) {
            if let Some(pixels) = self.pixels.get_mut(row * width + a..row * width + b) {
                pixels.fill(owner);
            }
        }
    }

    #[inline]
    pub fn at(&self, u: f64, v: f64) -> u8 {
        if !(u >= 0.0 && v >= 0.0 && u < self.size[0] as f64 && v < self.size[1] as f64) {
            return NOBODY;
        }
        self.pixels.get(v as usize * self.size[0] + u as usize).copied().unwrap_or(NOBODY)
    }
}

/// Indices from the farthest to the nearest.
pub(in crate::perception) fn order(silhouettes: &[Silhouette]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..silhouettes.len().min(MAX_BODIES_IN_FRAME)).collect();
    order.sort_by(|&a, &b| silhouettes[b].depth.total_cmp(&silhouettes[a].depth).then(a.cmp(&b)));
    order
}
