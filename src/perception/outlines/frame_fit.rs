//! All bodies of one frame are fitted together.
//!
//! The poses are improved one after another, nearest body first, each against the image and the silhouettes of the others as they
//! are then (block coordinate descent); two rounds suffice where bodies touch. The first round moves each silhouette by whole
//! pixels (`region_search`), and then to the edges (`contour_fit`); the second one only to the edges.

use crate::media::VideoFrame;
use crate::perception::image::colour_histogram::Likelihoods;
use crate::perception::image::evidence::Evidence;
use crate::perception::outlines::contour_fit::{COARSE, ContourFit, FINE, FitTarget, PosePrior};
use crate::perception::outlines::depth_order::{Owners, Silhouette, order};
use crate::perception::outlines::outline::Pose;
use crate::perception::outlines::region_search::RegionEvidence;
use crate::perception::outlines::viewpoint::Viewpoint;

/// Rounds over all bodies.
const ROUNDS: usize = 2;
/// Largest shift sought beyond the predicted motion (px), and the least.
const REACH: [f64; 2] = [5.0, 18.0];
/// Deviation of the prediction: at rest as a share of the size, and as a share of the path since the last frame.
const PREDICTION_SIGMA: f64 = 0.1;
const PREDICTION_SHARE: f64 = 0.5;
/// Deviation of the predicted yaw (rad): the fastest spin seen is 10 rad/s, 0.4 rad a frame.
const YAW_SIGMA: f64 = 0.2;
/// A shift (px) above which the fit is also started from the prediction.
const SMALL_SHIFT: i32 = 2;

/// A body in the frame that is fitted.
#[derive(Debug, Clone)]
pub(in crate::perception) struct FramedBody {
    /// Index of its track.
    pub track: usize,
    pub predicted: Pose,
    /// Path since the last frame (m).
    pub path: f64,
    /// Whether it may move; others only hide and are hidden.
    pub is_free: bool,
    pub pose: Pose,
    pub fit: Option<ContourFit>,
}

impl FramedBody {
    /// A body where it was placed before.
    pub fn placed(track: usize, pose: Pose, is_free: bool) -> FramedBody {
        FramedBody { track, predicted: pose, path: 0.0, is_free, pose, fit: None }
    }

    pub fn prior(&self) -> PosePrior {
        let sigma = PREDICTION_SIGMA * self.predicted.size + PREDICTION_SHARE * self.path;
        PosePrior { pose: self.predicted, deviations: [sigma, sigma, YAW_SIGMA, 0.0] }
    }
}

/// A frame with what is known of it.
pub(in crate::perception) struct FrameFit<'a> {
    pub view: &'a Viewpoint,
    pub frame: &'a VideoFrame,
    pub evidence: &'a Evidence,
    pub owners: Owners,
    pub silhouettes: Vec<Silhouette>,
}

impl<'a> FrameFit<'a> {
    pub fn new(
        view: &'a Viewpoint,
        frame: &'a VideoFrame,
        evidence: &'a Evidence,
        bodies: &[FramedBody],
    ) -> FrameFit<'a> {
        let silhouettes: Vec<Silhouette> = bodies.iter().map(|b| Silhouette::new(view, &b.pose)).collect();
        let mut owners = Owners::none(frame.size);
        owners.paint(&silhouettes);
        FrameFit { view, frame, evidence, owners, silhouettes }
    }

    /// Fits all free bodies.
    pub fn fit(&mut self, bodies: &mut [FramedBody], likelihoods: &[&Likelihoods]) {
        for round in 0..ROUNDS {
            // The second round is for bodies that touch others.
            for k in order(&self.silhouettes).into_iter().rev() {
                if !bodies[k].is_free || (round > 0 && !self.touches(k)) {
                    continue;
                }
                self.fit_one(&mut bodies[k], k, likelihoods, round == 0);
                self.silhouettes[k] = Silhouette::new(self.view, &bodies[k].pose);
                self.owners.paint(&self.silhouettes);
            }
        }
    }

    pub fn region<'b>(&'b self, likelihoods: &'b [&'b Likelihoods]) -> RegionEvidence<'b> {
        RegionEvidence {
            evidence: self.evidence,
            owners: &self.owners,
            silhouettes: &self.silhouettes,
            likelihoods,
        }
    }

    /// Whether the boxes of the silhouette and another one come within three pixels.
    pub fn touches(&self, k: usize) -> bool {
        let bounds = |s: &Silhouette| {
            let left = s.spans.rows.iter().map(|r| r[0]).min().unwrap_or(0);
            let right = s.spans.rows.iter().map(|r| r[1]).max().unwrap_or(0);
            [left - 3, s.spans.top - 3, right + 3, s.spans.top + s.spans.rows.len() as i32 + 3]
        };
        let own = bounds(&self.silhouettes[k]);
        self.silhouettes.iter().enumerate().any(|(j, s)| {
            let other = bounds(s);
            j != k && own[0] < other[2] && other[0] < own[2] && own[1] < other[3] && other[1] < own[3]
        })
    }

    fn fit_one(&self, body: &mut FramedBody, k: usize, likelihoods: &[&Likelihoods], search: bool) {
        let target = FitTarget {
            view: self.view,
            frame: self.frame,
            evidence: self.evidence,
            owners: &self.owners,
            own: k as u8 + 1,
        };
        let prior = body.prior();
        let mut start = body.pose;
        let mut shift = [0, 0];
        if search {
            let at = [body.pose.at.x, body.pose.at.y, body.pose.size];
            let path = body.path * self.view.magnification(at);
            let reach = (REACH[0] + path).min(REACH[1]) as i32;
            shift = self.region(likelihoods).best_shift(k, reach);
            if let Some(pixel) = self.view.pixel(at)
                && let Some(moved) = self
                    .view
                    .locate([pixel[0] + f64::from(shift[0]), pixel[1] + f64::from(shift[1])], body.pose.size)
            {
                start.at = moved;
            }
        }
        let fit_from = |start: &Pose| {
            let coarse = if search { target.fit(&prior, start, COARSE, 3) } else { None };
            let start = coarse.map_or(*start, |c| c.pose);
            target.fit(&prior, &start, FINE, 5)
        };
        let mut fit = fit_from(&start);
        if shift.iter().any(|s| s.abs() > SMALL_SHIFT) {
            let other = fit_from(&body.pose);
            let quality = |f: &Option<ContourFit>| f.map_or(f64::NEG_INFINITY, |f| f.support - 0.3 * f.rms);
            if quality(&other) > quality(&fit) {
                fit = other;
            }
        }
        if let Some(fit) = fit {
            body.pose = fit.pose;
        } else if search {
            body.pose = start;
        }
        body.fit = fit;
    }
}
