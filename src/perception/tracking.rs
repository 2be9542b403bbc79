//! Frames to tracks: predict, fit together, find new bodies, and follow each new one back to where it came into view.

use super::body_track::{BodyTrack, Placement, nearest_yaw, plane_covariance};
use super::camera_shake::{Shake, remove_shake};
use super::candidates::{Candidate, Component, Search, components, form_cost, near_silhouettes};
use crate::media::VideoFrame;
use crate::num::{Vec2, median};
use crate::perception::image::colour_histogram::{ColourHistogram, Likelihoods};
use crate::perception::image::evidence::{CODE_MASK, Evidence, IS_BODY};
use crate::perception::image::ground::Ground;
use crate::perception::image::light::LIGHT;
use crate::perception::outlines::contour_fit::{ContourFit, FINE, FitTarget, PosePrior};
use crate::perception::outlines::depth_order::{MAX_BODIES_IN_FRAME, NOBODY, Owners, Silhouette};
use crate::perception::outlines::frame_fit::{FrameFit, FramedBody};
use crate::perception::outlines::outline::{BodyForm, FORMS, Pose};
use crate::perception::outlines::viewpoint::Viewpoint;
use std::cell::Cell;
use std::collections::VecDeque;
use std::rc::Rc;

/// Least visible pixels of a body that is placed, and least share of its silhouette in the image.
const LEAST_VISIBLE: usize = 25;
const LEAST_VISIBLE_SHARE: f64 = 0.12;
/// Least share of the visible pixels that look like the body.
const LEAST_LIKENESS: f64 = 0.55;
/// The same for learning its look.
const SURE_LIKENESS: f64 = 0.8;
/// Share of the outline with a fitting edge, and largest distance of the edges (px), that prove a body whatever its look.
const SURE_SUPPORT: f64 = 0.6;
const SURE_RMS: f64 = 0.6;
/// Distance from its prediction, as a share of the size, within which a found body is the tracked one whatever its look.
const SAME_PLACE: f64 = 0.5;
/// Frames without a placement after which a body that should be seen is given up, and one that is hidden.
const MAX_UNSEEN: usize = 5;
const MAX_HIDDEN: usize = 60;
/// Distance within which bodies may hide each other or were confused, as a multiple of the size.
const NEAR: f64 = 5.0;
/// Frames of which the forms are compared, and every so many after them.
const FIRST_FORM_FRAMES: usize = 8;
const FORM_STRIDE: usize = 5;
/// Visible share from which a frame says something of form and look.
const CLEAR_SHARE: f64 = 0.9;
const PARTIAL_SHARE: f64 = 0.4;
/// Turn of a cube (in quarter turns) from which its fit is started again, and share of the cost below which another pose is taken.
const CUBE_RESTART: f64 = 0.1;
const CLEARLY_BETTER: f64 = 0.7;
/// Least size of a body as a share of the largest one, where sizes are fitted: less is a piece of a shadow or of a reflection.
const LEAST_SIZE_SHARE: f64 = 0.35;
/// Deviation of a fitted size as a share of the size.
const SIZE_SHARE: f64 = 0.2;
/// Frames in which a new body must be seen to be one.
const LEAST_FRAMES: usize = 6;
/// Share of its frames in which its outline must fit; and frames, where a ground with a pattern has many edges.
const OUTLINED_SHARE: f64 = 0.3;
/// Least median share of a body's outline with fitting edges where sizes are free, which fit more: bodies have 0.93 and more, pieces of
/// a cluttered scene 0.57 to 0.9.
const LEAST_FREE_SUPPORT: f64 = 0.85;
const LEAST_FRAMES_ON_PATTERN: usize = 12;
/// Share of a silhouette inside the image from which a body at the border is taken up: less is ambiguous. It is followed back to
/// where it entered. A component that stays, or one of the last frame, is taken up with less.
const INSIDE: f64 = 0.88;
const LEAST_INSIDE: f64 = 0.35;
const STAYING: usize = 12;
/// Most components of one frame that are examined, the largest first: more are texture, not bodies.
const MAX_EXAMINED: usize = 8;
/// Outline fits of candidates: a frame earns so many, at most so many are saved, and a component is examined with at least so many
/// (all forms at two places). A fit takes 0.1 to 0.3 ms; a scene of eight bodies that is seen first takes about 1,000.
const FITS_PER_FRAME: usize = 60;
const MAX_FITS: usize = 3000;
const LEAST_FITS: usize = 12;
/// Pixels around a body's silhouette that its fit reads: the largest shift and the widest search for edges.
const FIT_MARGIN: f64 = 48.0;
/// A component that stays is examined every so many frames.
const RETRIAL: usize = 4;
/// Share of the image that bodies cover at most: more means that the camera moved or the scene was cut.
const MAX_BODY_SHARE: f64 = 0.4;
/// Change of ln L of a frame's ground that automatic exposure (a stop and a half) and white balance explain.
const MAX_EXPOSURE: f32 = 1.0;
const MAX_BALANCE: f32 = 0.4;

