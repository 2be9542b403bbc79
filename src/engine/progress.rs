//! How far a job is: what it reports, and what its callers see of it.

use crate::fit::SceneFit;
use std::time::{Duration, Instant};

/// Smallest step of progress that is reported: a watcher needs no more.
const PROGRESS_STEP: f64 = 0.005;
/// Fraction from which the time left is estimated: before it, the pace is not known.
const MIN_FRACTION: f64 = 0.05;

/// What a job does now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Phase {
    /// For a CPU thread, or for the store.
    #[default]
    Waiting,
    /// On a CPU thread, with work that has no name of its own.
    Computing,
    Fitting,
    Comparing,
    Diagnosing,
    Discovering,
    Revising,
    Learning,
    /// The result is written to the data folder.
    Storing,
}

/// What a job reports.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Report {
    Phase(Phase),
    /// Done share of the whole job, 0 to 1.
    Fraction(f64),
    /// See [`JobProgress::rmse`].
    Rmse(f64),
    /// See [`JobProgress::loss`].
    Loss(f64),
}

/// How far a job is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JobProgress {
    /// 0 to 1, never falling.
    pub fraction: f64,
    pub phase: Phase,
    /// Root mean square position residual of the models that are fitted by now, each with the same weight (m).
    pub rmse: Option<f64>,
    /// Mean negative log probability of the right answers of the last batch, while words are trained (nat).
    pub loss: Option<f64>,
    /// When it left the queue.
    start: Option<Instant>,
}

impl Report {
    /// The error of fitted models; of several, each has the same weight.
    pub fn rmse(scenes: &[SceneFit]) -> Report {
        let squares: f64 = scenes.iter().map(|s| s.rmse * s.rmse).sum();
        Report::Rmse((squares / scenes.len().max(1) as f64).sqrt())
    }
}

impl JobProgress {
    /// Takes a report in; whether callers should see the change.
    pub fn update(&mut self, report: Report) -> bool {
        match report {
            Report::Phase(phase) => {
                if phase != Phase::Waiting {
                    self.start.get_or_insert_with(Instant::now);
                }
                std::mem::replace(&mut self.phase, phase) != phase
            }
            Report::Fraction(fraction) => {
                let fraction = fraction.min(1.0);
                let is_step = fraction >= self.fraction + PROGRESS_STEP;
                if is_step {
                    self.fraction = fraction;
                }
                is_step
            }
            Report::Rmse(rmse) => self.rmse.replace(rmse) != Some(rmse),
            // Each step has another one: callers see it with the next step of the fraction.
            Report::Loss(loss) => {
                self.loss = Some(loss);
                false
            }
        }
    }

    /// At the mean pace since it left the queue; `None` while that is not known.
    pub fn time_left(&self) -> Option<Duration> {
        let elapsed = self.start?.elapsed();
        (self.fraction >= MIN_FRACTION)
            .then(|| elapsed.mul_f64((1.0 - self.fraction).max(0.0) / self.fraction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_rises_and_the_time_left_is_unknown_at_first() {
        let mut progress = JobProgress::default();
        assert!(progress.update(Report::Fraction(0.5)) && !progress.update(Report::Fraction(0.4)));
        assert_eq!((progress.fraction, progress.time_left()), (0.5, None), "a job that waits has no pace");
        assert!(progress.update(Report::Phase(Phase::Fitting)));
        let start = progress.start;
        assert!(progress.update(Report::Phase(Phase::Storing)) && progress.start == start && start.is_some());
        assert!(progress.time_left().is_some());
        progress.update(Report::Fraction(1.0));
        assert_eq!(progress.time_left(), Some(Duration::ZERO));
        assert!(!progress.update(Report::Loss(0.7)) && progress.loss == Some(0.7), "seen with the next step");
        let early = JobProgress { fraction: 0.01, ..progress };
        assert_eq!(early.time_left(), None);
    }
}
