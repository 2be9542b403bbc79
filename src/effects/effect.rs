//! What an effect is: its spec, and hooks that do nothing unless a law overrides them.

use super::param::ParamSpec;
use super::profile::Profile;
use super::report::{Quantity, joined};
use super::seed::Seeds;
use crate::body::{Body, BodyCorrection, Contact, ContactLaw, Observation, Obstacle, Wrench};
use crate::num::{Real, Vec2};

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
    /// The first values of a search.
    const SEEDS: Seeds = &[];
    /// What other rooms know of it.
    const PROFILE: Profile = Profile::LAW;

    /// The parameters as reports name them; vectors are joined by the rule of [`joined`].
    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        let form = Self::FORM.map(|word| ("form", Quantity::Word(word)));
        form.into_iter().chain(joined(Self::SPEC.params, p)).collect()
    }

    /// The shortest time in which the law may change much without motion (s).
    fn pace<T: Real>(_p: &[T]) -> f64 {
        f64::INFINITY
    }

    /// How long a contact between two objects takes (s), their reduced mass being `mass` (kg).
    fn contact_time(_p: &[f64], _mass: f64) -> f64 {
        0.0
    }

    /// Adds to the wrench on `body` at `time` (s). `p` holds the parameters as they apply to this body.
    fn force<T: Real>(_p: &[T], _time: T, _body: &Body<T>, _out: &mut Wrench<T>) {}

    /// The force on `a` because of `b` (N); `b` feels the opposite.
    fn pair<T: Real>(_p: &[T], _a: &Body<T>, _b: &Body<T>) -> Vec2<T> {
        Vec2::zero()
    }

    /// Shapes the law of a contact. `pa` and `pb` hold the parameters as they apply to either body.
    fn contact<T: Real>(_pa: &[T], _pb: &[T], _contact: &Contact<T>, _out: &mut ContactLaw<T>) {}

    /// Gap between the outlines of two bodies at which they touch (m), at most [`super::MOST_MARGIN`].
    fn margin<T: Real>(_p: &[T]) -> T {
        T::zero()
    }

    /// An obstacle that no track shows and bodies run into.
    fn bodies<T: Real>(_p: &[T]) -> Option<Obstacle<T>> {
        None
    }

    /// Corrects the assumed mass and size of a body.
    fn matter<T: Real>(_p: &[T], _out: &mut BodyCorrection<T>) {}

    /// Changes what the camera reports of a body.
    fn observe<T: Real>(_p: &[T], _out: &mut Observation<T>) {}

    /// By how much the true time differs from the video's `time` (s).
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
