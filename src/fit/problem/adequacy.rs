//! How well a point fits: root mean square error and reduced chi-square of each scene.

use super::fit_problem::FitProblem;
use super::scene_problem::Horizon;
use crate::world::Ending;

/// Reduced chi-square up to which a fit needs no other attempt.
pub(in super::super) const GOOD: f64 = 1.25;
/// Reduced chi-square up to which noise explains the misfit.
const ADEQUATE: f64 = 1.5;
/// Reduced chi-square of a scene whose simulation does not come to its end.
const INCOMPLETE: f64 = 1e9;

/// Whether noise explains a misfit.
pub(in super::super) fn is_adequate(reduced_chi_square: f64) -> bool {
    reduced_chi_square <= ADEQUATE
}

/// What a simulation leaves of one scene's measurements.
pub(in super::super) struct Misfit {
    /// Root mean square of the position residuals, both coordinates pooled (m).
    pub rmse: f64,
    /// Sum of squared whitened residuals over the degrees of freedom.
    pub reduced_chi_square: f64,
    /// Measurements minus the scene's own parameters with a prior standard deviation above 1.
    pub degrees_of_freedom: usize,
}

pub(in super::super) fn misfit(
    problem: &FitProblem,
    index: usize,
    point: &[f64],
    horizon: Horizon,
) -> Misfit {
    let scene = &problem.scenes[index];
    let rollout = scene.rollout(&problem.parameters, point, horizon);
    let (squares, positions) = scene.position_error(&rollout, horizon);
    let (mut chi_square, mut count) = (0.0, 0usize);
    scene.each_residual(&rollout, horizon, |_, r, _| {
        chi_square += r * r;
        count += 1;
    });
    let own = problem.parameters.iter().filter(|p| p.scene == Some(index) && p.sd > 1.0).count();
    let degrees_of_freedom = count.saturating_sub(own).max(1);
    let completed = rollout.ending == Ending::Completed;
    Misfit {
        rmse: (squares / positions.max(1) as f64).sqrt(),
        reduced_chi_square: if completed { chi_square / degrees_of_freedom as f64 } else { INCOMPLETE },
        degrees_of_freedom,
    }
}

/// Reduced chi-square of each scene.
pub(in super::super) fn reduced_chi_squares(
    problem: &FitProblem,
    point: &[f64],
    horizon: Horizon,
) -> impl Iterator<Item = f64> {
    (0..problem.scenes.len()).map(move |i| misfit(problem, i, point, horizon).reduced_chi_square)
}

pub(in super::super) fn worst_chi_square(problem: &FitProblem, point: &[f64], horizon: Horizon) -> f64 {
    reduced_chi_squares(problem, point, horizon).fold(0.0, f64::max)
}
