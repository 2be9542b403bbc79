//! Alternatives of the contact sequence: modes of the posterior in which two bodies that nearly miss each other touch, or two
//! that barely touch miss.
//!
//! Laplace's approximation knows one mode. Where a contact is a graze, a simulation with it and one without it may explain the
//! tracks equally well, and no draw from one mode reaches the other. For each graze:
//!
//! 1. the linear model gives the deviation of the gap between the outlines (of a contact: of its depth). Gaps beyond
//!    [`CLOSE`] deviations are no grazes;
//! 2. the search starts where the gap is on the other side of zero, at the least prior and misfit of the linear model (the step
//!    S g / (g^T S g), g the gradient of the gap), and refines from there;
//! 3. a minimum whose contact sequence is no other than one already known is not kept. The evidence of each is
//!    exp(-C) sqrt(det S), and the draws are shared out among the modes in proportion to it.
//!
//! Source: MacKay, Neural Computation 4 (1992) 415 (evidence of a mode).

use super::super::problem::{FitProblem, Horizon, NEGLIGIBLE_FALL, SceneProblem, huber};
use super::super::search::minimise;
use super::laplace::Laplace;
use crate::num::{Vec2, elementary};
use crate::world::{Event, EventKind, Kinematics, PlacedShape, Rollout, gap};
use nalgebra::DVector;
use std::collections::{BTreeMap, BTreeSet};

/// Deviations of a gap, or of a contact's depth, within which the other side of it is tried.
const CLOSE: f64 = 4.0;
/// How far beyond zero the search starts, in deviations.
const OVERLAP: f64 = 1.0;
/// Most alternatives that are tried, nearest first, and iterations of each: a graze is near its minimum.
const MOST_TRIED: usize = 6;
const MAX_ITERATIONS: usize = 30;
/// Times between two frames at which a gap is looked at.
const PARTS: usize = 8;
/// Least share of the evidence of a mode that is drawn from.
const NEGLIGIBLE: f64 = 1e-3;

/// A minimum of the cost, with its share of the evidence of all.
pub(super) struct PosteriorMode {
    pub point: Vec<f64>,
    pub laplace: Laplace,
    pub weight: f64,
}

/// A pair of bodies that grazes, or nearly does.
struct Graze {
    /// Between the outlines (m); of a contact minus its depth.
    gap: f64,
    /// By the parameters.
    gradient: DVector<f64>,
    /// Deviation of the gap in the linear model (m).
    sd: f64,
}

/// The modes of one scene's posterior: first that of the best point. Several scenes together have that one only.
pub(super) fn modes(
    problem: &FitProblem,
    point: &[f64],
    laplace: Laplace,
    horizon: Horizon,
) -> Vec<PosteriorMode> {
    let best = PosteriorMode { point: point.to_vec(), laplace, weight: 1.0 };
    let [scene] = &problem.scenes[..] else { return vec![best] };
    if std::env::var("ONE_MODE").is_ok() {
        return vec![best];
    }
    let rollout = scene.rollout(&problem.parameters, point, horizon);
    let mut grazes = grazes(scene, &rollout, &best.laplace, horizon);
    grazes.sort_by(|a, b| (a.gap.abs() / a.sd).total_cmp(&(b.gap.abs() / b.sd)));
    let mut known = vec![met(&rollout)];
    let mut found = vec![best];
    let evidence = |mode: &PosteriorMode| log_evidence(problem, &mode.point, &mode.laplace);
    let first = evidence(&found[0]);
    for graze in grazes.iter().take(MOST_TRIED) {
        let Some((point, pairs)) = other_side(problem, &found[0], graze, horizon) else { continue };
        if known.contains(&pairs) {
            continue;
        }
        known.push(pairs);
        let laplace = Laplace::at(problem, &point, horizon);
        let mut mode = PosteriorMode { point, laplace, weight: 0.0 };
        mode.weight = elementary::exp((evidence(&mode) - first).min(20.0));
        found.push(mode);
    }
    let total: f64 = found.iter().map(|m| m.weight).sum();
    found.iter_mut().for_each(|m| m.weight /= total);
    found.retain(|m| m.weight > NEGLIGIBLE);
    found
}

