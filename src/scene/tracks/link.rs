//! Links detections of single frames to tracks of objects.
//!
//! In each frame detections (rows) are assigned to tracks or to new tracks (columns) at the least total cost, by the algorithm of
//! Kuhn (1955) and Munkres (1957). The cost of giving a detection to a track is minus twice a log likelihood up to a constant;
//! `track_candidate` derives it. A new track costs [`NEW_TRACK_COST`].
//!
//! 1. Each detection is placed on the ground plane with its covariance (`silhouette`).
//! 2. Frame by frame, detections are assigned; tracks continue over gaps.
//! 3. Tracks with too few detections are dropped; attributes are decided by votes weighted with confidence, and so is the mean of
//!    the features.
//! 4. Detections are placed again with the voted shape. Where two bodies overlap, the less certain sample is dropped.

use crate::num::{Stop, Stopped};
use crate::scene::camera::projection::{Camera, CameraError};
use crate::scene::limits::{DEFAULT_SIZE, MAX_FRAMES, MAX_OBJECTS};
use crate::scene::object::Object;
use crate::scene::observation::{Sample, Track};
use crate::scene::tracks::detection::{AttributeScores, Detection, LinkOptions};
use crate::scene::tracks::mask::BoundingBox;
use crate::scene::tracks::silhouette::place;
use crate::scene::tracks::track_candidate::{
    LONGEST_GAP, MIN_DETECTIONS, PlacedDetection, SHORT_GAP, TrackCandidate, top_word, voted_shape,
};
use pathfinding::matrix::Matrix;
use pathfinding::prelude::kuhn_munkres_min;
use std::collections::BTreeMap;

/// Most detections of one video.
pub const MAX_DETECTIONS: usize = 200_000;
/// Most detections of one frame: the work of an assignment grows with the third power.
pub const MAX_IN_FRAME: usize = 128;
/// Most tracks followed at a time.
const MAX_FOLLOWED: usize = 256;
/// Cost of a new track: more than a body at the gate with the right look, less than one with a wrong look there.
const NEW_TRACK_COST: f64 = 24.0;
/// Added cost of a track with fewer detections than an object needs: it gives way to a confirmed one.
const UNCONFIRMED_COST: f64 = 4.0;
/// Samples that are placed between two checks of the stop token.
const STOP_EVERY: usize = 256;
/// Least distance of two bodies as a share of the sum of their inscribed radii.
const MIN_SEPARATION: f64 = 0.75;

