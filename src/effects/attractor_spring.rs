//! A spring to a fixed place: an attractor that grows with distance.

use super::{Effect, EffectSpec, Hook, ParamSpec, Scope, Seed, Seeds, Symmetry};
use crate::body::{Body, Wrench};
use crate::num::{Real, vec2};

pub struct AttractorSpring;

impl Effect for AttractorSpring {
    const SPEC: EffectSpec = EffectSpec {
        name: "attractor_spring",
        doc: "F = k (center - x); negative k drives away.",
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
            ParamSpec {
                name: "center_x",
                unit: "m",
                default: 0.0,
                min: -100.0,
                max: 100.0,
                scope: Scope::Setup,
                doc: "where it is centred",
            },
            ParamSpec {
                name: "center_y",
                unit: "m",
                default: 0.0,
                min: -100.0,
                max: 100.0,
                scope: Scope::Setup,
                doc: "where it is centred",
            },
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
