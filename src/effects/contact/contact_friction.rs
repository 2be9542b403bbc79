//! Coulomb friction between objects that touch.

use crate::body::{Contact, ContactLaw};
use crate::effects::{
    Effect, EffectSpec, Hook, ParamRole, ParamSpec, Profile, Scope, SearchStart, Seed, Seeds,
};
use crate::num::Real;

pub struct ContactFriction;

impl Effect for ContactFriction {
    const SPEC: EffectSpec = EffectSpec {
        name: "contact_friction",
        doc: "Friction at contacts: tangential impulse of at most mu times the normal impulse, against the slip of the contact point; where that would stop the slip, a tangential restitution reverses a share of it.",
        source: "Coulomb's law; Stronge, Impact Mechanics, ch. 3; Foerster, Louge, Chang and Allia, Phys. Fluids 6 (1994) 1108",
        hooks: &[Hook::Contact],
        params: &[
            ParamSpec {
                name: "mu",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 2.0,
                scope: Scope::Setup,
                doc: "coefficient of friction between objects",
            },
            ParamSpec {
                name: "tangential_restitution",
                unit: "1",
                default: 0.0,
                min: -1.0,
                max: 1.0,
                scope: Scope::Setup,
                doc: "share of the slip that is reversed where friction stops it; below 0: the share that remains",
            },
            ParamSpec {
                name: "planar",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 1.0,
                scope: Scope::Setup,
                doc: "share of a ball's rolling that causes no slip at contacts: 1 in engines whose contacts are planar",
            },
        ],
    };
    const PROFILE: Profile = Profile {
        common_name: Some("object_friction"),
        param_roles: &[("planar", ParamRole::Choice)],
        negligible: 0.02,
        // Most touching surfaces do not slip with this coefficient. From zero, where contacts change at once, no search leads to it.
        start: Some(SearchStart::Amplitudes(&[0.3])),
        ..Profile::LAW
    };
    const SEEDS: Seeds = &[("planar", Seed::Values(&[0.0, 1.0]))];

    fn contact<T: Real>(pa: &[T], _pb: &[T], contact: &Contact<T>, out: &mut ContactLaw<T>) {
        if contact.b.is_some() {
            out.friction += pa[0];
            out.tangential_restitution += pa[1];
            out.ignore_roll += pa[2];
        }
    }
}