/// Objects and tracks linked from detections.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkedTracks {
    pub objects: Vec<Object>,
    pub tracks: Vec<Track>,
    /// For each object, the indices of its detections among those given.
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
    /// Detections that belong to no object.
    pub detections_dropped: usize,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LinkError {
    #[error("detections: {given} were given; give at most {MAX_DETECTIONS}")]
    TooMany { given: usize },
    #[error("frame {frame}: has {given} detections; give at most {MAX_IN_FRAME}")]
    Crowded { frame: usize, given: usize },
    #[error(
        "detections: none of the {given} belongs to a track of {MIN_DETECTIONS} frames; give detections over more frames"
    )]
    NoObject { given: usize },
    #[error("detections: {found} objects were found; at most {MAX_OBJECTS} are allowed")]
    TooManyObjects { found: usize },
    #[error(transparent)]
    Camera(#[from] CameraError),
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

/// Objects and tracks from detections in any order. Deterministic.
pub fn link(detections: &[Detection], options: &LinkOptions, stop: Stop) -> Result<LinkedTracks, LinkError> {
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
    let mut candidates = follow(detections, &by_frame, &options, stop)?;
    candidates.iter_mut().for_each(|p| p.trim(detections, options.fps));
    candidates.retain(TrackCandidate::is_object);
    // By first frame, then from left to right: independent of the order given.
    candidates.sort_by(|a, b| {
        let key = |p: &TrackCandidate| (p.placed[0].frame, p.placed[0].position.x, p.placed[0].position.y);
        let ((f, x, y), (g, u, v)) = (key(a), key(b));
        f.cmp(&g).then(x.total_cmp(&u)).then(y.total_cmp(&v))
    });
    if candidates.is_empty() {
        return Err(LinkError::NoObject { given: detections.len() });
    }
    if candidates.len() > MAX_OBJECTS {
        return Err(LinkError::TooManyObjects { found: candidates.len() });
    }
    linked((detections, &by_frame), candidates, &options, stop)
}

/// Assigns detections to tracks, frame by frame.
fn follow(
    detections: &[Detection],
    by_frame: &BTreeMap<usize, Vec<usize>>,
    options: &LinkOptions,
    stop: Stop,
) -> Result<Vec<TrackCandidate>, Stopped> {
    let (mut followed, mut ended): (Vec<TrackCandidate>, Vec<TrackCandidate>) = (vec![], vec![]);
    for (&frame, list) in by_frame {
        stop(frame as f64 / options.frames.max(1) as f64)?;
        let ended_before = |p: &TrackCandidate| {
            let gap = frame - p.placed[p.placed.len() - 1].frame;
            gap > 2
                && gap as f64 / options.fps
                    > if p.placed.len() < MIN_DETECTIONS { SHORT_GAP } else { LONGEST_GAP }
        };
        let (done, mut kept): (Vec<TrackCandidate>, Vec<TrackCandidate>) =
            followed.into_iter().partition(ended_before);
        ended.extend(done);
        if kept.len() > MAX_FOLLOWED {
            let surplus = kept.len() - MAX_FOLLOWED;
            ended.extend(kept.drain(..surplus));
        }
        // A detection above the horizon is not of a body on the ground.
        let placed = |&i: &usize| {
            let d = &detections[i];
            let shape = voted_shape(&d.shape, options.size);
            let (position, covariance) =
                place(&options.camera, &shape, &d.bounds, &[], options.sigma).ok()?;
            Some(PlacedDetection { detection: i, frame, position, covariance })
        };
        let mut here: Vec<PlacedDetection> = list.iter().filter_map(placed).collect();
        // Sorted, so that the order given does not matter where two costs are equal.
        here.sort_by(|a, b| {
            a.position.x.total_cmp(&b.position.x).then(a.position.y.total_cmp(&b.position.y))
        });
        for (member, candidate) in here.iter().zip(assign(&here, &kept, detections, options)) {
            match candidate {
                Some(candidate) => kept[candidate].extend(*member, detections, options),
                None => kept.push(TrackCandidate::new(*member, &detections[member.detection])),
            }
        }
        followed = kept;
    }
    ended.extend(followed);
    Ok(ended)
}

/// For each detection the index of its track; `None`: a new one.
fn assign(
    here: &[PlacedDetection],
    candidates: &[TrackCandidate],
    detections: &[Detection],
    options: &LinkOptions,
) -> Vec<Option<usize>> {
    /// Whole numbers per unit of cost.
    const SCALE: f64 = 1e4;
    /// Cost of a forbidden assignment: more than all new tracks together.
    const NEVER: i64 = 1_000_000_000;
    if here.is_empty() {
        return vec![];
    }
    let cost = |row: usize, column: usize| match candidates.get(column) {
        Some(candidate) => {
            let cost = candidate.cost(&here[row], &detections[here[row].detection], options);
            let doubt = if candidate.placed.len() < MIN_DETECTIONS { UNCONFIRMED_COST } else { 0.0 };
            cost.map_or(NEVER, |(c, _)| (SCALE * (c + doubt)) as i64)
        }
        None if column - candidates.len() == row => (SCALE * NEW_TRACK_COST) as i64,
        None => NEVER,
    };
    let columns = candidates.len() + here.len();
    let costs = (0..here.len()).flat_map(|row| (0..columns).map(move |c| (row, c))).map(|(r, c)| cost(r, c));
    let Ok(matrix) = Matrix::from_vec(here.len(), columns, costs.collect()) else {
        return vec![None; here.len()];
    };
    let (_, chosen) = kuhn_munkres_min(&matrix);
    let candidate = |(row, column): (usize, usize)| {
        (column < candidates.len() && matrix[(row, column)] < NEVER).then_some(column)
    };
    chosen.into_iter().enumerate().map(candidate).collect()
}

/// Decides attributes by votes, and places each detection again with the voted shape.
fn linked(
    (detections, by_frame): (&[Detection], &BTreeMap<usize, Vec<usize>>),
    candidates: Vec<TrackCandidate>,
    options: &LinkOptions,
    stop: Stop,
) -> Result<LinkedTracks, LinkError> {
    let word = |votes: &AttributeScores| top_word(votes).unwrap_or_default().to_string();
    let object = |(id, p): (usize, &TrackCandidate)| Object {
        id: id as u32,
        color: word(&p.votes[0]),
        material: word(&p.votes[1]),
        shape: voted_shape(&p.votes[2], options.size),
        mass: None,
        features: vec![],
    };
    let mut objects: Vec<Object> = candidates.iter().enumerate().map(object).collect();
    let mut taken: Vec<bool> = vec![false; detections.len()];
    candidates.iter().flat_map(|p| &p.placed).for_each(|s| taken[s.detection] = true);
    let mut tracks: Vec<Track> = vec![];
    let mut members: Vec<Vec<usize>> = vec![];
    for (candidate, object) in candidates.iter().zip(&objects) {
        let mut track = Track::default();
        let mut own = vec![];
        for (k, member) in candidate.placed.iter().enumerate() {
            if k % STOP_EVERY == 0 {
                stop(1.0)?;
            }
            let bounds = &detections[member.detection].bounds;
            // For a camera that looks down, a body that reaches lower in the image is nearer.
            let hides = |i: &&usize| {
                **i != member.detection && taken[**i] && detections[**i].bounds.bottom > bounds.bottom
            };
            let rivals = by_frame.get(&member.frame).into_iter().flatten().filter(hides);
            let nearer: Vec<BoundingBox> = rivals.map(|&i| detections[i].bounds).collect();
            let placed = place(&options.camera, &object.shape, bounds, &nearer, options.sigma);
            let (position, covariance) = placed.unwrap_or((member.position, member.covariance));
            track.samples.push(Sample {
                frame: member.frame,
                position,
                yaw: None,
                covariance: Some(covariance),
            });
            own.push(member.detection);
        }
        tracks.push(track);
        members.push(own);
    }
    separate(&objects, &mut tracks, &mut members, stop)?;
    for (object, own) in objects.iter_mut().zip(&members) {
        object.features = mean_features(own.iter().map(|&i| &detections[i]));
    }
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
    Ok(LinkedTracks { objects, tracks, members, camera: options.camera, report })
}

/// The mean features of the detections that have some, weighted by their scores.
fn mean_features<'a>(members: impl Iterator<Item = &'a Detection>) -> Vec<f32> {
    let (mut sums, mut weight) = (vec![], 0.0);
    for member in members.filter(|d| !d.features.is_empty()) {
        sums.resize(member.features.len(), 0.0);
        weight += member.score;
        sums.iter_mut().zip(&member.features).for_each(|(sum, &f)| *sum += member.score * f64::from(f));
    }
    sums.into_iter().map(|sum| (sum / weight) as f32).collect()
}

