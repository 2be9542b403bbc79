//! A table that is not level.

use crate::body::{Body, GRAVITY, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope, Symmetry};
use crate::num::{Real, vec2};

pub struct Tilt;

/// Steepest slope (m/s^2): free fall in a vertical plane, and half of it again for a wrong scale.
const STEEPEST: f64 = 15.0;

const fn component(name: &'static str, doc: &'static str) -> ParamSpec {
    let (min, max) = (-STEEPEST, STEEPEST);
    ParamSpec { name, unit: "m/s^2", default: 0.0, min, max, scope: Scope::Setup, doc }
}

impl Effect for Tilt {
    const SPEC: EffectSpec = EffectSpec {
        name: "tilt",
        doc: "The table slopes: F = m a, a constant and the same for all masses.",
        source: "Inclined plane: |a| = g sin(angle)",
        hooks: &[Hook::Force],
        params: &[
            component("a_x", "downhill acceleration along x"),
            component("a_y", "downhill acceleration along y"),
        ],
    };
    const PROFILE: Profile =
        Profile { formula_terms: &[["1", ""], ["", "1"]], constant_of_nature: Some(GRAVITY), ..Profile::LAW };
    const AMPLITUDES: usize = 2;
    const SYMMETRY: Symmetry = Symmetry::Shifts;

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.force += vec2(p[0], p[1]) * body.mass;
    }
}