/// What the tracker works with.
pub(super) struct Setting {
    pub view: Viewpoint,
    pub ground: Ground,
    pub times: Vec<f64>,
    /// Radius or half side of the bodies (m); `None`: each has its own.
    pub size: Option<f64>,
    pub forms: Vec<BodyForm>,
}

/// Counts for the report.
#[derive(Debug, Clone, Default)]
pub(super) struct Counts {
    pub merged_frames: usize,
    pub hidden_frames: usize,
    /// Components that are no body: frame, box and pixels.
    pub unexplained: Vec<(usize, [usize; 4], usize)>,
    pub covered_frames: Vec<usize>,
    pub exposure: Vec<[f32; 3]>,
}

pub(super) struct Tracker {
    pub setting: Setting,
    pub tracks: Vec<BodyTrack>,
    pub counts: Counts,
    /// Of the camera; found at the end.
    pub shake: Option<Shake>,
    ground_histogram: ColourHistogram,
    ground_shares: Vec<f32>,
    /// The last frames, for following new bodies back.
    past: VecDeque<PastFrame>,
    past_limit: usize,
    /// Outline fits of candidates that may be made now.
    fits_left: usize,
}

/// A frame that was taken, and its exposure against the ground.
#[derive(Clone)]
struct PastFrame {
    index: usize,
    frame: Rc<VideoFrame>,
    exposure: [f32; 3],
}

impl Tracker {
    /// `past_limit`: frames that are kept.
    pub fn new(setting: Setting, past_limit: usize) -> Tracker {
        Tracker {
            setting,
            tracks: vec![],
            counts: Counts::default(),
            shake: None,
            ground_histogram: ColourHistogram::default(),
            ground_shares: vec![],
            past: VecDeque::new(),
            past_limit,
            fits_left: MAX_FITS,
        }
    }

    /// Takes the next frame.
    pub fn step(&mut self, index: usize, frame: VideoFrame) {
        let evidence = Evidence::new(&frame, &self.setting.ground);
        let other = self.setting.ground.other_share;
        let is_full = evidence.body_share() > other + MAX_BODY_SHARE * (1.0 - other);
        if is_full || is_other_scene(evidence.exposure) {
            self.counts.covered_frames.push(index);
            return;
        }
        self.counts.exposure.push(evidence.exposure);
        if self.ground_shares.is_empty() {
            self.learn_ground(&evidence, None);
        }
        let owners = self.place_all(index, &frame, &evidence);
        let found = self.find_new(index, &frame, &evidence, owners);
        self.past.push_back(PastFrame { index, frame: Rc::new(frame), exposure: evidence.exposure });
        while self.past.len() > self.past_limit {
            self.past.pop_front();
        }
        for track in found {
            self.follow_back(track, index);
        }
    }

