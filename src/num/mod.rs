//! Scalars, plane vectors and numerical methods; nothing here knows of physics.
//!
//! | file | holds |
//! |---|---|
//! | `real`, `jet` | the scalars that the model is compiled for: `f64`, and `Jet` and `JetF32` with derivatives |
//! | `vec2`, `angle` | vectors of the plane, angles |
//! | `digits` | numbers with the digits that their uncertainty leaves |
//! | `elementary`, `normal` | elementary functions and normal draws with the same bits on every processor |
//! | `least_squares`, `lbfgs` | minimisation: Levenberg-Marquardt for sums of squares, L-BFGS for other functions |
//! | `hermite` | cubic interpolation |
//! | `statistics` | quantiles and medians |
//! | `stop` | progress and cancellation |

mod angle;
mod digits;
pub mod elementary;
mod hermite;
mod jet;
mod lbfgs;
mod least_squares;
mod normal;
mod real;
mod statistics;
mod stop;
mod vec2;

pub use angle::wrap_angle;
pub use digits::{decimals, interval_digits, measured_digits, rounded};
pub use elementary::NUMERIC_FINGERPRINT;
pub use hermite::{HermiteWeights, hermite};
pub use jet::{DerivativeScalar, Dual, Jet, JetF32, LANES};
pub use lbfgs::{Descent, Objective};
pub use least_squares::{
    AtBounds, Bounds, Ended, LeastSquares, Minimum, NormalEquations, Schedule, levenberg_marquardt,
};
pub use normal::standard_normal;
pub use real::{Differential, Real};
pub use statistics::{
    NINETY_FIVE, NORMAL_MEDIAN_ABSOLUTE, NORMAL_MEDIAN_DISTANCE, median, quantile, share_interval,
};
pub use stop::{Stop, Stopped, never, progress_of_jobs, progress_within};
pub use vec2::{Vec2, vec2};
