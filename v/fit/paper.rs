//! The paper's own strategy, for comparison: L-BFGS in stages, contacts after motion, windows that grow.

use super::problem::{Free, Problem, Window};
use super::solve::Solution;
use super::{FitError, Outcome};
use crate::effects::{Hook, effect};
use crate::num::Stop;
use crate::scene::Scene;
use std::collections::VecDeque;

/// Steps a stage.
const STEPS: usize = 20;
/// Pairs of steps and gradient changes that L-BFGS remembers.
const MEMORY: usize = 10;
/// Trials of one line search, and the share of the promised fall that it asks for (Armijo).
const TRIALS: usize = 20;
const SUFFICIENT: f64 = 1e-4;
/// A relative fall of the cost below this ends a stage.
const TOLERANCE: f64 = 1e-8;
/// Objects with less between their bounding circles may be touching (m).
const NEAR: f64 = 0.05;
/// Samples that remain of a track, however early its first contact.
const FEWEST: usize = 5;

/// One stage: whether contacts matter yet, over which frames, and the loss at which it is done.
struct Stage {
    contacts: bool,
    frames: usize,
    /// Squared position error, averaged over objects and coordinates, summed over frames (m^2).
    loss: f64,
}

/// VRDP's stages and thresholds: motion before the first contact, then mass and restitution over growing windows.
/// The windows search the motion too: its code holds it in the later ones, where errors of it become wrong masses.
const STAGES: [Stage; 4] = [
    Stage { contacts: false, frames: usize::MAX, loss: 5e-4 },
    Stage { contacts: true, frames: 40, loss: 2e-4 },
    Stage { contacts: true, frames: 80, loss: 1e-3 },
    Stage { contacts: true, frames: usize::MAX, loss: 1e-2 },
];

/// Runs the stages over the frames before `frames`. The cost is ours (whitened, with priors and bounds); the
/// paper's loss only says when a stage is done. `budget` counts steps over all stages.
pub(super) fn minimise(
    problem: &Problem,
    frames: Window,
    budget: usize,
    stop: Stop,
) -> Result<Solution, FitError> {
    let before: Vec<Scene> = problem.parts.iter().map(|p| before_contact(p.scene)).collect();
    let free_motion = problem.with_scenes(&before);
    let mut point = problem.start();
    let mut last = None;
    let (mut iterations, mut losses) = (0, vec![]);
    for (number, stage) in STAGES.iter().enumerate() {
        let problem = if stage.contacts { problem } else { &free_motion };
        let window = stage.frames.min(frames);
        let searched = |f: &Free| stage.contacts || !of_contacts(f);
        // Newton's step along each coordinate is the first guess; a coordinate of scale zero stays.
        let diagonal = problem.normal(&point, window).hessian.diagonal();
        let scale = problem.free.iter().zip(diagonal.iter());
        let scale = scale.map(|(f, h)| if searched(f) && *h > 0.0 { 1.0 / h } else { 0.0 }).collect();
        let search = Search {
            value: &|x| problem.cost(x, window),
            gradient: &|x| problem.normal(x, window).gradient.as_slice().to_vec(),
            done: &|x| loss(problem, x, window) < stage.loss,
            bounds: problem.free.iter().map(|f| (f.min, f.max)).collect(),
            scale,
        };
        let progress = |p: f64| stop((number as f64 + p) / STAGES.len() as f64);
        let found = search.run(&point, STEPS.min(budget.saturating_sub(iterations)), &progress)?;
        iterations += found.iterations;
        point = found.point.clone();
        losses.extend(&found.losses);
        last = Some(found);
    }
    let outcome = last.map_or(Outcome::IterationLimit, |l| l.outcome);
    let cost = problem.cost(&point, frames);
    Ok(Solution { point, cost, iterations, outcome, losses, linear: None })
}

/// Whether a parameter matters at contacts only: masses and contact laws.
fn of_contacts(free: &Free) -> bool {
    let name = free.name.split('.').next().unwrap_or_default();
    free.log || effect(name).is_some_and(|e| e.uses(Hook::Contact))
}

