//! The force across the velocity on a body that spins.

use crate::body::{Body, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct Magnus;

impl Effect for Magnus {
    const SPEC: EffectSpec = EffectSpec {
        name: "magnus",
        doc: "Spin bends the path: F = S w z^ x v, w the turn rate about z.",
        source: "Rubinow and Keller, J. Fluid Mech. 11 (1961) 447",
        hooks: &[Hook::Force],
        params: &[ParamSpec {
            name: "S",
            unit: "kg",
            default: 0.0,
            min: -10.0,
            max: 10.0,
            scope: Scope::Setup,
            doc: "force per speed and turn rate",
        }],
    };
    const PROFILE: Profile = Profile { formula_terms: &[["-spin*vy", "spin*vx"]], ..Profile::LAW };

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.force += body.velocity.perp() * (p[0] * body.spin);
    }
}
