//! Detections of single frames to objects with tracks.
//!
//! Frame by frame, detections are assigned to tracks at the least total cost (Kuhn and Munkres): the squared distance from
//! where the track is expected at constant velocity, in the bird's-eye plane, and the disagreement of colour, material and
//! shape. Tracks outlive gaps; what has too few detections was none. Attributes are voted over each track; then its
//! detections are placed anew as bodies of the voted shape.

use super::camera::{Camera, CameraError};
use super::mask::BoundingBox;
use super::silhouette::place;
use super::{Covariance, DEFAULT_SIZE, MAX_FRAMES, MAX_OBJECTS, Object, Sample, Shape, Track};
use crate::num::Vec2;
use pathfinding::matrix::Matrix;
use pathfinding::prelude::kuhn_munkres_min;
use std::collections::BTreeMap;

/// Most detections of one video, and of one frame: an assignment's work grows with the third power.
pub const MAX_DETECTIONS: usize = 200_000;
pub const MAX_IN_FRAME: usize = 128;
/// Most tracks that are followed at a time.
const MAX_FOLLOWED: usize = 256;
/// How much a blow changes a velocity (object sizes a second, one deviation): 1.6 m/s for CLEVRER's objects.
const BLOW: f64 = 8.0;
/// Speed of a body that was seen once (sizes a second, one deviation).
const UNKNOWN_SPEED: f64 = 8.0;
/// Deviation from the expected place beyond which it is another body.
const GATE: f64 = 4.0;
/// Cost of a new track: more than a body at the gate that looks right, less than one that looks wrong there.
const NEW: f64 = 24.0;
/// Costs of a velocity that changed a moment ago, and of a false detection in a track.
const CHANGED: f64 = 2.0;
const FALSE: f64 = 8.0;
/// Share of detections whose attribute is wrong.
const WRONG: f64 = 0.08;
/// A track of fewer detections is none.
const FEWEST: usize = 3;
/// Longest gap (s) over which a track is followed by its motion; over a longer one its looks must agree in everything.
const GAP: f64 = 0.6;
/// Longest gap of a track that has fewer detections than a track needs (s).
const SHORT_GAP: f64 = 0.13;
/// Longest gap at all (s): a body hidden behind another.
const LONGEST_GAP: f64 = 3.0;
/// Samples that tell the velocity.
const RECENT: usize = 6;
/// Two bodies are never nearer than this share of the sum of their inscribed radii, but for the noise.
const INSIDE: f64 = 0.75;

/// How sure a detector is of each word.
pub type AttributeScores = BTreeMap<String, f64>;

/// What a detector found in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    pub frame: usize,
    /// Around the part of the body that is seen (px).
    pub bounds: BoundingBox,
    pub color: AttributeScores,
    pub material: AttributeScores,
    pub shape: AttributeScores,
    /// How sure it is of all this: its weight in votes.
    pub score: f64,
}

/// What is known beside the detections.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkOptions {
    /// Frames of the video.
    pub frames: usize,
    /// 1/s.
    pub fps: f64,
    pub camera: Camera,
    /// Radius or half side of every object (m).
    pub size: f64,
    /// Deviation of a box's edge (px).
    pub sigma: f64,
}

