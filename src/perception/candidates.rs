//! Bodies that are not tracked yet: pixels that show bodies, but lie in no silhouette.
//!
//! Connected pixels of this kind are a component. Bodies of each form are tried at places all over it: the histogram of the pixels
//! there says which pixels look alike, the edges say where the outline is. A body is accepted if its silhouette is filled and its
//! outline has edges; then the rest of the component is examined for another one.

use crate::media::VideoFrame;
use crate::num::Vec2;
use crate::perception::image::colour_histogram::{ColourHistogram, likelihoods};
use crate::perception::image::evidence::{CODE_MASK, Evidence, IS_BODY};
use crate::perception::outlines::contour_fit::{COARSE, ContourFit, FINE, FitTarget, PosePrior};
use crate::perception::outlines::depth_order::{NOBODY, Owners, Silhouette};
use crate::perception::outlines::outline::{BodyForm, FORMS, Pose};
use crate::perception::outlines::viewpoint::Viewpoint;
use std::cell::Cell;
use std::f64::consts::{FRAC_PI_4, FRAC_PI_8};

/// Fewest pixels of a component that may be a body: of any in an image of 480 x 320, and as a share of the silhouette of a body there.
const LEAST_PIXELS: usize = 12;
const LEAST_SHARE: f64 = 0.12;
/// Least radius of a body (px): below, edges of opposite sides blur into each other.
const LEAST_RADIUS: f64 = 3.5;
/// Distance between places that are tried, as a share of the silhouette's width.
const PLACE_STEP: f64 = 0.35;
/// Most places that are tried in one component.
const MAX_PLACES: usize = 60;
/// Least share of a silhouette's pixels that show a body, and of its outline that has a fitting edge; largest distance of the
/// edges (px): wrong forms leave 1.5 px and more.
const LEAST_FILLED: f64 = 0.8;
pub(super) const LEAST_SUPPORT: f64 = 0.5;
pub(super) const MAX_RMS: f64 = 1.0;
/// The same share after the coarse fit: a fifth of what the fine fit must reach.
const LEAST_COARSE_SUPPORT: f64 = 0.2 * LEAST_SUPPORT;
/// Largest radius of a body of unknown size as a share of the smaller side of the image: larger is a part of the scene.
const MAX_RADIUS_SHARE: f64 = 0.2;
/// Least distance between the centres of two bodies as a share of the sum of their radii: less is inside each other.
const LEAST_SEPARATION: f64 = 0.85;
/// Deviation of the prior of a new body: of x, y and an unknown size as multiples of the size, of yaw in rad.
const WIDE: [f64; 3] = [2.5, 1.0, 0.3];
/// Starting yaws of a cube (rad), over a quarter turn.
const YAWS: [f64; 4] = [0.0, FRAC_PI_8, FRAC_PI_4, 3.0 * FRAC_PI_8];

/// Connected pixels that show a body nobody tracks.
#[derive(Debug, Clone)]
pub(super) struct Component {
    pub pixels: Vec<usize>,
    /// Left, top, right, bottom; the latter two exclusive.
    pub bounds: [usize; 4],
}

impl Component {
    pub fn middle(&self) -> [f64; 2] {
        [0.5 * (self.bounds[0] + self.bounds[2]) as f64, 0.5 * (self.bounds[1] + self.bounds[3]) as f64]
    }
}

impl Component {
    pub fn touches_border(&self, [width, height]: [usize; 2]) -> bool {
        let [left, top, right, bottom] = self.bounds;
        left <= 1 || top <= 1 || right + 1 >= width || bottom + 1 >= height
    }
}

/// A body found in a component.
pub(super) struct Candidate {
    pub fit: ContourFit,
    pub histogram: ColourHistogram,
    /// Cost of each form at this place.
    pub form_costs: [f64; 3],
}

/// Components of unexplained pixels, at least `LEAST_PIXELS` large, that are not within two pixels of a silhouette.
pub(super) fn components(evidence: &Evidence, owners: &Owners, explained: &[bool]) -> Vec<Component> {
    let [width, height] = evidence.size;
    let least = LEAST_PIXELS * (width * height / (480 * 320)).max(1);
    let is_open = |k: usize| evidence.codes[k] & IS_BODY != 0 && owners.pixels[k] == NOBODY && !explained[k];
    let mut seen = vec![false; evidence.codes.len()];
    let (mut found, mut stack) = (vec![], vec![]);
    for start in 0..evidence.codes.len() {
        if seen[start] || !is_open(start) {
            continue;
        }
        seen[start] = true;
        stack.push(start);
        let mut component = Component { pixels: vec![], bounds: [width, height, 0, 0] };
        while let Some(k) = stack.pop() {
            let (x, y) = (k % width, k / width);
            let b = &mut component.bounds;
            *b = [b[0].min(x), b[1].min(y), b[2].max(x + 1), b[3].max(y + 1)];
            component.pixels.push(k);
            let near = [
                (x > 0).then(|| k - 1),
                (x + 1 < width).then_some(k + 1),
                (y > 0).then(|| k - width),
                (y + 1 < height).then_some(k + width),
            ];
            for next in near.into_iter().flatten() {
                if !seen[next] && is_open(next) {
                    seen[next] = true;
                    stack.push(next);
                }
            }
        }
        if component.pixels.len() >= least {
            found.push(component);
        }
    }
    // The sort is stable: equal ones stay in the order of their first pixel.
    found.sort_by_key(|c| std::cmp::Reverse(c.pixels.len()));
    found
}

