//! Frames that the camera lost though numbers and times go on: all objects leap ahead at once.
//!
//! The numbers n_k >= 0 of frames that are lost after each frame k are sought together: for given n of its neighbours, chi-square of one
//! parabola an object on both sides of pair k, its later samples n_k frame times later (`sides`), says by how much n_k is better than none. The search
//! starts from the lengths of steps, sum_j d_jk . v_j / sum_j |v_j|^2 over objects j with their usual steps v_j, and is improved pair by
//! pair, the greatest fall first, until nothing falls: lost frames in one place have the price `proof` (iterated conditional modes: Besag, J. Roy. Stat. Soc. B 48
//! (1986) 259). A contact changes velocities, which no n explains;
//! where one is near, fewer samples beside the pair are taken.

use crate::num::{Stop, Stopped, Vec2, quantile};
use crate::scene::measurement::finding::{FindingKind, TrackFinding};
use crate::scene::measurement::position_sds;
use crate::scene::measurement::sides::{Remains, Sides, proof};
use crate::scene::observation::{Sample, Scene};

/// Most frames that are lost in one place.
const MOST: usize = 25;
/// Samples on each side whose median step is the usual one.
const NEAR: usize = 6;
/// Deviations of a step's length, and greatest distance from a whole number of frames, that begin a search.
const CLEAR: f64 = 6.0;
const WHOLE: f64 = 0.25;
/// Improvements for each pair, at most: each lowers the deviance, so that this is never reached but by round-off.
const ROUNDS: usize = 4;

/// Shifts the times after lost frames, and says so.
pub fn take_in_lost_frames(
    scene: &mut Scene,
    step: f64,
    stop: Stop,
) -> Result<Option<TrackFinding>, Stopped> {
    let mut gaps: Vec<f64> = scene.times.windows(2).map(|w| w[1] - w[0]).collect();
    let pairs = gaps.len();
    let Some(frame_time) = quantile(&mut gaps, 0.5) else { return Ok(None) };
    let noises = position_sds(scene, step);
    let mut search = LostFrames { given: scene.times.clone(), lost: vec![0; pairs], frame_time, noises };
    let mut start = vec![];
    for frame in 0..pairs {
        stop(0.0)?;
        start.push(search.by_step_lengths(scene, frame));
    }
    for (frame, n) in start.into_iter().enumerate().filter(|(_, n)| *n > 0) {
        stop(0.0)?;
        search.set(scene, frame, n);
    }
    search.improve(scene, stop)?;
    search.drop_unproven(scene, stop)?;
    let frames: Vec<usize> = (0..pairs).filter(|frame| search.lost[*frame] > 0).collect();
    let value = search.lost.iter().sum::<usize>() as f64;
    let kind = FindingKind::LostFrames;
    Ok((!frames.is_empty()).then_some(TrackFinding { kind, objects: vec![], frames, value }))
}

/// How many frames are lost after each; the scene's times have them.
struct LostFrames {
    /// Times as they were given (s).
    given: Vec<f64>,
    lost: Vec<usize>,
    /// s.
    frame_time: f64,
    /// m.
    noises: Vec<f64>,
}

impl LostFrames {
    fn set(&mut self, scene: &mut Scene, frame: usize, lost: usize) {
        self.lost[frame] = lost;
        let before: usize = self.lost[..frame].iter().sum();
        let sums = self.lost[frame..].iter().scan(before, |sum, n| {
            *sum += n;
            Some(*sum)
        });
        // From the given times, so that what is taken back leaves no round-off.
        for ((time, given), sum) in
            scene.times[frame + 1..].iter_mut().zip(&self.given[frame + 1..]).zip(sums)
        {
            *time = given + sum as f64 * self.frame_time;
        }
    }

    /// The number of lost frames that the lengths of all objects' steps show; 0 unless it is clear and whole.
    fn by_step_lengths(&self, scene: &Scene, frame: usize) -> usize {
        let (mut along, mut square) = (0.0, 0.0);
        for (track, noise) in scene.tracks.iter().zip(&self.noises) {
            if let Some((over, usual)) = steps(&track.samples, frame) {
                along += over.dot(usual) / (noise * noise);
                square += usual.norm_squared() / (noise * noise);
            }
        }
        let more = along / square.max(f64::MIN_POSITIVE) - 1.0;
        let whole = (more - more.round()).abs() < WHOLE;
        let clear = more * (square / 2.0).sqrt() > CLEAR;
        if whole && clear && more < MOST as f64 + WHOLE { more.round() as usize } else { 0 }
    }

