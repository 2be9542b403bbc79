//! Coulomb friction between objects that touch.

use super::{Effect, EffectSpec, Hook, ParamSpec, Scope, Seed, Seeds};
use crate::body::{Contact, ContactLaw};
use crate::num::Real;

pub struct ContactFriction;

impl Effect for ContactFriction {
    const SPEC: EffectSpec = EffectSpec {
        name: "contact_friction",
        doc: "Touching surfaces rub: tangential impulse of at most mu times the normal impulse, against the slip of the touching points; where it holds them, surfaces that shear give slip back, or leave some.",
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
                doc: "share of the slip that comes back reversed where friction holds; below 0: that is left",
            },
            ParamSpec {
                name: "planar",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 1.0,
                scope: Scope::Setup,
                doc: "share of a ball's rolling that does not rub where it touches others: 1 in engines whose contacts know the plane only",
            },
        ],
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
