//! The parameters that a fit searches: which values of the models are free, their bounds and priors.

use super::super::noise::Noise;
use crate::effects::{ActsOn, Hook, effect};
use crate::num::{Bounds, elementary};
use crate::scene::Scene;
use crate::world::{
    ActiveEffect, BODY_VALUES, BodySpec, IMPULSE_VALUES, MASS, MASS_BOUNDS, Model, Parameter, SPINS,
    UnknownImpulse,
};

/// A force parameter whose prior standard deviation is at most this share of its mean is frozen until the motion is right:
/// it hardly moves, but would cost a part of every pass with derivatives.
const WELL_KNOWN: f64 = 0.1;

/// Place of the delay in [`IMPULSE_VALUES`], and its bound in prior standard deviations: one of these is half a frame, so that the
/// bound is the next frame but one.
const IMPULSE_DELAY: usize = 3;
const MAX_DELAY: f64 = 3.0;

/// One parameter, in the space in which it is searched.
#[derive(Debug, Clone)]
pub(in super::super) struct SearchParameter {
    /// Index of its scene; `None` if scenes share it.
    pub scene: Option<usize>,
    pub name: String,
    pub unit: String,
    /// Whether it is searched as a logarithm (masses).
    pub log: bool,
    pub min: f64,
    pub max: f64,
    /// Prior mean and standard deviation, in search space; an infinite deviation is no prior.
    pub mean: f64,
    pub sd: f64,
    /// Whether it stays where it is for now.
    pub frozen: bool,
}

impl SearchParameter {
    /// Negative logarithm of the prior density, but for a constant.
    pub fn prior_cost(&self, x: f64) -> f64 {
        0.5 * elementary::powi((x - self.mean) / self.sd, 2)
    }

    /// The value in a model for a value in search space.
    pub fn in_model(&self, x: f64) -> f64 {
        if self.log { elementary::exp(x) } else { x }
    }

    pub fn bounds(&self) -> Bounds {
        Bounds { min: self.min, max: self.max, frozen: self.frozen }
    }
}

/// Index in [`Model::flatten`], and index of the search parameter whose value it is.
pub(super) type Slot = (usize, usize);

/// Adds the free parameters of one scene to `all`; a shared parameter that is there already is not added again. Returns the slots.
pub(super) fn add_parameters(
    index: usize,
    (scene, model, noise): (&Scene, &Model, &Noise),
    all: &mut Vec<SearchParameter>,
) -> Vec<Slot> {
    let mut list = ParameterList { index, all, slots: vec![] };
    for (b, body) in model.bodies.iter().enumerate() {
        list.add_start_state(b, body, (scene, model, noise));
        if scene.objects[b].mass.is_none() {
            list.add_mass(b, body, model.mass_sd);
        }
    }
    let mut at = BODY_VALUES.len() * model.bodies.len();
    for active in &model.effects {
        for k in 0..active.parameters.len() {
            list.add_effect_parameter(active, k, &model.bodies, &mut at);
        }
    }
    for (which, impulse) in model.impulses.iter().enumerate() {
        list.add_impulse(which, impulse, at + which * IMPULSE_VALUES.len());
    }
    list.slots
}

/// The parameters so far, and the slots of the scene that is being added.
struct ParameterList<'a> {
    index: usize,
    all: &'a mut Vec<SearchParameter>,
    slots: Vec<Slot>,
}

