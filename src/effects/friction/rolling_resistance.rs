//! Resistance of the ground against rolling.

use crate::body::{Body, GRAVITY, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamRole, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct RollingResistance;

impl Effect for RollingResistance {
    const SPEC: EffectSpec = EffectSpec {
        name: "rolling_resistance",
        doc: "Rolling balls are slowed: a = -mu g v/|v| of a rolling ball.",
        source: "VRDP eq. 1 (l2); Alciatore, Technical proofs TP 4.1",
        hooks: &[Hook::Force],
        params: &[ParamSpec {
            name: "mu",
            unit: "1",
            default: 0.0,
            min: 0.0,
            max: 2.0,
            scope: Scope::Setup,
            doc: "deceleration of a rolling ball over g",
        }],
    };
    const PROFILE: Profile = Profile {
        common_name: Some("friction"),
        param_roles: &[("mu", ParamRole::GroundFriction)],
        ..Profile::LAW
    };

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.rolling_resistance += p[0] * body.mass * GRAVITY;
    }
}
