//! Frames to tracks: predict, fit together, find new bodies, and follow each new one back to where it came into view.

use super::body_track::{BodyTrack, Placement, nearest_yaw, plane_covariance};
use super::candidates::{Candidate, Component, Search, components, form_cost, near_silhouettes};
use crate::media::VideoFrame;
use crate::num::Vec2;
use crate::perception::image::colour_histogram::{ColourHistogram, Likelihoods};
use crate::perception::image::evidence::{CODE_MASK, Evidence, IS_BODY};
use crate::perception::image::ground::Ground;
use crate::perception::image::light::LIGHT;
use crate::perception::outlines::contour_fit::{ContourFit, FINE, FitTarget, PosePrior};
use crate::perception::outlines::depth_order::{MAX_BODIES_IN_FRAME, NOBODY, Owners, Silhouette};
use crate::perception::outlines::frame_fit::{FrameFit, FramedBody};
use crate::perception::outlines::outline::{BodyForm, FORMS, Pose};
use crate::perception::outlines::viewpoint::Viewpoint;
use std::collections::VecDeque;

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
/// Least size of a body as a share of the largest one, where sizes are fitted: less is a piece of a shadow or of a reflection.
const LEAST_SIZE_SHARE: f64 = 0.35;
/// Deviation of a fitted size as a share of the size.
const SIZE_SHARE: f64 = 0.2;
/// Frames in which a new body must be seen to be one.
const LEAST_FRAMES: usize = 4;
/// Share of a silhouette inside the image from which a body at the border is taken up: less is ambiguous. It is followed back to
/// where it entered. A component that stays, or one of the last frame, is taken up with less.
const INSIDE: f64 = 0.88;
const LEAST_INSIDE: f64 = 0.35;
const STAYING: usize = 12;
/// Most components of one frame that are examined, the largest first: more are texture, not bodies.
const MAX_EXAMINED: usize = 8;
/// A component that stays is examined every so many frames.
const RETRIAL: usize = 4;
/// Share of the image that bodies cover at most: more means that the camera moved or the scene was cut.
const MAX_BODY_SHARE: f64 = 0.4;

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
    ground_histogram: ColourHistogram,
    ground_shares: Vec<f32>,
    /// The last frames, for following new bodies back.
    past: VecDeque<(usize, VideoFrame)>,
    past_limit: usize,
}

impl Tracker {
    /// `past_limit`: frames that are kept.
    pub fn new(setting: Setting, past_limit: usize) -> Tracker {
        Tracker {
            setting,
            tracks: vec![],
            counts: Counts::default(),
            ground_histogram: ColourHistogram::default(),
            ground_shares: vec![],
            past: VecDeque::new(),
            past_limit,
        }
    }

    /// Takes the next frame.
    pub fn step(&mut self, index: usize, frame: VideoFrame) {
        let evidence = Evidence::new(&frame, &self.setting.ground);
        self.counts.exposure.push(evidence.exposure);
        if evidence.body_share() > MAX_BODY_SHARE {
            self.counts.covered_frames.push(index);
            return;
        }
        if self.ground_shares.is_empty() {
            self.learn_ground(&evidence, None);
        }
        let owners = self.place_all(index, &frame, &evidence);
        let found = self.find_new(index, &frame, &evidence, owners);
        self.past.push_back((index, frame));
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
        loop {
            let near = near_silhouettes(&painting.silhouettes, evidence.size);
            let open = components(evidence, &painting.owners, &near);
            if open.is_empty() && index.is_multiple_of(10) {
                self.learn_ground(evidence, Some((&painting.owners, &near)));
            }
            let known = |c: &Component| {
                refused.iter().any(|r| r.bounds == c.bounds && r.pixels.len() == c.pixels.len())
            };
            let Some(component) = open.into_iter().find(|c| !known(c)) else { break };
            let last = index + 1 == self.setting.times.len();
            let stays = last || self.stays(&component, index);
            let wait =
                (component.touches_border(evidence.size) && !stays) || self.was_refused(&component, index);
            examined += usize::from(!wait);
            if wait || examined > MAX_EXAMINED {
                refused.push(component);
                continue;
            }
            if painting.silhouettes.len() >= MAX_BODIES_IN_FRAME {
                break;
            }
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
            };
            let Some(candidate) = search.best(&component) else {
                refused.push(component);
                continue;
            };
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
            covariance: plane_covariance(&fit.covariance),
            visible: 1,
            whole: 1,
            rms: fit.rms,
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
        let mut at = self.past.iter().rposition(|(k, _)| *k == index);
        while let Some(place) = at {
            let Some((k, frame)) = self.past.get(place).cloned() else { break };
            at = place.checked_sub(1);
            if k != index && self.tracks[track].placements[k].is_some() {
                break;
            }
            let evidence = Evidence::new(&frame, &self.setting.ground);
            let mut bodies = self.bodies_around(track, k, k == index);
            self.fit_and_record(k, (&frame, &evidence), &mut bodies, true);
            unseen = if self.tracks[track].missed > 0 { unseen + 1 } else { 0 };
            self.tracks[track].missed = 0;
            if unseen > MAX_UNSEEN {
                break;
            }
        }
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
        self.tracks.retain(|t| t.placed_frames() >= LEAST_FRAMES);
        if self.setting.size.is_none() {
            let largest = self.tracks.iter().map(|t| t.size).fold(0.0, f64::max);
            self.tracks.retain(|t| t.size >= LEAST_SIZE_SHARE * largest);
        }
        for track in &mut self.tracks {
            track.form = track.best_form();
        }
    }
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
        covariance: plane_covariance(&fit.covariance),
        visible,
        whole,
        rms: fit.rms,
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
        let starts: &[f64] = if *form == BodyForm::Cube && placement.pose.form != BodyForm::Cube {
            &[0.0, 0.25, 0.5, 0.75]
        } else {
            &[0.0]
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
    if best != track.form {
        track.form = best;
        if let (Some((_, fit)), Some(p)) = (fits[slot], &mut track.placements[index]) {
            p.pose = fit.pose;
        }
    }
}

/// Whether the pixels of a candidate look like a track's body.
fn alike(track: &BodyTrack, histogram: &ColourHistogram) -> bool {
    let shares = histogram.shares();
    let likely: f32 = shares.iter().zip(&track.likelihoods).filter(|(_, l)| **l > 0.0).map(|(s, _)| s).sum();
    likely > 0.6 * shares.iter().sum::<f32>()
}