impl ParameterList<'_> {
    fn push(&mut self, slot: usize, parameter: SearchParameter) {
        self.slots.push((slot, self.all.len()));
        self.all.push(parameter);
    }

    /// Position, yaw, velocity and spin at the start, as far as they can be seen: a body at rest has no velocity parameter.
    fn add_start_state(
        &mut self,
        b: usize,
        body: &BodySpec,
        (scene, model, noise): (&Scene, &Model, &Noise),
    ) {
        let state = &body.start.state;
        let moves = state.velocity.norm() > 0.0 || state.spin != 0.0;
        let yaw = scene.tracks[b].samples.iter().any(|s| s.yaw.is_some());
        let ball = body.shape.is_ball();
        let spun = moves && ball && model.spin_sd > 0.0;
        let free = [
            true,
            true,
            if body.shape.is_round() { yaw && !ball } else { true },
            moves,
            moves,
            spun || (moves && !ball),
            spun,
            spun,
        ];
        let units = ["m", "m", "rad", "m/s", "m/s", "rad/s", "rad/s", "rad/s"];
        let start = [
            state.position.x,
            state.position.y,
            state.yaw,
            state.velocity.x,
            state.velocity.y,
            // The prior mean of a spin about the vertical is 0.
            0.0,
            state.roll.x,
            state.roll.y,
        ];
        // Wide, so that a direction without data (the yaw of a square that was not measured) stays finite.
        let wide = [100.0 * noise.position, 100.0 * noise.position, 1.0, 10.0, 10.0, 3.0, 3.0, 3.0];
        let spin_sd = model.spin_sd / body.shape.bounding_radius();
        for value in (0..free.len()).filter(|value| free[*value]) {
            let parameter = SearchParameter {
                scene: Some(self.index),
                name: format!("objects[{}].{}", body.id, BODY_VALUES[value]),
                unit: units[value].into(),
                log: false,
                min: f64::NEG_INFINITY,
                max: f64::INFINITY,
                mean: start[value],
                sd: if spun && SPINS.contains(&value) { spin_sd } else { wide[value] },
                frozen: false,
            };
            self.push(b * BODY_VALUES.len() + value, parameter);
        }
    }

    /// The numbers of an impulse of unknown origin, whose first is at `at` in [`Model::flatten`]; a standard deviation of 0 keeps one
    /// as it is. The tracks say where the prior is centred, as for start states.
    fn add_impulse(&mut self, which: usize, impulse: &UnknownImpulse, at: usize) {
        let units = ["m/s", "m/s", "rad/s", "s"];
        let mean = [impulse.velocity.x, impulse.velocity.y, impulse.spin, 0.0];
        let sd = [impulse.velocity_sd, impulse.velocity_sd, impulse.spin_sd, impulse.delay_sd];
        for value in (0..IMPULSE_VALUES.len()).filter(|value| sd[*value] > 0.0) {
            // A delay is within the frames next to it.
            let most = if value == IMPULSE_DELAY { MAX_DELAY * impulse.delay_sd } else { f64::INFINITY };
            let parameter = SearchParameter {
                scene: Some(self.index),
                name: format!("impulses[{which}].{}", IMPULSE_VALUES[value]),
                unit: units[value].into(),
                log: false,
                min: -most,
                max: most,
                mean: mean[value],
                sd: sd[value],
                frozen: false,
            };
            self.push(at + value, parameter);
        }
    }

    fn add_mass(&mut self, b: usize, body: &BodySpec, sd: f64) {
        let parameter = SearchParameter {
            scene: Some(self.index),
            name: format!("objects[{}].mass", body.id),
            unit: "1".into(),
            log: true,
            min: elementary::ln(MASS_BOUNDS[0]),
            max: elementary::ln(MASS_BOUNDS[1]),
            mean: 0.0,
            sd,
            frozen: false,
        };
        self.push(b * BODY_VALUES.len() + MASS, parameter);
    }

    /// Adds the free values of parameter `k` of an effect; `at` is the index of the first in [`Model::flatten`] and moves past them.
    fn add_effect_parameter(&mut self, active: &ActiveEffect, k: usize, bodies: &[BodySpec], at: &mut usize) {
        let parameter: &Parameter = &active.parameters[k];
        let bounds = active.bounds(k);
        let shared = active.shares(parameter);
        for (label, mean) in parameter.labels.iter().zip(&parameter.means) {
            let slot = *at;
            *at += 1;
            let is_free = parameter.prior.sd > 0.0 && active.on;
            if !is_free || is_without_effect(active, label, bodies) {
                continue;
            }
            let name = parameter.full_name(active, label);
            let known = self.all.iter().position(|f| shared && f.scene.is_none() && f.name == name);
            if let Some(known) = known {
                self.slots.push((slot, known));
                continue;
            }
            let found = SearchParameter {
                scene: (!shared).then_some(self.index),
                name,
                unit: bounds.map_or("1", |b| b.0).into(),
                log: false,
                min: bounds.map_or(f64::NEG_INFINITY, |b| b.1),
                max: bounds.map_or(f64::INFINITY, |b| b.2),
                mean: *mean,
                sd: parameter.prior.sd,
                frozen: is_frozen_at_first(active, parameter.prior.sd, *mean),
            };
            self.push(slot, found);
        }
    }
}

/// Whether a value of an effect belongs to a ball, on which the effect does nothing.
fn is_without_effect(active: &ActiveEffect, label: &str, bodies: &[BodySpec]) -> bool {
    let named = |b: &BodySpec| b.id.to_string() == label || b.shape.word() == label;
    let on_feet = effect(&active.name).is_some_and(|e| e.profile.acts_on == ActsOn::SlidingFeet);
    on_feet && bodies.iter().any(|b| b.shape.is_ball() && named(b))
}

/// Whether a parameter is frozen until the motion is right: contact distances, which mislead a search before it is known what
/// touches, and forces that the prior knows well.
fn is_frozen_at_first(active: &ActiveEffect, sd: f64, mean: f64) -> bool {
    let uses = |hook| effect(&active.name).is_some_and(|e| e.uses(hook));
    uses(Hook::Margin) || (uses(Hook::Force) && sd <= WELL_KNOWN * mean.abs())
}
