//! Positions where no object was: for a frame or a few a tracker took something else for it.

use super::{Sample, Scene, SceneError, Track};
use crate::num::Vec2;
use serde::{Deserialize, Serialize};

/// Frames in a row for which a tracker goes astray; more may be motion.
const LONGEST: usize = 3;
/// An object would have gone there and come back so many times as fast as the fastest of the video goes: what is struck is at most
/// twice as fast as what strikes it.
const FASTER: f64 = 2.0;
/// Share of the steps of a track that are no faster than it is said to go, two at least being faster: outliers make these.
const USUALLY: f64 = 0.9;
/// Before and after, it is on one way: the step over the gap is at most so many times what it goes in that time.
const ON_ITS_WAY: f64 = 1.5;
/// Distance in median deviations of a sample from the line through its neighbours (10 standard deviations), and in sizes of
/// the object, from which a sample is astray.
const FAR: f64 = 7.0;
const FAR_BY_SIZE: f64 = 0.25;
/// Steps on either side of which the median tells how fast it goes: two may be to another outlier and back, or hold a bounce.
const STEPS: usize = 5;
/// Most frames from the sample before to the one after: in a longer gap it may have gone there.
const GAP: usize = 8;
/// One may hide another near it.
const LOOKS: usize = 3;

/// A sample that was set aside.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Outlier {
    /// Index of the object.
    pub object: usize,
    pub sample: Sample,
    /// Distance from where the object was, by the samples before and after (m).
    #[serde(rename = "off")]
    pub distance: f64,
}

impl Scene {
    /// The scene with its outliers set aside; or everything that is wrong with it.
    pub fn validate(mut self) -> Result<Scene, SceneError> {
        let (tracks, outliers) = self.parted();
        self.check(&tracks)?;
        (self.tracks, self.outliers) = (tracks, outliers);
        Ok(self)
    }

    /// Its tracks without outliers, and these. What is wrong with the scene otherwise does no harm.
    pub(super) fn parted(&self) -> (Vec<Track>, Vec<Outlier>) {
        let (mut tracks, mut outliers) = (self.tracks.clone(), self.outliers.clone());
        let fastest = tracks.iter().map(|track| fast(&timed(track, &self.times))).fold(0.0, f64::max);
        for (object, (track, thing)) in tracks.iter_mut().zip(&self.objects).enumerate() {
            let found =
                astray(timed(track, &self.times), fastest, FAR_BY_SIZE * thing.shape.inscribed_radius());
            track.samples.retain(|s| found.iter().all(|(outlier, _)| outlier.frame != s.frame));
            outliers.extend(found.into_iter().map(|(sample, distance)| Outlier { object, sample, distance }));
        }
        (tracks, outliers)
    }

    /// All that was measured of an object, its outliers among it.
    pub fn all_samples(&self, object: usize) -> Vec<Sample> {
        let own = self.tracks.get(object).into_iter().flat_map(|t| &t.samples);
        let outliers = self.outliers.iter().filter(|s| s.object == object).map(|s| &s.sample);
        let mut all: Vec<Sample> = own.chain(outliers).copied().collect();
        all.sort_by_key(|s| s.frame);
        all
    }
}

fn timed(track: &Track, times: &[f64]) -> Vec<(f64, Sample)> {
    track.samples.iter().filter_map(|s| Some((*times.get(s.frame)?, *s))).collect()
}

/// Speeds from sample to sample (m/s), the slowest first.
fn speeds(seen: &[(f64, Sample)]) -> Vec<f64> {
    let speed = |w: &[(f64, Sample)]| (w[1].1.position - w[0].1.position).norm() / (w[1].0 - w[0].0);
    let mut speeds: Vec<f64> = seen.windows(2).map(speed).filter(|v| v.is_finite()).collect();
    speeds.sort_by(f64::total_cmp);
    speeds
}

/// How fast an object goes at most (m/s).
fn fast(seen: &[(f64, Sample)]) -> f64 {
    let speeds = speeds(seen);
    let usual = (USUALLY * speeds.len() as f64) as usize;
    speeds.get(usual.min(speeds.len().saturating_sub(3))).copied().unwrap_or(0.0)
}

/// Samples that are astray, by frame, and how far (m), at least `least` (m), where nothing is faster than `fastest` (m/s).
fn astray(mut seen: Vec<(f64, Sample)>, fastest: f64, least: f64) -> Vec<(Sample, f64)> {
    let mut found = vec![];
    let far = f64::max(least, FAR * usual(&seen));
    for _ in 0..LOOKS {
        let before = seen.len();
        let mut at = 1;
        while at + 1 < seen.len() {
            let run = (1..=LONGEST).find_map(|run| Some((run, run_astray(&seen, at, run, fastest, far)?)));
            if let Some((run, offs)) = run {
                found.extend(seen.drain(at..at + run).map(|(_, sample)| sample).zip(offs));
            }
            at += 1;
        }
        if seen.len() == before {
            break;
        }
    }
    found.sort_by_key(|(sample, _)| sample.frame);
    found
}

