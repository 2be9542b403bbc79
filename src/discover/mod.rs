//! Finds the physics that a model lacks: compare, locate, screen, refit, prove, add.

mod force;
mod path;

pub use force::{Lens, fit_forces, flats, free_parameters};
pub use path::{Jump, Path, paths};
