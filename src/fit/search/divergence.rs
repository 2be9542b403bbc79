//! Where a simulation leaves the tracks that it should follow.

use super::super::problem::{FitProblem, Horizon, SceneProblem};
use crate::world::Rollout;

/// A residual beyond this many standard deviations is no noise.
const OUT_OF_NOISE: f64 = 6.0;
/// Mean square of whitened residuals up to which a simulation follows its tracks.
const FOLLOWED: f64 = 1.25;

/// Where the simulation of one scene first leaves its tracks.
pub(in super::super) struct Divergence<'p> {
    pub scene: &'p SceneProblem<'p>,
    pub rollout: Rollout<f64>,
    pub frame: usize,
    pub body: usize,
}

/// The first divergence of each scene within the horizon; none of a scene whose tracks are followed.
pub(in super::super) fn divergences<'p>(
    problem: &'p FitProblem<'p>,
    point: &[f64],
    horizon: Horizon,
) -> Vec<Divergence<'p>> {
    let of = |scene: &'p SceneProblem<'p>| {
        let rollout = scene.rollout(&problem.parameters, point, horizon);
        let (mut squares, mut count) = (0.0, 0);
        let mut first: Option<(usize, usize)> = None;
        scene.each_residual(&rollout, horizon, |(body, frame, _), r, _| {
            squares += r * r;
            count += 1;
            if r.abs() > OUT_OF_NOISE && first.is_none_or(|(known, _)| frame < known) {
                first = Some((frame, body));
            }
        });
        let (frame, body) = first.filter(|_| squares > FOLLOWED * f64::from(count))?;
        Some(Divergence { scene, rollout, frame, body })
    };
    problem.scenes.iter().filter_map(of).collect()
}

/// The first frame at which the simulation of any scene is out of the noise of its measurements.
pub(super) fn first_divergence(problem: &FitProblem, point: &[f64], horizon: Horizon) -> Option<usize> {
    let of = |scene: &SceneProblem| {
        let rollout = scene.rollout(&problem.parameters, point, horizon);
        let mut first: Option<usize> = None;
        scene.each_residual(&rollout, horizon, |(_, frame, _), r, _| {
            if r.abs() > OUT_OF_NOISE && first.is_none_or(|f| frame < f) {
                first = Some(frame);
            }
        });
        first
    };
    problem.scenes.iter().filter_map(of).min()
}
