//! A spring to a fixed place: an attractor that grows with distance.

use crate::body::{Body, Wrench};
use crate::effects::{CENTER, Effect, EffectSpec, Hook, ParamSpec, Scope, Seed, Seeds, Symmetry};
use crate::num::{Real, vec2};

pub struct AttractorSpring;

impl Effect for AttractorSpring {
    const SPEC: EffectSpec = EffectSpec {
        name: "attractor_spring",
        doc: "Something pulls to a point like a spring: F = k (center - x); negative k drives away.",
        source: "Hooke's law",
        hooks: &[Hook::Force],
        params: &[
            ParamSpec {
                name: "k",
                unit: "N/m",
                default: 0.0,
                min: -50.0,
                max: 50.0,
                scope: Scope::Setup,
                doc: "force per distance",
            },
            CENTER[0],
            CENTER[1],
        ],
    };
    const KIND: &str = "attractor";
    const FORM: Option<&str> = Some("spring");
    const SYMMETRY: Symmetry = Symmetry::About { center: 1, mirrors: true };
    const SEEDS: Seeds = &[("center_x", Seed::PlaceX), ("center_y", Seed::PlaceY)];

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.force += (vec2(p[1], p[2]) - body.position) * p[0];
    }
}
