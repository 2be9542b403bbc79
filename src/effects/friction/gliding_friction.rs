//! Friction as the paper has it: one deceleration for what slides and one for what rolls.

use crate::body::{Body, GRAVITY, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamRole, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct GlidingFriction;

impl Effect for GlidingFriction {
    const SPEC: EffectSpec = EffectSpec {
        name: "gliding_friction",
        doc: "Constant deceleration: a = -l g v/|v|, l = sliding for cylinders and cubes, rolling for spheres from the start, whatever their spin.",
        source: "VRDP eq. 1 (l1, l2)",
        hooks: &[Hook::Force],
        params: &[
            ParamSpec {
                name: "sliding",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 2.0,
                scope: Scope::Setup,
                doc: "deceleration of a cylinder or cube over g",
            },
            ParamSpec {
                name: "rolling",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 2.0,
                scope: Scope::Setup,
                doc: "deceleration of a sphere over g",
            },
        ],
    };
    const PROFILE: Profile = Profile {
        common_name: Some("friction"),
        param_roles: &[("sliding", ParamRole::GroundFriction), ("rolling", ParamRole::GroundFriction)],
        covers: &["sliding_friction", "rolling_resistance", "ball_spin"],
        holds_at_rest: true,
        ..Profile::LAW
    };

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        let weight = body.mass * GRAVITY;
        // The world lets resistance to rolling act on balls only.
        out.rolling_resistance += p[1] * weight;
        if !body.shape.is_ball() {
            out.friction_limit += p[0] * weight;
        }
    }
}