/// The scene with each track cut where its object first comes near another.
fn before_contact(scene: &Scene) -> Scene {
    let mut cut = scene.clone();
    for (a, track) in cut.tracks.iter_mut().enumerate() {
        let near = |frame: usize, b: usize| {
            let place = |i: usize| scene.tracks[i].at(frame);
            let reach = scene.objects[a].shape.bounding_radius() + scene.objects[b].shape.bounding_radius();
            let pair = place(a).zip(place(b));
            b != a && pair.is_some_and(|(p, q)| (p.position - q.position).norm() < reach + NEAR)
        };
        let met = |frame: usize| (0..scene.tracks.len()).any(|b| near(frame, b));
        let alone = track.samples.iter().take_while(|s| !met(s.frame)).count();
        track.samples.truncate(alone.max(FEWEST));
    }
    cut
}

/// The paper's loss of the worst scene (m^2).
fn loss(problem: &Problem, point: &[f64], window: Window) -> f64 {
    let of = |part: &super::problem::Part| {
        let (squares, _) = part.position_error(&part.rollout(&problem.free, point, window), window);
        squares / (2 * part.scene.objects.len().max(1)) as f64
    };
    problem.parts.iter().map(of).fold(0.0, f64::max)
}

/// A function to be minimised inside bounds.
struct Search<'f> {
    value: &'f dyn Fn(&[f64]) -> f64,
    gradient: &'f dyn Fn(&[f64]) -> Vec<f64>,
    done: &'f dyn Fn(&[f64]) -> bool,
    bounds: Vec<(f64, f64)>,
    /// Diagonal of the inverse Hessian as it is first guessed; 0 keeps the coordinate where it is.
    scale: Vec<f64>,
}

impl Search<'_> {
    /// L-BFGS (Nocedal and Wright, Numerical Optimization, algorithms 7.4 and 7.5) with steps projected on the bounds
    /// and a backtracking line search; pairs of negative curvature are left out, so that every direction descends.
    fn run(&self, start: &[f64], steps: usize, stop: Stop) -> Result<Solution, FitError> {
        let mut point = start.to_vec();
        let mut cost = (self.value)(&point);
        let mut pairs: VecDeque<(Vec<f64>, Vec<f64>)> = VecDeque::new();
        let (mut gradient, mut losses) = (vec![], vec![cost]);
        for iteration in 0..steps {
            stop(iteration as f64 / steps as f64)?;
            let ended = |point: &[f64], iterations, losses| Solution {
                point: point.to_vec(),
                cost,
                iterations,
                outcome: Outcome::Converged,
                losses,
                linear: None,
            };
            if (self.done)(&point) {
                return Ok(ended(&point, iteration, losses));
            }
            if gradient.is_empty() {
                gradient = (self.gradient)(&point);
            }
            let mut found = self.line_search(&point, cost, &gradient, &self.direction(&gradient, &pairs));
            if found.is_none() && !pairs.is_empty() {
                pairs.clear();
                found = self.line_search(&point, cost, &gradient, &self.direction(&gradient, &pairs));
            }
            let Some((next, lower)) = found else { return Ok(ended(&point, iteration + 1, losses)) };
            let fall = cost - lower;
            let slope = (self.gradient)(&next);
            let moved = difference(&next, &point);
            let change = difference(&slope, &gradient);
            if dot(&moved, &change) > 1e-10 * dot(&moved, &moved).sqrt() * dot(&change, &change).sqrt() {
                pairs.push_back((moved, change));
                if pairs.len() > MEMORY {
                    pairs.pop_front();
                }
            }
            (point, cost, gradient) = (next, lower, slope);
            losses.push(cost);
            if fall <= TOLERANCE * cost {
                let (iterations, outcome) = (iteration + 1, Outcome::Converged);
                return Ok(Solution { point, cost, iterations, outcome, losses, linear: None });
            }
        }
        Ok(Solution {
            point,
            cost,
            iterations: steps,
            outcome: Outcome::IterationLimit,
            losses,
            linear: None,
        })
    }

    /// The two-loop recursion.
    fn direction(&self, gradient: &[f64], pairs: &VecDeque<(Vec<f64>, Vec<f64>)>) -> Vec<f64> {
        let mut q = gradient.to_vec();
        let mut shares = vec![];
        for (s, y) in pairs.iter().rev() {
            let share = dot(s, &q) / dot(s, y);
            add(&mut q, y, -share);
            shares.push(share);
        }
        let scaled = |v: &[f64]| -> Vec<f64> { v.iter().zip(&self.scale).map(|(v, h)| v * h).collect() };
        let size = pairs.back().map_or(1.0, |(s, y)| dot(s, y) / dot(y, &scaled(y)).max(f64::MIN_POSITIVE));
        let mut r: Vec<f64> = scaled(&q).iter().map(|v| v * size).collect();
        for ((s, y), share) in pairs.iter().zip(shares.iter().rev()) {
            let back = dot(y, &r) / dot(s, y);
            add(&mut r, s, share - back);
        }
        r.iter().map(|v| -v).collect()
    }

    /// The first trial along the projected direction that falls enough, and its cost.
    fn line_search(&self, x: &[f64], cost: f64, slope: &[f64], along: &[f64]) -> Option<(Vec<f64>, f64)> {
        let mut share = 1.0;
        for _ in 0..TRIALS {
            let trial: Vec<f64> = (0..x.len())
                .map(|k| (x[k] + share * along[k]).clamp(self.bounds[k].0, self.bounds[k].1))
                .collect();
            let promised = dot(slope, &difference(&trial, x));
            if promised >= 0.0 {
                return None;
            }
            let lower = (self.value)(&trial);
            if lower <= cost + SUFFICIENT * promised {
                return Some((trial, lower));
            }
            // The minimum of the parabola through what is known.
            let least = -0.5 * promised / (lower - cost - promised);
            share *= if least.is_finite() { least.clamp(0.1, 0.5) } else { 0.1 };
        }
        None
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(x, y)| x - y).collect()
}

