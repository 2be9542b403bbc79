//! Damping: motion that decays at a rate independent of mass, as in the paper and in most engines.

use crate::body::{Body, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct Damping;

impl Effect for Damping {
    const SPEC: EffectSpec = EffectSpec {
        name: "damping",
        doc: "Damping, the same for all masses: velocities by a = -(linear + quadratic |v|) v, spins w by -(linear + spin |w|) w.",
        source: "VRDP eq. 1 (l3); linear and angular damping of Bullet's bodies and multibodies",
        hooks: &[Hook::Force],
        params: &[
            ParamSpec {
                name: "linear",
                unit: "1/s",
                default: 0.0,
                min: 0.0,
                max: 10.0,
                scope: Scope::Setup,
                doc: "rate at which velocities and spins decay",
            },
            ParamSpec {
                name: "quadratic",
                unit: "1/m",
                default: 0.0,
                min: 0.0,
                max: 10.0,
                scope: Scope::Shape,
                doc: "deceleration per squared speed",
            },
            ParamSpec {
                name: "spin",
                unit: "1/rad",
                default: 0.0,
                min: 0.0,
                max: 10.0,
                scope: Scope::Setup,
                doc: "angular deceleration per squared turn rate, about all axes",
            },
        ],
    };
    const PROFILE: Profile = Profile { common_name: Some("drag"), ..Profile::NUISANCE };

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.damping += p[0];
        // A box spins about one axis only: no root is needed.
        let rate = match body.shape.is_ball() {
            true => (body.roll.norm_squared() + body.spin * body.spin).sqrt_or_zero(),
            false => body.spin.abs(),
        };
        out.spin_damping += p[2] * rate;
        out.force -= body.velocity * (body.mass * p[1] * body.velocity.norm());
    }
}
