//! Bounded nonlinear least squares by the Levenberg-Marquardt method.
//!
//! Minimised over parameters x (n of them, min <= x <= max) is a cost C(x) that is half of, or all of, a sum of squared
//! residuals r (m of them), or a robust loss of them. With the Jacobian J = dr/dx (m x n), the weights w of the loss and the
//! terms of priors included, one iteration
//!
//! 1. forms the normal equations: gradient g = J^T W r and Gauss-Newton Hessian H = J^T W J;
//! 2. solves (H + d diag H) s = -g for the step s, with the damping d (Marquardt's scaling: d has no unit);
//! 3. projects x + s onto the bounds and accepts it if C falls; then d is divided by ten. Otherwise d grows and 2. is repeated;
//! 4. may take further steps with the same J as long as they gain (chord steps), if the problem gives a gradient for them.
//!
//! Source: Marquardt, SIAM J. Appl. Math. 11 (1963) 431; Nocedal and Wright, Numerical Optimization (2006), section 10.3; chord
//! steps: Kelley, Iterative Methods for Linear and Nonlinear Equations (1995), section 5.4.

use nalgebra::{DMatrix, DVector};

/// Normal equations at one point: cost, gradient g (n) and Gauss-Newton Hessian H (n x n).
#[derive(Debug, Clone)]
pub struct NormalEquations {
    pub cost: f64,
    pub gradient: DVector<f64>,
    pub hessian: DMatrix<f64>,
}

impl NormalEquations {
    /// Without any term, for `n` parameters.
    pub fn zeros(n: usize) -> Self {
        NormalEquations { cost: 0.0, gradient: DVector::zeros(n), hessian: DMatrix::zeros(n, n) }
    }

    /// Lower triangular L with L L^T = H^-1, the covariance of the parameters. A singular H gets the smallest ridge of
    /// 1e-12, 1e-10, ... of its diagonal that makes it positive definite.
    pub fn covariance_factor(self) -> DMatrix<f64> {
        let NormalEquations { hessian, .. } = self;
        let n = hessian.nrows();
        // Scaled to a unit diagonal first: parameters differ by orders of magnitude.
        let scale = DVector::from_iterator(n, (0..n).map(|k| 1.0 / hessian[(k, k)].max(1e-300).sqrt()));
        let mut unit = hessian;
        for i in 0..n {
            for j in 0..n {
                unit[(i, j)] *= scale[i] * scale[j];
            }
        }
        let mut ridge = 0.0;
        let inverse = loop {
            let mut trial = unit.clone();
            for k in 0..n {
                trial[(k, k)] += ridge;
            }
            if let Some(c) = trial.cholesky() {
                break c.inverse();
            }
            ridge = if ridge == 0.0 { 1e-12 } else { ridge * 100.0 };
            if ridge > 1.0 {
                break DMatrix::identity(n, n);
            }
        };
        let mut covariance = inverse;
        for i in 0..n {
            for j in 0..n {
                covariance[(i, j)] *= scale[i] * scale[j];
            }
        }
        let diagonal = covariance.diagonal();
        match covariance.cholesky() {
            Some(c) => c.unpack(),
            None => DMatrix::from_diagonal(&diagonal.map(|v| v.max(0.0).sqrt())),
        }
    }
}

/// Where one parameter may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    pub min: f64,
    pub max: f64,
    /// Whether it stays where it is.
    pub frozen: bool,
}

impl Bounds {
    /// Any value.
    pub const NONE: Bounds = Bounds { min: f64::NEG_INFINITY, max: f64::INFINITY, frozen: false };
}

/// How a step treats bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AtBounds {
    /// The step is solved for all parameters, then each is clamped.
    Clamp,
    /// Parameters at a bound that the step would cross are fixed there, and it is solved again for the others.
    ActiveSet,
}

/// How the damping d starts and changes, and when steps with an old Jacobian are tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    pub initial: f64,
    /// Lower limit of d when it is divided by ten after an accepted step.
    pub min: f64,
    /// No step is tried from this d on.
    pub max: f64,
    /// Upper limit of d at the start of an iteration.
    pub max_at_start: f64,
    /// After a rejected step d is raised to at least this, then multiplied by `growth`.
    pub min_after_rejection: f64,
    pub growth: f64,
    /// Most steps that one iteration tries.
    pub trials: usize,
    /// Chord steps are tried while the cost falls by no more than this and d does not exceed `initial`; 0: none.
    pub chord_below: f64,
    pub at_bounds: AtBounds,
}

