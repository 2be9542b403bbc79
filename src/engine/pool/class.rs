//! Kinds of jobs, and the classes by which they share the workers.
//!
//! | class | is | of n workers at most |
//! |---|---|---|
//! | short | milliseconds: an answer, a simulation, draws, the conversion of an upload, a page | n |
//! | medium | a second: a fit of one video, its comparison, many rollouts or detections, a video file | n - 1 of medium and long; n where n <= 2 |
//! | long | minutes: a discovery, a joint fit, learning | n - 2, but at least 1 |
//!
//! From three workers on, one is thus always free of medium and long work, and a fit finds one that no discovery holds. With
//! fewer, longer jobs give way to shorter ones (`scheduler`). A fit is not long, as it would wait for discoveries; it is not
//! short, as fits on all workers would delay answers.

/// What a job computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobKind {
    Answer,
    /// Of a question.
    Parsing,
    Simulation,
    Draws,
    /// The scene of a usual upload.
    Conversion,
    Calibration,
    Page,
    /// Something small that has no name of its own.
    Computation,
    Fit,
    Comparison,
    /// An answer or a simulation with many rollouts.
    Ensemble,
    /// The scene of many detections.
    Linking,
    /// One word from a few examples.
    WordLearning,
    /// Tracks from a video file.
    Perception,
    JointFit,
    Diagnosis,
    Revision,
    Discovery,
    Learning,
}

impl JobKind {
    pub fn name(self) -> &'static str {
        match self {
            JobKind::Answer => "answer",
            JobKind::Parsing => "parsing",
            JobKind::Simulation => "simulation",
            JobKind::Draws => "draws",
            JobKind::Conversion => "conversion",
            JobKind::Calibration => "calibration",
            JobKind::Page => "page",
            JobKind::Computation => "computation",
            JobKind::Fit => "fit",
            JobKind::Comparison => "comparison",
            JobKind::Ensemble => "ensemble",
            JobKind::Linking => "linking",
            JobKind::WordLearning => "word_learning",
            JobKind::Perception => "perception",
            JobKind::JointFit => "joint_fit",
            JobKind::Diagnosis => "diagnosis",
            JobKind::Revision => "revision",
            JobKind::Discovery => "discovery",
            JobKind::Learning => "learning",
        }
    }

    pub fn class(self) -> JobClass {
        match self {
            JobKind::Answer
            | JobKind::Parsing
            | JobKind::Simulation
            | JobKind::Draws
            | JobKind::Conversion
            | JobKind::Calibration
            | JobKind::Page
            | JobKind::Computation => JobClass::Short,
            JobKind::Fit
            | JobKind::Comparison
            | JobKind::Ensemble
            | JobKind::Linking
            | JobKind::WordLearning
            | JobKind::Perception => JobClass::Medium,
            JobKind::JointFit
            | JobKind::Diagnosis
            | JobKind::Revision
            | JobKind::Discovery
            | JobKind::Learning => JobClass::Long,
        }
    }
}

/// How long jobs of a kind usually run; a later class is longer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum JobClass {
    Short,
    Medium,
    Long,
}

impl JobClass {
    pub const ALL: [JobClass; 3] = [JobClass::Short, JobClass::Medium, JobClass::Long];

    /// CPU time of a job until it is known (s).
    pub fn usual_cost(self) -> f64 {
        match self {
            JobClass::Short => 0.02,
            JobClass::Medium => 0.5,
            JobClass::Long => 30.0,
        }
    }

    /// Most of `workers` that jobs of this class and longer ones may hold together.
    pub fn most(self, workers: usize) -> usize {
        match self {
            JobClass::Short => workers,
            JobClass::Medium if workers > 2 => workers - 1,
            JobClass::Medium => workers,
            JobClass::Long => workers.saturating_sub(2).max(1),
        }
    }
}