/// Marks all pixels within two of a silhouette: edges blur, feet reflect.
pub(super) fn near_silhouettes(silhouettes: &[Silhouette], size: [usize; 2]) -> Vec<bool> {
    const MARGIN: i32 = 2;
    let mut near = vec![false; size[0] * size[1]];
    for silhouette in silhouettes {
        for dv in -MARGIN..=MARGIN {
            let mut wide = silhouette.spans.shifted([0, dv]);
            for row in wide.rows.iter_mut().filter(|r| r[1] > r[0]) {
                *row = [row[0] - MARGIN, row[1] + MARGIN];
            }
            for (row, a, b) in wide.clipped(size) {
                near[row * size[0] + a..row * size[0] + b].fill(true);
            }
        }
    }
    near
}

/// What candidates are sought with.
pub(super) struct Search<'a> {
    pub view: &'a Viewpoint,
    pub frame: &'a VideoFrame,
    pub evidence: &'a Evidence,
    pub owners: &'a Owners,
    /// Shares of the codes among the ground's pixels.
    pub ground: &'a [f32],
    /// Radius or half side of the bodies (m); `None`: each has its own, which is fitted.
    pub size: Option<f64>,
    /// Depth of each owner's silhouette.
    pub depths: &'a [f64],
    pub forms: &'a [BodyForm],
    /// Ground positions of the bodies that are tracked in this frame.
    pub taken: &'a [Vec2],
    /// Least share of the silhouette inside the image.
    pub least_inside: f64,
    /// Fits that may still be made.
    pub fits_left: Cell<usize>,
}

