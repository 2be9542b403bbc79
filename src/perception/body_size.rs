//! The size of the bodies from the video: of a calibrated camera in metres; of a view from straight above in pixels, so that balls
//! of known radius give its scale.
//!
//! A body that rests on the ground at a place (x, y) has three unknown numbers x, y, r, and its outline shows three: where it is in
//! the image, and how large. Outlines of free size are fitted to the isolated components of a few frames. With noise a cylinder looks
//! like a larger ball, but not all bodies look so by the same factor. So each of these sizes, and CLEVRER's, is tried for all
//! components, and the one with which the outlines fit best is theirs: `sum_k max_form q_k(form, r)`, q the outline's quality. If
//! they fit much worse than with sizes of their own, bodies differ in size.

use super::candidates::{Component, Search, components};
use crate::media::VideoFrame;
use crate::num::median;
use crate::perception::image::colour_histogram::ColourHistogram;
use crate::perception::image::evidence::{CODE_MASK, Evidence, IS_BODY};
use crate::perception::image::ground::Ground;
use crate::perception::outlines::contour_fit::ContourFit;
use crate::perception::outlines::depth_order::Owners;
use crate::perception::outlines::outline::BodyForm;
use crate::perception::outlines::viewpoint::{Viewpoint, top_camera};
use crate::scene::DEFAULT_SIZE;
use std::cell::Cell;

/// Outline fits of one component: all forms at four places.
const MAX_FITS: usize = 24;
/// Least ratio of a component's area to that of its box: a disc has pi/4.
const LEAST_ROUND: f64 = 0.65;
/// Largest ratio of the sides of its box.
const MAX_ASPECT: f64 = 1.3;
/// Frames whose components are fitted.
const FRAMES: usize = 6;
/// Sizes that are tried for all, besides CLEVRER's: those of the best outlines.
const TRIED: usize = 3;
/// Sizes within this share of each other are one.
const ALIKE: f64 = 0.04;
/// Error of a size, as a share: up to 0.4 px, which the outlines of one body share, of 20 px.
const SIZE_ERROR: f64 = 0.02;
/// Least share of an isolated body's outline that has a fitting edge: of 115 right ones in five rendered videos all but three had more,
/// of 130 bodies that were taken for one or cut by the image's border none.
const LEAST_ISOLATED_SUPPORT: f64 = 0.95;
/// Quality that a body loses where its size is wrong, at least.
const CLEARLY_WORSE: f64 = 0.3;

/// Metres per pixel of a view from above; `None` where no ball stands alone.
pub(super) fn ball_scale(frames: &[VideoFrame], ground: &Ground, radius: f64) -> Option<f64> {
    let view = Viewpoint::new(top_camera(1.0, ground.size.map(|s| s as f64)));
    let forms = [BodyForm::Ball];
    let fits = isolated_fits(frames, ground, (&view, &forms), &[None]);
    let mut radii: Vec<f64> = fits.iter().filter_map(|f| f[0]).map(|f| f.pose.size).collect();
    median(&mut radii).map(|r| radius / r)
}

/// The size (m) that all bodies have; `None` where none stands alone or sizes differ. A size that agrees with CLEVRER's is that.
pub(super) fn common_size(
    frames: &[VideoFrame],
    ground: &Ground,
    view: &Viewpoint,
    forms: &[BodyForm],
) -> Option<f64> {
    let few: Vec<VideoFrame> = frames.iter().step_by(frames.len().div_ceil(FRAMES).max(1)).cloned().collect();
    let own = isolated_fits(&few, ground, (view, forms), &[None]);
    let own: Vec<Option<ContourFit>> = own.into_iter().map(|f| f[0]).collect();
    let tried = candidate_sizes(&own);
    let sizes: Vec<Option<f64>> = tried.iter().map(|s| Some(*s)).collect();
    let fits = isolated_fits(&few, ground, (view, forms), &sizes);
    let total = |k: usize| fits.iter().filter_map(|f| f[k]).map(|f| quality(&f)).sum::<f64>();
    let mut best = 0;
    for k in 1..tried.len() {
        best = if total(k) > total(best) { k } else { best };
    }
    let alike = fits.iter().filter(|f| f[best].is_some()).count();
    // Isolated bodies that fit with another size only.
    let is_other = |own: &ContourFit, common: &Option<ContourFit>| {
        own.support >= LEAST_ISOLATED_SUPPORT
            && common.is_none_or(|c| quality(own) - quality(&c) > CLEARLY_WORSE)
    };
    let others = own.iter().zip(&fits).filter(|(own, f)| own.is_some_and(|own| is_other(&own, &f[best])));
    let is_common = alike > 0 && 4 * others.count() <= alike;
    let is_usual = (tried[best] - DEFAULT_SIZE).abs() <= SIZE_ERROR * DEFAULT_SIZE;
    is_common.then_some(if is_usual { DEFAULT_SIZE } else { tried[best] })
}

