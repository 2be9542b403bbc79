//! Restitution that falls with the speed of the approach.

use crate::body::{Contact, ContactLaw};
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Quantity, Scope, SearchStart};
use crate::num::Real;

pub struct SpeedDependentRestitution;

impl Effect for SpeedDependentRestitution {
    const SPEC: EffectSpec = EffectSpec {
        name: "speed_dependent_restitution",
        doc: "Restitution falls with approach speed: e = e0 exp(-v_n/v0), e0 what the other laws say and v_n the approach speed.",
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
    const PROFILE: Profile = Profile { start: Some(SearchStart::RestitutionDecay), ..Profile::LAW };

    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        vec![("v0", Quantity::Number(1.0 / p[0]))]
    }

    fn contact<T: Real>(pa: &[T], _pb: &[T], _contact: &Contact<T>, out: &mut ContactLaw<T>) {
        out.restitution_decay += pa[0];
    }
}