    /// Fits all tracked bodies to a frame; returns the owners of its pixels.
    fn place_all(&mut self, index: usize, frame: &VideoFrame, evidence: &Evidence) -> FramePainting {
        let active: Vec<usize> = (0..self.tracks.len()).filter(|&k| self.tracks[k].is_active).collect();
        let mut bodies: Vec<FramedBody> =
            active.iter().filter_map(|&k| self.framed(k, index, false, true)).collect();
        bodies.truncate(MAX_BODIES_IN_FRAME);
        let (owners, silhouettes) = self.fit_and_record(index, (frame, evidence), &mut bodies, false);
        self.end_tracks(&bodies);
        FramePainting { owners, silhouettes }
    }

    /// Time of a frame (s).
    fn time(&self, index: usize) -> f64 {
        self.setting.times.get(index).copied().unwrap_or(0.0)
    }

    fn framed(&self, track: usize, index: usize, backwards: bool, is_free: bool) -> Option<FramedBody> {
        let (predicted, speed) = self.tracks[track].predicted(index, &self.setting.times, backwards)?;
        let step = if backwards { index + 1 } else { index.saturating_sub(1) };
        let path = speed * (self.time(index) - self.time(step)).abs();
        Some(FramedBody { track, predicted, path, is_free, pose: predicted, fit: None })
    }

    /// Fits the free bodies and records where they are.
    fn fit_and_record(
        &mut self,
        index: usize,
        (frame, evidence): (&VideoFrame, &Evidence),
        bodies: &mut [FramedBody],
        backwards: bool,
    ) -> (Owners, Vec<Silhouette>) {
        let view = self.setting.view;
        let mut fitting = FrameFit::new(&view, frame, evidence, bodies);
        {
            let likelihoods: Vec<&Likelihoods> =
                bodies.iter().map(|b| &self.tracks[b.track].likelihoods).collect();
            fitting.fit(bodies, &likelihoods);
        }
        for (k, body) in bodies.iter().enumerate().filter(|(_, b)| b.is_free) {
            self.record(index, &fitting, k, (body, bodies), backwards);
        }
        (fitting.owners, fitting.silhouettes)
    }

    /// Records where body `k` of a fitted frame is, and learns what it looks like.
    fn record(
        &mut self,
        index: usize,
        fitting: &FrameFit,
        k: usize,
        (body, bodies): (&FramedBody, &[FramedBody]),
        backwards: bool,
    ) {
        let likelihoods: Vec<&Likelihoods> =
            bodies.iter().map(|b| &self.tracks[b.track].likelihoods).collect();
        let placement = placement(fitting, &likelihoods, k, body);
        let track = &mut self.tracks[body.track];
        let Some(placement) = placement else {
            track.missed += 1;
            return;
        };
        track.missed = 0;
        track.placements[index] = Some(placement);
        let share = placement.visible_share();
        if !backwards {
            self.counts.merged_frames += usize::from(fitting.touches(k));
            self.counts.hidden_frames += usize::from(share < CLEAR_SHARE);
        }
        let is_shown = share >= PARTIAL_SHARE || track.appearance.is_empty();
        if is_shown && (placement.likeness > SURE_LIKENESS || is_outlined(body.fit)) {
            learn_look(track, fitting, k, &self.setting.ground, &self.ground_shares);
        }
        let count = track.form_frames;
        let is_due = share >= CLEAR_SHARE && (count < FIRST_FORM_FRAMES || index.is_multiple_of(FORM_STRIDE));
        // What is never seen whole is judged by what shows.
        let is_partial = share >= PARTIAL_SHARE && count < FIRST_FORM_FRAMES;
        let is_open = self.setting.forms.len() > 1 || self.setting.size.is_none();
        if is_open && (is_due || is_partial) {
            compare_forms(track, index, fitting, k, &self.setting);
        }
    }

