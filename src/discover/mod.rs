//! Finds the physics that a model lacks: compare, locate, screen, refit, prove, add.

mod force;
mod path;
mod revise;
mod screen;
mod search;

pub use force::{Lens, fit_forces, flats, free_parameters};
pub use path::{Jump, Path, paths};
pub use revise::{Revision, revise};
pub use screen::{Candidate, at_values, region, screen, sought, with_effect, with_nuisance};
pub use search::{FreeMotion, search};

/// Reduced chi-square of the free motion above which structure remains.
pub const MISFIT: f64 = 1.3;
