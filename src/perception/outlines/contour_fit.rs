//! The fine fit: the outline is moved to the edges of the image.
//!
//! At a point k of the outline the light is read along the normal n_k. With e the unit vector from the mean colour inside to
//! the mean colour outside and `g(s) = dL/ds . e` the slope of the light at s px from the outline, the edge is at
//!
//! `delta_k = sum s g_+^2 / sum g_+^2`.
//!
//! It needs no model of the ground: shadows and reflections change the colour on the outside, but not where the light changes
//! fastest. Light is linear in the share of a pixel that a body covers, so that the edge has no bias towards the brighter side.
//! Over the pose p (x, y, yaw of a cube, size where it is free) is minimised
//!
//! `sum_k rho(delta_k - m_k . dp)/sigma_k^2 + |dp + p0 - p_prior|^2 / sigma_prior^2`,
//!
//! m_k the motion of the outline along n_k (see `outline`), `sigma_k^2 = EDGE_SIGMA^2 + (noise/slope)^2` and rho the Geman-McClure
//! loss. Points that a nearer body hides, whose outside is partly another body, or that lie at the image's border do not count.
//! Where two visible faces of a cube meet (creases), a difference of light is an edge too, and counts with `CREASE_SIGMA`.
//! The covariance is the inverse of the normal matrix times the mean squared residual and the length over which errors of
//! neighbouring points are alike. Sources: Harris, Tracking with rigid models (1992); Drummond and Cipolla, PAMI 24 (2002) 932.

use crate::media::VideoFrame;
use crate::num::elementary;
use crate::perception::image::evidence::Evidence;
use crate::perception::image::light::{light_at, plane_at};
use crate::perception::outlines::depth_order::{NOBODY, Owners};
use crate::perception::outlines::outline::{BodyForm, Outline, OutlinePoint, Pose};
use crate::perception::outlines::viewpoint::Viewpoint;
use nalgebra::{SMatrix, SVector};

/// Distance between points of the outline (px): about the blur of a camera with 4:2:0 chroma.
const POINT_STEP: f64 = 1.6;
/// Most points of an outline, those of a radius of 56 px; larger outlines have points farther apart.
const MAX_POINTS: f64 = 220.0;
/// Deviation of an edge's place apart from noise (px): sampling and compression. Colour has half the resolution of luma.
const EDGE_SIGMA: f64 = 0.2;
const COLOUR_EDGE_SIGMA: f64 = 0.5;
/// Deviation of the place of a crease (px): edges are rounded, and a highlight may lie on them.
const CREASE_SIGMA: f64 = 0.5;
/// Noise of a difference of light between neighbouring samples (share of full scale): compressed video.
const LIGHT_NOISE: f64 = 0.01;
/// Least difference of light between inside and outside (share of full scale) that makes an edge.
const LEAST_CONTRAST: f64 = 0.02;
const LEAST_LUMA_CONTRAST: f64 = 0.04;
/// Length of the outline along which errors are alike (px): three points, as the blur covers two.
const CORRELATED_LENGTH: f64 = 3.0 * POINT_STEP;
/// Least distance at which the loss begins to level off (px): between the errors of an edge (0.2 to 0.5) and the distance of a wrong
/// one (1 and more, as a cube's crease in place of a face that mirrors the ground).
const LEAST_LOSS_SCALE: f64 = 0.7;
/// Largest distance of an edge that fits (px).
const FITTING: f64 = 2.0;
/// Least number of points with an edge.
const LEAST_POINTS: usize = 8;

type Parameters = SVector<f64, 4>;
type Information = SMatrix<f64, 4, 4>;

/// How far from the outline edges are sought, and how finely (px).
#[derive(Debug, Clone, Copy)]
pub(in crate::perception) struct EdgeRange {
    pub reach: f64,
    pub step: f64,
}

/// Largest reach as a share of the radius of the outline: the inside must be the body's own, and not its other edge.
const REACH_SHARE: f64 = 0.7;
/// Most samples along a normal.
const MAX_SAMPLES: usize = 24;

impl EdgeRange {
    /// Narrower for a small body; its radius in px.
    fn within(self, radius: f64) -> EdgeRange {
        EdgeRange { reach: self.reach.min(REACH_SHARE * radius).max(2.0 * self.step), ..self }
    }

    fn samples(self) -> usize {
        (2.0 * self.reach / self.step).round() as usize + 1
    }

    /// Place of a sample (px): negative inside the outline.
    fn place(self, sample: usize) -> f64 {
        self.step * sample as f64 - self.reach
    }
}

/// Where the last fit or a cruder one left the outline within several pixels, and within one.
pub(in crate::perception) const COARSE: EdgeRange = EdgeRange { reach: 6.0, step: 1.0 };
pub(in crate::perception) const FINE: EdgeRange = EdgeRange { reach: 3.3, step: 0.6 };

/// What the pose is expected to be; deviations of x and y (m), yaw (rad) and size (m). A deviation of 0 freezes the number.
#[derive(Debug, Clone, Copy)]
pub(in crate::perception) struct PosePrior {
    pub pose: Pose,
    pub deviations: [f64; 4],
}