    /// Ends tracks whose body left the image or cannot be found.
    fn end_tracks(&mut self, bodies: &[FramedBody]) {
        let size = self.setting.view.size();
        for body in bodies {
            let spans = Silhouette::new(&self.setting.view, &body.pose).spans;
            let inside = spans.area_within(size);
            let near = |other: &FramedBody| (other.pose.at - body.pose.at).norm() < NEAR * body.pose.size;
            let may_be_hidden = bodies.iter().any(|b| b.track != body.track && near(b));
            let track = &mut self.tracks[body.track];
            let has_left = inside < LEAST_VISIBLE && track.missed > 0;
            let at_border = 2 * inside <= spans.area();
            let is_lost = track.missed > MAX_UNSEEN && (at_border || !may_be_hidden);
            if has_left || is_lost || track.missed > MAX_HIDDEN {
                track.is_active = false;
            }
        }
    }

    fn learn_ground(&mut self, evidence: &Evidence, owned: Option<(&Owners, &[bool])>) {
        self.ground_histogram.fade(0.9);
        for (k, &code) in evidence.codes.iter().enumerate().step_by(3) {
            let is_ground = match owned {
                Some((owners, near)) => owners.pixels[k] == NOBODY && (!near[k] || code & IS_BODY == 0),
                None => code & IS_BODY == 0,
            };
            if is_ground && (code & IS_BODY == 0 || owned.is_some()) {
                self.ground_histogram.add(code & CODE_MASK);
            }
        }
        self.ground_shares = self.ground_histogram.shares();
    }

    /// New bodies from unexplained components; returns their tracks.
    fn find_new(
        &mut self,
        index: usize,
        frame: &VideoFrame,
        evidence: &Evidence,
        mut painting: FramePainting,
    ) -> Vec<usize> {
        let mut found = vec![];
        let mut refused: Vec<Component> = vec![];
        let mut examined = 0;
        self.fits_left = (self.fits_left + FITS_PER_FRAME).min(MAX_FITS);
        // Each found body changes which pixels are open.
        while painting.silhouettes.len() < MAX_BODIES_IN_FRAME {
            let near = near_silhouettes(&painting.silhouettes, evidence.size);
            let open = components(evidence, &painting.owners, &near);
            if open.is_empty() && index.is_multiple_of(10) {
                self.learn_ground(evidence, Some((&painting.owners, &near)));
            }
            let mut candidate = None;
            for component in open {
                if refused
                    .iter()
                    .any(|r| r.bounds == component.bounds && r.pixels.len() == component.pixels.len())
                {
                    continue;
                }
                let stays = index + 1 == self.setting.times.len() || self.stays(&component, index);
                let wait = (component.touches_border(evidence.size) && !stays)
                    || self.was_refused(&component, index)
                    || self.fits_left < LEAST_FITS;
                examined += usize::from(!wait);
                if !wait && examined <= MAX_EXAMINED {
                    candidate = self.examine(index, (frame, evidence), &painting, &component, stays);
                }
                if candidate.is_some() {
                    break;
                }
                refused.push(component);
            }
            let Some(candidate) = candidate else { break };
            let track = self.start(index, candidate);
            found.push(track);
            if let Some(Some(placement)) = self.tracks[track].placements.get(index) {
                painting.silhouettes.push(Silhouette::new(&self.setting.view, &placement.pose));
                painting.owners.paint(&painting.silhouettes);
            }
        }
        for component in refused {
            self.counts.unexplained.push((index, component.bounds, component.pixels.len()));
        }
        found
    }

    /// The best body in a component of a frame.
    fn examine(
        &mut self,
        index: usize,
        (frame, evidence): (&VideoFrame, &Evidence),
        painting: &FramePainting,
        component: &Component,
        stays: bool,
    ) -> Option<Candidate> {
        let depths: Vec<f64> = painting.silhouettes.iter().map(|s| s.depth).collect();
        let taken: Vec<Vec2> = self.placed(index);
        let search = Search {
            view: &self.setting.view,
            frame,
            evidence,
            owners: &painting.owners,
            ground: &self.ground_shares,
            size: self.setting.size,
            depths: &depths,
            forms: &self.setting.forms,
            taken: &taken,
            least_inside: if stays { LEAST_INSIDE } else { INSIDE },
            fits_left: Cell::new(self.fits_left),
        };
        let candidate = search.best(component);
        self.fits_left = search.fits_left.get();
        candidate
    }

