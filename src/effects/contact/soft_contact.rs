//! Contacts of finite duration: a spring and a damper between the surfaces.

use crate::body::{Contact, ContactLaw};
use crate::effects::{
    Effect, EffectSpec, Hook, ParamSpec, Profile, Quantity, Scope, SearchStart, Seed, Seeds,
};
use crate::num::Real;

pub struct SoftContact;

impl Effect for SoftContact {
    const SPEC: EffectSpec = EffectSpec {
        name: "soft_contact",
        doc: "Contacts have a spring and a damper: F = k x + c dx/dt while compressed, never a pull; the damper's loss comes on top of the restitution that the other laws give.",
        source: "Schwager and Poeschel, Granular Matter 9 (2007) 465",
        hooks: &[Hook::Contact],
        params: &[
            ParamSpec {
                name: "softness",
                unit: "(m/N)^0.5",
                default: 0.0,
                min: 0.0,
                max: 2.0,
                scope: Scope::Setup,
                doc: "1/sqrt(k), to which the contact's duration is proportional",
            },
            ParamSpec {
                name: "damping",
                unit: "N s/m",
                default: 0.0,
                min: 0.0,
                max: 100.0,
                scope: Scope::Setup,
                doc: "force of the damper per speed",
            },
        ],
    };
    const PROFILE: Profile = Profile {
        // A contact of two frames is long enough to be seen as a finite duration.
        start: Some(SearchStart::ContactFrames(2.0)),
        ..Profile::LAW
    };
    const SEEDS: Seeds = &[("damping", Seed::Values(&[0.0, 1.0]))];

    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        vec![("stiffness", Quantity::Number(1.0 / (p[0] * p[0]))), ("damping", Quantity::Number(p[1]))]
    }

    /// Half a period of the reduced mass on the spring.
    fn contact_time(p: &[f64], mass: f64) -> f64 {
        p[0] * (std::f64::consts::PI * mass.sqrt())
    }

    fn contact<T: Real>(pa: &[T], _pb: &[T], _contact: &Contact<T>, out: &mut ContactLaw<T>) {
        out.softness += pa[0];
        out.damping += pa[1];
    }
}