/// The mode that draw number `draw` comes from: any first draws have the modes in proportion to their weights.
pub(super) fn mode_of_draw(modes: &[PosteriorMode], draw: usize) -> usize {
    // The golden ratio's multiples are the most evenly spread sequence of numbers.
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let at = (0.5 + GOLDEN * draw as f64).fract() * modes.iter().map(|m| m.weight).sum::<f64>();
    let mut sum = 0.0;
    let reached = modes.iter().position(|mode| {
        sum += mode.weight;
        at < sum
    });
    reached.unwrap_or(0)
}

/// Which bodies collide, by their ids.
pub(super) fn met(rollout: &Rollout<f64>) -> BTreeSet<Vec<u32>> {
    let sorted = |e: &Event| {
        let mut ids = e.objects.clone();
        ids.sort_unstable();
        ids
    };
    let is_collision = |e: &&Event| e.kind == EventKind::Collision && e.objects.len() == 2;
    rollout.events.iter().filter(is_collision).map(sorted).collect()
}

/// The minimum on the other side of a graze, and which bodies collide there.
fn other_side(
    problem: &FitProblem,
    best: &PosteriorMode,
    graze: &Graze,
    horizon: Horizon,
) -> Option<(Vec<f64>, BTreeSet<Vec<u32>>)> {
    let Graze { gap, gradient, sd } = graze;
    let by = -gap - gap.signum() * OVERLAP * sd;
    let factor = &best.laplace.factor;
    let step = factor * factor.tr_mul(gradient) * (by / (sd * sd));
    let start = problem.stepped(&best.point, |k| step[k]);
    let found = minimise(problem, &start, horizon, NEGLIGIBLE_FALL, MAX_ITERATIONS, problem.stop).ok()?;
    let rollout = problem.scenes.first()?.rollout(&problem.parameters, &found.point, horizon);
    found.cost.is_finite().then(|| (found.point, met(&rollout)))
}

/// Logarithm of the evidence of a mode, but for what all have in common.
fn log_evidence(problem: &FitProblem, point: &[f64], laplace: &Laplace) -> f64 {
    let prior: f64 = problem.parameters.iter().zip(point).map(|(p, x)| p.prior_cost(*x)).sum();
    let misfit = laplace.scenes.iter().zip(&laplace.shares);
    let misfit: f64 =
        misfit.map(|(scene, share)| share * scene.residuals.iter().map(|r| huber(*r)).sum::<f64>()).sum();
    let volume: f64 = laplace.factor.diagonal().iter().map(|l| elementary::ln(l.abs().max(1e-300))).sum();
    volume - prior - misfit
}

/// All grazes of a simulation.
fn grazes(scene: &SceneProblem, rollout: &Rollout<f64>, laplace: &Laplace, horizon: Horizon) -> Vec<Graze> {
    let mut rows: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    scene.each_residual(rollout, horizon, |(body, frame, coordinate), _, row| {
        if coordinate == 0 {
            rows.insert((body, frame), row);
        }
    });
    let count = scene.model.bodies.len();
    let met = met(rollout);
    let pairs = (0..count).flat_map(|b| (0..b).map(move |a| [a, b]));
    let graze = |pair: [usize; 2]| {
        let mut ids = pair.map(|k| scene.model.bodies[k].id).to_vec();
        ids.sort_unstable();
        let (gap, normal, frame) = match met.contains(&ids) {
            true => depth(scene, rollout, &ids, pair)?,
            false => nearest(scene, rollout, pair)?,
        };
        let gradient = gradient(scene, laplace, &rows, (pair, frame), normal)?;
        let sd = laplace.factor.tr_mul(&gradient).norm();
        (sd > 0.0 && gap.abs() < CLOSE * sd).then_some(Graze { gap, gradient, sd })
    };
    pairs.filter_map(graze).collect()
}

/// The states of two bodies at a frame.
fn states(rollout: &Rollout<f64>, frame: usize, pair: [usize; 2]) -> Option<[Kinematics<f64>; 2]> {
    let row = rollout.states.get(frame)?;
    Some([*row.get(pair[0])?.as_ref()?, *row.get(pair[1])?.as_ref()?])
}