    /// Ground positions of the bodies placed in a frame.
    fn placed(&self, index: usize) -> Vec<Vec2> {
        self.tracks.iter().filter_map(|t| t.placements.get(index)?.map(|p| p.pose.at)).collect()
    }

    /// Whether a component like this one was there in each of the last frames.
    fn stays(&self, component: &Component, index: usize) -> bool {
        (1..=STAYING).all(|back| self.was_there(component, index, back))
    }

    /// Whether this component was refused in the last frame and is not due for another trial.
    fn was_refused(&self, component: &Component, index: usize) -> bool {
        !index.is_multiple_of(RETRIAL)
            && index + 1 < self.setting.times.len()
            && self.was_there(component, index, 1)
    }

    /// Whether a component with nearly the same box and pixels was unexplained some frames ago.
    fn was_there(&self, component: &Component, index: usize, back: usize) -> bool {
        let Some(frame) = index.checked_sub(back) else { return false };
        let alike = |u: &(usize, [usize; 4], usize)| {
            let near = |k: usize| u.1[k].abs_diff(component.bounds[k]) <= 2;
            let pixels = component.pixels.len();
            (0..4).all(near) && u.2.abs_diff(pixels) * 20 <= pixels
        };
        let recent = self.counts.unexplained.iter().rev().take_while(|u| u.0 >= frame);
        recent.filter(|u| u.0 == frame).any(alike)
    }

    /// Starts a track, or goes on with one that was not found for some frames.
    fn start(&mut self, index: usize, candidate: Candidate) -> usize {
        let fit = candidate.fit;
        let frames = self.setting.times.len();
        let revived = (0..self.tracks.len()).find(|&k| {
            let track = &self.tracks[k];
            let Some((pose, speed)) = track.predicted(index, &self.setting.times, false) else {
                return false;
            };
            let distance = (pose.at - fit.pose.at).norm();
            let missed = track.missed.min(index);
            let reach = 2.0 * track.size + speed * (self.time(index) - self.time(index - missed));
            let is_same = distance < SAME_PLACE * track.size
                || (distance < reach && alike(track, &candidate.histogram));
            track.missed > 0 && track.is_active && is_same
        });
        let placement = Placement {
            pose: fit.pose,
            covariance: plane_covariance(&self.setting.view, &fit),
            visible: 1,
            whole: 1,
            rms: fit.rms,
            support: fit.support,
            likeness: 1.0,
        };
        let track = match revived {
            Some(track) => track,
            None => {
                let new = BodyTrack::new(&fit.pose, frames, candidate.histogram, &self.ground_shares);
                self.tracks.push(new);
                self.tracks.len() - 1
            }
        };
        let own = &mut self.tracks[track];
        own.missed = 0;
        own.placements[index] = Some(placement);
        let largest = candidate.form_costs.iter().copied().filter(|c| c.is_finite()).fold(0.0, f64::max);
        for (sum, cost) in own.form_costs.iter_mut().zip(candidate.form_costs) {
            *sum += if cost.is_finite() { cost } else { largest + 1.0 };
        }
        own.form_frames += 1;
        track
    }