impl Schedule {
    /// Marquardt's: by tens from 1e-3, without chord steps; bounds clamp.
    pub const MARQUARDT: Schedule = Schedule {
        initial: 1e-3,
        min: 1e-12,
        max: 1e12,
        max_at_start: f64::INFINITY,
        min_after_rejection: 0.0,
        growth: 10.0,
        trials: usize::MAX,
        chord_below: 0.0,
        at_bounds: AtBounds::Clamp,
    };
}

/// A least-squares problem, as [`levenberg_marquardt`] needs it.
pub trait LeastSquares {
    /// What is known of a point beside its cost, such as its residuals.
    type Evaluation;
    /// The residuals' derivatives at a point.
    type Linearization;
    /// Why a caller ends the work early.
    type Error;

    /// The cost at a point; `None` where it is not defined.
    fn evaluate(&mut self, point: &[f64]) -> Option<(f64, Self::Evaluation)>;
    /// The normal equations at a point; `known` is what [`evaluate`](Self::evaluate) found there.
    fn linearize(
        &mut self,
        point: &[f64],
        known: Option<&Self::Evaluation>,
    ) -> (Self::Linearization, NormalEquations);
    /// Bounds of each parameter.
    fn bounds(&self) -> &[Bounds];
    /// The fall of the cost, from `before` to `after`, at or below which the search has converged.
    fn tolerance(&self, before: f64, after: f64) -> f64;
    /// Called before each linearisation and each step, with the share of the iterations that are done.
    fn poll(&self, progress: f64) -> Result<(), Self::Error>;
    /// Whether the search must end for another reason than its iterations.
    fn is_exhausted(&self) -> bool {
        false
    }
    /// Approximate gradient at a point near the one that was linearised; asked for if `chord_below` is not 0.
    fn chord_gradient(
        &self,
        _point: &[f64],
        _linearization: &Self::Linearization,
        _known: &Self::Evaluation,
    ) -> Option<DVector<f64>> {
        None
    }
}

/// Why a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// The last step gained less than the tolerance, or no step lowers the cost.
    Converged,
    /// [`LeastSquares::is_exhausted`].
    Exhausted,
    IterationLimit,
    /// The cost is not defined at the start.
    Undefined,
}

/// Where a search ended.
pub struct Minimum<P: LeastSquares> {
    pub point: Vec<f64>,
    pub cost: f64,
    /// At `point`; `None` if no step was accepted from a start that was linearised before.
    pub evaluation: Option<P::Evaluation>,
    /// Of the last iteration, whose start may lie one step before `point`; `None` at the iteration limit.
    pub linearization: Option<P::Linearization>,
    /// Of the last iteration.
    pub normal: Option<NormalEquations>,
    pub iterations: usize,
    pub ended: Ended,
    /// The cost at the start of each iteration, and of a search that took a step in its last one the cost at the end.
    pub losses: Vec<f64>,
}

/// Minimises the problem's cost from `start`, which may be linearised already; at most `budget` iterations.
pub fn levenberg_marquardt<P: LeastSquares>(
    problem: &mut P,
    start: Vec<f64>,
    linearized: Option<(P::Linearization, NormalEquations)>,
    schedule: &Schedule,
    budget: usize,
) -> Result<Minimum<P>, P::Error> {
    let mut at = Minimum {
        point: start,
        cost: f64::INFINITY,
        evaluation: None,
        linearization: None,
        normal: None,
        iterations: 0,
        ended: Ended::IterationLimit,
        losses: vec![],
    };
    let mut known = linearized;
    if known.is_none() {
        let Some((cost, evaluation)) = problem.evaluate(&at.point) else {
            return Ok(Minimum { ended: Ended::Undefined, ..at });
        };
        (at.cost, at.evaluation) = (cost, Some(evaluation));
    }
    let mut damping = schedule.initial;
    for iteration in 0..budget {
        let progress = iteration as f64 / budget as f64;
        problem.poll(progress)?;
        at.linearization = None;
        let (linearization, normal) = match known.take() {
            Some(known) => known,
            None => problem.linearize(&at.point, at.evaluation.as_ref()),
        };
        at.cost = normal.cost;
        at.losses.push(at.cost);
        if problem.is_exhausted() {
            (at.linearization, at.normal, at.ended) = (Some(linearization), Some(normal), Ended::Exhausted);
            return Ok(at);
        }
        at.iterations = iteration + 1;
        let step = descend(problem, &at.point, &linearization, &normal, (&mut damping, schedule), progress)?;
        (at.linearization, at.normal) = (Some(linearization), Some(normal));
        let Some(Iterate { to: next, converged }) = step else {
            at.ended = Ended::Converged;
            return Ok(at);
        };
        (at.point, at.cost, at.evaluation) = (next.point, next.cost, Some(next.evaluation));
        if converged {
            at.losses.push(at.cost);
            at.ended = Ended::Converged;
            return Ok(at);
        }
        damping = damping.min(schedule.max_at_start);
    }
    at.losses.push(at.cost);
    at.linearization = None;
    Ok(at)
}

