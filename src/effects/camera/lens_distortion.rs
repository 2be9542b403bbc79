//! A lens that bends lines: an error of the camera that imitates a pull to the middle of the picture, or away from it.

use crate::body::Observation;
use crate::effects::{CENTER, Effect, EffectSpec, Hook, ParamSpec, Profile, Scope, Seed, Seeds, Symmetry};
use crate::num::{Real, vec2};

pub struct LensDistortion;

/// Strongest barrel: from a third on, the picture of what is farther from the middle would come nearer again.
const STRONGEST: f64 = -0.25;

impl Effect for LensDistortion {
    const SPEC: EffectSpec = EffectSpec {
        name: "lens_distortion",
        doc: "The lens draws in the edge of the picture (barrel, k < 0) or pulls it out (pincushion): x_seen = x + k |d|^2 d, d = x - center.",
        source: "Brown, Photogrammetric Engineering 32 (1966) 444, first radial term",
        hooks: &[Hook::Observe],
        params: &[
            ParamSpec {
                name: "k",
                unit: "1/m^2",
                default: 0.0,
                min: -1000.0,
                max: 1000.0,
                scope: Scope::Setup,
                doc: "relative change of the distance from the middle, per squared distance",
            },
            CENTER[0],
            CENTER[1],
        ],
    };
    const PROFILE: Profile = Profile::CAMERA;
    const SYMMETRY: Symmetry = Symmetry::About { center: 1, mirrors: true };
    const SEEDS: Seeds = &[("center_x", Seed::PlaceX), ("center_y", Seed::PlaceY)];

    fn observe<T: Real>(p: &[T], out: &mut Observation<T>) {
        let d = out.position - vec2(p[1], p[2]);
        out.position += d * (d.norm_squared() * p[0]).max(T::constant(STRONGEST));
    }
}
