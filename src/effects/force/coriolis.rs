//! The sideways acceleration of a table that turns.

use crate::body::{Body, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope, Symmetry};
use crate::num::Real;

pub struct Coriolis;

impl Effect for Coriolis {
    const SPEC: EffectSpec = EffectSpec {
        name: "coriolis",
        doc: "The table turns: a = -2 Omega z^ x v, the same for all masses.",
        source: "Coriolis (1835); Goldstein, Classical Mechanics, sec. 4.10",
        hooks: &[Hook::Force],
        params: &[ParamSpec {
            name: "Omega",
            unit: "rad/s",
            default: 0.0,
            min: -10.0,
            max: 10.0,
            scope: Scope::Setup,
            doc: "turn rate of the table",
        }],
    };
    const PROFILE: Profile = Profile { formula_terms: &[["-vy", "vx"]], ..Profile::LAW };
    const SYMMETRY: Symmetry = Symmetry::Chiral;

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.force -= body.velocity.perp() * (body.mass * p[0] * 2.0);
    }
}
