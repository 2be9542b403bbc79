//! The cushion of a table: how its edge reflects a ball, with spin.

use crate::body::{Contact, ContactLaw};
use crate::effects::{ActsOn, Effect, EffectSpec, Hook, ParamRole, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct Cushion;

impl Effect for Cushion {
    const SPEC: EffectSpec = EffectSpec {
        name: "cushion",
        doc: "A wall's edge touches a ball above its centre: restitution along the inclined normal, Coulomb friction against the slip of the whole spin, which the rubber's shear can reverse.",
        source: "Han, J. Mech. Sci. Technol. 19 (2005) 976; Mathavan, Jackson and Parkin, Proc. IMechE C 224 (2010) 1863; Cross, Am. J. Phys. 70 (2002) 1093",
        hooks: &[Hook::Contact],
        params: &[
            ParamSpec {
                name: "restitution",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 1.0,
                scope: Scope::Setup,
                doc: "separation over approach speed along the inclined normal",
            },
            ParamSpec {
                name: "mu",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 2.0,
                scope: Scope::Setup,
                doc: "coefficient of friction between edge and ball",
            },
            ParamSpec {
                name: "height",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 0.6,
                scope: Scope::Setup,
                doc: "height of the edge over the ball's centre, in radii",
            },
            ParamSpec {
                name: "tangential_restitution",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 1.0,
                scope: Scope::Setup,
                doc: "share of the slip that is reversed where friction stops it",
            },
        ],
    };
    const PROFILE: Profile = Profile {
        acts_on: ActsOn::TableWalls,
        param_roles: &[("restitution", ParamRole::WallRestitution)],
        ..Profile::LAW
    };

    fn contact<T: Real>(pa: &[T], _pb: &[T], contact: &Contact<T>, out: &mut ContactLaw<T>) {
        if contact.b.is_none() {
            out.restitution = (out.restitution + pa[0]).min(T::constant(1.0));
            out.friction += pa[1];
            out.contact_height += pa[2];
            out.tangential_restitution += pa[3];
        }
    }
}
