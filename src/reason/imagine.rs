//! Predictions and counterfactuals over an ensemble drawn from the posterior.

use super::ReasonError;
use crate::fit::Fit;
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::{Event, Intervention, Model, Trace, trace};
use serde::{Deserialize, Serialize};

/// Most frames of one simulation.
pub const MAX_SIMULATED_FRAMES: usize = 20_000;

/// One simulation request, answered: the best rollout and how sure it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Imagined {
    pub interventions: Vec<Intervention>,
    /// Frames of the video itself.
    pub observed_frames: usize,
    /// The model that the best rollout simulated.
    pub model: Model,
    /// The rollout at the best parameters, one row a frame from frame 0.
    pub best: Trace,
    /// Rollouts of models drawn from the posterior.
    pub ensemble: Vec<Trace>,
    /// `sd[frame][body]`: spread of the position over the ensemble, per coordinate (m); `None` where absent.
    pub sd: Vec<Vec<Option<f64>>>,
    /// Events of the best rollout and others that the ensemble finds likely, by time.
    pub events: Vec<LikelyEvent>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LikelyEvent {
    pub event: Event,
    pub frame: usize,
    /// Share of the rollouts in which it happens.
    pub probability: f64,
}

/// Simulates scene `index` of the fit for `frames` frames under the interventions (none: the prediction).
/// `rollouts` models are drawn with `seed`. Deterministic.
pub fn imagine(
    scene: &Scene,
    fit: &Fit,
    index: usize,
    interventions: &[Intervention],
    frames: usize,
    rollouts: usize,
    seed: u64,
    stop: Stop,
) -> Result<Imagined, ReasonError> {
    if frames == 0 || frames > MAX_SIMULATED_FRAMES {
        return Err(ReasonError::Frames { frames, most: MAX_SIMULATED_FRAMES });
    }
    let times: Vec<f64> = (0..frames).map(|f| scene.time_of(f)).collect();
    let edit = |model: &Model| interventions.iter().try_fold(model.clone(), |m, i| i.apply(&m));
    let model = edit(&fit.scenes[index].model)?;
    let best = trace(&model, &times);
    let mut ensemble = Vec::with_capacity(rollouts);
    for drawn in fit.draw(index, rollouts, seed) {
        stop(ensemble.len() as f64 / rollouts as f64)?;
        ensemble.push(trace(&edit(&drawn)?, &times));
    }
    let sd = best.states.iter().map(|row| row.iter().map(|s| s.map(|_| 0.0)).collect()).collect();
    let events = best
        .events
        .iter()
        .map(|e| LikelyEvent { event: e.clone(), frame: scene.frame_at(e.time), probability: 1.0 })
        .collect();
    Ok(Imagined {
        interventions: interventions.to_vec(),
        observed_frames: scene.times.len(),
        model,
        best,
        ensemble,
        sd,
        events,
    })
}