/// Median distance of samples from the line through their neighbours (m).
fn usual(seen: &[(f64, Sample)]) -> f64 {
    let off = |w: &[(f64, Sample)]| (w[1].1.position - between(&w[0], &w[2], w[1].0)).norm();
    let mut offs: Vec<f64> = seen.windows(3).map(off).collect();
    let middle = offs.len() / 2;
    if offs.is_empty() { 0.0 } else { *offs.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Where it was at a time on the straight line from one sample to another.
fn between(a: &(f64, Sample), b: &(f64, Sample), time: f64) -> Vec2 {
    a.1.position + (b.1.position - a.1.position).scaled((time - a.0) / (b.0 - a.0))
}

/// How far `run` samples from `at` on are astray, if they are.
fn run_astray(seen: &[(f64, Sample)], at: usize, run: usize, fastest: f64, far: f64) -> Option<Vec<f64>> {
    let (before, gone, after) = (seen.get(..at)?, seen.get(at..at + run)?, seen.get(at + run..)?);
    let (last, next, first, end) = (before.last()?, after.first()?, gone.first()?, gone.last()?);
    let step = |a: &(f64, Sample), b: &(f64, Sample)| (b.1.position - a.1.position).norm();
    let leaps = |a, b: &(f64, Sample), speed: f64| step(a, b) > FASTER * speed * (b.0 - a.0) + far;
    // Nearly all samples end here.
    if !leaps(last, first, fastest) || !leaps(end, next, fastest) {
        return None;
    }
    let usual = |side: &[(f64, Sample)]| {
        let speeds = speeds(side);
        speeds.get(speeds.len().saturating_sub(1) / 2).copied()
    };
    let sides = [&before[at.saturating_sub(STEPS + 1)..], &after[..after.len().min(STEPS + 1)]];
    let speed = sides.into_iter().filter_map(usual).max_by(f64::total_cmp)?;
    let home = next.1.frame.abs_diff(last.1.frame) <= GAP
        && step(last, next) < ON_ITS_WAY * speed * (next.0 - last.0) + far;
    let off = |s: &(f64, Sample)| (s.1.position - between(last, next, s.0)).norm();
    let offs: Vec<f64> = gone.iter().map(off).collect();
    (home && leaps(last, first, speed) && leaps(end, next, speed) && offs.iter().all(|off| *off > far))
        .then_some(offs)
}

#[cfg(test)]
mod tests {
    use super::super::{Object, Shape, WorldKind};
    use super::*;
    use crate::num::vec2;
    use proptest::prelude::*;

    /// A disc of .2 m filmed at 25 frames/s.
    fn filmed(positions: Vec<Vec2>) -> Scene {
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
            }],
            tracks: vec![Track { samples: positions.into_iter().enumerate().map(sample).collect() }],
            outliers: vec![],
        }
    }

    /// A deviation of about `size` (m) that no two frames share.
    fn shaken(frame: usize, size: f64) -> Vec2 {
        let at = frame as f64;
        vec2((12.9 * at).sin(), (78.2 * at).cos()).scaled(size)
    }

    proptest! {
        #[test]
        fn a_frame_or_a_few_far_away_are_set_aside_and_nothing_is_lost(
            start in 3..40usize, run in 1..=3usize, angle in 0.0..6.0f64, far in 0.35..2.0f64, speed in 0.0..1.2f64
        ) {
            let way = |f: usize| vec2(speed * f as f64 / 25.0, 0.0) + shaken(f, 0.005);
            let leapt = |f: usize| (start..start + run).contains(&f);
            let away = Vec2::from_angle(angle).scaled(far);
            let scene = filmed((0..50).map(|f| if leapt(f) { way(f) + away } else { way(f) }).collect());
            let accepted = scene.clone().validate().unwrap();
            let frames: Vec<usize> = accepted.outliers.iter().map(|s| s.sample.frame).collect();
            prop_assert_eq!(frames, (start..start + run).collect::<Vec<_>>());
            prop_assert!(accepted.outliers.iter().all(|s| (s.distance - far).abs() < 0.05));
            prop_assert_eq!(accepted.all_samples(0), scene.tracks[0].samples.clone());
        }

        #[test]
        fn hits_and_rests_are_motion(frame in 2..47usize, part in 0.0..1.0f64, before in -3.0..3.0f64, after in -3.0..3.0f64, noise in 0.0..0.005f64) {
            let hit = (frame as f64 + part) / 25.0;
            let way = |f: usize| {
                let t = f as f64 / 25.0 - hit;
                vec2(if t < 0.0 { before * t } else { after * t }, 0.0) + shaken(f, noise)
            };
            prop_assert!(filmed((0..50).map(way).collect()).validate().unwrap().outliers.is_empty());
        }
    }

    #[test]
    fn what_bounces_to_and_fro_between_few_frames_is_motion() {
        // 3 m/s between walls .4 m apart, 25 frames/s: a bounce every three to four frames.
        let way = |f: usize| {
            let along = (3.0 * f as f64 / 25.0) % 0.8;
            vec2(if along < 0.4 { along } else { 0.8 - along }, 0.0) + shaken(f, 0.002)
        };
        assert!(filmed((0..50).map(way).collect()).validate().unwrap().outliers.is_empty());
    }

    #[test]
    fn a_tracker_that_stays_away_says_that_the_object_is_there() {
        let way = |f: usize| vec2(if (20..26).contains(&f) { 0.8 } else { 0.0 }, 0.0) + shaken(f, 0.005);
        assert!(filmed((0..50).map(way).collect()).validate().unwrap().outliers.is_empty());
    }
}
