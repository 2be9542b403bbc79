//! Restitution that falls with the speed of the approach.

use super::{Effect, EffectSpec, Hook, ParamSpec, Scope, report::Quantity};
use crate::body::{Contact, ContactLaw};
use crate::num::Real;

pub struct SpeedDependentRestitution;

impl Effect for SpeedDependentRestitution {
    const SPEC: EffectSpec = EffectSpec {
        name: "speed_dependent_restitution",
        doc: "Fast hits bounce less: e = e0 exp(-v_n/v0), e0 what the other laws say and v_n the approach speed.",
        source: "Empirical; loss grows with speed: Johnson, Contact Mechanics, sec. 11.5",
        hooks: &[Hook::Contact],
        params: &[ParamSpec {
            name: "inverse_v0",
            unit: "s/m",
            default: 0.0,
            min: 0.0,
            max: 20.0,
            scope: Scope::Setup,
            doc: "1/v0: zero is a restitution that does not depend on speed",
        }],
    };

    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        vec![("v0", Quantity::Number(1.0 / p[0]))]
    }

    fn contact<T: Real>(pa: &[T], _pb: &[T], _contact: &Contact<T>, out: &mut ContactLaw<T>) {
        out.restitution_decay += pa[0];
    }
}
