//! Restitution: how much of the approach speed comes back at a contact.

use super::{Effect, EffectSpec, Hook, ParamSpec, Scope};
use crate::body::{Contact, ContactLaw};
use crate::num::Real;

pub struct Restitution;

impl Effect for Restitution {
    const SPEC: EffectSpec = EffectSpec {
        name: "restitution",
        doc: "e = coefficient r_a r_b: separation over approach speed (a coefficient of the pair, a factor of each object).",
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
                doc: "of the pair",
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
        ],
    };

    fn contact<T: Real>(pa: &[T], pb: &[T], _contact: &Contact<T>, out: &mut ContactLaw<T>) {
        out.restitution = pa[0] * pa[1] * pb[1];
    }
}