    /// The number after a frame that leaves least, if that is noise or none, and how far chi-square falls from the present one.
    fn best(&self, scene: &Scene, frame: usize) -> Option<(usize, f64)> {
        let wide = Sides::of(scene, frame, &self.noises);
        if self.lost[frame] == 0 && !wide.leap() {
            return None;
        }
        self.best_of(&wide, frame).or_else(|| self.best_of(&Sides::nearer(scene, frame, &self.noises), frame))
    }

    fn best_of(&self, sides: &Sides, frame: usize) -> Option<(usize, f64)> {
        let now = self.lost[frame];
        let price = |n: usize| self.remains(sides, frame, n).chi_square + self.price(n);
        let best = (0..=MOST).map(|n| (n, price(n))).min_by(|a, b| a.1.total_cmp(&b.1))?;
        let explains = best.0 == 0 || self.remains(sides, frame, best.0).are_noise();
        (best.0 != now && explains).then(|| (best.0, price(now) - best.1))
    }

    /// Price of lost frames in one place.
    fn price(&self, lost: usize) -> f64 {
        if lost > 0 { proof(self.lost.len()) } else { 0.0 }
    }

    /// What is left where `n` frames are lost after a frame.
    fn remains(&self, sides: &Sides, frame: usize, n: usize) -> Remains {
        let more = (n as f64 - self.lost[frame] as f64) * self.frame_time;
        sides.smooth(|t| t + more)
    }

    /// Sets the number that falls most, until none falls.
    fn improve(&mut self, scene: &mut Scene, stop: Stop) -> Result<(), Stopped> {
        let pairs = self.lost.len();
        let mut best: Vec<Option<(usize, f64)>> = vec![];
        for frame in 0..pairs {
            stop(0.0)?;
            best.push(self.best(scene, frame));
        }
        for _ in 0..ROUNDS * pairs {
            stop(0.0)?;
            let fall = |frame: &usize| best[*frame].map_or(0.0, |(_, fall)| fall);
            let Some(frame) = (0..pairs).max_by(|a, b| fall(a).total_cmp(&fall(b))) else { break };
            let Some((n, _)) = best[frame].filter(|(_, fall)| *fall > 1e-6) else { break };
            self.set(scene, frame, n);
            let near = frame.saturating_sub(Sides::REACH)..(frame + Sides::REACH + 1).min(pairs);
            near.for_each(|other| best[other] = self.best(scene, other));
        }
        Ok(())
    }

    /// Drops numbers that leave more than noise, that are not worth their price, or that are worse than a bump of the camera.
    fn drop_unproven(&mut self, scene: &mut Scene, stop: Stop) -> Result<(), Stopped> {
        let mut frame = 0;
        while frame < self.lost.len() {
            stop(0.0)?;
            let present = self.lost[frame];
            if present > 0 && !self.is_proven(scene, frame) {
                self.set(scene, frame, 0);
                // Those before may have rested on it.
                frame = frame.saturating_sub(Sides::REACH);
            } else {
                frame += 1;
            }
        }
        Ok(())
    }

    fn is_proven(&mut self, scene: &mut Scene, frame: usize) -> bool {
        let present = self.lost[frame];
        self.set(scene, frame, 0);
        let shown = [Sides::of, Sides::nearer].into_iter().any(|of| {
            let sides = of(scene, frame, &self.noises);
            let with = sides.smooth(|t| t + present as f64 * self.frame_time);
            let without = sides.remains(|t| t).deviance();
            // One object alone may have met something.
            let none = if sides.len() > 1 { sides.smooth(|t| t).chi_square } else { without };
            let (_, of_bump, leaves_noise) = sides.displacement();
            let is_bump = leaves_noise && without - of_bump < with.chi_square;
            with.are_noise() && none - with.chi_square > self.price(present) && !is_bump
        });
        self.set(scene, frame, present);
        shown
    }
}

/// The step of a track over a pair of frames, and its usual one there: the median of each coordinate over its neighbours.
fn steps(samples: &[Sample], frame: usize) -> Option<(Vec2, Vec2)> {
    let at = samples.binary_search_by_key(&frame, |s| s.frame).ok()?;
    let step = |k: usize| {
        let (a, b) = (samples.get(k)?, samples.get(k + 1)?);
        (a.frame + 1 == b.frame).then(|| b.position - a.position)
    };
    let over = step(at)?;
    let near: Vec<Vec2> =
        (at.saturating_sub(NEAR)..=at + NEAR).filter(|k| *k != at).filter_map(step).collect();
    let median = |axis: fn(&Vec2) -> f64| quantile(&mut near.iter().map(axis).collect::<Vec<f64>>(), 0.5);
    Some((over, Vec2 { x: median(|v| v.x)?, y: median(|v| v.y)? }))
}
