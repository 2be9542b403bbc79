//! A force that is the same everywhere: wind.

use crate::body::{Body, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope, Symmetry};
use crate::num::{Real, vec2};

pub struct UniformForce;

impl Effect for UniformForce {
    const SPEC: EffectSpec = EffectSpec {
        name: "uniform_force",
        doc: "The same force everywhere, such as wind: F constant, a = F/m.",
        source: "Newton's second law; steady wind",
        hooks: &[Hook::Force],
        params: &[
            ParamSpec {
                name: "F_x",
                unit: "N",
                default: 0.0,
                min: -50.0,
                max: 50.0,
                scope: Scope::Setup,
                doc: "the force",
            },
            ParamSpec {
                name: "F_y",
                unit: "N",
                default: 0.0,
                min: -50.0,
                max: 50.0,
                scope: Scope::Setup,
                doc: "the force",
            },
        ],
    };
    const PROFILE: Profile = Profile { formula_terms: &[["1", ""], ["", "1"]], ..Profile::LAW };
    const AMPLITUDES: usize = 2;
    const SYMMETRY: Symmetry = Symmetry::Shifts;

    fn force<T: Real>(p: &[T], _time: T, _body: &Body<T>, out: &mut Wrench<T>) {
        out.force += vec2(p[0], p[1]);
    }
}
