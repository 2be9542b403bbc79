//! Ground friction that acts a little beside the centre of mass: a sliding body turns slowly and drifts.

use crate::body::{Body, Wrench};
use crate::effects::{ActsOn, Effect, EffectSpec, Hook, ParamRole, ParamSpec, Profile, Scope, Symmetry};
use crate::num::Real;

/// Prior deviation of the angle between friction and velocity (rad): found in boxes and cylinders of Bullet.
const SKEW_SD: f64 = 0.02;

pub struct FrictionOffset;

impl Effect for FrictionOffset {
    const SPEC: EffectSpec = EffectSpec {
        name: "friction_offset",
        doc: "The ground's friction on a sliding object acts beside the centre of mass and at an angle to the velocity; a box may load one diagonal of its corners more; the load may be concentrated towards the middle.",
        source: "Uneven load over the foot: Goyal, Ruina and Papadopoulos, Wear 143 (1991) 307",
        hooks: &[Hook::Force],
        params: &[
            ParamSpec {
                name: "lever",
                unit: "m",
                default: 0.0,
                min: -0.05,
                max: 0.05,
                scope: Scope::Object,
                doc: "sideways distance from the centre of mass",
            },
            ParamSpec {
                name: "skew",
                unit: "rad",
                default: 0.0,
                min: -0.3,
                max: 0.3,
                scope: Scope::Object,
                doc: "angle of the friction force from the velocity's opposite",
            },
            ParamSpec {
                name: "rock",
                unit: "1",
                default: 0.0,
                min: -1.0,
                max: 1.0,
                scope: Scope::Object,
                doc: "share by which a box loads one diagonal of its corners more than the other",
            },
            ParamSpec {
                name: "foot",
                unit: "1",
                default: 0.0,
                min: -1.0,
                max: 0.0,
                scope: Scope::Shape,
                doc: "concentration of the load towards the middle: 0 at rim and corners, -0.3 evenly spread, -1 a point",
            },
        ],
    };
    const PROFILE: Profile = Profile {
        acts_on: ActsOn::SlidingFeet,
        param_roles: &[("lever", ParamRole::UnseenInFreeMotion)],
        nuisance_priors: &[("skew", SKEW_SD)],
        ..Profile::NUISANCE
    };

    const SYMMETRY: Symmetry = Symmetry::Chiral;

    fn force<T: Real>(p: &[T], _time: T, _body: &Body<T>, out: &mut Wrench<T>) {
        out.friction_arm += p[0];
        out.friction_skew += p[1];
        out.diagonal_load += p[2];
        out.load_concentration += p[3];
    }
}
