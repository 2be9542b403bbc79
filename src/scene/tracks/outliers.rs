//! Tracking outliers: a few frames in which a tracker followed something other than its object.
//!
//! A run of 1 to [`MAX_RUN`] samples at frames between samples `a` (before) and `b` (after) is an outlier if all of these hold,
//! with positions x (m), times t (s), a typical speed v (m/s) and a threshold d (m):
//! - the jump to the run and the jump back are too fast: `|dx| > MIN_SPEED_RATIO v dt + d`;
//! - without the run the motion is ordinary: `|x_b - x_a| < MAX_GAP_SPEED_RATIO v (t_b - t_a) + d`, over a gap of at most
//!   [`MAX_GAP_FRAMES`] frames;
//! - each sample of the run is farther than d from the straight line between a and b.
//!
//! `v` is the larger of the median step speeds over the [`NEIGHBOUR_STEPS`] steps before and after the run. Jumps must also be
//! too fast for the fastest object of the video: in an elastic collision the hit body leaves at most twice as fast as
//! the hitting body came. `d = max(MIN_DISTANCE_SIZES r, MIN_DISTANCE_DEVIATIONS m)` with r the inscribed radius (m) and m the
//! median distance (m) of samples from the line between their neighbours: for independent normal noise of standard deviation
//! sigma a coordinate, `m = 1.177 sqrt(3/2) sigma`, so that `7 m` is about `10 sigma`. The search repeats, as one outlier can
//! hide another next to it. The method and its thresholds are ours.

use crate::num::{Vec2, quantile};
use crate::scene::observation::{Outlier, Sample, Scene, Track};
use std::ops::Range;

/// Longest run of outliers (frames); a longer one may be motion.
const MAX_RUN: usize = 3;
/// Least speed of a jump to and from an outlier, in units of the object's usual speed and of the video's top speed.
const MIN_SPEED_RATIO: f64 = 2.0;
/// Quantile of a track's step speeds taken as its top speed; at least the two fastest steps are excluded, as outliers cause them.
const TOP_SPEED_QUANTILE: f64 = 0.9;
/// Largest speed from the sample before to the sample after, in units of the usual speed.
const MAX_GAP_SPEED_RATIO: f64 = 1.5;
/// Least distance of an outlier in median deviations (about 10 standard deviations of a position).
const MIN_DISTANCE_DEVIATIONS: f64 = 7.0;
/// Least distance of an outlier in inscribed radii of the object.
const MIN_DISTANCE_SIZES: f64 = 0.25;
/// Steps on each side that give the usual speed. The median tolerates two steps to and from another outlier, or a collision.
const NEIGHBOUR_STEPS: usize = 5;
/// Most frames from the sample before to the sample after; in a longer gap the object may have travelled there.
const MAX_GAP_FRAMES: usize = 8;
/// Searches of a track: an outlier may hide another one near it.
const SEARCHES: usize = 3;

/// The tracks of a scene without outliers, and all outliers. The scene need not be valid.
pub(in crate::scene) fn reject_outliers(scene: &Scene) -> (Vec<Track>, Vec<Outlier>) {
    let (mut tracks, mut outliers) = (scene.tracks.clone(), scene.outliers.clone());
    let top_speed = tracks.iter().map(|track| top_speed(&timed(track, &scene.times))).fold(0.0, f64::max);
    for (index, (track, object)) in tracks.iter_mut().zip(&scene.objects).enumerate() {
        let least = MIN_DISTANCE_SIZES * object.shape.inscribed_radius();
        let found = find_outliers(timed(track, &scene.times), top_speed, least);
        track.samples.retain(|s| found.iter().all(|(outlier, _)| outlier.frame != s.frame));
        outliers.extend(found.into_iter().map(|(sample, distance)| Outlier {
            object: index,
            sample,
            distance,
        }));
    }
    (tracks, outliers)
}

/// Samples with their times (s).
fn timed(track: &Track, times: &[f64]) -> Vec<(f64, Sample)> {
    track.samples.iter().filter_map(|s| Some((*times.get(s.frame)?, *s))).collect()
}

