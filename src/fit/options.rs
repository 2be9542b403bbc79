//! What a caller chooses about a fit.

use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FitOptions {
    /// Most iterations, over all stages.
    pub max_iterations: usize,
    pub method: Method,
    /// Where the search starts.
    #[serde(default, rename = "begin")]
    pub start_point: StartPoint,
    /// Share of the work limit (simulation steps) that the search may use; less where many models are tried, most of them wrong.
    #[serde(default = "whole_budget", skip_serializing_if = "is_whole_budget")]
    pub budget_fraction: f64,
    /// Whether the search uses derivatives of single precision; standard deviations always come from double precision.
    #[serde(skip)]
    pub single_precision: bool,
}

fn whole_budget() -> f64 {
    1.0
}

fn is_whole_budget(budget_fraction: &f64) -> bool {
    *budget_fraction == whole_budget()
}

impl Default for FitOptions {
    fn default() -> Self {
        FitOptions {
            max_iterations: 200,
            method: Method::default(),
            start_point: StartPoint::default(),
            budget_fraction: whole_budget(),
            single_precision: false,
        }
    }
}

/// Where a search starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StartPoint {
    /// At lines through the first frames of the tracks.
    #[default]
    Tracks,
    /// At the start states of the models.
    Models,
    /// At the start states of the models, whose unmeasured yaws were searched before.
    YawSearched,
    /// At the start states of the models, which are near the optimum: no growing horizon, no restarts.
    NearOptimum,
}

/// How the cost is minimised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Levenberg-Marquardt over the whole video, then over a growing horizon where that is not enough.
    #[default]
    GaussNewton,
    /// L-BFGS in the stages of the VRDP paper, for comparison; without the paper's last stage, which estimates the states again
    /// 20 frames before the video's end.
    Paper,
}
