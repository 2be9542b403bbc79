//! A frame rate that changes within the video: from one frame on all objects are faster by one factor.
//!
//! As for lost frames, the later samples have other times: q t after a pair instead of t. Where some q leaves noise, and is better
//! than contacts by more than the price of an event, and at least three objects show it, the rate changes there. Two objects may have met.

use crate::num::elementary;
use crate::scene::measurement::finding::{FindingKind, TrackFinding};
use crate::scene::measurement::position_sds;
use crate::scene::measurement::sides::{Sides, proof};
use crate::scene::observation::Scene;

/// Factors that are tried first: 2^(k / 8) for |k| up to this; less is no other rate of a camera.
const FACTORS: i32 = 20;
const LEAST: f64 = 1.1;
/// Objects that show a change, at least: two may have met.
const SHOWING: usize = 3;
/// Halvings of the interval around the best of them: to 10^-3 of the factor.
const HALVINGS: usize = 7;

/// Changes the times after such frames, and says so.
pub fn take_in_rate_changes(scene: &mut Scene, step: f64) -> Option<TrackFinding> {
    let noises = position_sds(scene, step);
    let (mut frames, mut factor) = (vec![], 1.0);
    let mut frame = 0;
    while frame + 1 < scene.times.len() {
        let here = change(scene, frame, &noises);
        // The neighbours show it, too: the best of them is taken.
        let ahead = (frame + 1..(frame + Sides::REACH).min(scene.times.len() - 1))
            .map_while(|f| change(scene, f, &noises).map(|c| (f, c)));
        let Some(first) = here else {
            frame += 1;
            continue;
        };
        let all = std::iter::once((frame, first)).chain(ahead);
        let Some((at, (q, _))) = all.max_by(|a, b| a.1.1.total_cmp(&b.1.1)) else { break };
        let start = scene.times[at];
        scene.times[at + 1..].iter_mut().for_each(|t| *t = start + q * (*t - start));
        frames.push(at);
        factor *= q;
        frame = at + Sides::REACH;
    }
    (!frames.is_empty()).then_some(TrackFinding {
        kind: FindingKind::RateChange,
        objects: vec![],
        frames,
        value: factor,
    })
}

/// The factor of later times after a frame, and by how much it lowers the deviance; `None` unless it is proven.
fn change(scene: &Scene, frame: usize, noises: &[f64]) -> Option<(f64, f64)> {
    let sides = Sides::of(scene, frame, noises);
    let present = sides.smooth(|t| t);
    if sides.len() < SHOWING || present.are_noise() {
        return None;
    }
    let with = |log: f64| {
        let q = elementary::exp(std::f64::consts::LN_2 * log);
        sides.smooth(|t| q * t)
    };
    let least = |logs: &mut dyn Iterator<Item = f64>| {
        let all = logs.map(|log| (log, with(log).chi_square));
        all.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(log, _)| log)
    };
    let mut best = least(&mut (-FACTORS..=FACTORS).map(|k| f64::from(k) / 8.0))?;
    let mut width = 1.0 / 8.0;
    for _ in 0..HALVINGS {
        width *= 0.5;
        best = least(&mut [best - width, best, best + width].into_iter())?;
    }
    let q = elementary::exp(std::f64::consts::LN_2 * best);
    let fall = sides.remains(|t| t).deviance() - with(best).chi_square;
    let shown = sides.showing(|t| q * t);
    let proven = fall > proof(scene.times.len()) && with(best).are_noise() && shown >= SHOWING;
    (proven && q.max(1.0 / q) > LEAST).then_some((q, fall))
}
