//! An object that is larger, or smaller, than assumed: an error that imitates a contact law.

use crate::body::BodyCorrection;
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Quantity, Scope};
use crate::num::Real;

pub struct WrongSize;

impl Effect for WrongSize {
    const SPEC: EffectSpec = EffectSpec {
        name: "wrong_size",
        doc: "Objects are larger or smaller than assumed: lengths of the outline are factor times the assumed ones, factor = 1 + excess.",
        source: "A rival to contact laws",
        hooks: &[Hook::Matter],
        params: &[ParamSpec {
            name: "excess",
            unit: "1",
            default: 0.0,
            min: -0.5,
            max: 1.0,
            scope: Scope::Object,
            doc: "factor - 1",
        }],
    };
    const PROFILE: Profile = Profile { negligible: 0.02, ..Profile::MATTER };

    /// The label of its scope is the `object_id`.
    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        vec![("factor", Quantity::Number(1.0 + p[0]))]
    }

    fn matter<T: Real>(p: &[T], out: &mut BodyCorrection<T>) {
        out.size *= p[0] + 1.0;
    }
}