/// Speeds from sample to sample (m/s), the slowest first.
fn speeds(samples: &[(f64, Sample)]) -> Vec<f64> {
    let speed = |w: &[(f64, Sample)]| (w[1].1.position - w[0].1.position).norm() / (w[1].0 - w[0].0);
    let mut speeds: Vec<f64> = samples.windows(2).map(speed).filter(|v| v.is_finite()).collect();
    speeds.sort_by(f64::total_cmp);
    speeds
}

/// Top speed of an object (m/s), outliers excluded.
fn top_speed(samples: &[(f64, Sample)]) -> f64 {
    let speeds = speeds(samples);
    let usual = (TOP_SPEED_QUANTILE * speeds.len() as f64) as usize;
    speeds.get(usual.min(speeds.len().saturating_sub(3))).copied().unwrap_or(0.0)
}

/// Outliers by frame with their distances (m), at least `least` (m); `top_speed` (m/s) is that of the video.
fn find_outliers(mut samples: Vec<(f64, Sample)>, top_speed: f64, least: f64) -> Vec<(Sample, f64)> {
    let mut found = vec![];
    let threshold = f64::max(least, MIN_DISTANCE_DEVIATIONS * median_deviation(&samples));
    for _ in 0..SEARCHES {
        let before = samples.len();
        let mut at = 1;
        while at + 1 < samples.len() {
            let run = (1..=MAX_RUN)
                .find_map(|run| Some((run, run_distances(&samples, at..at + run, top_speed, threshold)?)));
            if let Some((run, distances)) = run {
                found.extend(samples.drain(at..at + run).map(|(_, sample)| sample).zip(distances));
            }
            at += 1;
        }
        if samples.len() == before {
            break;
        }
    }
    found.sort_by_key(|(sample, _)| sample.frame);
    found
}

/// Median distance of samples from the line between their neighbours (m).
fn median_deviation(samples: &[(f64, Sample)]) -> f64 {
    let distance = |w: &[(f64, Sample)]| (w[1].1.position - interpolate(&w[0], &w[2], w[1].0)).norm();
    let mut distances: Vec<f64> = samples.windows(3).map(distance).collect();
    quantile(&mut distances, 0.5).unwrap_or(0.0)
}

/// Position at a time (s) on the straight line from one sample to another.
fn interpolate(a: &(f64, Sample), b: &(f64, Sample), time: f64) -> Vec2 {
    a.1.position + (b.1.position - a.1.position).scaled((time - a.0) / (b.0 - a.0))
}