/// What was found, and what was done for it.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkedTracks {
    pub objects: Vec<Object>,
    pub tracks: Vec<Track>,
    /// For each object, the indices of its detections, in the order given.
    pub members: Vec<Vec<usize>>,
    pub camera: Camera,
    pub report: LinkReport,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinkReport {
    pub frames: usize,
    pub detections: usize,
    pub objects: usize,
    /// Gaps in tracks, and the frames in them.
    pub gaps_bridged: usize,
    pub frames_bridged: usize,
    /// Detections that are no object's.
    pub detections_dropped: usize,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LinkError {
    #[error("{given} detections were given; at most {MAX_DETECTIONS} are linked")]
    TooMany { given: usize },
    #[error("frame {frame}: {given} detections; at most {MAX_IN_FRAME} are linked")]
    Crowded { frame: usize, given: usize },
    #[error("of {given} detections none was followed over {FEWEST} frames; there is no object")]
    NoObject { given: usize },
    #[error("{found} objects were found; at most {MAX_OBJECTS} are allowed")]
    TooManyObjects { found: usize },
    #[error(transparent)]
    Camera(#[from] CameraError),
}

/// Objects and tracks of detections in any order. Deterministic.
pub fn link(detections: &[Detection], options: &LinkOptions) -> Result<LinkedTracks, LinkError> {
    if detections.len() > MAX_DETECTIONS {
        return Err(LinkError::TooMany { given: detections.len() });
    }
    let size = if options.size > 0.0 { options.size } else { DEFAULT_SIZE };
    let pixels: Vec<[f64; 2]> = detections.iter().map(|d| d.bounds.centre()).collect();
    let camera = options.camera.facing(&pixels, size)?;
    let options = LinkOptions { camera, size, ..*options };
    let mut by_frame: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, d) in detections.iter().enumerate().filter(|(_, d)| d.frame < MAX_FRAMES) {
        by_frame.entry(d.frame).or_default().push(i);
    }
    if let Some((frame, list)) = by_frame.iter().find(|(_, list)| list.len() > MAX_IN_FRAME) {
        return Err(LinkError::Crowded { frame: *frame, given: list.len() });
    }
    let mut paths = follow(detections, &by_frame, &options);
    paths.iter_mut().for_each(|p| p.trim(detections, options.fps));
    paths.retain(Path::is_object);
    // By first frame, then from left to right: independent of the order given.
    paths.sort_by(|a, b| {
        let key = |p: &Path| (p.seen[0].frame, p.seen[0].position.x, p.seen[0].position.y);
        let ((f, x, y), (g, u, v)) = (key(a), key(b));
        f.cmp(&g).then(x.total_cmp(&u)).then(y.total_cmp(&v))
    });
    if paths.is_empty() {
        return Err(LinkError::NoObject { given: detections.len() });
    }
    if paths.len() > MAX_OBJECTS {
        return Err(LinkError::TooManyObjects { found: paths.len() });
    }
    Ok(linked(detections, &by_frame, paths, &options))
}

/// A detection in its place.
#[derive(Clone, Copy)]
struct Seen {
    detection: usize,
    frame: usize,
    position: Vec2,
    covariance: Covariance,
}

/// A track that is being followed.
struct Path {
    seen: Vec<Seen>,
    votes: [AttributeScores; 3],
}

fn looks(d: &Detection) -> [&AttributeScores; 3] {
    [&d.color, &d.material, &d.shape]
}

impl Path {
    fn new(seen: Seen, detection: &Detection) -> Path {
        let mut path = Path { seen: vec![], votes: Default::default() };
        path.add(seen, detection);
        path
    }

    fn add(&mut self, seen: Seen, detection: &Detection) {
        self.seen.push(seen);
        for (votes, scores) in self.votes.iter_mut().zip(looks(detection)) {
            for (word, score) in scores {
                *votes.entry(word.clone()).or_insert(0.0) += score * detection.score;
            }
        }
    }

    /// Gives it a detection; where it fits much better without the last one, that was false and is taken out.
    fn extend(&mut self, seen: Seen, detections: &[Detection], options: &LinkOptions) {
        let detection = &detections[seen.detection];
        if self.cost(&seen, detection, options).is_some_and(|(_, last_is_false)| last_is_false) {
            self.remove_last(detections);
        }
        self.add(seen, detection);
    }

    /// Takes out what stands alone before or after it: false detections that it met when its body was not there.
    fn trim(&mut self, detections: &[Detection], fps: f64) {
        for _ in 0..2 {
            let apart = |k: &usize| {
                let (a, b) = (self.seen[k - 1].frame, self.seen[*k].frame);
                a.abs_diff(b) as f64 / fps > SHORT_GAP
            };
            let n = self.seen.len();
            let end = (n.saturating_sub(FEWEST - 1).max(1)..n).find(apart).unwrap_or(n);
            while self.seen.len() > end {
                self.remove_last(detections);
            }
            self.seen.reverse();
        }
    }

    /// Whether it has the detections of a body: false ones may lie near each other, but they hardly agree.
    fn is_object(&self) -> bool {
        let n = self.seen.len();
        let steady = || self.seen.windows(2).all(|w| w[1].frame - w[0].frame <= 2);
        let most = |votes: &AttributeScores| votes.values().copied().fold(0.0, f64::max);
        let agree = || self.votes.iter().all(|v| 2.0 * most(v) > v.values().sum::<f64>() || v.is_empty());
        n >= 2 * FEWEST || (n >= FEWEST && steady() && agree())
    }

    fn remove_last(&mut self, detections: &[Detection]) {
        let Some(detection) = self.seen.pop().map(|s| &detections[s.detection]) else { return };
        for (votes, scores) in self.votes.iter_mut().zip(looks(detection)) {
            for (word, score) in scores {
                if let Some(vote) = votes.get_mut(word) {
                    *vote -= score * detection.score;
                }
            }
        }
    }

    /// Cost of giving it a detection, and whether its last one must have been false; `None` if it cannot be its.
    fn cost(&self, seen: &Seen, detection: &Detection, options: &LinkOptions) -> Option<(f64, bool)> {
        let gap = seen.frame - self.seen.last()?.frame;
        let seconds = gap as f64 / options.fps;
        let (agrees, misfit) = self.likeness(detection);
        let longest = match (self.seen.len() >= FEWEST, agrees) {
            (false, _) => SHORT_GAP,
            (true, true) => LONGEST_GAP,
            (true, false) => GAP,
        };
        if gap > 2 && seconds > longest {
            return None;
        }
        // Its motion may have changed a moment ago, its last detection may have been false, or all but its last.
        let all = &self.seen[..];
        let but_last = &all[..all.len() - 1];
        let tried = [
            (distance(all, RECENT, seen, options), false),
            (distance(all, 3, seen, options).map(|d| d + CHANGED), false),
            (distance(all, 1, seen, options).map(|d| d + FALSE), false),
            (distance(but_last, RECENT, seen, options).map(|d| d + FALSE), true),
        ];
        let best = tried.into_iter().filter_map(|(d, last)| Some((d? + misfit, last)));
        best.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Whether the detection's best words are those voted so far, and minus twice the logarithm of the likelihood.
    fn likeness(&self, detection: &Detection) -> (bool, f64) {
        let (mut agrees, mut misfit) = (true, 0.0);
        for (votes, scores) in self.votes.iter().zip(looks(detection)) {
            let (all, own): (f64, f64) = (votes.values().sum(), scores.values().sum());
            if all <= 0.0 || own <= 0.0 {
                continue;
            }
            let both =
                scores.iter().map(|(word, s)| s * votes.get(word).copied().unwrap_or(0.0)).sum::<f64>();
            misfit -= 2.0 * (WRONG + (1.0 - WRONG) * both / (all * own)).ln();
            agrees &= winner(votes) == winner(scores);
        }
        (agrees, misfit)
    }
}

/// Squared distance, in deviations, of a detection from where these earlier ones lead, the last `window` of which tell the
/// velocity; the larger the region in which it might be, the more it costs. `None` beyond the gate.
fn distance(earlier: &[Seen], window: usize, seen: &Seen, options: &LinkOptions) -> Option<f64> {
    let recent = &earlier[earlier.len().saturating_sub(window)..];
    let last = recent.last()?;
    let gap = (seen.frame - last.frame) as f64;
    let n = recent.len() as f64;
    let time = |s: &Seen| s.frame as f64 - last.frame as f64;
    let (t, p) = recent.iter().fold((0.0, Vec2::zero()), |(t, p), s| (t + time(s), p + s.position));
    let (t, p) = (t / n, p.scaled(1.0 / n));
    let spread: f64 = recent.iter().map(|s| (time(s) - t).powi(2)).sum();
    let slope = recent.iter().map(|s| (s.position - p).scaled((time(s) - t) / spread.max(1e-9)));
    let velocity = slope.fold(Vec2::zero(), |a, b| a + b);
    let off = seen.position - last.position - velocity.scaled(gap);
    let speed = if recent.len() < 2 { BLOW.hypot(UNKNOWN_SPEED) } else { BLOW };
    let blow = (speed * options.size * gap / options.fps).powi(2);
    // The measurement, the one before, and the velocity that such measurements tell.
    let measured = 2.0 + if recent.len() < 2 { 0.0 } else { gap * gap / spread };
    let c = &seen.covariance;
    let total = Covariance { xx: measured * c.xx + blow, xy: measured * c.xy, yy: measured * c.yy + blow };
    let [xx, yx, yy] = total.factor()?;
    let a = off.x / xx;
    let b = (off.y - yx * a) / yy;
    let squares = a * a + b * b;
    let room = 2.0 * (xx * yy / (options.size * options.size)).ln().max(0.0);
    (squares <= GATE * GATE).then_some(squares + room)
}

/// The word with most votes; of equal ones the first in the alphabet.
fn winner(votes: &AttributeScores) -> Option<&str> {
    let best = votes.iter().reduce(|best, next| if next.1 > best.1 { next } else { best });
    best.map(|(word, _)| word.as_str())
}

fn shape(votes: &AttributeScores, size: f64) -> Shape {
    match winner(votes) {
        Some("sphere" | "ball") => Shape::Ball { radius: size },
        Some("cube" | "box" | "square" | "block") => Shape::Square { half_side: size },
        _ => Shape::Disc { radius: size },
    }
}

fn follow(
    detections: &[Detection],
    by_frame: &BTreeMap<usize, Vec<usize>>,
    options: &LinkOptions,
) -> Vec<Path> {
    let (mut followed, mut ended): (Vec<Path>, Vec<Path>) = (vec![], vec![]);
    for (&frame, list) in by_frame {
        let late = |p: &Path| {
            let gap = frame - p.seen[p.seen.len() - 1].frame;
            gap > 2 && gap as f64 / options.fps > if p.seen.len() < FEWEST { SHORT_GAP } else { LONGEST_GAP }
        };
        let (done, mut kept): (Vec<Path>, Vec<Path>) = followed.into_iter().partition(late);
        ended.extend(done);
        if kept.len() > MAX_FOLLOWED {
            let surplus = kept.len() - MAX_FOLLOWED;
            ended.extend(kept.drain(..surplus));
        }
        // A detection above the horizon is none of a body on the ground.
        let placed = |&i: &usize| {
            let d = &detections[i];
            let shape = shape(&d.shape, options.size);
            let (position, covariance) =
                place(&options.camera, &shape, &d.bounds, &[], options.sigma).ok()?;
            Some(Seen { detection: i, frame, position, covariance })
        };
        let mut here: Vec<Seen> = list.iter().filter_map(placed).collect();
        // The order given must not matter, also where two costs are equal.
        here.sort_by(|a, b| {
            a.position.x.total_cmp(&b.position.x).then(a.position.y.total_cmp(&b.position.y))
        });
        for (seen, path) in here.iter().zip(assign(&here, &kept, detections, options)) {
            match path {
                Some(path) => kept[path].extend(*seen, detections, options),
                None => kept.push(Path::new(*seen, &detections[seen.detection])),
            }
        }
        followed = kept;
    }
    ended.extend(followed);
    ended
}

/// For each detection its track, or none: a new one.
fn assign(
    here: &[Seen],
    paths: &[Path],
    detections: &[Detection],
    options: &LinkOptions,
) -> Vec<Option<usize>> {
    /// Costs as whole numbers, and one that is never chosen while a new track can be.
    const SCALE: f64 = 1e4;
    const NEVER: i64 = 1_000_000_000;
    if here.is_empty() {
        return vec![];
    }
    let cost = |row: usize, column: usize| match paths.get(column) {
        Some(path) => {
            let cost = path.cost(&here[row], &detections[here[row].detection], options);
            // A track that is not sure to be one gives way to one that is.
            let doubt = if path.seen.len() < FEWEST { 4.0 } else { 0.0 };
            cost.map_or(NEVER, |(c, _)| (SCALE * (c + doubt)) as i64)
        }
        None if column - paths.len() == row => (SCALE * NEW) as i64,
        None => NEVER,
    };
    let columns = paths.len() + here.len();
    let costs = (0..here.len()).flat_map(|row| (0..columns).map(move |c| (row, c))).map(|(r, c)| cost(r, c));
    let Ok(matrix) = Matrix::from_vec(here.len(), columns, costs.collect()) else {
        return vec![None; here.len()];
    };
    let (_, chosen) = kuhn_munkres_min(&matrix);
    let path = |(row, column): (usize, usize)| {
        (column < paths.len() && matrix[(row, column)] < NEVER).then_some(column)
    };
    chosen.into_iter().enumerate().map(path).collect()
}

/// Votes, and places each detection as the body that it is.
fn linked(
    detections: &[Detection],
    by_frame: &BTreeMap<usize, Vec<usize>>,
    paths: Vec<Path>,
    options: &LinkOptions,
) -> LinkedTracks {
    let word = |votes: &AttributeScores| winner(votes).unwrap_or_default().to_string();
    let object = |(id, p): (usize, &Path)| Object {
        id: id as u32,
        color: word(&p.votes[0]),
        material: word(&p.votes[1]),
        shape: shape(&p.votes[2], options.size),
        mass: None,
    };
    let objects: Vec<Object> = paths.iter().enumerate().map(object).collect();
    let mut taken: Vec<bool> = vec![false; detections.len()];
    paths.iter().flat_map(|p| &p.seen).for_each(|s| taken[s.detection] = true);
    let mut tracks: Vec<Track> = vec![];
    let mut members: Vec<Vec<usize>> = vec![];
    for (path, object) in paths.iter().zip(&objects) {
        let mut track = Track::default();
        let mut own = vec![];
        for seen in &path.seen {
            let bounds = &detections[seen.detection].bounds;
            // What reaches lower in the image is nearer to a camera that looks down.
            let hides = |i: &&usize| {
                **i != seen.detection && taken[**i] && detections[**i].bounds.bottom > bounds.bottom
            };
            let rivals = by_frame.get(&seen.frame).into_iter().flatten().filter(hides);
            let nearer: Vec<BoundingBox> = rivals.map(|&i| detections[i].bounds).collect();
            let placed = place(&options.camera, &object.shape, bounds, &nearer, options.sigma);
            let (position, covariance) = placed.unwrap_or((seen.position, seen.covariance));
            track.samples.push(Sample {
                frame: seen.frame,
                position,
                yaw: None,
                covariance: Some(covariance),
            });
            own.push(seen.detection);
        }
        tracks.push(track);
        members.push(own);
    }
    part(&objects, &mut tracks, &mut members);
    let gaps = tracks.iter().flat_map(|t| t.samples.windows(2)).map(|w| w[1].frame - w[0].frame - 1);
    let (bridged, missing) = gaps.filter(|&g| g > 0).fold((0, 0), |(n, sum), g| (n + 1, sum + g));
    let report = LinkReport {
        frames: options.frames,
        detections: detections.len(),
        objects: objects.len(),
        gaps_bridged: bridged,
        frames_bridged: missing,
        detections_dropped: detections.len() - members.iter().map(Vec::len).sum::<usize>(),
    };
    LinkedTracks { objects, tracks, members, camera: options.camera, report }
}

/// Where two bodies lie inside each other, the less certain sample is wrong.
fn part(objects: &[Object], tracks: &mut [Track], members: &mut [Vec<usize>]) {
    for b in 1..tracks.len() {
        for a in 0..b {
            let limit = INSIDE * (objects[a].shape.inscribed_radius() + objects[b].shape.inscribed_radius());
            let clash = |tracks: &[Track]| {
                tracks[b].samples.iter().enumerate().find_map(|(k, s)| {
                    let i = tracks[a].samples.binary_search_by_key(&s.frame, |o| o.frame).ok()?;
                    let other = &tracks[a].samples[i];
                    let variance = |s: &Sample| s.covariance.map_or(0.0, |c| c.mean());
                    let near = (other.position - s.position).norm() < limit;
                    near.then(|| if variance(other) > variance(s) { (a, i) } else { (b, k) })
                })
            };
            while let Some((track, sample)) = clash(tracks) {
                // A track that would vanish is kept; validation names it.
                if tracks[track].samples.len() < 2 {
                    break;
                }
                tracks[track].samples.remove(sample);
                members[track].remove(sample);
            }
        }
    }
}
