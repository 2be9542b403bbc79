//! What the tracks say against a fitted simulation at one instant: a shift of each body's state, as far as noise does
//! not explain it.

use super::SceneFit;
use super::noise::Noise;
use crate::num::{Vec2, vec2, wrapped};
use crate::scene::Scene;
use crate::world::{Anchor, EventKind, State, Trace, Views};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// Samples of a track that are read, those nearest to the instant; the paper's last stage has as many frames.
const SAMPLES: usize = 20;
/// Fewest samples: a line through fewer says nothing of its own error.
const FEWEST: usize = 4;
/// A deviation is believed where its square is beyond this many times what noise makes of it, and then less by as much
/// (a positive-part James-Stein estimate with a high threshold: an adequate model is left as it is).
const BELIEVED: f64 = 6.0;

/// A line through the residuals (measured minus simulated) of one body near an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    id: u32,
    /// The instant, and how long after the centre of the samples it is (s).
    time: f64,
    lead: f64,
    place: Line<2>,
    yaw: Line<1>,
}

/// Value at the centre and slope, each with its standard deviations and the share of it that is believed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line<const N: usize> {
    value: [f64; N],
    slope: [f64; N],
    value_sd: [f64; N],
    slope_sd: [f64; N],
    value_share: f64,
    slope_share: f64,
}

/// A residual.
struct Point<const N: usize> {
    /// From the centre of the samples (s).
    time: f64,
    off: [f64; N],
    /// Of the measurement's noise.
    variance: [f64; N],
}

/// How a body deviates at `time` (s) from a simulation of its scene's fit, `run`, which has the frames of the video;
/// `None` where noise explains it. Read are samples of the stretch between two contacts in which `time` is.
pub fn deviation(scene: &Scene, fitted: &SceneFit, run: &Trace, body: usize, time: f64) -> Option<Deviation> {
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
    near.truncate(SAMPLES);
    if near.len() < FEWEST {
        return None;
    }
    let noise = Noise::of_fit(scene, fitted.noise_sigma);
    let centre = near.iter().map(|n| n.0).sum::<f64>() / near.len() as f64;
    let views = Views::new(&fitted.model, &fitted.model.flatten());
    let places = near.iter().map(|(t, s, state)| {
        let measured = views.undone(body, s.position, state.yaw);
        let (off, c) = (measured - state.position, noise.covariance(s.covariance));
        Point { time: t - centre, off: [off.x, off.y], variance: [c.xx, c.yy] }
    });
    let place = Line::through(&places.collect::<Vec<_>>());
    let sigma = fitted.noise_yaw.filter(|_| !object.shape.is_ball());
    let turns = near.iter().filter_map(|(t, s, state)| {
        Some(Point { time: t - centre, off: [wrapped(s.yaw? - state.yaw)], variance: [sigma? * sigma?] })
    });
    let turns: Vec<_> = turns.collect();
    let yaw = if turns.len() == near.len() { Line::through(&turns) } else { Line::NONE };
    let found = Deviation { id: object.id, time, lead: time - centre, place, yaw };
    (place.is_believed() || yaw.is_believed()).then_some(found)
}

impl<const N: usize> Line<N> {
    const NONE: Line<N> = Line {
        value: [0.0; N],
        slope: [0.0; N],
        value_sd: [0.0; N],
        slope_sd: [0.0; N],
        value_share: 0.0,
        slope_share: 0.0,
    };

