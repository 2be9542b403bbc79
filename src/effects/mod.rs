//! The laws of motion and contact: one file each, one line each in [`EFFECTS`].

mod ball_spin;
mod contact_friction;
mod damping;
mod friction_offset;
mod gliding_friction;
mod linear_drag;
mod quadratic_drag;
mod restitution;
mod rolling_resistance;
mod sliding_friction;
#[cfg(test)]
mod tests;

use crate::body::{Body, Contact, ContactLaw, Wrench};
use crate::num::{Jet, Real, Vec2};

/// Every effect there is. A new one is its file and a line here.
pub static EFFECTS: &[EffectEntry] = &[
    EffectEntry::of::<sliding_friction::SlidingFriction>(),
    EffectEntry::of::<friction_offset::FrictionOffset>(),
    EffectEntry::of::<rolling_resistance::RollingResistance>(),
    EffectEntry::of::<ball_spin::BallSpin>(),
    EffectEntry::of::<gliding_friction::GlidingFriction>(),
    EffectEntry::of::<damping::Damping>(),
    EffectEntry::of::<linear_drag::LinearDrag>(),
    EffectEntry::of::<quadratic_drag::QuadraticDrag>(),
    EffectEntry::of::<restitution::Restitution>(),
    EffectEntry::of::<contact_friction::ContactFriction>(),
];

/// The entry of that name.
pub fn effect(name: &str) -> Option<&'static EffectEntry> {
    EFFECTS.iter().find(|e| e.spec.name == name)
}

/// A law: its spec and the hooks it has; a hook that is not overridden does nothing.
pub trait Effect {
    const SPEC: EffectSpec;

    /// Adds to the wrench on `body` at `time` (s). `p` holds the parameters as they apply to this body.
    fn force<T: Real>(_p: &[T], _time: T, _body: &Body<T>, _out: &mut Wrench<T>) {}

    /// The force on `a` because of `b` (N); `b` feels the opposite.
    fn pair<T: Real>(_p: &[T], _a: &Body<T>, _b: &Body<T>) -> Vec2<T> {
        Vec2::zero()
    }

    /// Shapes the law of a contact. `pa` and `pb` hold the parameters as they apply to either body.
    fn contact<T: Real>(_pa: &[T], _pb: &[T], _contact: &Contact<T>, _out: &mut ContactLaw<T>) {}
}

/// What is known of an effect without running it.
#[derive(Debug, Clone, Copy)]
pub struct EffectSpec {
    pub name: &'static str,
    /// One sentence with the formula.
    pub doc: &'static str,
    /// Where the formula comes from.
    pub source: &'static str,
    /// Which hooks are in use.
    pub hooks: &'static [Hook],
    /// The first is the amplitude: zero means absent.
    pub params: &'static [ParamSpec],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hook {
    Force,
    Pair,
    Contact,
}

#[derive(Debug, Clone, Copy)]
pub struct ParamSpec {
    pub name: &'static str,
    pub unit: &'static str,
    /// The value at which the effect is absent (of the amplitude), or a neutral one.
    pub default: f64,
    pub min: f64,
    pub max: f64,
    /// Who shares a value, unless a preset says otherwise.
    pub scope: Scope,
    pub doc: &'static str,
}

/// Who shares one value of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    Setup,
    Material,
    Shape,
    Object,
    /// Unordered pair of shapes (contact laws only).
    ShapePair,
    /// Unordered pair of objects (contact laws only).
    Pair,
}

/// See [`Effect::force`].
pub type ForceFn<T> = fn(&[T], T, &Body<T>, &mut Wrench<T>);
/// See [`Effect::pair`].
pub type PairFn<T> = fn(&[T], &Body<T>, &Body<T>) -> Vec2<T>;
/// See [`Effect::contact`].
pub type ContactFn<T> = fn(&[T], &[T], &Contact<T>, &mut ContactLaw<T>);

/// The hooks of one effect, compiled for one scalar.
pub struct Hooks<T> {
    pub force: ForceFn<T>,
    pub pair: PairFn<T>,
    pub contact: ContactFn<T>,
}

pub struct EffectEntry {
    pub spec: EffectSpec,
    real: Hooks<f64>,
    jet: Hooks<Jet>,
}

impl EffectEntry {
    const fn of<E: Effect>() -> Self {
        EffectEntry {
            spec: E::SPEC,
            real: Hooks { force: E::force::<f64>, pair: E::pair::<f64>, contact: E::contact::<f64> },
            jet: Hooks { force: E::force::<Jet>, pair: E::pair::<Jet>, contact: E::contact::<Jet> },
        }
    }

    pub fn uses(&self, hook: Hook) -> bool {
        self.spec.hooks.contains(&hook)
    }
}

/// The two scalars that effects are compiled for.
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
