//! An effect as the rest of the crate sees it: constants, hooks compiled for each scalar, and what follows from them.

use super::effect::{Effect, EffectSpec, Hook, Symmetry};
use super::param::{ParamSpec, Scope};
use super::profile::{ObstacleForm, ParamRole, Profile, Role, SearchStart};
use super::report::Quantity;
use super::seed::{Region, Seeds};
use crate::body::{Body, BodyCorrection, Contact, ContactLaw, Observation, Obstacle, Wrench};
use crate::num::{Jet, JetF32, Real, Vec2};

/// See [`Effect::pace`].
pub type PaceFn<T> = fn(&[T]) -> f64;
/// See [`Effect::force`].
pub type ForceFn<T> = fn(&[T], T, &Body<T>, &mut Wrench<T>);
/// See [`Effect::pair`].
pub type PairFn<T> = fn(&[T], &Body<T>, &Body<T>) -> Vec2<T>;
/// See [`Effect::contact`].
pub type ContactFn<T> = fn(&[T], &[T], &Contact<T>, &mut ContactLaw<T>);
/// See [`Effect::margin`].
pub type MarginFn<T> = fn(&[T]) -> T;
/// See [`Effect::bodies`].
pub type BodiesFn<T> = fn(&[T]) -> Option<Obstacle<T>>;
/// See [`Effect::matter`].
pub type MatterFn<T> = fn(&[T], &mut BodyCorrection<T>);
/// See [`Effect::observe`].
pub type ObserveFn<T> = fn(&[T], &mut Observation<T>);
/// See [`Effect::clock`].
pub type ClockFn<T> = fn(&[T], f64) -> T;

/// The hooks of one effect, compiled for one scalar.
pub struct Hooks<T> {
    pub pace: PaceFn<T>,
    pub force: ForceFn<T>,
    pub pair: PairFn<T>,
    pub contact: ContactFn<T>,
    pub margin: MarginFn<T>,
    pub bodies: BodiesFn<T>,
    pub matter: MatterFn<T>,
    pub observe: ObserveFn<T>,
    pub clock: ClockFn<T>,
}

impl<T: Real> Hooks<T> {
    const fn of<E: Effect>() -> Self {
        Hooks {
            pace: E::pace::<T>,
            force: E::force::<T>,
            pair: E::pair::<T>,
            contact: E::contact::<T>,
            margin: E::margin::<T>,
            bodies: E::bodies::<T>,
            matter: E::matter::<T>,
            observe: E::observe::<T>,
            clock: E::clock::<T>,
        }
    }
}

/// An effect as the rest of the crate sees it: constants and hooks, compiled for each scalar.
pub struct EffectEntry {
    pub spec: EffectSpec,
    /// See [`Effect::KIND`] and the constants after it.
    pub kind: &'static str,
    pub amplitudes: usize,
    pub symmetry: Symmetry,
    pub seeds: Seeds,
    pub profile: Profile,
    /// See [`Effect::report`].
    pub report: fn(&[f64]) -> Vec<(&'static str, Quantity)>,
    /// See [`Effect::contact_time`].
    pub contact_time: fn(&[f64], f64) -> f64,
    real: Hooks<f64>,
    jet: Hooks<Jet>,
    jet_f32: Hooks<JetF32>,
}

impl EffectEntry {
    pub(super) const fn of<E: Effect>() -> Self {
        EffectEntry {
            spec: E::SPEC,
            kind: E::KIND,
            amplitudes: E::AMPLITUDES,
            symmetry: E::SYMMETRY,
            seeds: E::SEEDS,
            profile: E::PROFILE,
            report: E::report,
            contact_time: E::contact_time,
            real: Hooks::of::<E>(),
            jet: Hooks::of::<E>(),
            jet_f32: Hooks::of::<E>(),
        }
    }

    /// Whether each object has its own numbers of the law.
    pub fn of_objects(&self) -> bool {
        self.spec.params.iter().all(|p| p.scope == Scope::Object)
    }

    pub fn uses(&self, hook: Hook) -> bool {
        self.spec.hooks.contains(&hook)
    }

    /// Whether a discovery may propose it.
    pub fn is_candidate(&self) -> bool {
        self.profile.role != Role::Nuisance && self.profile.covers.is_empty()
    }

    /// Whether motion between contacts determines one of its parameters.
    pub fn shows_in_free_motion(&self) -> bool {
        let acts = [Hook::Force, Hook::Pair, Hook::Observe].iter().any(|hook| self.uses(*hook));
        let seen = |p: &ParamSpec| self.profile.param_role(p.name) != Some(ParamRole::UnseenInFreeMotion);
        acts && self.spec.params.iter().any(seen)
    }

    /// Whether it shows where objects touch each other, or an obstacle.
    pub fn shows_at_contacts(&self) -> bool {
        let acts = [Hook::Contact, Hook::Bodies, Hook::Matter].iter().any(|hook| self.uses(*hook));
        acts || self.profile.shows_at_contacts
    }

    /// The form of the hidden obstacle that it is.
    pub fn obstacle(&self) -> Option<ObstacleForm> {
        match self.profile.start {
            Some(SearchStart::BehindImpacts(form)) => Some(form),
            _ => None,
        }
    }

    /// The parameter values with which it is tried, where it acts fully or not at all.
    pub fn all_or_nothing(&self) -> Option<&'static [f64]> {
        match self.profile.start {
            Some(SearchStart::AllOrNothing(values)) => Some(values),
            _ => None,
        }
    }

    /// Its parameter with this meaning.
    pub fn parameter(&self, role: ParamRole) -> Option<&'static ParamSpec> {
        self.spec.params.iter().find(|p| self.profile.param_role(p.name) == Some(role))
    }

    /// The parameters with those that a law of contact has seeds for, which are choices, chosen otherwise.
    pub fn choices(&self, parameters: &[f64], region: &Region) -> Vec<Vec<f64>> {
        let chosen = |name: &str| self.seeds.iter().any(|(seeded, _)| *seeded == name);
        let one = |seed: Vec<f64>| -> Vec<f64> {
            let of = self.spec.params.iter().zip(seed).zip(parameters);
            of.map(|((p, seed), &value)| if chosen(p.name) { seed } else { value }).collect()
        };
        self.seeds(region).into_iter().map(one).filter(|values| values != parameters).collect()
    }

    /// Every combination of the seeds, as parameter values in the spec's order with the amplitudes at zero.
    pub fn seeds(&self, region: &Region) -> Vec<Vec<f64>> {
        let mut all = vec![self.spec.params.iter().map(|p| p.default).collect::<Vec<f64>>()];
        for (k, p) in self.spec.params.iter().enumerate() {
            let Some((_, seed)) = self.seeds.iter().find(|(name, _)| *name == p.name) else { continue };
            let values = seed.values(region);
            all = all
                .iter()
                .flat_map(|start| {
                    values.iter().map(|v| {
                        let mut next = start.clone();
                        next[k] = v.clamp(p.min, p.max);
                        next
                    })
                })
                .collect();
        }
        all
    }
}

/// The scalars that effects are compiled for.
pub trait Scalar: Real {
    fn hooks(entry: &EffectEntry) -> &Hooks<Self>;
}
impl Scalar for f64 {
    fn hooks(entry: &EffectEntry) -> &Hooks<f64> {
        &entry.real
    }
}
impl Scalar for Jet {
    fn hooks(entry: &EffectEntry) -> &Hooks<Jet> {
        &entry.jet
    }
}
impl Scalar for JetF32 {
    fn hooks(entry: &EffectEntry) -> &Hooks<JetF32> {
        &entry.jet_f32
    }
}