impl Search<'_> {
    /// The best body in a component, if any is good enough.
    pub fn best(&self, component: &Component) -> Option<Candidate> {
        let size = self.size.or_else(|| self.size_of(component))?;
        let at = self.view.locate(component.middle(), size)?;
        if size * self.view.magnification([at.x, at.y, size]) < LEAST_RADIUS {
            return None;
        }
        let whole = Silhouette::new(self.view, &Pose { form: BodyForm::Ball, size, at, yaw: 0.0 })
            .spans
            .area()
            .max(1);
        if (component.pixels.len() as f64) < LEAST_SHARE * whole as f64 {
            return None;
        }
        let diameter = 2.0 * (whole as f64 / std::f64::consts::PI).sqrt();
        let mut best: Option<(f64, Candidate)> = None;
        for place in self.places(component, PLACE_STEP * diameter) {
            if self.fits_left.get() < YAWS.len() + FORMS.len() - 1 {
                break;
            }
            let histogram = self.histogram_around(component, place, 0.2 * diameter);
            let likelihoods = likelihoods(&histogram.shares(), self.ground);
            let Some(at) = self.view.locate(place, size) else { continue };
            let start = Pose { form: BodyForm::Ball, size, at, yaw: 0.0 };
            let Some(candidate) = self.at_place(&start, &histogram, &likelihoods) else { continue };
            if best.as_ref().is_none_or(|b| candidate.0 > b.0) {
                best = Some(candidate);
            }
        }
        best.map(|b| b.1)
    }

    /// The radius (m) of a disc with the component's area.
    fn size_of(&self, component: &Component) -> Option<f64> {
        let radius = (component.pixels.len() as f64 / std::f64::consts::PI).sqrt();
        let at = self.view.locate(component.middle(), 0.0)?;
        let magnification = self.view.magnification([at.x, at.y, 0.0]);
        let largest = MAX_RADIUS_SHARE * self.evidence.size[0].min(self.evidence.size[1]) as f64;
        (magnification > 0.0 && radius <= largest).then(|| radius / magnification)
    }

    /// Pixels of a grid inside the component, and its middle first.
    fn places(&self, component: &Component, step: f64) -> Vec<[f64; 2]> {
        let [width, _] = self.evidence.size;
        let stride = (step.max(2.0)) as usize;
        let on_grid = |k: &&usize| {
            let (x, y) = (**k % width, **k / width);
            (x - component.bounds[0]) % stride == stride / 2
                && (y - component.bounds[1]) % stride == stride / 2
        };
        let grid = component.pixels.iter().filter(on_grid);
        let places = grid.map(|k| [(k % width) as f64 + 0.5, (k / width) as f64 + 0.5]);
        std::iter::once(component.middle()).chain(places).take(MAX_PLACES).collect()
    }

    /// Codes of the component's pixels around a place; those of all of it count a little.
    fn histogram_around(&self, component: &Component, place: [f64; 2], radius: f64) -> ColourHistogram {
        let [width, _] = self.evidence.size;
        let mut histogram = ColourHistogram::default();
        for &k in &component.pixels {
            let (x, y) = ((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
            if (x - place[0]).abs() <= radius && (y - place[1]).abs() <= radius {
                histogram.add(self.evidence.codes[k]);
            }
        }
        histogram
    }

    /// The best form there: its quality and what was found.
    fn at_place(
        &self,
        place: &Pose,
        histogram: &ColourHistogram,
        likelihoods: &[f32],
    ) -> Option<(f64, Candidate)> {
        let mut best: Option<(f64, ContourFit)> = None;
        let mut costs = [f64::INFINITY; 3];
        for &form in self.forms {
            let yaws: &[f64] = if form == BodyForm::Cube { &YAWS } else { &YAWS[..1] };
            for &yaw in yaws {
                let start = Pose { form, yaw, ..*place };
                let Some(fit) = self.fitted(&start).filter(|f| self.is_possible(&f.pose)) else { continue };
                let filled = self.filled(&fit.pose, likelihoods);
                let slot = FORMS.iter().position(|f| *f == form).unwrap_or(0);
                costs[slot] = costs[slot].min(form_cost(&fit));
                let good = filled >= LEAST_FILLED && fit.support >= LEAST_SUPPORT && fit.rms <= MAX_RMS;
                let quality = filled + fit.support - 0.5 * fit.rms;
                if good && best.as_ref().is_none_or(|b| quality > b.0) {
                    best = Some((quality, fit));
                }
            }
        }
        let (quality, fit) = best?;
        Some((quality, Candidate { fit, histogram: histogram.clone(), form_costs: costs }))
    }

    /// Whether a body can be there: inside the image, and in no other body.
    fn is_possible(&self, pose: &Pose) -> bool {
        let spans = Silhouette::new(self.view, pose).spans;
        let inside = spans.area_within(self.evidence.size) as f64 / spans.area().max(1) as f64;
        let is_separate = |other: &Vec2| (*other - pose.at).norm() > LEAST_SEPARATION * 2.0 * pose.size;
        inside >= self.least_inside && self.taken.iter().all(is_separate)
    }

    /// The outline moved to the edges, from a start.
    fn fitted(&self, start: &Pose) -> Option<ContourFit> {
        let target = FitTarget {
            view: self.view,
            frame: self.frame,
            evidence: self.evidence,
            owners: self.owners,
            own: u8::MAX,
        };
        self.fits_left.set(self.fits_left.get().saturating_sub(1));
        let [shift, turn, growth] = WIDE;
        let growth = if self.size.is_none() { growth * start.size } else { 0.0 };
        let deviations = [shift * start.size, shift * start.size, turn, growth];
        let coarse = target.fit(&PosePrior { pose: *start, deviations }, start, COARSE, 6)?;
        if coarse.support < LEAST_COARSE_SUPPORT {
            return None;
        }
        let prior = PosePrior { pose: coarse.pose, deviations };
        target.fit(&prior, &coarse.pose, FINE, 6)
    }

    /// Share of the silhouette's pixels, of those that no nearer body hides, that show a body of this look or of another one.
    fn filled(&self, pose: &Pose, likelihoods: &[f32]) -> f64 {
        let silhouette = Silhouette::new(self.view, pose);
        let [width, _] = self.evidence.size;
        let (mut visible, mut shown) = (0usize, 0usize);
        for (row, a, b) in silhouette.spans.clipped(self.evidence.size) {
            for pixel in row * width + a..row * width + b {
                let code = self.evidence.codes[pixel];
                match self.owners.pixels[pixel] {
                    NOBODY => {
                        visible += 1;
                        let alike = likelihoods.get(usize::from(code & CODE_MASK)).is_some_and(|l| *l > 0.0);
                        shown += usize::from(alike || code & IS_BODY != 0);
                    }
                    // A new body in front of a tracked one: pixels of both.
                    owner => {
                        let depth = self.depths.get(usize::from(owner) - 1).copied().unwrap_or(0.0);
                        visible += usize::from(depth > silhouette.depth);
                    }
                }
            }
        }
        let whole = silhouette.spans.area().max(1);
        if (visible as f64) < LEAST_SHARE * whole as f64 { 0.0 } else { shown as f64 / visible as f64 }
    }
}

/// Cost of a form: mean square of the edges' distances, more where edges are missing.
pub(super) fn form_cost(fit: &ContourFit) -> f64 {
    fit.rms * fit.rms + 2.0 * (1.0 - fit.support)
}
