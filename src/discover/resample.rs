//! Scenes at the frame rate that their noise is worth. All that looks at motion frame by frame needs steps that are larger than the noise.
//!
//! Frames in which nothing was seen are dropped. Of the others, k neighbouring ones become one at their mean time: the largest odd k
//! for which an object that moves as fast as the fastest of the video still moves by at most `STEP` deviations of the mean position,
//! v k dt <= STEP sigma / sqrt(k), and k dt is at most `LONGEST`. A kink of the path within such a frame is then below the noise.

use super::revise::Revision;
use crate::fit::estimate_noise;
use crate::num::{Vec2, quantile};
use crate::scene::{Covariance, Sample, Scene, Track};
use crate::world::{Model, Preset};
use std::borrow::Cow;

/// Deviations of a position by which the fastest object moves in a frame.
const STEP: f64 = 4.0;
/// Longest frame (s): what happens in contacts is not followed in longer ones.
const LONGEST: f64 = 0.02;
/// Time over which a speed is measured (s): over one frame, noise would be speed.
const SPEED_TIME: f64 = 0.1;

/// Scenes for the search, and where their frames are in the ones that were given.
pub struct Resampled<'a> {
    pub scenes: Cow<'a, [Scene]>,
    /// By scene: the frame that each frame stands for.
    frames: Vec<Vec<usize>>,
}

/// The scenes themselves where no frame is to be dropped or joined with others.
pub fn resampled(scenes: &[Scene]) -> Resampled<'_> {
    let frames: Vec<Vec<usize>> = scenes.iter().map(seen_frames).collect();
    let joined: Vec<usize> = scenes.iter().zip(&frames).map(|(s, frames)| joined(s, frames)).collect();
    let as_given = |(k, scene): (usize, &Scene)| joined[k] == 1 && frames[k].len() == scene.times.len();
    if scenes.iter().enumerate().all(as_given) {
        return Resampled { scenes: Cow::Borrowed(scenes), frames };
    }
    let all = scenes.iter().zip(&frames).zip(&joined).map(|((s, frames), k)| one(s, frames, *k));
    let (scenes, frames): (Vec<Scene>, Vec<Vec<usize>>) = all.unzip();
    Resampled { scenes: Cow::Owned(scenes), frames }
}

impl Resampled<'_> {
    /// The frame of a scene as it was given.
    pub fn frame(&self, scene: usize, frame: usize) -> usize {
        self.frames.get(scene).and_then(|frames| frames.get(frame)).copied().unwrap_or(frame)
    }

    /// The models for these scenes: a preset's is made again, so that it is known as one.
    pub fn models(&self, given: &[Scene], models: &[Model]) -> Vec<Model> {
        let one = |((model, given), scene): ((&Model, &Scene), &Scene)| {
            let preset = Preset::named(&model.preset).filter(|preset| preset.model(given) == *model);
            preset.map_or_else(|| model.clone(), |preset| preset.model(scene))
        };
        models.iter().zip(given).zip(self.scenes.iter()).map(one).collect()
    }

    /// Lets the models of a revision begin where the scenes that were given do.
    pub fn restore(&self, given: &[Scene], revision: &mut Revision) {
        if matches!(self.scenes, Cow::Owned(_)) {
            let fits = revision.fit.scenes.iter_mut().zip(given);
            for (k, (fit, scene)) in fits.enumerate() {
                begin_with(scene, &mut fit.model);
                fit.model.impulses.iter_mut().for_each(|i| i.frame = self.frame(k, i.frame));
            }
        }
    }
}

/// Frames in which any object was seen.
fn seen_frames(scene: &Scene) -> Vec<usize> {
    let mut seen = vec![false; scene.times.len()];
    for sample in scene.tracks.iter().flat_map(|t| &t.samples) {
        if let Some(seen) = seen.get_mut(sample.frame) {
            *seen = true;
        }
    }
    (0..seen.len()).filter(|f| seen[*f]).collect()
}

/// How many frames become one: an odd number.
fn joined(scene: &Scene, frames: &[usize]) -> usize {
    let mut gaps: Vec<f64> = frames.windows(2).map(|w| scene.times[w[1]] - scene.times[w[0]]).collect();
    let Some(frame_time) = quantile(&mut gaps, 0.5) else { return 1 };
    let noise = estimate_noise(scene).position;
    let fastest = scene.tracks.iter().map(|track| speed(scene, track)).fold(0.0, f64::max);
    let worth = |k: &usize| {
        let (time, number) = (*k as f64 * frame_time, *k as f64);
        time <= LONGEST && fastest * time <= STEP * noise / number.sqrt()
    };
    (1..frames.len().max(2)).step_by(2).take_while(|k| *k == 1 || worth(k)).last().unwrap_or(1)
}

