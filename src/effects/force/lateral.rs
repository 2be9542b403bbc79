//! A force across the velocity, whatever the mass.

use crate::body::{Body, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope, Symmetry};
use crate::num::Real;

pub struct Lateral;

impl Effect for Lateral {
    const SPEC: EffectSpec = EffectSpec {
        name: "lateral",
        doc: "A sideways force on whatever moves: F = b z^ x v (a = F/m).",
        source: "Lorentz force of a charge in a field along z",
        hooks: &[Hook::Force],
        params: &[ParamSpec {
            name: "b",
            unit: "kg/s",
            default: 0.0,
            min: -20.0,
            max: 20.0,
            scope: Scope::Setup,
            doc: "force per speed",
        }],
    };
    const PROFILE: Profile = Profile { formula_terms: &[["-vy", "vx"]], ..Profile::LAW };
    const SYMMETRY: Symmetry = Symmetry::Chiral;

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.force += body.velocity.perp() * p[0];
    }
}
