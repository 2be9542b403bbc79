//! A straight wall that no track shows.

use crate::body::{Obstacle, ObstacleShape};
use crate::effects::{
    Effect, EffectSpec, Hook, ObstacleForm, ParamRole, ParamSpec, Profile, Quantity, Scope, SearchStart,
    Seed, Seeds, Symmetry,
};
use crate::num::{Real, elementary};

pub struct HiddenWall;

impl Effect for HiddenWall {
    const SPEC: EffectSpec = EffectSpec {
        name: "hidden_wall",
        doc: "A hidden wall: static; everything behind the line through point = offset normal is solid.",
        source: "Impact on a fixed plane",
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
                name: "offset",
                unit: "m",
                default: 0.0,
                min: -100.0,
                max: 100.0,
                scope: Scope::Setup,
                doc: "distance of the wall from the origin along its normal",
            },
            ParamSpec {
                name: "angle",
                unit: "rad",
                default: 0.0,
                min: -10.0,
                max: 10.0,
                scope: Scope::Setup,
                doc: "direction of the normal, towards the objects",
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
        start: Some(SearchStart::BehindImpacts(ObstacleForm::Wall)),
        ..Profile::LAW
    };
    const SYMMETRY: Symmetry = Symmetry::None;
    const SEEDS: Seeds = &[("offset", Seed::Offset), ("angle", Seed::Angle)];

    /// The point is the wall's nearest to the origin.
    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        let (sin, cos) = elementary::sin_cos(p[2]);
        let normal = [cos, sin];
        vec![
            ("point", Quantity::Vector([p[1] * normal[0], p[1] * normal[1]])),
            ("normal", Quantity::Vector(normal)),
            ("restitution", Quantity::Number(p[3])),
        ]
    }

    fn bodies<T: Real>(p: &[T]) -> Option<Obstacle<T>> {
        let outline = ObstacleShape::HalfPlane { offset: p[1], angle: p[2] };
        Some(Obstacle { name: Self::SPEC.name, outline, presence: p[0], restitution: p[3] })
    }
}