/// The speed that a track rarely exceeds (m/s).
pub fn speed(scene: &Scene, track: &Track) -> f64 {
    let time = |s: &Sample| scene.time_of(s.frame);
    let later = |a: &Sample| track.samples.partition_point(|b| time(b) < time(a) + SPEED_TIME);
    let pairs = track.samples.iter().filter_map(|a| Some((a, track.samples.get(later(a))?)));
    let one = |(a, b): (&Sample, &Sample)| (b.position - a.position).norm() / (time(b) - time(a));
    let mut speeds: Vec<f64> = pairs.map(one).filter(|v| v.is_finite()).collect();
    quantile(&mut speeds, 0.9).unwrap_or(0.0)
}

/// The scene with `k` of these frames in one, and the frame in the middle of each.
fn one(scene: &Scene, frames: &[usize], k: usize) -> (Scene, Vec<usize>) {
    let blocks: Vec<&[usize]> = frames.chunks_exact(k).collect();
    let mean_time = |block: &&[usize]| block.iter().map(|f| scene.times[*f]).sum::<f64>() / k as f64;
    let track = |track: &Track| {
        let of = |(frame, block): (usize, &&[usize])| {
            let samples: Option<Vec<&Sample>> = block.iter().map(|f| track.at(*f)).collect();
            Some(mean(frame, &samples?))
        };
        Track { samples: blocks.iter().enumerate().filter_map(of).collect() }
    };
    let times = blocks.iter().map(mean_time).collect();
    let tracks = scene.tracks.iter().map(track).collect();
    let coarse = Scene { times, tracks, fps: scene.fps / k as f64, outliers: vec![], ..scene.clone() };
    // What nobody saw in any whole block stays as it was: a scene without it would be another one.
    let whole =
        coarse.tracks.iter().zip(&scene.tracks).all(|(a, b)| !a.samples.is_empty() || b.samples.is_empty());
    match whole {
        true => (coarse, blocks.iter().map(|block| block[k / 2]).collect()),
        false => (scene.clone(), (0..scene.times.len()).collect()),
    }
}

/// The mean of samples in neighbouring frames.
fn mean(frame: usize, samples: &[&Sample]) -> Sample {
    let share = 1.0 / samples.len() as f64;
    let position = samples.iter().fold(Vec2::zero(), |sum, s| sum + s.position).scaled(share);
    let first = samples.first().and_then(|s| s.yaw);
    let turned = |s: &&Sample| Some(first? + crate::num::wrap_angle(s.yaw? - first?));
    let yaws: Option<Vec<f64>> = samples.iter().map(turned).collect();
    let yaw = yaws.map(|yaws| yaws.iter().sum::<f64>() * share);
    let stated: Option<Vec<Covariance>> = samples.iter().map(|s| s.covariance).collect();
    let sum =
        |all: &[Covariance], of: fn(&Covariance) -> f64| all.iter().map(of).sum::<f64>() * share * share;
    let covariance = stated.map(|all| Covariance {
        xx: sum(&all, |c| c.xx),
        xy: sum(&all, |c| c.xy),
        yy: sum(&all, |c| c.yy),
    });
    Sample { frame, position, yaw, covariance }
}

/// Lets each body begin at its first sample; between the two times, which differ by less than a frame, it moves uniformly.
fn begin_with(scene: &Scene, model: &mut Model) {
    for (body, track) in model.bodies.iter_mut().zip(&scene.tracks) {
        let Some(first) = track.samples.first() else { continue };
        let time = scene.time_of(first.frame);
        let earlier = body.start.time - time;
        let state = &mut body.start.state;
        state.position -= state.velocity.scaled(earlier);
        state.yaw -= state.spin * earlier;
        body.start.time = time;
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{DISC, film};
    use super::*;
    use crate::num::vec2;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn a_film_of_many_frames_is_looked_at_in_fewer() {
        let scenes = film(&[vec![(DISC, 0.6, [-0.5, 0.0], [0.3, 0.0])]], None);
        assert!(matches!(resampled(&scenes).scenes, Cow::Borrowed(_)), "25 frames/s are as they are");
        // The same motion in a thousand frames a second.
        let mut fast = scenes[0].clone();
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        fast.times = (0..1000).map(|f| f as f64 / 1000.0).collect();
        let mut sample = |f: usize| Sample {
            frame: f,
            position: vec2(-0.5 + 0.0003 * f as f64, 0.0) + vec2(noise(), noise()).scaled(0.005),
            yaw: None,
            covariance: None,
        };
        fast.tracks[0].samples = (0..1000).map(&mut sample).collect();
        let given = [fast];
        let coarse = resampled(&given);
        let frames = coarse.scenes[0].times.len();
        assert!((40..90).contains(&frames), "{frames}");
        assert!((coarse.scenes[0].times[0] - given[0].times[coarse.frame(0, 0)]).abs() < 1e-9);
        // Frames in which nothing was seen are dropped.
        let mut sparse = scenes.clone();
        sparse[0].tracks[0].samples.retain(|s| s.frame % 2 == 0);
        let dense = resampled(&sparse);
        assert_eq!(dense.scenes[0].times.len(), scenes[0].times.len().div_ceil(2));
        assert_eq!(dense.frame(0, 3), 6);
    }
}
