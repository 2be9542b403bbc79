//! Ground friction that acts a little beside the centre of mass: a sliding body turns slowly and drifts.

use super::{Effect, EffectSpec, Hook, ParamSpec, Scope, Symmetry};
use crate::body::{Body, Wrench};
use crate::num::Real;

pub struct FrictionOffset;

impl Effect for FrictionOffset {
    const SPEC: EffectSpec = EffectSpec {
        name: "friction_offset",
        doc: "The ground's friction on a sliding foot acts at a lever beside the centre of mass, askew to the velocity; a box rocks, as any that stands on four corners; a foot may carry less at its edge.",
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
                doc: "share by which a box stands more on one diagonal of its corners than on the other",
            },
            ParamSpec {
                name: "foot",
                unit: "1",
                default: 0.0,
                min: -1.0,
                max: 0.0,
                scope: Scope::Shape,
                doc: "how much nearer to the middle than rim and corners the weight stands: -0.3 evenly spread, -1 a point",
            },
        ],
    };

    const SYMMETRY: Symmetry = Symmetry::Chiral;

    fn force<T: Real>(p: &[T], _time: T, _body: &Body<T>, out: &mut Wrench<T>) {
        out.friction_arm += p[0];
        out.friction_skew += p[1];
        out.diagonal_load += p[2];
        out.load_concentration += p[3];
    }
}
