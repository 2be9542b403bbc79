//! A tracked point beside the centre of mass: an error of the tracker that imitates a force.

use crate::body::Observation;
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope, Symmetry};
use crate::num::{Real, Vec2, vec2};

pub struct OffCentreMarker;

impl Effect for OffCentreMarker {
    const SPEC: EffectSpec = EffectSpec {
        name: "off_centre_marker",
        doc: "The tracker follows a point beside the centre: x_seen = x + R(yaw) arm.",
        source: "Kinematics of a rigid body",
        hooks: &[Hook::Observe],
        params: &[
            ParamSpec {
                name: "arm_x",
                unit: "m",
                default: 0.0,
                min: -1.0,
                max: 1.0,
                scope: Scope::Object,
                doc: "from the centre of mass to the point, in the body's frame",
            },
            ParamSpec {
                name: "arm_y",
                unit: "m",
                default: 0.0,
                min: -1.0,
                max: 1.0,
                scope: Scope::Object,
                doc: "from the centre of mass to the point, in the body's frame",
            },
        ],
    };
    const PROFILE: Profile = Profile::CAMERA;
    const AMPLITUDES: usize = 2;
    const SYMMETRY: Symmetry = Symmetry::None;

    fn observe<T: Real>(p: &[T], out: &mut Observation<T>) {
        out.position += vec2(p[0], p[1]).rotated(Vec2::from_angle(out.yaw));
    }
}
