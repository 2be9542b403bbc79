//! The posterior distribution of the parameters, and what it says of objects and effects.
//!
//! Laplace's approximation: around the minimum x* of the cost C the posterior is normal with mean x* and covariance
//! S = H^-1, H = sum_s J_s^T W J_s / R_s + diag(1 / s_k^2) over scenes s (J_s rows x parameters), the Gauss-Newton Hessian of
//! C with priors of standard deviation s_k. R_s >= 1 is the redundancy of the scene's measurements: correlated
//! residuals of a model that is not quite right count for less. Masses are normal in their logarithm.
//!
//! The standard deviation of a shared parameter is the larger one of that by the noise and of that by how far the scenes
//! disagree on it (the jackknife over scenes, to first order), at most four times the former.
//!
//! - A parameter is *identified* if its standard deviation sd is below 0.5 s_k: the data and not the prior determine it.
//! - It is *informative* if sd < 0.95 s_k; otherwise the data say nothing of it, and it repeats the prior.
//!
//! Draws (`sampling.rs`) start as x* + L z, with S = L L^T and z standard normal. Through contacts the cost is no parabola, so a
//! draw that fits worse than a draw of the normal distribution would is led back to the residuals that the linear model predicts.
//!
//! Sources: MacKay, Neural Computation 4 (1992) 415 (Laplace); Bardsley et al., SIAM J. Sci. Comput. 36 (2014) A1895
//! (randomise, then optimise).

mod estimates;
mod laplace;
mod pairs;
mod parameter_estimate;
mod sampling;

pub use estimates::{ObjectEstimate, SharedEstimate};
pub use laplace::{Posterior, widened};
pub use pairs::PairRestitution;
pub use parameter_estimate::Estimate;
pub use sampling::DRAWS;
pub(super) use sampling::sample;
