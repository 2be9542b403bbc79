//! The search of the VRDP paper, for comparison: L-BFGS in four stages, the motion first, then contacts over growing windows.
//!
//! | stage | searched | frames | done at loss (m^2) |
//! |---|---|---|---|
//! | 1 | motion: start states, friction and other forces; tracks end where objects come near each other | all | 5e-4 |
//! | 2 | all parameters | first 40 | 2e-4 |
//! | 3 | all parameters | first 80 | 1e-3 |
//! | 4 | all parameters | all | 1e-2 |
//!
//! A stage takes at most 20 L-BFGS steps. What it lowers is the cost of [`super::super::problem`], with priors and bounds; the
//! paper's loss, the squared position error averaged over objects and coordinates and summed over frames, only says when
//! a stage is done. The later stages search the motion too: the paper's code freezes it there, which turns errors of
//! the motion into wrong masses. The paper's last stage, the last 20 frames, is in `fit/state_discrepancy.rs`.
//!
//! Source: Ding, Chen, Du, Luo, Tenenbaum and Gan, Dynamic Visual Reasoning by Learning Differentiable Physics Models from Video
//! and Language, NeurIPS 2021.

use super::super::problem::{FitProblem, Horizon, SceneProblem, SearchParameter};
use super::local_search::{Solution, Termination};
use crate::effects::{Hook, ParamId, effect};
use crate::num::{Objective, Stop, Stopped};
use crate::scene::Scene;

/// Most L-BFGS steps of a stage.
const STAGE_STEPS: usize = 20;
/// Objects with less between their bounding circles may be touching (m).
const NEAR: f64 = 0.05;
/// Samples that remain of a track, however early its first contact.
const FEWEST_SAMPLES: usize = 5;

/// One stage: whether contacts matter yet, over which frames, and the loss at which it is done.
struct SearchStage {
    contacts: bool,
    frames: usize,
    /// Squared position error, averaged over objects and coordinates, summed over frames (m^2).
    loss: f64,
}

const STAGES: [SearchStage; 4] = [
    SearchStage { contacts: false, frames: usize::MAX, loss: 5e-4 },
    SearchStage { contacts: true, frames: 40, loss: 2e-4 },
    SearchStage { contacts: true, frames: 80, loss: 1e-3 },
    SearchStage { contacts: true, frames: usize::MAX, loss: 1e-2 },
];

/// Runs the stages over the frames before `frames`; `budget` counts steps over all stages.
pub(in super::super) fn minimise(
    problem: &FitProblem,
    frames: Horizon,
    budget: usize,
    stop: Stop,
) -> Result<Solution, Stopped> {
    let before: Vec<Scene> = problem.scenes.iter().map(|s| before_contact(s.scene)).collect();
    let free_motion = problem.with_scenes(&before);
    let mut point = problem.start();
    let mut outcome = Termination::IterationLimit;
    let (mut iterations, mut losses) = (0, vec![]);
    for (number, stage) in STAGES.iter().enumerate() {
        let problem = if stage.contacts { problem } else { &free_motion };
        let horizon = stage.frames.min(frames);
        let is_searched = |p: &SearchParameter| stage.contacts || !matters_at_contacts_only(p);
        // Newton's step along each coordinate is the first guess; a coordinate of scale 0 does not move.
        let diagonal = problem.normal_equations_at(&point, horizon).hessian.diagonal();
        let scale = problem.parameters.iter().zip(diagonal.iter());
        let scale = scale.map(|(p, h)| if is_searched(p) && *h > 0.0 { 1.0 / h } else { 0.0 }).collect();
        let objective = Objective {
            value: &|x| problem.cost(x, horizon),
            gradient: &|x| problem.normal_equations_at(x, horizon).gradient.as_slice().to_vec(),
            done: &|x| loss(problem, x, horizon) < stage.loss,
            bounds: problem.parameters.iter().map(|p| (p.min, p.max)).collect(),
            scale,
        };
        let progress = |p: f64| stop((number as f64 + p) / STAGES.len() as f64);
        let found =
            objective.minimise(&point, STAGE_STEPS.min(budget.saturating_sub(iterations)), &progress)?;
        outcome = if found.converged { Termination::Converged } else { Termination::IterationLimit };
        iterations += found.iterations;
        point = found.point;
        losses.extend(&found.values);
    }
    let cost = problem.cost(&point, frames);
    Ok(Solution { point, cost, iterations, outcome, losses, linear: None })
}

/// Whether a parameter is a mass or belongs to a contact law.
fn matters_at_contacts_only(parameter: &SearchParameter) -> bool {
    let of = ParamId::parse(&parameter.name).and_then(|id| effect(id.effect));
    parameter.log || of.is_some_and(|e| e.uses(Hook::Contact))
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
        let free = track.samples.iter().take_while(|s| !met(s.frame)).count();
        track.samples.truncate(free.max(FEWEST_SAMPLES));
    }
    cut
}

/// The paper's loss of the worst scene (m^2).
fn loss(problem: &FitProblem, point: &[f64], horizon: Horizon) -> f64 {
    let of = |scene: &SceneProblem| {
        let rollout = scene.rollout(&problem.parameters, point, horizon);
        let (squares, _) = scene.position_error(&rollout, horizon);
        squares / (2 * scene.scene.objects.len().max(1)) as f64
    };
    problem.scenes.iter().map(of).fold(0.0, f64::max)
}
