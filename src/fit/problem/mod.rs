//! The fit as a nonlinear least-squares problem.
//!
//! Unknown are the parameters x: of each scene the start states and masses of its bodies, and the parameters of effects, of
//! which scenes of one set-up share some. A simulation from them (`SceneProblem`) predicts each measured position and
//! yaw. Minimised is the cost
//!
//! C(x) = sum_i rho(r_i(x)) + sum_k ((x_k - m_k) / s_k)^2 / 2
//!
//! | symbol | is | unit |
//! |---|---|---|
//! | r_i | whitened residual: simulated minus measured, times the inverse Cholesky factor of the measurement's covariance | 1 |
//! | rho | Huber's loss: r^2 / 2 up to h = 5, beyond it h (abs(r) - h / 2), so that an outlier cannot dominate | 1 |
//! | m_k, s_k | prior mean and standard deviation of parameter k | that of x_k |
//!
//! C is the negative logarithm of the posterior density but for a constant, as long as no residual exceeds h. Rows of r are
//! ordered by scene, body and frame; a position has two rows and a measured yaw that matters a third. The Jacobian dr/dx (rows x
//! parameters) comes from the same simulation run on jets (`LinearizedScene`); masses are searched as logarithms.
//!
//! The simulation runs from the start states to the last frame of the horizon (single shooting); how far the horizon reaches is
//! the search's choice. Sources: Huber, Annals of Mathematical Statistics 35 (1964) 73; Bock, Springer Series in
//! Chemical Physics 18 (1981) 102.

mod adequacy;
mod fit_problem;
mod jacobian;
mod loss;
mod scene_problem;
mod search_parameter;

pub(super) use adequacy::{GOOD, is_adequate, misfit, reduced_chi_squares, worst_chi_square};
pub(super) use fit_problem::{FitProblem, MAX_CHORD_FALL, NEGLIGIBLE_FALL};
pub(super) use jacobian::LinearizedScene;
pub(super) use loss::{huber, influence};
pub(super) use scene_problem::{Horizon, SceneProblem, SimulatedScene};
pub(super) use search_parameter::SearchParameter;
