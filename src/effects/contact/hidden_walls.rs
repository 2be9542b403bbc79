//! Four walls around the objects that nobody stated: the edge of a table.

use crate::body::{Obstacle, ObstacleShape};
use crate::effects::{
    Effect, EffectSpec, Hook, ObstacleForm, ParamRole, ParamSpec, Profile, Quantity, Scope, SearchStart,
    Symmetry, joined,
};
use crate::num::Real;

pub struct HiddenWalls;

const fn side(name: &'static str, default: f64, doc: &'static str) -> ParamSpec {
    ParamSpec { name, unit: "m", default, min: -100.0, max: 100.0, scope: Scope::Setup, doc }
}

impl Effect for HiddenWalls {
    const SPEC: EffectSpec = EffectSpec {
        name: "hidden_walls",
        doc: "Hidden walls: a static rectangle with sides along x and y that keeps objects in, as a table that is not stated.",
        source: "Impact on fixed planes",
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
            side("left", -1.0, "x of the wall on the side of small x"),
            side("right", 1.0, "x of the wall on the side of large x"),
            side("bottom", -1.0, "y of the wall on the side of small y"),
            side("top", 1.0, "y of the wall on the side of large y"),
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
    const KIND: &str = "hidden_wall";
    const FORM: Option<&str> = Some("rectangle");
    const PROFILE: Profile = Profile {
        param_roles: &[("presence", ParamRole::Presence), ("restitution", ParamRole::WallRestitution)],
        start: Some(SearchStart::BehindImpacts(ObstacleForm::Rectangle)),
        ..Profile::LAW
    };
    const SYMMETRY: Symmetry = Symmetry::None;

    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        let form = Self::FORM.map(|word| ("form", Quantity::Word(word)));
        form.into_iter().chain(joined(&Self::SPEC.params[1..], &p[1..])).collect()
    }

    fn bodies<T: Real>(p: &[T]) -> Option<Obstacle<T>> {
        let outline = ObstacleShape::Inside { x: [p[1], p[2]], y: [p[3], p[4]] };
        Some(Obstacle { name: Self::SPEC.name, outline, presence: p[0], restitution: p[5] })
    }
}
