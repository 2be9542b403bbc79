//! Friction of the ground against turning on the spot.

use crate::body::{Body, GRAVITY, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamRole, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct SpinFriction;

impl Effect for SpinFriction {
    const SPEC: EffectSpec = EffectSpec {
        name: "spin_friction",
        doc: "Spin about the vertical dies away: torque of mu m g r against the spin about z (r: radius); a ball's spin falls at 5 mu g / (2 r).",
        source: "Marlow, The Physics of Pocket Billiards (1995); Alciatore, Technical proofs TP 4.1",
        hooks: &[Hook::Force],
        params: &[ParamSpec {
            name: "mu",
            unit: "1",
            default: 0.0,
            min: 0.0,
            max: 1.0,
            scope: Scope::Setup,
            doc: "torque over weight times radius",
        }],
    };
    const PROFILE: Profile = Profile {
        common_name: Some("friction"),
        param_roles: &[("mu", ParamRole::GroundFriction)],
        ..Profile::LAW
    };

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.spin_friction_limit += p[0] * body.mass * (GRAVITY * body.shape.bounding_radius());
    }
}
