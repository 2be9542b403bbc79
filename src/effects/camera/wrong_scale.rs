//! A wrong scale of lengths: an error of the camera that imitates a force.

use crate::body::Observation;
use crate::effects::{
    Effect, EffectSpec, Hook, ParamRole, ParamSpec, Profile, Quantity, Scope, SearchStart, Symmetry,
};
use crate::num::Real;

pub struct WrongScale;

impl Effect for WrongScale {
    const SPEC: EffectSpec = EffectSpec {
        name: "wrong_scale",
        doc: "Lengths of the video are wrong by a factor: x_seen = (1 + excess) x.",
        source: "A rival to forces",
        hooks: &[Hook::Observe],
        params: &[ParamSpec {
            name: "excess",
            unit: "1",
            default: 0.0,
            min: -0.5,
            max: 1.0,
            scope: Scope::Setup,
            doc: "scale - 1",
        }],
    };
    const PROFILE: Profile = Profile {
        // Between contacts, friction of another size compensates it.
        param_roles: &[("excess", ParamRole::UnseenInFreeMotion)],
        shows_at_contacts: true,
        negligible: 0.015,
        start: Some(SearchStart::Amplitudes(&[0.1, -0.1])),
        ..Profile::CAMERA
    };
    const SYMMETRY: Symmetry = Symmetry::None;

    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        vec![("scale", Quantity::Number(1.0 + p[0]))]
    }

    fn observe<T: Real>(p: &[T], out: &mut Observation<T>) {
        out.position = out.position * (p[0] + 1.0);
    }
}
