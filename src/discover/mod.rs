//! Finds the physics that a model lacks: compare, locate, screen, refit, prove, add.

mod force;
mod path;
mod screen;

pub use force::{Lens, fit_forces, flats, free_parameters};
pub use path::{Jump, Path, paths};
pub use screen::{Candidate, at_values, region, screen, sought, with_effect};
