//! The outward acceleration of a table that turns.

use crate::body::{Body, Wrench};
use crate::effects::{CENTER, Effect, EffectSpec, Hook, ParamSpec, Profile, Scope, Seed, Seeds, Symmetry};
use crate::num::{Real, vec2};

pub struct Centrifugal;

impl Effect for Centrifugal {
    const SPEC: EffectSpec = EffectSpec {
        name: "centrifugal",
        doc: "The table turns: a = q (x - center), q = Omega^2, the same for all masses.",
        source: "Huygens (1673); Goldstein, Classical Mechanics, sec. 4.10",
        hooks: &[Hook::Force],
        params: &[
            ParamSpec {
                name: "q",
                unit: "1/s^2",
                default: 0.0,
                min: 0.0,
                max: 100.0,
                scope: Scope::Setup,
                doc: "square of the turn rate of the table",
            },
            CENTER[0],
            CENTER[1],
        ],
    };
    const PROFILE: Profile = Profile::LAW;
    const SYMMETRY: Symmetry = Symmetry::About { center: 1, mirrors: true };
    const SEEDS: Seeds = &[("center_x", Seed::PlaceX), ("center_y", Seed::PlaceY)];

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.force += (body.position - vec2(p[1], p[2])) * (body.mass * p[0]);
    }
}