    /// By least squares, each point weighed by the mean of its variances.
    fn through(points: &[Point<N>]) -> Line<N> {
        let weight = |p: &Point<N>| N as f64 / p.variance.iter().sum::<f64>();
        let total: f64 = points.iter().map(weight).sum();
        let spread: f64 = points.iter().map(|p| weight(p) * p.time * p.time).sum();
        if spread <= 0.0 {
            return Line::NONE;
        }
        let mut line = Line::NONE;
        let mut left = 0.0;
        for k in 0..N {
            let sum = |f: &dyn Fn(&Point<N>) -> f64| points.iter().map(|p| weight(p) * f(p)).sum::<f64>();
            line.value[k] = sum(&|p| p.off[k]) / total;
            line.slope[k] = sum(&|p| p.time * p.off[k]) / spread;
            line.value_sd[k] = sum(&|p| weight(p) * p.variance[k]).sqrt() / total;
            line.slope_sd[k] = sum(&|p| weight(p) * p.variance[k] * p.time * p.time).sqrt() / spread;
            let (value, slope) = (line.value[k], line.slope[k]);
            left += points
                .iter()
                .map(|p| (p.off[k] - value - slope * p.time).powi(2) / p.variance[k])
                .sum::<f64>();
        }
        // Where no line describes them, it is known less well than the noise says.
        let scatter = (left / (N as f64 * (points.len() as f64 - 2.0))).sqrt().max(1.0);
        line.value_sd.iter_mut().chain(&mut line.slope_sd).for_each(|sd| *sd *= scatter);
        let share = |of: &[f64; N], sd: &[f64; N]| {
            let squares: f64 = of.iter().zip(sd).map(|(v, sd)| (v / sd).powi(2)).sum();
            (1.0 - BELIEVED * N as f64 / squares.max(f64::MIN_POSITIVE)).max(0.0)
        };
        line.value_share = share(&line.value, &line.value_sd);
        line.slope_share = share(&line.slope, &line.slope_sd);
        line
    }

    fn is_believed(&self) -> bool {
        self.value_share > 0.0 || self.slope_share > 0.0
    }

    /// What it moves a simulation by whose own value and slope are `off` the one that it was measured against, after
    /// `lead` (s): value and slope.
    fn shift(&self, off: [[f64; N]; 2], lead: f64, mut noise: impl FnMut() -> f64) -> [[f64; N]; 2] {
        let mut shift = [[0.0; N]; 2];
        for k in 0..N {
            let slope = self.slope_share * (self.slope[k] - off[1][k])
                + self.slope_share.sqrt() * self.slope_sd[k] * noise();
            let centre = off[0][k] - off[1][k] * lead;
            let value = self.value_share * (self.value[k] - centre)
                + self.value_share.sqrt() * self.value_sd[k] * noise();
            shift[0][k] = value + slope * lead;
            shift[1][k] = slope;
        }
        shift
    }
}

impl Deviation {
    /// What puts the simulation right that the deviation was measured against.
    pub fn anchor(&self) -> Anchor {
        let place = self.place.shift([[0.0; 2]; 2], self.lead, || 0.0);
        self.anchored(place, self.yaw.shift([[0.0]; 2], self.lead, || 0.0))
    }

    /// The same of draw number `draw` from the posterior, `state` in it and `best` in the simulation that was measured:
    /// as far as the deviation is believed, it takes the place of the posterior's own spread.
    pub fn drawn(&self, draw: usize, state: &State, best: &State) -> Anchor {
        let mut random = ChaCha8Rng::seed_from_u64((draw as u64) << 32 | u64::from(self.id));
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        let (p, v) = (state.position - best.position, state.velocity - best.velocity);
        let place = self.place.shift([[p.x, p.y], [v.x, v.y]], self.lead, &mut noise);
        let turn = [[wrapped(state.yaw - best.yaw)], [state.spin - best.spin]];
        self.anchored(place, self.yaw.shift(turn, self.lead, &mut noise))
    }

    fn anchored(&self, place: [[f64; 2]; 2], turn: [[f64; 1]; 2]) -> Anchor {
        let vector = |[x, y]: [f64; 2]| -> Vec2 { vec2(x, y) };
        let ([position, velocity], [[yaw], [spin]]) = (place.map(vector), turn);
        Anchor { id: self.id, time: self.time, position, velocity, yaw, spin }
    }
}
