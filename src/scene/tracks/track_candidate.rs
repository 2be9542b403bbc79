//! A track under construction, and the cost of giving it one more detection.
//!
//! With the detection at x, its covariance C (m^2) and the track's last samples, the cost is the least over four hypotheses of
//! `D + penalty + M`:
//! - motion: `D = e^T S^-1 e + 2 ln max(1, sqrt(det S) / L^2)`, the squared Mahalanobis distance plus the log volume, with
//!   `e = x - x_last - v g` (m), g the gap (frames), L the object's size (m), v (m/frame) the regression slope of the last
//!   positions, and `S = (2 + g^2 / sum (t - mean t)^2) C + (w L g / fps)^2 I`. The terms are the noise of both positions, that of v,
//!   and a velocity changed by an impulse of standard deviation w sizes/s. Distances beyond [`GATE`] are refused;
//! - hypotheses: v from the last [`VELOCITY_SAMPLES`] samples; from the last 3, if the velocity has just changed
//!   ([`CHANGED_COST`]); from the last one only, if the others are false; without the last one, if that is false ([`FALSE_COST`]);
//! - look: `M = -2 sum ln(q + (1 - q) p)` over colour, material and shape, with q the share of wrong attributes and p the
//!   probability that votes and detection name the same word.
//!
//! Source: nearest-neighbour data association with gating, Bar-Shalom and Fortmann, Tracking and Data Association (1988); the
//! hypotheses and their costs are ours.

use crate::num::{Vec2, elementary};
use crate::scene::covariance::Covariance;
use crate::scene::object::Shape;
use crate::scene::tracks::detection::{AttributeScores, Detection, LinkOptions};

/// Standard deviation of the change of velocity in a collision (sizes/s): 1.6 m/s for CLEVRER's objects.
const COLLISION_SPEED: f64 = 8.0;
/// Standard deviation of the speed of a body with a single detection (sizes/s).
const UNKNOWN_SPEED: f64 = 8.0;
/// Largest Mahalanobis distance from the expected position.
const GATE: f64 = 4.0;
/// Cost of a velocity that has just changed.
const CHANGED_COST: f64 = 2.0;
/// Cost of a false detection in a track.
const FALSE_COST: f64 = 8.0;
/// Share of detections with a wrong attribute.
const WRONG_SHARE: f64 = 0.08;
/// Fewest detections of an object.
pub(super) const MIN_DETECTIONS: usize = 3;
/// Longest gap (s) over which motion alone continues a track; over a longer one all attributes must agree.
const MOTION_GAP: f64 = 0.6;
/// Longest gap (s) of a track with fewer than [`MIN_DETECTIONS`] detections.
pub(super) const SHORT_GAP: f64 = 0.13;
/// Longest gap (s) of any track: a body hidden behind another.
pub(super) const LONGEST_GAP: f64 = 3.0;
/// Samples that give the velocity.
const VELOCITY_SAMPLES: usize = 6;

/// A detection with its position on the ground plane.
#[derive(Clone, Copy)]
pub(super) struct PlacedDetection {
    /// Index among the detections given.
    pub detection: usize,
    pub frame: usize,
    /// m.
    pub position: Vec2,
    pub covariance: Covariance,
}

/// A track under construction.
pub(super) struct TrackCandidate {
    /// By frame.
    pub placed: Vec<PlacedDetection>,
    /// Votes for colour, material and shape.
    pub votes: [AttributeScores; 3],
}

/// Colour, material and shape.
fn attributes(d: &Detection) -> [&AttributeScores; 3] {
    [&d.color, &d.material, &d.shape]
}

impl TrackCandidate {
    pub(super) fn new(first: PlacedDetection, detection: &Detection) -> TrackCandidate {
        let mut candidate = TrackCandidate { placed: vec![], votes: Default::default() };
        candidate.add(first, detection);
        candidate
    }

    fn add(&mut self, next: PlacedDetection, detection: &Detection) {
        self.placed.push(next);
        for (votes, scores) in self.votes.iter_mut().zip(attributes(detection)) {
            for (word, score) in scores {
                *votes.entry(word.clone()).or_insert(0.0) += score * detection.score;
            }
        }
    }

    /// Adds a detection; removes the last one where the track fits much better without it.
    pub(super) fn extend(&mut self, next: PlacedDetection, detections: &[Detection], options: &LinkOptions) {
        let detection = &detections[next.detection];
        if self.cost(&next, detection, options).is_some_and(|(_, last_is_false)| last_is_false) {
            self.remove_last(detections);
        }
        self.add(next, detection);
    }

    /// Removes isolated detections at both ends: false ones, found while the body was not in view.
    pub(super) fn trim(&mut self, detections: &[Detection], fps: f64) {
        for _ in 0..2 {
            let is_after_gap = |k: &usize| {
                let (a, b) = (self.placed[k - 1].frame, self.placed[*k].frame);
                a.abs_diff(b) as f64 / fps > SHORT_GAP
            };
            let n = self.placed.len();
            let end = (n.saturating_sub(MIN_DETECTIONS - 1).max(1)..n).find(is_after_gap).unwrap_or(n);
            while self.placed.len() > end {
                self.remove_last(detections);
            }
            self.placed.reverse();
        }
    }