    /// Follows a new body through the kept frames back to where it is not seen.
    fn follow_back(&mut self, track: usize, index: usize) {
        let mut unseen = 0;
        let mut at = self.past.iter().rposition(|p| p.index == index);
        while let Some(place) = at {
            let Some(PastFrame { index: k, frame, exposure }) = self.past.get(place).cloned() else { break };
            at = place.checked_sub(1);
            if k != index && self.tracks[track].placements[k].is_some() {
                break;
            }
            let mut bodies = self.bodies_around(track, k, k == index);
            let part = self.part_around(&bodies);
            let evidence = Evidence::within(&frame, &self.setting.ground, exposure, part);
            self.fit_and_record(k, (&frame, &evidence), &mut bodies, true);
            unseen = if self.tracks[track].missed > 0 { unseen + 1 } else { 0 };
            self.tracks[track].missed = 0;
            if unseen > MAX_UNSEEN {
                break;
            }
        }
    }

    /// The part of the image that fits of the free bodies read: left, top, right, bottom.
    fn part_around(&self, bodies: &[FramedBody]) -> [usize; 4] {
        let mut part = [f64::INFINITY, f64::INFINITY, 0.0, 0.0];
        for body in bodies.iter().filter(|b| b.is_free) {
            let spans = Silhouette::new(&self.setting.view, &body.pose).spans;
            let at = [body.pose.at.x, body.pose.at.y, body.pose.size];
            let margin = FIT_MARGIN + body.path * self.setting.view.magnification(at);
            let left = spans.rows.iter().map(|r| r[0]).min().unwrap_or(0);
            let right = spans.rows.iter().map(|r| r[1]).max().unwrap_or(0);
            let bottom = spans.top + spans.rows.len() as i32;
            for (k, low) in [left, spans.top].into_iter().enumerate() {
                part[k] = part[k].min(f64::from(low) - margin);
            }
            for (k, high) in [right, bottom].into_iter().enumerate() {
                part[k + 2] = part[k + 2].max(f64::from(high) + margin);
            }
        }
        // Casts from numbers below 0 give 0.
        part.map(|p| p as usize)
    }

    /// A new body in an earlier frame, or in its first one, and the others there. Those near it were fitted without it, and are
    /// fitted again.
    fn bodies_around(&self, track: usize, index: usize, is_first: bool) -> Vec<FramedBody> {
        let own = match (is_first, self.tracks[track].placements[index]) {
            (true, Some(p)) => Some(FramedBody::placed(track, p.pose, true)),
            _ => self.framed(track, index, true, true),
        };
        let Some(own) = own else { return vec![] };
        let near = |pose: &Pose| (pose.at - own.pose.at).norm() < NEAR * own.pose.size;
        let others = (0..self.tracks.len()).filter(|&other| other != track).filter_map(|other| {
            let placement = self.tracks[other].placements[index]?;
            Some(FramedBody::placed(other, placement.pose, near(&placement.pose)))
        });
        let mut bodies: Vec<FramedBody> = others.collect();
        bodies.insert(0, own);
        bodies.truncate(MAX_BODIES_IN_FRAME);
        bodies
    }

    /// Ends the work: drops what was seen too briefly and decides the forms.
    pub fn finish(&mut self) {
        let has_pattern = self.setting.ground.pattern.is_some();
        let least = if has_pattern { LEAST_FRAMES_ON_PATTERN } else { LEAST_FRAMES };
        let least = least.min(self.setting.times.len());
        // What is never seen whole may have any size.
        let is_whole = |p: &Placement| self.setting.size.is_some() || p.visible_share() >= CLEAR_SHARE;
        let is_free = self.setting.size.is_none();
        let is_body = |t: &BodyTrack| {
            let mut supports: Vec<f64> = t.placements.iter().flatten().map(|p| p.support).collect();
            if is_free && median(&mut supports).is_none_or(|s| s < LEAST_FREE_SUPPORT) {
                return false;
            }
            let placed = t.placements.iter().flatten();
            let outlined = placed.filter(|p| p.is_outlined() && is_whole(p)).count();
            outlined >= least.max((OUTLINED_SHARE * t.placed_frames() as f64).ceil() as usize)
        };
        let (bodies, others) = std::mem::take(&mut self.tracks).into_iter().partition(is_body);
        self.tracks = bodies;
        self.report_unexplained(others);
        if self.setting.size.is_none() {
            let largest = self.tracks.iter().map(|t| t.size).fold(0.0, f64::max);
            self.tracks.retain(|t| t.size >= LEAST_SIZE_SHARE * largest);
        }
        for track in &mut self.tracks {
            track.form = track.best_form();
        }
        self.shake = remove_shake(&mut self.tracks, &self.setting.view);
    }

