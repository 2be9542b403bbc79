//! What the engine computes and keeps: fits, revisions, studies, simulations and answers.

use crate::discover::{ChangeEvidence, Comparison, Diagnosis, Discovery, FoundEffect, PredictionErrors};
use crate::fit::Fit;
use crate::num::NUMERIC_FINGERPRINT;
use crate::reason::{Answer, Prediction};
use crate::scene::canonical_digest;
use serde::{Deserialize, Serialize};

/// The id of a result: a digest of `inputs`, of the program's version and of its arithmetic.
///
/// Numbers of a result depend on all three, so a program of another version or with other elementary functions never
/// finds a result of this one under its id: it computes the result again. Ids of videos are digests of what was
/// observed only; they stay the same.
pub fn result_digest<T: Serialize>(kind: &str, inputs: &T) -> String {
    canonical_digest(kind, &(inputs, env!("CARGO_PKG_VERSION"), NUMERIC_FINGERPRINT.as_str()))
}

/// A fit as it is stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredFit {
    pub video: String,
    pub id: String,
    /// Effects that were added since the preset.
    #[serde(default)]
    pub revision: u32,
    /// Of one scene, the video.
    pub fit: Fit,
    /// The revision that it belongs to; `None` for a plain fit.
    #[serde(default, rename = "step")]
    pub record: Option<RevisionRecord>,
}

/// A revision of the models of a set-up: its parent, the change, and the errors; the same for all its videos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RevisionRecord {
    /// Changes since the first revision.
    pub number: u32,
    pub videos: Vec<String>,
    /// Ids of its models, one a video.
    pub models: Vec<String>,
    /// Ids of the models of the parent revision; empty for the first.
    pub parents: Vec<String>,
    pub added: Option<FoundEffect>,
    pub removed: Option<String>,
    /// Root mean square position residual on all frames (m).
    pub rmse: f64,
    #[serde(rename = "unseen")]
    pub prediction_errors: PredictionErrors,
    pub reduced_chi_square: f64,
    /// Measurement noise of a position, all videos pooled (m).
    pub noise_sigma: f64,
    /// The evidence for the change, against its parent.
    #[serde(rename = "weight")]
    pub evidence: Option<ChangeEvidence>,
    /// Why its videos do not determine whether the change is worth making, and what to record instead.
    #[serde(default, rename = "too_little")]
    pub not_identifiable_reason: Option<String>,
}

/// A study of the videos of one set-up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Study {
    /// Ids, in an order that does not depend on the request's: the same videos are the same study.
    pub videos: Vec<String>,
    pub findings: Findings,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Findings {
    Comparison(Comparison),
    Diagnosis(Diagnosis),
    Discovery(Box<Discovered>),
    /// The parent revision and the new one.
    Changed(Box<[RevisionRecord; 2]>),
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Discovered {
    pub discovery: Discovery,
    /// One a revision.
    #[serde(rename = "steps")]
    pub records: Vec<RevisionRecord>,
    /// One a video.
    #[serde(rename = "courses")]
    pub trajectories: Vec<TrajectoryPair>,
}

/// x, y (m) and yaw (rad); `None` where the object is absent.
pub type OptionalPose = Option<[f64; 3]>;

/// One video simulated without and with the effects that were added: `[frame][object]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrajectoryPair {
    pub before: Vec<Vec<OptionalPose>>,
    pub after: Vec<Vec<OptionalPose>>,
}

/// A simulation whose trace is stored.
#[derive(Debug)]
pub struct PublishedSimulation {
    pub model: String,
    pub fps: f64,
    /// Without its ensemble.
    pub prediction: Prediction,
    pub trace: String,
}

/// An answer whose traces are stored.
#[derive(Debug)]
pub struct PublishedAnswer {
    pub model: String,
    /// Its simulations without their ensembles.
    pub answer: Answer,
    pub traces: Vec<String>,
    /// The language model that wrote the program; `None`: our reader, or the caller.
    pub parser: Option<String>,
}
