//! Adhesion: objects that touch stick and move on as one body.

use crate::body::{Contact, ContactLaw};
use crate::effects::{Effect, EffectSpec, Hook, ParamRole, ParamSpec, Profile, Quantity, Scope, SearchStart};
use crate::num::Real;

pub struct StickyContact;

impl Effect for StickyContact {
    const SPEC: EffectSpec = EffectSpec {
        name: "sticky_contact",
        doc: "Objects stick together: a plastic impact that also ends slip and relative spin; then both move as one rigid body until a pull of `strength` separates them.",
        source: "Euler's laws of a rigid body; Goldstein, Classical Mechanics, ch. 5",
        hooks: &[Hook::Contact],
        params: &[
            ParamSpec {
                name: "presence",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 1.0,
                scope: Scope::Setup,
                doc: "from 0.5 on they stick; below, the impact removes twice this share of the relative motion and they separate",
            },
            ParamSpec {
                name: "weakness",
                unit: "1/N",
                default: 0.0,
                min: 0.0,
                max: 1000.0,
                scope: Scope::Setup,
                doc: "one over the pull that separates them; 0: nothing does",
            },
        ],
    };
    const PROFILE: Profile = Profile {
        param_roles: &[("presence", ParamRole::Presence)],
        start: Some(SearchStart::AllOrNothing(&[1.0, 0.0])),
        ..Profile::LAW
    };

    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        let parts = p[1] > 0.0;
        parts.then(|| ("strength", Quantity::Number(1.0 / p[1]))).into_iter().collect()
    }

    fn contact<T: Real>(pa: &[T], _pb: &[T], contact: &Contact<T>, out: &mut ContactLaw<T>) {
        if contact.b.is_some() {
            let share = pa[0] * 2.0;
            out.stick += share;
            out.inverse_strength += pa[1] * share.min(T::constant(1.0));
        }
    }
}