#[derive(Debug, Clone, Copy)]
pub(in crate::perception) struct ContourFit {
    pub pose: Pose,
    /// Robust root mean square distance of the edges from the outline (px).
    pub rms: f64,
    /// Share of the outline's points that have an edge and fit it.
    pub support: f64,
    /// Covariance of x, y, yaw (m, rad).
    pub covariance: SMatrix<f64, 3, 3>,
}

/// A frame with the owners of its pixels, and which of them is fitted.
#[derive(Clone, Copy)]
pub(in crate::perception) struct FitTarget<'a> {
    pub view: &'a Viewpoint,
    pub frame: &'a VideoFrame,
    pub evidence: &'a Evidence,
    pub owners: &'a Owners,
    /// Its number among the owners.
    pub own: u8,
}

/// An edge along a normal: distance from the outline and deviation (px).
struct Edge {
    offset: f64,
    sigma: f64,
}

impl FitTarget<'_> {
    /// Moves the pose to the edges. `None` where too little of the outline shows.
    pub fn fit(
        &self,
        prior: &PosePrior,
        start: &Pose,
        range: EdgeRange,
        rounds: usize,
    ) -> Option<ContourFit> {
        let mut pose = *start;
        let mut last = None;
        let radius = pose.size * self.view.magnification([pose.at.x, pose.at.y, pose.size]);
        let range = range.within(radius);
        for round in 0..rounds {
            let outline = Outline::new(self.view, &pose)?;
            let spacing = POINT_STEP.max(outline.length() / MAX_POINTS);
            let mut points = outline.points(self.view, spacing);
            let possible = points.iter().filter(|p| self.is_free(p)).count();
            points.extend(outline.creases(self.view, spacing));
            let edges: Vec<Option<Edge>> = points.iter().map(|p| self.edge(p, range)).collect();
            if points.iter().zip(&edges).filter(|(p, e)| !p.is_crease && e.is_some()).count() < LEAST_POINTS {
                return last;
            }
            let correlated = (CORRELATED_LENGTH / spacing).max(1.0);
            let (step, fit) = solve(&points, &edges, (&pose, prior), possible, correlated);
            last = Some(fit);
            if round + 1 == rounds {
                break;
            }
            // A step beyond the reach is not supported by what was read.
            let largest = points
                .iter()
                .map(|p| (0..4).map(|i| p.motion[i] * step[i]).sum::<f64>().abs())
                .fold(0.0, f64::max);
            let scale = (range.reach / largest.max(1e-9)).min(1.0);
            pose.at.x += scale * step[0];
            pose.at.y += scale * step[1];
            pose.yaw += scale * step[2];
            pose.size = (pose.size + scale * step[3]).max(0.2 * prior.pose.size);
            if largest < 0.005 {
                break;
            }
        }
        last
    }

    /// Whether the point's inner side shows the body.
    fn is_free(&self, p: &OutlinePoint) -> bool {
        let at = |s: f64| (p.pixel[0] + s * p.normal[0], p.pixel[1] + s * p.normal[1]);
        let [width, height] = self.owners.size.map(|s| s as f64);
        let within = |(u, v): (f64, f64)| u > 1.5 && v > 1.5 && u < width - 1.5 && v < height - 1.5;
        if !within(at(-1.5)) || !within(at(1.5)) {
            return false;
        }
        let inner = at(-2.0);
        let owner = self.owners.at(inner.0, inner.1);
        owner == self.own || owner == NOBODY
    }

    fn edge(&self, p: &OutlinePoint, range: EdgeRange) -> Option<Edge> {
        if !self.is_free(p) {
            return None;
        }
        // What lies outside must be one thing: the ground or one other body.
        let owner_at = |s: f64| self.owners.at(p.pixel[0] + s * p.normal[0], p.pixel[1] + s * p.normal[1]);
        let reach = range.reach;
        let (near, far) = (owner_at(1.2), owner_at(reach.min(3.0)));
        if near != far && near != self.own && far != self.own {
            return None;
        }
        let in_luma = self.luma_edge(p, range);
        if p.is_crease {
            return in_luma.map(|e| Edge { sigma: elementary::hypot(e.sigma, CREASE_SIGMA), ..e });
        }
        in_luma.or_else(|| self.colour_edge(p, range))
    }

    /// The edge in luma, where it has enough contrast.
    fn luma_edge(&self, p: &OutlinePoint, range: EdgeRange) -> Option<Edge> {
        let mut light = [0f32; MAX_SAMPLES];
        let light = light.get_mut(..range.samples())?;
        for (j, l) in light.iter_mut().enumerate() {
            let s = range.place(j);
            let (u, v) = (p.pixel[0] + s * p.normal[0], p.pixel[1] + s * p.normal[1]);
            *l = plane_at(&self.evidence.luma, self.evidence.size, u, v)?;
        }
        let side = light.len() / 4;
        let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
        let difference = mean(&light[light.len() - side..]) - mean(&light[..side]);
        if f64::from(difference.abs()) < LEAST_LUMA_CONTRAST {
            return None;
        }
        let sign = difference.signum();
        steepest(range, |j| (light[j + 1] - light[j]) * sign, EDGE_SIGMA)
    }

    /// The edge along the difference of colour between inside and outside.
    fn colour_edge(&self, p: &OutlinePoint, range: EdgeRange) -> Option<Edge> {
        let mut light = [[0f32; 3]; MAX_SAMPLES];
        let light = light.get_mut(..range.samples())?;
        for (j, l) in light.iter_mut().enumerate() {
            let s = range.place(j);
            *l = light_at(self.frame, p.pixel[0] + s * p.normal[0], p.pixel[1] + s * p.normal[1])?;
        }
        let side = light.len() / 4;
        let mean =
            |part: &[[f32; 3]]| [0, 1, 2].map(|c| part.iter().map(|l| l[c]).sum::<f32>() / part.len() as f32);
        let (inside, outside) = (mean(&light[..side]), mean(&light[light.len() - side..]));
        let difference = [0, 1, 2].map(|c| outside[c] - inside[c]);
        let contrast = difference.iter().map(|d| d * d).sum::<f32>().sqrt();
        if f64::from(contrast) < LEAST_CONTRAST {
            return None;
        }
        let direction = difference.map(|d| d / contrast);
        let rise = |j: usize| [0, 1, 2].map(|c| (light[j + 1][c] - light[j][c]) * direction[c]).iter().sum();
        steepest(range, rise, COLOUR_EDGE_SIGMA)
    }
}

