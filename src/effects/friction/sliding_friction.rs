//! Coulomb friction of the ground against sliding.

use crate::body::{Body, GRAVITY, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamRole, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct SlidingFriction;

impl Effect for SlidingFriction {
    const SPEC: EffectSpec = EffectSpec {
        name: "sliding_friction",
        doc: "Friction with the ground: a = -mu g v/|v| of the touching surface; over a footprint it is shared between sliding and turning, and a ball slides until it rolls.",
        source: "VRDP eq. 1; Farkas et al., Phys. Rev. Lett. 90 (2003) 248302 for sliding with spin",
        hooks: &[Hook::Force],
        params: &[ParamSpec {
            name: "mu",
            unit: "1",
            default: 0.0,
            min: 0.0,
            max: 2.0,
            scope: Scope::Setup,
            doc: "coefficient of friction against the ground",
        }],
    };
    const PROFILE: Profile = Profile {
        common_name: Some("friction"),
        param_roles: &[("mu", ParamRole::GroundFriction)],
        holds_at_rest: true,
        formula_terms: &[["vx/max(speed, 0.01)", "vy/max(speed, 0.01)"]],
        ..Profile::LAW
    };

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.friction_limit += p[0] * body.mass * GRAVITY;
    }
}
