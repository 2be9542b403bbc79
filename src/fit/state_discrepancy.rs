//! State discrepancy: by how much the tracks differ from a fitted simulation at one instant, as far as noise does not explain it.
//! Predictions correct the simulation by it; it takes the place of the paper's last stage, a fit of the last 20 frames.
//!
//! 1. Residuals (measured minus simulated) of the up to 20 samples of one body nearest to the instant and between the same two
//!    contacts are fitted by a line: value and slope at the samples' mean time, each with a standard deviation sd. The deviations are
//!    multiplied by the root of the line's reduced chi-square where that is above 1.
//! 2. Value and slope are shrunk by the factor max(0, 1 - T N / sum_k (v_k / sd_k)^2), N coordinates, T = 6: a positive-part
//!    James-Stein estimator with a high threshold, which leaves an adequate model as it is.
//! 3. A draw from the posterior is corrected towards the same line, plus noise of the line's standard deviations.
//!
//! Source: James and Stein, Proceedings of the Fourth Berkeley Symposium 1 (1961) 361; Efron and Morris, JASA 68 (1973) 117.

use super::SceneFit;
use super::noise::Noise;
use crate::num::{Vec2, elementary, standard_normal, vec2, wrap_angle};
use crate::scene::Scene;
use crate::world::{EventKind, ObservationModel, State, StateCorrection, Trace};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Most samples of a line; the paper's last stage has as many frames.
const MAX_SAMPLES: usize = 20;
/// Fewest samples: a line through fewer gives no estimate of its own error.
const MIN_SAMPLES: usize = 4;
/// Threshold T of the shrinkage.
const SHRINKAGE: f64 = 6.0;

/// A line through the position and yaw residuals of one body near an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateDiscrepancy {
    id: u32,
    /// The instant, and how long after the mean time of the samples it is (s).
    time: f64,
    lead: f64,
    position: ResidualLine<2>,
    yaw: ResidualLine<1>,
}

/// Value at the samples' mean time and slope, each with its standard deviations and its shrinkage factor.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ResidualLine<const N: usize> {
    value: [f64; N],
    slope: [f64; N],
    value_sd: [f64; N],
    slope_sd: [f64; N],
    value_factor: f64,
    slope_factor: f64,
}

/// A residual.
struct TimedResidual<const N: usize> {
    /// From the mean time of the samples (s).
    time: f64,
    off: [f64; N],
    /// Of the measurement.
    variance: [f64; N],
}

/// The discrepancy of one body at `time` (s) from `run`, a simulation of its scene's fit at the frames of the video; `None` if noise
/// explains it.
pub fn state_discrepancy(
    scene: &Scene,
    fitted: &SceneFit,
    run: &Trace,
    body: usize,
    time: f64,
) -> Option<StateDiscrepancy> {
    let (object, track) = (scene.objects.get(body)?, scene.tracks.get(body)?);
    let contacts =
        run.events.iter().filter(|e| e.kind == EventKind::Collision && e.objects.contains(&object.id));
    let (mut from, mut until) = (f64::NEG_INFINITY, f64::INFINITY);
    for contact in contacts {
        if contact.time <= time {
            from = f64::max(from, contact.time);
        } else {
            until = f64::min(until, contact.time);
        }
    }
    let mut near: Vec<_> = track
        .samples
        .iter()
        .filter_map(|s| {
            let state = run.states.get(s.frame)?.get(body).copied().flatten()?;
            let at = scene.time_of(s.frame);
            (from < at && at < until).then_some((at, s, state))
        })
        .collect();
    near.sort_by(|a, b| (a.0 - time).abs().total_cmp(&(b.0 - time).abs()));
    near.truncate(MAX_SAMPLES);
    if near.len() < MIN_SAMPLES {
        return None;
    }
    let noise = Noise::of_fit(scene, fitted.noise_sigma);
    let centre = near.iter().map(|n| n.0).sum::<f64>() / near.len() as f64;
    let views = ObservationModel::new(&fitted.model, &fitted.model.flatten());
    let offsets = near.iter().map(|(t, s, state)| {
        let measured = views.true_position(body, s.position, state.yaw);
        let (off, c) = (measured - state.position, noise.covariance(s.covariance));
        TimedResidual { time: t - centre, off: [off.x, off.y], variance: [c.xx, c.yy] }
    });
    let position = ResidualLine::through(&offsets.collect::<Vec<_>>());
    let sigma = fitted.noise_yaw.filter(|_| !object.shape.is_ball());
    let turns = near.iter().filter_map(|(t, s, state)| {
        Some(TimedResidual {
            time: t - centre,
            off: [wrap_angle(s.yaw? - state.yaw)],
            variance: [sigma? * sigma?],
        })
    });
    let turns: Vec<_> = turns.collect();
    let yaw = if turns.len() == near.len() { ResidualLine::through(&turns) } else { ResidualLine::NONE };
    let found = StateDiscrepancy { id: object.id, time, lead: time - centre, position, yaw };
    (position.is_significant() || yaw.is_significant()).then_some(found)
}