/// A point that was evaluated.
struct Accepted<E> {
    point: Vec<f64>,
    cost: f64,
    evaluation: E,
}

/// Where one iteration leads, and whether the search has converged there.
struct Iterate<E> {
    to: Accepted<E>,
    converged: bool,
}

/// The steps of one iteration; `None` if no step lowers the cost.
fn descend<P: LeastSquares>(
    problem: &mut P,
    point: &[f64],
    linearization: &P::Linearization,
    normal: &NormalEquations,
    (damping, schedule): (&mut f64, &Schedule),
    progress: f64,
) -> Result<Option<Iterate<P::Evaluation>>, P::Error> {
    let NormalEquations { cost, gradient, hessian } = normal;
    let mut accepted = None;
    for _ in 0..schedule.trials {
        if *damping >= schedule.max {
            break;
        }
        problem.poll(progress)?;
        accepted = trial(problem, point, (gradient, hessian), (*damping, schedule), *cost);
        if accepted.is_some() {
            *damping = (*damping * 0.1).max(schedule.min);
            break;
        }
        *damping = damping.max(schedule.min_after_rejection) * schedule.growth;
    }
    let Some(mut best) = accepted else { return Ok(None) };
    let enough = problem.tolerance(*cost, best.cost);
    let mut fall = cost - best.cost;
    // A linearisation costs as much as many evaluations. Far from the minimum, chord steps lead to other minima.
    let near = fall <= enough || (fall <= schedule.chord_below && *damping <= schedule.initial);
    while near && fall > enough {
        problem.poll(progress)?;
        let Some(gradient) = problem.chord_gradient(&best.point, linearization, &best.evaluation) else {
            break;
        };
        let next = trial(problem, &best.point, (&gradient, hessian), (*damping, schedule), best.cost);
        let gain = next.as_ref().map_or(0.0, |next| best.cost - next.cost);
        best = next.unwrap_or(best);
        if gain < 0.1 * fall && gain > enough {
            break;
        }
        fall = gain;
    }
    Ok(Some(Iterate { to: best, converged: fall <= enough }))
}

/// One damped step, if it leads below `cost`.
fn trial<P: LeastSquares>(
    problem: &mut P,
    point: &[f64],
    (gradient, hessian): (&DVector<f64>, &DMatrix<f64>),
    (damping, schedule): (f64, &Schedule),
    cost: f64,
) -> Option<Accepted<P::Evaluation>> {
    let point = match schedule.at_bounds {
        AtBounds::Clamp => clamped_step(problem.bounds(), point, gradient, hessian, damping)?,
        AtBounds::ActiveSet => active_set_step(problem.bounds(), point, gradient, hessian, damping)?,
    };
    let (found, evaluation) = problem.evaluate(&point)?;
    (found < cost).then_some(Accepted { point, cost: found, evaluation })
}

/// x + s of (H + d diag H) s = -g with the `fixed` parameters left out; `None` if there is no finite solution.
fn stepped(
    fixed: &[bool],
    point: &[f64],
    gradient: &DVector<f64>,
    hessian: &DMatrix<f64>,
    damping: f64,
) -> Option<Vec<f64>> {
    let mut system = hessian.clone();
    let mut right = -gradient;
    for k in 0..point.len() {
        system[(k, k)] *= 1.0 + damping;
        if fixed[k] {
            system.row_mut(k).fill(0.0);
            system.column_mut(k).fill(0.0);
            system[(k, k)] = 1.0;
            right[k] = 0.0;
        }
    }
    let step = system.cholesky()?.solve(&right);
    let finite = step.iter().all(|s| s.is_finite());
    finite.then(|| point.iter().zip(step.iter()).map(|(x, s)| x + s).collect())
}