fn quality(fit: &ContourFit) -> f64 {
    fit.support - 0.5 * fit.rms
}

/// CLEVRER's size, which wins where others are no better, and the sizes of the best outlines. Each is the median of those alike.
fn candidate_sizes(own: &[Option<ContourFit>]) -> Vec<f64> {
    let mut fits: Vec<&ContourFit> = own.iter().flatten().collect();
    fits.sort_by(|a, b| quality(b).total_cmp(&quality(a)));
    let mut sizes = vec![DEFAULT_SIZE];
    for fit in &fits {
        let size = fit.pose.size;
        let is_alike = |s: f64| (s - size).abs() <= ALIKE * size;
        if sizes.len() <= TRIED && !sizes[1..].iter().any(|s| is_alike(*s)) {
            let mut alike: Vec<f64> = fits.iter().map(|f| f.pose.size).filter(|s| is_alike(*s)).collect();
            sizes.extend(median(&mut alike));
        }
    }
    sizes
}

/// For each isolated component the best outline of each of these sizes; `None`: of free size.
fn isolated_fits(
    frames: &[VideoFrame],
    ground: &Ground,
    (view, forms): (&Viewpoint, &[BodyForm]),
    sizes: &[Option<f64>],
) -> Vec<Vec<Option<ContourFit>>> {
    let owners = Owners::none(ground.size);
    let nothing = vec![false; ground.size[0] * ground.size[1]];
    let mut found = vec![];
    for frame in frames {
        let evidence = Evidence::new(frame, ground);
        let mut histogram = ColourHistogram::default();
        let codes = evidence.codes.iter().filter(|c| **c & IS_BODY == 0);
        codes.for_each(|c| histogram.add(c & CODE_MASK));
        let shares = histogram.shares();
        let isolated: Vec<Component> =
            components(&evidence, &owners, &nothing).into_iter().filter(is_round).collect();
        let of_size = |size: Option<f64>| -> Vec<Option<ContourFit>> {
            let search = Search {
                view,
                frame,
                evidence: &evidence,
                owners: &owners,
                ground: &shares,
                size,
                depths: &[],
                forms,
                taken: &[],
                least_inside: 1.0,
                fits_left: Cell::new(MAX_FITS),
            };
            let best = |component: &Component| {
                search.fits_left.set(MAX_FITS);
                search.best(component).map(|found| found.fit)
            };
            isolated.iter().map(best).collect()
        };
        let by_size: Vec<Vec<Option<ContourFit>>> = sizes.iter().map(|s| of_size(*s)).collect();
        found.extend((0..isolated.len()).map(|k| by_size.iter().map(|fits| fits[k]).collect::<Vec<_>>()));
    }
    found
}

/// Whether a component may be one body that stands alone.
fn is_round(component: &Component) -> bool {
    let [left, top, right, bottom] = component.bounds;
    let (w, h) = ((right - left) as f64, (bottom - top) as f64);
    component.pixels.len() as f64 >= LEAST_ROUND * w * h && w.max(h) <= MAX_ASPECT * w.min(h)
}
