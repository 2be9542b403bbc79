//! The launch that would tell two laws apart: simulate both, pick where they differ most.

use super::outcome::Experiment;
use super::revise::pooled_noise;
use super::screen::ForceCandidate;
use super::search::FreeMotion;
use super::weak_form::WeakFormRegression;
use crate::num::{Vec2, elementary, vec2};
use crate::world::{BodySpec, Model, Start, State, trace};

/// Launch speeds (m/s), directions, and how long to look (s).
const SPEEDS: [f64; 3] = [0.3, 1.0, 2.0];
const DIRECTIONS: usize = 8;
const TIME: f64 = 3.0;
/// Masses beside the objects' own: a law that is the same for all masses shows on others.
const MASSES: [f64; 3] = [1.0, 0.3, 3.0];

/// The best launch of one object alone between the first two of the `kinds` that these videos do not distinguish, or of the laws
/// that are `alike`.
pub fn tell_apart(
    lens: &WeakFormRegression,
    motion: &FreeMotion,
    kinds: &[String],
    alike: &[ForceCandidate],
) -> Option<Experiment> {
    let law = |kind: &String| match motion.ranked.iter().find(|(_, c)| c.entry.kind == kind) {
        Some((_, c)) => c.models.first(),
        // Two laws.
        None => motion.models.first(),
    };
    let laws: Vec<&Model> = match kinds {
        [] => alike.iter().filter_map(|c| c.models.first()).collect(),
        _ => kinds.iter().filter_map(law).collect(),
    };
    let [one, other] = laws.get(..2)? else { return None };
    let sigma = pooled_noise(lens);
    let tracks = lens.scenes.iter().flat_map(|s| &s.tracks).flat_map(|t| &t.samples);
    let (sum, count) = tracks.fold((Vec2::zero(), 0.0), |(s, n), x| (s + x.position, n + 1.0));
    let position = sum.scaled(1.0 / f64::max(count, 1.0));
    let mut best: Option<Experiment> = None;
    for body in &one.bodies {
        for mass in MASSES.map(|factor| factor * body.mass) {
            for speed in SPEEDS {
                for k in 0..DIRECTIONS {
                    let angle = std::f64::consts::TAU * k as f64 / DIRECTIONS as f64;
                    let velocity = vec2(elementary::cos(angle), elementary::sin(angle)).scaled(speed);
                    let apart = (landing(one, body, mass, position, velocity)?
                        - landing(other, body, mass, position, velocity)?)
                    .norm()
                        / sigma;
                    if best.as_ref().is_none_or(|b| apart > b.sigmas) {
                        let shape = body.shape.word().to_string();
                        best =
                            Some(Experiment { shape, mass, position, velocity, time: TIME, sigmas: apart });
                    }
                }
            }
        }
    }
    best
}

/// Where the object is after the time, launched alone.
fn landing(law: &Model, body: &BodySpec, mass: f64, position: Vec2, velocity: Vec2) -> Option<Vec2> {
    let mut model = law.clone();
    let mut alone = body.clone();
    alone.mass = mass;
    alone.start = Start {
        time: 0.0,
        state: State { position, velocity, ..State::default() },
        rolling: body.start.rolling,
    };
    model.bodies = vec![alone];
    let rollout = trace(&model, &[0.0, TIME]);
    rollout.states.last()?.first()?.map(|s| s.position)
}
