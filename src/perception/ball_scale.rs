//! The scale of a view from straight above, from balls of known radius.
//!
//! In an image whose unit is the pixel, an outline of free size is fitted to each isolated component of a few frames. The median
//! of their radii r (px) gives the scale `R/r` (m/px) for balls of radius R.

use super::candidates::{Search, components};
use crate::media::VideoFrame;
use crate::num::median;
use crate::perception::image::colour_histogram::ColourHistogram;
use crate::perception::image::evidence::{CODE_MASK, Evidence, IS_BODY};
use crate::perception::image::ground::Ground;
use crate::perception::outlines::depth_order::Owners;
use crate::perception::outlines::outline::BodyForm;
use crate::perception::outlines::viewpoint::{Viewpoint, top_camera};
use std::cell::Cell;

/// Outline fits a frame: 20 isolated balls at nine places each.
const MAX_FITS: usize = 200;
/// Least ratio of a component's area to that of its box: a disc has pi/4.
const LEAST_ROUND: f64 = 0.65;
/// Largest ratio of the sides of its box.
const MAX_ASPECT: f64 = 1.3;

/// Metres per pixel; `None` where no ball stands alone.
pub(super) fn ball_scale(frames: &[VideoFrame], ground: &Ground, radius: f64) -> Option<f64> {
    let size = ground.size;
    let view = Viewpoint::new(top_camera(1.0, size.map(|s| s as f64)));
    let owners = Owners::none(size);
    let nothing = vec![false; size[0] * size[1]];
    let mut radii = vec![];
    for frame in frames {
        let evidence = Evidence::new(frame, ground);
        let mut histogram = ColourHistogram::default();
        let codes = evidence.codes.iter().filter(|c| **c & IS_BODY == 0);
        codes.for_each(|c| histogram.add(c & CODE_MASK));
        let shares = histogram.shares();
        let search = Search {
            view: &view,
            frame,
            evidence: &evidence,
            owners: &owners,
            ground: &shares,
            size: None,
            depths: &[],
            forms: &[BodyForm::Ball],
            taken: &[],
            least_inside: 1.0,
            fits_left: Cell::new(MAX_FITS),
        };
        for component in components(&evidence, &owners, &nothing) {
            let [left, top, right, bottom] = component.bounds;
            let (w, h) = ((right - left) as f64, (bottom - top) as f64);
            let is_round =
                component.pixels.len() as f64 >= LEAST_ROUND * w * h && w.max(h) <= MAX_ASPECT * w.min(h);
            if is_round && let Some(found) = search.best(&component) {
                radii.push(found.fit.pose.size);
            }
        }
    }
    median(&mut radii).map(|r| radius / r)
}