/// Drops the less certain of two samples of a frame that put two bodies inside each other.
fn separate(
    objects: &[Object],
    tracks: &mut [Track],
    members: &mut [Vec<usize>],
    stop: Stop,
) -> Result<(), Stopped> {
    for b in 1..tracks.len() {
        for a in 0..b {
            let limit =
                MIN_SEPARATION * (objects[a].shape.inscribed_radius() + objects[b].shape.inscribed_radius());
            let clash = |tracks: &[Track]| {
                tracks[b].samples.iter().enumerate().find_map(|(k, s)| {
                    let i = tracks[a].samples.binary_search_by_key(&s.frame, |o| o.frame).ok()?;
                    let other = &tracks[a].samples[i];
                    let variance = |s: &Sample| s.covariance.map_or(0.0, |c| c.mean());
                    let near = (other.position - s.position).norm() < limit;
                    near.then(|| if variance(other) > variance(s) { (a, i) } else { (b, k) })
                })
            };
            stop(1.0)?;
            while let Some((track, sample)) = clash(tracks) {
                // The last sample of a track is kept; validation reports the overlap.
                if tracks[track].samples.len() < 2 {
                    break;
                }
                tracks[track].samples.remove(sample);
                members[track].remove(sample);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_are_means_weighted_by_scores() {
        let bounds = BoundingBox { left: 0.0, top: 0.0, right: 1.0, bottom: 1.0 };
        let detection = |score: f64, features: &[f32]| {
            let (color, material, shape) = Default::default();
            Detection { frame: 0, bounds, color, material, shape, score, features: features.to_vec() }
        };
        let members = [detection(0.75, &[1.0, 0.0]), detection(0.5, &[]), detection(0.25, &[5.0, -4.0])];
        assert_eq!(mean_features(members.iter()), [2.0, -1.0]);
        assert_eq!(mean_features(members[1..2].iter()), [0.0; 0]);
    }
}