impl<const N: usize> ResidualLine<N> {
    const NONE: ResidualLine<N> = ResidualLine {
        value: [0.0; N],
        slope: [0.0; N],
        value_sd: [0.0; N],
        slope_sd: [0.0; N],
        value_factor: 0.0,
        slope_factor: 0.0,
    };

    /// Weighted least squares; the weight of a point is one over the mean of its variances.
    fn through(points: &[TimedResidual<N>]) -> ResidualLine<N> {
        let weight = |p: &TimedResidual<N>| N as f64 / p.variance.iter().sum::<f64>();
        let total: f64 = points.iter().map(weight).sum();
        let spread: f64 = points.iter().map(|p| weight(p) * p.time * p.time).sum();
        if spread <= 0.0 {
            return ResidualLine::NONE;
        }
        let mut line = ResidualLine::NONE;
        let mut left = 0.0;
        for k in 0..N {
            let sum =
                |f: &dyn Fn(&TimedResidual<N>) -> f64| points.iter().map(|p| weight(p) * f(p)).sum::<f64>();
            line.value[k] = sum(&|p| p.off[k]) / total;
            line.slope[k] = sum(&|p| p.time * p.off[k]) / spread;
            line.value_sd[k] = sum(&|p| weight(p) * p.variance[k]).sqrt() / total;
            line.slope_sd[k] = sum(&|p| weight(p) * p.variance[k] * p.time * p.time).sqrt() / spread;
            let (value, slope) = (line.value[k], line.slope[k]);
            left += points
                .iter()
                .map(|p| elementary::powi(p.off[k] - value - slope * p.time, 2) / p.variance[k])
                .sum::<f64>();
        }
        // No line describes them better than this.
        let scatter = (left / (N as f64 * (points.len() as f64 - 2.0))).sqrt().max(1.0);
        line.value_sd.iter_mut().chain(&mut line.slope_sd).for_each(|sd| *sd *= scatter);
        let factor = |of: &[f64; N], sd: &[f64; N]| {
            let squares: f64 = of.iter().zip(sd).map(|(v, sd)| elementary::powi(v / sd, 2)).sum();
            (1.0 - SHRINKAGE * N as f64 / squares.max(f64::MIN_POSITIVE)).max(0.0)
        };
        line.value_factor = factor(&line.value, &line.value_sd);
        line.slope_factor = factor(&line.slope, &line.slope_sd);
        line
    }

    fn is_significant(&self) -> bool {
        self.value_factor > 0.0 || self.slope_factor > 0.0
    }

    /// Value and slope of the correction, `lead` (s) after the mean time, for a simulation whose own value and slope differ by `off`
    /// from the one that was measured.
    fn shift(&self, off: [[f64; N]; 2], lead: f64, mut noise: impl FnMut() -> f64) -> [[f64; N]; 2] {
        let mut shift = [[0.0; N]; 2];
        for k in 0..N {
            let slope = self.slope_factor * (self.slope[k] - off[1][k])
                + self.slope_factor.sqrt() * self.slope_sd[k] * noise();
            let centre = off[0][k] - off[1][k] * lead;
            let value = self.value_factor * (self.value[k] - centre)
                + self.value_factor.sqrt() * self.value_sd[k] * noise();
            shift[0][k] = value + slope * lead;
            shift[1][k] = slope;
        }
        shift
    }
}

impl StateDiscrepancy {
    /// The correction of the simulation that was measured.
    pub fn correction(&self) -> StateCorrection {
        let position = self.position.shift([[0.0; 2]; 2], self.lead, || 0.0);
        self.correction_of(position, self.yaw.shift([[0.0]; 2], self.lead, || 0.0))
    }

    /// The correction of draw number `draw` from the posterior, with `state` in the draw and `best` in the simulation that was
    /// measured: as far as the discrepancy is significant, it replaces the posterior's own spread.
    pub fn sample_correction(&self, draw: usize, state: &State, best: &State) -> StateCorrection {
        let mut random = ChaCha8Rng::seed_from_u64((draw as u64) << 32 | u64::from(self.id));
        let mut noise = || -> f64 { standard_normal(&mut random) };
        let (p, v) = (state.position - best.position, state.velocity - best.velocity);
        let position = self.position.shift([[p.x, p.y], [v.x, v.y]], self.lead, &mut noise);
        let turn = [[wrap_angle(state.yaw - best.yaw)], [state.spin - best.spin]];
        self.correction_of(position, self.yaw.shift(turn, self.lead, &mut noise))
    }

    fn correction_of(&self, position: [[f64; 2]; 2], turn: [[f64; 1]; 2]) -> StateCorrection {
        let vector = |[x, y]: [f64; 2]| -> Vec2 { vec2(x, y) };
        let ([position, velocity], [[yaw], [spin]]) = (position.map(vector), turn);
        StateCorrection { id: self.id, time: self.time, position, velocity, yaw, spin }
    }
}
