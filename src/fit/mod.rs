//! Fits a model to what was observed: maximum a posteriori parameters and their posterior distribution.
//!
//! | file | holds |
//! |---|---|
//! | `noise` | measurement noise, estimated from the tracks without a model |
//! | `initial_states` | start states, from lines through the first frames |
//! | `problem` | the cost that is minimised: Huber's loss of whitened residuals, plus priors; its Jacobian |
//! | `search` | Levenberg-Marquardt, growing horizon, restarts; L-BFGS in stages |
//! | `posterior` | Laplace's approximation: standard deviations, what the data identify, draws |
//! | `joint` | several videos of one set-up: consensus of their shared parameters |
//! | `state_discrepancy` | what the tracks say against a fitted simulation at one instant |
//! | `estimation`, `single`, `estimate` | the steps of a fit; one scene; the ways in |

mod error;
mod estimate;
mod estimation;
mod initial_states;
mod joint;
mod noise;
mod options;
mod posterior;
mod problem;
mod result;
mod search;
mod single;
mod state_discrepancy;

pub use error::{FitError, check};
pub use estimate::{estimate, fit, with_draws};
pub use initial_states::initial_model;
pub use joint::fit_jointly;
pub use noise::{Noise, estimate as estimate_noise};
pub use options::{FitOptions, Method, StartPoint};
pub use posterior::{DRAWS, Estimate, ObjectEstimate, PairRestitution, Posterior, SharedEstimate, widened};
pub use result::{Fit, SceneFit};
pub use search::Termination;
pub use single::{estimate_each, estimate_one};
pub use state_discrepancy::{StateDiscrepancy, state_discrepancy};

#[cfg(test)]
mod tests;
