//! A wrong frame rate: an error of the camera that imitates a force.

use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Quantity, Scope, Symmetry};
use crate::num::Real;

pub struct FrameRate;

impl Effect for FrameRate {
    const SPEC: EffectSpec = EffectSpec {
        name: "frame_rate",
        doc: "The clock of the video is wrong: t_true = (1 + excess) t + offset.",
        source: "A rival to forces",
        hooks: &[Hook::Clock],
        params: &[
            ParamSpec {
                name: "excess",
                unit: "1",
                default: 0.0,
                min: -0.5,
                max: 1.0,
                scope: Scope::Setup,
                doc: "true seconds per second of the video, less 1",
            },
            ParamSpec {
                name: "offset",
                unit: "s",
                default: 0.0,
                min: -1.0,
                max: 1.0,
                scope: Scope::Setup,
                doc: "true time of the video's time 0",
            },
        ],
    };
    const PROFILE: Profile = Profile::CAMERA;
    const AMPLITUDES: usize = 2;
    const SYMMETRY: Symmetry = Symmetry::None;

    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        vec![("factor", Quantity::Number(1.0 + p[0])), ("offset", Quantity::Number(p[1]))]
    }

    fn clock<T: Real>(p: &[T], time: f64) -> T {
        p[0] * time + p[1]
    }
}