/// Distances (m) of the samples `run` from the line between their neighbours, if the run is an outlier by the module's rules.
fn run_distances(
    samples: &[(f64, Sample)],
    run: Range<usize>,
    top_speed: f64,
    threshold: f64,
) -> Option<Vec<f64>> {
    let (before, inside, after) =
        (samples.get(..run.start)?, samples.get(run.clone())?, samples.get(run.end..)?);
    let (last, next, first, end) = (before.last()?, after.first()?, inside.first()?, inside.last()?);
    let step = |a: &(f64, Sample), b: &(f64, Sample)| (b.1.position - a.1.position).norm();
    let jumps =
        |a, b: &(f64, Sample), speed: f64| step(a, b) > MIN_SPEED_RATIO * speed * (b.0 - a.0) + threshold;
    // Nearly all samples end here.
    if !jumps(last, first, top_speed) || !jumps(end, next, top_speed) {
        return None;
    }
    let median_speed = |side: &[(f64, Sample)]| {
        let speeds = speeds(side);
        speeds.get(speeds.len().saturating_sub(1) / 2).copied()
    };
    let sides = [
        &before[run.start.saturating_sub(NEIGHBOUR_STEPS + 1)..],
        &after[..after.len().min(NEIGHBOUR_STEPS + 1)],
    ];
    let speed = sides.into_iter().filter_map(median_speed).max_by(f64::total_cmp)?;
    let continues = next.1.frame.abs_diff(last.1.frame) <= MAX_GAP_FRAMES
        && step(last, next) < MAX_GAP_SPEED_RATIO * speed * (next.0 - last.0) + threshold;
    let distance = |s: &(f64, Sample)| (s.1.position - interpolate(last, next, s.0)).norm();
    let distances: Vec<f64> = inside.iter().map(distance).collect();
    (continues
        && jumps(last, first, speed)
        && jumps(end, next, speed)
        && distances.iter().all(|distance| *distance > threshold))
    .then_some(distances)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::vec2;
    use crate::scene::{Object, Shape, WorldKind};
    use proptest::prelude::*;

    /// A disc of 0.2 m at 25 frames/s.
    fn video(positions: Vec<Vec2>) -> Scene {
        let sample = |(frame, position)| Sample { frame, position, yaw: Some(0.0), covariance: None };
        Scene {
            name: "one".into(),
            setup: None,
            world: WorldKind::Table,
            fps: 25.0,
            times: (0..positions.len()).map(|f| f as f64 / 25.0).collect(),
            camera: None,
            table: None,
            noise_sigma: None,
            objects: vec![Object {
                id: 4,
                color: String::new(),
                material: String::new(),
                shape: Shape::Disc { radius: 0.2 },
                mass: None,
                features: vec![],
            }],
            tracks: vec![Track { samples: positions.into_iter().enumerate().map(sample).collect() }],
            outliers: vec![],
            findings: vec![],
            feature_layout: None,
            absent: vec![],
        }
    }

    /// A deviation of about `size` (m), different in each frame.
    fn shaken(frame: usize, size: f64) -> Vec2 {
        let at = frame as f64;
        vec2((12.9 * at).sin(), (78.2 * at).cos()).scaled(size)
    }

    proptest! {
        #[test]
        fn one_to_three_distant_frames_are_outliers_and_are_kept_as_such(
            start in 3..40usize, run in 1..=3usize, angle in 0.0..6.0f64, far in 0.35..2.0f64, speed in 0.0..1.2f64
        ) {
            let way = |f: usize| vec2(speed * f as f64 / 25.0, 0.0) + shaken(f, 0.005);
            let jumped = |f: usize| (start..start + run).contains(&f);
            let away = Vec2::from_angle(angle).scaled(far);
            let scene = video((0..50).map(|f| if jumped(f) { way(f) + away } else { way(f) }).collect());
            let accepted = scene.clone().validate().unwrap();
            let frames: Vec<usize> = accepted.outliers.iter().map(|s| s.sample.frame).collect();
            prop_assert_eq!(frames, (start..start + run).collect::<Vec<_>>());
            prop_assert!(accepted.outliers.iter().all(|s| (s.distance - far).abs() < 0.05));
            prop_assert_eq!(accepted.all_samples(0), scene.tracks[0].samples.clone());
        }

        #[test]
        fn collisions_and_rest_are_motion(frame in 2..47usize, part in 0.0..1.0f64, before in -3.0..3.0f64, after in -3.0..3.0f64, noise in 0.0..0.005f64) {
            let hit = (frame as f64 + part) / 25.0;
            let way = |f: usize| {
                let t = f as f64 / 25.0 - hit;
                vec2(if t < 0.0 { before * t } else { after * t }, 0.0) + shaken(f, noise)
            };
            prop_assert!(video((0..50).map(way).collect()).validate().unwrap().outliers.is_empty());
        }
    }

    #[test]
    fn bouncing_every_few_frames_is_motion() {
        // 3 m/s between walls .4 m apart, 25 frames/s: a bounce every three to four frames.
        let way = |f: usize| {
            let along = (3.0 * f as f64 / 25.0) % 0.8;
            vec2(if along < 0.4 { along } else { 0.8 - along }, 0.0) + shaken(f, 0.002)
        };
        assert!(video((0..50).map(way).collect()).validate().unwrap().outliers.is_empty());
    }

    #[test]
    fn a_jump_of_six_frames_and_back_is_no_motion() {
        let way = |f: usize| vec2(if (20..26).contains(&f) { 0.8 } else { 0.0 }, 0.0) + shaken(f, 0.005);
        let frames = |s: &Outlier| s.sample.frame;
        let outliers = video((0..50).map(way).collect()).validate().unwrap().outliers;
        assert_eq!(outliers.iter().map(frames).collect::<Vec<_>>(), (20..26).collect::<Vec<_>>());
    }
}
