//! Computes what the pictures show: simulations of the first and the last model, and their residuals.

use super::ReportData;
use crate::discover::{UnexplainedAcceleration, failures, unexplained};
use crate::fit::{Fit, estimate_noise};
use crate::num::elementary;
use crate::scene::Scene;
use crate::world::{EventKind, Model, Trace, trace};
use std::collections::BTreeMap;

/// Number of predicted frames after the video.
pub const FUTURE: usize = 60;
/// Number of lags of the autocorrelation.
const LAGS: usize = 25;
/// The missing acceleration has a direction if its mean is this many standard deviations from zero.
const SIGNIFICANT: f64 = 5.0;
/// Half-width of the 99 % band of a normal distribution, in standard deviations.
pub const NINETY_NINE: f64 = 2.576;

/// A model, simulated on all videos.
pub struct ModelStage {
    /// One for each video, with [`FUTURE`] frames after it.
    pub runs: Vec<Trace>,
    /// One list for each video.
    pub residuals: Vec<Vec<PositionResidual>>,
    pub unexplained: Vec<UnexplainedAcceleration>,
    /// Autocorrelation of the residuals from lag 0 on; both coordinates and all tracks are pooled.
    pub autocorrelation: Vec<f64>,
    /// `1 - |measured - simulated| / |measured - mean|` (%), the fit percentage of system identification; at most 100.
    pub fit_percent: f64,
    /// Root mean square residual (m) and number of positions of each regime.
    pub regimes: Vec<(String, f64, usize)>,
}

/// One residual of a position.
pub struct PositionResidual {
    pub object: usize,
    pub frame: usize,
    /// Measured (m).
    pub at: [f64; 2],
    /// Measured minus simulated (m).
    pub off: [f64; 2],
}

impl PositionResidual {
    pub fn size(&self) -> f64 {
        elementary::hypot(self.off[0], self.off[1])
    }
}

/// All computed parts of a report.
pub struct ReportViews {
    /// The first and the last model; one if no effect was added.
    pub stages: Vec<ModelStage>,
    /// Their names, such as `without coriolis`.
    pub names: Vec<String>,
    /// Measurement noise of each video (m).
    pub noise: Vec<f64>,
    /// Number of positions of all tracks; determines the band of the autocorrelation.
    pub count: usize,
}

impl ReportViews {
    pub fn of(report: &ReportData) -> ReportViews {
        let revisions = &report.discovery.revisions;
        let ends = match &revisions[..] {
            [] => vec![],
            [only] => vec![only],
            [first, .., last] => vec![first, last],
        };
        let stages = ends.iter().map(|r| stage(report.scenes, &r.fit)).collect();
        let noise = report.scenes.iter().map(|s| estimate_noise(s).position).collect();
        let tracks = report.scenes.iter().flat_map(|s| &s.tracks);
        let added = match &report.discovery.effects[..] {
            [only] => label(&only.effect),
            [] => "it".into(),
            _ => "them".into(),
        };
        let names = match ends.len() {
            2 if report.kept.is_some() => report.kept.map_or(vec![], |kept| kept.names.to_vec()),
            2 => vec![format!("without {added}"), format!("with {added}")],
            _ => vec!["the model".into()],
        };
        ReportViews { stages, names, noise, count: tracks.map(|t| t.samples.len()).sum() }
    }

    /// The largest residual of the first model in a video; `None` if there is only one model.
    pub fn farthest(&self, video: usize) -> Option<&PositionResidual> {
        let first = self.stages.first().filter(|_| self.stages.len() > 1)?;
        first.residuals.get(video)?.iter().max_by(|a, b| a.size().total_cmp(&b.size()))
    }

    /// Times of the collisions of the last model within the video (s).
    pub fn contacts(&self, video: usize, scene: &Scene) -> Vec<f64> {
        let end = scene.times.last().copied().unwrap_or(0.0);
        let run = self.stages.last().and_then(|s| s.runs.get(video));
        let events = run.into_iter().flat_map(|r| &r.events).filter(|e| e.kind == EventKind::Collision);
        events.map(|e| e.time).filter(|t| *t <= end).collect()
    }
}

fn stage(scenes: &[Scene], fit: &Fit) -> ModelStage {
    let models = fit.models();
    let run = |(scene, model): (&Scene, &Model)| {
        let times: Vec<f64> = (0..scene.times.len() + FUTURE).map(|f| scene.time_of(f)).collect();
        trace(model, &times).as_observed(model)
    };
    let runs: Vec<Trace> = scenes.iter().zip(&models).map(run).collect();
    let residuals: Vec<Vec<PositionResidual>> =
        scenes.iter().zip(&runs).map(|(s, r)| residuals(s, r)).collect();
    ModelStage {
        unexplained: unexplained(scenes, &models),
        autocorrelation: autocorrelation(scenes, &residuals),
        fit_percent: fit_percent(scenes, &residuals),
        regimes: regimes(scenes, &models),
        residuals,
        runs,
    }
}

