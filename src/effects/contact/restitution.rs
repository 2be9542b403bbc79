//! Restitution: the ratio of separation to approach speed when two objects collide.

use crate::body::{Contact, ContactLaw};
use crate::effects::{Effect, EffectSpec, Hook, ParamRole, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct Restitution;

impl Effect for Restitution {
    const SPEC: EffectSpec = EffectSpec {
        name: "restitution",
        doc: "Restitution of a collision: e = coefficient r_a r_b d_ab, separation over approach speed; a factor of each object and a deviation of the pair.",
        source: "VRDP eq. 2 (product law); Newton's law of restitution",
        hooks: &[Hook::Contact],
        params: &[
            ParamSpec {
                name: "coefficient",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 1.0,
                scope: Scope::Setup,
                doc: "what the set-up or the kind of pair has in common",
            },
            ParamSpec {
                name: "object",
                unit: "1",
                default: 1.0,
                min: 0.0,
                max: 1.0,
                scope: Scope::Object,
                doc: "factor of the object",
            },
            ParamSpec {
                name: "deviation",
                unit: "1",
                default: 1.0,
                min: 0.0,
                max: 4.0,
                scope: Scope::Pair,
                doc: "ratio of the pair's own coefficient to what the others say",
            },
        ],
    };
    const PROFILE: Profile = Profile {
        param_roles: &[
            ("coefficient", ParamRole::CommonRestitution),
            ("object", ParamRole::ObjectRestitution),
            ("deviation", ParamRole::PairRestitution),
        ],
        ..Profile::LAW
    };

    fn contact<T: Real>(pa: &[T], pb: &[T], contact: &Contact<T>, out: &mut ContactLaw<T>) {
        if contact.b.is_some() {
            out.restitution = (pa[0] * pa[1] * pb[1] * pa[2]).min(T::constant(1.0));
        }
    }
}
