//! A camera that moves: all objects move together, which nothing on a table does.
//!
//! A bump is one displacement d of all objects between two frames: one path for each object on both sides (`sides`), with one d in common, leaves
//! noise, and far more without it. A shake is a part of the error that all objects have in common: of the distances r_i of samples
//! from parabolas through their neighbours, the correlation between objects is rho = var(shake) / (var(shake) + var(noise)). The shake of a frame with
//! n objects is then best estimated by n rho / (1 + (n - 1) rho) times the mean of r_i (Wiener), and taken out.

use super::finding::{FindingKind, TrackFinding};
use super::position_sds;
use super::sides::{Sides, proof};
use crate::num::{Stop, Stopped, Vec2, vec2};
use crate::scene::observation::Scene;

/// Neighbours on each side that a parabola goes through.
const NEAR: usize = 5;
/// Farther distances (deviations), and those near them, do not count: contacts bend paths, and are no shake.
const CUT: f64 = 4.0;
/// Least correlation that is reported, and deviations of what chance gives: odds of 3 * 10^5 to 1.
const LEAST: f64 = 0.2;
const CERTAIN: f64 = 4.5;

/// Takes out bumps, and says so.
pub fn take_out_bumps(scene: &mut Scene, step: f64, stop: Stop) -> Result<Option<TrackFinding>, Stopped> {
    let noises = position_sds(scene, step);
    let (mut frames, mut squares) = (vec![], 0.0);
    for frame in 0..scene.times.len().saturating_sub(1) {
        stop(0.0)?;
        let sides = Sides::of(scene, frame, &noises);
        if sides.len() < 2 || !sides.leap() {
            continue;
        }
        let ([x, y], fall, leaves_noise) = sides.displacement();
        if fall > proof(scene.times.len()) && leaves_noise {
            for s in scene.tracks.iter_mut().flat_map(|t| &mut t.samples).filter(|s| s.frame > frame) {
                s.position -= vec2(x, y);
            }
            frames.push(frame);
            squares += x * x + y * y;
        }
    }
    let value = (squares / frames.len().max(1) as f64).sqrt();
    let kind = FindingKind::MovingCamera;
    Ok((!frames.is_empty()).then_some(TrackFinding { kind, objects: vec![], frames, value }))
}

/// Takes out the shake, and says so.
pub fn take_out_shake(scene: &mut Scene, step: f64) -> Option<TrackFinding> {
    let noises = position_sds(scene, step);
    let off: Vec<Vec<Option<Vec2>>> =
        (0..scene.tracks.len()).map(|k| distances(scene, k, noises[k])).collect();
    let (mut products, mut squares, mut count) = (0.0, 0.0, 0.0_f64);
    for frame in 0..scene.times.len() {
        let seen: Vec<Vec2> =
            off.iter().zip(&noises).filter_map(|(o, noise)| Some(o[frame]?.scaled(1.0 / noise))).collect();
        for (i, a) in seen.iter().enumerate() {
            for b in &seen[..i] {
                products += a.dot(*b);
                squares += 0.5 * (a.norm_squared() + b.norm_squared());
                count += 2.0;
            }
        }
    }
    let share = products / f64::max(squares, f64::MIN_POSITIVE);
    if count < 1.0 || share < f64::max(LEAST, CERTAIN * (repetition(&off) / count).sqrt()) {
        return None;
    }
    let (mut total, mut frames) = (0.0, 0.0);
    let mut shakes = vec![Vec2::zero(); scene.times.len()];
    for (frame, shake) in shakes.iter_mut().enumerate() {
        let seen: Vec<Vec2> = off.iter().filter_map(|o| o[frame]).collect();
        let n = seen.len() as f64;
        if n > 1.0 {
            let sum = seen.iter().fold(Vec2::zero(), |sum, o| sum + *o);
            *shake = sum.scaled(share / (1.0 + (n - 1.0) * share));
            (total, frames) = (total + shake.norm_squared(), frames + 1.0);
        }
    }
    for s in scene.tracks.iter_mut().flat_map(|t| &mut t.samples) {
        s.position -= shakes[s.frame];
    }
    let value = (total / f64::max(frames, 1.0)).sqrt();
    Some(TrackFinding { kind: FindingKind::MovingCamera, objects: vec![], frames: vec![], value })
}

/// How many times more distances than independent numbers a correlation needs: 1 + 2 sum_j rho_j^2 over lags j (Bartlett, J. Roy. Stat. Soc.
/// Suppl. 8 (1946) 27). A marker that turns off its centre wobbles through many frames, as another may by chance.
fn repetition(off: &[Vec<Option<Vec2>>]) -> f64 {
    let products = |lag: usize| -> f64 {
        let of = |o: &Vec<Option<Vec2>>| -> f64 {
            o.iter().zip(&o[lag.min(o.len())..]).filter_map(|(a, b)| Some((*a)?.dot((*b)?))).sum()
        };
        off.iter().map(of).sum()
    };
    let square = products(0).max(f64::MIN_POSITIVE);
    let correlations = (1..=4 * NEAR).map(|lag| products(lag) / square);
    1.0 + 2.0 * correlations.map(|r| r * r).sum::<f64>()
}

/// Distances of a track's samples from parabolas through their neighbours (m); `None` where a neighbour was not seen, or the path
/// bends.
fn distances(scene: &Scene, track: usize, noise: f64) -> Vec<Option<Vec2>> {
    let samples = &scene.tracks[track].samples;
    let weights = weights();
    let mut all = vec![None; scene.times.len()];
    for (k, window) in samples.windows(2 * NEAR + 1).enumerate() {
        let middle = &samples[k + NEAR];
        if window[2 * NEAR].frame - window[0].frame != 2 * NEAR {
            continue;
        }
        let pair = |d: usize| (window[NEAR - d].position + window[NEAR + d].position).scaled(weights[d - 1]);
        let off = middle.position - (1..=NEAR).fold(Vec2::zero(), |sum, d| sum + pair(d));
        all[middle.frame] = Some(off);
    }
    let most = CUT * noise;
    let bends = |off: &Option<Vec2>| off.is_some_and(|off| off.x.abs().max(off.y.abs()) > most);
    let bent: Vec<bool> = all.iter().map(bends).collect();
    let near =
        |frame: usize| bent[frame.saturating_sub(NEAR)..(frame + NEAR + 1).min(bent.len())].contains(&true);
    (0..all.len()).map(|frame| all[frame].filter(|_| !near(frame))).collect()
}

/// Weights of the neighbours at distance 1, 2 and so on in a parabola's value at the middle, which has none itself (Savitzky and
/// Golay, Anal. Chem. 36 (1964) 1627).
fn weights() -> [f64; NEAR] {
    let power = |k: u32| 2.0 * (1..=NEAR).map(|d| (d.pow(k)) as f64).sum::<f64>();
    let (count, second, fourth) = (2.0 * NEAR as f64, power(2), power(4));
    let determinant = count * fourth - second * second;
    std::array::from_fn(|k| (fourth - second * ((k + 1) * (k + 1)) as f64) / determinant)
}
