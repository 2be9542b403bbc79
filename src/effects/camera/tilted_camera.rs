//! A camera that does not look straight down: an error that imitates a force.

use crate::body::Observation;
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope, Symmetry};
use crate::num::{Real, vec2};

pub struct TiltedCamera;

impl Effect for TiltedCamera {
    const SPEC: EffectSpec = EffectSpec {
        name: "tilted_camera",
        doc: "The camera is tilted: x_seen = x/(1 - h.x): the perspective of a plane that recedes along h.",
        source: "Hartley and Zisserman, Multiple View Geometry, sec. 2.4",
        hooks: &[Hook::Observe],
        params: &[
            ParamSpec {
                name: "h_x",
                unit: "1/m",
                default: 0.0,
                min: -0.1,
                max: 0.1,
                scope: Scope::Setup,
                doc: "change of scale per distance",
            },
            ParamSpec {
                name: "h_y",
                unit: "1/m",
                default: 0.0,
                min: -0.1,
                max: 0.1,
                scope: Scope::Setup,
                doc: "change of scale per distance",
            },
        ],
    };
    const PROFILE: Profile = Profile::CAMERA;
    const AMPLITUDES: usize = 2;
    const SYMMETRY: Symmetry = Symmetry::None;

    fn observe<T: Real>(p: &[T], out: &mut Observation<T>) {
        let depth = -vec2(p[0], p[1]).dot(out.position) + 1.0;
        out.position = out.position * (T::constant(1.0) / depth);
    }
}
