//! The size of the bodies from the video: of a calibrated camera in metres; of a view from straight above in pixels, so that balls
//! of known radius give its scale.
//!
//! An outline of free size is fitted to each isolated component of a few frames. A body that rests on the ground at a place (x, y)
//! has three unknown numbers x, y, r, and its outline shows three: where it is in the image, and how large. Equal bodies are the
//! rule, so that the median of all sizes is taken for all of them, unless the sizes scatter by more than outlines err.

use super::candidates::{Search, components};
use crate::media::VideoFrame;
use crate::num::{median, quantile};
use crate::perception::image::colour_histogram::ColourHistogram;
use crate::perception::image::evidence::{CODE_MASK, Evidence, IS_BODY};
use crate::perception::image::ground::Ground;
use crate::perception::outlines::depth_order::Owners;
use crate::perception::outlines::outline::BodyForm;
use crate::perception::outlines::viewpoint::{Viewpoint, top_camera};
use crate::scene::DEFAULT_SIZE;
use std::cell::Cell;

/// Outline fits a frame: a dozen isolated bodies, all forms at one or two places.
const MAX_FITS: usize = 100;
/// Sizes that suffice: the median of so many errs by a quarter of what one errs.
const ENOUGH: usize = 20;
/// Least share of an isolated body's outline that has a fitting edge: of 115 right ones in five rendered videos all but three had more,
/// of 130 bodies that were taken for one or cut by the image's border none.
const LEAST_ISOLATED_SUPPORT: f64 = 0.95;
/// Least ratio of a component's area to that of its box: a disc has pi/4.
const LEAST_ROUND: f64 = 0.65;
/// Largest ratio of the sides of its box.
const MAX_ASPECT: f64 = 1.3;
/// Half the distance between the quartiles of equal bodies' sizes as a share of the median, at most: an outline of 20 px errs by 0.2 px
/// alone and by 1 px where a shadow or a neighbour is taken in. Bodies of two sizes differ by more.
const MAX_SCATTER: f64 = 0.05;
/// Error of the median size, as a share: up to 0.4 px, which the outlines of one body share, of 20 px.
const SIZE_ERROR: f64 = 0.02;

/// Metres per pixel of a view from above; `None` where no ball stands alone.
pub(super) fn ball_scale(frames: &[VideoFrame], ground: &Ground, radius: f64) -> Option<f64> {
    let view = Viewpoint::new(top_camera(1.0, ground.size.map(|s| s as f64)));
    let mut radii = isolated_sizes(frames, ground, &view, &[BodyForm::Ball]);
    median(&mut radii).map(|r| radius / r)
}

/// The size (m) that all bodies have; `None` where none stands alone or sizes differ. A size that agrees with CLEVRER's is that.
pub(super) fn common_size(
    frames: &[VideoFrame],
    ground: &Ground,
    view: &Viewpoint,
    forms: &[BodyForm],
) -> Option<f64> {
    let mut sizes = isolated_sizes(frames, ground, view, forms);
    let (low, high) = (quantile(&mut sizes, 0.25)?, quantile(&mut sizes, 0.75)?);
    let size = median(&mut sizes)?;
    let is_usual = (size - DEFAULT_SIZE).abs() <= SIZE_ERROR * DEFAULT_SIZE;
    (high - low <= 2.0 * MAX_SCATTER * size).then_some(if is_usual { DEFAULT_SIZE } else { size })
}

/// Sizes of the outlines that fit isolated components, in the units of the view.
fn isolated_sizes(frames: &[VideoFrame], ground: &Ground, view: &Viewpoint, forms: &[BodyForm]) -> Vec<f64> {
    let size = ground.size;
    let owners = Owners::none(size);
    let nothing = vec![false; size[0] * size[1]];
    let mut found = vec![];
    for frame in frames {
        let evidence = Evidence::new(frame, ground);
        let mut histogram = ColourHistogram::default();
        let codes = evidence.codes.iter().filter(|c| **c & IS_BODY == 0);
        codes.for_each(|c| histogram.add(c & CODE_MASK));
        let shares = histogram.shares();
        let search = Search {
            view,
            frame,
            evidence: &evidence,
            owners: &owners,
            ground: &shares,
            size: None,
            depths: &[],
            forms,
            taken: &[],
            least_inside: 1.0,
            fits_left: Cell::new(MAX_FITS),
        };
        for component in components(&evidence, &owners, &nothing) {
            let [left, top, right, bottom] = component.bounds;
            let (w, h) = ((right - left) as f64, (bottom - top) as f64);
            let is_round =
                component.pixels.len() as f64 >= LEAST_ROUND * w * h && w.max(h) <= MAX_ASPECT * w.min(h);
            let fit = if is_round { search.best(&component).map(|c| c.fit) } else { None };
            found.extend(fit.filter(|f| f.support >= LEAST_ISOLATED_SUPPORT).map(|f| f.pose.size));
        }
        if found.len() >= ENOUGH {
            break;
        }
    }
    found
}