    /// Counts what was followed but is no body as unexplained.
    fn report_unexplained(&mut self, tracks: Vec<BodyTrack>) {
        let size = self.setting.view.size();
        for track in tracks {
            for (frame, placement) in track.placements.iter().enumerate() {
                let Some(placement) = placement else { continue };
                let spans = Silhouette::new(&self.setting.view, &placement.pose).spans;
                let mut bounds = [size[0], size[1], 0, 0];
                for (row, a, b) in spans.clipped(size) {
                    bounds = [bounds[0].min(a), bounds[1].min(row), bounds[2].max(b), bounds[3].max(row + 1)];
                }
                self.counts.unexplained.push((frame, bounds, spans.area_within(size)));
            }
        }
        // The sort is stable.
        self.counts.unexplained.sort_by_key(|u| u.0);
    }
}

/// Whether the ground's light or its colour differs too much from that of the other frames for an exposure or a white balance.
fn is_other_scene(exposure: [f32; 3]) -> bool {
    let mean = exposure.iter().sum::<f32>() / 3.0;
    mean.abs() > MAX_EXPOSURE || exposure.iter().any(|e| (e - mean).abs() > MAX_BALANCE)
}

/// The silhouettes of a frame and the owners of its pixels.
struct FramePainting {
    owners: Owners,
    silhouettes: Vec<Silhouette>,
}

/// What the fit of body `k` amounts to; `None` where it is not seen.
fn placement(
    fitting: &FrameFit,
    likelihoods: &[&Likelihoods],
    k: usize,
    body: &FramedBody,
) -> Option<Placement> {
    let (visible, alike) = fitting.region(likelihoods).support(k);
    let spans = &fitting.silhouettes[k].spans;
    let whole = spans.area();
    let share = visible as f64 / spans.area_within(fitting.owners.size).max(1) as f64;
    if visible < LEAST_VISIBLE || share < LEAST_VISIBLE_SHARE {
        return None;
    }
    let likeness = alike as f64 / visible as f64;
    let fit = body.fit?;
    // A mirror shows its neighbours: where the outline fits, the look may change.
    if likeness < LEAST_LIKENESS && !is_outlined(body.fit) {
        return None;
    }
    let mut pose = fit.pose;
    pose.yaw = if pose.form == BodyForm::Cube { nearest_yaw(pose.yaw, body.predicted.yaw) } else { pose.yaw };
    Some(Placement {
        pose,
        covariance: plane_covariance(fitting.view, &fit),
        visible,
        whole,
        rms: fit.rms,
        support: fit.support,
        likeness,
    })
}

/// Whether the edges alone prove the body.
fn is_outlined(fit: Option<ContourFit>) -> bool {
    fit.is_some_and(|f| f.support >= SURE_SUPPORT && f.rms <= SURE_RMS)
}