    /// Whether its detections are those of a body: few ones must be in adjacent frames and agree in their attributes.
    pub(super) fn is_object(&self) -> bool {
        let n = self.placed.len();
        let steady = || self.placed.windows(2).all(|w| w[1].frame - w[0].frame <= 2);
        let most = |votes: &AttributeScores| votes.values().copied().fold(0.0, f64::max);
        let agree = || self.votes.iter().all(|v| 2.0 * most(v) > v.values().sum::<f64>() || v.is_empty());
        n >= 2 * MIN_DETECTIONS || (n >= MIN_DETECTIONS && steady() && agree())
    }

    fn remove_last(&mut self, detections: &[Detection]) {
        let Some(detection) = self.placed.pop().map(|s| &detections[s.detection]) else { return };
        for (votes, scores) in self.votes.iter_mut().zip(attributes(detection)) {
            for (word, score) in scores {
                if let Some(vote) = votes.get_mut(word) {
                    *vote -= score * detection.score;
                }
            }
        }
    }

    /// Cost of adding a detection, and whether the last one is false by the best hypothesis; `None` where it cannot belong.
    pub(super) fn cost(
        &self,
        next: &PlacedDetection,
        detection: &Detection,
        options: &LinkOptions,
    ) -> Option<(f64, bool)> {
        let gap = next.frame - self.placed.last()?.frame;
        let seconds = gap as f64 / options.fps;
        let (agrees, misfit) = self.look(detection);
        let longest = match (self.placed.len() >= MIN_DETECTIONS, agrees) {
            (false, _) => SHORT_GAP,
            (true, true) => LONGEST_GAP,
            (true, false) => MOTION_GAP,
        };
        if gap > 2 && seconds > longest {
            return None;
        }
        // The hypotheses of the module's doc.
        let all = &self.placed[..];
        let but_last = &all[..all.len() - 1];
        let tried = [
            (distance(all, VELOCITY_SAMPLES, next, options), false),
            (distance(all, 3, next, options).map(|d| d + CHANGED_COST), false),
            (distance(all, 1, next, options).map(|d| d + FALSE_COST), false),
            (distance(but_last, VELOCITY_SAMPLES, next, options).map(|d| d + FALSE_COST), true),
        ];
        let best = tried.into_iter().filter_map(|(d, last)| Some((d? + misfit, last)));
        best.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Whether the detection's best words are the voted ones, and the cost M of its look.
    fn look(&self, detection: &Detection) -> (bool, f64) {
        let (mut agrees, mut misfit) = (true, 0.0);
        for (votes, scores) in self.votes.iter().zip(attributes(detection)) {
            let (all, own): (f64, f64) = (votes.values().sum(), scores.values().sum());
            if all <= 0.0 || own <= 0.0 {
                continue;
            }
            let both =
                scores.iter().map(|(word, s)| s * votes.get(word).copied().unwrap_or(0.0)).sum::<f64>();
            misfit -= 2.0 * elementary::ln(WRONG_SHARE + (1.0 - WRONG_SHARE) * both / (all * own));
            agrees &= top_word(votes) == top_word(scores);
        }
        (agrees, misfit)
    }
}

/// The cost D of the motion from `earlier` to `next`, with the velocity of the last `window` samples; `None` beyond the gate.
fn distance(
    earlier: &[PlacedDetection],
    window: usize,
    next: &PlacedDetection,
    options: &LinkOptions,
) -> Option<f64> {
    let recent = &earlier[earlier.len().saturating_sub(window)..];
    let last = recent.last()?;
    let gap = (next.frame - last.frame) as f64;
    let n = recent.len() as f64;
    let time = |s: &PlacedDetection| s.frame as f64 - last.frame as f64;
    let (t, p) = recent.iter().fold((0.0, Vec2::zero()), |(t, p), s| (t + time(s), p + s.position));
    let (t, p) = (t / n, p.scaled(1.0 / n));
    let spread: f64 = recent.iter().map(|s| elementary::powi(time(s) - t, 2)).sum();
    let slope = recent.iter().map(|s| (s.position - p).scaled((time(s) - t) / spread.max(1e-9)));
    let velocity = slope.fold(Vec2::zero(), |a, b| a + b);
    let error = next.position - last.position - velocity.scaled(gap);
    let speed =
        if recent.len() < 2 { elementary::hypot(COLLISION_SPEED, UNKNOWN_SPEED) } else { COLLISION_SPEED };
    let impulse = elementary::powi(speed * options.size * gap / options.fps, 2);
    // Variances of this measurement, the last one, and the velocity, in units of one measurement's.
    let measured = 2.0 + if recent.len() < 2 { 0.0 } else { gap * gap / spread };
    let c = &next.covariance;
    let total =
        Covariance { xx: measured * c.xx + impulse, xy: measured * c.xy, yy: measured * c.yy + impulse };
    let [xx, yx, yy] = total.factor()?;
    let a = error.x / xx;
    let b = (error.y - yx * a) / yy;
    let squares = a * a + b * b;
    let volume = 2.0 * elementary::ln(xx * yy / (options.size * options.size)).max(0.0);
    (squares <= GATE * GATE).then_some(squares + volume)
}

/// The word with most votes; of equal ones the first in the alphabet.
pub(super) fn top_word(votes: &AttributeScores) -> Option<&str> {
    let best = votes.iter().reduce(|best, next| if next.1 > best.1 { next } else { best });
    best.map(|(word, _)| word.as_str())
}

/// The shape with most votes, of radius or half side `size` (m).
pub(super) fn voted_shape(votes: &AttributeScores, size: f64) -> Shape {
    match top_word(votes) {
        Some("sphere" | "ball") => Shape::Ball { radius: size },
        Some("cube" | "box" | "square" | "block") => Shape::Square { half_side: size },
        _ => Shape::Disc { radius: size },
    }
}
