//! Damping: motion that decays at its own rate whatever the mass, as the paper and most engines have it.

use super::{Effect, EffectSpec, Hook, ParamSpec, Scope};
use crate::body::{Body, Wrench};
use crate::num::Real;

pub struct Damping;

impl Effect for Damping {
    const SPEC: EffectSpec = EffectSpec {
        name: "damping",
        doc: "Whatever moves is slowed: a = -(linear + quadratic |v|) v, the same for all masses; spins decay at the linear rate too.",
        source: "VRDP eq. 1 (l3); linear and angular damping of Bullet's rigid bodies",
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
        ],
    };

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.damping += p[0];
        out.force -= body.velocity * (body.mass * p[1] * body.velocity.norm());
    }
}
