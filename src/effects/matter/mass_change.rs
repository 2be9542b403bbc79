//! An object that is heavier, or lighter, than assumed.

use crate::body::BodyCorrection;
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Quantity, Scope, SearchStart};
use crate::num::Real;

pub struct MassChange;

impl Effect for MassChange {
    const SPEC: EffectSpec = EffectSpec {
        name: "mass_change",
        doc: "An object is heavier or lighter than assumed: m = factor times the assumed mass, factor = 1 + excess.",
        source: "A rival to forces, and a hidden load",
        hooks: &[Hook::Matter],
        params: &[ParamSpec {
            name: "excess",
            unit: "1",
            default: 0.0,
            min: -0.95,
            max: 20.0,
            scope: Scope::Object,
            doc: "factor - 1",
        }],
    };
    const PROFILE: Profile =
        Profile { negligible: 0.05, start: Some(SearchStart::RatioToMedian), ..Profile::MATTER };

    /// The label of its scope is the `object_id`.
    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        vec![("factor", Quantity::Number(1.0 + p[0]))]
    }

    fn matter<T: Real>(p: &[T], out: &mut BodyCorrection<T>) {
        out.mass *= p[0] + 1.0;
    }
}
