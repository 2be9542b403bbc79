//! Progress of jobs to replies.

use crate::api::v1;
use crate::engine::{JobProgress, Phase};

pub fn progress_message(at: &JobProgress) -> v1::Progress {
    let phase = match at.phase {
        Phase::Waiting => v1::Phase::Waiting,
        Phase::Computing => v1::Phase::Computing,
        Phase::Fitting => v1::Phase::Fitting,
        Phase::Comparing => v1::Phase::Comparing,
        Phase::Diagnosing => v1::Phase::Diagnosing,
        Phase::Discovering => v1::Phase::Discovering,
        Phase::Revising => v1::Phase::Revising,
        Phase::Learning => v1::Phase::Learning,
        Phase::Storing => v1::Phase::Storing,
    };
    let time_left = at.time_left().and_then(|time| prost_types::Duration::try_from(time).ok());
    v1::Progress { fraction: at.fraction, phase: phase.into(), rmse: at.rmse, time_left, loss: at.loss }
}
