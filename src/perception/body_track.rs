//! One body through the video: where it was in each frame, what it looks like, and where it is expected next.

use super::appearance::Appearance;
use super::candidates::{LEAST_SUPPORT, MAX_RMS};
use crate::num::wrap_angle;
use crate::perception::image::colour_histogram::{ColourHistogram, Likelihoods, likelihoods};
use crate::perception::outlines::contour_fit::ContourFit;
use crate::perception::outlines::outline::{BodyForm, FORMS, Pose};
use crate::perception::outlines::viewpoint::Viewpoint;
use crate::scene::Covariance;

/// Where a body is in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Placement {
    pub pose: Pose,
    pub covariance: Covariance,
    /// Visible pixels and those of the whole silhouette, outside the image too.
    pub visible: usize,
    pub whole: usize,
    /// Root mean square distance of the image's edges from the outline (px).
    pub rms: f64,
    /// Share of the outline's free points that have a fitting edge.
    pub support: f64,
    /// Share of the visible pixels that look like the body.
    pub likeness: f64,
}

impl Placement {
    /// Whether the outline fits as that of a new body must.
    pub fn is_outlined(&self) -> bool {
        self.support >= LEAST_SUPPORT && self.rms <= MAX_RMS
    }

    pub fn visible_share(&self) -> f64 {
        self.visible as f64 / self.whole.max(1) as f64
    }
}

/// Deviation of the image of a body's centre that all its edges share (px): contact shadows, mirrored neighbours, rounded edges.
/// Measured on 48 bodies of rendered videos: it makes the mean of the squared normalised errors 1.
const SHARED_SIGMA: f64 = 0.12;
/// Frames over which the velocity is the mean one.
const VELOCITY_FRAMES: usize = 3;
/// Frames of which the histogram remembers about so many.
const HISTOGRAM_MEMORY: f32 = 0.97;

#[derive(Debug, Clone)]
pub(super) struct BodyTrack {
    pub form: BodyForm,
    pub size: f64,
    /// By frame.
    pub placements: Vec<Option<Placement>>,
    histogram: ColourHistogram,
    pub likelihoods: Likelihoods,
    /// Histogram updates since the start; likelihoods are renewed ever more rarely.
    updates: usize,
    /// Sum of the costs of each form, and frames they were summed over.
    pub form_costs: [f64; 3],
    pub form_frames: usize,
    pub appearance: Appearance,
    /// Whether it is still expected in later frames.
    pub is_active: bool,
    /// Frames since it was last placed.
    pub missed: usize,
}

impl BodyTrack {
    pub fn new(pose: &Pose, frames: usize, histogram: ColourHistogram, ground: &[f32]) -> BodyTrack {
        let likelihoods = likelihoods(&histogram.shares(), ground);
        BodyTrack {
            form: pose.form,
            size: pose.size,
            placements: vec![None; frames],
            histogram,
            likelihoods,
            updates: 0,
            form_costs: [0.0; 3],
            form_frames: 0,
            appearance: Appearance::default(),
            is_active: true,
            missed: 0,
        }
    }

    /// Adds codes of pixels that surely show the body.
    pub fn learn(&mut self, codes: impl Iterator<Item = u16>, ground: &[f32]) {
        self.histogram.fade(HISTOGRAM_MEMORY);
        codes.for_each(|c| self.histogram.add(c));
        self.updates += 1;
        if self.updates <= 4 || self.updates.is_multiple_of(12) {
            self.likelihoods = likelihoods(&self.histogram.shares(), ground);
        }
    }

    /// The placed frames next to `frame`, nearest first: before it, or after it where `backwards`.
    fn neighbours(&self, frame: usize, backwards: bool) -> impl Iterator<Item = (usize, &Placement)> {
        let ahead = self.placements.get(frame + 1..).unwrap_or(&[]).iter().enumerate();
        let behind = self.placements.get(..frame).unwrap_or(&[]).iter().enumerate().rev();
        let ahead = backwards.then(|| ahead.map(move |(k, p)| (frame + 1 + k, p))).into_iter().flatten();
        let behind = (!backwards).then_some(behind).into_iter().flatten();
        ahead.chain(behind).filter_map(|(k, p)| Some((k, p.as_ref()?)))
    }

    /// The pose expected in a frame at constant velocity, and the speed (m/s). `None` if it was never placed.
    pub fn predicted(&self, frame: usize, times: &[f64], backwards: bool) -> Option<(Pose, f64)> {
        let mut near = self.neighbours(frame, backwards);
        let (last_frame, last) = near.next()?;
        let earlier = near.take(VELOCITY_FRAMES).last();
        let time = |k: usize| times.get(k).copied().unwrap_or(0.0);
        let mut pose = Pose { form: self.form, size: self.size, ..last.pose };
        let Some((first_frame, first)) = earlier else { return Some((pose, 0.0)) };
        let span = time(last_frame) - time(first_frame);
        let ahead = time(frame) - time(last_frame);
        // Beyond a gap the velocity is not trusted for longer than it was measured.
        let ratio = (ahead / span).clamp(-2.0, 2.0);
        let moved = last.pose.at - first.pose.at;
        pose.at = last.pose.at + moved.scaled(ratio);
        pose.yaw = last.pose.yaw + (last.pose.yaw - first.pose.yaw) * ratio;
        Some((pose, moved.norm() / span.abs().max(1e-9)))
    }

    /// The form with the least cost so far.
    pub fn best_form(&self) -> BodyForm {
        let best = (0..3).min_by(|&a, &b| self.form_costs[a].total_cmp(&self.form_costs[b])).unwrap_or(0);
        if self.form_frames == 0 { self.form } else { FORMS[best] }
    }

    pub fn first_frame(&self) -> Option<usize> {
        self.placements.iter().position(Option::is_some)
    }

    pub fn placed_frames(&self) -> usize {
        self.placements.iter().flatten().count()
    }
}

/// The yaw of a cube nearest to an expected one: they differ by quarter turns.
pub(super) fn nearest_yaw(yaw: f64, expected: f64) -> f64 {
    expected + 0.25 * wrap_angle(4.0 * (yaw - expected))
}

/// Covariance of x and y: of the fit, and of what all edges share.
pub(super) fn plane_covariance(view: &Viewpoint, fit: &ContourFit) -> Covariance {
    let (c, pose) = (&fit.covariance, &fit.pose);
    let shared =
        shifted_covariance(view, pose, SHARED_SIGMA).unwrap_or(Covariance { xx: 0.0, xy: 0.0, yy: 0.0 });
    Covariance { xx: c[(0, 0)] + shared.xx, xy: c[(0, 1)] + shared.xy, yy: c[(1, 1)] + shared.yy }
}

/// Covariance of a body's place whose image is shifted with this deviation of each coordinate (px).
pub(super) fn shifted_covariance(view: &Viewpoint, pose: &Pose, sigma: f64) -> Option<Covariance> {
    let pixel = view.pixel([pose.at.x, pose.at.y, pose.size])?;
    view.camera.locate(pixel, pose.size, [sigma; 2]).ok().map(|found| found.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_of_a_cube_are_unwrapped() {
        let quarter = std::f64::consts::FRAC_PI_2;
        assert!((nearest_yaw(0.1 + quarter, 0.12) - 0.1).abs() < 1e-12);
        assert!((nearest_yaw(-0.1, 3.0 * quarter) - (3.0 * quarter - 0.1)).abs() < 1e-12);
    }
}
