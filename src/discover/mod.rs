//! Finds the physics that a model lacks: compare, locate, screen, refit, prove, add.

mod alternatives;
mod central;
mod change;
mod checkpoints;
mod compare;
mod contact;
mod contact_law;
mod cost;
mod departures;
mod discovery;
mod experiment;
mod followed;
mod formula;
mod formula_test;
mod free;
mod hidden_geometry;
mod intervals;
mod jackknife;
mod negligible;
mod outcome;
mod proof;
mod proposal;
mod resample;
mod restitution_decay;
mod revise;
mod screen;
mod search;
mod segment;
mod smooth_track;
#[cfg(test)]
mod tests;
mod trajectory_check;
mod unexplained;
mod unexplained_impacts;
mod unseen_pushes;
mod user_formula;
mod verdict;
mod wave;
mod weak_form;
mod whole_trajectory;
mod window_fits;
mod windows;

pub use change::{
    ChangeEvidence, ChangeResult, ChangeVerdict, Origin, PredictionErrors, change, log_evidence, weigh,
};
pub use checkpoints::Checkpoints;
pub use compare::{
    Comparison, FAST, FAST_FREE, ObjectComparison, Regime, SLOW_FREE, SceneComparison, Separation, compare,
    failures, separations,
};
pub use contact::{ContactCandidate, screen_contacts};
pub use contact_law::with_contact;
pub use cost::Cost;
pub use discovery::{Diagnosis, diagnose, discover, discover_with};
pub use formula::{ResidualLaw, residual_law};
pub use free::{at_values, flats, free_parameters};
pub use outcome::{
    DetectionLimit, Discovery, Experiment, FoundEffect, ParameterEstimate, ParameterOwner, ParameterValue,
    RankedEffect, Verdict, reported,
};
pub use proposal::{ChangeError, FORMULA, ModelChange, check_name};
pub use revise::{Revision, revise};
pub use screen::{ForceCandidate, candidates, region, screen, with_effect, with_nuisance};
pub use search::{FreeMotion, search, search_on};
pub use smooth_track::{ChangePoint, SmoothTrack, paths};
pub use unexplained::{UnexplainedAcceleration, unexplained};
pub use unseen_pushes::{fit_passing_over_pushes, pass_over_pushes};
pub use verdict::DiscoverOptions;
pub use weak_form::{WeakFormRegression, fit_forces};
pub use window_fits::WindowFits;
pub use windows::{ContactWindows, contacts};

/// Reduced chi-square of the free motion above which structure remains.
pub const MISFIT: f64 = 1.3;