fn clamp(bounds: &[Bounds], point: &[f64]) -> Vec<f64> {
    point.iter().zip(bounds).map(|(x, b)| x.clamp(b.min, b.max)).collect()
}

fn clamped_step(
    bounds: &[Bounds],
    point: &[f64],
    gradient: &DVector<f64>,
    hessian: &DMatrix<f64>,
    damping: f64,
) -> Option<Vec<f64>> {
    let fixed: Vec<bool> = bounds.iter().map(|b| b.frozen).collect();
    Some(clamp(bounds, &stepped(&fixed, point, gradient, hessian, damping)?))
}

fn active_set_step(
    bounds: &[Bounds],
    point: &[f64],
    gradient: &DVector<f64>,
    hessian: &DMatrix<f64>,
    damping: f64,
) -> Option<Vec<f64>> {
    let outward = |(k, b): (usize, &Bounds)| {
        (point[k] <= b.min && gradient[k] > 0.0) || (point[k] >= b.max && gradient[k] < 0.0) || b.frozen
    };
    let mut fixed: Vec<bool> = bounds.iter().enumerate().map(outward).collect();
    for _ in 0..4 {
        let moved = stepped(&fixed, point, gradient, hessian, damping)?;
        let mut crossed = false;
        for (k, b) in bounds.iter().enumerate() {
            let at_bound = point[k] == b.min || point[k] == b.max;
            if !fixed[k] && at_bound && (moved[k] < b.min || moved[k] > b.max) {
                fixed[k] = true;
                crossed = true;
            }
        }
        if !crossed {
            return Some(clamp(bounds, &moved));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    /// Rosenbrock's function: residuals 10 (y - x^2) and 1 - x.
    struct Rosenbrock([Bounds; 2]);

    impl LeastSquares for Rosenbrock {
        type Evaluation = [f64; 2];
        type Linearization = ();
        type Error = Infallible;

        fn evaluate(&mut self, p: &[f64]) -> Option<(f64, [f64; 2])> {
            let r = [10.0 * (p[1] - p[0] * p[0]), 1.0 - p[0]];
            Some((0.5 * (r[0] * r[0] + r[1] * r[1]), r))
        }
        fn linearize(&mut self, p: &[f64], known: Option<&[f64; 2]>) -> ((), NormalEquations) {
            let r = known.copied().or_else(|| Some(self.evaluate(p)?.1)).expect("it is defined everywhere");
            let j = DMatrix::from_row_slice(2, 2, &[-20.0 * p[0], 10.0, -1.0, 0.0]);
            let r = DVector::from_row_slice(&r);
            let cost = 0.5 * r.norm_squared();
            ((), NormalEquations { cost, gradient: j.tr_mul(&r), hessian: j.tr_mul(&j) })
        }
        fn bounds(&self) -> &[Bounds] {
            &self.0
        }
        fn tolerance(&self, _: f64, _: f64) -> f64 {
            1e-20
        }
        fn poll(&self, _: f64) -> Result<(), Infallible> {
            Ok(())
        }
    }

    #[track_caller]
    fn check(bounds: [Bounds; 2], at_bounds: AtBounds, expected: [f64; 2]) {
        let schedule = Schedule { at_bounds, ..Schedule::MARQUARDT };
        let Ok(found) = levenberg_marquardt(&mut Rosenbrock(bounds), vec![-1.2, 0.0], None, &schedule, 200);
        assert_eq!(found.ended, Ended::Converged);
        let off = found.point.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-6, "{:?}", found.point);
        assert!(found.losses.is_sorted_by(|a, b| a >= b), "{:?}", found.losses);
    }

    #[test]
    fn it_follows_a_curved_valley_within_bounds() {
        let low = Bounds { max: 0.25, ..Bounds::NONE };
        for at_bounds in [AtBounds::Clamp, AtBounds::ActiveSet] {
            check([Bounds::NONE; 2], at_bounds, [1.0, 1.0]);
            check([Bounds { frozen: true, ..Bounds::NONE }, Bounds::NONE], at_bounds, [-1.2, 1.44]);
        }
        check([Bounds::NONE, low], AtBounds::ActiveSet, [0.504_879_542_410_327_4, 0.25]);
    }

    #[test]
    fn a_singular_hessian_has_a_covariance() {
        let mut normal = NormalEquations::zeros(2);
        normal.hessian.fill(4.0);
        let factor = normal.covariance_factor();
        assert!(factor.iter().all(|v| v.is_finite()) && factor[(0, 0)] > 1e3, "{factor}");
    }
}
