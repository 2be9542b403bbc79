//! A ball's spin about the horizontal axes: it slides on the ground until it rolls.

use crate::body::{Body, GRAVITY, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamRole, ParamSpec, Profile, Scope};
use crate::num::Real;
use crate::scene::Shape;

pub struct BallSpin;

impl Effect for BallSpin {
    const SPEC: EffectSpec = EffectSpec {
        name: "ball_spin",
        doc: "A spinning ball slides before it rolls: friction mu_slide m g against the slip of its contact point; then a = -mu_roll g v/|v|; the same resistance slows its rotation while it slides.",
        source: "Marlow, The Physics of Pocket Billiards (1995), ch. 2; rolling friction as a torque: Coumans, Bullet manual",
        hooks: &[Hook::Force],
        params: &[
            ParamSpec {
                name: "mu_slide",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 2.0,
                scope: Scope::Setup,
                doc: "coefficient of friction while a ball slides",
            },
            ParamSpec {
                name: "mu_roll",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 2.0,
                scope: Scope::Setup,
                doc: "deceleration of a rolling ball over g",
            },
        ],
    };
    const PROFILE: Profile = Profile {
        common_name: Some("friction"),
        param_roles: &[("mu_slide", ParamRole::GroundFriction), ("mu_roll", ParamRole::GroundFriction)],
        changes_after_contact: true,
        ..Profile::LAW
    };

    const AMPLITUDES: usize = 2;

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        if let Shape::Ball { radius } = body.shape {
            let weight = body.mass * GRAVITY;
            out.friction_limit += p[0] * weight;
            out.rolling_resistance += p[1] * weight;
            // A torque M slows a ball that rolls by 5/7 M/(m r).
            out.rolling_torque += p[1] * weight * (1.4 * radius);
        }
    }
}
