//! Air drag: a force against the velocity that grows with its square.

use crate::body::{Body, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct QuadraticDrag;

impl Effect for QuadraticDrag {
    const SPEC: EffectSpec = EffectSpec {
        name: "quadratic_drag",
        doc: "Drag of the air, which grows with the square of the speed: F = -c |v| v.",
        source: "VRDP eq. 1 (l3); Batchelor, An Introduction to Fluid Dynamics, sec. 5.11",
        hooks: &[Hook::Force],
        params: &[ParamSpec {
            name: "c",
            unit: "kg/m",
            default: 0.0,
            min: 0.0,
            max: 10.0,
            scope: Scope::Setup,
            doc: "force per squared speed",
        }],
    };
    const PROFILE: Profile =
        Profile { common_name: Some("drag"), formula_terms: &[["vx*speed", "vy*speed"]], ..Profile::LAW };

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.force -= body.velocity * (p[0] * body.velocity.norm());
    }
}