/// Adds the body's inner pixels to its histogram and its appearance.
fn learn_look(track: &mut BodyTrack, fitting: &FrameFit, k: usize, ground: &Ground, shares: &[f32]) {
    const MARGIN: usize = 2;
    let (evidence, owner) = (fitting.evidence, k as u8 + 1);
    let [width, _] = evidence.size;
    let mut codes = vec![];
    let (_, ln) = &*LIGHT;
    for (row, a, b) in fitting.silhouettes[k].spans.clipped(evidence.size) {
        for u in (a + MARGIN)..b.saturating_sub(MARGIN) {
            let pixel = row * width + u;
            if fitting.owners.pixels[pixel] != owner {
                continue;
            }
            codes.push(evidence.codes[pixel]);
            let (Some(rgb), Some(g)) =
                (fitting.frame.rgb.get(3 * pixel..3 * pixel + 3), ground.ln_light.get(pixel))
            else {
                continue;
            };
            let d: [f32; 3] = std::array::from_fn(|c| ln[usize::from(rgb[c])] - g[c] - evidence.exposure[c]);
            let l = (d[0] + d[1] + d[2]) / 3.0;
            track.appearance.add(l, d[0] - l, d[2] - l);
        }
    }
    track.learn(codes.into_iter(), shares);
}

/// Adds the cost of each form in this frame; changes the form where another one is better.
fn compare_forms(track: &mut BodyTrack, index: usize, fitting: &FrameFit, k: usize, setting: &Setting) {
    let Some(placement) = track.placements[index] else { return };
    let target = FitTarget {
        view: fitting.view,
        frame: fitting.frame,
        evidence: fitting.evidence,
        owners: &fitting.owners,
        own: k as u8 + 1,
    };
    let mut fits = [None; 3];
    for (slot, form) in FORMS.iter().enumerate().filter(|(_, f)| setting.forms.contains(f)) {
        let quarter = std::f64::consts::FRAC_PI_2;
        let starts: &[f64] = match (*form, placement.pose.form) {
            (BodyForm::Cube, BodyForm::Cube) => &[0.0, CUBE_RESTART, -CUBE_RESTART],
            (BodyForm::Cube, _) => &[0.0, 0.25, 0.5, 0.75],
            _ => &[0.0],
        };
        for turn in starts {
            let pose = Pose { form: *form, yaw: placement.pose.yaw + turn * quarter, ..placement.pose };
            let growth = if setting.size.is_none() { SIZE_SHARE * pose.size } else { 0.0 };
            let prior = PosePrior { pose, deviations: [0.5 * pose.size, 0.5 * pose.size, 0.5, growth] };
            if let Some(fit) = target.fit(&prior, &pose, FINE, 4) {
                let better = fits[slot].is_none_or(|(cost, _)| form_cost(&fit) < cost);
                if better {
                    fits[slot] = Some((form_cost(&fit), fit));
                }
            }
        }
    }
    let worst = fits.iter().flatten().map(|f| f.0).fold(0.0, f64::max);
    for (sum, fit) in track.form_costs.iter_mut().zip(&fits) {
        *sum += fit.map_or(worst + 1.0, |f| f.0);
    }
    track.form_frames += 1;
    let best = track.best_form();
    let slot = FORMS.iter().position(|f| *f == best).unwrap_or(0);
    if let (Some((_, fit)), true) = (fits[slot], setting.size.is_none()) {
        // The mean of all frames so far.
        track.size += (fit.pose.size - track.size) / (track.form_frames + 1) as f64;
    }
    let own = target_cost(&placement);
    let is_better = fits[slot].is_some_and(|(cost, _)| cost < CLEARLY_BETTER * own);
    if best != track.form || (best == BodyForm::Cube && is_better && track.form_frames <= FIRST_FORM_FRAMES) {
        track.form = best;
        if let (Some((_, fit)), Some(p)) = (fits[slot], &mut track.placements[index]) {
            p.pose = fit.pose;
        }
    }
}

/// Cost of the outline of a placed body.
fn target_cost(placement: &Placement) -> f64 {
    placement.rms * placement.rms + 2.0 * (1.0 - placement.support)
}

/// Whether the pixels of a candidate look like a track's body.
fn alike(track: &BodyTrack, histogram: &ColourHistogram) -> bool {
    let shares = histogram.shares();
    let likely: f32 = shares.iter().zip(&track.likelihoods).filter(|(_, l)| **l > 0.0).map(|(s, _)| s).sum();
    likely > 0.6 * shares.iter().sum::<f32>()
}
