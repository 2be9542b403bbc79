//! The laws of motion and contact: one file each, one line each in [`EFFECTS`].

mod attractor_inverse_square;
mod attractor_spring;
mod ball_spin;
mod contact_distance;
mod contact_friction;
mod coriolis;
mod cushion;
mod damping;
pub mod formula;
mod frame_rate;
mod friction_offset;
mod friction_patch;
mod gliding_friction;
mod hidden_object;
mod hidden_wall;
mod lateral;
mod linear_drag;
mod magnus;
mod mass_change;
mod off_centre_marker;
mod pair_attraction;
mod pair_repulsion;
mod parser;
pub mod program;
mod quadratic_drag;
mod report;
mod restitution;
mod rolling_resistance;
mod seed;
mod sliding_friction;
mod soft_contact;
mod speed_dependent_restitution;
mod spin_friction;
mod sticky_contact;
#[cfg(test)]
mod tests;
mod tilt;
mod tilted_camera;
mod time_periodic;
mod uniform_force;
mod unit;
mod vortex;
mod wrong_scale;
mod wrong_size;

pub use contact_distance::MOST_MARGIN;
pub use report::{Quantity, joined};
pub use seed::{Region, Seed, Seeds};

use crate::body::{Body, BodyCorrection, Contact, ContactLaw, Observation, Obstacle, Wrench};
use crate::num::{Jet, JetF32, Real, Vec2};

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
    EffectEntry::of::<contact_distance::ContactDistance>(),
    EffectEntry::of::<cushion::Cushion>(),
    EffectEntry::of::<spin_friction::SpinFriction>(),
    EffectEntry::of::<tilt::Tilt>(),
    EffectEntry::of::<uniform_force::UniformForce>(),
    EffectEntry::of::<attractor_spring::AttractorSpring>(),
    EffectEntry::of::<attractor_inverse_square::AttractorInverseSquare>(),
    EffectEntry::of::<vortex::Vortex>(),
    EffectEntry::of::<coriolis::Coriolis>(),
    EffectEntry::of::<lateral::Lateral>(),
    EffectEntry::of::<magnus::Magnus>(),
    EffectEntry::of::<pair_attraction::PairAttraction>(),
    EffectEntry::of::<pair_repulsion::PairRepulsion>(),
    EffectEntry::of::<friction_patch::FrictionPatch>(),
    EffectEntry::of::<time_periodic::TimePeriodic>(),
    EffectEntry::of::<hidden_wall::HiddenWall>(),
    EffectEntry::of::<hidden_object::HiddenObject>(),
    EffectEntry::of::<speed_dependent_restitution::SpeedDependentRestitution>(),
    EffectEntry::of::<soft_contact::SoftContact>(),
    EffectEntry::of::<sticky_contact::StickyContact>(),
    EffectEntry::of::<mass_change::MassChange>(),
    EffectEntry::of::<wrong_size::WrongSize>(),
    EffectEntry::of::<wrong_scale::WrongScale>(),
    EffectEntry::of::<tilted_camera::TiltedCamera>(),
    EffectEntry::of::<off_centre_marker::OffCentreMarker>(),
    EffectEntry::of::<frame_rate::FrameRate>(),
];

/// The entry of that name.
pub fn effect(name: &str) -> Option<&'static EffectEntry> {
    EFFECTS.iter().find(|e| e.spec.name == name)
}

/// A law: its spec and the hooks it has; a hook that is not overridden does nothing.
pub trait Effect {
    const SPEC: EffectSpec;
    /// Its name in reports, where several effects are forms of one kind.
    const KIND: &'static str = Self::SPEC.name;
    /// Which form of its kind it is.
    const FORM: Option<&'static str> = None;
    /// How many of the first parameters are amplitudes: the law is linear in them near zero, and absent where all are zero.
    const AMPLITUDES: usize = 1;
    const SYMMETRY: Symmetry = Symmetry::Isotropic;
    /// How a search begins.
    const SEEDS: Seeds = &[];

    /// The parameters as reports name them; vectors are joined by the rule of [`joined`].
    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        let form = Self::FORM.map(|word| ("form", Quantity::Word(word)));
        form.into_iter().chain(joined(Self::SPEC.params, p)).collect()
    }

    /// The shortest time in which the law may change much by itself (s).
    fn pace<T: Real>(_p: &[T]) -> f64 {
        f64::INFINITY
    }

    /// Adds to the wrench on `body` at `time` (s). `p` holds the parameters as they apply to this body.
    fn force<T: Real>(_p: &[T], _time: T, _body: &Body<T>, _out: &mut Wrench<T>) {}

    /// The force on `a` because of `b` (N); `b` feels the opposite.
    fn pair<T: Real>(_p: &[T], _a: &Body<T>, _b: &Body<T>) -> Vec2<T> {
        Vec2::zero()
    }

    /// Shapes the law of a contact. `pa` and `pb` hold the parameters as they apply to either body.
    fn contact<T: Real>(_pa: &[T], _pb: &[T], _contact: &Contact<T>, _out: &mut ContactLaw<T>) {}

    /// Gap between the outlines of two bodies at which they touch (m), at most [`MOST_MARGIN`].
    fn margin<T: Real>(_p: &[T]) -> T {
        T::zero()
    }

    /// What nobody saw and bodies run into.
    fn bodies<T: Real>(_p: &[T]) -> Option<Obstacle<T>> {
        None
    }

    /// Corrects what is believed of a body.
    fn matter<T: Real>(_p: &[T], _out: &mut BodyCorrection<T>) {}

    /// Changes what the camera reports of a body.
    fn observe<T: Real>(_p: &[T], _out: &mut Observation<T>) {}

    /// By how much the true time differs from the film's `time` (s).
    fn clock<T: Real>(_p: &[T], _time: f64) -> T {
        T::zero()
    }
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
    /// The first are the amplitudes ([`Effect::AMPLITUDES`]): zero means absent.
    pub params: &'static [ParamSpec],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hook {
    Force,
    Pair,
    Contact,
    Margin,
    Bodies,
    Matter,
    Observe,
    Clock,
}

/// Which changes of the world leave the law as it is, parameters kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Symmetry {
    /// Shifts, turns and mirrors.
    Isotropic,
    /// Shifts and turns.
    Chiral,
    /// Shifts.
    Shifts,
    /// Turns about the place whose coordinates begin at parameter `center`, and mirrors through it.
    About { center: usize, mirrors: bool },
    /// Not any of these.
    None,
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

const fn center(name: &'static str) -> ParamSpec {
    let (unit, doc) = ("m", "where it is centred");
    ParamSpec { name, unit, default: 0.0, min: -100.0, max: 100.0, scope: Scope::Setup, doc }
}

/// Place of a law that has a centre.
const CENTER: [ParamSpec; 2] = [center("center_x"), center("center_y")];

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

pub struct EffectEntry {
    pub spec: EffectSpec,
    /// See [`Effect::KIND`] and the constants after it.
    pub kind: &'static str,
    pub amplitudes: usize,
    pub symmetry: Symmetry,
    pub seeds: Seeds,
    /// See [`Effect::report`].
    pub report: fn(&[f64]) -> Vec<(&'static str, Quantity)>,
    real: Hooks<f64>,
    jet: Hooks<Jet>,
    jet_f32: Hooks<JetF32>,
}

impl EffectEntry {
    const fn of<E: Effect>() -> Self {
        EffectEntry {
            spec: E::SPEC,
            kind: E::KIND,
            amplitudes: E::AMPLITUDES,
            symmetry: E::SYMMETRY,
            seeds: E::SEEDS,
            report: E::report,
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