/// The place where light rises fastest, from the rise between neighbouring samples.
fn steepest(range: EdgeRange, rise: impl Fn(usize) -> f32, sigma: f64) -> Option<Edge> {
    let (mut sum, mut moment, mut peak) = (0f64, 0f64, 0f64);
    for j in 0..range.samples() - 1 {
        let slope = f64::from(rise(j).max(0.0)) / range.step;
        let s = range.place(j) + 0.5 * range.step;
        (sum, moment, peak) = (sum + slope * slope, moment + s * slope * slope, peak.max(slope));
    }
    let noise = LIGHT_NOISE / peak;
    (sum > 0.0).then(|| Edge { offset: moment / sum, sigma: (sigma * sigma + noise * noise).sqrt() })
}

/// One Gauss-Newton step and what the fit is at its start.
fn solve(
    points: &[OutlinePoint],
    edges: &[Option<Edge>],
    (pose, prior): (&Pose, &PosePrior),
    possible: usize,
    correlated: f64,
) -> (Parameters, ContourFit) {
    let frozen: [bool; 4] =
        std::array::from_fn(|i| prior.deviations[i] <= 0.0 || (i == 2 && pose.form != BodyForm::Cube));
    let outer = points.iter().zip(edges).filter(|(p, _)| !p.is_crease);
    let mut offsets: Vec<f64> = outer.filter_map(|(_, e)| e.as_ref()).map(|e| e.offset.abs()).collect();
    let scale = (1.5 * crate::num::median(&mut offsets).unwrap_or(0.0)).max(LEAST_LOSS_SCALE);
    let mut normal = Information::zeros();
    let mut right = Parameters::zeros();
    let (mut weights, mut squares, mut fitting) = (0.0, 0.0, 0usize);
    for (point, edge) in points.iter().zip(edges) {
        let Some(edge) = edge else { continue };
        let share = edge.offset / scale;
        let robust = 1.0 / ((1.0 + share * share) * (1.0 + share * share));
        let weight = robust / (edge.sigma * edge.sigma);
        let motion = Parameters::from_fn(|i, _| if frozen[i] { 0.0 } else { point.motion[i] });
        normal += motion * motion.transpose() * weight;
        right += motion * (weight * edge.offset);
        // Creases help to place the body; whether it is one, its outline decides.
        if point.is_crease {
            continue;
        }
        weights += robust;
        squares += robust * edge.offset * edge.offset;
        fitting += usize::from(edge.offset.abs() < FITTING);
    }
    let mean_square = squares / f64::max(weights, 1e-9);
    // The information of the edges alone, before the prior.
    let inflation = correlated * (mean_square / (EDGE_SIGMA * EDGE_SIGMA)).max(1.0);
    let mut scaled = normal / inflation;
    let at = [pose.at.x, pose.at.y, pose.yaw, pose.size];
    let expected = [prior.pose.at.x, prior.pose.at.y, prior.pose.yaw, prior.pose.size];
    for i in 0..4 {
        let information = if frozen[i] { 1e18 } else { 1.0 / (prior.deviations[i] * prior.deviations[i]) };
        normal[(i, i)] += information;
        scaled[(i, i)] += information;
        if !frozen[i] {
            right[i] += information * (expected[i] - at[i]);
        }
    }
    let step = normal.cholesky().map(|c| c.solve(&right)).unwrap_or_default();
    let covariance = scaled.cholesky().map(|c| c.inverse()).unwrap_or_else(Information::identity);
    let fit = ContourFit {
        pose: *pose,
        rms: mean_square.sqrt(),
        support: fitting as f64 / possible.max(1) as f64,
        covariance: covariance.fixed_view::<3, 3>(0, 0).into_owned(),
    };
    (step, fit)
}
