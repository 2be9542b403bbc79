//! The errors of a model on one video as JSON.

use crate::api::v1::{ObjectComparison, Regime, VideoComparison};
use serde_json::{Value, json};

pub fn to_json(video: &VideoComparison) -> Value {
    let object = |o: &ObjectComparison| {
        json!({
            "object_id": o.object_id,
            "rmse_m": o.rmse,
            "worst_m": o.worst,
            "worst_frame": o.worst_frame,
            "reduced_chi_square": o.reduced_chi_square,
            "autocorrelation": o.autocorrelation,
        })
    };
    let regime = |r: &Regime| {
        json!({
            "regime": r.regime,
            "rmse_m": r.rmse,
            "reduced_chi_square": r.reduced_chi_square,
            "frames": r.frames,
        })
    };
    json!({
        "rmse_m": video.rmse,
        "noise_sigma_m": video.noise_sigma,
        "reduced_chi_square": video.reduced_chi_square,
        "held_out_rmse_m": video.held_out_rmse,
        "objects": video.objects.iter().map(object).collect::<Vec<_>>(),
        "regimes": video.regimes.iter().map(regime).collect::<Vec<_>>(),
    })
}