/// The least gap of two bodies that do not meet, its direction (from the first to the second), and its frame.
fn nearest(scene: &SceneProblem, rollout: &Rollout<f64>, pair: [usize; 2]) -> Option<(f64, Vec2, usize)> {
    let shapes = pair.map(|k| &scene.model.bodies[k].shape);
    let reach: f64 = shapes.iter().map(|s| s.bounding_radius()).sum();
    let mut least: Option<(f64, Vec2, usize)> = None;
    for frame in 0..rollout.states.len().saturating_sub(1) {
        let Some((now, next)) = states(rollout, frame, pair).zip(states(rollout, frame + 1, pair)) else {
            continue;
        };
        let moved = now.iter().zip(&next).map(|(a, b)| (b.position - a.position).norm()).sum::<f64>();
        if (now[1].position - now[0].position).norm() > 2.0 * reach + moved {
            continue;
        }
        for part in 0..PARTS {
            let share = part as f64 / PARTS as f64;
            let placed = |k: usize| PlacedShape {
                position: now[k].position + (next[k].position - now[k].position) * share,
                yaw: now[k].yaw + (next[k].yaw - now[k].yaw) * share,
                shape: shapes[k],
            };
            let (gap, normal) = gap(&placed(0), &placed(1));
            if least.is_none_or(|l| gap < l.0) {
                least = Some((gap.max(0.0), normal, frame));
            }
        }
    }
    least
}

/// Of the only contact of two bodies minus the depth by which they would overlap if they did not touch, its direction (across the
/// relative motion) and the frame before it.
fn depth(
    scene: &SceneProblem,
    rollout: &Rollout<f64>,
    ids: &[u32],
    pair: [usize; 2],
) -> Option<(f64, Vec2, usize)> {
    let between = |e: &&Event| e.objects.len() == 2 && ids.iter().all(|id| e.objects.contains(id));
    let mut contacts = rollout.events.iter().filter(between);
    let contact = contacts.next()?;
    if contacts.next().is_some() {
        return None;
    }
    let frame = scene.scene.times.iter().rposition(|t| *t < contact.time)?;
    let [a, b] = states(rollout, frame, pair)?;
    let velocity = b.velocity - a.velocity;
    let normal = contact.normal?;
    let speed = velocity.norm();
    let cosine = velocity.dot(normal).abs() / speed.max(f64::MIN_POSITIVE);
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let reach = (a.position - b.position - velocity * (contact.time - scene.scene.time_of(frame))).norm();
    // Across the motion, from the first to the second.
    let across = velocity.perp() * (1.0 / speed.max(f64::MIN_POSITIVE));
    let across = if across.dot(b.position - a.position) < 0.0 { across * -1.0 } else { across };
    (speed > 0.0).then(|| (-(reach * (1.0 - sine)).max(f64::MIN_POSITIVE), across, frame))
}

/// The derivative of the distance of two bodies along `normal` by the parameters, at the sampled frames nearest to one.
fn gradient(
    scene: &SceneProblem,
    laplace: &Laplace,
    rows: &BTreeMap<(usize, usize), usize>,
    (pair, frame): ([usize; 2], usize),
    normal: Vec2,
) -> Option<DVector<f64>> {
    let linear = laplace.scenes.first()?;
    let mut factors = vec![0.0; linear.residuals.len()];
    for (body, sign) in pair.into_iter().zip([-1.0, 1.0]) {
        let before = rows.range((body, 0)..=(body, frame)).next_back();
        let (&(_, at), &row) = before.or_else(|| rows.range((body, frame)..(body + 1, 0)).next())?;
        let sample = scene.scene.tracks.get(body)?.at(at)?;
        // Residuals are whitened positions; this is their combination that is the position along the normal.
        let whitener = scene.noise.whitener(sample.covariance);
        let ([xx, yx], [_, yy]) = (whitener.apply(1.0, 0.0), whitener.apply(0.0, 1.0));
        let second = normal.y / yy;
        factors[row + 1] = sign * second;
        factors[row] = sign * (normal.x - yx * second) / xx;
    }
    let mut gradient = DVector::zeros(laplace.factor.nrows());
    linear.add_transposed_product(&factors, &mut gradient);
    Some(gradient)
}
