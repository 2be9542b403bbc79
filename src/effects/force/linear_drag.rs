//! Viscous drag: a force against the velocity, proportional to it.

use crate::body::{Body, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct LinearDrag;

impl Effect for LinearDrag {
    const SPEC: EffectSpec = EffectSpec {
        name: "linear_drag",
        doc: "Drag that grows with the speed: F = -c v.",
        source: "Stokes' law; a lubricating layer of air",
        hooks: &[Hook::Force],
        params: &[ParamSpec {
            name: "c",
            unit: "kg/s",
            default: 0.0,
            min: 0.0,
            max: 10.0,
            scope: Scope::Setup,
            doc: "force per speed",
        }],
    };
    const PROFILE: Profile =
        Profile { common_name: Some("drag"), formula_terms: &[["vx", "vy"]], ..Profile::LAW };

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.force -= body.velocity * p[0];
    }
}