fn add(to: &mut [f64], v: &[f64], share: f64) {
    to.iter_mut().zip(v).for_each(|(t, v)| *t += share * v);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::never;

    fn rosenbrock(x: &[f64]) -> f64 {
        (1.0 - x[0]).powi(2) + 100.0 * (x[1] - x[0] * x[0]).powi(2)
    }

    fn slope(x: &[f64]) -> Vec<f64> {
        let steep = 200.0 * (x[1] - x[0] * x[0]);
        vec![-2.0 * (1.0 - x[0]) - 2.0 * x[0] * steep, steep]
    }

    fn minimum(scale: [f64; 2]) -> Vec<f64> {
        let search = Search {
            value: &rosenbrock,
            gradient: &slope,
            done: &|_| false,
            bounds: vec![(-2.0, 2.0); 2],
            scale: scale.to_vec(),
        };
        search.run(&[-1.2, 1.0], 100, &never).expect("nobody stops it").point
    }

    #[test]
    fn it_follows_a_curved_valley_inside_the_bounds() {
        let close = |x: Vec<f64>, to: [f64; 2]| {
            assert!((x[0] - to[0]).abs() < 1e-3 && (x[1] - to[1]).abs() < 1e-3, "{x:?}");
        };
        close(minimum([1.0, 1.0]), [1.0, 1.0]);
        // Scale zero holds a coordinate where it starts.
        close(minimum([0.0, 1.0]), [-1.2, 1.44]);
        let refused = |_: f64| Err(crate::num::Stopped);
        let search = Search {
            value: &rosenbrock,
            gradient: &slope,
            done: &|_| false,
            bounds: vec![(-2.0, 2.0); 2],
            scale: vec![1.0; 2],
        };
        assert!(matches!(search.run(&[0.0, 0.0], 9, &refused), Err(FitError::Stopped(_))));
    }
}
