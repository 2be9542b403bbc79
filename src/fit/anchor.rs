//! What the tracks say against a fitted simulation at one instant: a shift of each body's state, as far as noise does
//! not explain it.

use super::SceneFit;
use super::noise::wrapped;
use crate::num::{Vec2, vec2};
use crate::scene::Scene;
use crate::world::{Anchor, EventKind, State, Trace};
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

/// Value at the centre and slope, each with its standard deviation and the share of it that is believed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line<const N: usize> {
    value: [f64; N],
    slope: [f64; N],
    value_sd: f64,
    slope_sd: f64,
    value_share: f64,
    slope_share: f64,
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
    let centre = near.iter().map(|n| n.0).sum::<f64>() / near.len() as f64;
    let places = near.iter().map(|(t, s, state)| {
        let off = s.position - state.position;
        (t - centre, [off.x, off.y])
    });
    let turns = near.iter().filter_map(|(t, s, state)| Some((t - centre, [wrapped(s.yaw? - state.yaw)])));
    let turns: Vec<_> = if object.shape.is_ball() { vec![] } else { turns.collect() };
    let place = Line::through(&places.collect::<Vec<_>>(), fitted.noise_sigma);
    let yaw = match fitted.noise_yaw {
        Some(sigma) if turns.len() == near.len() => Line::through(&turns, sigma),
        _ => Line::NONE,
    };
    let found = Deviation { id: object.id, time, lead: time - centre, place, yaw };
    (place.is_believed() || yaw.is_believed()).then_some(found)
}

impl<const N: usize> Line<N> {
    const NONE: Line<N> = Line {
        value: [0.0; N],
        slope: [0.0; N],
        value_sd: 0.0,
        slope_sd: 0.0,
        value_share: 0.0,
        slope_share: 0.0,
    };

    /// By least squares through points (time from their centre, residual) with noise `sigma`.
    fn through(points: &[(f64, [f64; N])], sigma: f64) -> Line<N> {
        let n = points.len() as f64;
        let spread: f64 = points.iter().map(|p| p.0 * p.0).sum();
        if spread <= 0.0 {
            return Line::NONE;
        }
        let mut line = Line::NONE;
        for k in 0..N {
            line.value[k] = points.iter().map(|p| p.1[k]).sum::<f64>() / n;
            line.slope[k] = points.iter().map(|p| p.0 * p.1[k]).sum::<f64>() / spread;
        }
        let left = |p: &(f64, [f64; N])| -> f64 {
            (0..N).map(|k| (p.1[k] - line.value[k] - line.slope[k] * p.0).powi(2)).sum()
        };
        // Where no line describes them, it is known less well than the noise says.
        let left = points.iter().map(left).sum::<f64>() / (N as f64 * (n - 2.0));
        let scatter = left.sqrt().max(sigma);
        (line.value_sd, line.slope_sd) = (scatter / n.sqrt(), scatter / spread.sqrt());
        let share = |of: &[f64; N], sd: f64| {
            let squares: f64 = of.iter().map(|v| v * v).sum();
            (1.0 - BELIEVED * N as f64 * sd * sd / squares.max(f64::MIN_POSITIVE)).max(0.0)
        };
        line.value_share = share(&line.value, line.value_sd);
        line.slope_share = share(&line.slope, line.slope_sd);
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
                + self.slope_share.sqrt() * self.slope_sd * noise();
            let centre = off[0][k] - off[1][k] * lead;
            let value = self.value_share * (self.value[k] - centre)
                + self.value_share.sqrt() * self.value_sd * noise();
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
