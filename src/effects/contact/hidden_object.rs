//! A fixed round object that no track shows.

use crate::body::{Obstacle, ObstacleShape};
use crate::effects::{
    Effect, EffectSpec, Hook, ObstacleForm, ParamRole, ParamSpec, Profile, Quantity, Scope, SearchStart,
    Seed, Seeds, Symmetry, joined,
};
use crate::num::{Real, vec2};

pub struct HiddenObject;

impl Effect for HiddenObject {
    const SPEC: EffectSpec = EffectSpec {
        name: "hidden_object",
        doc: "A hidden object: a static disc that no track shows.",
        source: "Impact on a fixed disc",
        hooks: &[Hook::Bodies],
        params: &[
            ParamSpec {
                name: "presence",
                unit: "1",
                default: 0.0,
                min: 0.0,
                max: 1.0,
                scope: Scope::Setup,
                doc: "share of the impulse that it gives: 0 lets bodies through, 1 is solid",
            },
            ParamSpec {
                name: "center_x",
                unit: "m",
                default: 0.0,
                min: -100.0,
                max: 100.0,
                scope: Scope::Setup,
                doc: "its middle",
            },
            ParamSpec {
                name: "center_y",
                unit: "m",
                default: 0.0,
                min: -100.0,
                max: 100.0,
                scope: Scope::Setup,
                doc: "its middle",
            },
            ParamSpec {
                name: "radius",
                unit: "m",
                default: 0.2,
                min: 0.001,
                max: 10.0,
                scope: Scope::Setup,
                doc: "its radius",
            },
            ParamSpec {
                name: "restitution",
                unit: "1",
                default: 0.8,
                min: 0.0,
                max: 1.0,
                scope: Scope::Setup,
                doc: "ratio of separation to approach speed",
            },
        ],
    };
    const PROFILE: Profile = Profile {
        param_roles: &[("presence", ParamRole::Presence), ("restitution", ParamRole::WallRestitution)],
        start: Some(SearchStart::BehindImpacts(ObstacleForm::Disc)),
        ..Profile::LAW
    };
    const SYMMETRY: Symmetry = Symmetry::None;
    const SEEDS: Seeds =
        &[("center_x", Seed::PlaceX), ("center_y", Seed::PlaceY), ("radius", Seed::Values(&[0.1, 0.3]))];

    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        joined(&Self::SPEC.params[1..], &p[1..])
    }

    fn bodies<T: Real>(p: &[T]) -> Option<Obstacle<T>> {
        let outline = ObstacleShape::Disc { center: vec2(p[1], p[2]), radius: p[3] };
        Some(Obstacle { name: Self::SPEC.name, outline, presence: p[0], restitution: p[4] })
    }
}