/// The direction of the missing acceleration in words, if it is significant.
pub fn direction(lacks: &[UnexplainedAcceleration]) -> Option<&'static str> {
    // The mean in units of its standard deviation.
    let significance = |part: fn(&UnexplainedAcceleration) -> f64| {
        let (mean, sd) = weighted_mean(lacks, part);
        mean / sd
    };
    let (along, left) = (significance(along), significance(left));
    let fixed = elementary::hypot(significance(|u| u.acceleration.x), significance(|u| u.acceleration.y));
    let directions = [
        (along, "along the motion"),
        (-along, "against the motion"),
        (left, "to the left of the motion"),
        (-left, "to the right of the motion"),
        (fixed, "the same way everywhere"),
    ];
    let (most, words) = directions.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    (most > SIGNIFICANT).then_some(words)
}

/// The missing acceleration along the velocity (m/s²).
pub fn along(u: &UnexplainedAcceleration) -> f64 {
    u.acceleration.dot(u.velocity) / u.velocity.norm().max(1e-9)
}

/// The missing acceleration to the left of the velocity (m/s²).
pub fn left(u: &UnexplainedAcceleration) -> f64 {
    u.velocity.cross(u.acceleration) / u.velocity.norm().max(1e-9)
}

/// Mean of a component, weighted by inverse variance, and its standard deviation.
pub fn weighted_mean<'u>(
    lacks: impl IntoIterator<Item = &'u UnexplainedAcceleration>,
    part: fn(&UnexplainedAcceleration) -> f64,
) -> (f64, f64) {
    let mut sums = (0.0, 0.0);
    for u in lacks {
        let weight = 1.0 / (u.sd * u.sd).max(1e-12);
        sums = (sums.0 + weight * part(u), sums.1 + weight);
    }
    let whole = f64::max(sums.1, 1e-12);
    (sums.0 / whole, 1.0 / whole.sqrt())
}

pub fn residuals(scene: &Scene, run: &Trace) -> Vec<PositionResidual> {
    let mut all = vec![];
    for (object, track) in scene.tracks.iter().enumerate() {
        for s in &track.samples {
            let state = run.states.get(s.frame).and_then(|row| row.get(object).copied().flatten());
            if let Some(state) = state {
                let d = s.position - state.position;
                let at = [s.position.x, s.position.y];
                all.push(PositionResidual { object, frame: s.frame, at, off: [d.x, d.y] });
            }
        }
    }
    all
}

fn autocorrelation(scenes: &[Scene], residuals: &[Vec<PositionResidual>]) -> Vec<f64> {
    let mut products = [0.0; LAGS + 1];
    for (scene, all) in scenes.iter().zip(residuals) {
        for object in 0..scene.objects.len() {
            let own: Vec<&PositionResidual> = all.iter().filter(|r| r.object == object).collect();
            for (lag, sum) in products.iter_mut().enumerate() {
                let pairs = own.iter().zip(own.iter().skip(lag)).filter(|(a, b)| b.frame == a.frame + lag);
                *sum += pairs.map(|(a, b)| a.off[0] * b.off[0] + a.off[1] * b.off[1]).sum::<f64>();
            }
        }
    }
    let whole = products[0].max(f64::MIN_POSITIVE);
    products.iter().map(|p| p / whole).collect()
}

fn fit_percent(scenes: &[Scene], residuals: &[Vec<PositionResidual>]) -> f64 {
    let squares: f64 = residuals.iter().flatten().map(|r| elementary::powi(r.size(), 2)).sum();
    let mut motion = 0.0;
    for samples in scenes.iter().flat_map(|s| &s.tracks).map(|t| &t.samples) {
        let count = samples.len().max(1) as f64;
        let (x, y) = samples.iter().fold((0.0, 0.0), |(x, y), s| (x + s.position.x, y + s.position.y));
        let (x, y) = (x / count, y / count);
        motion += samples
            .iter()
            .map(|s| elementary::powi(s.position.x - x, 2) + elementary::powi(s.position.y - y, 2))
            .sum::<f64>();
    }
    100.0 * (1.0 - (squares / motion.max(f64::MIN_POSITIVE)).sqrt())
}

fn regimes(scenes: &[Scene], models: &[Model]) -> Vec<(String, f64, usize)> {
    let mut order = vec![];
    let mut sums: BTreeMap<String, (f64, usize)> = BTreeMap::new();
    for regime in scenes.iter().zip(models).flat_map(|(s, m)| failures(s, m)) {
        if !order.contains(&regime.regime) {
            order.push(regime.regime.clone());
        }
        let sum = sums.entry(regime.regime).or_default();
        sum.0 += regime.rmse * regime.rmse * regime.frames as f64;
        sum.1 += regime.frames;
    }
    let pooled = |name: String| {
        let (squares, frames) = sums.get(&name).copied().unwrap_or_default();
        (name, (squares / frames.max(1) as f64).sqrt(), frames)
    };
    order.into_iter().map(pooled).collect()
}

/// The name of an effect in words.
pub fn label(effect: &str) -> String {
    effect.replace('_', " ")
}
