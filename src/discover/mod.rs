//! Finds the physics that a model lacks: compare, locate, screen, refit, prove, add.

mod account;
mod alone;
mod central;
mod change;
mod choice;
mod compare;
mod conclude;
mod contact;
mod contact_law;
mod cost;
mod experiment;
mod fading;
mod film;
mod force;
mod formula;
mod free;
mod hearing;
mod inquire;
mod jackknife;
mod outcome;
mod outside;
mod path;
mod proof;
mod revise;
mod screen;
mod search;
mod slight;
mod stretch;
mod struck;
#[cfg(test)]
mod tests;
mod unexplained;
mod unseen;
mod wave;
mod whole;
mod written;

pub use alone::Alone;
pub use change::{
    Change, ChangeError, Changed, FORMULA, Origin, Unseen, Weight, Worth, change, check_name, weigh,
};
pub use compare::{
    Comparison, FAST, FAST_FREE, ObjectComparison, Regime, SLOW_FREE, SceneComparison, compare, failures,
};
pub use conclude::DiscoverOptions;
pub use contact::{ContactCandidate, screen_contacts};
pub use contact_law::with_contact;
pub use cost::Cost;
pub use film::{Contacts, contacts};
pub use force::{Lens, fit_forces};
pub use formula::{ResidualLaw, residual_law};
pub use free::{at_values, flats, free_parameters};
pub use inquire::{Diagnosis, diagnose, discover};
pub use outcome::{
    Discovery, Experiment, Found, Owner, Ranked, Reported, Smallest, Value, Verdict, reported,
};
pub use path::{Jump, Path, paths};
pub use revise::{Revision, revise};
pub use screen::{Candidate, region, screen, sought, with_effect, with_nuisance};
pub use search::{FreeMotion, search, search_on};
pub use unexplained::{Unexplained, unexplained};

/// Reduced chi-square of the free motion above which structure remains.
pub const MISFIT: f64 = 1.3;
